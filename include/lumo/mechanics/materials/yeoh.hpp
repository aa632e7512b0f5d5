#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mechanics/materials/material.hpp"

#include <cmath>
#include <limits>

namespace lumo {

/// Yeoh solid, W = Σ cₖ (Ī₁ − 3)ᵏ, k = 1, 2, 3, + κ/4 (J² − 1 − 2 ln J). Shear modulus 2 c₁; +∞ where J ≤ 0. Source:
/// Yeoh 1993. The energy's slope by Ī₁ must be positive however far the body is stretched; c₂ may be negative, as fits
/// to rubber that softens and then stiffens have it. The default is Dragon Skin of the paper at small strain.
struct Yeoh {
  double c1 = 53.0e3;       ///< [Pa]
  double c2 = 0.0;          ///< [Pa]
  double c3 = 0.0;          ///< [Pa]
  double bulk = 10.5647e6;  ///< bulk modulus κ [Pa]

  double shear_modulus() const { return 2.0 * c1; }

  template <class S> S distortion_energy(const Mat3<S>& F) const {
    if (!(F.determinant() > 0.0)) return std::numeric_limits<double>::infinity();
    const S s = first_isochoric_invariant(F).value - 3.0;
    return s * (c1 + s * (c2 + s * c3));
  }
  template <class S> Mat3<S> distortion_stress(const Mat3<S>& F) const {
    const InvariantSample<S> I = first_isochoric_invariant(F);
    return slope(I.value - 3.0) * I.gradient;
  }
  template <class S> Mat9<S> distortion_tangent(const Mat3<S>& F) const {
    const InvariantSample<S> I = first_isochoric_invariant(F);
    const S s = I.value - 3.0;
    const Eigen::Map<const Eigen::Matrix<S, 9, 1>> g(I.gradient.data());
    return slope(s) * I.hessian + (2.0 * c2 + 6.0 * c3 * s) * g * g.transpose();
  }
  template <class S> VolumetricSample<S> volumetric(const S& J) const { return convex_volumetric(bulk, J); }

 private:
  template <class S> S slope(const S& s) const { return c1 + s * (2.0 * c2 + s * 3.0 * c3); }
};

inline void validate(const Yeoh& m) {
  require_positive("Yeoh c1", m.c1, "Pa");
  require_in_range("Yeoh c3", m.c3, 0.0, 1e12, "Pa");
  // c₁ + 2 c₂ s + 3 c₃ s² > 0 for all s ≥ 0; where the parabola only touches 0 there is no stiffness left.
  const double least = -std::sqrt(3.0 * m.c1 * m.c3);
  if (!(std::isfinite(m.c2) && m.c2 <= 1e12 && (m.c2 >= 0.0 || m.c2 > least)))
    throw InvalidArgument(message("Yeoh c2 is ", m.c2, " Pa, must lie above -sqrt(3 c1 c3) = ", least,
        " Pa, or not below 0, and not above 1e12 Pa"));
  require_in_range("bulk modulus", m.bulk, 1e-3, 1e15, "Pa");
}

static_assert(HyperelasticMaterial<Yeoh>);

}  // namespace lumo
