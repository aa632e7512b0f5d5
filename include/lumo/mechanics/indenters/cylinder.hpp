#pragma once

#include "lumo/mechanics/indenters/indenter.hpp"

#include <algorithm>
#include <cmath>

namespace lumo {

/// Rigid cylinder about its own z axis, with rounded rims where `edge_radius_m` > 0: a flat punch; lying (see
/// Oriented), a bar.
struct Cylinder {
  double diameter_m = 10e-3;
  double length_m = 20e-3;
  double edge_radius_m = 0.5e-3;

  bool operator==(const Cylinder&) const = default;

  double radius_m() const { return 0.5 * std::hypot(diameter_m, length_m); }
  double contact_radius_m() const { return 0.5 * diameter_m; }
  bool symmetric(int) const { return true; }
  template <class S> S distance(const Vec3<S>& p) const;
  DistanceSample sample(const Vec3d& p) const;
};

inline void validate(const Cylinder& c) {
  require_in_range("cylinder diameter", c.diameter_m * 1e3, 0.1, 1000.0, "mm");
  require_in_range("cylinder length", c.length_m * 1e3, 0.1, 1000.0, "mm");
  require_in_range("edge radius of the cylinder", c.edge_radius_m * 1e3, 0.0,
      0.499 * std::min(c.diameter_m, c.length_m) * 1e3, "mm");
}

// A rectangle in the half-plane through the axis, turned about it.
template <class S> S Cylinder::distance(const Vec3<S>& p) const {
  using std::abs, std::hypot;
  const S beyond = abs(p.z()) - 0.5 * length_m + edge_radius_m,
          aside = hypot(p.x(), p.y()) - 0.5 * diameter_m + edge_radius_m;
  if (beyond > 0.0 && aside > 0.0) return hypot(beyond, aside) - edge_radius_m;
  return (beyond > aside ? beyond : aside) - edge_radius_m;
}

inline DistanceSample Cylinder::sample(const Vec3d& p) const {
  const double rho = std::hypot(p.x(), p.y()), up = p.z() < 0.0 ? -1.0 : 1.0;
  const Vec3d radial = rho > 0.0 ? Vec3d(p.x() / rho, p.y() / rho, 0.0) : Vec3d(Vec3d::UnitX()),
              axial = up * Vec3d::UnitZ();
  const Vec3d around = Vec3d::UnitZ().cross(radial);
  const double beyond = std::abs(p.z()) - 0.5 * length_m + edge_radius_m,
               aside = rho - 0.5 * diameter_m + edge_radius_m;
  if (beyond > 0.0 && aside > 0.0) {
    const double r = std::hypot(beyond, aside);
    const Vec3d n = (beyond * axial + aside * radial) / r, t = (aside * axial - beyond * radial) / r;
    return {r - edge_radius_m, n, t * t.transpose() / r + aside / (r * rho) * around * around.transpose()};
  }
  if (beyond > aside) return {beyond - edge_radius_m, axial, Mat3d::Zero()};
  return {aside - edge_radius_m, radial, around * around.transpose() / (rho > 0.0 ? rho : 0.5 * diameter_m)};
}

static_assert(Indenter<Cylinder>);

}  // namespace lumo
