#pragma once

#include "lumo/core/types.hpp"

#include <vector>

namespace lumo {

/// A flat polygon of a surface, by vertex numbers, counter-clockwise seen from outside.
struct Facet {
  std::vector<int> loop;
  int patch = -1;  ///< number of the part of the surface that it belongs to; negative: of none
};

/// A closed polyhedral surface.
struct ClosedSurface {
  std::vector<Vec3d> vertices;  ///< [m] or any unit: what reads it is scale-free
  std::vector<Facet> facets;    ///< closed, manifold, counter-clockwise seen from outside
};

}  // namespace lumo
