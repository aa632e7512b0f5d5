#pragma once

#include "lumo/objective/contact_progression.hpp"
#include "lumo/objective/optical_separation.hpp"
#include "lumo/pipeline/observations.hpp"

#include <concepts>
#include <cstddef>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

namespace lumo {

/// A number to optimise, with its error, from all that was observed of a body; nullopt if the observations do not
/// define it. Laws: a pure function; never NaN.
template <class O>
concept ObservedObjective = requires(const O& objective, const Observations& all) {
  { objective(all) } -> std::same_as<std::optional<Estimate>>;
};

/// Result of the evaluation of any body. All objectives are empty unless every scenario converged, or was held where
/// the pipeline accepts held states.
struct Scores {
  bool converged = false;
  std::vector<std::optional<Estimate>> objectives;
  Observations observations;
};

/// Objectives from the observations. A numerical failure is a status, never a score.
template <class P, ObservedObjective... Objectives>
Scores score(Observations observations, const P& pipeline, const std::tuple<Objectives...>& objectives) {
  Scores result;
  result.observations = std::move(observations);
  result.converged = all_scored(result.observations.scenarios, pipeline.accept_held);
  const auto add = [&](const auto&... objective) {
    (result.objectives.push_back(result.converged ? objective(result.observations) : std::nullopt), ...);
  };
  std::apply(add, objectives);
  return result;
}

/// Result of the evaluation of a finger. An objective is empty if a scenario did not converge, or if the loads do not
/// define its terms.
struct Evaluation {
  std::optional<Estimate> J_contact, J_obs;
  std::optional<std::size_t> worst_contact;     ///< scenario that sets J_contact
  std::optional<Separation> worst_observation;  ///< pair of `observed` that sets J_obs
  std::vector<ObservedState> observed;
  Observations observations;
};

/// The paper's two objectives from the observations.
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

}  // namespace lumo
