#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/shape.hpp"

#include <array>
#include <cmath>

namespace lumo {

// Shapes of revolution and the ellipsoid. Of each the body is inside, or, with `hole`, around it: then the normal
// points into the hole.

/// The cylinder of `radius` [m] about the line through `point` along the unit vector `axis`; it has no ends.
struct CylinderShape {
  Vec3d point{0.0, 0.0, 0.0};  ///< [m]
  Vec3d axis{0.0, 0.0, 1.0};
  double radius = 1.0;
  bool hole = false;

  Vec3d closest_point(const Vec3d& p) const;
  Vec3d normal(const Vec3d& p) const;
};

/// The cone from `apex` that opens along the unit vector `axis`, on that side only; `half_angle_rad` between axis and
/// surface. At the apex the normal is one of many.
struct ConeShape {
  Vec3d apex{0.0, 0.0, 0.0};  ///< [m]
  Vec3d axis{0.0, 0.0, 1.0};
  double half_angle_rad = 0.25 * pi;
  bool hole = false;

  Vec3d closest_point(const Vec3d& p) const;
  Vec3d normal(const Vec3d& p) const;
};

/// The ellipsoid about `center` with half axes `semi` along x, y and z [m].
struct EllipsoidShape {
  Vec3d center{0.0, 0.0, 0.0};
  Vec3d semi{1.0, 1.0, 1.0};
  bool hole = false;

  Vec3d closest_point(const Vec3d& p) const;
  Vec3d normal(const Vec3d& p) const;
};

/// The torus about `center`: a tube of radius `tube` [m] whose middle is the circle of radius `ring` [m] across the
/// unit vector `axis`. A round edge is a quarter of it, a fillet a quarter with `hole`.
struct TorusShape {
  Vec3d center{0.0, 0.0, 0.0};  ///< [m]
  Vec3d axis{0.0, 0.0, 1.0};
  double ring = 2.0, tube = 1.0;
  bool hole = false;

  Vec3d closest_point(const Vec3d& p) const;
  Vec3d normal(const Vec3d& p) const;
};

/// Throw InvalidArgument for an axis whose length is not 1, a length that is not positive, a cone's angle out of
/// [0.1, 89.9] degrees, and a tube that is thicker than its ring.
inline void validate(const CylinderShape& s) {
  require_unit("axis of a cylinder", s.axis);
  require_positive("radius of a cylinder", s.radius, "m");
}
inline void validate(const ConeShape& s) {
  require_unit("axis of a cone", s.axis);
  require_in_range("half angle of a cone", s.half_angle_rad * 180.0 / pi, 0.1, 89.9, "deg");
}
inline void validate(const EllipsoidShape& s) {
  for (Eigen::Index k = 0; k < 3; ++k) require_positive("half axis of an ellipsoid", s.semi[k], "m");
}
inline void validate(const TorusShape& s) {
  require_unit("axis of a torus", s.axis);
  require_positive("radius of a torus' tube", s.tube, "m");
  require_positive("radius of a torus' ring", s.ring, "m");
  if (!(s.tube <= s.ring))
    throw InvalidArgument(
        message("radius of a torus' tube is ", s.tube, " m, at most that of its ring, ", s.ring, " m"));
}

namespace detail {

// A point as it lies about an axis.
struct AboutAxis {
  double along, aside;
  Vec3d out;  ///< unit, from the axis to the point; of points on the axis any

