#pragma once

#include "lumo/core/lanes.hpp"
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

/// A hyperelastic solid, W(F) = distortion(F) + U(det F). The split lets an element treat the stiff volumetric part U by its mean.
/// Laws: P(I) = 0; W(QF) = W(F) for rotations Q; stress and tangent are the derivatives of the energy; W = +∞ where det F ≤ 0 if the
/// law resists inversion. Stress is the first Piola–Kirchhoff stress [Pa], 3 × 3; tangent is ∂P/∂F, 9 × 9, flattened by columns.
template <class M>
concept HyperelasticMaterial = requires(const M& m, const Mat3& F, double J) {
  { m.distortion_energy(F) } -> std::convertible_to<double>;
  { m.distortion_stress(F) } -> std::convertible_to<Mat3>;
  { m.distortion_tangent(F) } -> std::convertible_to<Mat9>;
  { m.volumetric(J) } -> std::convertible_to<VolumetricSample>;
  { m.shear_modulus() } -> std::convertible_to<double>;
  validate(m);
};

/// h'(J) and h''(J) [Pa] of a solid W = μ/2 (I_C − 3) + h(J), as numbers or arrays of them.
template <class T>
struct DilatationSample {
  T stress;
  T stiffness;
};

/// A solid of the form W = μ/2 (I_C − 3) + h(J), whose P = μ F + h'(J) cof F is cheap enough to be taken for many elements at once.
template <class M>
concept DilatationalMaterial = HyperelasticMaterial<M> && requires(const M& m, const Lanes& J) {
  { m.dilatation(J) } -> std::same_as<DilatationSample<Lanes>>;
};

/// Derivative of det F by F: the cofactor matrix.
template <class Mat3 = Mat3>
inline Mat3 cofactor(In<Mat3> F) {
  Mat3 c;
  c.col(0) = F.col(1).cross(F.col(2));
  c.col(1) = F.col(2).cross(F.col(0));
  c.col(2) = F.col(0).cross(F.col(1));
  return c;
}

/// Second derivative of det F by F, flattened by columns.
template <class Vec3 = Vec3, class Mat3 = Mat3, class Mat9 = Mat9>
inline Mat9 determinant_hessian(In<Mat3> F) {
  const auto cross = [](const Vec3& v) {
    Mat3 m;
    m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
    return m;
  };
  Mat9 h = Mat9::Zero();
  h.template block<3, 3>(0, 3) = -cross(F.col(2));
  h.template block<3, 3>(0, 6) = cross(F.col(1));
  h.template block<3, 3>(3, 0) = cross(F.col(2));
  h.template block<3, 3>(3, 6) = -cross(F.col(0));
  h.template block<3, 3>(6, 0) = -cross(F.col(1));
  h.template block<3, 3>(6, 3) = cross(F.col(0));
  return h;
}

/// Energy density W(F) [J/m³].
template <HyperelasticMaterial M, class Mat3 = Mat3>
double energy_density(const M& m, In<Mat3> F) {
  return m.distortion_energy(F) + m.volumetric(F.determinant()).energy;
}

/// First Piola–Kirchhoff stress P = ∂W/∂F [Pa].
template <HyperelasticMaterial M, class Mat3 = Mat3>
Mat3 first_piola(const M& m, In<Mat3> F) {
  return m.distortion_stress(F) + m.volumetric(F.determinant()).stress * cofactor(F);
}

/// Tangent ∂P/∂F [Pa], 9 × 9, flattened by columns.
template <HyperelasticMaterial M, class Mat3 = Mat3, class Mat9 = Mat9, class Vector9d = Eigen::Matrix<double, 9, 1>>
Mat9 elasticity_tangent(const M& m, In<Mat3> F) {
  const VolumetricSample u = m.volumetric(F.determinant());
  const Mat3 c = cofactor(F);
  const Eigen::Map<const Vector9d> flat(c.data());
  return m.distortion_tangent(F) + u.stiffness * flat * flat.transpose() + u.stress * determinant_hessian(F);
}

}  // namespace lumo
