#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mechanics/materials/material.hpp"

namespace lumo {

/// Neo-Hookean solid without a logarithm, W = μ/2 (I_C − 3) + λ'/2 (J − α)² less its value at rest, with λ' = λ + μ and
/// α = 1 + μ/λ'. Rest is free of stress, and μ and λ are the Lamé parameters of small strain. Finite where J ≤ 0: an
/// element that is turned inside out is pushed back. Source: Smith, de Goes, Kim 2018, without their logarithmic term,
/// as Newton 1.8 has it.
struct StableNeoHookean {
  double mu = 106.0e3;       ///< shear modulus [Pa]
  double lambda = 10.494e6;  ///< Lamé's first parameter [Pa]

  double shear_modulus() const { return mu; }

  // λ'/2 (J − α)² − μ²/(2 λ') = λ'/2 (J − 1)² − μ (J − 1): only the first term is stiff.
  template <class S> S distortion_energy(const Mat3<S>& F) const {
    return 0.5 * mu * (F.squaredNorm() - 3.0) - mu * (F.determinant() - 1.0);
  }
  template <class S> Mat3<S> distortion_stress(const Mat3<S>& F) const { return mu * (F - cofactor(F)); }
  template <class S> Mat9<S> distortion_tangent(const Mat3<S>& F) const {
    return mu * (isotropic(S(1.0)) - determinant_hessian(F));
  }
  template <class S> DilatationSample<S> distortion_dilatation(const S& J) const { return {-mu + 0.0 * J, 0.0 * J}; }
  template <class S> VolumetricSample<S> volumetric(const S& J) const {
    const double k = lambda + mu;
    return {0.5 * k * (J - 1.0) * (J - 1.0), k * (J - 1.0), k};
  }
  template <class S> DilatationSample<S> dilatation(const S& J) const {
    const double k = lambda + mu;
    return {k * (J - 1.0) - mu, k + 0.0 * J};
  }
};

inline void validate(const StableNeoHookean& m) {
  require_positive("shear modulus mu", m.mu, "Pa");
  require_in_range("Lame parameter lambda", m.lambda, 0.0, 1e15, "Pa");
}

static_assert(HyperelasticMaterial<StableNeoHookean>);

}  // namespace lumo
