#pragma once

#include "lumo/mechanics/contact/first_touch.hpp"
#include "lumo/mechanics/contact/scenario.hpp"
#include "lumo/mechanics/contact/state.hpp"
#include "lumo/mechanics/indenters/indenter.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "lumo/morphology/body.hpp"

namespace lumo::micro {

/// The pad that mechanics and optics are timed on: θ = 5, 10, 10, 6, 3 mm of Dragon Skin under a sphere of 10 mm, in
/// equilibrium at 5 N, on a coarse mesh that is refined at the contact.
struct PressedPad {
  Body body;
  TetMesh mesh;  ///< quadratic, the whole body
  Scenario<Sphere> ball;
  Touch touch;
  MechanicalState state;
};

/// Made at the first call, which takes a few seconds.
const PressedPad& pressed_pad();

}  // namespace lumo::micro
