#pragma once

#include "console/text.hpp"
#include "report/press_report.hpp"

#include "lumo/campaign/evaluate.hpp"

#include <utility>

/// The library's records as they are reported.
namespace lumo::program {

inline Seconds report(const Timing& t) { return {t.mesh, t.mechanics, t.optics, t.total}; }

inline Ledger report(const EnergyLedger& e) {
  double regions = 0.0;
  for (const double c : e.channels) regions += c;
  const double physical = regions + e.to_indenter + e.elsewhere + e.absorbed_in_medium + e.absorbed_at_surfaces + e.lost;
  const double p = e.emitted;
  return {1.0, regions / p, e.to_indenter / p, e.elsewhere / p, e.absorbed_in_medium / p, e.absorbed_at_surfaces / p,
          (e.accounted() - physical) / p, e.lost / p};
}

/// As people give them: 30, where 30 · π/180 · 180/π is an ulp below.
inline double degrees(double rad) { return as_typed(rad * 180.0 / pi); }

inline ScenarioReport report(const ScenarioRecord& s) {
  ScenarioReport report;
  report.diameter_mm = 1e3 * s.diameter_m, report.angle_deg = degrees(s.angle_rad), report.y_mm = 1e3 * s.y_m;
  report.status = std::string(to_string(s.status));
  report_terms(report, s.terms);
  for (const StateRecord& k : s.states) {
    StateReport state = report_state(k);
    state.response = k.response;
    if (k.change.size() > 0) state.change_error = standard_error(k.change);
    report.states.push_back(std::move(state));
  }
  return report;
}

inline EvaluationResult report(const Evaluation& e) {
  const Observations& seen = e.observations;
  EvaluationResult result;
  const auto record = [](const std::optional<Estimate>& j, double& value, double& error) {
    if (j) value = j->value, error = j->error;
  };
  record(e.J_contact, result.J_contact, result.J_contact_err);
  record(e.J_obs, result.J_obs, result.J_obs_err);
  for (const ScenarioRecord& s : seen.scenarios) result.scenarios.push_back(report(s));
  if (e.worst_contact) {
    const ScenarioReport& s = result.scenarios[*e.worst_contact];
    result.worst_contact = WorstContact{s.diameter_mm, s.angle_deg, s.y_mm, result.J_contact};
  }
  if (e.worst_observation) {
    const ObservedState &a = e.observed[e.worst_observation->first], &b = e.observed[e.worst_observation->second];
    result.worst_observation = WorstObservation{1e3 * a.diameter_m, degrees(a.angle_rad), a.load_N, 1e3 * a.y_m, 1e3 * b.y_m, result.J_obs};
  }
  result.unloaded_response = seen.unloaded_response;
  result.unloaded_error = seen.unloaded_error;
  result.ledger = report(seen.ledger);
  result.size = {seen.nodes, seen.elements};
  result.seconds = report(seen.seconds);
  return result;
}

}  // namespace lumo::program
