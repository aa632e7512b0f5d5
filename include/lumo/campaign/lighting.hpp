#pragma once

#include "lumo/campaign/ensemble.hpp"
#include "lumo/campaign/observations.hpp"
#include "lumo/campaign/stopwatch.hpp"
#include "lumo/core/error.hpp"
#include "lumo/core/executor.hpp"
#include "lumo/mechanics/state.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "lumo/morphology/body.hpp"
#include "lumo/optics/response.hpp"
#include "lumo/optics/tracer.hpp"

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

namespace lumo {

/// Planes in which body, mesh, emitters and the states of a scenario are their own mirror images.
template <Indenter Tool>
Symmetry symmetry_of(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario) {
  const Symmetry unloaded = symmetry_of(body, mesh);
  return {unloaded.x && scenario.angle_rad == 0.0, unloaded.y && scenario.y_m == 0.0};
}

/// How the states that decide J_obs are retraced. A round takes those that undecided_states() names, with `factor` times the rays of the round
/// before (and the unloaded bodies on their meshes, too), until there are none. What is still undecided after the last round shows in the error.
struct RayRefinement {
  double tolerance = 0.015; ///< wanted standard error of J_obs, and of all that might be less, as a fraction
  int factor = 4;           ///< a power of two
  int rounds = 3;           ///< 0: everything is traced once
};

namespace detail {

/// A solved scenario with its fields.
struct SolvedScenario {
  ScenarioRecord record;
  std::vector<MechanicalState> states;
  double seconds = 0.0;
};

/// Light in the states of all solved scenarios.
template <class Light, class Pad>
class Lighting {
 public:
  /// `places`: the body on its mesh for each place of the plan.
  Lighting(const Body& body, const ContactPlan& plan, const Light& light, const std::vector<Pad>& places, std::vector<SolvedScenario>& solved)
      : body_(body), plan_(plan), light_(light), places_(places), solved_(solved) {
    for (std::size_t k = 0; k < solved.size(); ++k)
      for (std::size_t s = 0; s < solved[k].states.size(); ++s)
        if (const Status status = solved[k].states[s].status; status == Status::converged || status == Status::held) all_.push_back({k, s});
  }

  struct State {
    std::size_t solve, state;
    auto operator<=>(const State&) const = default;
  };
  const std::vector<State>& all() const { return all_; }

  /// Traces these states with `factor` times the rays, and the unloaded body on their meshes (factor 1: on all meshes), and notes their changes.
  /// Returns the unloaded responses by place; of places that were not needed they are empty.
  template <Executor E, class Report>
  std::vector<Response> trace(const std::vector<State>& wanted, int factor, const E& executor, Report&& report) {
    std::vector<std::size_t> used;
    for (const State& s : wanted) used.push_back(plan_.solves[s.solve].place);
    for (std::size_t place = 0; factor == 1 && place < places_.size(); ++place) used.push_back(place);
    std::sort(used.begin(), used.end());
    used.erase(std::unique(used.begin(), used.end()), used.end());

    const Light light = light_.refined(factor);
    std::vector<Response> unloaded(places_.size()), loaded(wanted.size());
    std::vector<double> spent(used.size() + wanted.size(), 0.0);
    executor.for_each(spent.size(), [&](std::size_t i) {
      const Stopwatch watch;
      if (i >= wanted.size()) {  // short ones last, so that threads end together
        const std::size_t place = used[i - wanted.size()];
        unloaded[place] = light.trace(body_, places_[place]->mesh());
      } else {
        const auto [k, s] = wanted[i];
        const TetMesh& mesh = places_[plan_.solves[k].place]->mesh();
        loaded[i] = light.trace(body_, mesh, solved_[k].states[s], symmetry_of(body_, mesh, plan_.solves[k].scenario));
      }
      spent[i] = watch.seconds();
      report(spent.size());
    });
    for (double s : spent) seconds += s;

    const auto keep_worst = [&](const Response& r) {
      if (ledger.emitted == 0.0 || r.ledger.imbalance() >= ledger.imbalance()) ledger = r.ledger;
    };
    for (std::size_t place : used) keep_worst(unloaded[place]);
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      const auto [k, s] = wanted[i];
      solved_[k].record.states[s].change = response_change(loaded[i], unloaded[plan_.solves[k].place]);
      keep_worst(loaded[i]);
    }
    return unloaded;
  }

  /// States that decide the least distance of the observed ones, mirror images being one state. A pure function of the responses.
  std::vector<State> undecided(const std::vector<ScenarioRecord>& records, double tolerance) const {
    const std::vector<ObservedState> observed = observed_states(records);
    std::vector<State> states;
    for (std::size_t i : undecided_states(observed, tolerance)) {
      const std::size_t solve = plan_.images[observed[i].scenario].solve;
      const auto& candidates = solved_[solve].record.states;
      const auto it = std::find_if(candidates.begin(), candidates.end(), [&](const StateRecord& s) { return s.load_N == observed[i].load_N; });
      states.push_back({solve, std::size_t(it - candidates.begin())});
    }
    std::sort(states.begin(), states.end());
    states.erase(std::unique(states.begin(), states.end()), states.end());
    return states;
  }

  EnergyLedger ledger;   ///< of the traced state that closes worst
  double seconds = 0.0;  ///< spent in tracing, summed over threads

 private:
  const Body& body_;
  const ContactPlan& plan_;
  const Light& light_;
  const std::vector<Pad>& places_;
  std::vector<SolvedScenario>& solved_;
  std::vector<State> all_;
};

}  // namespace detail

}  // namespace lumo
