#pragma once

#include "lumo/core/types.hpp"
#include "lumo/morphology/emitter.hpp"

namespace lumo {

/// Point of the unit disc from two numbers in (0, 1), uniform in area; opposite numbers give opposite points. Source:
/// Shirley & Chiu, "A Low Distortion Map Between Disk and Square", J. Graphics Tools 2 (1997).
inline Vec3d on_unit_disc(double u, double v, const Vec3d& t1, const Vec3d& t2) {
  const double a = 2.0 * u - 1.0, b = 2.0 * v - 1.0;
  if (a == 0.0 && b == 0.0) return Vec3d::Zero();
  const bool steep = std::abs(b) > std::abs(a);
  const double r = steep ? b : a, turn = steep ? 0.5 * pi - 0.25 * pi * (a / b) : 0.25 * pi * (b / a);
  return r * (std::cos(turn) * t1 + std::sin(turn) * t2);
}

/// Point of the disc about `center` with unit normal `n`; the same for every description of it.
inline Vec3d on_disc(const Vec3d& center, const Vec3d& n, double radius_m, double u, double v) {
  Vec3d t1, t2;
  tangents(n, t1, t2);
  return center + radius_m * on_unit_disc(u, v, t1, t2);
}

/// A flat round emitter with a cosine law (Lambert 1760). It radiates to `normal`.
struct DiscEmitter {
  Vec3d center{0.0, 0.0, 0.0};  ///< [m]
  Vec3d normal{0.0, 0.0, 1.0};  ///< unit
  double radius_m = 0.5e-3;
  double power_W = 1.0;
  int channel = 0;  ///< colour channel

  Vec3d axis() const { return normal; }
  Vec3d point(double u, double v) const { return on_disc(center, normal, radius_m, u, v); }
  Polar polar(double u) const { return {std::sqrt(u), std::sqrt(1.0 - u)}; }
  double intensity(double cosine) const { return cosine > 0.0 ? power_W / pi * cosine : 0.0; }
  DiscEmitter mirrored(const Vec3d& m) const {
    return {m.cwiseProduct(center), m.cwiseProduct(normal), radius_m, power_W, channel};
  }
};

inline void validate(const DiscEmitter& e) { require_positive("radius of a disc emitter", e.radius_m, "m"); }

static_assert(EmitterModel<DiscEmitter>);

}  // namespace lumo
