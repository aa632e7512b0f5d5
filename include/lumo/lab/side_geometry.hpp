#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/body.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace lumo {

/// What a pad's side looks like, apart from the light itself.
struct SideGeometry {
  double half_width_m = 14.75_mm;       ///< of the pad: the facing side is taken as the plane x = half_width_m
  double half_length_m = 30.0_mm;       ///< where the pad ends along y
  double low_m = 0.0, high_m = 9.0_mm;  ///< heights between which light leaves the visible side
  double lamp_height_m = 5.0_mm;        ///< z of the LEDs
  double refractive_index = 1.41;
  std::vector<double> lamp_m{-22.0_mm, -11.0_mm, 0.0, 11.0_mm, 22.0_mm};
};

/// Of a body that is symmetric in x and y: its visible surface reaches as high as its regions do, found to 1 % of the
/// pad's height. Throws InvalidArgument for a body without LEDs or visible surface.
inline SideGeometry side_geometry(const Body& body) {
  if (body.emitters.empty() || body.vertices.empty())
    throw InvalidArgument("virtual lab: the pad has no LEDs or no surface");
  SideGeometry g{0.0, 0.0, 1e300, -1e300, body.emitters.front().center().z(), body.medium.refractive_index, {}};
  for (const Vec3d& v : body.vertices)
    g.half_width_m = std::max(g.half_width_m, v.x()), g.half_length_m = std::max(g.half_length_m, std::abs(v.y()));
  for (const Facet& f : body.facets) {
    if (f.patch < 0 || !body.patches[std::size_t(f.patch)].contactable) continue;
    for (std::size_t k = 0; k < f.loop.size(); ++k)
      for (int part = 0; part <= 64; ++part) {
        const Vec3d &a = body.vertices[std::size_t(f.loop[k])],
                    &b = body.vertices[std::size_t(f.loop[(k + 1) % f.loop.size()])];
        Vec3d p = a + part / 64.0 * (b - a);
        p.y() = 0.0;
        p = closest_point(body.patches[std::size_t(f.patch)].shape, p);
        if (body.region(p, outward_normal(body, f.patch, p)) < 0) continue;
        g.low_m = std::min(g.low_m, p.z()), g.high_m = std::max(g.high_m, p.z());
      }
  }
  if (!(g.high_m > g.low_m))
    throw InvalidArgument("virtual lab: no part of the pad's surface is visible from the side");
  for (const Emitter& e : body.emitters) g.lamp_m.push_back(e.center().y());
  std::sort(g.lamp_m.begin(), g.lamp_m.end());
  g.lamp_m.erase(std::unique(g.lamp_m.begin(), g.lamp_m.end()), g.lamp_m.end());  // one on each side
  return g;
}

}  // namespace lumo
