#pragma once

#include "lumo/mechanics/materials/material.hpp"

#include <cmath>
#include <limits>

// What nearly incompressible rubber laws share: invariants of the deformation without its volume change, and one
// volumetric energy.
namespace lumo {

/// A function of the deformation gradient with its first and second derivative, the latter flattened by columns.
template <class S> struct InvariantSample {
  S value;
  Mat3<S> gradient;
  Mat9<S> hessian;
};

/// U(J) = κ/4 (J² − 1 − 2 ln J): convex, and without limit at both ends. Source: Simo and Taylor 1991.
template <class S> VolumetricSample<S> convex_volumetric(double bulk, const S& J) {
  using std::log;
  if (!(J > 0.0)) return {std::numeric_limits<double>::infinity(), 0.0, 0.0};
  return {0.25 * bulk * (J * J - 1.0 - 2.0 * log(J)), 0.5 * bulk * (J - 1.0 / J), 0.5 * bulk * (1.0 + 1.0 / (J * J))};
}

namespace detail {

// I J^(−m), from I with its derivatives.
template <class S> InvariantSample<S> without_volume(const Mat3<S>& F, const InvariantSample<S>& full, double m) {
  using std::pow;
  const S J = F.determinant(), scale = pow(J, -m);
  const Mat3<S> c = cofactor(F);
  const Mat9<S> mixed = dyad(full.gradient, c);
  return {scale * full.value, scale * (full.gradient - (m * full.value / J) * c),
      scale * (full.hessian - (m / J) * (mixed + mixed.transpose()) +
                  dyad((m * (m + 1.0) * full.value / (J * J)) * c, c) - (m * full.value / J) * determinant_hessian(F))};
}

}  // namespace detail

/// Ī₁ = J^(−2/3) tr C; det F must be positive.
template <class S> InvariantSample<S> first_isochoric_invariant(const Mat3<S>& F) {
  const InvariantSample<S> full{F.squaredNorm(), 2.0 * F, isotropic(S(2.0))};
  return detail::without_volume(F, full, 2.0 / 3.0);
}

/// Ī₂ = J^(−4/3) tr cof C; det F must be positive.
template <class S> InvariantSample<S> second_isochoric_invariant(const Mat3<S>& F) {
  const Mat3<S> C = F.transpose() * F, B = F * F.transpose();
  const S I1 = C.trace();
  Mat9<S> h;  // 2 (I₁ dF + 2 (F : dF) F − dF C − F dFᵀ F − B dF)
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k < 3; ++k)
        for (int l = 0; l < 3; ++l) {
          const double same_row = i == k ? 1.0 : 0.0, same_column = j == l ? 1.0 : 0.0;
          h(i + 3 * j, k + 3 * l) = 2.0 * (I1 * same_row * same_column + 2.0 * F(i, j) * F(k, l) - same_row * C(l, j) -
                                              F(i, l) * F(k, j) - same_column * B(i, k));
        }
  const InvariantSample<S> full{0.5 * (I1 * I1 - C.squaredNorm()), 2.0 * (I1 * F - F * C), h};
  return detail::without_volume(F, full, 4.0 / 3.0);
}

}  // namespace lumo
