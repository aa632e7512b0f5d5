#pragma once

#include "lumo/core/colour.hpp"
#include "lumo/mechanics/contact/contact_surface.hpp"
#include "lumo/mechanics/contact/first_touch.hpp"
#include "lumo/mechanics/contact/state.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <ostream>
#include <string>
#include <vector>

namespace lumo {

/// Draws the pressed body as an SVG picture: a cut through it across y at the place of touch, coloured by how far the material has moved, over its undeformed
/// outline, with carrier and indenter; axes x and z in mm. Throws InvalidArgument for a state that has no displacement on this mesh, or when the indenter passes by;
/// InputError when the stream fails.
template <Indenter Tool>
void write_press_svg(std::ostream& out, const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario, const MechanicalState& state);

namespace detail {

/// A point of a cut in mm, with how far it has moved.
struct CutPoint {
  double x, z, moved_mm;
};

/// Where the plane y = `at` cuts a tetrahedron or triangle with these corners, in order around the cut. A corner in the plane counts as beyond it.
template <std::size_t N>
inline std::vector<CutPoint> cut_across(const std::array<Vec3d, N>& corners, const std::array<double, N>& moved_mm, double at) {
  std::vector<CutPoint> points;
  for (std::size_t i = 0; i < N; ++i)
    for (std::size_t j = 0; j < N; ++j) {
      if (!(corners[i].y() < at) || corners[j].y() < at) continue;
      const double t = (at - corners[i].y()) / (corners[j].y() - corners[i].y());
      const Vec3d p = corners[i] + t * (corners[j] - corners[i]);
      points.push_back({1e3 * p.x(), 1e3 * p.z(), moved_mm[i] + t * (moved_mm[j] - moved_mm[i])});
    }
  if (points.size() == 4) std::swap(points[2], points[3]);   // edges come as ac, ad, bc, bd
  return points;
}

/// Straight parts of a quadratic tetrahedron, between all its nodes.
inline constexpr std::array<std::array<int, 4>, 8> tet_parts{{{0, 4, 6, 7}, {1, 5, 4, 8}, {2, 6, 5, 9}, {3, 7, 8, 9}, {4, 9, 5, 6}, {4, 9, 6, 7}, {4, 9, 7, 8}, {4, 9, 8, 5}}};

/// Lightness falls with the value, which survives greyscale print; the hue is the same for any colour vision.
inline std::string moved_colour(double part) {
  constexpr std::array<std::array<double, 3>, 4> stops{{{235, 243, 250}, {141, 190, 222}, {43, 119, 184}, {8, 44, 92}}};
  const double t = 3.0 * std::clamp(part, 0.0, 1.0);
  const std::size_t low = std::min<std::size_t>(2, std::size_t(t));
  std::array<int, 3> rgb{};
  for (std::size_t k = 0; k < 3; ++k) rgb[k] = int(std::lround(stops[low][k] + (t - double(low)) * (stops[low + 1][k] - stops[low][k])));
  return hex_colour(rgb);
}

}  // namespace detail

template <Indenter Tool>
void write_press_svg(std::ostream& out, const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario, const MechanicalState& state) {
  if (state.displacement.size() != mesh.nodes.size())
    throw InvalidArgument(message("picture: the state has ", state.displacement.size(), " displacements, the mesh ", mesh.nodes.size(), " nodes"));
  const Touch touch = first_touch(body, mesh, scenario);
  const Vec3d tool = touch.origin + state.depth_m * scenario.direction();
  const auto cut = [&]<std::size_t N>(const auto& nodes, const std::array<int, N>& part, bool pressed) {
    std::array<Vec3d, N> p;
    std::array<double, N> moved;
    for (std::size_t k = 0; k < N; ++k) {
      const auto n = std::size_t(nodes[std::size_t(part[k])]);
      p[k] = pressed ? Vec3d(mesh.nodes[n] + state.displacement[n]) : mesh.nodes[n];
      moved[k] = 1e3 * state.displacement[n].norm();
    }
    return detail::cut_across(p, moved, touch.point.y());
  };
  const bool quadratic = mesh.order == 2;
  std::vector<std::vector<detail::CutPoint>> areas;
  double most = 0.0, x_low = 0.0, x_high = 0.0, z_low = 0.0, z_high = 0.0;
  const auto cover = [&](double x, double z) { x_low = std::min(x_low, x), x_high = std::max(x_high, x), z_low = std::min(z_low, z), z_high = std::max(z_high, z); };
  for (const auto& t : mesh.tets)
    for (std::size_t part = 0; part < (quadratic ? 8 : 1); ++part)
      if (auto area = cut(t, quadratic ? detail::tet_parts[part] : std::array{0, 1, 2, 3}, true); area.size() >= 3) {
        for (const auto& p : area) most = std::max(most, p.moved_mm), cover(p.x, p.z);
        areas.push_back(std::move(area));
      }
  std::vector<std::vector<detail::CutPoint>> outline;
  for (const BoundaryFace& f : mesh.faces)
    for (std::size_t part = 0; part < (quadratic ? 4 : 1); ++part)
      if (auto line = cut(f.nodes, quadratic ? face_parts()[part] : std::array{0, 1, 2}, false); line.size() == 2) outline.push_back(std::move(line));
  for (const auto& line : outline)
    for (const auto& p : line) cover(p.x, p.z);
  // Room to the next 5 mm, and for what of the indenter is near.
  x_low = 5.0 * std::floor(x_low / 5.0 - 0.2), x_high = 5.0 * std::ceil(x_high / 5.0 + 0.2), z_low = -5.0, z_high = 5.0 * std::ceil(z_high / 5.0 + 0.2) + 5.0;
  const double scale = 560.0 / std::max(x_high - x_low, z_high - z_low), left = 64.0, top = 56.0;
  const double right = left + scale * (x_high - x_low), bottom = top + scale * (z_high - z_low);
  const auto px = [&](double x) { return message(std::round(100.0 * (left + scale * (x - x_low))) / 100.0); };
  const auto pz = [&](double z) { return message(std::round(100.0 * (bottom - scale * (z - z_low))) / 100.0); };
  const auto path = [&](const auto& points) {
    std::string d;
    for (const auto& p : points) d += (d.empty() ? "M" : "L") + px(p.x) + " " + pz(p.z);
    return d;
  };
  const auto words = [&](double x, double y, const std::string& style, const std::string& what) {
    out << "<text x=\"" << x << "\" y=\"" << y << "\" " << style << ">" << what << "</text>\n";
  };

  const double width = right + 130.0, height = bottom + 60.0;
  out << "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" << width << "\" height=\"" << height << "\" viewBox=\"0 0 " << width << " " << height
      << "\" font-family=\"DejaVu Sans, Verdana, Helvetica, sans-serif\" font-size=\"12\" fill=\"#222222\">\n<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n"
      << "<clipPath id=\"plot\"><rect x=\"" << left << "\" y=\"" << top << "\" width=\"" << right - left << "\" height=\"" << bottom - top << "\"/></clipPath>\n";
  const auto rounded = [](double v, double step) { return message(std::round(v / step) * step); };
  words(left, 24, "font-size=\"15\" font-weight=\"bold\"", message("Pressed to ", rounded(state.force_N, 0.1), " N: ", rounded(1e3 * state.depth_m, 0.01), " mm deep, ",
                                                                       rounded(1e6 * state.contact_area_m2, 0.1), " mm² of contact"));
  words(left, 43, "fill=\"#666666\"", message("cut at y = ", rounded(1e3 * touch.point.y(), 0.01), " mm; dashed: the surface before"));
  for (double x = x_low; x <= x_high; x += 5.0) {
    out << "<path stroke=\"#dddddd\" d=\"M" << px(x) << " " << top << "V" << bottom << "\"/>\n";
    words(left + scale * (x - x_low), bottom + 18, "text-anchor=\"middle\"", message(x < 0 ? "−" : "", std::abs(x)));
  }
  for (double z = z_low; z <= z_high; z += 5.0) {
    out << "<path stroke=\"#dddddd\" d=\"M" << left << " " << pz(z) << "H" << right << "\"/>\n";
    words(left - 8, bottom - scale * (z - z_low) + 4, "text-anchor=\"end\"", message(z < 0 ? "−" : "", std::abs(z)));
  }
  words(0.5 * (left + right), bottom + 42, "font-size=\"13\" text-anchor=\"middle\"", "across x [mm]");
  out << "<text transform=\"translate(22 " << 0.5 * (top + bottom) << ") rotate(-90)\" font-size=\"13\" text-anchor=\"middle\">height z [mm]</text>\n<g clip-path=\"url(#plot)\">\n";
  for (const RigidBox& box : body.carrier)
    if (std::abs(touch.point.y() - box.center.y()) <= box.half.y()) {
      const Vec3d low = 1e3 * (box.center - box.half), high = 1e3 * (box.center + box.half);
      out << "<path fill=\"#8c8c8c\" d=\"M" << px(low.x()) << " " << pz(low.z()) << "H" << px(high.x()) << "V" << pz(high.z()) << "H" << px(low.x()) << "Z\"/>\n";
    }
  for (const auto& area : areas) {
    double moved = 0.0;
    for (const auto& p : area) moved += p.moved_mm / double(area.size());
    const std::string colour = detail::moved_colour(most > 0.0 ? moved / most : 0.0);
    out << "<path fill=\"" << colour << "\" stroke=\"" << colour << "\" stroke-width=\"0.6\" d=\"" << path(area) << "Z\"/>\n";
  }
  // The indenter's outline where its distance changes sign, on a grid of triangles.
  const double step = 0.25;
  const auto distance = [&](double x, double z) { return scenario.indenter.distance(1e-3 * Vec3d(x, 0.0, z) + Vec3d(0.0, touch.point.y(), 0.0) - tool); };
  out << "<path fill=\"none\" stroke=\"#d55e00\" stroke-width=\"2\" stroke-linecap=\"round\" d=\"";
  for (double x = x_low; x < x_high; x += step)
    for (double z = z_low; z < z_high; z += step)
      for (const double upper : {0.0, 1.0}) {
        const std::array<std::array<double, 2>, 3> corner{{{x + upper * step, z + upper * step}, {x + step, z}, {x, z + step}}};
        std::vector<detail::CutPoint> line;
        for (std::size_t i = 0; i < 3; ++i) {
          const auto &a = corner[i], &b = corner[(i + 1) % 3];
          const double da = distance(a[0], a[1]), db = distance(b[0], b[1]);
          if ((da < 0.0) == (db < 0.0)) continue;
          const double t = da / (da - db);
          line.push_back({a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), 0.0});
        }
        if (line.size() == 2) out << path(line);
      }
  out << "\"/>\n<path fill=\"none\" stroke=\"#444444\" stroke-dasharray=\"5 4\" d=\"";
  for (const auto& line : outline) out << path(line);
  out << "\"/>\n</g>\n";
  const double bar = right + 24.0, bar_height = std::min(220.0, bottom - top);
  for (int k = 0; k < 40; ++k)
    out << "<rect x=\"" << bar << "\" y=\"" << top + bar_height * (39 - k) / 40.0 << "\" width=\"18\" height=\"" << bar_height / 40.0 + 0.5 << "\" fill=\"" << detail::moved_colour((k + 0.5) / 40.0) << "\"/>\n";
  for (const double part : {0.0, 0.5, 1.0}) words(bar + 24, top + bar_height * (1.0 - part) + 4, "", rounded(part * most, 0.01));
  words(bar, top + bar_height + 22, "", "moved by [mm]");
  out << "</svg>\n";
  if (!out) throw InputError("writing an .svg file failed");
}

}  // namespace lumo
