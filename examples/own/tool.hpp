#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mechanics/indenters/indenter.hpp"

#include <cmath>

namespace own {

//! [tool]
/// A ring that lies flat, about its own z axis: an O-ring, or the rim of a cup.
struct Ring {
  double diameter_m = 10e-3;  ///< of the circle in the middle of its cord
  double cord_m = 3e-3;       ///< the cord's diameter

  bool operator==(const Ring&) const = default;

  double radius_m() const { return 0.5 * (diameter_m + cord_m); }
  double contact_radius_m() const { return 0.5 * cord_m; }
  bool symmetric(int) const { return true; }
  double distance(const lumo::Vec3d& p) const {
    return std::hypot(std::hypot(p.x(), p.y()) - 0.5 * diameter_m, p.z()) - 0.5 * cord_m;
  }
  lumo::DistanceSample sample(const lumo::Vec3d& p) const {
    const double from_axis = std::hypot(p.x(), p.y());
    const lumo::Vec3d out = from_axis > 0.0 ? lumo::Vec3d(p.x() / from_axis, p.y() / from_axis, 0.0)
                                            : lumo::Vec3d(lumo::Vec3d::UnitX()),
                      along(-out.y(), out.x(), 0.0);
    const double side = from_axis - 0.5 * diameter_m, from_cord = std::hypot(side, p.z());
    const lumo::Vec3d n = from_cord > 0.0 ? lumo::Vec3d((side * out + p.z() * lumo::Vec3d::UnitZ()) / from_cord) : out,
                      turn = n.cross(along);
    // The distance bends around the cord, and around the axis.
    const lumo::Mat3d bend = turn * turn.transpose() / (from_cord > 0.0 ? from_cord : 0.5 * cord_m) +
                             n.dot(out) / (from_axis > 0.0 ? from_axis : 0.5 * diameter_m) * along * along.transpose();
    return {from_cord - 0.5 * cord_m, n, bend};
  }
};

inline void validate(const Ring& r) {
  lumo::require_in_range("a ring's cord", 1e3 * r.cord_m, 0.1, 1000.0, "mm");
  lumo::require_in_range("a ring's diameter", 1e3 * r.diameter_m, 1e3 * r.cord_m, 1000.0, "mm");
}

static_assert(lumo::Indenter<Ring>);
//! [tool]

}  // namespace own
