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
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <numeric>
#include <optional>
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

/// How the states that decide J_obs become known better than the others. First all states are lit with few rays. Then
/// each round lights the states that undecided_states() names with as many as their noise asks for, in one pattern (and
/// the unloaded bodies on their meshes, too), until there are none. The error covers those still undecided then. Rays
/// of states are sent where contacts at their place change the light.
struct RayRefinement {
  double tolerance = 0.02;  ///< wanted standard error of J_obs, and of all that might be less, as a fraction
  int rounds = 8;           ///< at most this many; 0: everything is lit once, with the tracer's rays
  double pilot = 0.25;     ///< share of the tracer's rays that all states are lit with if rounds follow; a power of two
  double focus_m = 14e-3;  ///< the rays' density falls by e over this distance from the contact's place

  static constexpr double most = 512.0;       ///< times the tracer's rays, in one pattern
  static constexpr double most_growth = 4.0;  ///< from one round to the next
  /// Variance falls as the rays to this power: one fine pattern is worth more than many coarse ones. Measured from 1 to
  /// 16 times the default's rays on the deciding pair of the plain baseline: 1.4.
  static constexpr double rate = 1.4;

  /// Rays, in the tracer's, for a state that has had `rays` and whose error is `excess` times the wanted one.
  static double next(double rays, double excess) {
    const double growth = std::exp2(std::ceil(2.0 / rate * std::log2(excess) - 0.5));
    return std::min(most, rays * std::clamp(growth, 2.0, most_growth));
  }
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
  Lighting(const Body& body, const ContactPlan<Tool>& plan, const Light& light, const RayRefinement& rays,
      const std::vector<Pad>& places, const std::vector<SolvedScenario>& solved)
      : body_(body), plan_(plan), light_(light), rays_(rays), places_(places), solved_(solved) {
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
  /// A state, and with how many rays it is to be lit, in the tracer's.
  struct Wanted {
    State state;
    double rays;
  };

  /// All states, for the first trace, which lights the unloaded body on all meshes, too.
  std::vector<Wanted> all() const {
    std::vector<Wanted> wanted;
    for (const State& s : all_) wanted.push_back({s, pilot()});
    return wanted;
  }

  /// Lights these states, and the unloaded body on their meshes with the same rays. Patterns of different size are
  /// independent. `report(count)` is called after each of `count` jobs. Throws NumericalError if too much light is
  /// lost.
  template <Executor E, class Report>
  void trace(const std::vector<Wanted>& wanted, const E& executor, Report&& report) {
    if (guides_.empty()) learn(executor);
    const std::vector<Job> jobs = jobs_for(wanted);
    std::vector<Task> tasks;  // long ones first, so that threads end together
    for (std::size_t j = 0; j < jobs.size(); ++j) {
      const int parts = parts_of(jobs[j]);
      for (int part = 0; part < parts; ++part) tasks.push_back({j, part, parts});
    }
    std::stable_sort(tasks.begin(), tasks.end(), [&](const Task& a, const Task& b) {
      return jobs[a.job].bare.rays / a.parts > jobs[b.job].bare.rays / b.parts;
    });
    std::vector<Response> lit(tasks.size());
    std::vector<double> spent(tasks.size(), 0.0);
    executor.for_each(tasks.size(), [&](std::size_t i) {
      const Stopwatch watch;
      lit[i] = light(jobs[tasks[i].job], tasks[i].part, tasks[i].parts);
      spent[i] = watch.seconds();
      report(tasks.size());
    });
    seconds += std::accumulate(spent.begin(), spent.end(), 0.0);
    std::vector<std::vector<Response>> parts(jobs.size());
    for (std::size_t i = 0; i < tasks.size(); ++i) parts[tasks[i].job].push_back(std::move(lit[i]));
    keep(jobs, parts);
  }

  /// Records of the solved scenarios, with their changes.
  const std::vector<ScenarioRecord>& records() const { return records_; }

  /// Responses of the undeformed body on each mesh, with rays that are sent evenly.
  std::vector<Response> unloaded() const {
    std::vector<Response> each;
    for (std::size_t place = 0; place < places_.size(); ++place) each.push_back(unloaded_.at({place, pilot(), {}}));
    return each;
  }

  /// States that decide the least distance of those observed in `all` scenarios, mirror images being one state, and the
  /// rays that they need. A pure function of the responses.
  std::vector<Wanted> undecided(const std::vector<ScenarioRecord>& all, const OpticalError& mesh) const {
    const std::vector<ObservedState> observed = observed_states(all);
    std::map<State, double> excess;
    for (const Undecided& u : undecided_states(observed, rays_.tolerance, mesh)) {
      const ObservedState& o = observed[u.state];
      const std::size_t solve = plan_.images[o.scenario].solve;
      const auto& candidates = records_[solve].states;
      const auto it = std::find_if(
          candidates.begin(), candidates.end(), [&](const StateRecord& s) { return s.load_N == o.load_N; });
      double& most = excess[{solve, std::size_t(it - candidates.begin())}];
      most = std::max(most, u.excess);
    }
    std::vector<Wanted> wanted;
    for (const auto& [state, e] : excess)
      if (const double had = had_.at(state).rays, rays = RayRefinement::next(had, e); rays > had)
        wanted.push_back({state, rays});
    return wanted;
  }

  EnergyLedger ledger;   ///< of the traced state that closes worst
  double seconds = 0.0;  ///< spent in tracing, summed over threads

 private:
  // An undeformed body, as it is lit for a state.
  struct Bare {
    std::size_t place;
    double rays;
    std::optional<double> focus_m;  // y that more rays are sent to than elsewhere; with them goes the place's guide
    auto operator<=>(const Bare&) const = default;
  };
  struct Job {
    Bare bare;
    const State* state;  // null: unloaded
  };
  // What a state was lit with: rays of the last and finest pattern, and the weight of all.
  struct Had {
    double rays = 0.0, weight = 0.0;
  };
  struct Task {
    std::size_t job;
    int part, parts;
  };

  double pilot() const { return rays_.rounds > 0 ? rays_.pilot : 1.0; }

  // Long traces are divided by their replicates, so that all threads have work.
  int parts_of(const Job& job) const {
    int parts = 1;
    while (parts < job.bare.rays && 2 * parts <= light_.config().replicates) parts *= 2;
    return parts;
  }

  // What is worth knowing before light is traced, place by place: of the undeformed body, and how the states at the
  // middle loads differ from it, which stand for the others there.
  template <Executor E> void learn(const E& executor) {
    std::vector<std::vector<State>> taught(places_.size());
    for (const State& s : all_)
      if (s.state == solved_[s.solve].states.size() / 2) taught[plan_.solves[s.solve].place].push_back(s);
    guides_.resize(places_.size());
    std::vector<double> spent(places_.size(), 0.0);
    executor.for_each(places_.size(), [&](std::size_t place) {
      const Stopwatch watch;
      const TetMesh& mesh = places_[place]->mesh();
      Symmetry all = symmetry_of(body_, mesh);
      std::vector<const MechanicalState*> states;
      for (const State& s : taught[place]) {
        states.push_back(&solved_[s.solve].states[s.state]);
        const Symmetry one = symmetry_of(body_, mesh, plan_.solves[s.solve].scenario, states.back()->status);
        all = {all.x && one.x, all.y && one.y};
      }
      guides_[place] = light_.guide(body_, mesh, states, all);
      spent[place] = watch.seconds();
    });
    seconds += std::accumulate(spent.begin(), spent.end(), 0.0);
  }

  std::vector<Job> jobs_for(const std::vector<Wanted>& wanted) {
    std::set<Bare> bare;
    std::vector<Job> jobs;
    for (const Wanted& w : wanted) {
      const auto& solve = plan_.solves[w.state.solve];
      jobs.push_back({{solve.place, w.rays, solve.scenario.y_m}, &w.state});
      bare.insert(jobs.back().bare);
    }
    for (std::size_t place = 0; unloaded_.empty() && place < places_.size(); ++place) bare.insert({place, pilot(), {}});
    for (const Bare& b : bare)
      if (!unloaded_.contains(b)) jobs.push_back({b, nullptr});
    return jobs;
  }

  Response light(const Job& job, int part, int parts) const {
    const auto& [place, rays, focus_m] = job.bare;
    const int count = light_.config().replicates / parts;
    const Light refined = light_.refined(rays, std::uint64_t(std::log2(rays / pilot()))).portion(part * count, count);
    const TetMesh& mesh = places_[place]->mesh();
    if (!focus_m) return refined.trace(body_, mesh);
    const auto& p = plan_.places[place];
    RayFocus focus{.y_m = *focus_m};
    if (p.angle_rad == 0.0 || p.tilt == TiltPlane::xz) focus.length_m = rays_.focus_m;  // others touch elsewhere
    if (job.state == nullptr) {
      const Symmetry unloaded = symmetry_of(body_, mesh);
      return refined.trace(
          body_, mesh, SurfaceState{}, {unloaded.x, unloaded.y && focus.is_symmetric()}, focus, guides_[place]);
    }
    const MechanicalState& loaded = solved_[job.state->solve].states[job.state->state];
    const Symmetry symmetry = symmetry_of(body_, mesh, plan_.solves[job.state->solve].scenario, loaded.status);
    return refined.trace(body_, mesh, loaded, symmetry, focus, guides_[place]);
  }

  void keep(const std::vector<Job>& jobs, const std::vector<std::vector<Response>>& parts) {
    std::vector<Response> lit;
    for (std::size_t j = 0; j < jobs.size(); ++j) {
      lit.push_back(Light::joined(parts[j]));
      require_closed(lit.back().ledger, light_.refined(jobs[j].bare.rays).lost_admitted(body_));
    }
    for (std::size_t j = 0; j < jobs.size(); ++j) {
      if (ledger.emitted == 0.0 || lit[j].ledger.imbalance() >= ledger.imbalance()) ledger = lit[j].ledger;
      if (jobs[j].state == nullptr) unloaded_[jobs[j].bare] = lit[j];
    }
    for (std::size_t j = 0; j < jobs.size(); ++j) {
      const auto& [bare, state] = jobs[j];
      if (state == nullptr) continue;
      const Eigen::MatrixXd change = response_change(lit[j], unloaded_.at(bare));
      Eigen::MatrixXd& mean = records_[state->solve].states[state->state].change;
      // Patterns count by the inverse of their variance.
      Had& had = had_[*state];
      const double weight = std::pow(bare.rays, RayRefinement::rate), share = weight / (had.weight + weight);
      mean = had.weight == 0.0 ? change : Eigen::MatrixXd((1.0 - share) * mean + share * change);
      had.weight += weight;
      had.rays = bare.rays;
    }
  }

  const Body& body_;
  const ContactPlan<Tool>& plan_;
  const Light& light_;
  RayRefinement rays_;
  const std::vector<Pad>& places_;
  const std::vector<SolvedScenario>& solved_;
  std::vector<ScenarioRecord> records_;
  std::vector<State> all_;
  std::map<State, Had> had_;
  std::map<Bare, Response> unloaded_;
  std::vector<RayGuide> guides_;  // per place
};

}  // namespace lumo
