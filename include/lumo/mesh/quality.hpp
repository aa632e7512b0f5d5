#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mesh/mesh_sides.hpp"
#include "lumo/mesh/tet_mesh.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace lumo {

/// How good a mesh is.
struct MeshQuality {
  double volume_m3 = 0.0;           ///< exact integral of the Jacobian
  double min_jacobian_ratio = 1.0;  ///< smallest Bernstein coefficient of any element's Jacobian over the element's
                                    ///< mean: > 0 proves it valid everywhere
  double min_dihedral_deg = 180.0;  ///< of the corner tetrahedra
};

/// Bernstein coefficients of det(∂x/∂ξ) over one element: 1 (linear) or 20 (quadratic). All positive proves that the
/// map is invertible at every point, not only at quadrature points. Source: Johnen, Remacle, Geuzaine 2013.
inline std::vector<double> jacobian_coefficients(const TetMesh& mesh, const std::array<int, 10>& tet);

/// Measures without judging.
inline MeshQuality measure(const TetMesh& mesh);

/// Throws MeshError, which says what and where, unless nodes are finite and all in use, indices in range, middle nodes
/// there in a quadratic mesh only, all Jacobians positive over the whole element, elements joined side by side, `faces`
/// their boundary and a closed manifold, both sides of a plane of symmetry mirror images, and the volume within
/// `volume_tolerance` of `exact_volume_m3` (0: not checked). Linear in the size of the mesh.
inline void require_valid(const TetMesh& mesh, double exact_volume_m3 = 0.0, double volume_tolerance = 0.01);

namespace detail {

// Six times the volume of the corner tetrahedron, with its sign.
inline double corner_jacobian(const TetMesh& mesh, const std::array<int, 10>& t) {
  const auto x = [&](int k) -> const Vec3d& { return mesh.nodes[std::size_t(t[std::size_t(k)])]; };
  return (x(1) - x(0)).cross(x(2) - x(0)).dot(x(3) - x(0));
}

// Symmetric multilinear form whose diagonal is the determinant.
inline double mixed_determinant(const Mat3d& a, const Mat3d& b, const Mat3d& c) {
  const auto det = [](const Vec3d& u, const Vec3d& v, const Vec3d& w) { return u.dot(v.cross(w)); };
  return (det(a.col(0), b.col(1), c.col(2)) + det(a.col(0), c.col(1), b.col(2)) + det(b.col(0), a.col(1), c.col(2)) +
             det(b.col(0), c.col(1), a.col(2)) + det(c.col(0), a.col(1), b.col(2)) +
             det(c.col(0), b.col(1), a.col(2))) /
         6.0;
}

}  // namespace detail

inline std::vector<double> jacobian_coefficients(const TetMesh& mesh, const std::array<int, 10>& t) {
  const auto x = [&](int k) -> const Vec3d& { return mesh.nodes[std::size_t(t[std::size_t(k)])]; };
  if (mesh.order == 1) return {detail::corner_jacobian(mesh, t)};
  // The Jacobian of a quadratic map is linear in the barycentric coordinates: its values at the four corners determine
  // it.
  static constexpr int mid[4][4] = {{-1, 4, 6, 7}, {4, -1, 5, 8}, {6, 5, -1, 9}, {7, 8, 9, -1}};
  std::array<Mat3d, 4> corner;
  for (int k = 0; k < 4; ++k) {
    std::array<Vec3d, 4> by_lambda;  // ∂x/∂λ_j at corner k
    for (int j = 0; j < 4; ++j)
      by_lambda[std::size_t(j)] = j == k ? Vec3d(3.0 * x(k)) : Vec3d(4.0 * x(mid[k][j]) - x(j));
    for (int j = 1; j < 4; ++j) corner[std::size_t(k)].col(j - 1) = by_lambda[std::size_t(j)] - by_lambda[0];
  }
  std::vector<double> coefficients;
  for (std::size_t a = 0; a < 4; ++a)
    for (std::size_t b = a; b < 4; ++b)
      for (std::size_t c = b; c < 4; ++c)
        coefficients.push_back(detail::mixed_determinant(corner[a], corner[b], corner[c]));
  return coefficients;
}

