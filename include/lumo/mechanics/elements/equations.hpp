#pragma once

#include "lumo/mechanics/elements/linear_solver.hpp"
#include "lumo/mesh/sector.hpp"
#include "lumo/morphology/body.hpp"

#include <algorithm>
#include <vector>

namespace lumo {

/// How a displacement field behaves under reflection in the planes that bound a sector.
struct Parity {
  bool odd_x = false;
  bool odd_y = false;
  bool operator==(const Parity&) const = default;
};

/// Numbers the free displacement components of a sector's nodes, and holds the sparsity pattern of its tangent.
/// Bonded faces are closed sets: all their nodes are fixed. On a bounding plane an even field has no normal component
/// and an odd field has only that one.
struct Equations {
  std::vector<int> of;  ///< 3 · node + component → equation, −1 where fixed
  int count = 0;
  SparseLower pattern;     ///< lower triangle; values are scratch
  std::vector<int> slots;  ///< per tet, (3N)(3N+1)/2 positions in the pattern's values (row ≥ column, column by
                           ///< column), −1 where fixed

  Equations(const Sector& sector, const Body& body, Parity parity);

  /// Position in the pattern's values of an entry of the lower triangle.
  int slot(int row, int column) const;
};

inline int Equations::slot(int row, int column) const {
  if (row < column) std::swap(row, column);
  const int* begin = pattern.innerIndexPtr() + pattern.outerIndexPtr()[column];
  const int* end = pattern.innerIndexPtr() + pattern.outerIndexPtr()[column + 1];
  return int(std::lower_bound(begin, end, row) - pattern.innerIndexPtr());
}

inline Equations::Equations(const Sector& sector, const Body& body, Parity parity) {
  const TetMesh& mesh = sector.mesh;
  const std::size_t n = mesh.nodes.size();
  std::vector<char> fixed(3 * n, 0);
  for (const BoundaryFace& f : mesh.faces)
    if (body.patches[std::size_t(f.patch)].bonded)
      for (int k = 0; k < mesh.nodes_per_face(); ++k)
        for (std::size_t c = 0; c < 3; ++c) fixed[3 * std::size_t(f.nodes[std::size_t(k)]) + c] = 1;
  const auto bound = [&](std::size_t node, std::size_t axis, bool odd) {
    for (std::size_t c = 0; c < 3; ++c)
      if ((c == axis) != odd) fixed[3 * node + c] = 1;
  };
  for (std::size_t k = 0; k < n; ++k) {
    if (sector.planes.x && mesh.nodes[k].x() == 0.0) bound(k, 0, parity.odd_x);
    if (sector.planes.y && mesh.nodes[k].y() == 0.0) bound(k, 1, parity.odd_y);
  }
  of.assign(3 * n, -1);
  for (std::size_t i = 0; i < 3 * n; ++i)
    if (!fixed[i]) of[i] = count++;

  // Node graph first (compact), then the equations of each pair of nodes.
  const std::size_t per = std::size_t(mesh.nodes_per_tet());
  std::vector<std::vector<int>> near(n);
  for (const auto& t : mesh.tets)
    for (std::size_t a = 0; a < per; ++a)
      for (std::size_t b = 0; b < per; ++b) near[std::size_t(t[a])].push_back(t[b]);
  for (auto& list : near) {
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
  }
  std::vector<int> starts{0}, rows;
  for (std::size_t k = 0; k < n; ++k)
    for (std::size_t c = 0; c < 3; ++c) {
      const int column = of[3 * k + c];
      if (column < 0) continue;
      for (int other : near[k])
        for (std::size_t d = 0; d < 3; ++d)
          if (const int row = of[3 * std::size_t(other) + d]; row >= column) rows.push_back(row);
      starts.push_back(int(rows.size()));
    }
  const std::vector<double> zeros(rows.size(), 0.0);
  pattern = Eigen::Map<const SparseLower>(count, count, int(rows.size()), starts.data(), rows.data(), zeros.data());

  slots.reserve(mesh.tets.size() * (3 * per) * (3 * per + 1) / 2);
  for (const auto& t : mesh.tets)
    for (std::size_t j = 0; j < 3 * per; ++j)
      for (std::size_t i = j; i < 3 * per; ++i) {
        const int row = of[3 * std::size_t(t[i / 3]) + i % 3], column = of[3 * std::size_t(t[j / 3]) + j % 3];
        slots.push_back(row < 0 || column < 0 ? -1 : slot(row, column));
      }
}

}  // namespace lumo
