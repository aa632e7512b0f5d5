#pragma once

#include "lumo/mechanics/contact/first_touch.hpp"
#include "lumo/mesh/body_mesh.hpp"
#include "lumo/mesh/size_field.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace lumo {

namespace detail {

// Nearer than this part of the tool's contact radius, a surface counts as touched with it; places nearer to each other
// than the next one are one. A ball that touches a plane has one, whatever its size.
inline constexpr double near_part = 0.01, apart_part = 0.25;

// Calls visit(point of the exact surface) on a lattice over a face, at most `spacing` apart.
template <class Visit>
void for_points_on(const BoundaryFace& f, const TetMesh& mesh, const Shape& shape, double spacing, Visit&& visit) {
  constexpr int most_cuts = 40;
  const Vec3d a = mesh.nodes[std::size_t(f.nodes[0])], b = mesh.nodes[std::size_t(f.nodes[1])] - a,
              c = mesh.nodes[std::size_t(f.nodes[2])] - a;
  const double longest = std::max({b.norm(), c.norm(), (c - b).norm()});
  const int cuts = int(std::clamp(std::ceil(longest / spacing), 1.0, double(most_cuts)));
  for (int i = 0; i <= cuts; ++i)
    for (int j = 0; i + j <= cuts; ++j) visit(closest_point(shape, a + (double(i) * b + double(j) * c) / cuts));
}

}  // namespace detail

/// Places where the surface is as good as touched when the indenter first touches it: the place of first touch, and
/// others that stand for what lies farther along a line, on a face, or under a second part of the tool. Throws
/// InvalidArgument when the indenter passes by.
template <Indenter Tool>
std::vector<Vec3d> touched_places(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario) {
  const Touch touch = first_touch(body, mesh, scenario);
  const double radius = contact_radius(scenario.indenter), apart = detail::apart_part * radius,
               near = detail::near_part * radius;
  std::vector<Vec3d> places = {touch.point};
  for (const BoundaryFace& f : mesh.faces) {
    const Patch& patch = body.patches[std::size_t(f.patch)];
    if (!patch.contactable) continue;
    const Vec3d corner = mesh.nodes[std::size_t(f.nodes[0])];
    const double size = std::max(
        (mesh.nodes[std::size_t(f.nodes[1])] - corner).norm(), (mesh.nodes[std::size_t(f.nodes[2])] - corner).norm());
    if (scenario.indenter.distance(corner - touch.origin) > 2.0 * size + near) continue;
    detail::for_points_on(f, mesh, patch.shape, 0.5 * apart, [&](const Vec3d& p) {
      if (scenario.indenter.distance(p - touch.origin) > near) return;
      for (const Vec3d& known : places)
        if ((p - known).norm() < apart) return;
      places.push_back(p);
    });
  }
  return places;
}

/// The body with its mesh sizing refined where the scenarios' indenters first touch it (touched_places), and in the
/// mirror images of those places. `coarse` is any mesh of the body. Throws InvalidArgument when an indenter passes by.
template <Indenter Tool> Body focused_on_contact(
    const Body& body, const TetMesh& coarse, const std::vector<Scenario<Tool>>& scenarios, const Focus& focus = {}) {
  std::vector<Vec3d> touches;
  Focus fine = focus;
  for (const Scenario<Tool>& s : scenarios) {
    const std::vector<Vec3d> touched = touched_places(body, coarse, s);
    touches.insert(touches.end(), touched.begin(), touched.end());
    fine.finest = std::min(fine.finest, focus.of_tool * contact_radius(s.indenter));
  }
  return focused(body, touches, fine);
}

/// A mesh of that body. Throws MeshError when it cannot be meshed.
template <Mesher M, Indenter Tool> TetMesh mesh_for_contact(const Body& body, const TetMesh& coarse,
    const std::vector<Scenario<Tool>>& scenarios, const M& mesher, const Focus& focus = {}, int order = 2) {
  return mesh_body(focused_on_contact(body, coarse, scenarios, focus), mesher, order);
}

}  // namespace lumo
