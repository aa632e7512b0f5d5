#pragma once

#include "lumo/geometry/surface_check.hpp"

#include <array>
#include <cstddef>
#include <numbers>
#include <utility>
#include <vector>

namespace lumo {

/// A surface of triangles, counter-clockwise seen from outside.
struct TriangleSurface {
  std::vector<Vec3d> vertices;  ///< [m]
  std::vector<std::array<int, 3>> triangles;
};

/// Removes the vertices that no triangle has; the others keep their order.
inline void drop_unused_vertices(TriangleSurface& surface) {
  std::vector<int> number(surface.vertices.size(), -1);
  for (const auto& t : surface.triangles)
    for (const int v : t) number[std::size_t(v)] = 0;
  std::vector<Vec3d> used;
  for (std::size_t v = 0; v < number.size(); ++v)
    if (number[v] == 0) {
      number[v] = int(used.size());
      used.push_back(surface.vertices[v]);
    }
  surface.vertices = std::move(used);
  for (auto& t : surface.triangles)
    for (int& v : t) v = number[std::size_t(v)];
}

/// Throws MeshError unless the surface is closed, manifold, faces outwards and does not cross itself; see
/// validate_surface.
inline SurfaceReport validate_surface(const TriangleSurface& surface) {
  ClosedSurface input;
  input.vertices = surface.vertices;
  for (const auto& t : surface.triangles) input.facets.push_back({{t[0], t[1], t[2]}, 0});
  return validate_surface(input);
}

/// How often the surface winds around a point: 1 inside, 0 outside.
inline double winding_number(const TriangleSurface& surface, const Vec3d& point) {
  double angle = 0.0;
  const auto at = [&](int vertex) -> const Vec3d& { return surface.vertices[std::size_t(vertex)]; };
  for (const auto& t : surface.triangles) angle += solid_angle(at(t[0]), at(t[1]), at(t[2]), point);
  return angle / (4.0 * std::numbers::pi);
}

}  // namespace lumo
