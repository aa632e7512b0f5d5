#pragma once

#include "computing/request.hpp"
#include "report/report.hpp"

#include <nlohmann/json.hpp>

#include <cmath>
#include <optional>
#include <span>

namespace lumo::program {

/// Keeps keys in the order of writing.
using Json = nlohmann::ordered_json;

/// A number, or null where it is not defined: JSON has no NaN.
inline Json number(double v) { return std::isfinite(v) ? Json(v) : Json(nullptr); }

/// Null for a number that there is not.
inline Json maybe(const std::optional<double>& v) { return v ? number(*v) : Json(nullptr); }

inline Json numbers(std::span<const double> values) {
  Json a = Json::array();
  for (const double v : values) a.push_back(number(v));
  return a;
}

/// What stands under a key of a record, if it is a number.
inline double value_at(const Json& record, const char* key) {
  return record.is_object() && record.contains(key) && record[key].is_number() ? record[key].get<double>() : undefined;
}

/// What stands in a text; null where that is not JSON: a store's notes may be damaged unnoticed.
inline Json json_or_null(const std::string& text) {
  Json j = Json::parse(text, nullptr, false);
  return j.is_discarded() ? Json(nullptr) : j;
}

/// For what others wrote: bytes that are no UTF-8 are replaced. `indent` −1: one line.
inline std::string text_of(const Json& j, int indent) { return j.dump(indent, ' ', false, Json::error_handler_t::replace); }

inline Json json(const StateReport& s) {
  return {{"load_N", number(s.load_N)},
          {"force_N", number(s.force_N)},
          {"depth_mm", number(s.depth_mm)},
          {"contact_area_mm2", number(s.contact_area_mm2)},
          {"reference_area_mm2", number(s.reference_area_mm2)},
          {"residual_N", number(s.residual_N)},
          {"penetration_mm", number(s.penetration_mm)},
          {"response", s.response.empty() ? Json(nullptr) : numbers(s.response)},
          {"response_change_err", s.change_error.empty() ? Json(nullptr) : numbers(s.change_error)}};
}

inline Json json(const ScenarioReport& s) {
  Json states = Json::array();
  for (const auto& state : s.states) states.push_back(json(state));
  return {{"diameter_mm", number(s.diameter_mm)}, {"angle_deg", number(s.angle_deg)}, {"y_mm", number(s.y_mm)},     {"status", s.status},
          {"q_form", number(s.q_form)},           {"q_stable", number(s.q_stable)},   {"q_stiff", number(s.q_stiff)}, {"states", states}};
}

inline Json json(const MeshReport& m) { return {{"nodes", m.nodes}, {"elements", m.elements}}; }

inline Json json(const Seconds& s) {
  return {{"mesh", number(s.mesh)}, {"mechanics", number(s.mechanics)}, {"optics", number(s.optics)}, {"total", number(s.total)}};
}

inline Json json(const Ledger& l) {
  return {{"emitted", number(l.emitted)},
          {"regions", number(l.regions)},
          {"to_indenter", number(l.to_indenter)},
          {"elsewhere", number(l.elsewhere)},
          {"absorbed_medium", number(l.absorbed_medium)},
          {"absorbed_carrier", number(l.absorbed_carrier)},
          {"sampling", number(l.sampling)},
          {"lost", number(l.lost)}};
}

inline Json json(const WorstContact& w) { return {{"diameter_mm", w.diameter_mm}, {"angle_deg", w.angle_deg}, {"y_mm", w.y_mm}, {"value", number(w.value)}}; }

inline Json json(const WorstObservation& w) {
  return {{"diameter_mm", w.diameter_mm}, {"angle_deg", w.angle_deg}, {"load_N", w.load_N}, {"y_mm", {w.y_a_mm, w.y_b_mm}}, {"value", number(w.value)}};
}

/// All but the design, and the time that it took.
inline Json json(const EvaluationResult& e) {
  Json j;
  j["J_contact"] = number(e.J_contact);
  j["J_contact_err"] = number(e.J_contact_err);
  j["J_obs"] = number(e.J_obs);
  j["J_obs_err"] = number(e.J_obs_err);
  j["worst_contact"] = e.worst_contact ? json(*e.worst_contact) : Json(nullptr);
  j["worst_observation"] = e.worst_observation ? json(*e.worst_observation) : Json(nullptr);
  j["unloaded_response"] = numbers(e.unloaded_response);
  j["unloaded_response_err"] = numbers(e.unloaded_error);
  j["scenarios"] = Json::array();
  for (const auto& s : e.scenarios) j["scenarios"].push_back(json(s));
  j["ledger"] = json(e.ledger);
  j["mesh"] = json(e.size);
  return j;
}

/// The design that a result belongs to; the first keys of every result.
inline Json heading(const Pad& o) { return {{"theta_mm", numbers(o.theta_mm)}, {"material", o.material}}; }

inline Json json(const Mechanics& m) {
  return {{"mode", m.paper ? "paper" : "default"},
          {"solver", name(m.solver)},
          {"element", name(m.element)},
          {"size_mm", m.size_mm > 0.0 ? Json(m.size_mm) : Json(nullptr)},
          {"sweeps", m.solver == Mechanics::Solver::vbd ? Json(m.sweeps) : Json(nullptr)},
          {"law", name(m.law)},
          {"contact_stiffness_N_per_m3", m.contact_stiffness_N_per_m3},
          {"contact_points", name(m.points)},
          {"friction", m.friction}};
}

/// A field of a CSV file: a number, a plain word, or nothing.
inline std::string csv_field(const Json& v) { return v.is_number() ? v.dump() : v.is_string() ? v.get<std::string>() : ""; }

inline void append(Json& to, const Json& from) {
  for (const auto& [key, value] : from.items()) to[key] = value;
}

}  // namespace lumo::program
