#pragma once

#include "lumo/drawing/plot.hpp"
#include "lumo/drawing/svg.hpp"
#include "lumo/mechanics/contact/contact_surface.hpp"
#include "lumo/mechanics/contact/first_touch.hpp"
#include "lumo/mechanics/contact/state.hpp"
#include "lumo/mechanics/elements/element.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <ostream>
#include <vector>

namespace lumo {

/// Writes an SVG picture of the pressed body: a cut through it across y at the place of touch, coloured by how far the
/// material has moved, over its undeformed outline, with carrier and indenter; axes x and z in mm. Throws
/// InvalidArgument for a state that has no displacement on this mesh, or when the indenter passes by; InputError when
/// the stream fails.
template <Indenter Tool> void write_press_svg(std::ostream& out, const Body& body, const TetMesh& mesh,
    const Scenario<Tool>& scenario, const MechanicalState& state);

namespace detail {

/// A point of a cut in mm, with how far it has moved.
struct CutPoint {
  double x, z, moved_mm;
};

/// The body where a plane across y cuts it.
struct BodyCut {
  std::vector<std::vector<CutPoint>> areas;    ///< of the elements, pressed
  std::vector<std::vector<CutPoint>> outline;  ///< of the surface before, line by line
};

/// Where the plane y = `at` cuts a tetrahedron or triangle with these corners, in order around the cut. A corner in the
/// plane counts as beyond it.
template <std::size_t N> std::vector<CutPoint> cut_across(
    const std::array<Vec3d, N>& corners, const std::array<double, N>& moved_mm, double at) {
  std::vector<CutPoint> points;
  for (std::size_t i = 0; i < N; ++i)
    for (std::size_t j = 0; j < N; ++j) {
      if (!(corners[i].y() < at) || corners[j].y() < at) continue;
      const double t = (at - corners[i].y()) / (corners[j].y() - corners[i].y());
      const Vec3d p = corners[i] + t * (corners[j] - corners[i]);
      points.push_back({1e3 * p.x(), 1e3 * p.z(), moved_mm[i] + t * (moved_mm[j] - moved_mm[i])});
    }
  if (points.size() == 4) std::swap(points[2], points[3]);  // edges come as ac, ad, bc, bd
  return points;
}

inline BodyCut cut_body(const TetMesh& mesh, const MechanicalState& state, double at) {
  const auto cut = [&]<std::size_t N>(const auto& nodes, const std::array<int, N>& part, bool pressed) {
    std::array<Vec3d, N> p;
    std::array<double, N> moved;
    for (std::size_t k = 0; k < N; ++k) {
      const auto n = std::size_t(nodes[std::size_t(part[k])]);
      p[k] = pressed ? Vec3d(mesh.nodes[n] + state.displacement[n]) : mesh.nodes[n];
      moved[k] = 1e3 * state.displacement[n].norm();
    }
    return cut_across(p, moved, at);
  };
  const bool quadratic = mesh.order == 2;
  BodyCut out;
  for (const auto& t : mesh.tets)
    for (std::size_t k = 0; k < (quadratic ? 8 : 1); ++k) {
      auto area = cut(t, quadratic ? std::to_array(LinearPatchTet::parts[k]) : std::array{0, 1, 2, 3}, true);
      if (area.size() >= 3) out.areas.push_back(std::move(area));
    }
  for (const BoundaryFace& f : mesh.faces)
    for (std::size_t k = 0; k < (quadratic ? 4 : 1); ++k) {
      auto line = cut(f.nodes, quadratic ? face_parts()[k] : std::array{0, 1, 2}, false);
      if (line.size() == 2) out.outline.push_back(std::move(line));
    }
  return out;
}

/// A plot with equal scales for all that the plane cuts, with room for what of the indenter is near.
inline plot::Frame frame_around(const BodyCut& cut) {
  constexpr double tick_mm = 5.0, longest_px = 560.0;
  double x_low = 0.0, x_high = 0.0, z_high = 0.0;
  for (const auto* lines : {&cut.areas, &cut.outline})
    for (const auto& line : *lines)
      for (const CutPoint& p : line) {
        x_low = std::min(x_low, p.x);
        x_high = std::max(x_high, p.x);
        z_high = std::max(z_high, p.z);
      }
  const auto next = [](double v, double room) { return std::ceil(v / tick_mm + room); };
  plot::Frame f{.left = 64.0, .top = 56.0};
  for (double k = -next(-x_low, 0.2); k <= next(x_high, 0.2); ++k) f.x_ticks.push_back(k * tick_mm);
  for (double k = -1.0; k <= next(z_high, 0.2) + 1.0; ++k) f.y_ticks.push_back(k * tick_mm);
  f.fit_x();
  f.fit_y();
  const double scale = longest_px / std::max(f.x1 - f.x0, f.y1 - f.y0);
  f.right = f.left + scale * (f.x1 - f.x0);
  f.bottom = f.top + scale * (f.y1 - f.y0);
  return f;
}

/// Lightness falls with the value, which survives greyscale print; the hue is the same for any colour vision.
inline std::string moved_colour(double part) {
  constexpr std::array<std::array<double, 3>, 4> stops{{{235, 243, 250}, {141, 190, 222}, {43, 119, 184}, {8, 44, 92}}};
  return colour_between(stops, part);
}

/// Lines, in px, along which a distance that is given for places in the plot changes its sign, on a grid of triangles.
template <class Distance> std::vector<Svg::Points> zero_lines(const plot::Frame& f, const Distance& distance) {
  constexpr double step = 0.25;  // [mm]
  std::vector<Svg::Points> lines;
  for (double x = f.x0; x < f.x1; x += step)
    for (double z = f.y0; z < f.y1; z += step)
      for (const double upper : {0.0, step}) {
        const std::array<Svg::Point, 3> corner{{{x + upper, z + upper}, {x + step, z}, {x, z + step}}};
        Svg::Points line;
        for (std::size_t i = 0; i < 3; ++i) {
          const auto &a = corner[i], &b = corner[(i + 1) % 3];
          const double da = distance(a[0], a[1]), db = distance(b[0], b[1]), t = da / (da - db);
          if ((da < 0.0) != (db < 0.0)) line.push_back({f.x(a[0] + t * (b[0] - a[0])), f.y(a[1] + t * (b[1] - a[1]))});
        }
        if (line.size() == 2) lines.push_back(std::move(line));
      }
  return lines;
}

/// The scale of colours, right of the plot.
inline void draw_colour_bar(Svg& svg, const plot::Frame& f, double most_mm) {
  constexpr int steps = 40;
  const double left = f.right + 24.0, height = std::min(220.0, f.bottom - f.top);
  for (int k = 0; k < steps; ++k)
    svg.rect({left, f.top + height * (steps - 1 - k) / steps}, 18, height / steps + 0.5,
        {.fill = moved_colour((k + 0.5) / steps)});
  for (const double part : {0.0, 0.5, 1.0})
    svg.text({left + 24, f.top + height * (1.0 - part) + 4}, short_number(part * most_mm));
  svg.text({left, f.top + height + 22}, "moved by [mm]");
}

inline Svg::Points to_px(const plot::Frame& f, const std::vector<CutPoint>& points) {
  Svg::Points px;
  for (const CutPoint& p : points) px.push_back({f.x(p.x), f.y(p.z)});
  return px;
}

}  // namespace detail

template <Indenter Tool> void write_press_svg(std::ostream& out, const Body& body, const TetMesh& mesh,
    const Scenario<Tool>& scenario, const MechanicalState& state) {
  if (state.displacement.size() != mesh.nodes.size())
    throw InvalidArgument(message("picture: the state has ", state.displacement.size(), " displacements, the mesh ",
        mesh.nodes.size(), " nodes"));
  const Touch touch = first_touch(body, mesh, scenario);
  const Vec3d tool = touch.origin + state.depth_m * scenario.direction();
  const double y = touch.point.y();
  const detail::BodyCut cut = detail::cut_body(mesh, state, y);
  const plot::Frame f = detail::frame_around(cut);
  double most_mm = 0.0;
  for (const auto& area : cut.areas)
    for (const detail::CutPoint& p : area) most_mm = std::max(most_mm, p.moved_mm);

  Svg svg(f.right + 130.0, f.bottom + 60.0);
  plot::headline(svg, f.left,
      "Pressed to " + short_number(state.force_N, 1) + " N: " + short_number(1e3 * state.depth_m) + " mm deep, " +
          short_number(1e6 * state.contact_area_m2, 1) + " mm² of contact",
      "cut at y = " + short_number(1e3 * y) + " mm; dashed: the surface before");
  plot::x_axis(svg, f, "across x [mm]");
  plot::y_axis(svg, f, "height z [mm]");
  svg.begin_clip({f.left, f.top}, f.right - f.left, f.bottom - f.top);
  for (const RigidBox& box : body.carrier) {
    if (std::abs(y - box.center.y()) > box.half.y()) continue;
    const Vec3d low = 1e3 * (box.center - box.half), high = 1e3 * (box.center + box.half);
    svg.rect({f.x(low.x()), f.y(high.z())}, f.x(high.x()) - f.x(low.x()), f.y(low.z()) - f.y(high.z()),
        {.fill = "#8c8c8c"}, f.x(1e3 * box.edge_radius) - f.x(0.0));
  }
  for (const auto& area : cut.areas) {
    double moved = 0.0;
    for (const detail::CutPoint& p : area) moved += p.moved_mm / double(area.size());
    const std::string colour = detail::moved_colour(most_mm > 0.0 ? moved / most_mm : 0.0);
    svg.polygon({detail::to_px(f, area)}, {.fill = colour, .stroke = colour, .width = 0.6});
  }
  const auto distance = [&](double x, double z) {
    return scenario.indenter.distance(Vec3d(1e-3 * x, y, 1e-3 * z) - tool);
  };
  svg.polylines(detail::zero_lines(f, distance), {.stroke = "#d55e00", .width = 2, .round_ends = true});
  std::vector<Svg::Points> outline;
  for (const auto& line : cut.outline) outline.push_back(detail::to_px(f, line));
  svg.polylines(outline, {.stroke = "#444444", .dash = "5 4"});
  svg.end_group();
  detail::draw_colour_bar(svg, f, most_mm);
  svg.write(out);
}

}  // namespace lumo
