#pragma once

#include "lumo/core/units.hpp"
#include "lumo/fabrication/casting_options.hpp"
#include "lumo/fabrication/faceted_solid.hpp"

#include <cmath>
#include <vector>

namespace lumo {

/// The rigid carrier: a plate with mounting holes, and on it the ridge with a pocket for the LED strip and a duct for
/// its wires through the plate. The ridge is a clearance shorter than the pad, so that it goes between the mould's
/// ends. Stands on z = −plate. Throws InvalidArgument, MeshError.
inline TriangleSurface carrier_solid(const CastSection& section, const CastingOptions& options = {});

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

inline TriangleSurface carrier_solid(const CastSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  const double bottom = -o.plate, ridge_x = 0.5 * s.ridge_width, ridge_y = at.half_length - 0.5 * o.clearance;
  FacetedSolid solid;
  const auto plate = [&](double z) { return detail::rectangle(-at.plate_x, at.plate_x, -at.plate_y, at.plate_y, z); };
  const auto ridge = [&](double z) { return detail::rectangle(-ridge_x, ridge_x, -ridge_y, ridge_y, z); };
  const auto pocket = [&](double z) {
    return detail::rectangle(-at.pocket_x, at.pocket_x, -at.pocket_y, at.pocket_y, z);
  };
  const auto duct = [&](double z) {
    return detail::rectangle(-0.5 * o.strip_width, 0.5 * o.strip_width, -at.strip_y,
                             CastingLayout::duct_length - at.strip_y, z);
  };
  const auto holes = [&](double z) {
    std::vector<std::vector<Vec3d>> loops;
    for (const double x : {-1.0, 1.0})
      for (const double y : {-1.0, 1.0})
        loops.push_back(
            reversed(detail::ring(Vec3d(x * (at.half_width - 5.0e-3), y * (at.half_length + 0.5 * o.tab), z),
                                  Vec3d::UnitX(), Vec3d::UnitY(), 0.5 * o.hole_diameter)));
    return loops;
  };
  auto below = holes(bottom), above = holes(0.0);
  for (std::size_t k = 0; k < below.size(); ++k) solid.band(below[k], above[k]);
  solid.band(plate(bottom), plate(0.0));
  solid.band(ridge(0.0), ridge(s.ridge_height));
  solid.band(reversed(duct(bottom)), reversed(duct(at.pocket_floor)));
  solid.band(reversed(pocket(at.pocket_floor)), reversed(pocket(s.ridge_height)));

  std::vector<std::vector<Vec3d>> openings;  // seen from below
  for (const auto& loop : below) openings.push_back(reversed(loop));
  openings.push_back(duct(bottom));
  solid.face(reversed(plate(bottom)), openings);
  above.push_back(reversed(ridge(0.0)));
  solid.face(plate(0.0), above);
  solid.face(pocket(at.pocket_floor), {reversed(duct(at.pocket_floor))});
  solid.face(ridge(s.ridge_height), {reversed(pocket(s.ridge_height))});
  return solid.surface();
}

}  // namespace lumo
