#pragma once

#include "lumo/mechanics/contact/scenario.hpp"
#include "lumo/mechanics/indenters/indenter.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "lumo/morphology/body.hpp"

#include <limits>
#include <string>

namespace lumo {

/// Where an indenter that comes along a line first meets the exact undeformed surface.
struct Touch {
  Vec3d origin;  ///< of the indenter's frame at first touch [m]
  Vec3d point;   ///< of the surface [m]
};

/// First touch with the body's contactable patches, on their exact shapes (never on facets), to 10 nm for convex tools
/// with edges and far better for round ones. The mesh bounds the patches. Throws InvalidArgument when the
/// indenter passes by, with what is known of why: no patch may be touched, it meets one that may not, or the tool lies
/// far off its own origin, which is what comes along the line.
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

namespace detail {

// The line on which an indenter comes.
template <Indenter Tool> struct ApproachLine {
  const Tool& tool;
  Vec3d start;  // of the tool's origin, clear of the body [m]
  Vec3d direction;
  double reach_m;

  double advance_to(const Vec3d& p) const { return lumo::advance_to(tool, start, direction, p, 2.0 * reach_m); }
};

// The first touch on one patch, or on its image in symmetry planes. Points are folded into the patch's own quarter.
template <Indenter Tool> struct PatchSearch {
  static constexpr double first_step = 0.1;    // of the box's diagonal
  static constexpr double finest_step = 1e-9;  // [m]: the advance is quadratic about its minimum
  static constexpr int directions = 8;
  static constexpr int most_moves = 1000;  // with one step: where rounding makes gains, there is no end to them

  const ApproachLine<Tool>& line;
  const Patch& patch;
  double sign_x, sign_y;  // −1: the image
  double slack_m;
  Vec3d low = Vec3d::Constant(std::numeric_limits<double>::infinity());  // box of the patch's nodes: it trims the shape
  Vec3d high = -low;
  Vec3d seed = Vec3d::Zero();
  double nearest = std::numeric_limits<double>::infinity();

  Vec3d fold(const Vec3d& p) const { return Vec3d(sign_x * p.x(), sign_y * p.y(), p.z()); }
  Vec3d into_box(const Vec3d& p) const { return elementwise_min(elementwise_max(p, low), high); }
  bool inside(const Vec3d& p) const {
    for (int axis = 0; axis < 3; ++axis)
      if (!(p[axis] >= low[axis] - slack_m && p[axis] <= high[axis] + slack_m)) return false;
    return true;
  }
  bool try_seed(const Vec3d& q, double gain) {
    const double s = line.advance_to(fold(q));
    if (!(s < nearest - gain)) return false;
    nearest = s;
    seed = q;
    return true;
  }

  void add_nodes(const TetMesh& mesh, int patch_number, Symmetry planes) {
    for (const BoundaryFace& f : mesh.faces) {
      if (f.patch != patch_number) continue;
      for (std::size_t k = 0; k < std::size_t(mesh.nodes_per_face()); ++k) {
        const Vec3d q = fold(mesh.nodes[std::size_t(f.nodes[k])]);
        if ((planes.x && q.x() < 0) || (planes.y && q.y() < 0)) continue;
        low = elementwise_min(low, q);
        high = elementwise_max(high, q);
        try_seed(q, 0.0);
      }
    }
  }
  bool empty() const { return !(low.x() <= high.x()); }

  // Nodes may be too far apart for a small tool: also start from where the tool's centre line comes closest.
  void follow_line() {
    const double radius = line.tool.radius_m();
    for (double s = 0.0; s < 2.0 * line.reach_m;) {
      const Vec3d center = fold(line.start + s * line.direction);
      const Vec3d q = closest_point(patch.shape, into_box(center));
      const double apart = (q - center).norm();
      if (inside(q) && apart < 1.01 * radius) try_seed(q, 0.0);
      s += std::max(0.2 * apart, 1e-3 * radius);
    }
  }

  // Pattern search on the exact shape, in directions that turn by `spin` after each round; an advance shorter by less
  // than `gain` is no gain.
  void refine(double spin, double gain) {
    double spun = 0.0;
    for (double step = first_step * (high - low).norm(); step > finest_step; step *= 0.5)
      for (int moves = 0, moved = 1; moved && moves < most_moves; ++moves, spun += spin) {
        moved = 0;
        const Vec3d n = outward_normal(patch.shape, seed);
        const Vec3d u = n.unitOrthogonal(), v = n.cross(u);
        for (int k = 0; k < directions; ++k) {
          const double turn = 0.25 * pi * k + spun;
          const Vec3d trial =
              closest_point(patch.shape, into_box(seed + step * (std::cos(turn) * u + std::sin(turn) * v)));
          if (inside(trial) && try_seed(trial, gain)) moved = 1;
        }
      }
  }
};

// A scenario's tool in a message.
template <Indenter Tool> std::string approach(const Scenario<Tool>& s) {
  return message("the indenter at ", s.x_m == 0.0 ? "" : message("x = ", s.x_m * 1e3, " mm, "), "y = ", s.y_m * 1e3,
      " mm and ", s.angle_rad * 180 / pi, " deg");
}

// Why a tool on this line touches nothing.
template <Indenter Tool>
std::string passing_by(const Body& body, const TetMesh& mesh, const std::string& what, const ApproachLine<Tool>& line) {
  bool may_touch = false;
  int met = -1;
  double nearest = std::numeric_limits<double>::infinity();
  for (const BoundaryFace& f : mesh.faces) {
    if (body.patches[std::size_t(f.patch)].contactable) {
      may_touch = true;
      continue;
    }
    for (std::size_t k = 0; k < std::size_t(mesh.nodes_per_face()); ++k)
      if (const double s = line.advance_to(mesh.nodes[std::size_t(f.nodes[k])]); s < nearest) {
        nearest = s;
        met = f.patch;
      }
  }
  if (!may_touch) return what + " touches nothing: no patch of the body is contactable";
  if (met >= 0)
    return message(
        what, " meets patch \"", printable(body.patches[std::size_t(met)].name), "\", which may not be touched");
  const double off = line.tool.distance(Vec3d(0.0, 0.0, 0.0));
  return what + " passes by the body" +
         (off > contact_radius(line.tool) ? message("; the tool lies ", off * 1e3, " mm off its own origin") : "");
}

}  // namespace detail

template <Indenter Tool> Touch first_touch(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario) {
  validate(scenario);
  const Vec3d direction = scenario.direction();
  double size = 0.0;
  for (const Vec3d& p : mesh.nodes) size = std::max(size, p.norm());
  const Vec3d shift(scenario.x_m, scenario.y_m, 0.0);
  const double reach = 2.0 * size + 2.0 * scenario.indenter.radius_m() + shift.norm();
  const Vec3d start = body.pivot + shift - reach * direction;
  const detail::ApproachLine<Tool> line{scenario.indenter, start, direction, reach};

  double best = std::numeric_limits<double>::infinity();
  Vec3d point = Vec3d::Zero();
  for (std::size_t patch = 0; patch < body.patches.size(); ++patch) {
    if (!body.patches[patch].contactable) continue;
    for (int image = 0; image < 4; ++image) {
      const double sx = image & 1 ? -1.0 : 1.0, sy = image & 2 ? -1.0 : 1.0;
      if ((sx < 0 && !body.symmetry.x) || (sy < 0 && !body.symmetry.y)) continue;
      detail::PatchSearch<Tool> search{line, body.patches[patch], sx, sy, 1e-12 * size};
      search.add_nodes(mesh, int(patch), body.symmetry);
      if (search.empty()) continue;
      search.follow_line();
      if (!std::isfinite(search.nearest)) continue;
      search.refine(0.0, 1e-16);
      // Edges of a tool put kinks into the advance, at which fixed directions can get stuck; directions that never
      // repeat do not (Audet, Dennis 2006).
      constexpr double golden = 0.61803398875;
      search.refine(0.25 * pi * golden, 1e-12);
      if (search.nearest < best) {
        best = search.nearest;
        point = search.fold(search.seed);
      }
    }
  }
  if (!std::isfinite(best)) throw InvalidArgument(detail::passing_by(body, mesh, detail::approach(scenario), line));
  return {start + best * direction, point};
}

}  // namespace lumo
