#pragma once

#include "lumo/core/types.hpp"

#include <array>
#include <concepts>
#include <limits>
#include <vector>

namespace lumo {

/// Triangle of an optical scene, counter-clockwise seen from outside the body, or from the lit side of a carrier face.
struct SceneTriangle {
  std::array<Vec3d, 3> corners;  ///< [m]
  bool in_air_only = false;      ///< a carrier face: met only by rays outside the body
};

/// The first triangle on a ray.
struct RayHit {
  double t = std::numeric_limits<double>::infinity();  ///< along the unit direction [m]; infinite: no triangle
  int triangle = -1;
  explicit operator bool() const { return triangle >= 0; }
};

/// Finds what a ray meets first, *given the medium it is in*: inside the body only faces that it can leave by (d·n > 0,
/// not in_air_only) count, outside only faces that it can meet from their front (d·n < 0). A ray that starts on a face
/// can therefore never meet that face again, whatever the rounding, and needs no offset.
template <class S>
concept RayScene = requires(const S& scene, const Vec3d& v, bool inside) {
  { scene.first_hit(v, v, inside) } -> std::same_as<RayHit>;
};

/// Builds a RayScene from triangles. Laws: same triangles, same hits; results do not depend on where the scene lies in
/// space.
template <class I>
concept Intersector = requires(const I& intersector, const std::vector<SceneTriangle>& triangles) {
  { intersector.build(triangles) } -> RayScene;
};

}  // namespace lumo
