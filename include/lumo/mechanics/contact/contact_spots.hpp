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
  Vec3d place;
  double force_N;  // along the normal
};

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
  std::vector<std::size_t> number;  // of a mesh's node among `nodes`
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    const std::size_t node = std::size_t(nodes.mesh_node[k]);
    if (node >= number.size()) number.resize(node + 1);
    number[node] = k;
  }
  for (const PressedPoint& p : pressed) {
    const std::array<int, 3> node = surface.sub_triangle(p.face, std::size_t(p.point->part));
    double field = 0.0;
    std::size_t nearest = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      field += p.point->hat[k] * edge.field()[number[std::size_t(node[k])]];
      if (p.point->hat[k] > p.point->hat[nearest]) nearest = k;
    }
    const int part = edge.part_of_node(number[std::size_t(node[nearest])]);
    ContactSpot& spot = part >= 0 ? spots[std::size_t(part)] : spots.back();
    spot.force_N += p.force_N;
    spot.place_m += p.force_N * p.place;
    if (!(field > 0.0)) spot.force_outside_N += p.force_N;
  }
  std::erase_if(spots, [](const ContactSpot& s) { return !(s.force_N > 0.0); });
  for (ContactSpot& s : spots) {
    s.place_m /= s.force_N;
    if (s.rim_m > 0.0) s.edge_m /= s.rim_m;
  }
  std::stable_sort(
      spots.begin(), spots.end(), [](const ContactSpot& a, const ContactSpot& b) { return a.force_N > b.force_N; });
  return spots;
}

}  // namespace lumo::detail
