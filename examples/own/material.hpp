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

  template <class S> S distortion_energy(const lumo::Mat3<S>& F) const {
    using std::expm1;
    if (!(F.determinant() > 0.0)) return std::numeric_limits<double>::infinity();  // it resists inversion
    return 0.5 * mu / b * expm1(b * invariant(F));
  }
  template <class S> lumo::Mat3<S> distortion_stress(const lumo::Mat3<S>& F) const { return mu * rise(F) * slope(F); }
  template <class S> lumo::Mat9<S> distortion_tangent(const lumo::Mat3<S>& F) const {
    const S J = F.determinant();
    const lumo::Mat3<S> c = lumo::cofactor(F), s = slope(F);
    const lumo::Mat9<S> bend = lumo::dyad(c, c) / (J * J) - lumo::determinant_hessian(F) / J;
    return mu * rise(F) * (lumo::isotropic(S(1.0)) + bend + lumo::dyad(2.0 * b * s, s));
  }
  template <class S> lumo::VolumetricSample<S> volumetric(const S& J) const {
    using std::log;
    if (!(J > 0.0)) return {std::numeric_limits<double>::infinity(), 0.0, 0.0};
    const S l = log(J);
    return {0.5 * lambda * l * l, lambda * l / J, lambda * (1.0 - l) / (J * J)};
  }

 private:
  template <class S> static S invariant(const lumo::Mat3<S>& F) {  // i
    using std::log;
    return F.squaredNorm() - 3.0 - 2.0 * log(F.determinant());
  }
  template <class S> S rise(const lumo::Mat3<S>& F) const {
    using std::exp;
    return exp(b * invariant(F));
  }
  /// Half of ∂i/∂F.
  template <class S> static lumo::Mat3<S> slope(const lumo::Mat3<S>& F) {
    return F - lumo::cofactor(F) / F.determinant();
  }
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
