#pragma once

#include "lumo/core/types.hpp"
#include "lumo/mesh/contact_slope.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "lumo/morphology/body.hpp"

#include <Eigen/Sparse>

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <utility>
#include <vector>

namespace lumo {

/// Shape functions of a quadratic triangle at barycentric (b1, b2); nodes: corners 0, 1, 2, then the middles of edges
/// 01, 12, 20.
inline std::array<double, 6> quadratic_shape(double b1, double b2) {
  const double b0 = 1.0 - b1 - b2;
  return {
      b0 * (2.0 * b0 - 1.0), b1 * (2.0 * b1 - 1.0), b2 * (2.0 * b2 - 1.0), 4.0 * b0 * b1, 4.0 * b1 * b2, 4.0 * b2 * b0};
}

/// Its point at (b1, b2).
inline Vec3d on_quadratic(const std::array<Vec3d, 6>& x, double b1, double b2) {
  const std::array<double, 6> n = quadratic_shape(b1, b2);
  return n[0] * x[0] + n[1] * x[1] + n[2] * x[2] + n[3] * x[3] + n[4] * x[4] + n[5] * x[5];
}

/// The same at (k1, k2)/n. Points on an edge come from the edge's own three nodes in the order of their `numbers`, so
/// that neighbours get the same bits: no cracks.
inline Vec3d lattice_point(const std::array<Vec3d, 6>& x, const std::array<int, 6>& numbers, int n, int k1, int k2) {
  const double h = 1.0 / n;
  const auto on_edge = [&](std::size_t a, std::size_t b, std::size_t m, int ka, int kb) {
    if (kb == 0) return x[a];
    if (ka == 0) return x[b];
    if (numbers[a] > numbers[b]) {
      std::swap(a, b);
      std::swap(ka, kb);
    }
    const double s = ka * h, t = kb * h;
    return Vec3d(s * (2.0 * s - 1.0) * x[a] + t * (2.0 * t - 1.0) * x[b] + 4.0 * s * t * x[m]);
  };
  const int k0 = n - k1 - k2;
  if (k2 == 0) return on_edge(0, 1, 3, k0, k1);
  if (k0 == 0) return on_edge(1, 2, 4, k1, k2);
  if (k1 == 0) return on_edge(2, 0, 5, k2, k0);
  return on_quadratic(x, k1 * h, k2 * h);
}

/// Unit normal at (b1, b2); not finite if the triangle is crushed.
inline Vec3d quadratic_normal(const std::array<Vec3d, 6>& x, double b1, double b2) {
  const double b0 = 1.0 - b1 - b2;
  const Vec3d d1 =
      (1.0 - 4.0 * b0) * x[0] + (4.0 * b1 - 1.0) * x[1] + 4.0 * (b0 - b1) * x[3] + 4.0 * b2 * (x[4] - x[5]);
  const Vec3d d2 =
      (1.0 - 4.0 * b0) * x[0] + (4.0 * b2 - 1.0) * x[2] + 4.0 * (b0 - b2) * x[5] + 4.0 * b1 * (x[4] - x[3]);
  return d1.cross(d2).normalized();
}

/// A boundary face of the mesh in one state.
struct QuadraticFace {
  std::array<Vec3d, 6> reference, deformed;  ///< [m]
  std::array<Vec3d, 6> normal;  ///< unit outward normals of the deformed face at its nodes, shared with its neighbours
  std::array<double, 6> contact;  ///< contact field, > 0 in contact, −infinity where there can be none
  int patch;
  bool may_touch;
  std::array<ContactSlope, 6> slope;  ///< how the face leans away from what it touches
  bool leans;                         ///< they say something of it

  /// Unit outward normal at (b1, b2).
  Vec3d normal_at(double b1, double b2) const;

  /// Inside {φ > 0}, φ linear on the four triangles between corners and edge middles?
  bool in_contact(double b1, double b2) const {
    if (!may_touch) return false;
    const double b0 = 1.0 - b1 - b2;
    double value = 0.0;
    struct Term {
      double weight;
      std::size_t node;
    };
    using Terms = std::array<Term, 3>;
    const Terms terms = b0 > 0.5   ? Terms{{{2.0 * b0 - 1.0, 0}, {2.0 * b1, 3}, {2.0 * b2, 5}}}
                        : b1 > 0.5 ? Terms{{{2.0 * b1 - 1.0, 1}, {2.0 * b0, 3}, {2.0 * b2, 4}}}
                        : b2 > 0.5 ? Terms{{{2.0 * b2 - 1.0, 2}, {2.0 * b1, 4}, {2.0 * b0, 5}}}
                                   : Terms{{{1.0 - 2.0 * b2, 3}, {1.0 - 2.0 * b0, 4}, {1.0 - 2.0 * b1, 5}}};
    for (const auto& [weight, node] : terms)
      if (weight > 0.0) value += weight * contact[node];  // a weight of 0 must not meet −infinity
    return value > 0.0;
  }
};

inline Vec3d QuadraticFace::normal_at(double b1, double b2) const {
  const std::array<double, 6> shape = quadratic_shape(b1, b2);
  Vec3d recovered = Vec3d::Zero();
  for (std::size_t k = 0; k < 6; ++k) recovered += shape[k] * normal[k];
  if (!leans) return recovered.normalized();
  double weight = 0.0, opening = 0.0;
  Vec3d rigid = Vec3d::Zero(), tilt = Vec3d::Zero();
  for (std::size_t k = 0; k < 6; ++k) {
    weight += shape[k] * slope[k].weight;
    opening += shape[k] * slope[k].opening;
    rigid += shape[k] * slope[k].normal;
    tilt += shape[k] * slope[k].tilt;
  }
  const double share = std::clamp(weight, 0.0, 1.0);
  const Vec3d leaning = (rigid + hertz_slope(opening) * tilt).normalized();
  return (share * leaning + (1.0 - share) * recovered.normalized()).normalized();
}

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

/// Sets the normals of the deformed faces. Normals of neighbouring quadratic faces differ, by about as much as a light
/// load turns them; the shape of the undeformed body is known. The exact normals are therefore turned as the faces
/// turn, by the nearest field that is continuous and quadratic on each patch: it turns every node's surroundings as
/// much as the faces do in the mean. Source: Hinton, Campbell 1974.
inline void recover_normals(
    std::vector<QuadraticFace>& faces, const std::vector<BoundaryFace>& mesh_faces, const Body& body) {
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
      if (!turn.allFinite()) continue;  // a crushed face has no normal
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
