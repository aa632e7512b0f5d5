#pragma once

#include "lumo/core/types.hpp"

#include <algorithm>
#include <cmath>
#include <concepts>
#include <variant>

namespace lumo {

/// An exact surface that a patch of a body lies on.
/// Laws: closest_point is idempotent; normal(p) is the outward unit normal at closest_point(p).
template <class S>
concept SurfaceShape = requires(const S& shape, const Vec3d& p) {
  { shape.closest_point(p) } -> std::convertible_to<Vec3d>;
  { shape.normal(p) } -> std::convertible_to<Vec3d>;
};

/// The plane through `point` with outward unit normal `direction`.
struct Plane {
  Vec3d point{0.0, 0.0, 0.0};
  Vec3d direction{0.0, 0.0, 1.0};

  Vec3d closest_point(const Vec3d& p) const { return p - direction.dot(p - point) * direction; }
  Vec3d normal(const Vec3d&) const { return direction; }
};

/// The upper half (z ≥ centre) of the elliptic cylinder along y: ((x−cx)/semi_x)² + ((z−cz)/semi_z)² = 1, lengths in m.
struct EllipticCylinder {
  Vec3d center{0.0, 0.0, 0.0};
  double semi_x = 1.0;
  double semi_z = 1.0;

  Vec3d closest_point(const Vec3d& p) const;
  Vec3d normal(const Vec3d& p) const;
};

/// Sphere of `radius` [m] about `center`; the body is inside.
struct SphereShape {
  Vec3d center{0.0, 0.0, 0.0};
  double radius = 1.0;

  Vec3d closest_point(const Vec3d& p) const { return center + radius * normal(p); }
  Vec3d normal(const Vec3d& p) const {
    const Vec3d d = p - center;
    const double r = d.norm();
    return r > 0.0 ? Vec3d(d / r) : Vec3d(Vec3d::UnitZ());
  }
};

using Shape = std::variant<Plane, EllipticCylinder, SphereShape>;

inline Vec3d closest_point(const Shape& shape, const Vec3d& p) {
  return std::visit([&](const auto& s) -> Vec3d { return s.closest_point(p); }, shape);
}
inline Vec3d outward_normal(const Shape& shape, const Vec3d& p) {
  return std::visit([&](const auto& s) -> Vec3d { return s.normal(p); }, shape);
}

// The foot of the perpendicular on an ellipse, after Eberly, "Distance from a Point to an Ellipse" (2013): the root of
// a convex, falling function; Newton's method from the surface, where most points are, and bisection where a step would
// leave the bracket, so that it converges for every aspect ratio and every point.
inline Vec3d EllipticCylinder::closest_point(const Vec3d& p) const {
  const double px = std::abs(p.x() - center.x());
  const double pz = std::max(0.0, p.z() - center.z());
  const double side = p.x() < center.x() ? -1.0 : 1.0;
  const bool x_major = semi_x >= semi_z;
  const double a = x_major ? semi_x : semi_z, b = x_major ? semi_z : semi_x;
  const double u = x_major ? px : pz, v = x_major ? pz : px;  // along the major and the minor axis
  double fu = 0.0, fv = 0.0;
  if (v > 0.0) {
    if (u > 0.0) {
      const double r = (a / b) * (a / b), e = r - 1.0, zu = r * u / a, zv = v / b;
      double low = zv, high = std::hypot(zu, zv), t = std::clamp(1.0, low, high);  // 1: on the surface
      for (int i = 0; i < 200; ++i) {
        const double x = zu / (t + e), y = zv / t, excess = x * x + y * y - 1.0;
        (excess > 0.0 ? low : high) = t;
        const double step = 0.5 * excess / (x * x / (t + e) + y * y / t), next = t + step;
        const bool close = std::abs(step) <= 1e-9 * t;  // then the error that is left is the square of this
        t = close || (next >= low && next <= high) ? next : 0.5 * (low + high);
        if (close || !(low < high)) break;
      }
      fu = r * u / (t + e);
      fv = v / t;
    } else {
      fv = b;
    }
  } else {
    const double c = a * a - b * b;
    if (a * u < c) {
      fu = a * a * u / c;
      fv = b * std::sqrt(std::max(0.0, 1.0 - (fu / a) * (fu / a)));
    } else {
      fu = a;
    }
  }
  return {center.x() + side * (x_major ? fu : fv), p.y(), center.z() + (x_major ? fv : fu)};
}

inline Vec3d EllipticCylinder::normal(const Vec3d& p) const {
  const Vec3d foot = closest_point(p) - center;
  return Vec3d(foot.x() / (semi_x * semi_x), 0.0, foot.z() / (semi_z * semi_z)).normalized();
}

static_assert(SurfaceShape<Plane> && SurfaceShape<EllipticCylinder> && SurfaceShape<SphereShape>);

}  // namespace lumo
