#pragma once

#include "lumo/core/types.hpp"
#include "lumo/geometry/closed_surface.hpp"

#include <array>
#include <concepts>
#include <functional>
#include <vector>

namespace lumo {

/// A closed surface to be filled, with a wanted edge length. Vertices of no facet are interior points.
struct MeshInput : ClosedSurface {
  std::function<double(const Vec3d&)> edge;  ///< wanted edge length, same unit; may be empty
  bool keep_surface = false;                 ///< do not split the given facets
};

/// Straight tetrahedra that fill a MeshInput. Boundary triangles are counter-clockwise seen from outside and carry
/// their facet's patch.
struct LinearTets {
  std::vector<Vec3d> vertices;
  std::vector<std::array<int, 4>> tets;  ///< positive orientation: (b−a)×(c−a)·(d−a) > 0
  std::vector<std::array<int, 3>> faces;
  std::vector<int> patches;  ///< one per face
};

/// Fills a closed surface with tetrahedra. Law: same input, same bits. Throws MeshError, never anything else.
template <class M>
concept Mesher = requires(const M& mesher, const MeshInput& input) {
  { mesher.fill(input) } -> std::same_as<LinearTets>;
};

}  // namespace lumo
