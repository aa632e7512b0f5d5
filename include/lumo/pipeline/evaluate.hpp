#pragma once

#include "lumo/morphology/finger.hpp"
#include "lumo/pipeline/observe.hpp"

#include <concepts>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

namespace lumo {

/// A number to optimise, with its error, from all that was observed of a body; nothing where that does not define it.
/// Laws: a pure function; never NaN.
template <class O>
concept ObservedObjective = requires(const O& objective, const Observations& all) {
  { objective(all) } -> std::same_as<std::optional<Estimate>>;
};

/// What an evaluation of any body gives. Where a scenario did not converge (or, where the pipeline accepts held states,
/// was not held) all objectives are empty.
struct Scores {
  bool converged = false;
  std::vector<std::optional<Estimate>> objectives;
  Observations observations;
};

/// Body → meshes → equilibria → responses → objectives, for any body, tool and objectives (ObservedObjective). Mirror
/// images are solved once; scenarios run side by side. Throws MeshError when the body cannot be meshed,
/// InvalidArgument.
template <class P, Indenter Tool, Executor E, ObservedObjective... Objectives>
Scores evaluate(const Body& body, const std::vector<Scenario<Tool>>& scenarios, const P& pipeline, const E& executor,
                const std::tuple<Objectives...>& objectives, const ProgressReport& progress = {}) {
  Scores scores;
  scores.observations = observe(body, scenarios, pipeline, executor, progress);
  scores.converged = all_scored(scores.observations.scenarios, pipeline.accept_held);
  const auto score = [&](const auto&... objective) {
    // A numerical failure is a status, never a score.
    (scores.objectives.push_back(scores.converged ? objective(scores.observations) : std::nullopt), ...);
  };
  std::apply(score, objectives);
  return scores;
}

/// What one evaluation of a design gives. An objective is empty when a scenario did not converge, or when its terms are
/// not defined by the loads.
struct Evaluation {
  std::optional<Estimate> J_contact, J_obs;
  std::optional<std::size_t> worst_contact;     ///< scenario that sets J_contact
  std::optional<Separation> worst_observation;  ///< pair of `observed` that sets J_obs
  std::vector<ObservedState> observed;
  Observations observations;
};

/// The worst scenario's contact progression (paper Eq. 5), with the scenario that sets it.
inline std::optional<std::pair<Estimate, std::size_t>> contact_progression(
    const std::vector<ScenarioRecord>& scenarios);

/// The paper's two objectives from what was observed.
template <class P> Evaluation score(Observations observations, const P& pipeline) {
  Evaluation result;
  result.observations = std::move(observations);
  const std::vector<ScenarioRecord>& scenarios = result.observations.scenarios;
  if (!all_scored(scenarios, pipeline.accept_held)) return result;

  if (const auto worst = contact_progression(scenarios)) {
    result.J_contact = worst->first;
    result.worst_contact = worst->second;
  }
  result.observed = observed_states(scenarios);
  result.worst_observation = optical_separation(result.observed, pipeline.optical_error);
  if (result.worst_observation) result.J_obs = result.worst_observation->distance;
  return result;
}

/// θ → finger → meshes → equilibria → responses → the paper's two objectives.
/// Throws InfeasibleDesign before anything is computed, MeshError when the body cannot be meshed.
template <class P, Executor E>
Evaluation evaluate(const FingerDesign& design, const Silicone& silicone, const Ensemble& ensemble, const P& pipeline,
                    const FingerOptions& options, const E& executor, const ProgressReport& progress = {}) {
  return score(observe(finger(design, silicone, options), ensemble.scenarios(), pipeline, executor, progress),
               pipeline);
}

inline std::optional<std::pair<Estimate, std::size_t>> contact_progression(
    const std::vector<ScenarioRecord>& scenarios) {
  std::optional<std::pair<Estimate, std::size_t>> worst;
  for (std::size_t k = 0; k < scenarios.size(); ++k) {
    const auto score = scenarios[k].terms.score();
    if (!score) return std::nullopt;
    if (!worst || score->value < worst->first.value) worst = std::pair(*score, k);
  }
  return worst;
}

}  // namespace lumo
