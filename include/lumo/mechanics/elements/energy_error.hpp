#pragma once

#include "lumo/mechanics/elements/element.hpp"
#include "lumo/mechanics/elements/solid.hpp"
#include "lumo/mechanics/materials/material.hpp"
#include "lumo/mesh/tet_mesh.hpp"

#include <Eigen/LU>

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

namespace lumo {

/// How far a mesh is from resolving the stresses on it: in an element they are polynomials, and jump to the next one's.
/// Stresses of distortion are carried to the nodes, averaged there, and compared with themselves. Their difference, as
/// a part of their energy, is the part of the energy, and of a depth or stiffness, that a finer mesh would change.
/// Source: Zienkiewicz, Zhu 1987, doi:10.1002/nme.1620240206.
template <HyperelasticMaterial Material, TetElement Element> class EnergyError {
 public:
  /// Throws InvalidArgument where the mesh is not of the element's order.
  EnergyError(const TetMesh& mesh, const Material& material) : mesh_(&mesh), material_(material), points_(mesh) {}

  /// Relative; +∞ where the state is not finite or an element is inverted.
  double operator()(const Positions& x) const {
    const std::size_t tets = mesh_->tets.size(), n = mesh_->nodes.size();
    std::vector<std::array<Mat3d, points>> stress(tets);
    std::vector<Mat3d> mean(n, Mat3d::Zero());
    std::vector<double> volume(n, 0.0);
    for (std::size_t e = 0; e < tets; ++e) {
      double whole = 0.0;
      for (std::size_t q = 0; q < points; ++q) {
        stress[e][q] = material_.distortion_stress(deformation(e, q, x));
        whole += points_.weight(e, int(q));
      }
      for (std::size_t a = 0; a < nodes; ++a) {
        const std::size_t node = std::size_t(mesh_->tets[e][a]);
        for (std::size_t q = 0; q < points; ++q)
          mean[node] += whole * to_nodes_(Eigen::Index(a), Eigen::Index(q)) * stress[e][q];
        volume[node] += whole;
      }
    }
    for (std::size_t k = 0; k < n; ++k)
      if (volume[k] > 0.0) mean[k] /= volume[k];
    const double rounding = std::pow(1e-12 * material_.shear_modulus(), 2);
    double jumps = 0.0, all = 0.0, rest = 0.0;
    for (std::size_t e = 0; e < tets; ++e)
      for (std::size_t q = 0; q < points; ++q) {
        Mat3d smooth = Mat3d::Zero();
        for (std::size_t a = 0; a < nodes; ++a)
          smooth += from_nodes_(Eigen::Index(q), Eigen::Index(a)) * mean[std::size_t(mesh_->tets[e][a])];
        jumps += points_.weight(e, int(q)) * (smooth - stress[e][q]).squaredNorm();
        all += points_.weight(e, int(q)) * stress[e][q].squaredNorm();
        rest += points_.weight(e, int(q)) * rounding;
      }
    if (all <= rest) return 0.0;
    return std::isfinite(jumps / all) ? jumps / all : std::numeric_limits<double>::infinity();
  }

 private:
  static constexpr std::size_t nodes = std::size_t(Element::nodes), points = std::size_t(Element::points);
  using ToNodes = Eigen::Matrix<double, Element::nodes, Element::points>;
  using FromNodes = Eigen::Matrix<double, Element::points, Element::nodes>;

  // Barycentric coordinates of a quadrature point, or of a node.
  static std::array<double, 4> corners_of_point(int q) {
    const Vec3d p = Element::place(q);
    return {1.0 - p.sum(), p.x(), p.y(), p.z()};
  }
  static std::array<double, 4> corners_of_node(int a) {
    std::array<double, 4> l = {};
    if (a < 4) l[std::size_t(a)] = 1.0;
    else
      for (const int k : tet_edges[a - 4]) l[std::size_t(k)] = 0.5;
    return l;
  }
  // The element's own polynomial at its nodes: constant by one point, linear through (or among) more.
  static ToNodes to_nodes() {
    if constexpr (Element::points == 1) return ToNodes::Ones();
    Eigen::Matrix<double, Element::points, 4> at;
    for (int q = 0; q < Element::points; ++q)
      for (int k = 0; k < 4; ++k) at(q, k) = corners_of_point(q)[std::size_t(k)];
    const Eigen::Matrix<double, 4, 4> normal = at.transpose() * at;
    const Eigen::Matrix<double, 4, Element::points> corner = normal.inverse() * at.transpose();
    ToNodes all = ToNodes::Zero();
    for (int a = 0; a < Element::nodes; ++a)
      for (int k = 0; k < 4; ++k) all.row(a) += corners_of_node(a)[std::size_t(k)] * corner.row(k);
    return all;
  }
  // Lagrange's shape functions at the quadrature points.
  static FromNodes from_nodes() {
    FromNodes all;
    for (int q = 0; q < Element::points; ++q) {
      const std::array<double, 4> l = corners_of_point(q);
      for (int a = 0; a < Element::nodes; ++a) {
        if (a >= 4) all(q, a) = 4.0 * l[std::size_t(tet_edges[a - 4][0])] * l[std::size_t(tet_edges[a - 4][1])];
        else all(q, a) = l[std::size_t(a)] * (Element::nodes == 4 ? 1.0 : 2.0 * l[std::size_t(a)] - 1.0);
      }
    }
    return all;
  }

  Mat3d deformation(std::size_t e, std::size_t q, const Positions& x) const {
    const auto& g = points_.gradient(e, int(q));
    Mat3d F = Mat3d::Zero();
    for (std::size_t a = 0; a < nodes; ++a)
      for (int j = 0; j < 3; ++j)
        for (int i = 0; i < 3; ++i) F(i, j) += x(i, mesh_->tets[e][a]) * g(j, Eigen::Index(a));
    return F;
  }

  const TetMesh* mesh_;
  Material material_;
  ElementPoints<Element> points_;
  ToNodes to_nodes_ = to_nodes();
  FromNodes from_nodes_ = from_nodes();
};

}  // namespace lumo
