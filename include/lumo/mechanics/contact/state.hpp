#pragma once

#include "lumo/core/types.hpp"
#include "lumo/mechanics/contact/status.hpp"

#include <limits>
#include <vector>

namespace lumo {

/// The pad at one load. Forces act on the indenter, along −direction; all in the finger frame, SI.
struct MechanicalState {
  Status status = Status::non_finite;
  double load_N = 0.0;       ///< prescribed
  bool certified = false;    ///< equilibrium, found so by an independent routine; never of a state that is only held
  double force_N = 0.0;      ///< contact wrench · (−direction)
  double met_force_N = 0.0;  ///< the force when a solver that goes in time stopped the advance, before the hold
  double depth_m = 0.0;      ///< advance since first touch of the exact undeformed profile
  std::vector<Vec3d> displacement;  ///< per mesh node [m]
  /// Contact field per mesh node: > 0 in contact with the indenter, < 0 outside; −infinity on nodes that it cannot
  /// touch. Linear on the sub-facets of the surface (corners and edge middles); the contact set is {φ > 0}.
  std::vector<double> contact_field;
  std::vector<Vec3d> friction_N;    ///< friction on the body per mesh node; empty without
  double friction_push_N = 0.0;     ///< what of it is in force_N
  std::vector<double> pressure_Pa;  ///< indenter pressure per mesh node, per reference area; 0 off the surface
  double contact_area_m2 = 0.0;     ///< A(C; X), deformed
  double reference_area_m2 = 0.0;   ///< A_0(C), undeformed
  double residual_N =
      std::numeric_limits<double>::infinity();  ///< norm of the out-of-balance forces, from an independent routine
  double penetration_m = 0.0;                   ///< largest overlap of surface and indenter
  int iterations = 0;                           ///< Newton steps, or sweeps, spent on this load
};

}  // namespace lumo
