#pragma once

#include "lumo/core/units.hpp"
#include "lumo/fabrication/casting_options.hpp"
#include "lumo/fabrication/faceted_solid.hpp"

#include <array>
#include <cmath>
#include <vector>

namespace lumo {

/// The rigid carrier: a plate with mounting holes, and on it the stem with a pocket for the LED strip and a duct for
/// its wires through the plate. The stem is a clearance shorter than the pad, so that it goes between the mould's ends.
/// The carrier stands on z = −plate. Throws InvalidArgument, MeshError.
inline TriangleSurface carrier_solid(const HalfSection& section, const CastingOptions& options = {});

namespace detail {

/// Corners of a regular polygon in a circle, in the plane of u and v, counter-clockwise seen from u × v.
inline std::vector<Vec3d> ring(const Vec3d& center, const Vec3d& u, const Vec3d& v, double radius, int corners = 32) {
  std::vector<Vec3d> loop;
  for (int k = 0; k < corners; ++k)
    loop.push_back(center + radius * (std::cos(2.0 * pi * k / corners) * u + std::sin(2.0 * pi * k / corners) * v));
  return loop;
}

/// A rectangle in a plane of constant z, counter-clockwise seen from above.
inline std::vector<Vec3d> rectangle(double x0, double x1, double y0, double y1, double z) {
  return {{x0, y0, z}, {x1, y0, z}, {x1, y1, z}, {x0, y1, z}};
}

}  // namespace detail

inline TriangleSurface carrier_solid(const HalfSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  const double bottom = -o.plate, stem_y = at.half_length - 0.5 * o.clearance;
  FacetedSolid solid;
  const auto plate = [&](double z) { return detail::rectangle(-at.plate_x, at.plate_x, -at.plate_y, at.plate_y, z); };
  const auto stem = [&](double z) { return detail::rectangle(-at.stem_x, at.stem_x, -stem_y, stem_y, z); };
  const auto pocket = [&](double z) {
    return detail::rectangle(-at.pocket_x, at.pocket_x, -at.pocket_y, at.pocket_y, z);
  };
  const auto duct = [&](double z) {
    return detail::rectangle(
        -0.5 * o.strip_width, 0.5 * o.strip_width, -at.strip_y, CastingLayout::duct_length - at.strip_y, z);
  };
  const auto holes = [&](double z) {
    std::vector<std::vector<Vec3d>> loops;
    for (const double x : {-1.0, 1.0})
      for (const double y : {-1.0, 1.0})
        loops.push_back(reversed(
            detail::ring(Vec3d(x * (at.half_width - CastingLayout::hole_inset), y * (at.half_length + 0.5 * o.tab), z),
                Vec3d::UnitX(), Vec3d::UnitY(), 0.5 * o.hole_diameter)));
    return loops;
  };
  auto below = holes(bottom), above = holes(0.0);
  for (std::size_t k = 0; k < below.size(); ++k) solid.band(below[k], above[k]);
  solid.band(plate(bottom), plate(0.0));
  solid.band(stem(0.0), stem(at.stem_height));
  solid.band(reversed(duct(bottom)), reversed(duct(at.pocket_floor)));
  solid.band(reversed(pocket(at.pocket_floor)), reversed(pocket(at.stem_height)));

  std::vector<std::vector<Vec3d>> openings;  // seen from below
  for (const auto& loop : below) openings.push_back(reversed(loop));
  openings.push_back(duct(bottom));
  solid.face(reversed(plate(bottom)), openings);
  above.push_back(reversed(stem(0.0)));
  solid.face(plate(0.0), above);
  solid.face(pocket(at.pocket_floor), {reversed(duct(at.pocket_floor))});
  solid.face(stem(at.stem_height), {reversed(pocket(at.stem_height))});
  return solid.surface();
}

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
