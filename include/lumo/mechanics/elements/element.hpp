#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/mechanics/materials/material.hpp"
#include "lumo/mesh/tet_mesh.hpp"

#include <Eigen/LU>
#include <array>
#include <concepts>
#include <vector>

namespace lumo {

/// Gradients of Lagrange's shape functions by (λ₁, λ₂, λ₃) at xi, 3 × nodes, in the node order of TetMesh.
template <int Nodes, class S> Eigen::Matrix<S, 3, Nodes> shape_gradients(const Vec3<S>& xi) {
  static constexpr double corner[4][3] = {{-1, -1, -1}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  Eigen::Matrix<S, 3, Nodes> g;
  const std::array<S, 4> l = {1.0 - xi.sum(), xi.x(), xi.y(), xi.z()};
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 4; ++k) g(i, k) = Nodes == 4 ? S(corner[k][i]) : (4.0 * l[std::size_t(k)] - 1.0) * corner[k][i];
    for (int k = 4; k < Nodes; ++k) {
      const int a = tet_edges[k - 4][0], b = tet_edges[k - 4][1];
      g(i, k) = 4.0 * (l[std::size_t(b)] * corner[a][i] + l[std::size_t(a)] * corner[b][i]);
    }
  }
  return g;
}

/// A tetrahedral finite element: gradients of its shape functions by λ₁, λ₂, λ₃ at its quadrature points, 3 × nodes in
/// the node order of TetMesh, on the reference tetrahedron λ₁, λ₂, λ₃ ≥ 0, λ₁ + λ₂ + λ₃ ≤ 1, where those points are,
/// and how its mass is shared. `order` is the mesh's. Laws: gradients sum to zero and reproduce linear fields, weights
/// sum to 1/6, shares of the mass to 1.
template <class E>
concept TetElement = requires(const E& element) {
  requires E::order == 1 || E::order == 2;
  requires E::nodes == (E::order == 1 ? 4 : 10);
  requires E::points >= 1;
  { E::gradients(0) } -> std::same_as<Eigen::Matrix<double, 3, E::nodes>>;
  { E::place(0) } -> std::convertible_to<Vec3d>;
  { E::weight(0) } -> std::convertible_to<double>;
  { E::mass_share(0) } -> std::convertible_to<double>;
  { element.mean_dilatation } -> std::convertible_to<bool>;
};

/// Quadratic tetrahedron; with `mean_dilatation` its volumetric energy sees the element's mean of J, which cures
/// locking near incompressibility (Nagtegaal, Parks, Rice 1974). Four-point quadrature of degree 2.
struct QuadraticTet {
  static constexpr int order = 2;
  static constexpr int nodes = 10;
  static constexpr int points = 4;
  bool mean_dilatation = true;

  static Vec3d place(int q) {
    constexpr double a = 0.58541019662496845446, b = 0.13819660112501051518;
    return Vec3d(q == 1 ? a : b, q == 2 ? a : b, q == 3 ? a : b);
  }
  static Eigen::Matrix<double, 3, nodes> gradients(int q) { return shape_gradients<nodes>(place(q)); }
  static double weight(int) { return 1.0 / 24.0; }
  /// In proportion to the diagonal of the consistent matrix (Hinton, Rock, Zienkiewicz 1976): row sums would be
  /// negative.
  static double mass_share(int a) { return a < 4 ? 1.0 / 36.0 : 4.0 / 27.0; }
};

/// Linear tetrahedron: locks at ν = 0.495 (20–60 % too stiff on pads like LUMO's). Offered for comparison with codes
/// that use it.
struct LinearTet {
  static constexpr int order = 1;
  static constexpr int nodes = 4;
  static constexpr int points = 1;
  bool mean_dilatation = false;

  static Vec3d place(int) { return Vec3d(0.25, 0.25, 0.25); }
  static Eigen::Matrix<double, 3, nodes> gradients(int q) { return shape_gradients<nodes>(place(q)); }
  static double weight(int) { return 1.0 / 6.0; }
  static double mass_share(int) { return 0.25; }
};

