#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/silicone.hpp"

#include <cmath>
#include <concepts>
#include <type_traits>
#include <variant>

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

// The policies themselves (Dielectric, Lambertian, Mirror, Absorber) are data of a body: morphology/silicone.hpp.
// This header has their reflection. Dielectric lets light through; the tracer splits it by fresnel().

/// Reflectance of an opaque surface [–], in [0, 1]. The rest is booked as absorbed there.
constexpr double reflectance(const Lambertian& s) { return s.albedo; }
constexpr double reflectance(const Mirror& s) { return s.reflectance; }
constexpr double reflectance(const Absorber&) { return 0.0; }

namespace detail {

/// Direction about the axis `n` with density cos θ/π from two numbers in (0, 1); the azimuth starts at `t1`.
inline Vec3d cosine_direction(const Vec3d& t1, const Vec3d& t2, const Vec3d& n, double u, double azimuth) {
  const double sine = std::sqrt(u);
  return (sine * std::cos(azimuth) * t1 + sine * std::sin(azimuth) * t2 + std::sqrt(1.0 - u) * n).normalized();
}

}  // namespace detail

/// Direction in which opaque surfaces send light: a unit vector for the incoming unit direction `d`, unit normal `n` on
/// the lit side, and two numbers in (0, 1). `mirror` (±1, ±1, 1) is the mirror image that the path belongs to: image
/// paths take image directions.
inline Vec3d reflected(const Lambertian&, const Vec3d&, const Vec3d& n, double u, double v, const Vec3d& mirror) {
  const Vec3d m = mirror.cwiseProduct(n);
  Vec3d t1, t2;
  tangents(m, t1, t2);
  return mirror.cwiseProduct(detail::cosine_direction(t1, t2, m, u, 2.0 * pi * v));
}
inline Vec3d reflected(const Mirror&, const Vec3d& d, const Vec3d& n, double, double, const Vec3d&) {
  return reflect(d, n);
}
inline Vec3d reflected(const Absorber&, const Vec3d&, const Vec3d& n, double, double, const Vec3d&) { return n; }

/// An opaque surface. Law: 0 ≤ reflectance ≤ 1, and reflected() stays on the lit side.
template <class S>
concept OpaqueSurface = requires(const S& s, const Vec3d& v) {
  { reflectance(s) } -> std::convertible_to<double>;
  { reflected(s, v, v, 0.5, 0.5, v) } -> std::convertible_to<Vec3d>;
};

static_assert(OpaqueSurface<Lambertian> && OpaqueSurface<Mirror> && OpaqueSurface<Absorber>);
static_assert(!OpaqueSurface<Dielectric>);

inline bool is_dielectric(const SurfaceOptics& s) { return std::holds_alternative<Dielectric>(s); }

/// Throws InvalidArgument for a reflectance outside [0, 1].
inline void validate(const SurfaceOptics& optics) {
  std::visit(
      [](const auto& s) {
        if constexpr (OpaqueSurface<std::decay_t<decltype(s)>>)
          require_in_range("surface reflectance", reflectance(s), 0.0, 1.0, "");
      },
      optics);
}

}  // namespace lumo
