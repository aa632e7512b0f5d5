#pragma once

#include "lumo/mechanics/contact_surface.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "drawing/svg.hpp"

#include <cmath>
#include <map>
#include <utility>
#include <vector>

namespace lumo::program {

/// Edges of the contact set {φ > 0} on the undeformed pad, seen from outside: closed loops of (y, x) in mm, the set on one side of all of them. The
/// field is linear on the surface's sub-facets (see MechanicalState). Loops come by their first mesh edge, in the order of node numbers.
inline std::vector<std::vector<Point>> contact_outline(const TetMesh& mesh, const std::vector<double>& field) {
  using Edge = std::pair<int, int>;
  // In every facet that the edge of contact crosses it comes in where the field falls and leaves where it rises; the next facet shares that edge.
  std::map<Edge, Edge> next;
  const auto key = [](int a, int b) { return a < b ? Edge{a, b} : Edge{b, a}; };
  const std::size_t parts = mesh.order == 2 ? 4 : 1;
  for (const BoundaryFace& face : mesh.faces)
    for (std::size_t part = 0; part < parts; ++part) {
      Edge falls{-1, -1}, rises{-1, -1};
      for (std::size_t k = 0; k < 3; ++k) {
        const auto corner = [&](std::size_t i) { return face.nodes[parts == 4 ? std::size_t(face_parts()[part][i % 3]) : i % 3]; };
        const int a = corner(k), b = corner(k + 1);
        const bool in_a = field[std::size_t(a)] > 0.0, in_b = field[std::size_t(b)] > 0.0;
        if (in_a && !in_b) falls = key(a, b);
        if (!in_a && in_b) rises = key(a, b);
      }
      if (falls.first >= 0) next[falls] = rises;
    }
  // A node that nothing can touch carries −infinity: the set ends at its neighbour.
  const auto crossing = [&](const Edge& e) -> Point {
    const double a = field[std::size_t(e.first)], b = field[std::size_t(e.second)];
    const double t = std::isinf(b) ? 0.0 : std::isinf(a) ? 1.0 : a / (a - b);
    const Vec3 p = mesh.nodes[std::size_t(e.first)] + t * (mesh.nodes[std::size_t(e.second)] - mesh.nodes[std::size_t(e.first)]);
    return {1e3 * p.y(), 1e3 * p.x()};
  };
  std::vector<std::vector<Point>> loops;
  while (!next.empty()) {
    std::vector<Point>& loop = loops.emplace_back();
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
