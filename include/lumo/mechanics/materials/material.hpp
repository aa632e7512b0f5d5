#pragma once

#include "lumo/mechanics/solvers/simd.hpp"
#include "lumo/core/types.hpp"

#include <Eigen/LU>
#include <concepts>

namespace lumo {

/// A function of the volume ratio J with its derivatives: energy density [J/m³], dU/dJ [Pa], d²U/dJ² [Pa].
struct VolumetricSample {
  double energy;
  double stress;
  double stiffness;
};

/// A hyperelastic solid, W(F) = distortion(F) + U(det F). The split lets an element treat the stiff volumetric part U
/// by its mean. Laws: P(I) = 0; W(QF) = W(F) for rotations Q; stress and tangent are the derivatives of the energy; W =
/// +∞ where det F ≤ 0 if the law resists inversion. Stress is the first Piola–Kirchhoff stress [Pa], 3 × 3; tangent is
/// ∂P/∂F, 9 × 9, flattened by columns.
template <class M>
concept HyperelasticMaterial = requires(const M& m, const Mat3d& F, double J) {
  { m.distortion_energy(F) } -> std::convertible_to<double>;
  { m.distortion_stress(F) } -> std::convertible_to<Mat3d>;
  { m.distortion_tangent(F) } -> std::convertible_to<Mat9d>;
  { m.volumetric(J) } -> std::convertible_to<VolumetricSample>;
  { m.shear_modulus() } -> std::convertible_to<double>;
  validate(m);
};

/// h'(J) and h''(J) [Pa] of a solid W = μ/2 (I_C − 3) + h(J), as numbers or arrays of them.
template <class T> struct DilatationSample {
  T stress;
  T stiffness;
};

/// A solid of the form W = μ/2 (I_C − 3) + h(J), whose P = μ F + h'(J) cof F is cheap enough to be taken for many
/// elements at once.
template <class M>
concept DilatationalMaterial = HyperelasticMaterial<M> && requires(const M& m, const SimdPack& J) {
  { m.dilatation(J) } -> std::same_as<DilatationSample<SimdPack>>;
};

/// Derivative of det F by F: the cofactor matrix.
inline Mat3d cofactor(const Mat3d& F) {
  Mat3d c;
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
inline Mat3d inverse_transposed(const Mat3d& A) {
  const Mat3d c = cofactor(A);
  return c * (1.0 / (c(0, 0) * A(0, 0) + c(1, 0) * A(1, 0) + c(2, 0) * A(2, 0)));
}

/// Second derivative of det F by F, flattened by columns.
inline Mat9d determinant_hessian(const Mat3d& F) {
  Mat9d h = Mat9d::Zero();
  for (int j = 0; j < 3; ++j)
    for (int turn = 1; turn < 3; ++turn)
      for (int i = 0; i < 3; ++i) {
        const int j2 = (j + turn) % 3, next = (i + 1) % 3, last = (i + 2) % 3;
        const double* column = F.data() + 3 * (3 - j - j2);
        h(i + 3 * j, next + 3 * j2) = turn == 1 ? column[last] : -column[last];
        h(i + 3 * j, last + 3 * j2) = turn == 1 ? -column[next] : column[next];
      }
  return h;
}

/// a ⊗ b, both flattened by columns.
inline Mat9d dyad(const Mat3d& a, const Mat3d& b) {
  Mat9d product;
  for (int j = 0; j < 9; ++j)
    for (int i = 0; i < 9; ++i) product.data()[i + 9 * j] = a.data()[i] * b.data()[j];
  return product;
}

/// m I of nine rows.
inline Mat9d isotropic(double m) {
  Mat9d diagonal = Mat9d::Zero();
  for (int i = 0; i < 9; ++i) diagonal.data()[10 * i] = m;
  return diagonal;
}

/// Energy density W(F) [J/m³].
template <HyperelasticMaterial M> double energy_density(const M& m, const Mat3d& F) {
  return m.distortion_energy(F) + m.volumetric(F.determinant()).energy;
}

/// First Piola–Kirchhoff stress P = ∂W/∂F [Pa].
template <HyperelasticMaterial M> Mat3d first_piola(const M& m, const Mat3d& F) {
  return m.distortion_stress(F) + m.volumetric(F.determinant()).stress * cofactor(F);
}

/// Tangent ∂P/∂F [Pa], 9 × 9, flattened by columns.
template <HyperelasticMaterial M> Mat9d elasticity_tangent(const M& m, const Mat3d& F) {
  const VolumetricSample u = m.volumetric(F.determinant());
  const Mat3d c = cofactor(F);
  return m.distortion_tangent(F) + dyad(u.stiffness * c, c) + u.stress * determinant_hessian(F);
}

}  // namespace lumo
