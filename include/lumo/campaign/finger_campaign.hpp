#pragma once

#include "lumo/campaign/campaign.hpp"
#include "lumo/pipeline/evaluate.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

namespace lumo {

/// The paper's search: J_contact and J_obs as large as can be over θ, from the references (the paper has five) and
/// eight Sobol designs. Source: paper §III-D.
inline Problem finger_problem(int evaluations = 160, std::uint64_t seed = 1, const PadDimensions& pad = {},
    const std::vector<FingerDesign>& references = built_references()) {
  Problem p;
  p.space = finger_space(pad);
  p.objectives = {{"J_contact", true, 0.0}, {"J_obs", true, 0.0}};
  for (const FingerDesign& d : references) {
    const auto x = d.values();
    p.initial.emplace_back(x.begin(), x.end());
  }
  p.sobol = 8;  // paper §III-D
  p.evaluations = evaluations;
  p.seed = seed;
  return p;
}

/// Where a scenario presses, in words.
inline std::string contact_words(const ScenarioRecord& s) {
  return message(
      "sphere of ", 1e3 * s.diameter_m, " mm at ", s.angle_rad * 180.0 / pi, " deg, y = ", 1e3 * s.y_m, " mm");
}

/// Why a scenario has no score though it has equilibria.
inline std::string unresolved_contact(const ScenarioRecord& s) {
  const Unresolved& u = *s.unresolved;
  return message("the contact is not resolved at ", u.load_N, " N: radius ", 1e-2 * std::round(1e5 * u.radius_m),
      " mm, edges ", 1e-2 * std::round(1e5 * u.edge_m), " mm, ", contact_words(s));
}

/// The first scenario that failed, and how; empty if all converged, or were held where that is accepted.
inline std::string failed_press(const std::vector<ScenarioRecord>& scenarios, bool accept_held = false) {
  for (const ScenarioRecord& s : scenarios)
    if (s.unresolved && !is_scored(s.status, accept_held)) return "press: " + unresolved_contact(s);
    else if (!is_scored(s.status, accept_held))
      return message("press: ", to_string(s.status), " at ", s.states.back().load_N, " N, ", contact_words(s));
  return "";
}

/// Why an evaluation has no objectives: the stage and the first scenario that failed; empty if it has both.
inline std::string failure_of(const Evaluation& e, bool accept_held = false) {
  if (e.J_contact && e.J_obs) return "";
  if (std::string why = failed_press(e.observations.scenarios, accept_held); !why.empty()) return why;
  return !e.J_contact ? "objective: the loads do not define the terms of J_contact"
                      : "objective: no two states can be compared for J_obs";
}

/// Did the machine's limits end a solve, and not the body?
inline bool is_machine_limit(const std::vector<ScenarioRecord>& scenarios) {
  return std::any_of(
      scenarios.begin(), scenarios.end(), [](const ScenarioRecord& s) { return s.status == Status::time_limit; });
}
/// Did they end a mesh?
inline bool is_machine_limit(const MeshError& e) {
  return e.reason() == MeshError::Reason::timed_out || e.reason() == MeshError::Reason::out_of_memory;
}

/// The part of an evaluation that a campaign keeps. It may try again what the machine ended.
inline TrialResult trial_result(const Evaluation& e, bool accept_held = false) {
  TrialResult result;
  result.why = failure_of(e, accept_held);
  if (result.why.empty()) {
    result.outputs = {e.J_contact->value, e.J_obs->value};
    result.errors = {e.J_contact->standard_error(), e.J_obs->standard_error()};
  }
  result.retry = is_machine_limit(e.observations.scenarios);
  return result;
}

/// The same of a mesh that could not be made.
inline TrialResult trial_result(const MeshError& e) {
  TrialResult result;
  result.why = message("mesh: ", e.what());
  result.retry = is_machine_limit(e);
  return result;
}

}  // namespace lumo
