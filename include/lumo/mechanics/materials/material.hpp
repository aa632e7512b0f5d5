#pragma once

#include "lumo/core/types.hpp"

#include <Eigen/LU>
#include <cmath>
#include <concepts>
#include <limits>

namespace lumo {

/// A function of the volume ratio J with its derivatives: energy density [J/m³], dU/dJ [Pa], d²U/dJ² [Pa].
template <class S> struct VolumetricSample {
  S energy;
  S stress;
  S stiffness;
};

/// A hyperelastic solid, W(F) = distortion(F) + U(det F). The split lets an element treat the stiff volumetric part U
/// by its mean. A law is written for doubles, or with a deduced scalar (`template <class S> S distortion_energy(const
/// Mat3<S>& F) const` …), so that it can also be differentiated by dual numbers. Laws: P(I) = 0; W(QF) = W(F) for
/// rotations Q; stress and tangent are the derivatives of the energy; W = +∞ where det F ≤ 0 if the law resists
/// inversion. Stress is the first Piola–Kirchhoff stress [Pa], 3 × 3; tangent is ∂P/∂F, 9 × 9, flattened by columns.
template <class M>
concept HyperelasticMaterial = requires(const M& m, const Mat3d& F, double J) {
  { m.distortion_energy(F) } -> std::convertible_to<double>;
  { m.distortion_stress(F) } -> std::convertible_to<Mat3d>;
  { m.distortion_tangent(F) } -> std::convertible_to<Mat9d>;
  { m.volumetric(J) } -> std::convertible_to<VolumetricSample<double>>;
  { m.shear_modulus() } -> std::convertible_to<double>;
  validate(m);
};

/// h'(J) and h''(J) [Pa] of a solid W = μ/2 (I_C − 3) + h(J), as numbers or packs of them.
template <class S> struct DilatationSample {
  S stress;
  S stiffness;
};

/// Derivative of det F by F: the cofactor matrix.
template <class S> Mat3<S> cofactor(const Mat3<S>& F) {
  Mat3<S> c;
  for (int j = 0; j < 3; ++j) {
    const int j1 = (j + 1) % 3, j2 = (j + 2) % 3;
    for (int i = 0; i < 3; ++i) {
      const int i1 = (i + 1) % 3, i2 = (i + 2) % 3;
      c(i, j) = F(i1, j1) * F(i2, j2) - F(i2, j1) * F(i1, j2);
    }
  }
  return c;
}

/// A⁻ᵀ.
template <class S> Mat3<S> inverse_transposed(const Mat3<S>& A) {
  const Mat3<S> c = cofactor(A);
  return c * (1.0 / (c(0, 0) * A(0, 0) + c(1, 0) * A(1, 0) + c(2, 0) * A(2, 0)));
}

/// Second derivative of det F by F, flattened by columns.
template <class S> Mat9<S> determinant_hessian(const Mat3<S>& F) {
  Mat9<S> h = Mat9<S>::Zero();
  for (int j = 0; j < 3; ++j)
    for (int turn = 1; turn < 3; ++turn)
      for (int i = 0; i < 3; ++i) {
        const int j2 = (j + turn) % 3, next = (i + 1) % 3, last = (i + 2) % 3;
        const S* column = F.data() + 3 * (3 - j - j2);
        h(i + 3 * j, next + 3 * j2) = turn == 1 ? column[last] : -column[last];
        h(i + 3 * j, last + 3 * j2) = turn == 1 ? -column[next] : column[next];
      }
  return h;
}

/// a ⊗ b, both flattened by columns.
template <class S> Mat9<S> dyad(const Mat3<S>& a, const Mat3<S>& b) {
  Mat9<S> product;
  for (int j = 0; j < 9; ++j)
    for (int i = 0; i < 9; ++i) product.data()[i + 9 * j] = a.data()[i] * b.data()[j];
  return product;
}

/// m I of nine rows.
template <class S> Mat9<S> isotropic(const S& m) {
  Mat9<S> diagonal = Mat9<S>::Zero();
  for (int i = 0; i < 9; ++i) diagonal.data()[10 * i] = m;
  return diagonal;
}

/// Energy density W(F) [J/m³].
template <HyperelasticMaterial M, class S> S energy_density(const M& m, const Mat3<S>& F) {
  return m.distortion_energy(F) + m.volumetric(F.determinant()).energy;
}

/// First Piola–Kirchhoff stress P = ∂W/∂F [Pa].
template <HyperelasticMaterial M, class S> Mat3<S> first_piola(const M& m, const Mat3<S>& F) {
  return m.distortion_stress(F) + m.volumetric(F.determinant()).stress * cofactor(F);
}

/// Tangent ∂P/∂F [Pa], 9 × 9, flattened by columns.
template <HyperelasticMaterial M, class S> Mat9<S> elasticity_tangent(const M& m, const Mat3<S>& F) {
  const VolumetricSample<S> u = m.volumetric(F.determinant());
  const Mat3<S> c = cofactor(F);
  return m.distortion_tangent(F) + dyad(u.stiffness * c, c) + u.stress * determinant_hessian(F);
}

}  // namespace lumo

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
