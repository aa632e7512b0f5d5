#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mechanics/elements/element.hpp"
#include "lumo/mechanics/materials/material.hpp"
#include "lumo/mesh/tet_mesh.hpp"

#include <Eigen/LU>
#include <vector>

namespace lumo {

/// Gradients of the shape functions by the place at rest, and volumes, at the quadrature points of all tetrahedra of a
/// mesh.
template <TetElement Element> class ElementPoints {
 public:
  using Gradients = Eigen::Matrix<double, 3, Element::nodes>;

  /// Throws InvalidArgument where the mesh is not of the element's order: nodes in the middle of edges would belong to
  /// no element, or be missing.
  explicit ElementPoints(const TetMesh& mesh) {
    if (mesh.order != Element::order)
      throw InvalidArgument(message(
          "elements are of order ", Element::order, ", the mesh is of order ", mesh.order, ", must be the same"));
    gradients_.reserve(mesh.tets.size() * Element::points);
    weights_.reserve(mesh.tets.size() * Element::points);
    for (const auto& t : mesh.tets)
      for (int q = 0; q < Element::points; ++q) {
        const Gradients by_xi = Element::gradients(q);
        Mat3d jacobian = Mat3d::Zero();
        for (int a = 0; a < Element::nodes; ++a)
          jacobian += mesh.nodes[std::size_t(t[std::size_t(a)])] * Vec3d(by_xi.col(a)).transpose();
        const Mat3d to_x = inverse_transposed(jacobian);
        Gradients& by_x = gradients_.emplace_back();
        for (int a = 0; a < Element::nodes; ++a)
          for (int i = 0; i < 3; ++i)
            by_x(i, a) = to_x(i, 0) * by_xi(0, a) + to_x(i, 1) * by_xi(1, a) + to_x(i, 2) * by_xi(2, a);
        weights_.push_back(Element::weight(q) * jacobian.determinant());
      }
  }

  /// [1/m], of tetrahedron e at point q.
  const Gradients& gradient(std::size_t e, int q) const {
    return gradients_[e * std::size_t(Element::points) + std::size_t(q)];
  }
  /// Volume that the point stands for [m³].
  double weight(std::size_t e, int q) const { return weights_[e * std::size_t(Element::points) + std::size_t(q)]; }

 private:
  std::vector<Gradients, Eigen::aligned_allocator<Gradients>> gradients_;
  std::vector<double> weights_;
};

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
