#pragma once

#include "charts/chart.hpp"
#include "lumo/mechanics/contact/contact_surface.hpp"
#include "lumo/mesh/tet_mesh.hpp"

#include <array>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

namespace lumo::program {

/// The flat triangles of the surface as nodes, four for a curved face: a contact field is linear on each (see
/// MechanicalState).
inline std::vector<std::array<std::size_t, 3>> sub_facets(const TetMesh& mesh) {
  std::vector<std::array<std::size_t, 3>> facets;
  for (const BoundaryFace& face : mesh.faces)
    for (std::size_t part = 0; part < (mesh.order == 2 ? 4 : 1); ++part) {
      const auto corner = mesh.order == 2 ? face_parts()[part] : std::array{0, 1, 2};
      const auto node = [&](std::size_t k) { return std::size_t(face.nodes[std::size_t(corner[k])]); };
      facets.push_back({node(0), node(1), node(2)});
    }
  return facets;
}

/// Where on the way from one node to the other a field is zero, 0 … 1. A node that nothing can touch carries −infinity:
/// the contact set ends at its neighbour.
inline double zero_between(double a, double b) { return std::isinf(b) ? 0.0 : std::isinf(a) ? 1.0 : a / (a - b); }

/// Edges of the contact set {φ > 0} on the undeformed pad, seen from outside: closed loops of (y, x) in mm, the set on
/// one side of all of them. Loops come by their first mesh edge, in the order of node numbers.
inline std::vector<Points> contact_outline(const TetMesh& mesh, const std::vector<double>& field) {
  using Edge = std::pair<std::size_t, std::size_t>;
  // In every facet that the edge of contact crosses it comes in where the field falls and leaves where it rises; the
  // next facet shares that edge.
  std::map<Edge, Edge> next;
  for (const auto& facet : sub_facets(mesh)) {
    std::array<Edge, 2> crossed;  // where the field falls, where it rises
    bool crosses = false;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t a = facet[k], b = facet[(k + 1) % 3];
      if ((field[a] > 0.0) == (field[b] > 0.0)) continue;
      crossed[field[a] > 0.0 ? 0 : 1] = std::minmax(a, b);
      crosses = true;
    }
    if (crosses) next[crossed[0]] = crossed[1];
  }
  const auto crossing = [&](const Edge& e) -> Point {
    const Vec3d &a = mesh.nodes[e.first], &b = mesh.nodes[e.second];
    const Vec3d p = a + zero_between(field[e.first], field[e.second]) * (b - a);
    return {1e3 * p.y(), 1e3 * p.x()};
  };
  std::vector<Points> loops;
  while (!next.empty()) {
    Points& loop = loops.emplace_back();
    for (auto at = next.begin(); at != next.end();) {
      loop.push_back(crossing(at->first));
      const Edge to = at->second;
      next.erase(at);
      at = next.find(to);
    }
    loop.push_back(loop.front());
  }
  return loops;
}

}  // namespace lumo::program
