#pragma once

#include "lumo/core/units.hpp"
#include "lumo/geometry/triangle_surface.hpp"

#include <cmath>
#include <utility>
#include <vector>

// Tools as triangles [m].
namespace lumo::test {

/// A closed box [−half, half] of twelve triangles.
inline TriangleSurface brick(const Vec3d& half) {
  TriangleSurface s;
  for (int k = 0; k < 8; ++k)
    s.vertices.emplace_back(k & 1 ? half.x() : -half.x(), k & 2 ? half.y() : -half.y(), k & 4 ? half.z() : -half.z());
  s.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4}, {2, 6, 3}, {3, 6, 7}, {0, 4, 2},
      {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return s;
}

/// Rings about z of a solid of revolution, from the lower end of its axis to the upper; radius and height [m].
inline TriangleSurface turned_solid(
    const std::vector<std::pair<double, double>>& rings, double low, double high, int around) {
  TriangleSurface s;
  s.vertices = {{0.0, 0.0, low}, {0.0, 0.0, high}};
  for (const auto& [radius, z] : rings)
    for (int k = 0; k < around; ++k)
      s.vertices.emplace_back(radius * std::cos(2 * pi * k / around), radius * std::sin(2 * pi * k / around), z);
  const auto id = [&](std::size_t ring, int k) { return 2 + int(ring) * around + k % around; };
  for (int k = 0; k < around; ++k) {
    s.triangles.push_back({0, id(0, k + 1), id(0, k)});
    for (std::size_t i = 0; i + 1 < rings.size(); ++i) {
      s.triangles.push_back({id(i, k), id(i, k + 1), id(i + 1, k + 1)});
      s.triangles.push_back({id(i, k), id(i + 1, k + 1), id(i + 1, k)});
    }
    s.triangles.push_back({1, id(rings.size() - 1, k), id(rings.size() - 1, k + 1)});
  }
  return s;
}

/// A ball of 4 mm about the origin, on a shaft of 3 mm along z that ends at `shaft_end` [m].
inline TriangleSurface probe(double shaft_end) {
  const double radius = 2e-3, shaft = 1.5e-3, end = pi - std::asin(shaft / radius);
  std::vector<std::pair<double, double>> rings;
  for (int k = 1; k <= 48; ++k) rings.emplace_back(radius * std::sin(end * k / 48), -radius * std::cos(end * k / 48));
  rings.emplace_back(shaft, shaft_end);
  return turned_solid(rings, -radius, shaft_end, 96);
}

}  // namespace lumo::test
