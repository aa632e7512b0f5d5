#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mechanics/materials/isochoric.hpp"

#include <Eigen/SVD>
#include <array>

namespace lumo {

/// Ogden solid, W = Σ μ_p/α_p (λ̄₁^α_p + λ̄₂^α_p + λ̄₃^α_p − 3) + κ/4 (J² − 1 − 2 ln J), λ̄ᵢ = J^(−1/3) λᵢ the principal stretches without the
/// volume change. Shear modulus ½ Σ μ_p α_p; +∞ where J ≤ 0. Source: Ogden 1972. A term with μ_p = 0 is none. The default is Dragon Skin
/// of the paper at small strain.
struct Ogden {
  struct Term {
    double mu = 0.0;       ///< [Pa], of the sign of alpha
    double alpha = 2.0;    ///< exponent
  };
  std::array<Term, 3> terms = {{{106.0e3, 2.0}, {}, {}}};
  double bulk = 10.5647e6;   ///< bulk modulus κ [Pa]

  double shear_modulus() const {
    double sum = 0.0;
    for (const Term& t : terms) sum += 0.5 * t.mu * t.alpha;
    return sum;
  }

  template <class Vec3 = Vec3, class Mat3 = Mat3>
  double distortion_energy(In<Mat3> F) const;
  template <class Mat3 = Mat3, class Vec3 = Vec3>
  Mat3 distortion_stress(In<Mat3> F) const;
  template <class Mat3 = Mat3, class Mat9 = Mat9, class Vec3 = Vec3>
  Mat9 distortion_tangent(In<Mat3> F) const;
  VolumetricSample volumetric(double J) const { return convex_volumetric(bulk, J); }

 private:
  // Principal stretches l, with F = U diag(l) Vᵀ, and gᵢ = lᵢ ∂W/∂lᵢ.
  template <class Vec3, class Mat3>
  struct Principal {
    Mat3 U, V;
    Vec3 l, g;
  };
  template <class Vec3 = Vec3, class Mat3 = Mat3>
  Principal<Vec3, Mat3> principal(In<Mat3> F) const;
  // ∂gᵢ/∂ln lⱼ
  template <class Vec3 = Vec3, class Mat3 = Mat3>
  Mat3 log_slopes(In<Vec3> l) const;
  // (gᵢ − gⱼ)/(lᵢ − lⱼ), without cancellation where they meet.
  template <class Vec3 = Vec3>
  double divided_difference(In<Vec3> l, int i, int j) const;
};

template <class = void>
inline void validate(const Ogden& m) {
  for (const Ogden::Term& t : m.terms) {
    require_in_range("Ogden exponent alpha", t.alpha, -20.0, 20.0, "");
    if (t.mu != 0.0) require_positive("Ogden product mu alpha", t.mu * t.alpha, "Pa");
  }
  require_positive("shear modulus", m.shear_modulus(), "Pa");
  require_in_range("bulk modulus", m.bulk, 1e-3, 1e15, "Pa");
}

template <class Vec3, class Mat3>
inline Ogden::Principal<Vec3, Mat3> Ogden::principal(In<Mat3> F) const {
  const Eigen::JacobiSVD<Mat3> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Principal<Vec3, Mat3> p{svd.matrixU(), svd.matrixV(), svd.singularValues(), Vec3::Zero()};
  const double J = p.l.prod();
  for (const Term& t : terms) {
    const Vec3 power = t.mu * std::pow(J, -t.alpha / 3.0) * p.l.array().pow(t.alpha).matrix();
    p.g += power - Vec3::Constant(power.sum() / 3.0);
  }
  return p;
}

template <class Vec3, class Mat3>
inline double Ogden::distortion_energy(In<Mat3> F) const {
  const double J = F.determinant();
  if (!(J > 0.0)) return std::numeric_limits<double>::infinity();
  const Vec3 l = principal(F).l / std::cbrt(J);
  double sum = 0.0;
  for (const Term& t : terms)
    if (t.mu != 0.0) sum += t.mu / t.alpha * (l.array().pow(t.alpha).sum() - 3.0);
  return sum;
}

template <class Mat3, class Vec3>
inline Mat3 Ogden::distortion_stress(In<Mat3> F) const {
  const Principal<Vec3, Mat3> p = principal<Vec3, Mat3>(F);
  return p.U * p.g.cwiseQuotient(p.l).asDiagonal() * p.V.transpose();
}

template <class Vec3, class Mat3>
inline Mat3 Ogden::log_slopes(In<Vec3> l) const {
  Mat3 d = Mat3::Zero();
  for (const Term& t : terms) {
    const Vec3 power = t.mu * t.alpha * std::pow(l.prod(), -t.alpha / 3.0) * l.array().pow(t.alpha).matrix();
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) d(i, j) += (i == j ? power[i] : 0.0) - (power[i] + power[j]) / 3.0 + power.sum() / 9.0;
  }
  return d;
}

template <class Vec3>
inline double Ogden::divided_difference(In<Vec3> l, int i, int j) const {
  const double apart = l[i] - l[j];
  double sum = 0.0;
  for (const Term& t : terms) {
    const double scale = t.mu * std::pow(l.prod(), -t.alpha / 3.0) * std::pow(l[j], t.alpha);
    sum += scale * (apart == 0.0 ? t.alpha / l[j] : std::expm1(t.alpha * std::log1p(apart / l[j])) / apart);
  }
  return sum;
}

// In the principal frame stretching couples the diagonal, and each pair of off-diagonal components is a stretch and a turn.
template <class Mat3, class Mat9, class Vec3>
inline Mat9 Ogden::distortion_tangent(In<Mat3> F) const {
  const Principal<Vec3, Mat3> p = principal<Vec3, Mat3>(F);
  const Mat3 slopes = log_slopes(p.l);
  Mat9 local = Mat9::Zero();
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      local(4 * i, 4 * j) = (slopes(i, j) - (i == j ? p.g[i] : 0.0)) / (p.l[i] * p.l[j]);
      if (i == j) continue;
      const double stretch = divided_difference(p.l, i, j) / p.l[i] - p.g[j] / (p.l[i] * p.l[j]);
      const double turn = (p.g[i] / p.l[i] + p.g[j] / p.l[j]) / (p.l[i] + p.l[j]);
      local(i + 3 * j, i + 3 * j) = 0.5 * (stretch + turn);
      local(i + 3 * j, j + 3 * i) = 0.5 * (stretch - turn);
    }
  Mat9 frame;  // vec(U X Vᵀ) = frame · vec(X)
  for (int j = 0; j < 3; ++j)
    for (int l = 0; l < 3; ++l) frame.template block<3, 3>(3 * j, 3 * l) = p.V(j, l) * p.U;
  return frame * local * frame.transpose();
}

}  // namespace lumo
