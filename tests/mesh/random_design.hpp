#pragma once

#include "lumo/morphology/design.hpp"

#include <array>
#include <random>

/// Some feasible lattice design, by rejection.
inline lumo::FingerDesign random_design(std::mt19937& random) {
  const lumo::DesignSpace space = lumo::finger_space(lumo::plain_pad());
  for (;;) {
    std::array<double, 5> x;
    for (std::size_t i = 0; i < 5; ++i)
      x[i] = 0.5 * double(std::uniform_int_distribution<int>(
                       int(2 * space.variables[i].lower), int(2 * space.variables[i].upper))(random));
    if (space.contains(x)) return lumo::FingerDesign::from(x);
  }
}
