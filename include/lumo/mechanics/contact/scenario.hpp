#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/mechanics/indenters/indenter.hpp"

#include <cmath>
#include <vector>

namespace lumo {

/// Plane in which an approach is tilted from the pad normal: across the finger, as the paper's are read, or along it.
enum class TiltPlane { xz, yz };

/// One contact: an indenter, the line on which it comes, and the loads at which it is observed.
/// It moves along direction() on the line through Body::pivot shifted by `x_m` and `y_m`; it does not move sideways.
template <Indenter Tool = Sphere> struct Scenario {
  Tool indenter;
  double angle_rad = 0.0;                                     ///< approach angle from the pad normal
  double y_m = 0.0;                                           ///< place along the finger [m]
  std::vector<double> loads_N = {1.0, 2.0, 5.0, 10.0, 15.0};  ///< increasing
  TiltPlane tilt = TiltPlane::xz;                             ///< in which the angle lies
  double x_m = 0.0;                                           ///< place across the finger [m]

  bool operator==(const Scenario&) const = default;

  /// Unit vector of the advance (paper §III-B; model reading: −(sin α, 0, cos α)).
  Vec3d direction() const {
    const double sideways = -std::sin(angle_rad);
    return {tilt == TiltPlane::xz ? sideways : 0.0, tilt == TiltPlane::yz ? sideways : 0.0, -std::cos(angle_rad)};
  }
};

/// Planes in which a contact is its own mirror image.
template <Indenter Tool> Symmetry symmetry_of(const Scenario<Tool>& s) {
  const bool straight = s.angle_rad == 0.0;
  return {s.x_m == 0.0 && (straight || s.tilt == TiltPlane::yz) && is_symmetric(s.indenter, 0),
      s.y_m == 0.0 && (straight || s.tilt == TiltPlane::xz) && is_symmetric(s.indenter, 1)};
}

/// Mirror image of a contact with a symmetric tool in these planes.
template <Indenter Tool> Scenario<Tool> mirrored(Scenario<Tool> s, Symmetry planes) {
  if (planes.x) s.x_m = 0.0 - s.x_m;
  if (planes.y) s.y_m = 0.0 - s.y_m;
  if (s.tilt == TiltPlane::xz ? planes.x : planes.y) s.angle_rad = 0.0 - s.angle_rad;
  return s;
}

/// What validate() admits, in the units in which people give it.
inline constexpr Limits approach_angles_deg{-80.0, 80.0}, contact_places_mm{-1e4, 1e4}, loads_admitted_N{1e-3, 1e4};

/// Throws InvalidArgument for an angle, place or load out of range, and for loads that do not increase.
template <Indenter Tool> void validate(const Scenario<Tool>& s) {
  validate(s.indenter);
  require_in_range("approach angle", s.angle_rad * 180.0 / pi, approach_angles_deg, "deg");
  require_in_range("contact place x", s.x_m * 1e3, contact_places_mm, "mm");
  require_in_range("contact place y", s.y_m * 1e3, contact_places_mm, "mm");
  if (s.loads_N.empty()) throw InvalidArgument("loads: none given, at least one is needed");
  double last = 0.0;
  for (double load : s.loads_N) {
    require_in_range("load", load, loads_admitted_N, "N");
    if (load <= last) throw InvalidArgument(message("loads must increase: ", load, " N follows ", last, " N"));
    last = load;
  }
}

}  // namespace lumo
