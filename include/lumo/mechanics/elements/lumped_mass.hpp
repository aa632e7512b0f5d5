#pragma once

#include "lumo/mechanics/elements/element_points.hpp"

#include <vector>

namespace lumo {

/// Mass of each node [kg], as each element shares its own.
/// Throws InvalidArgument where the mesh is not of the element's order.
template <TetElement Element> std::vector<double> lumped_masses(const TetMesh& mesh, double density_kg_per_m3) {
  std::vector<double> mass(mesh.nodes.size(), 0.0);
  const ElementPoints<Element> points(mesh);
  for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
    double volume = 0.0;
    for (int q = 0; q < Element::points; ++q) volume += points.weight(e, q);
    for (int a = 0; a < Element::nodes; ++a)
      mass[std::size_t(mesh.tets[e][std::size_t(a)])] += density_kg_per_m3 * volume * Element::mass_share(a);
  }
  return mass;
}

}  // namespace lumo
