#pragma once

#include "lumo/geometry/surface_check.hpp"

#include <array>
#include <numbers>
#include <vector>

namespace lumo {

/// A surface of triangles, counter-clockwise seen from outside.
struct TriangleSurface {
  std::vector<Vec3d> vertices;  ///< [m]
  std::vector<std::array<int, 3>> triangles;
};

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
