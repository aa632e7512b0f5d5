#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mesh/tet_mesh.hpp"

#include <algorithm>
#include <map>
#include <utility>

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

/// Throws MeshError unless all Jacobians are positive over the whole element, the surface is a closed manifold, and the
/// volume is within `volume_tolerance` of `exact_volume_m3` (0: not checked).
inline void require_valid(const TetMesh& mesh, double exact_volume_m3 = 0.0, double volume_tolerance = 0.01);

namespace detail {

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
  if (mesh.order == 1) return {(x(1) - x(0)).cross(x(2) - x(0)).dot(x(3) - x(0))};
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

inline void require_valid(const TetMesh& mesh, double exact_volume_m3, double volume_tolerance) {
  using Reason = MeshError::Reason;
  for (const Vec3d& x : mesh.nodes)
    if (!x.allFinite()) throw MeshError(Reason::not_finite, "mesh has a node that is not finite");
  for (std::size_t e = 0; e < mesh.tets.size(); ++e)
    for (double c : jacobian_coefficients(mesh, mesh.tets[e]))
      if (!(c > 0.0))
        throw MeshError(Reason::inverted, message("mesh element ", e, " has a Jacobian bound of ", c * 1e9,
                                              " mm3, must be > 0 over the whole element"));
  std::map<std::pair<int, int>, int> edges;  // directed edges of the closed surface must pair up
  for (const BoundaryFace& f : mesh.faces)
    for (std::size_t k = 0; k < 3; ++k) ++edges[{f.nodes[k], f.nodes[(k + 1) % 3]}];
  for (const auto& [edge, count] : edges) {
    const auto back = edges.find({edge.second, edge.first});
    if (count != 1 || back == edges.end() || back->second != 1)
      throw MeshError(count != 1 ? Reason::not_manifold : Reason::open,
          message("mesh surface is not a closed manifold at edge ", edge.first, "-", edge.second));
  }
  if (exact_volume_m3 > 0.0) {
    const double volume = measure(mesh).volume_m3;
    if (!(std::abs(volume / exact_volume_m3 - 1.0) <= volume_tolerance))
      throw MeshError(Reason::inaccurate, message("mesh volume is ", volume * 1e9, " mm3, must be within ",
                                              100 * volume_tolerance, " % of ", exact_volume_m3 * 1e9, " mm3"));
  }
}

}  // namespace lumo
