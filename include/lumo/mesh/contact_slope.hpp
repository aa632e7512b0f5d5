#pragma once

#include "lumo/core/types.hpp"

#include <cmath>

namespace lumo {

/// How a surface leans away from the rigid thing that it touches, at one node: the surface's outward normal there is
/// `normal` + hertz_slope(opening)·tilt, made unit. All but `normal` may be interpolated across the edge of contact,
/// where the slope of the surface itself has a vertical tangent.
struct ContactSlope {
  Vec3d normal = Vec3d::Zero();  ///< into the rigid thing, unit; the surface's own where it touches; 0: not known
  Vec3d tilt = Vec3d::Zero();
  double opening = -1.0;  ///< q = (r² − a²)/a² of a round contact of radius a; < 0 where it touches
  double weight = 0.0;    ///< 1 at the contact, falling to 0 where this says nothing of the surface
};

/// In the middle between two nodes.
inline ContactSlope midway(const ContactSlope& a, const ContactSlope& b) {
  return {
      0.5 * (a.normal + b.normal), 0.5 * (a.tilt + b.tilt), 0.5 * (a.opening + b.opening), 0.5 * (a.weight + b.weight)};
}

/// Gap beside a round contact of two smooth elastic bodies at q = (r² − a²)/a² ≥ 0, in units of a²/(πR): √q + (q − 1)
/// atan √q. Source: Hertz 1882; Johnson 1985, eq. (3.42).
inline double hertz_gap(double q) {
  const double s = std::sqrt(q);
  return s + (q - 1.0) * std::atan(s);
}

/// Its derivative; 0 inside the contact.
inline double hertz_slope(double q) {
  if (!(q > 0.0)) return 0.0;
  const double s = std::sqrt(q);
  return std::atan(s) + s / (1.0 + q);
}

/// The q ≥ 0 at which hertz_gap(q) = gap.
inline double hertz_opening(double gap) {
  if (!(gap > 0.0)) return 0.0;
  double q = std::cbrt(0.5625 * gap * gap);  // (3/4 gap)^(2/3), from below; hertz_gap is convex
  for (int k = 0; k < 50; ++k) {
    const double step = (gap - hertz_gap(q)) / hertz_slope(q);
    q += step;
    if (std::abs(step) <= 1e-14 * q) break;
  }
  return q;
}

}  // namespace lumo
