#pragma once

#include "lumo/fabrication/casting_options.hpp"
#include "lumo/fabrication/faceted_solid.hpp"

#include <array>
#include <vector>

namespace lumo {

/// Outline (y, z) of the core that keeps a void free, counter-clockwise seen along −x [m]: a bar of the void's height
/// from one end of the cavity out through the other, a handle behind it, and a step that stops at the mould.
inline std::vector<std::array<double, 2>> core_outline(const HalfSection& s, const CastingOptions& o = {}) {
  const CastingLayout at(s, o);
  constexpr double handle = 10.0e-3;
  return {{-at.half_length, 0.0}, {at.mould_y, 0.0}, {at.mould_y, -o.rim}, {at.mould_y + handle, -o.rim},
      {at.mould_y + handle, at.stem_height}, {-at.half_length, at.stem_height}};
}

/// The core of the void at x > 0, as thick as the void is wide; the other one is the same, shifted. It comes out along
/// +y. Throws InvalidArgument for a design without voids, MeshError.
inline TriangleSurface core_solid(const HalfSection& s, const CastingOptions& o = {}) {
  validate(o, s);
  const CastingLayout at(s, o);
  require_positive("void width", at.void_width * 1e3, "mm");
  const auto side = [&](double x) {
    std::vector<Vec3d> loop;
    for (const auto& p : core_outline(s, o)) loop.emplace_back(x, p[0], p[1]);
    return loop;
  };
  const auto inner = side(at.stem_x), outer = side(at.void_x);
  FacetedSolid solid;
  solid.band(inner, outer);
  solid.face(reversed(inner));
  solid.face(outer);
  return solid.surface();
}

}  // namespace lumo
