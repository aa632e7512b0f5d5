#pragma once

#include "computing/request.hpp"
#include "console/text.hpp"
#include "lumo/morphology/silicone.hpp"
#include "lumo/pipeline/ensemble.hpp"
#include "report/json.hpp"

#include <string>
#include <vector>

namespace lumo::program {

/// The contacts that an ensemble's name stands for.
inline lumo::Ensemble contacts(Ensemble e) { return e == Ensemble::flat ? flat_ensemble() : curved_ensemble(); }

/// Raised whenever an evaluation of the same design gives other numbers than before, or a search asks for other designs
/// after the same trials: old stores are then of another problem.
inline constexpr int results_version = 11;

/// Material with every number that decides a result, and what its contacts are called.
inline Json conditions(const std::string& material, std::string_view contacts) {
  const Silicone card = silicone(material);
  return {{"results", results_version}, {"material", material}, {"shear_modulus_Pa", card.mu_Pa},
      {"first_lame_parameter_Pa", card.lambda_Pa}, {"ensemble", contacts}};
}

/// The same with all numbers of the contacts, for the text by which a store knows its problem.
inline Json conditions(const std::string& material, std::string_view title, const lumo::Ensemble& ensemble) {
  const auto scaled = [](const std::vector<double>& values, double unit) {
    Json a = Json::array();
    for (const double v : values) a.push_back(as_typed(v / unit));
    return a;
  };
  Json j = conditions(material, title);
  append(
      j, {{"diameters_mm", scaled(ensemble.diameters_m, 1e-3)}, {"angles_deg", scaled(ensemble.angles_rad, pi / 180.0)},
             {"places_mm", scaled(ensemble.places_m, 1e-3)}, {"loads_N", ensemble.loads_N}});
  return j;
}

/// One line a key, so that the line in which two problems differ can be shown.
inline std::string line_by_line(const Json& object) {
  std::string text;
  for (const auto& [key, value] : object.items())
    text += (text.empty() ? "{" : ",\n ") + Json(key).dump() + ": " + value.dump();
  return text + "}";
}

}  // namespace lumo::program
