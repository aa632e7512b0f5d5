#pragma once

#include "lumo/mechanics/element_points.hpp"

#include <vector>

namespace lumo {

/// Mass of each node [kg]: a tetrahedron's shared in equal parts among four corners, or with 1/36 for a corner and 4/27 for the middle of an
/// edge among ten, in proportion to the diagonal of the consistent matrix (Hinton, Rock, Zienkiewicz 1976): row sums would be negative.
/// Throws InvalidArgument where the mesh is not of the element's order.
template <TetElement Element>
std::vector<double> lumped_masses(const TetMesh& mesh, double density_kg_per_m3) {
  std::vector<double> mass(mesh.nodes.size(), 0.0);
  const ElementPoints<Element> points(mesh);
  for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
    double volume = 0.0;
    for (int q = 0; q < Element::points; ++q) volume += points.weight(e, q);
    for (int a = 0; a < Element::nodes; ++a)
      mass[std::size_t(mesh.tets[e][std::size_t(a)])] += density_kg_per_m3 * volume * (Element::nodes == 4 ? 0.25 : a < 4 ? 1.0 / 36.0 : 4.0 / 27.0);
  }
  return mass;
}

}  // namespace lumo
