#pragma once

#include "configuration/configuration.hpp"
#include "console/text.hpp"

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
inline std::string text_of(const Json& j, int indent) {
  return j.dump(indent, ' ', false, Json::error_handler_t::replace);
}

inline void append(Json& to, const Json& from) {
  for (const auto& [key, value] : from.items()) to[key] = value;
}

/// The design that a result belongs to; the first keys of every result.
inline Json heading(const Pad& o) { return {{"theta_mm", numbers(o.theta_mm)}, {"material", o.material()}}; }

inline Json json(const Mechanics& m) {
  return {{"mode", m.paper ? "paper" : "default"}, {"solver", name(m.solver)}, {"element", name(m.element)},
      {"size_mm", m.size_mm > 0.0 ? Json(m.size_mm) : Json(nullptr)},
      {"sweeps", m.solver == Mechanics::Solver::vbd ? Json(m.sweeps) : Json(nullptr)}, {"law", name(m.law)},
      {"contact_stiffness_N_per_m3", m.contact_stiffness_N_per_m3}, {"contact_points", name(m.points)},
      {"friction", m.friction}};
}

/// A field of a CSV file: a number, a plain word, or nothing.
inline std::string csv_field(const Json& v) {
  return v.is_number() ? v.dump() : v.is_string() ? v.get<std::string>() : "";
}

}  // namespace lumo::program
