#pragma once

#include "lumo/core/error.hpp"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

namespace lumo {

/// The design to build: argmax of min(J_contact/max J_contact, J_obs/max J_obs), the first of equals. Pairs (J_contact,
/// J_obs); nullopt without pairs, or if an objective is positive in none. Throws InvalidArgument for one that is not
/// finite. Source: paper §III-D.
inline std::optional<std::size_t> balanced_choice(const std::vector<std::pair<double, double>>& objectives) {
  double contact = 0.0, observation = 0.0;
  for (const auto& [c, o] : objectives) {
    require_finite("J_contact", c, "");
    require_finite("J_obs", o, "");
    contact = std::max(contact, c);
    observation = std::max(observation, o);
  }
  if (!(contact > 0.0 && observation > 0.0)) return std::nullopt;
  std::size_t best = 0;
  const auto score = [&](std::size_t k) {
    return std::min(objectives[k].first / contact, objectives[k].second / observation);
  };
  for (std::size_t k = 1; k < objectives.size(); ++k)
    if (score(k) > score(best)) best = k;
  return best;
}

}  // namespace lumo
