#pragma once

#include "lumo/morphology/emitter.hpp"

namespace lumo {

/// A point that radiates alike in all directions. It must lie inside the medium: of a point on its surface half the light starts out of it.
struct PointEmitter {
  Vec3 center{0.0, 0.0, 0.0};      ///< [m]
  double power_W = 1.0;
  int channel = 0;                 ///< colour channel

  template <class Vec3 = Vec3>
  Vec3 axis() const { return Vec3::UnitZ(); }
  Vec3 point(double, double) const { return center; }
  Polar polar(double u) const { return {2.0 * std::sqrt(u * (1.0 - u)), 1.0 - 2.0 * u}; }
  double intensity(double) const { return power_W / (4.0 * pi); }
  template <class Vec3 = Vec3>
  PointEmitter mirrored(In<Vec3> m) const { return {m.cwiseProduct(center), power_W, channel}; }
};

static_assert(EmitterModel<PointEmitter>);

}  // namespace lumo
