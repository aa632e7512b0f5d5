#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mesh/tet_mesh.hpp"

#include <vector>

namespace lumo {

/// Groups of nodes no two of which share a tetrahedron: each node takes the first group that is free, in the order of
/// node numbers.
using VertexColors = std::vector<std::vector<int>>;

inline VertexColors color_vertices(const TetMesh& mesh) {
  const std::size_t per = std::size_t(mesh.nodes_per_tet());
  std::vector<std::vector<int>> tets_of(mesh.nodes.size());
  for (std::size_t e = 0; e < mesh.tets.size(); ++e)
    for (std::size_t a = 0; a < per; ++a) tets_of[std::size_t(mesh.tets[e][a])].push_back(int(e));
  VertexColors colors;
  std::vector<int> color(mesh.nodes.size(), -1), last_seen;
  for (std::size_t v = 0; v < mesh.nodes.size(); ++v) {
    for (int e : tets_of[v])
      for (std::size_t a = 0; a < per; ++a)
        if (const int c = color[std::size_t(mesh.tets[std::size_t(e)][a])]; c >= 0) last_seen[std::size_t(c)] = int(v);
    std::size_t free = 0;
    while (free < colors.size() && last_seen[free] == int(v)) ++free;
    if (free == colors.size()) {
      colors.emplace_back();
      last_seen.push_back(-1);
    }
    color[v] = int(free);
    colors[free].push_back(int(v));
  }
  return colors;
}

/// Throws InvalidArgument unless every node is in one group and no two nodes of a group share a tetrahedron.
inline void validate(const VertexColors& colors, const TetMesh& mesh) {
  std::vector<int> color(mesh.nodes.size(), -1);
  for (std::size_t c = 0; c < colors.size(); ++c)
    for (int v : colors[c]) {
      if (v < 0 || std::size_t(v) >= mesh.nodes.size())
        throw InvalidArgument(message("color ", c, " names node ", v, " of ", mesh.nodes.size()));
      if (color[std::size_t(v)] >= 0) throw InvalidArgument(message("node ", v, " has more than one color"));
      color[std::size_t(v)] = int(c);
    }
  for (std::size_t v = 0; v < color.size(); ++v)
    if (color[v] < 0) throw InvalidArgument(message("node ", v, " has no color"));
  for (const auto& t : mesh.tets)
    for (int a = 0; a < mesh.nodes_per_tet(); ++a)
      for (int b = 0; b < a; ++b)
        if (color[std::size_t(t[std::size_t(a)])] == color[std::size_t(t[std::size_t(b)])])
          throw InvalidArgument(
              message("nodes ", t[std::size_t(a)], " and ", t[std::size_t(b)], " of one tetrahedron have one color"));
}

}  // namespace lumo
