#pragma once

#include "lumo/fabrication/casting_options.hpp"
#include "lumo/fabrication/faceted_solid.hpp"

#include <array>
#include <vector>

namespace lumo {

/// Outline (y, z) of the core that keeps a gap free, counter-clockwise seen along −x [m]: a bar of the gap's height
/// from one end of the cavity out through the other, a handle behind it, and a step that stops at the mould.
inline std::vector<std::array<double, 2>> core_outline(const CastSection& s, const CastingOptions& o = {}) {
  const CastingLayout at(s, o);
  constexpr double handle = 10.0e-3;
  return {{-at.half_length, 0.0},
          {at.mould_y, 0.0},
          {at.mould_y, -o.rim},
          {at.mould_y + handle, -o.rim},
          {at.mould_y + handle, s.ridge_height},
          {-at.half_length, s.ridge_height}};
}

/// The core of the gap at x > 0, as thick as the gap is wide; the other one is the same, shifted. It comes out along
/// +y. Throws InvalidArgument where there is no gap, MeshError.
inline TriangleSurface core_solid(const CastSection& s, const CastingOptions& o = {}) {
  validate(o, s);
  require_positive("gap width", s.gap_width * 1e3, "mm");
  const auto side = [&](double x) {
    std::vector<Vec3d> loop;
    for (const auto& p : core_outline(s, o)) loop.emplace_back(x, p[0], p[1]);
    return loop;
  };
  const auto inner = side(0.5 * s.ridge_width), outer = side(0.5 * s.ridge_width + s.gap_width);
  FacetedSolid solid;
  solid.band(inner, outer);
  solid.face(reversed(inner));
  solid.face(outer);
  return solid.surface();
}

}  // namespace lumo
