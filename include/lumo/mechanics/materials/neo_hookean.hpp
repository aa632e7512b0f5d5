#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mechanics/materials/material.hpp"

#include <cmath>
#include <limits>

namespace lumo {

/// Compressible Neo-Hookean solid, W = μ/2 (I_C − 3) − μ ln J + λ/2 (ln J)². Source: Bonet and Wood 2008, §6.4.3.
struct NeoHookean {
  double mu = 106.0e3;       ///< shear modulus [Pa]
  double lambda = 10.494e6;  ///< Lamé's first parameter [Pa]

  double shear_modulus() const { return mu; }

  double distortion_energy(const Mat3d& F) const {
    const double J = F.determinant();
    if (!(J > 0.0)) return std::numeric_limits<double>::infinity();
    return 0.5 * mu * (F.squaredNorm() - 3.0) - mu * std::log(J);
  }
  Mat3d distortion_stress(const Mat3d& F) const { return mu * F - (mu / F.determinant()) * cofactor(F); }
  Mat9d distortion_tangent(const Mat3d& F) const {
    const double J = F.determinant();
    const Mat3d c = cofactor(F);
    return isotropic(mu) + dyad((mu / (J * J)) * c, c) - (mu / J) * determinant_hessian(F);
  }
  VolumetricSample volumetric(double J) const {
    if (!(J > 0.0)) return {std::numeric_limits<double>::infinity(), 0.0, 0.0};
    const double l = std::log(J);
    return {0.5 * lambda * l * l, lambda * l / J, lambda * (1.0 - l) / (J * J)};
  }
  template <class T> DilatationSample<T> dilatation(const T& J) const {
    using std::log;
    const T l = log(J);
    return {(lambda * l - mu) / J, (lambda * (1.0 - l) + mu) / (J * J)};
  }
};

inline void validate(const NeoHookean& m) {
  require_positive("shear modulus mu", m.mu, "Pa");
  require_in_range("Lame parameter lambda", m.lambda, 0.0, 1e15, "Pa");
}

}  // namespace lumo
