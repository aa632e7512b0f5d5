#pragma once

#include "lumo/pipeline/evaluate.hpp"
#include "report/json.hpp"

#include <array>
#include <optional>
#include <string>
#include <vector>

/// The library's records as they are reported: the one place that knows their names and units in JSON and CSV.
namespace lumo::program {

inline double value_of(const std::optional<Estimate>& e) { return e ? e->value : undefined; }
inline double error_of(const std::optional<Estimate>& e) { return e ? e->error : undefined; }

/// States as they are reported: of a solve that failed only the load is known.
inline std::vector<StateRecord> reported(const ScenarioRecord& scenario) {
  std::vector<StateRecord> states = scenario.states;
  for (StateRecord& s : states)
    if (!is_scored(s.status, true))
      s = {s.status, s.load_N, undefined, undefined, undefined, undefined, undefined, undefined, undefined, undefined,
          {}, {}, {}};
  return states;
}

/// Part of the emitted power.
struct PowerShare {
  const char *name, *words;  ///< in records and in text
  double part;
};

/// Where the emitted power went; all others add up to the first. `sampling` is what Russian roulette and other
/// estimators added or took; its expectation is 0. Undefined where nothing was traced.
inline std::array<PowerShare, 8> power_shares(const EnergyLedger& e) {
  double regions = 0.0;
  for (const double c : e.channels) regions += c;
  const double p = e.emitted;
  const double physical =
      regions + e.to_indenter + e.elsewhere + e.absorbed_in_medium + e.absorbed_at_surfaces + e.lost;
  return {{{"emitted", "emitted", p / p}, {"regions", "regions", regions / p},
      {"to_indenter", "to indenter", e.to_indenter / p}, {"elsewhere", "elsewhere", e.elsewhere / p},
      {"absorbed_medium", "silicone", e.absorbed_in_medium / p},
      {"absorbed_carrier", "carrier", e.absorbed_at_surfaces / p},
      {"sampling", "sampling", (e.accounted() - physical) / p}, {"lost", "lost", e.lost / p}}};
}

/// A number under `key`, its error beside it under `key`_err; null without one.
inline void put(Json& to, const std::string& key, const std::optional<Estimate>& e) {
  to[key] = e ? number(e->value) : Json(nullptr);
  to[key + "_err"] = e ? number(e->error) : Json(nullptr);
}

/// The same, read back; empty where the record has none.
inline std::optional<Estimate> estimate(const Json& record, const std::string& key) {
  if (!record.at(key).is_number()) return std::nullopt;
  return Estimate{record[key].get<double>(), record[key + "_err"].get<double>()};
}

/// Numbers of a state in the units of the output, under their names there.
struct StateQuantity {
  const char* name;
  double (*of)(const StateRecord&);
};
inline constexpr std::array<StateQuantity, 9> state_quantities = {
    {{"load_N", [](const StateRecord& s) { return s.load_N; }},
        {"force_N", [](const StateRecord& s) { return s.force_N; }},
        {"depth_mm", [](const StateRecord& s) { return 1e3 * s.depth_m; }},
        {"contact_area_mm2", [](const StateRecord& s) { return 1e6 * s.contact_area_m2; }},
        {"reference_area_mm2", [](const StateRecord& s) { return 1e6 * s.reference_area_m2; }},
        {"residual_N", [](const StateRecord& s) { return s.residual_N; }},
        {"penetration_mm", [](const StateRecord& s) { return 1e3 * s.penetration_m; }},
        {"depth_err_mm", [](const StateRecord& s) { return 1e3 * s.depth_error_m; }},
        {"contact_area_err_mm2", [](const StateRecord& s) { return 1e6 * s.contact_area_error_m2; }}}};

inline Json json(const StateRecord& s) {
  Json j;
  for (const StateQuantity& q : state_quantities) j[q.name] = number(q.of(s));
  j["response"] = s.response.empty() ? Json(nullptr) : numbers(s.response);
  j["response_change_err"] = s.change_error.empty() ? Json(nullptr) : numbers(s.change_error);
  return j;
}

/// Where a scenario presses.
inline Json place(const ScenarioRecord& s) {
  return {{"diameter_mm", mm(s.diameter_m)}, {"angle_deg", degrees(s.angle_rad)}, {"y_mm", mm(s.y_m)}};
}

inline Json json(const ContactTerms& t) {
  return {{"q_form", number(value_of(t.form))}, {"q_stable", number(value_of(t.stable))},
      {"q_stiff", number(value_of(t.stiff))}};
}

inline Json json(const ScenarioRecord& s) {
  Json j = place(s);
  j["status"] = to_string(s.status);
  append(j, json(s.terms));
  j["states"] = Json::array();
  for (const StateRecord& state : reported(s)) j["states"].push_back(json(state));
  return j;
}

inline Json mesh_size(std::size_t nodes, std::size_t elements) { return {{"nodes", nodes}, {"elements", elements}}; }

inline Json json(const Timing& s) {
  return {{"mesh", number(s.mesh)}, {"mechanics", number(s.mechanics)}, {"optics", number(s.optics)},
      {"total", number(s.total)}};
}

inline Json json(const EnergyLedger& ledger) {
  Json j;
  for (const PowerShare& s : power_shares(ledger)) j[s.name] = number(s.part);
  return j;
}

/// Both objectives, and which contact and which pair of places set them.
inline Json objectives(const Evaluation& e) {
  Json j;
  put(j, "J_contact", e.J_contact);
  put(j, "J_obs", e.J_obs);
  j["worst_contact"] = nullptr;
  j["worst_observation"] = nullptr;
  if (e.worst_contact) {
    j["worst_contact"] = place(e.observations.scenarios[*e.worst_contact]);
    j["worst_contact"]["value"] = j["J_contact"];
  }
  if (e.worst_observation) {
    const ObservedState &a = e.observed[e.worst_observation->first], &b = e.observed[e.worst_observation->second];
    j["worst_observation"] = {{"diameter_mm", mm(a.diameter_m)}, {"angle_deg", degrees(a.angle_rad)},
        {"load_N", a.load_N}, {"y_mm", {mm(a.y_m), mm(b.y_m)}}, {"value", j["J_obs"]}};
  }
  return j;
}

/// Light of the unloaded body.
inline Json unloaded(const Observations& seen) {
  return {
      {"unloaded_response", numbers(seen.unloaded_response)}, {"unloaded_response_err", numbers(seen.unloaded_error)}};
}

/// All but the design, and the time that it took.
inline Json json(const Evaluation& e) {
  const Observations& seen = e.observations;
  Json j = objectives(e);
  append(j, unloaded(seen));
  j["scenarios"] = Json::array();
  for (const ScenarioRecord& s : seen.scenarios) j["scenarios"].push_back(json(s));
  j["ledger"] = json(seen.ledger);
  j["mesh"] = mesh_size(seen.nodes, seen.elements);
  return j;
}

}  // namespace lumo::program