  AboutAxis(const Vec3d& from_origin, const Vec3d& axis) : along(axis.dot(from_origin)) {
    const Vec3d across = from_origin - along * axis;
    aside = across.norm();
    Vec3d t1, t2;
    tangents(axis, t1, t2);
    out = aside > 0.0 ? Vec3d(across / aside) : t1;
  }
};

}  // namespace detail

inline Vec3d CylinderShape::closest_point(const Vec3d& p) const {
  const detail::AboutAxis at(p - point, axis);
  return point + at.along * axis + radius * at.out;
}
inline Vec3d CylinderShape::normal(const Vec3d& p) const {
  return (hole ? -1.0 : 1.0) * detail::AboutAxis(p - point, axis).out;
}

inline Vec3d ConeShape::closest_point(const Vec3d& p) const {
  const detail::AboutAxis at(p - apex, axis);
  const double c = std::cos(half_angle_rad), s = std::sin(half_angle_rad);
  return apex + std::max(0.0, c * at.along + s * at.aside) * (c * axis + s * at.out);
}
inline Vec3d ConeShape::normal(const Vec3d& p) const {
  const detail::AboutAxis at(p - apex, axis);
  return (hole ? -1.0 : 1.0) * (std::cos(half_angle_rad) * at.out - std::sin(half_angle_rad) * axis);
}

// After Eberly, "Distance from a Point to an Ellipsoid" (2013), as EllipticCylinder does in the plane: the root of a
// convex, falling function by Newton's method in a bracket. Half axes are in units of the least.
inline Vec3d EllipsoidShape::closest_point(const Vec3d& p) const {
  Eigen::Index least = 0;
  semi.minCoeff(&least);
  const Vec3d q = (p - center).cwiseAbs();
  Vec3d r, excess, z;  // squared ratio of half axes, what it has over 1, and the place in units of the half axis
  for (Eigen::Index k = 0; k < 3; ++k) {
    r[k] = (semi[k] / semi[least]) * (semi[k] / semi[least]);
    excess[k] = r[k] - 1.0;
    z[k] = q[k] / semi[k];
  }
  const auto sum = [&](double t, double& slope) {
    double squares = 0.0;
    slope = 0.0;
    for (Eigen::Index k = 0; k < 3; ++k)
      if (z[k] > 0.0) {
        const double w = r[k] * z[k] / (t + excess[k]);
        squares += w * w;
        slope += w * w / (t + excess[k]);
      }
    return squares;
  };
  double low = z[least], high = Vec3d(r.cwiseProduct(z)).norm(), t = 0.0, slope = 0.0;
  // Without a part along the least axis the root may lie beyond the pole at t = 0: then the foot leaves the plane.
  if (low > 0.0 || !(sum(0.0, slope) <= 1.0)) {
    t = std::clamp(1.0, low, high);
    for (int i = 0; i < 200; ++i) {
      const double over = sum(t, slope) - 1.0;
      (over > 0.0 ? low : high) = t;
      const double step = 0.5 * over / slope, next = t + step;
      const bool close = std::abs(step) <= 1e-9 * t;
      t = close || (next >= low && next <= high) ? next : 0.5 * (low + high);
      if (close || !(low < high)) break;
    }
  }
  Vec3d foot(0.0, 0.0, 0.0);
  double rest = 1.0;
  for (Eigen::Index k = 0; k < 3; ++k) {
    if (z[k] > 0.0) foot[k] = r[k] * q[k] / (t + excess[k]);
    rest -= (foot[k] / semi[k]) * (foot[k] / semi[k]);
  }
  if (!(z[least] > 0.0)) foot[least] = semi[least] * std::sqrt(std::max(0.0, rest));
  for (Eigen::Index k = 0; k < 3; ++k) foot[k] = std::copysign(foot[k], p[k] - center[k]);
  return center + foot;
}
inline Vec3d EllipsoidShape::normal(const Vec3d& p) const {
  const Vec3d foot = closest_point(p) - center;
  return (hole ? -1.0 : 1.0) * foot.cwiseQuotient(semi.cwiseProduct(semi)).normalized();
}

inline Vec3d TorusShape::closest_point(const Vec3d& p) const {
  const detail::AboutAxis at(p - center, axis);
  return center + ring * at.out + (hole ? -tube : tube) * normal(p);
}
inline Vec3d TorusShape::normal(const Vec3d& p) const {
  const detail::AboutAxis at(p - center, axis);
  const Vec3d d = (at.aside - ring) * at.out + at.along * axis;
  const double length = d.norm();
  return (hole ? -1.0 : 1.0) * (length > 0.0 ? Vec3d(d / length) : axis);
}

static_assert(
    SurfaceShape<CylinderShape> && SurfaceShape<ConeShape> && SurfaceShape<EllipsoidShape> && SurfaceShape<TorusShape>);

}  // namespace lumo
