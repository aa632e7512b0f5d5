#pragma once

#include "lumo/mechanics/indenters/indenter.hpp"

#include <algorithm>
#include <cmath>

namespace lumo {

/// Rigid capsule about its own z axis: all points within half a diameter of a segment. Lying (see Oriented) it is a bar
/// with round ends.
struct Capsule {
  double diameter_m = 10e-3;
  double length_m = 20e-3;  ///< of the segment, without the caps

  bool operator==(const Capsule&) const = default;

  double radius_m() const { return 0.5 * (length_m + diameter_m); }
  double contact_radius_m() const { return 0.5 * diameter_m; }
  bool symmetric(int) const { return true; }
  template <class S> S distance(const Vec3<S>& p) const { return (p - nearest(p)).norm() - contact_radius_m(); }
  DistanceSample sample(const Vec3d& p) const {
    const Vec3d foot = nearest(p), out = p - foot;
    const double r = out.norm();
    const Vec3d n = r > 0.0 ? Vec3d(out / r) : Vec3d(Vec3d::UnitX());
    const bool side = std::abs(p.z()) <= 0.5 * length_m;
    Mat3d across = Mat3d::Identity() - n * n.transpose();
    if (side) across -= Vec3d::UnitZ() * Vec3d::UnitZ().transpose();
    return {r - contact_radius_m(), n, across / (r > 0.0 ? r : contact_radius_m())};
  }

 private:
  template <class S> Vec3<S> nearest(const Vec3<S>& p) const {
    return {S(0.0), S(0.0), std::clamp(p.z(), S(-0.5 * length_m), S(0.5 * length_m))};
  }
};

inline void validate(const Capsule& c) {
  require_in_range("capsule diameter", c.diameter_m * 1e3, 0.1, 1000.0, "mm");
  require_in_range("capsule length", c.length_m * 1e3, 0.0, 1000.0, "mm");
}

static_assert(Indenter<Capsule>);

}  // namespace lumo
