#pragma once

#include "lumo/core/types.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "lumo/morphology/body.hpp"
#include "lumo/optics/surface/quadratic_face.hpp"

#include <Eigen/Sparse>

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <vector>

namespace lumo {

/// Numbers of the six nodes of each face, shared by neighbours on the same patch only, so that a crease keeps both its
/// normals.
inline std::vector<std::array<int, 6>> patchwise_nodes(const std::vector<BoundaryFace>& faces) {
  std::vector<std::array<int, 6>> numbers(faces.size());
  std::map<std::array<int, 3>, int> known;  // patch and the corners of the edge (of a corner: itself twice)
  for (std::size_t f = 0; f < faces.size(); ++f)
    for (std::size_t k = 0; k < 6; ++k) {
      const int a = faces[f].nodes[k % 3], b = k < 3 ? a : faces[f].nodes[(k + 1) % 3];
      numbers[f][k] =
          known.try_emplace({faces[f].patch, std::min(a, b), std::max(a, b)}, int(known.size())).first->second;
    }
  return numbers;
}

/// Sets the normals of the deformed faces. Those of neighbouring quadratic faces differ, by about as much as a light
/// load turns them; and where the body is undeformed its shape is known. So the exact normals are turned as the faces
/// turn, by the nearest field that is continuous and quadratic on each patch: it turns every node's surroundings as
/// much as the faces do in the mean. Source: Hinton, Campbell 1974.
inline void recover_normals(std::vector<QuadraticFace>& faces, const std::vector<BoundaryFace>& mesh_faces,
                            const Body& body) {
  using Vector6d = Eigen::Matrix<double, 6, 1>;
  using Matrix6d = Eigen::Matrix<double, 6, 6>;
  using SparseMatrix = Eigen::SparseMatrix<double>;
  struct Point {
    double weight, b1, b2;
  };
  constexpr double w = 0.223381589678011, b = 0.445948490915965, v = 0.109951743655322,
                   c = 0.091576213509771;  // degree 4: Dunavant 1985
  constexpr std::array<Point, 6> rule = {
      {{w, b, b}, {w, 1 - 2 * b, b}, {w, b, 1 - 2 * b}, {v, c, c}, {v, 1 - 2 * c, c}, {v, c, 1 - 2 * c}}};

  const std::vector<std::array<int, 6>> nodes = patchwise_nodes(mesh_faces);
  int size = 0;
  for (const std::array<int, 6>& n : nodes) size = std::max(size, 1 + *std::max_element(n.begin(), n.end()));
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(36 * faces.size());
  Eigen::MatrixX3d turned = Eigen::MatrixX3d::Zero(size, 3);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const std::array<Vec3d, 6>& x = faces[f].reference;
    const double area = 0.5 * (x[1] - x[0]).cross(x[2] - x[0]).norm();
    Matrix6d mass = Matrix6d::Zero();
    for (const Point& p : rule) {
      const Vector6d shape(quadratic_shape(p.b1, p.b2).data());
      mass += area * p.weight * shape * shape.transpose();
      const Vec3d turn = quadratic_normal(faces[f].deformed, p.b1, p.b2) - quadratic_normal(x, p.b1, p.b2);
      if (!turn.allFinite()) continue;  // a face that is crushed to nothing has no normal
      for (std::size_t k = 0; k < 6; ++k) turned.row(nodes[f][k]) += area * p.weight * shape[int(k)] * turn.transpose();
    }
    for (std::size_t k = 0; k < 6; ++k)
      for (std::size_t l = 0; l < 6; ++l) entries.emplace_back(nodes[f][k], nodes[f][l], mass(int(k), int(l)));
  }
  SparseMatrix mass(size, size);
  mass.setFromTriplets(entries.begin(), entries.end());
  Eigen::ConjugateGradient<SparseMatrix, Eigen::Lower | Eigen::Upper> solver(mass);
  solver.setTolerance(1e-10);
  turned = solver.solve(turned).eval();
  for (std::size_t f = 0; f < faces.size(); ++f)
    for (std::size_t k = 0; k < 6; ++k)
      faces[f].normal[k] =
          (outward_normal(body, faces[f].patch, faces[f].reference[k]) + turned.row(nodes[f][k]).transpose())
              .normalized();
}

}  // namespace lumo
