#pragma once

#include "charts/chart.hpp"
#include "charts/contact_outline.hpp"
#include "lumo/mechanics/contact/state.hpp"
#include "lumo/mesh/tet_mesh.hpp"

#include <span>

namespace lumo::program {

namespace drawing {

/// The part of a triangle in which the field, linear between its corners, is positive.
inline Points clip_positive(const std::array<Point, 3>& corner, const std::array<double, 3>& field) {
  Points kept;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t j = (i + 1) % 3;
    if (field[i] > 0.0) kept.push_back(corner[i]);
    if ((field[i] > 0.0) == (field[j] > 0.0)) continue;
    const double t = zero_between(field[i], field[j]);
    kept.push_back(
        {corner[i][0] + t * (corner[j][0] - corner[i][0]), corner[i][1] + t * (corner[j][1] - corner[i][1])});
  }
  return kept;
}

/// The pad from outside, in mm: y to the right, x upwards.
inline plot::Frame pad_frame(const TetMesh& mesh) {
  constexpr double width_px = 640, tick_mm = 10;
  plot::Frame f{.x1 = 0, .y1 = 0};
  for (const BoundaryFace& face : mesh.faces)
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3d& p = mesh.nodes[std::size_t(face.nodes[k])];
      f.x1 = std::max(f.x1, 1e3 * std::abs(p.y()));
      f.y1 = std::max(f.y1, 1e3 * std::abs(p.x()));
    }
  f.x0 = -f.x1;
  f.y0 = -f.y1;
  f.right = f.left + width_px;
  f.bottom = f.top + 2 * f.y1 * (width_px / (2 * f.x1));
  for (double t = -tick_mm * int(f.x1 / tick_mm); t <= f.x1; t += tick_mm) f.x_ticks.push_back(t);
  for (double t = -tick_mm * int(f.y1 / tick_mm); t <= f.y1; t += tick_mm) f.y_ticks.push_back(t);
  return f;
}

/// One contact set in px, facet by facet; empty for a state without a contact field.
inline std::vector<Points> contact_set(const TetMesh& mesh, const std::vector<double>& field, const plot::Frame& f) {
  std::vector<Points> loops;
  if (field.size() != mesh.nodes.size()) return loops;
  for (const auto& facet : sub_facets(mesh)) {
    std::array<Point, 3> corner{};
    std::array<double, 3> value{};
    for (std::size_t k = 0; k < 3; ++k) {
      corner[k] = {f.x(1e3 * mesh.nodes[facet[k]].y()), f.y(1e3 * mesh.nodes[facet[k]].x())};
      value[k] = field[facet[k]];
    }
    Points loop = clip_positive(corner, value);
    if (loop.size() >= 3) loops.push_back(std::move(loop));
  }
  return loops;
}

}  // namespace drawing

/// Contact sets of increasing loads on the undeformed pad, seen from outside (along −z).
inline std::string draw_contact(const std::string& title, const std::string& subtitle, const TetMesh& mesh,
    std::span<const MechanicalState> states) {
  std::vector<drawing::LegendEntry> entries;
  for (const MechanicalState& s : states)
    entries.push_back({short_number(s.load_N) + " N, " + short_number(1e6 * s.contact_area_m2, 1) + " mm²",
        shade(int(entries.size()), int(states.size())), true});
  const plot::Frame f = drawing::pad_frame(mesh);
  const double width = f.right - f.left, height = f.bottom - f.top, middle = 0.5 * (f.left + f.right);
  Svg svg(f.right + drawing::legend_room(entries), std::max(f.bottom + 74, f.top + 20.0 * double(entries.size()) + 16));
  plot::headline(svg, f.left, title, subtitle);
  svg.rect({f.left, f.top}, width, height, {.fill = "#f4f6f8"});
  plot::x_grid(svg, f);
  plot::y_grid(svg, f);
  svg.rect({f.left, f.top}, width, height, {.stroke = "#0072b2", .width = 1.4});
  plot::x_label(svg, f, "place along the finger y [mm]");
  svg.text({middle, f.bottom + 62}, "drawn on the undeformed pad; areas are those of the deformed surface",
      {.size = 11, .anchor = Svg::middle});
  plot::y_label(svg, f, "across x [mm]", 30);
  for (std::size_t s = states.size(); s-- > 0;) {  // largest set first, so that the smaller ones lie on it
    const auto loops = drawing::contact_set(mesh, states[s].contact_field, f);
    const std::string colour = shade(int(s), int(states.size()));
    // A hairline of the same colour closes the seams that antialiasing leaves between neighbours.
    if (!loops.empty()) svg.polygon(loops, {.fill = colour, .stroke = colour, .width = 0.6});
  }
  drawing::legend(svg, f, entries);
  return svg.str();
}

}  // namespace lumo::program