inline MeshQuality measure(const TetMesh& mesh) {
  MeshQuality q;
  for (const auto& t : mesh.tets) {
    const std::vector<double> c = jacobian_coefficients(mesh, t);
    double sum = 0.0;
    for (double v : c) sum += v;
    const double mean = sum / double(c.size());
    q.volume_m3 += mean / 6.0;  // the integral of a Bernstein basis polynomial does not depend on its index
    q.min_jacobian_ratio =
        std::min(q.min_jacobian_ratio, *std::min_element(c.begin(), c.end()) / std::max(std::abs(mean), 1e-300));
    std::array<Vec3d, 4> n;
    for (std::size_t k = 0; k < 4; ++k) {
      const Vec3d &a = mesh.nodes[std::size_t(t[(k + 1) % 4])], &b = mesh.nodes[std::size_t(t[(k + 2) % 4])],
                  &d = mesh.nodes[std::size_t(t[(k + 3) % 4])];
      n[k] = (b - a).cross(d - a).normalized() * (k % 2 == 0 ? 1.0 : -1.0);
    }
    for (std::size_t i = 0; i < 4; ++i)
      for (std::size_t j = i + 1; j < 4; ++j)
        q.min_dihedral_deg =
            std::min(q.min_dihedral_deg, std::acos(std::clamp(-n[i].dot(n[j]), -1.0, 1.0)) * 180.0 / 3.14159265358979);
  }
  return q;
}

namespace detail {

// The parts of require_valid().
inline void require_indices(const TetMesh& mesh);
inline void require_orientation(const TetMesh& mesh);
inline void require_manifold(const TetMesh& mesh);
inline void require_mirror_images(const TetMesh& mesh, int axis);

}  // namespace detail

inline void require_valid(const TetMesh& mesh, double exact_volume_m3, double volume_tolerance) {
  detail::require_indices(mesh);
  detail::require_orientation(mesh);
  detail::MeshSides(mesh).require_pairs();
  detail::require_manifold(mesh);
  if (mesh.symmetry.x) detail::require_mirror_images(mesh, 0);
  if (mesh.symmetry.y) detail::require_mirror_images(mesh, 1);
  if (exact_volume_m3 > 0.0) {
    const double volume = measure(mesh).volume_m3;
    if (!(std::abs(volume / exact_volume_m3 - 1.0) <= volume_tolerance))
      throw MeshError(
          MeshError::Reason::inaccurate, message("mesh volume is ", volume * 1e9, " mm3, must be within ",
                                             100 * volume_tolerance, " % of ", exact_volume_m3 * 1e9, " mm3"));
  }
}

namespace detail {

// In a linear mesh the places of middle nodes are empty.
template <std::size_t N>
void require_nodes(const char* what, std::size_t number, const std::array<int, N>& nodes, int used, std::size_t there) {
  for (std::size_t k = 0; k < N; ++k) {
    const bool named = k < std::size_t(used), known = nodes[k] >= 0 && std::size_t(nodes[k]) < there;
    if (named && !known)
      throw MeshError(MeshError::Reason::bad_index,
          message("mesh ", what, " ", number, " names node ", nodes[k], ", the mesh has nodes 0 to ", int(there) - 1));
    if (!named && nodes[k] != -1)
      throw MeshError(MeshError::Reason::bad_index,
          message("mesh ", what, " ", number, " has middle node ", nodes[k], " in a linear mesh, must be -1"));
  }
}

inline void require_indices(const TetMesh& mesh) {
  using Reason = MeshError::Reason;
  if (mesh.order != 1 && mesh.order != 2)
    throw MeshError(Reason::bad_index, message("mesh order is ", mesh.order, ", must be 1 or 2"));
  if (mesh.tets.empty())
    throw MeshError(Reason::degenerate, "mesh has no elements: a bare surface can be lit, not pressed");
  const std::size_t count = mesh.nodes.size();
  for (std::size_t k = 0; k < count; ++k)
    if (!mesh.nodes[k].allFinite() || !(mesh.nodes[k].cwiseAbs().maxCoeff() < largest_coordinate_m))
      throw MeshError(Reason::not_finite, message("mesh node ", k, " is not at a finite place below 1e6 m"));
  for (std::size_t e = 0; e < mesh.tets.size(); ++e)
    require_nodes("element", e, mesh.tets[e], mesh.nodes_per_tet(), count);
  for (std::size_t f = 0; f < mesh.faces.size(); ++f)
    require_nodes("face", f, mesh.faces[f].nodes, mesh.nodes_per_face(), count);
  std::vector<char> used(count, 0);
  for (const auto& t : mesh.tets)
    for (std::size_t k = 0; k < std::size_t(mesh.nodes_per_tet()); ++k) used[std::size_t(t[k])] = 1;
  if (const auto loose = std::find(used.begin(), used.end(), 0); loose != used.end())
    throw MeshError(Reason::bad_index, message("mesh node ", loose - used.begin(), " belongs to no element"));
}

// How far, at most, the coefficients of a quadratic element lie from the Jacobian of its corners. They are determinants
// of edges, each moved by no more than four times the sum of how far middle nodes lie off the middles.
inline double largest_bend(const TetMesh& mesh, const std::array<int, 10>& t) {
  const auto x = [&](int k) -> const Vec3d& { return mesh.nodes[std::size_t(t[std::size_t(k)])]; };
  double moved = 0.0;
  for (int k = 0; k < 6; ++k) moved += 4.0 * (x(4 + k) - 0.5 * (x(tet_edges[k][0]) + x(tet_edges[k][1]))).norm();
  const double a = (x(1) - x(0)).norm(), b = (x(2) - x(0)).norm(), c = (x(3) - x(0)).norm();
  return (a + moved) * (b + moved) * (c + moved) - a * b * c;
}

inline void require_orientation(const TetMesh& mesh) {
  for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
    const auto& t = mesh.tets[e];
    double least = corner_jacobian(mesh, t);
    if (mesh.order == 2 && !(least > 2.0 * largest_bend(mesh, t))) {  // twice: rounding
      const std::vector<double> c = jacobian_coefficients(mesh, t);
      least = *std::min_element(c.begin(), c.end());
    }
    if (!(least > 0.0))
      throw MeshError(MeshError::Reason::inverted, message("mesh element ", e, " has a Jacobian bound of ", least * 1e9,
                                                       " mm3, must be > 0 over the whole element"));
  }
}

