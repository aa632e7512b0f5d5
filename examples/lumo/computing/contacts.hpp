#pragma once

#include "configuration/effective.hpp"
#include "report/json.hpp"

#include <string>
#include <vector>

namespace lumo::program {

/// Raised whenever an evaluation of the same design gives other numbers than before, or a search asks for other designs
/// after the same trials: old stores are then of another problem.
inline constexpr int results_version = 22;

/// What decides the results of a store, besides its designs.
inline Json conditions(const Configuration& o, const std::vector<std::string>& groups) {
  Json j = {{"results", results_version}};
  append(j, tree_of(o, groups));
  return j;
}

/// Groups of settings that decide an evaluation.
inline const std::vector<std::string> evaluation_groups = {
    "silicone", "finger", "leds", "readout", "mesh", "mechanics", "ensemble", "light"};

/// One line a key, so that the line in which two problems differ can be shown.
inline std::string line_by_line(const Json& object) {
  std::string text;
  for (const auto& [key, value] : object.items())
    text += (text.empty() ? "{" : ",\n ") + Json(key).dump() + ": " + value.dump();
  return text + "}";
}

}  // namespace lumo::program
