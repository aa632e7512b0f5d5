#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"

#include <concepts>

namespace lumo {

/// Signed distance to a rigid surface with its first and second derivatives by the point.
struct DistanceSample {
  double distance;  ///< [m], negative inside
  Vec3d gradient;   ///< unit outward normal
  Mat3d hessian;    ///< [1/m]
};

/// A rigid tool, given by its signed distance field in its own frame (origin at its centre); radius_m() is that of a
/// ball about the origin that holds it. distance() is for doubles, or of a deduced scalar. Laws: |gradient| = 1 almost
/// everywhere; distance is 1-Lipschitz; derivatives match finite differences.
template <class T>
concept Indenter = requires(const T& tool, const Vec3d& p) {
  { tool.distance(p) } -> std::convertible_to<double>;
  { tool.sample(p) } -> std::convertible_to<DistanceSample>;
  { tool.radius_m() } -> std::convertible_to<double>;
  validate(tool);
};

/// How strongly a tool is curved where it is meant to touch [m]: its own contact_radius_m(), or the whole tool's
/// radius. Only a scale for first guesses.
template <Indenter Tool> double contact_radius(const Tool& tool) {
  if constexpr (requires { tool.contact_radius_m(); }) return tool.contact_radius_m();
  else return tool.radius_m();
}

/// Is the tool its own mirror image in the plane across `axis` (0: x, 1: y, 2: z) of its frame? One that does not say
/// so by symmetric(axis) is taken not to be.
template <Indenter Tool> bool is_symmetric(const Tool& tool, int axis) {
  if constexpr (requires {
                  { tool.symmetric(axis) } -> std::convertible_to<bool>;
                })
    return tool.symmetric(axis);
  else return false;
}

/// Rigid sphere.
struct Sphere {
  double diameter_m = 10e-3;

  bool operator==(const Sphere&) const = default;

  double radius_m() const { return 0.5 * diameter_m; }
  bool symmetric(int) const { return true; }
  template <class S> S distance(const Vec3<S>& p) const { return p.norm() - radius_m(); }
  DistanceSample sample(const Vec3d& p) const {
    const double r = p.norm();
    const Vec3d n = r > 0.0 ? Vec3d(p / r) : Vec3d(Vec3d::UnitZ());
    return {r - radius_m(), n, (Mat3d::Identity() - n * n.transpose()) / (r > 0.0 ? r : radius_m())};
  }
};

inline constexpr Limits sphere_diameters_mm{0.1, 1000.0};

inline void validate(const Sphere& s) {
  require_in_range("sphere diameter", s.diameter_m * 1e3, sphere_diameters_mm, "mm");
}

static_assert(Indenter<Sphere>);

}  // namespace lumo
