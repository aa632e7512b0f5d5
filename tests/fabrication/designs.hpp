#pragma once

#include "lumo/fabrication/casting_options.hpp"

#include <cmath>
#include <random>
#include <vector>

inline lumo::CastingOptions plain_casting() { return lumo::CastingOptions{}.made_for(lumo::plain_finger()); }

/// Area of a regular polygon in a circle.
inline double ring_area(double radius, int corners = 32) {
  return 0.5 * corners * std::sin(2.0 * lumo::pi / corners) * radius * radius;
}
inline double frustum(double r, double R, double height) {
  return height / 3.0 * (ring_area(r) + std::sqrt(ring_area(r) * ring_area(R)) + ring_area(R));
}

/// Designs at the ends of the space: lowest and highest domes, narrowest and widest stems and voids, thinnest silicone.
inline std::vector<lumo::FingerDesign> extreme_designs() {
  return {{2, 5.5, 4, 2, 0}, {19, 1, 15, 2, 2}, {19, 1, 4, 14.5, 7.5}, {2, 18, 4, 2, 7.5}, {2, 18, 15, 2, 0},
      {10, 8, 4.5, 4, 7.5}, {8, 1, 4, 2, 0.5}, {2, 18, 4, 6.5, 0.5}, {19, 1, 15, 14, 2}, {18.5, 1, 4, 2, 7.5},
      {6.5, 12.5, 15, 12, 0.5}, {6, 6, 8, 5, 0}};
}

/// Feasible designs drawn from the lattice, each as likely as any other.
inline std::vector<lumo::FingerDesign> random_designs(int count, unsigned seed, const lumo::PadDimensions& pad) {
  std::mt19937_64 random(seed);
  const lumo::DesignSpace space = lumo::finger_space(pad);
  std::vector<lumo::FingerDesign> designs;
  while (int(designs.size()) < count) {
    std::vector<double> x;
    for (const lumo::Variable& v : space.variables)
      x.push_back(v.lower + 0.5 * double(random() % (unsigned(2.0 * (v.upper - v.lower)) + 1)));
    if (space.contains(x)) designs.push_back(lumo::FingerDesign::from(x));
  }
  return designs;
}

/// Area of the silicone in a section whose curve is cut into chords [mm²].
inline double section_area_mm2(const lumo::HalfSection& s) {
  double twice = 0.0;
  for (std::size_t i = 0, n = s.x.size(); i < n; ++i) twice += s.x[i] * s.z[(i + 1) % n] - s.x[(i + 1) % n] * s.z[i];
  return 1e6 * twice;
}