/// Eight linear tetrahedra in place of one quadratic, on its ten nodes; with `mean_dilatation` the volumetric energy
/// sees the mean of J over the eight, which cures their locking (de Souza Neto, Pires, Owen 2005, patches of linear
/// elements, here with an energy). Without it, linear tetrahedra of half the size.
struct LinearPatchTet {
  static constexpr int order = 2;
  static constexpr int nodes = 10;
  static constexpr int points = 8;
  bool mean_dilatation = true;

  static Vec3d place(int q) {
    Vec3d middle = Vec3d::Zero();
    for (int k : parts[q]) middle += 0.25 * Vec3d(corner[k][0], corner[k][1], corner[k][2]);
    return middle;
  }
  static Eigen::Matrix<double, 3, nodes> gradients(int q) {
    using Gradients = Eigen::Matrix<double, 3, nodes>;
    Gradients g = Gradients::Zero();
    const auto& part = parts[q];
    const auto edge = [&](int k) {
      return Vec3d(corner[part[k]][0] - corner[part[0]][0], corner[part[k]][1] - corner[part[0]][1],
          corner[part[k]][2] - corner[part[0]][2]);
    };
    for (int k = 1; k < 4; ++k) {
      const Vec3d u = edge(k % 3 + 1), v = edge((k + 1) % 3 + 1),
                  slope = 8.0 * u.cross(v);  // u × v · edge(k) = 1/8, six times the volume
      for (int i = 0; i < 3; ++i) {
        g(i, part[k]) = slope[i];
        g(i, part[0]) -= slope[i];
      }
    }
    return g;
  }
  static double weight(int) { return 1.0 / 48.0; }
  static double mass_share(int a) {
    int shared = 0;
    for (const auto& part : parts)
      for (int node : part) shared += node == a;
    return shared / 32.0;
  }

  /// Nodes of the eight: at the corners, and the octahedron between them cut along the line from node 4 to node 9,
  /// which mirrored() leaves in place.
  static constexpr int parts[8][4] = {
      {0, 4, 6, 7}, {4, 1, 5, 8}, {6, 5, 2, 9}, {7, 8, 9, 3}, {4, 9, 5, 6}, {4, 9, 6, 7}, {4, 9, 7, 8}, {4, 9, 8, 5}};

 private:
  static constexpr double corner[10][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0.5, 0, 0}, {0.5, 0.5, 0},
      {0, 0.5, 0}, {0, 0, 0.5}, {0.5, 0, 0.5}, {0, 0.5, 0.5}};
};

/// Shape functions of the six-node (or three-node) boundary triangle at barycentric (1−u−v, u, v), in the node order of
/// BoundaryFace.
template <class S> std::array<S, 6> face_shape(const S& u, const S& v, int order) {
  const S w = 1.0 - u - v;
  if (order == 1) return {w, u, v, 0.0, 0.0, 0.0};
  return {w * (2 * w - 1), u * (2 * u - 1), v * (2 * v - 1), 4 * w * u, 4 * u * v, 4 * v * w};
}

/// Derivatives of face_shape by u and v.
template <class S> std::array<std::array<S, 2>, 6> face_shape_derivatives(const S& u, const S& v, int order) {
  if (order == 1) return {{{-1, -1}, {1, 0}, {0, 1}, {0, 0}, {0, 0}, {0, 0}}};
  const S w = 1.0 - u - v;
  return {{{1 - 4 * w, 1 - 4 * w}, {4 * u - 1, 0}, {0, 4 * v - 1}, {4 * (w - u), -4 * u}, {4 * v, 4 * u},
      {-4 * v, 4 * (w - v)}}};
}

static_assert(TetElement<QuadraticTet> && TetElement<LinearTet> && TetElement<LinearPatchTet>);

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
