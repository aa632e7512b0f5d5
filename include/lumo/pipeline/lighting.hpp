#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/executor.hpp"
#include "lumo/core/stopwatch.hpp"
#include "lumo/mechanics/contact/state.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "lumo/morphology/body.hpp"
#include "lumo/optics/response.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/optics/transport/ray_pattern.hpp"
#include "lumo/pipeline/ensemble.hpp"
#include "lumo/pipeline/observations.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <map>
#include <set>
#include <utility>
#include <vector>

namespace lumo {

/// Planes in which body, mesh, emitters and the states of a scenario are their own mirror images.
template <Indenter Tool> Symmetry symmetry_of(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario) {
  const Symmetry unloaded = symmetry_of(body, mesh), contact = symmetry_of(scenario);
  return {unloaded.x && contact.x, unloaded.y && contact.y};
}

/// The same for a state that ended with `status`. Sweeps visit vertices one after the other: a state that they hold is
/// not its own mirror image.
template <Indenter Tool>
Symmetry symmetry_of(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario, Status status) {
  return status == Status::held ? Symmetry{} : symmetry_of(body, mesh, scenario);
}

/// Rays of a round of refinement, in those of round 0: 1, 1, 2, 2, 4, 4, 4, …
constexpr int rays_of(int round) { return round < 4 ? 1 << (round / 2) : 4; }

/// Rays of all rounds up to this one: 1, 2, 4, 6, 10, 14, 18, …
constexpr int rays_up_to(int round) {
  int all = 0;
  for (int r = 0; r <= round; ++r) all += rays_of(r);
  return all;
}

/// How the states that decide J_obs become known better than the others. Each round traces the states that
/// undecided_states() names with new rays, at first half as many as they have had (and the unloaded bodies on their
/// meshes, too), until there are none. The error covers those still undecided then.
struct RayRefinement {
  double tolerance = 0.015;  ///< wanted standard error of J_obs, and of all that might be less, as a fraction
  int rounds = 17;           ///< at most this many: rays_up_to(17) = 62; 0: everything is traced once
  double focus_m = 14e-3;    ///< the new rays' density falls by e over this distance from the contact's place
};

/// A solved scenario with its fields.
struct SolvedScenario {
  ScenarioRecord record;
  std::vector<MechanicalState> states;
  double seconds = 0.0;
};

/// Light in the states of all solved scenarios.
template <class Light, class Pad, Indenter Tool> class Lighting {
 public:
  /// `places`: the body on its mesh for each place of the plan.
  Lighting(const Body& body, const ContactPlan<Tool>& plan, const Light& light, double focus_m,
      const std::vector<Pad>& places, const std::vector<SolvedScenario>& solved)
      : body_(body), plan_(plan), light_(light), focus_m_(focus_m), places_(places), solved_(solved) {
    for (std::size_t k = 0; k < solved.size(); ++k) {
      records_.push_back(solved[k].record);
      for (std::size_t s = 0; s < solved[k].states.size(); ++s)
        if (is_scored(solved[k].states[s].status, true)) all_.push_back({k, s});
    }
  }

  struct State {
    std::size_t solve, state;
    auto operator<=>(const State&) const = default;
  };
  const std::vector<State>& all() const { return all_; }

  /// Traces these states with the rays of all rounds up to `round` that they lack, and the unloaded body on their
  /// meshes with the same rays. Round 0 takes all meshes, and sends its rays evenly; later ones send them to the
  /// contact's place. Rounds have independent patterns. `report(count)` is called after each of `count` jobs.
  template <Executor E, class Report>
  void trace(const std::vector<State>& wanted, int round, const E& executor, Report&& report) {
    const std::vector<Job> jobs = jobs_for(wanted, round);
    std::vector<Response> lit(jobs.size());
    std::vector<double> spent(jobs.size(), 0.0);
    executor.for_each(jobs.size(), [&](std::size_t task) {
      const Stopwatch watch;
      const std::size_t i = jobs.size() - 1 - task;  // long ones first, so that threads end together
      lit[i] = light(jobs[i]);
      spent[i] = watch.seconds();
      report(jobs.size());
    });
    keep(jobs, lit, spent);
  }

  /// Records of the solved scenarios, with their changes.
  const std::vector<ScenarioRecord>& records() const { return records_; }

  /// Responses of the undeformed body on each mesh.
  const std::vector<Response>& unloaded() const { return unloaded_.front(); }

  /// States that decide the least distance of those observed in `all` scenarios, mirror images being one state. A pure
  /// function of the responses.
  std::vector<State> undecided(const std::vector<ScenarioRecord>& all, double tolerance) const {
    const std::vector<ObservedState> observed = observed_states(all);
    std::vector<State> states;
    for (std::size_t i : undecided_states(observed, tolerance)) {
      const std::size_t solve = plan_.images[observed[i].scenario].solve;
      const auto& candidates = records_[solve].states;
      const auto it = std::find_if(
          candidates.begin(), candidates.end(), [&](const StateRecord& s) { return s.load_N == observed[i].load_N; });
      states.push_back({solve, std::size_t(it - candidates.begin())});
    }
    std::sort(states.begin(), states.end());
    states.erase(std::unique(states.begin(), states.end()), states.end());
    return states;
  }

  EnergyLedger ledger;   ///< of the traced state that closes worst
  double seconds = 0.0;  ///< spent in tracing, summed over threads

 private:
  struct Job {
    std::size_t place;
    int round;
    const State* state;  ///< null: unloaded
  };

  std::vector<Job> jobs_for(const std::vector<State>& wanted, int round) {
    unloaded_.resize(std::max(unloaded_.size(), std::size_t(round) + 1), std::vector<Response>(places_.size()));
    std::vector<Job> jobs;
    std::set<std::pair<int, std::size_t>> bare;  // (round, place)
    for (const State& s : wanted)
      for (int r = rounds_[s]; r <= round; ++r) {
        jobs.push_back({plan_.solves[s.solve].place, r, &s});
        bare.insert({r, jobs.back().place});
      }
    for (std::size_t place = 0; round == 0 && place < places_.size(); ++place) bare.insert({0, place});
    for (const auto& [r, place] : bare)
      if (unloaded_[std::size_t(r)][place].power_W.empty()) jobs.push_back({place, r, nullptr});
    std::stable_sort(jobs.begin(), jobs.end(), [](const Job& a, const Job& b) { return a.round < b.round; });
    return jobs;
  }

  Response light(const Job& job) const {
    const Light refined = light_.refined(rays_of(job.round), std::uint64_t(job.round));
    const TetMesh& mesh = places_[job.place]->mesh();
    RayFocus focus;  // even, as round 0 serves all states, and as other tilts touch away from their place
    const auto& p = plan_.places[job.place];
    if (job.round > 0 && (p.angle_rad == 0.0 || p.tilt == TiltPlane::xz)) {
      focus.y_m = p.y_m;
      focus.length_m = focus_m_;
    }
    if (job.state == nullptr) {
      const Symmetry unloaded = symmetry_of(body_, mesh);
      return refined.trace(body_, mesh, {}, {}, {unloaded.x, unloaded.y && focus.is_symmetric()}, focus);
    }
    const MechanicalState& loaded = solved_[job.state->solve].states[job.state->state];
    const Symmetry symmetry = symmetry_of(body_, mesh, plan_.solves[job.state->solve].scenario, loaded.status);
    return refined.trace(body_, mesh, loaded, symmetry, focus);
  }

  void keep(const std::vector<Job>& jobs, const std::vector<Response>& lit, const std::vector<double>& spent) {
    for (std::size_t i = 0; i < jobs.size(); ++i) {
      seconds += spent[i];
      if (ledger.emitted == 0.0 || lit[i].ledger.imbalance() >= ledger.imbalance()) ledger = lit[i].ledger;
      if (jobs[i].state == nullptr) unloaded_[std::size_t(jobs[i].round)][jobs[i].place] = lit[i];
    }
    for (std::size_t i = 0; i < jobs.size(); ++i) {
      const auto& [place, r, state] = jobs[i];
      if (state == nullptr) continue;
      const Eigen::MatrixXd change = response_change(lit[i], unloaded_[std::size_t(r)][place]);
      Eigen::MatrixXd& sum = records_[state->solve].states[state->state].change;
      const double share = double(rays_of(r)) / rays_up_to(r);
      sum = r == 0 ? change : Eigen::MatrixXd((1.0 - share) * sum + share * change);
      rounds_[*state] = r + 1;
    }
  }

  const Body& body_;
  const ContactPlan<Tool>& plan_;
  const Light& light_;
  double focus_m_;
  const std::vector<Pad>& places_;
  const std::vector<SolvedScenario>& solved_;
  std::vector<ScenarioRecord> records_;
  std::vector<State> all_;
  std::map<State, int> rounds_;                  ///< that a state has had
  std::vector<std::vector<Response>> unloaded_;  ///< by round and place; empty if it was not needed
};

}  // namespace lumo
