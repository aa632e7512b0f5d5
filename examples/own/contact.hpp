#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mechanics/contact/contact_handler.hpp"

namespace own {

//! [contact]
/// A tool with a thin soft skin: its pressure rises more steeply the further it is pressed in,
/// p = k o (1 + o/h) at the overlap o.
struct SoftSkin {
  double stiffness_N_per_m3 = 2e10;  ///< k, at first touch; also the scale of lumo's friction springs
  double thickness_m = 50e-6;        ///< h
  double friction = 0.0;             ///< Coulomb's coefficient; may be left out

  template <class S> lumo::ContactResponse<S> respond(const S& gap) const {
    if (gap >= 0.0) return {0.0, 0.0, 0.0};
    const double k = stiffness_N_per_m3, h = thickness_m;
    const S o = -gap, energy = k * o * o * (0.5 + o / (3.0 * h)), pressure = k * o * (1.0 + o / h);
    return {energy, pressure, k * (1.0 + 2.0 * o / h)};
  }
};

inline void validate(const SoftSkin& c) {
  lumo::require_in_range("contact stiffness", c.stiffness_N_per_m3, 1e6, 1e15, "N/m3");
  lumo::require_positive("thickness of the skin", c.thickness_m, "m");
  lumo::require_in_range("friction coefficient", c.friction, 0.0, 10.0, "");
}

static_assert(lumo::ContactHandler<SoftSkin>);
//! [contact]

}  // namespace own
