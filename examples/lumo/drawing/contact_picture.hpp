#pragma once

#include "lumo/mechanics/contact_surface.hpp"
#include "lumo/mechanics/state.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "drawing/chart.hpp"

#include <span>

namespace lumo::program {

namespace detail {

/// The part of a triangle in which the field, linear between its corners, is positive.
inline std::vector<Point> clip_positive(const std::array<Point, 3>& corner, const std::array<double, 3>& field) {
  std::vector<Point> kept;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t j = (i + 1) % 3;
    if (field[i] > 0.0) kept.push_back(corner[i]);
    if ((field[i] > 0.0) == (field[j] > 0.0)) continue;
    // A node that nothing can touch carries −infinity: the set ends at its neighbour.
    const double t = std::isinf(field[j]) ? 0.0 : std::isinf(field[i]) ? 1.0 : field[i] / (field[i] - field[j]);
    kept.push_back({corner[i][0] + t * (corner[j][0] - corner[i][0]), corner[i][1] + t * (corner[j][1] - corner[i][1])});
  }
  return kept;
}

}  // namespace detail

/// Contact sets of increasing loads on the undeformed pad, seen from outside (along −z): y to the right, x upwards, in mm.
inline std::string draw_contact(const std::string& title, const std::string& subtitle, const TetMesh& mesh, std::span<const MechanicalState> states) {
  double x_max = 0, y_max = 0;
  for (const auto& face : mesh.faces)
    for (const int node : {face.nodes[0], face.nodes[1], face.nodes[2]}) {
      const Vec3& p = mesh.nodes[std::size_t(node)];
      x_max = std::max(x_max, 1e3 * std::abs(p.x())), y_max = std::max(y_max, 1e3 * std::abs(p.y()));
    }
  std::vector<detail::LegendEntry> entries;
  for (std::size_t s = 0; s < states.size(); ++s)
    entries.push_back({short_number(states[s].load_N) + " N, " + short_number(1e6 * states[s].contact_area_m2, 1) + " mm²", shade(int(s), int(states.size())), true});

  const double plot_width = 640, scale = plot_width / (2 * y_max);
  detail::Frame f;
  f.right = f.left + plot_width, f.bottom = f.top + 2 * x_max * scale;
  f.x0 = -y_max, f.x1 = y_max, f.y0 = -x_max, f.y1 = x_max;
  double room = 24;
  for (const auto& e : entries) room = std::max(room, 52 + detail::text_width(e.label, 12));
  Svg svg(f.right + room, std::max(f.bottom + 74, f.top + 20.0 * double(entries.size()) + 16));
  detail::headline(svg, f.left, title, subtitle);
  svg.rect({f.left, f.top}, plot_width, f.bottom - f.top, {.fill = "#f4f6f8"});
  for (int t = -10 * int(y_max / 10); t <= y_max; t += 10) {
    svg.line({f.x(t), f.top}, {f.x(t), f.bottom}, {.stroke = std::string(detail::faint)});
    svg.text({f.x(t), f.bottom + 18}, detail::tick(t, 0), {.anchor = "middle"});
  }
  for (int t = -10 * int(x_max / 10); t <= x_max; t += 10) {
    svg.line({f.left, f.y(t)}, {f.right, f.y(t)}, {.stroke = std::string(detail::faint)});
    svg.text({f.left - 8, f.y(t) + 4}, detail::tick(t, 0), {.anchor = "end"});
  }
  svg.rect({f.left, f.top}, plot_width, f.bottom - f.top, {.stroke = "#0072b2", .width = 1.4});
  svg.text({0.5 * (f.left + f.right), f.bottom + 42}, "place along the finger y [mm]", {.size = 13, .anchor = "middle"});
  svg.text({0.5 * (f.left + f.right), f.bottom + 62}, "drawn on the undeformed pad; areas are those of the deformed surface", {.size = 11, .anchor = "middle"});
  svg.text({30, 0.5 * (f.top + f.bottom)}, "across x [mm]", {.size = 13, .anchor = "middle", .rotate_deg = -90});

  // Sub-facets as in the contact set's definition: four per quadratic face.
  const std::size_t parts = mesh.order == 2 ? 4 : 1;
  for (std::size_t s = states.size(); s-- > 0;) {   // largest set first, so that the smaller ones lie on it
    const auto& field = states[s].contact_field;
    std::vector<std::vector<Point>> loops;
    if (field.size() == mesh.nodes.size())
      for (const auto& face : mesh.faces)
        for (std::size_t part = 0; part < parts; ++part) {
          std::array<Point, 3> corner{};
          std::array<double, 3> value{};
          for (std::size_t k = 0; k < 3; ++k) {
            const auto node = std::size_t(face.nodes[parts == 4 ? std::size_t(face_parts()[part][k]) : k]);
            corner[k] = {f.x(1e3 * mesh.nodes[node].y()), f.y(1e3 * mesh.nodes[node].x())};
            value[k] = field[node];
          }
          auto loop = detail::clip_positive(corner, value);
          if (loop.size() >= 3) loops.push_back(std::move(loop));
        }
    const std::string colour = shade(int(s), int(states.size()));
    // A hairline of the same colour closes the seams that antialiasing leaves between neighbours.
    if (!loops.empty()) svg.polygon(loops, {.fill = colour, .stroke = colour, .width = 0.6});
  }
  detail::legend(svg, f, entries);
  return svg.str();
}

}  // namespace lumo::program
