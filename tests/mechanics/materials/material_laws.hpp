#pragma once

#include "catch.hpp"
#include "lumo/mechanics/materials/material.hpp"
#include "mechanics/dual.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <concepts>
#include <limits>
#include <random>

// One suite for every hyperelastic material: the laws that stand beside the concept.
namespace lumo::test {

inline Mat3d random_deformation(std::mt19937& random, double size) {
  std::uniform_real_distribution<double> u(-size, size);
  Mat3d F;
  do F = Mat3d::Identity() + Mat3d::NullaryExpr([&] { return u(random); });
  while (F.determinant() < 0.2);
  return F;
}

inline Mat3d random_rotation(std::mt19937& random) {
  std::normal_distribution<double> n;
  return Eigen::Quaterniond(n(random), n(random), n(random), n(random)).normalized().toRotationMatrix();
}

template <class M>
concept TakesDuals = requires(const M& m, const Mat3<Dual>& F, const Dual& J) {
  { m.distortion_energy(F) } -> std::same_as<Dual>;
  { m.distortion_stress(F) } -> std::same_as<Mat3<Dual>>;
  { m.volumetric(J) } -> std::same_as<VolumetricSample<Dual>>;
};

/// Stress and tangent at F are what dual numbers find as derivatives, to rounding.
template <TakesDuals M> void check_dual_derivatives(const M& m, const Mat3d& F, double scale) {
  const Mat3d P = first_piola(m, F);
  const Mat9d A = elasticity_tangent(m, F);
  for (int i = 0; i < 9; ++i) {
    const Mat3<Dual> by_i = by_entry(F, i), slope = first_piola(m, by_i);
    CHECK(energy_density(m, by_i).slope == Approx(P.data()[i]).margin(1e-12 * scale).epsilon(1e-11));
    for (int j = 0; j < 9; ++j) CHECK(slope.data()[j].slope == Approx(A(j, i)).margin(1e-12 * A.norm()).epsilon(1e-11));
  }
  const double J = F.determinant();
  const VolumetricSample<Dual> u = m.volumetric(Dual(J, 1.0));
  CHECK(u.energy.slope == Approx(m.volumetric(J).stress).margin(1e-12 * scale).epsilon(1e-11));
  CHECK(u.stress.slope == Approx(m.volumetric(J).stiffness).margin(1e-12 * scale).epsilon(1e-11));
}

/// Small strain: an isotropic tangent whose shear modulus is the one that the material names.
template <HyperelasticMaterial M> void check_small_strain(const M& m) {
  const Mat9d A = elasticity_tangent(m, Mat3d(Mat3d::Identity()));
  const double mu = m.shear_modulus(), lambda = A(0, 4);
  Mat9d hooke = Mat9d::Zero();
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      hooke(4 * i, 4 * j) += lambda;
      hooke(i + 3 * j, i + 3 * j) += mu;
      hooke(i + 3 * j, j + 3 * i) += mu;
    }
  CHECK((A - hooke).norm() < 1e-12 * A.norm());
}

/// Inside out: no bound on the energy, or a finite one with the stress that belongs to it. Never NaN.
template <HyperelasticMaterial M> void check_inversion(const M& m, std::mt19937& random, double scale) {
  for (double squeeze : {-0.3, -1e-3, 0.0}) {
    const Mat3d F = random_rotation(random) * Mat3d(Vec3d(squeeze, 1.1, 0.9).asDiagonal());
    const double w = energy_density(m, F);
    if (w == std::numeric_limits<double>::infinity()) continue;
    REQUIRE(std::isfinite(w));
    const double h = 1e-6;
    const Mat3d P = first_piola(m, F);
    for (int i = 0; i < 9; ++i) {
      Mat3d up = F, down = F;
      up.data()[i] += h;
      down.data()[i] -= h;
      CHECK((energy_density(m, up) - energy_density(m, down)) / (2 * h) == Approx(P.data()[i]).margin(1e-7 * scale));
    }
  }
}

template <HyperelasticMaterial M> void check_material_laws(const M& m) {
  std::mt19937 random(1);
  const double scale = m.shear_modulus() + m.volumetric(1.0).stiffness;
  const Mat3d rest = Mat3d::Identity();
  CHECK(first_piola(m, rest).norm() < 1e-12 * scale);
  CHECK(std::abs(energy_density(m, rest)) < 1e-12 * scale);
  for (int k = 0; k < 20; ++k) {
    const Mat3d F = random_deformation(random, 0.4), Q = random_rotation(random);
    const double w = energy_density(m, F);
    CHECK(w > 0.0);
    CHECK(energy_density(m, Mat3d(Q * F)) == Approx(w).epsilon(1e-12));
    CHECK(energy_density(m, Mat3d(F * Q)) == Approx(w).epsilon(1e-12));  // isotropy
    CHECK((first_piola(m, Mat3d(Q * F)) - Q * first_piola(m, F)).norm() < 1e-10 * scale);
    const double h = 1e-6;
    const Mat3d P = first_piola(m, F);
    const Mat9d A = elasticity_tangent(m, F);
    for (int i = 0; i < 9; ++i) {
      Mat3d up = F, down = F;
      up.data()[i] += h;
      down.data()[i] -= h;
      CHECK((energy_density(m, up) - energy_density(m, down)) / (2 * h) ==
            Approx(P.data()[i]).margin(1e-7 * scale).epsilon(1e-7));
      const Mat3d slope = (first_piola(m, up) - first_piola(m, down)) / (2 * h);
      for (int j = 0; j < 9; ++j) CHECK(slope.data()[j] == Approx(A(j, i)).margin(2e-7 * scale).epsilon(1e-7));
    }
    if constexpr (TakesDuals<M>) check_dual_derivatives(m, F, scale);
    CHECK((A - A.transpose()).norm() < 1e-12 * A.norm());
    CHECK(first_piola(m, Q).norm() < 1e-10 * scale);
  }
  check_small_strain(m);
  check_inversion(m, random, scale);
  for (double J : {0.6, 0.9, 1.0, 1.2, 2.0}) {
    const double h = 1e-6;
    CHECK((m.volumetric(J + h).energy - m.volumetric(J - h).energy) / (2 * h) ==
          Approx(m.volumetric(J).stress).margin(1e-7 * scale));
    CHECK((m.volumetric(J + h).stress - m.volumetric(J - h).stress) / (2 * h) ==
          Approx(m.volumetric(J).stiffness).margin(1e-7 * scale));
  }
}

}  // namespace lumo::test
