#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mechanics/materials/material.hpp"

namespace lumo {

/// Mooney–Rivlin solid, W = c₁₀ (Ī₁ − 3) + c₀₁ (Ī₂ − 3) + κ/4 (J² − 1 − 2 ln J). Shear modulus 2 (c₁₀ + c₀₁); +∞ where
/// J ≤ 0. Source: Mooney 1940, Rivlin 1948. The default is Dragon Skin of the paper at small strain, a fifth of it in
/// the second term.
struct MooneyRivlin {
  double c10 = 42.4e3;      ///< [Pa]
  double c01 = 10.6e3;      ///< [Pa]
  double bulk = 10.5647e6;  ///< bulk modulus κ [Pa]

  double shear_modulus() const { return 2.0 * (c10 + c01); }

  template <class S> S distortion_energy(const Mat3<S>& F) const {
    if (!(F.determinant() > 0.0)) return std::numeric_limits<double>::infinity();
    return c10 * (first_isochoric_invariant(F).value - 3.0) + c01 * (second_isochoric_invariant(F).value - 3.0);
  }
  template <class S> Mat3<S> distortion_stress(const Mat3<S>& F) const {
    return c10 * first_isochoric_invariant(F).gradient + c01 * second_isochoric_invariant(F).gradient;
  }
  template <class S> Mat9<S> distortion_tangent(const Mat3<S>& F) const {
    return c10 * first_isochoric_invariant(F).hessian + c01 * second_isochoric_invariant(F).hessian;
  }
  template <class S> VolumetricSample<S> volumetric(const S& J) const { return convex_volumetric(bulk, J); }
};

inline void validate(const MooneyRivlin& m) {
  require_in_range("Mooney-Rivlin c10", m.c10, 0.0, 1e12, "Pa");
  require_in_range("Mooney-Rivlin c01", m.c01, 0.0, 1e12, "Pa");
  require_positive("shear modulus 2 (c10 + c01)", m.shear_modulus(), "Pa");
  require_in_range("bulk modulus", m.bulk, 1e-3, 1e15, "Pa");
}

static_assert(HyperelasticMaterial<MooneyRivlin>);

}  // namespace lumo
