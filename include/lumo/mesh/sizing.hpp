#pragma once

#include "lumo/core/error.hpp"
#include "lumo/morphology/body.hpp"

#include <algorithm>
#include <vector>

namespace lumo {

/// Mesh grading about the places where an indenter touches: the contact radius grows with the load, so edges that grow
/// in proportion to the distance resolve the edge of every contact equally well.
struct Focus {
  double finest = 0.2e-3;     ///< edge length at a place of touch [m]
  double growth = 0.1;        ///< edge length gained per distance from it
  double depth_growth = 0.7;  ///< and per depth below it: only the surface has to follow the edge of contact

  /// All edges `factor` times as long.
  constexpr Focus scaled(double factor) const { return {factor * finest, factor * growth, factor * depth_growth}; }
};

/// The body with its mesh sizing refined about the given points and their mirror images. Throws InvalidArgument.
inline Body focused(Body body, const std::vector<Vec3d>& points, const Focus& focus = {}) {
  require_in_range("finest mesh edge", focus.finest * 1e3, 0.02, 30.0, "mm");
  require_in_range("mesh growth about the contact", focus.growth, 0.01, 10.0, "");
  const Symmetry symmetry = body.symmetry;
  body.sizing.edge = [coarse = body.sizing.edge, points, focus, symmetry](const Vec3d& p) {
    double edge = coarse(p);
    for (Vec3d at : points) {
      if (symmetry.x) at.x() = std::abs(at.x());
      if (symmetry.y) at.y() = std::abs(at.y());
      const double depth = std::max(0.0, (at - p).z());
      edge = std::min(edge, focus.finest + focus.growth * (p - at).norm() + focus.depth_growth * depth);
    }
    return edge;
  };
  return body;
}

}  // namespace lumo
