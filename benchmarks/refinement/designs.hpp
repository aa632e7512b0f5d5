#pragma once

#include "lumo/morphology/design.hpp"

#include <array>
#include <cstddef>
#include <random>
#include <utility>
#include <vector>

namespace lumo {

/// The first `count` of `list`, followed by seeded feasible lattice designs of the pad.
inline std::vector<FingerDesign> with_seeded(
    std::vector<FingerDesign> list, const PadDimensions& pad, std::size_t count) {
  const DesignSpace space = finger_space(pad);
  std::mt19937 random(2026);
  while (list.size() < count) {
    std::array<double, 5> x;
    for (std::size_t i = 0; i < 5; ++i) {
      const int low = int(2 * space.variables[i].lower), high = int(2 * space.variables[i].upper);
      x[i] = 0.5 * double(low + int(random() % unsigned(high - low + 1)));
    }
    if (space.contains(x)) list.push_back(FingerDesign::from(x));
  }
  list.resize(count);
  return list;
}

}  // namespace lumo
