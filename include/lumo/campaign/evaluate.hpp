#pragma once

#include "lumo/campaign/observe.hpp"
#include "lumo/morphology/finger.hpp"

namespace lumo {

/// What one evaluation of a design gives. An objective is empty when a scenario did not converge, or when its terms are not defined by the loads.
struct Evaluation {
  std::optional<Estimate> J_contact, J_obs;
  std::optional<std::size_t> worst_contact;       ///< scenario that sets J_contact
  std::optional<Separation> worst_observation;    ///< pair of `observed` that sets J_obs
  std::vector<ObservedState> observed;
  Observations observations;
};

/// The worst scenario's contact progression (paper Eq. 3), with the scenario that sets it.
inline std::optional<std::pair<Estimate, std::size_t>> contact_progression(const std::vector<ScenarioRecord>& scenarios);

/// θ → body → meshes → equilibria → responses → objectives. Mirror images are solved once; scenarios run side by side.
/// Throws InfeasibleDesign before anything is computed, MeshError when the body cannot be meshed.
template <class P, Executor E>
Evaluation evaluate(const FingerDesign& design, const Silicone& silicone, const Ensemble& ensemble, const P& pipeline, const FingerOptions& options,
                    const E& executor, const ProgressReport& progress = {}) {
  const Body body = finger(design, silicone, options);

  Evaluation result;
  result.observations = observe(body, ensemble.scenarios(), pipeline, executor, progress);

  const std::vector<ScenarioRecord>& scenarios = result.observations.scenarios;
  for (const ScenarioRecord& s : scenarios)
    if (s.status != Status::converged) return result;  // a numerical failure is a status, never a score

  if (const auto worst = contact_progression(scenarios)) {
    result.J_contact = worst->first;
    result.worst_contact = worst->second;
  }
  result.observed = observed_states(scenarios);
  result.worst_observation = optical_separation(result.observed, pipeline.optical_error);
  if (result.worst_observation) result.J_obs = result.worst_observation->distance;
  return result;
}

inline std::optional<std::pair<Estimate, std::size_t>> contact_progression(const std::vector<ScenarioRecord>& scenarios) {
  std::optional<std::pair<Estimate, std::size_t>> worst;
  for (std::size_t k = 0; k < scenarios.size(); ++k) {
    const auto score = scenarios[k].terms.score();
    if (!score) return std::nullopt;
    if (!worst || score->value < worst->first.value) worst = std::pair(*score, k);
  }
  return worst;
}

}  // namespace lumo
