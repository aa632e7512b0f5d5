#pragma once

#include "lumo/core/types.hpp"

#include <array>
#include <cmath>

namespace lumo {

/// A place to about a nanometre, for look-ups.
using PlaceKey = std::array<long long, 3>;

// The odd unit keeps round coordinates off the borders of its cells.
inline PlaceKey place_key(const Vec3d& p) {
  constexpr double unit = 1.0471975512e-9;
  return {std::llround(p.x() / unit), std::llround(p.y() / unit), std::llround(p.z() / unit)};
}

/// The mirror image of `p` with x ≥ 0 and y ≥ 0, as far as there is `symmetry`.
inline Vec3d folded(Vec3d p, Symmetry symmetry) {
  if (symmetry.x) p.x() = std::abs(p.x());
  if (symmetry.y) p.y() = std::abs(p.y());
  return p;
}

}  // namespace lumo
