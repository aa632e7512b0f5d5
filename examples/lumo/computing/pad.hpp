#pragma once

#include "computing/request.hpp"

#include "lumo/core/units.hpp"
#include "lumo/mechanics/contact/scenario.hpp"
#include "lumo/mesh/size_field.hpp"
#include "lumo/morphology/finger.hpp"

/// A request as the library wants it.
namespace lumo::program {

inline FingerOptions finger_options(const Mechanics& m) {
  FingerOptions options;
  if (m.size_mm > 0.0) options.mesh.contact_edge = options.mesh.coarsest_edge = 1e-3 * m.size_mm;
  return options;
}

/// One size everywhere, where one was asked for.
inline Focus focus_of(const Mechanics& m) {
  Focus focus;
  if (m.size_mm > 0.0) focus.finest = 1e-3 * m.size_mm;
  return focus;
}

inline Body body_of(const Pad& pad, const Mechanics& m) {
  return finger(FingerDesign::from(pad.theta_mm), silicone(pad.material), finger_options(m));
}

inline Scenario<Sphere> scenario_of(const Touch& o) {
  return {{o.diameter_mm * 1e-3}, o.angle_deg * pi / 180.0, o.y_mm * 1e-3, o.loads_N};
}

}  // namespace lumo::program
