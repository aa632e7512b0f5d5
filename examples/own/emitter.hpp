#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/emitter.hpp"

#include <cmath>

namespace own {

//! [emitter]
/// A small square LED behind a lens, facing +z: intensity (n + 1)/(2π) P cosⁿ, n = 1 without a lens.
struct LensedLed {
  lumo::Vec3d center = lumo::Vec3d::Zero();  ///< [m]
  double half_edge_m = 0.4e-3;
  double exponent = 4.0;  ///< n
  double power_W = 1.0;
  int channel = 0;  ///< colour

  lumo::Vec3d axis() const { return lumo::Vec3d::UnitZ(); }
  lumo::Vec3d point(double u, double v) const {
    return center + half_edge_m * lumo::Vec3d(2.0 * u - 1.0, 2.0 * v - 1.0, 0.0);
  }
  /// Of u evenly spread over (0, 1): P(cos > c) = 1 − cⁿ⁺¹.
  lumo::Polar polar(double u) const {
    const double cosine = std::pow(1.0 - u, 1.0 / (exponent + 1.0));
    return {std::sqrt(1.0 - cosine * cosine), cosine};
  }
  /// [W/sr]. May be left out; with it direct light is gathered with less noise.
  double intensity(double cosine) const {
    return cosine > 0.0 ? 0.5 * (exponent + 1.0) / lumo::pi * power_W * std::pow(cosine, exponent) : 0.0;
  }
  LensedLed mirrored(const lumo::Vec3d& m) const {
    return {m.cwiseProduct(center), half_edge_m, exponent, power_W, channel};
  }
};

inline void validate(const LensedLed& e) {
  lumo::require_positive("half edge of an LED", e.half_edge_m, "m");
  lumo::require_in_range("exponent of a lens", e.exponent, 0.0, 1e4, "");
}

static_assert(lumo::EmitterModel<LensedLed>);
//! [emitter]

}  // namespace own
