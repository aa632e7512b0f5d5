#pragma once

#include "lumo/core/types.hpp"

#include <cmath>

namespace lumo {

/// A smooth interface met under a given angle: share of the power that is reflected, and the cosine behind it.
struct FresnelSplit {
  double reflectance;    ///< 1 under total internal reflection
  double cosine_behind;  ///< of the refracted ray to the normal; 0 under total internal reflection
};

/// Unpolarised power reflectance of a smooth dielectric interface.
/// `cosine` in [0, 1] in front, `index_ratio` = n in front / n behind. Laws: reciprocity (the same on the way back), R
/// + T = 1,
/// ((n−1)/(n+1))² at normal incidence, R_p = 0 at Brewster's angle. Source: Fresnel 1823; Born & Wolf, Principles of
/// Optics, §1.5.
inline FresnelSplit fresnel(double cosine, double index_ratio) {
  const double sine2 = index_ratio * index_ratio * (1.0 - cosine * cosine);
  if (!(sine2 < 1.0)) return {1.0, 0.0};
  const double behind = std::sqrt(1.0 - sine2);
  const double s = (index_ratio * cosine - behind) / (index_ratio * cosine + behind);
  const double p = (cosine - index_ratio * behind) / (cosine + index_ratio * behind);
  return {0.5 * (s * s + p * p), behind};
}

/// Mirror image of the unit direction `d` in the plane with unit normal `n`.
inline Vec3d reflect(const Vec3d& d, const Vec3d& n) { return (d - 2.0 * d.dot(n) * n).normalized(); }

/// Refracted direction of the unit direction `d` by Snell's law; `n` is the unit normal on the side that light comes
/// from.
inline Vec3d refract(const Vec3d& d, const Vec3d& n, double index_ratio, double cosine_behind) {
  return (index_ratio * (d - d.dot(n) * n) - cosine_behind * n).normalized();
}

}  // namespace lumo