// Directed edges of the closed surface must pair up.
inline void require_manifold(const TetMesh& mesh) {
  const auto key = [](int from, int to) { return std::uint64_t(unsigned(from)) << 32u | unsigned(to); };
  std::vector<std::uint64_t> edges, back;
  for (const BoundaryFace& f : mesh.faces)
    for (std::size_t k = 0; k < 3; ++k) {
      edges.push_back(key(f.nodes[k], f.nodes[(k + 1) % 3]));
      back.push_back(key(f.nodes[(k + 1) % 3], f.nodes[k]));
    }
  std::sort(edges.begin(), edges.end());
  std::sort(back.begin(), back.end());
  for (std::size_t k = 0; k < edges.size(); ++k) {
    const bool twice = k + 1 < edges.size() && edges[k + 1] == edges[k];
    if (!twice && back[k] == edges[k]) continue;
    const std::uint64_t edge = twice ? edges[k] : std::min(edges[k], back[k]);
    throw MeshError(twice ? MeshError::Reason::not_manifold : MeshError::Reason::open,
        message("mesh surface is not a closed manifold at edge ", edge >> 32u, "-", unsigned(edge)));
  }
}

inline void require_mirror_images(const TetMesh& mesh, int axis) {
  using Reason = MeshError::Reason;
  const std::vector<int>& image = axis == 0 ? mesh.mirror_x : mesh.mirror_y;
  const char* plane = axis == 0 ? "x = 0" : "y = 0";
  if (image.size() != mesh.nodes.size())
    throw MeshError(Reason::bad_index, message("mesh has ", image.size(), " mirror images of nodes in ", plane,
                                           ", must have as many as nodes, ", mesh.nodes.size()));
  for (std::size_t k = 0; k < image.size(); ++k) {
    if (image[k] < 0 || std::size_t(image[k]) >= image.size())
      throw MeshError(Reason::bad_index, message("mesh node ", k, " has mirror image ", image[k], " in ", plane,
                                             ", the mesh has nodes 0 to ", int(image.size()) - 1));
    Vec3d mirrored = mesh.nodes[k];
    mirrored[axis] = -mirrored[axis];
    if (mesh.nodes[std::size_t(image[k])] != mirrored)
      throw MeshError(Reason::asymmetric,
          message("mesh node ", image[k], " is not the exact mirror image of node ", k, " in ", plane));
  }
  std::ptrdiff_t more = 0;  // elements on the positive side than on the other
  for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
    double low = 0.0, high = 0.0;
    for (std::size_t k = 0; k < 4; ++k) {
      const double at = mesh.nodes[std::size_t(mesh.tets[e][k])][axis];
      low = std::min(low, at);
      high = std::max(high, at);
    }
    if (low < 0.0 && high > 0.0)
      throw MeshError(Reason::asymmetric, message("mesh element ", e, " crosses its plane of symmetry, ", plane));
    more += high > 0.0 ? 1 : -1;
  }
  if (more != 0)
    throw MeshError(Reason::asymmetric,
        message("mesh has ", std::abs(more), " elements more on one side of ", plane, " than on the other"));
}

}  // namespace detail

}  // namespace lumo
