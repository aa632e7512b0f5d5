#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/optical_data.hpp"
#include "lumo/optics/fresnel.hpp"

#include <cmath>
#include <concepts>
#include <type_traits>
#include <variant>

namespace lumo {

// The policies themselves (Dielectric, Lambertian, Mirror, Absorber) are data of a body: morphology/optical_data.hpp.
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
