#pragma once

#include "lumo/mechanics/contact/first_touch.hpp"
#include "lumo/mesh/body_mesh.hpp"
#include "lumo/mesh/size_field.hpp"

namespace lumo {

/// A mesh of the body that is fine where the scenarios' indenters first touch it, and in the mirror images of those
/// places. `coarse` is any mesh of the body. Throws InvalidArgument when an indenter passes by, MeshError when the body
/// cannot be meshed.
template <Mesher M, Indenter Tool> TetMesh mesh_for_contact(const Body& body, const TetMesh& coarse,
    const std::vector<Scenario<Tool>>& scenarios, const M& mesher, const Focus& focus = {}, int order = 2) {
  std::vector<Vec3d> touches;
  for (const Scenario<Tool>& s : scenarios) touches.push_back(first_touch(body, coarse, s).point);
  return mesh_body(focused(body, touches, focus), mesher, order);
}

}  // namespace lumo
