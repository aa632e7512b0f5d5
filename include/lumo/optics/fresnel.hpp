#pragma once

#include "lumo/core/types.hpp"

#include <cmath>
#include <type_traits>

namespace lumo {

/// A smooth interface met under a given angle: share of the power that is reflected, and the cosine behind it.
template <class S> struct FresnelSplit {
  S reflectance;    ///< 1 under total internal reflection
  S cosine_behind;  ///< of the refracted ray to the normal; 0 under total internal reflection
};

/// Unpolarised power reflectance of a smooth dielectric interface, for numbers or dual numbers. `cosine` in [0, 1] in
/// front, `index_ratio` = n in front / n behind. Laws: reciprocity (the same on the way back), R + T = 1,
/// ((n−1)/(n+1))² at normal incidence, R_p = 0 at Brewster's angle. Source: Fresnel 1823; Born & Wolf, Principles of
/// Optics, §1.5.
template <class S> FresnelSplit<S> fresnel(const S& cosine, const std::type_identity_t<S>& index_ratio) {
  using std::sqrt;
  const S sine2 = index_ratio * index_ratio * (1.0 - cosine * cosine);
  if (!(sine2 < 1.0)) return {S(1.0), S(0.0)};
  const S behind = sqrt(1.0 - sine2);
  const S s = (index_ratio * cosine - behind) / (index_ratio * cosine + behind);
  const S p = (cosine - index_ratio * behind) / (cosine + index_ratio * behind);
  return {0.5 * (s * s + p * p), behind};
}

/// Mirror image of the unit direction `d` in the plane with unit normal `n`.
template <class S> Vec3<S> reflect(const Vec3<S>& d, const Vec3<S>& n) { return (d - 2.0 * d.dot(n) * n).normalized(); }

/// Refracted direction of the unit direction `d` by Snell's law; `n` is the unit normal on the side that light comes
/// from.
template <class S> Vec3<S> refract(const Vec3<S>& d, const Vec3<S>& n, const std::type_identity_t<S>& index_ratio,
    const std::type_identity_t<S>& cosine_behind) {
  return (index_ratio * (d - d.dot(n) * n) - cosine_behind * n).normalized();
}

}  // namespace lumo
