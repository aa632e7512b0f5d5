#pragma once

#include "configuration/configuration.hpp"

#include "lumo/core/units.hpp"
#include "lumo/mechanics/contact/scenario.hpp"
#include "lumo/mesh/size_field.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/study/assumptions.hpp"

/// A request as the library wants it.
namespace lumo::program {

/// One edge length everywhere, where one was asked for.
inline FingerOptions finger_options(const Configuration& o) {
  FingerOptions options = o.pad.finger;
  if (const double mm = o.mechanics.size_mm; mm > 0.0)
    options.mesh.contact_edge = options.mesh.coarsest_edge = 1e-3 * mm;
  return options;
}
inline Focus focus_of(const Configuration& o) {
  Focus focus = o.focus;
  if (const double mm = o.mechanics.size_mm; mm > 0.0) {
    focus.finest = 1e-3 * mm;
    focus.of_tool = 1e3;  // who asked for one edge length gets it
  }
  return focus;
}

inline Body body_of(const Configuration& o) { return finger(o.pad.design(), o.pad.silicone, finger_options(o)); }

/// What other assumptions are compared with.
inline FingerAssumptions usual_assumptions(const Configuration& o) {
  return {o.pad.silicone, finger_options(o), o.mechanics.friction, o.ensemble.tilt};
}

inline Scenario<Sphere> scenario_of(const Touch& o) {
  return {{o.diameter_mm * 1e-3}, o.angle_deg * pi / 180.0, o.y_mm * 1e-3, o.loads_N, o.tilt, o.x_mm * 1e-3};
}

}  // namespace lumo::program
