#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"

#include <algorithm>
#include <cmath>
#include <concepts>
#include <memory>
#include <variant>

namespace lumo {

/// An exact surface that a patch of a body lies on.
/// Laws: closest_point is idempotent; normal(p) is the outward unit normal at closest_point(p). A `validate(shape)`
/// beside it is called before the shape is used.
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

/// Throws InvalidArgument unless the direction of a surface has length 1, within 1e-6.
inline void require_unit(const char* what, const Vec3d& direction) {
  if (!(std::abs(direction.norm() - 1.0) <= 1e-6))
    throw InvalidArgument(message(what, " has length ", direction.norm(), ", must be 1"));
}

inline void validate(const Plane& plane) { require_unit("direction of a plane", plane.direction); }

/// Any other model of SurfaceShape: a value, cheap to copy.
class OwnShape {
 public:
  template <class S>
  requires(!std::same_as<S, OwnShape> && SurfaceShape<S>) OwnShape(const S& model)
      : model_(std::make_shared<const S>(model)), calls_(&calls<S>) {}

  Vec3d closest_point(const Vec3d& p) const { return calls_->closest_point(model_.get(), p); }
  Vec3d normal(const Vec3d& p) const { return calls_->normal(model_.get(), p); }
  /// What the model's own validate() throws, if it has one.
  void validate() const { calls_->validate(model_.get()); }
  /// Its model, if it is an S.
  template <SurfaceShape S> const S* as() const {
    return calls_ == &calls<S> ? static_cast<const S*>(model_.get()) : nullptr;
  }

 private:
  struct Calls {
    Vec3d (*closest_point)(const void*, const Vec3d&);
    Vec3d (*normal)(const void*, const Vec3d&);
    void (*validate)(const void*);
  };
  template <class S> static const Calls calls;

  std::shared_ptr<const void> model_;
  const Calls* calls_;
};

/// The surface of a patch: any SurfaceShape. Three that bodies have most are called directly, all others through
/// OwnShape.
using Shape = std::variant<Plane, EllipticCylinder, SphereShape, OwnShape>;

inline Vec3d closest_point(const Shape& shape, const Vec3d& p) {
  return std::visit([&](const auto& s) -> Vec3d { return s.closest_point(p); }, shape);
}
inline Vec3d outward_normal(const Shape& shape, const Vec3d& p) {
  return std::visit([&](const auto& s) -> Vec3d { return s.normal(p); }, shape);
}

namespace detail {

// What a shape says of its own numbers.
template <class S> void validate_shape(const S& shape) {
  if constexpr (requires { shape.validate(); }) shape.validate();
  else if constexpr (requires { validate(shape); }) validate(shape);
}

}  // namespace detail

/// Throws what the shape's own validate() throws. Not for what could become a Shape: that would ask itself.
template <std::same_as<Shape> S> void validate(const S& shape) {
  std::visit([](const auto& s) { detail::validate_shape(s); }, shape);
}

template <class S> const OwnShape::Calls OwnShape::calls = {
    [](const void* s, const Vec3d& p) -> Vec3d { return static_cast<const S*>(s)->closest_point(p); },
    [](const void* s, const Vec3d& p) -> Vec3d { return static_cast<const S*>(s)->normal(p); },
    [](const void* s) { detail::validate_shape(*static_cast<const S*>(s)); }};

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
static_assert(SurfaceShape<OwnShape> && !SurfaceShape<Shape>);

}  // namespace lumo
