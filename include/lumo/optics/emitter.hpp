#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/morphology/optical_data.hpp"

#include <concepts>
#include <vector>

namespace lumo {

/// Unit normal of the radiating side.
inline Vec3 normal(const RectangleEmitter& e) { return e.half_u.cross(e.half_v).normalized(); }
/// Point [m] from two numbers in (0, 1), uniform in area.
inline Vec3 point(const RectangleEmitter& e, double u, double v) {
  return e.center + (2.0 * u - 1.0) * e.half_u + (2.0 * v - 1.0) * e.half_v;
}

/// A flat source with a cosine law (Lambert 1760) into the medium that it touches; power_W is all that it radiates.
/// Laws: point() is uniform in area over (0, 1)²; |normal| = 1.
template <class E>
concept FlatEmitter = requires(const E& e, double u) {
  { point(e, u, u) } -> std::convertible_to<Vec3>;
  { normal(e) } -> std::convertible_to<Vec3>;
  { e.power_W } -> std::convertible_to<double>;
};

static_assert(FlatEmitter<RectangleEmitter>);

/// Throws InvalidArgument for no emitters, numbers that are not finite, no area, or a power that is not positive.
inline void validate(const std::vector<RectangleEmitter>& emitters) {
  if (emitters.empty()) throw InvalidArgument("emitters: none given, at least one is needed");
  for (const RectangleEmitter& e : emitters) {
    require_positive("emitter power", e.power_W, "W");
    if (!e.center.allFinite() || !e.half_u.allFinite() || !e.half_v.allFinite())
      throw InvalidArgument("emitter: a coordinate is not finite");
    require_positive("emitter area", 4.0 * e.half_u.cross(e.half_v).norm(), "m2");
  }
}

}  // namespace lumo
