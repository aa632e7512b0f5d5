#pragma once

#include "lumo/morphology/emitter.hpp"

namespace lumo {

/// A point that radiates alike in all directions. It must lie inside the medium: of a point on its surface half the
/// light starts out of it.
struct PointEmitter {
  Vec3d center{0.0, 0.0, 0.0};  ///< [m]
  double power_W = 1.0;
  int channel = 0;  ///< colour channel

  Vec3d axis() const { return Vec3d::UnitZ(); }
  Vec3d point(double, double) const { return center; }
  Polar polar(double u) const { return {2.0 * std::sqrt(u * (1.0 - u)), 1.0 - 2.0 * u}; }
  double intensity(double) const { return power_W / (4.0 * pi); }
  PointEmitter mirrored(const Vec3d& m) const { return {m.cwiseProduct(center), power_W, channel}; }
};

static_assert(EmitterModel<PointEmitter>);

}  // namespace lumo
