#pragma once

#include "lumo/mechanics/contact/scenario.hpp"
#include "lumo/mechanics/indenters/indenter.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "lumo/morphology/body.hpp"

#include <limits>
#include <vector>

namespace lumo {

/// Where an indenter that comes along a line first meets the exact undeformed surface.
struct Touch {
  Vec3d origin;  ///< of the indenter's frame at first touch [m]
  Vec3d point;   ///< of the surface [m]
};

/// First touch with the body's contactable patches, on their exact shapes (never on facets), to 10 nm for convex tools
/// with edges and far better for round ones. The mesh only says where a patch ends. Throws InvalidArgument when the
/// indenter passes by.
template <Indenter Tool> Touch first_touch(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario);

// How far the tool can advance from `start` until it reaches p: sphere tracing, because distance is 1-Lipschitz. +∞: it
// passes by.
template <Indenter Tool>
double advance_to(const Tool& tool, const Vec3d& start, const Vec3d& direction, const Vec3d& p, double limit) {
  double s = 0.0, before = 0.0;
  for (int i = 0; i < 500; ++i) {
    const double gap = tool.distance(p - start - s * direction);
    if (gap < -1e-12) {  // a distance that is not quite one was too long: back to its zero
      for (int k = 0; k < 60; ++k) {
        const double middle = 0.5 * (before + s);
        (tool.distance(p - start - middle * direction) > 0.0 ? before : s) = middle;
      }
      return s;
    }
    if (gap < 1e-15) return s;
    before = s;
    s += gap;
    if (s > limit) break;
  }
  return s > limit ? std::numeric_limits<double>::infinity() : s;
}

template <Indenter Tool> Touch first_touch(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario) {
  const Vec3d direction = scenario.direction();
  double size = 0.0;
  for (const Vec3d& p : mesh.nodes) size = std::max(size, p.norm());
  const double reach = 2.0 * size + 2.0 * scenario.indenter.radius_m() + std::abs(scenario.y_m);
  const Vec3d start = body.pivot + Vec3d(0, scenario.y_m, 0) - reach * direction;

  double best = std::numeric_limits<double>::infinity();
  Vec3d point = Vec3d::Zero();
  for (std::size_t patch = 0; patch < body.patches.size(); ++patch) {
    if (!body.patches[patch].contactable) continue;
    // The patch's box trims its shape; images in symmetry planes are searched as one patch each.
    for (int image = 0; image < 4; ++image) {
      const double sx = image & 1 ? -1.0 : 1.0, sy = image & 2 ? -1.0 : 1.0;
      if ((sx < 0 && !body.symmetry.x) || (sy < 0 && !body.symmetry.y)) continue;
      const auto fold = [&](const Vec3d& p) { return Vec3d(sx * p.x(), sy * p.y(), p.z()); };
      Vec3d low = Vec3d::Constant(std::numeric_limits<double>::infinity()), high = -low, seed = Vec3d::Zero();
      double nearest = std::numeric_limits<double>::infinity();
      for (const BoundaryFace& f : mesh.faces) {
        if (f.patch != int(patch)) continue;
        for (std::size_t k = 0; k < std::size_t(mesh.nodes_per_face()); ++k) {
          const Vec3d q = fold(mesh.nodes[std::size_t(f.nodes[k])]);
          if ((body.symmetry.x && q.x() < 0) || (body.symmetry.y && q.y() < 0)) continue;
          low = elementwise_min(low, q);
          high = elementwise_max(high, q);
          const double s = advance_to(scenario.indenter, start, direction, fold(q), 2.0 * reach);
          if (s < nearest) nearest = s, seed = q;
        }
      }
      if (!(low.x() <= high.x())) continue;  // no face
      const double slack = 1e-12 * size;
      const auto into_box = [&](const Vec3d& p) { return elementwise_min(elementwise_max(p, low), high); };
      const auto inside = [&](const Vec3d& p) {
        for (int axis = 0; axis < 3; ++axis)
          if (!(p[axis] >= low[axis] - slack && p[axis] <= high[axis] + slack)) return false;
        return true;
      };
      // Nodes may be too far apart for a small tool: also start from where the tool's centre line comes closest.
      for (double s = 0.0; s < 2.0 * reach;) {
        const Vec3d center = fold(start + s * direction);
        const Vec3d q = closest_point(body.patches[patch].shape, into_box(center));
        const double apart = (q - center).norm();
        if (inside(q) && apart < 1.01 * scenario.indenter.radius_m())
          if (const double t = advance_to(scenario.indenter, start, direction, fold(q), 2.0 * reach); t < nearest)
            nearest = t, seed = q;
        s += std::max(0.2 * apart, 1e-3 * scenario.indenter.radius_m());
      }
      if (!std::isfinite(nearest)) continue;
      const auto search = [&](double first_step, double spin, double gain) {
        double spun = 0.0;
        for (double step = first_step; step > 1e-9; step *= 0.5)
          for (bool moved = true; moved; spun += spin) {
            moved = false;
            const Vec3d n = outward_normal(body.patches[patch].shape, seed);
            const Vec3d u = n.unitOrthogonal(), v = n.cross(u);
            for (int k = 0; k < 8; ++k) {
              const double turn = 0.25 * pi * k + spun;
              const Vec3d trial = closest_point(body.patches[patch].shape,
                                                into_box(seed + step * (std::cos(turn) * u + std::sin(turn) * v)));
              if (!inside(trial)) continue;
              const double s = advance_to(scenario.indenter, start, direction, fold(trial), 2.0 * reach);
              if (s < nearest - gain) nearest = s, seed = trial, moved = true;
            }
          }
      };
      // Pattern search on the exact shape: the advance is quadratic about its minimum, so 1 nm of place is far below
      // any depth that matters.
      search(0.1 * (high - low).norm(), 0.0, 1e-16);
      // Edges of a tool put kinks into the advance, at which fixed directions can get stuck; directions that never
      // repeat do not (Audet, Dennis 2006).
      search(0.1 * (high - low).norm(), 0.25 * pi * 0.61803398875, 1e-12);
      if (nearest < best) best = nearest, point = fold(seed);
    }
  }
  if (!std::isfinite(best))
    throw InvalidArgument(message("the indenter at y = ", scenario.y_m * 1e3, " mm and ", scenario.angle_rad * 180 / pi,
                                  " deg passes by the body"));
  return {start + best * direction, point};
}

}  // namespace lumo
