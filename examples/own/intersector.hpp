#pragma once

#include "lumo/optics/intersector.hpp"

#include <Eigen/Geometry>

#include <vector>

namespace own {

//! [intersector]
/// Asks every triangle (Möller & Trumbore 1997): slow, and a judge of whatever is fast.
struct EveryTriangle {
  struct Scene {
    std::vector<lumo::SceneTriangle> triangles;

    /// Inside the body a ray meets only faces that it leaves by, outside only fronts.
    lumo::RayHit first_hit(const lumo::Vec3d& from, const lumo::Vec3d& direction, bool inside) const {
      lumo::RayHit first;
      for (int k = 0; k < int(triangles.size()); ++k) {
        const auto& [corners, in_air_only] = triangles[std::size_t(k)];
        const lumo::Vec3d u = corners[1] - corners[0], v = corners[2] - corners[0], across = direction.cross(v);
        const double size = u.dot(across);  // = −d·n, twice the area of the triangle as the ray sees it
        if (inside ? size >= 0.0 || in_air_only : size <= 0.0) continue;
        const lumo::Vec3d away = from - corners[0], up = away.cross(u);
        const double a = away.dot(across) / size, b = direction.dot(up) / size, t = v.dot(up) / size;
        if (a >= 0.0 && b >= 0.0 && a + b <= 1.0 && t >= 0.0 && t < first.t) first = {t, k};
      }
      return first;
    }
  };
  Scene build(const std::vector<lumo::SceneTriangle>& triangles) const { return {triangles}; }
};

static_assert(lumo::Intersector<EveryTriangle>);
//! [intersector]

}  // namespace own
