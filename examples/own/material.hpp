#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mechanics/materials/material.hpp"

#include <cmath>
#include <limits>

namespace own {

//! [material]
/// A solid that stiffens as it is stretched, like skin:
/// W = μ/(2b) (exp(b i) − 1) + λ/2 (ln J)², i = I_C − 3 − 2 ln J.
/// Source: Demiray 1972, here with a term that leaves the compressible solid without stress at rest.
struct Demiray {
  double mu = 106.0e3;       ///< shear modulus [Pa]
  double b = 1.0;            ///< [–]: by how much it stiffens
  double lambda = 10.494e6;  ///< Lamé's first parameter [Pa]

  double shear_modulus() const { return mu; }

  double distortion_energy(const lumo::Mat3d& F) const {
    const double J = F.determinant();
    if (!(J > 0.0)) return std::numeric_limits<double>::infinity();  // it resists inversion
    return 0.5 * mu / b * std::expm1(b * (F.squaredNorm() - 3.0 - 2.0 * std::log(J)));
  }
  lumo::Mat3d distortion_stress(const lumo::Mat3d& F) const { return mu * rise(F) * slope(F); }
  lumo::Mat9d distortion_tangent(const lumo::Mat3d& F) const {
    const double J = F.determinant();
    const lumo::Mat3d c = lumo::cofactor(F), s = slope(F);
    // Flattened by columns.
    const Eigen::Map<const Eigen::Matrix<double, 9, 1>> cofactors(c.data()), slopes(s.data());
    const lumo::Mat9d bend = cofactors * cofactors.transpose() / (J * J) - lumo::determinant_hessian(F) / J;
    return mu * rise(F) * (lumo::Mat9d::Identity() + bend + 2.0 * b * slopes * slopes.transpose());
  }
  lumo::VolumetricSample volumetric(double J) const {
    if (!(J > 0.0)) return {std::numeric_limits<double>::infinity(), 0.0, 0.0};
    const double l = std::log(J);
    return {0.5 * lambda * l * l, lambda * l / J, lambda * (1.0 - l) / (J * J)};
  }

 private:
  double rise(const lumo::Mat3d& F) const {
    return std::exp(b * (F.squaredNorm() - 3.0 - 2.0 * std::log(F.determinant())));
  }
  /// Half of ∂i/∂F.
  static lumo::Mat3d slope(const lumo::Mat3d& F) { return F - lumo::cofactor(F) / F.determinant(); }
};

/// Throws lumo::InvalidArgument.
inline void validate(const Demiray& m) {
  lumo::require_positive("shear modulus mu", m.mu, "Pa");
  lumo::require_in_range("stiffening b", m.b, 1e-6, 100.0, "");
  lumo::require_in_range("Lame parameter lambda", m.lambda, 0.0, 1e15, "Pa");
}

static_assert(lumo::HyperelasticMaterial<Demiray>);
//! [material]

}  // namespace own
