#pragma once

#include "lumo/core/types.hpp"

namespace lumo::detail {

/// Two unit tangents that make a right-handed frame with the unit vector `n` (after Duff et al., JCGT 6(1), 2017).
template <class Vec3 = Vec3>
inline void tangents(In<Vec3> n, Vec3& t1, Vec3& t2) {
  const double sign = n.z() < -0.6180339887 ? -1.0 : 1.0;  // not at 0: walls are upright, and rounding must not turn their frames
  const double a = -1.0 / (sign + n.z()), b = n.x() * n.y() * a;
  t1 = {1.0 + sign * n.x() * n.x() * a, sign * b, -sign * n.x()};
  t2 = {b, sign + n.y() * n.y() * a, -n.y()};
}

}  // namespace lumo::detail
