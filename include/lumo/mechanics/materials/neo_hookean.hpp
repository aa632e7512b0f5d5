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

  template <class S> S distortion_energy(const Mat3<S>& F) const {
    using std::log;
    const S J = F.determinant();
    if (!(J > 0.0)) return std::numeric_limits<double>::infinity();
    return 0.5 * mu * (F.squaredNorm() - 3.0) - mu * log(J);
  }
  template <class S> Mat3<S> distortion_stress(const Mat3<S>& F) const {
    return mu * F - (mu / F.determinant()) * cofactor(F);
  }
  template <class S> Mat9<S> distortion_tangent(const Mat3<S>& F) const {
    const S J = F.determinant();
    const Mat3<S> c = cofactor(F);
    return isotropic(S(mu)) + dyad((mu / (J * J)) * c, c) - (mu / J) * determinant_hessian(F);
  }
  /// Of μ/2 (I_C − 3) − μ ln J.
  template <class S> DilatationSample<S> distortion_dilatation(const S& J) const { return {-mu / J, mu / (J * J)}; }
  template <class S> VolumetricSample<S> volumetric(const S& J) const {
    using std::log;
    if (!(J > 0.0)) return {std::numeric_limits<double>::infinity(), 0.0, 0.0};
    const S l = log(J);
    return {0.5 * lambda * l * l, lambda * l / J, lambda * (1.0 - l) / (J * J)};
  }
  template <class S> DilatationSample<S> dilatation(const S& J) const {
    using std::log;
    const S l = log(J);
    return {(lambda * l - mu) / J, (lambda * (1.0 - l) + mu) / (J * J)};
  }
};

inline void validate(const NeoHookean& m) {
  require_positive("shear modulus mu", m.mu, "Pa");
  require_in_range("Lame parameter lambda", m.lambda, 0.0, 1e15, "Pa");
}

static_assert(HyperelasticMaterial<NeoHookean>);

}  // namespace lumo
