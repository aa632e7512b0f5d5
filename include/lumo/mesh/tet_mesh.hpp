#pragma once

#include "lumo/core/types.hpp"

#include <array>
#include <vector>

namespace lumo {

/// Nodes lie within this of the origin [m]; lengths far beyond have no finite squares.
inline constexpr double largest_coordinate_m = 1e6;

/// Boundary triangle of a tetrahedral mesh, counter-clockwise seen from outside.
/// Nodes: three corners, then the middles of edges 01, 12, 20 (−1 in a linear mesh).
struct BoundaryFace {
  std::array<int, 6> nodes;
  int patch;  ///< index into Body::patches
};

/// Corners at the ends of a tetrahedron's edges, in the order of their middle nodes.
inline constexpr int tet_edges[6][2] = {{0, 1}, {1, 2}, {0, 2}, {0, 3}, {1, 3}, {2, 3}};

/// Corners of the face opposite to corner i of a positive tetrahedron, counter-clockwise seen from outside.
inline constexpr std::array<std::array<int, 3>, 4> outward_faces{{{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}};

/// Tetrahedral mesh of the *whole* body in its reference configuration.
/// Tet nodes: corners 0…3 (positive orientation), then the middles of tet_edges (−1 in a linear mesh).
struct TetMesh {
  int order = 2;             ///< 1 linear, 2 quadratic
  std::vector<Vec3d> nodes;  ///< [m]
  std::vector<std::array<int, 10>> tets;
  std::vector<BoundaryFace> faces;      ///< the closed boundary, patch by patch
  Symmetry symmetry;                    ///< planes in which the mesh is its own exact mirror image
  std::vector<int> mirror_x, mirror_y;  ///< node → its mirror image in x = 0 and y = 0 (empty without symmetry)

  int nodes_per_tet() const { return order == 2 ? 10 : 4; }
  int nodes_per_face() const { return order == 2 ? 6 : 3; }
};

}  // namespace lumo
