#pragma once

#include "lumo/mechanics/contact/contact_edge.hpp"
#include "lumo/mechanics/contact/contact_surface.hpp"
#include "lumo/mechanics/contact/state.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

namespace lumo::detail {

// A point of a surface that something presses on.
struct PressedPoint {
  std::size_t face;
  const SurfacePoint* point;
  Vec3d reference;  // undeformed
  double force_N;   // along the normal
};

// Part of each node's area that presses.
inline std::vector<double> bearing(
    const ContactSurface& surface, const std::vector<PressedPoint>& pressed, const SurfaceNodes& nodes) {
  std::vector<double> part(nodes.size(), 0.0);
  for (const PressedPoint& p : pressed) {
    const std::array<int, 3> node = surface.sub_triangle(p.face, std::size_t(p.point->part));
    for (std::size_t k = 0; k < 3; ++k) part[nodes.at(node[k])] += p.point->area_m2 * p.point->hat[k];
  }
  for (std::size_t k = 0; k < part.size(); ++k)
    if (part[k] > 0.0) part[k] /= nodes.area[k];
  return part;
}

// Adds area, rim and the nodes' spacing along it.
inline void measure_spots(const SurfaceNodes& nodes, const ContactEdge& edge, std::vector<ContactSpot>& spots) {
  for (const std::array<int, 3>& t : nodes.triangles) {
    std::array<Vec3d, 3> place;
    std::array<double, 3> field;
    double spacing = 0.0;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t node = std::size_t(t[k]);
      place[k] = nodes.place[node];
      field[k] = edge.field()[node];
      spacing += edge.spacing(node) / 3.0;
    }
    const RimCut cut = cut_at_rim(place, field);
    const int part = cut.area > 0.0 ? edge.part_of(t, cut.lone) : -1;
    if (part < 0) continue;
    ContactSpot& spot = spots[std::size_t(part)];
    spot.area_m2 += cut.area;
    spot.rim_m += cut.rim;
    spot.edge_m += cut.rim * spacing;
  }
}

// The separate contacts of an edge, those that press hardest first; what presses beside all of them is one, too.
inline std::vector<ContactSpot> contact_spots(const ContactSurface& surface, const std::vector<PressedPoint>& pressed,
    const SurfaceNodes& nodes, const ContactEdge& edge) {
  std::vector<ContactSpot> spots(edge.parts() + 1);
  measure_spots(nodes, edge, spots);
  std::vector<double> bearing_edge(spots.size(), 0.0);
  for (const PressedPoint& p : pressed) {
    const std::array<int, 3> node = surface.sub_triangle(p.face, std::size_t(p.point->part));
    double field = 0.0;
    std::size_t nearest = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      field += p.point->hat[k] * edge.field()[nodes.at(node[k])];
      if (p.point->hat[k] > p.point->hat[nearest]) nearest = k;
    }
    const std::size_t at = nodes.at(node[nearest]);
    const std::size_t part = edge.part_of_node(at) >= 0 ? std::size_t(edge.part_of_node(at)) : edge.parts();
    ContactSpot& spot = spots[part];
    spot.force_N += p.force_N;
    spot.reference_m += p.force_N * p.reference;
    bearing_edge[part] += p.force_N * edge.spacing(at);
    if (!(field > 0.0)) spot.force_outside_N += p.force_N;
  }
  for (std::size_t k = 0; k < spots.size(); ++k) {
    ContactSpot& s = spots[k];
    if (!(s.force_N > 0.0)) continue;
    s.reference_m /= s.force_N;
    s.edge_m = s.rim_m > 0.0 ? s.edge_m / s.rim_m : bearing_edge[k] / s.force_N;
  }
  std::erase_if(spots, [](const ContactSpot& s) { return !(s.force_N > 0.0); });
  std::stable_sort(
      spots.begin(), spots.end(), [](const ContactSpot& a, const ContactSpot& b) { return a.force_N > b.force_N; });
  return spots;
}

}  // namespace lumo::detail
