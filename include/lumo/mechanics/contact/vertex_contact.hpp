#pragma once

#include "lumo/mechanics/contact/contact_handler.hpp"

namespace lumo {

/// Penalty at the mesh's nodes with Coulomb friction, as Newton 1.8 has it: faces may overlap the indenter between
/// their nodes. A solver that goes in time steps takes each node's tangent plane of the indenter at the step's start
/// (`plane_frozen`). Newton's stiffness k_e [N/m] belongs to a vertex, whatever its share of the surface: that is
/// stiffness_N_per_m3 · area_per_vertex_m2.
struct VertexContact {
  static constexpr ContactPoints points = ContactPoints::vertices;
  static constexpr bool plane_frozen = true;
  double stiffness_N_per_m3 = 1e11;
  double friction = 0.5;            ///< Coulomb's coefficient
  double area_per_vertex_m2 = 0.0;  ///< the same for all; 0: each vertex has its share of the surface

  template <class S> ContactResponse<S> respond(const S& gap) const { return penalty(stiffness_N_per_m3, gap); }
};

inline void validate(const VertexContact& c) {
  require_in_range("contact stiffness", c.stiffness_N_per_m3, 1e6, 1e15, "N/m3");
  require_in_range("friction coefficient", c.friction, 0.0, 10.0, "");
  require_in_range("contact area per vertex", c.area_per_vertex_m2 * 1e6, 0.0, 1e6, "mm2");
}

static_assert(ContactHandler<VertexContact>);

}  // namespace lumo
