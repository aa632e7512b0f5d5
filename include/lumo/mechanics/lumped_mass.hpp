#pragma once

#include "lumo/mechanics/element.hpp"
#include "lumo/mesh/tet_mesh.hpp"

#include <vector>

namespace lumo {

/// Mass of each node [kg]: a tetrahedron's shared in equal parts among four corners, or with 1/36 for a corner and 4/27 for the middle of an
/// edge among ten, in proportion to the diagonal of the consistent matrix (Hinton, Rock, Zienkiewicz 1976): row sums would be negative.
template <TetElement Element>
std::vector<double> lumped_masses(const TetMesh& mesh, double density_kg_per_m3) {
  std::vector<double> mass(mesh.nodes.size(), 0.0);
  for (const auto& t : mesh.tets) {
    double volume = 0.0;
    for (int q = 0; q < Element::points; ++q) {
      const auto by_xi = shape_gradients<Element::nodes>(Element::point(q));
      Mat3 jacobian = Mat3::Zero();
      for (int a = 0; a < Element::nodes; ++a) jacobian += mesh.nodes[std::size_t(t[std::size_t(a)])] * by_xi.col(a).transpose();
      volume += Element::weight(q) * jacobian.determinant();
    }
    for (int a = 0; a < Element::nodes; ++a)
      mass[std::size_t(t[std::size_t(a)])] += density_kg_per_m3 * volume * (Element::nodes == 4 ? 0.25 : a < 4 ? 1.0 / 36.0 : 4.0 / 27.0);
  }
  return mass;
}

}  // namespace lumo
