#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mechanics/materials/material.hpp"

#include <Eigen/SVD>
#include <array>

namespace lumo {

/// Ogden solid, W = Σ μ_p/α_p (λ̄₁^α_p + λ̄₂^α_p + λ̄₃^α_p − 3) + κ/4 (J² − 1 − 2 ln J), λ̄ᵢ = J^(−1/3) λᵢ the
/// principal stretches without the volume change. Shear modulus ½ Σ μ_p α_p; +∞ where J ≤ 0. Source: Ogden 1972. A term
/// with μ_p = 0 is none. Distortion is for doubles: principal stretches come from an iteration. The default is Dragon
/// Skin of the paper at small strain.
struct Ogden {
  struct Term {
    double mu = 0.0;     ///< [Pa], of the sign of alpha
    double alpha = 2.0;  ///< exponent
  };
  std::array<Term, 3> terms = {{{106.0e3, 2.0}, {}, {}}};
  double bulk = 10.5647e6;  ///< bulk modulus κ [Pa]

  double shear_modulus() const {
    double sum = 0.0;
    for (const Term& t : terms) sum += 0.5 * t.mu * t.alpha;
    return sum;
  }

  double distortion_energy(const Mat3d& F) const {
    const double J = F.determinant();
    if (!(J > 0.0)) return std::numeric_limits<double>::infinity();
    const Vec3d l = principal(F).l / std::cbrt(J);
    double sum = 0.0;
    for (const Term& t : terms)
      if (t.mu != 0.0) sum += t.mu / t.alpha * (l.array().pow(t.alpha).sum() - 3.0);
    return sum;
  }
  Mat3d distortion_stress(const Mat3d& F) const {
    const Principal p = principal(F);
    return p.U * p.g.cwiseQuotient(p.l).asDiagonal() * p.V.transpose();
  }
  // In the principal frame stretching couples the diagonal, and each pair of off-diagonal components is a stretch and a
  // turn.
  Mat9d distortion_tangent(const Mat3d& F) const {
    const Principal p = principal(F);
    const Mat3d slopes = log_slopes(p.l);
    Mat9d local = Mat9d::Zero();
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        local(4 * i, 4 * j) = (slopes(i, j) - (i == j ? p.g[i] : 0.0)) / (p.l[i] * p.l[j]);
        if (i == j) continue;
        const double stretch = divided_difference(p.l, i, j) / p.l[i] - p.g[j] / (p.l[i] * p.l[j]);
        const double turn = (p.g[i] / p.l[i] + p.g[j] / p.l[j]) / (p.l[i] + p.l[j]);
        local(i + 3 * j, i + 3 * j) = 0.5 * (stretch + turn);
        local(i + 3 * j, j + 3 * i) = 0.5 * (stretch - turn);
      }
    Mat9d frame;  // vec(U X Vᵀ) = frame · vec(X)
    for (int j = 0; j < 3; ++j)
      for (int l = 0; l < 3; ++l) frame.block<3, 3>(3 * j, 3 * l) = p.V(j, l) * p.U;
    return frame * local * frame.transpose();
  }
  template <class S> VolumetricSample<S> volumetric(const S& J) const { return convex_volumetric(bulk, J); }

 private:
  // Principal stretches l, with F = U diag(l) Vᵀ, and gᵢ = lᵢ ∂W/∂lᵢ.
  struct Principal {
    Mat3d U, V;
    Vec3d l, g;
  };
  Principal principal(const Mat3d& F) const {
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Principal p{svd.matrixU(), svd.matrixV(), svd.singularValues(), Vec3d::Zero()};
    const double J = p.l.prod();
    for (const Term& t : terms) {
      const Vec3d power = t.mu * std::pow(J, -t.alpha / 3.0) * p.l.array().pow(t.alpha).matrix();
      p.g += power - Vec3d::Constant(power.sum() / 3.0);
    }
    return p;
  }
  // ∂gᵢ/∂ln lⱼ
  Mat3d log_slopes(const Vec3d& l) const {
    Mat3d d = Mat3d::Zero();
    for (const Term& t : terms) {
      const Vec3d power = t.mu * t.alpha * std::pow(l.prod(), -t.alpha / 3.0) * l.array().pow(t.alpha).matrix();
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
          d(i, j) += (i == j ? power[i] : 0.0) - (power[i] + power[j]) / 3.0 + power.sum() / 9.0;
    }
    return d;
  }
  // (gᵢ − gⱼ)/(lᵢ − lⱼ), without cancellation where they meet.
  double divided_difference(const Vec3d& l, int i, int j) const {
    const double apart = l[i] - l[j];
    double sum = 0.0;
    for (const Term& t : terms) {
      const double scale = t.mu * std::pow(l.prod(), -t.alpha / 3.0) * std::pow(l[j], t.alpha);
      sum += scale * (apart == 0.0 ? t.alpha / l[j] : std::expm1(t.alpha * std::log1p(apart / l[j])) / apart);
    }
    return sum;
  }
};

inline void validate(const Ogden& m) {
  for (const Ogden::Term& t : m.terms) {
    require_in_range("Ogden exponent alpha", t.alpha, -20.0, 20.0, "");
    if (t.mu != 0.0) require_positive("Ogden product mu alpha", t.mu * t.alpha, "Pa");
  }
  require_positive("shear modulus", m.shear_modulus(), "Pa");
  require_in_range("bulk modulus", m.bulk, 1e-3, 1e15, "Pa");
}

static_assert(HyperelasticMaterial<Ogden>);

}  // namespace lumo
