#pragma once

#include "lumo/core/types.hpp"
#include "lumo/mesh/contact_slope.hpp"

#include <array>
#include <cstddef>
#include <limits>
#include <string_view>
#include <vector>

namespace lumo {

/// How a solve ended. Only `converged` is scored (and `held` where a problem says so).
enum class Status {
  converged,              ///< equilibrium, residual certified, stable
  held,                   ///< a dynamic solver ran its sweeps; no statement about equilibrium
  max_iterations,         ///< residual still too large after the allowed iterations
  line_search,            ///< even the shortest step leaves an element less than a fifth of its volume by the solver's
                          ///< prediction: it is crushed, or flattened
  inverted,               ///< an element is turned inside out
  not_positive_definite,  ///< equilibrium, but unstable: the body would buckle away from it
  non_finite,             ///< NaN or infinity in the state or in a factor
  time_limit,             ///< stopped by the caller's time limit
  unresolved              ///< equilibria, but the mesh is too coarse for a contact: its area is not known
};

/// Whether objectives may rest on a state that ended so. `accept_held`: the problem says that it is about held states
/// (the paper's mechanics).
constexpr bool is_scored(Status s, bool accept_held = false) {
  return s == Status::converged || (accept_held && s == Status::held);
}

/// Whether the way to an equilibrium was lost: other strides, or another mesh, may find it.
constexpr bool is_lost(Status s) {
  return s == Status::not_positive_definite || s == Status::inverted || s == Status::line_search ||
         s == Status::max_iterations;
}

constexpr std::string_view to_string(Status s) {
  constexpr std::array<std::string_view, 9> names{"converged", "held", "max_iterations", "line_search", "inverted",
      "not_positive_definite", "non_finite", "time_limit", "unresolved"};
  return names[std::size_t(s)];
}

/// The tool's action about one point of the surface.
struct TractionPoint {
  Vec3d reference_m, place_m;  ///< undeformed and deformed
  double area_m2 = 0.0;        ///< of the deformed surface that it stands for
  double pressure_Pa = 0.0;
  Vec3d traction_Pa;  ///< on the body, per deformed area, with friction
};

/// One of the separate places where a tool touches, and how well the mesh resolves it.
struct ContactSpot {
  Vec3d reference_m = Vec3d::Zero();  ///< its place on the undeformed surface, the mean by force
  double force_N = 0.0;               ///< sum of the normal forces
  double area_m2 = 0.0;               ///< deformed
  double rim_m = 0.0;                 ///< length of its edge, deformed
  /// Between neighbouring nodes of the undeformed surface along its edge; where it has none, between those that bear.
  double edge_m = 0.0;
  double force_outside_N = 0.0;  ///< what of force_N acts outside the contact set: pressure and gap disagree there

  /// Of the disc with as much area for its edge; the width of a strip.
  double radius_m() const { return rim_m > 0.0 ? 2.0 * area_m2 / rim_m : 0.0; }
};

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
  /// How the surface leans away from the indenter, and from the carrier, per mesh node; may be empty.
  std::vector<ContactSlope> tool_slopes, carrier_slopes;
  /// The contact set by records (record_margin): is each sub-triangle of the touchable surface, in its order, in it?
  /// Empty: it is {φ > 0}.
  std::vector<char> recorded;
  std::vector<Vec3d> friction_N;    ///< friction on the body per mesh node; empty without
  double friction_push_N = 0.0;     ///< what of it is in force_N
  std::vector<double> pressure_Pa;  ///< indenter pressure per mesh node, per reference area; 0 off the surface
  /// Cauchy traction of the tool on the body, per deformed area, where it presses or rubs. The sum of traction · area
  /// is the force on the body: force_N along the direction of approach, and what lies across it.
  std::vector<TractionPoint> tractions;
  /// The same per mesh node, linear on the sub-facets of the deformed surface, on which it integrates to the same
  /// force.
  std::vector<Vec3d> traction_Pa;
  std::vector<ContactSpot> spots;  ///< of contact with the indenter; empty without
  double contact_area_m2 = 0.0;    ///< A(C; X), deformed
  double reference_area_m2 = 0.0;  ///< A_0(C), undeformed
  /// Norm of the out-of-balance forces, from an independent routine
  double residual_N = std::numeric_limits<double>::infinity();
  double energy_error = 0.0;   ///< how far the mesh is from resolving the stresses, see EnergyError
  double penetration_m = 0.0;  ///< largest overlap of surface and indenter
  int iterations = 0;          ///< Newton steps, or sweeps, spent on this load
};

}  // namespace lumo
