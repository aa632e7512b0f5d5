#pragma once

#include "lumo/core/units.hpp"
#include "lumo/fabrication/casting_layout.hpp"
#include "lumo/fabrication/faceted_solid.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace lumo {

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

/// Outline (y, z) of the core that keeps a void free, counter-clockwise seen along −x [m]: a bar of the void's height
/// from one end of the cavity out through the other, a handle behind it, and a step that stops at the mould.
inline std::vector<std::array<double, 2>> core_outline(const HalfSection& s, const CastingOptions& o = {}) {
  const CastingLayout at(s, o);
  constexpr double handle = 10.0e-3;
  const double inner = CastingLayout::has_cap(s) ? -at.stem_high : -at.half_length, outer = at.mould_y - at.middle_y;
  std::vector<std::array<double, 2>> outline{{inner, 0.0}, {outer, 0.0}, {outer, -at.rim}, {outer + handle, -at.rim},
      {outer + handle, at.stem_height}, {inner, at.stem_height}};
  if (at.pour > 0.0) return outline;
  for (auto& p : outline) p[0] = -p[0];
  std::reverse(outline.begin(), outline.end());
  return outline;
}

/// The core of the void at x > 0, as thick as the void is wide; the other one is the same, shifted. It comes out at the
/// end that is poured. Throws InvalidArgument for a design without voids, MeshError.
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

/// The bar that fills the slot below an LED strip whose LEDs lie in recesses, and holds the strip up; the wires go past
/// its end. Throws InvalidArgument for a stem without recesses, MeshError.
inline TriangleSurface led_bar_solid(const HalfSection& s, const CastingOptions& o = {}) {
  validate(o, s);
  const CastingLayout at(s, o);
  require_positive("depth of the LEDs' recesses", (at.stem_height - at.recess_floor) * 1e3, "mm");
  const auto level = [&](double z) {
    return detail::rectangle(
        -0.5 * o.strip_width, 0.5 * o.strip_width, CastingLayout::duct_length - at.strip_y, at.strip_y, z);
  };
  const auto low = level(at.seat - at.plate), high = level(at.pocket_floor);
  FacetedSolid solid;
  solid.band(low, high);
  solid.face(reversed(low));
  solid.face(high);
  return solid.surface();
}

}  // namespace lumo
