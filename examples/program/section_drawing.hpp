#pragma once

#include "program/chart.hpp"

namespace lumo::program {

/// A cross-section to draw, lengths in mm, x to the right and z upwards.
struct SectionDrawing {
  enum class Fill { silicone, carrier, air, led };
  struct Area {
    Fill fill;
    std::vector<Point> loop;
  };
  /// A measured length between two points; the dimension line runs along x or z, `shift` mm away from `from` across it.
  struct Dimension {
    enum class Along { x, z };
    Along along;
    Point from, to;
    double shift;
    std::string label;
  };

  std::string title, subtitle;
  std::vector<Area> areas;         ///< painted in order
  std::vector<Dimension> dimensions;
  std::vector<std::string> notes;  ///< lines under the legend
};

namespace detail {

inline Paint paint(SectionDrawing::Fill fill) {
  switch (fill) {
    case SectionDrawing::Fill::silicone: return {.fill = "#bfe0f2", .stroke = "#0072b2", .width = 1.6};
    case SectionDrawing::Fill::carrier: return {.fill = "#8c8c8c", .stroke = "#444444", .width = 1.2};
    case SectionDrawing::Fill::air: return {.fill = "#ffffff", .stroke = "#444444", .width = 1.0, .dash = "4 3"};
    default: return {.fill = "#f0a500", .stroke = "#7a4b00", .width = 1.0};
  }
}

/// Filled arrowhead with its tip at `tip`, pointing along (dx, dy).
inline void arrow(Svg& svg, Point tip, double dx, double dy) {
  constexpr double length = 8, half = 2.6;
  svg.polygon({{tip, {tip[0] - length * dx - half * dy, tip[1] - length * dy + half * dx}, {tip[0] - length * dx + half * dy, tip[1] - length * dy - half * dx}}},
              {.fill = std::string(ink)});
}

}  // namespace detail

inline std::string draw(const SectionDrawing& s) {
  using detail::ink;
  double x0 = 0, x1 = 0, z0 = 0, z1 = 0;
  const auto cover = [&](const Point& p) {
    x0 = std::min(x0, p[0]), x1 = std::max(x1, p[0]);
    z0 = std::min(z0, p[1]), z1 = std::max(z1, p[1]);
  };
  for (const auto& a : s.areas)
    for (const Point& p : a.loop) cover(p);
  for (const auto& d : s.dimensions) {
    const bool x = d.along == SectionDrawing::Dimension::Along::x;
    cover(x ? Point{d.from[0], d.from[1] + d.shift} : Point{d.from[0] + d.shift, d.from[1]});
  }
  const double label_room = 100, legend_width = 180, margin = 24, head = 62, scale = 560.0 / (x1 - x0);
  Svg svg(margin + 2 * label_room + scale * (x1 - x0) + legend_width, head + margin + 30 + scale * (z1 - z0));
  const auto px = [&](const Point& p) { return Point{margin + label_room + scale * (p[0] - x0), head + 18 + scale * (z1 - p[1])}; };

  svg.text({margin, 26}, s.title, {.size = 15, .bold = true});
  svg.text({margin, 45}, s.subtitle, {.size = 12, .fill = std::string(detail::grey)});
  for (const auto& a : s.areas) {
    std::vector<Point> loop;
    for (const Point& p : a.loop) loop.push_back(px(p));
    svg.polygon({loop}, detail::paint(a.fill));
  }

  const Paint thin{.stroke = std::string(ink), .width = 0.9}, extension{.stroke = std::string(detail::grey), .width = 0.6};
  for (const auto& d : s.dimensions) {
    const bool along_x = d.along == SectionDrawing::Dimension::Along::x;
    const Point a = px(along_x ? Point{d.from[0], d.from[1] + d.shift} : Point{d.from[0] + d.shift, d.from[1]});
    const Point b = px(along_x ? Point{d.to[0], d.from[1] + d.shift} : Point{d.from[0] + d.shift, d.to[1]});
    svg.line(px(d.from), a, extension);
    svg.line(px(d.to), b, extension);
    const double length = along_x ? std::abs(b[0] - a[0]) : std::abs(b[1] - a[1]);
    const double ux = along_x ? (b[0] > a[0] ? 1 : -1) : 0, uy = along_x ? 0 : (b[1] > a[1] ? 1 : -1);
    const bool inside = length > 22;   // else the arrows point inwards from outside
    svg.line(inside ? a : Point{a[0] - 14 * ux, a[1] - 14 * uy}, inside ? b : Point{b[0] + 14 * ux, b[1] + 14 * uy}, thin);
    detail::arrow(svg, b, inside ? ux : -ux, inside ? uy : -uy);
    detail::arrow(svg, a, inside ? -ux : ux, inside ? -uy : uy);
    const double text = detail::text_width(d.label, 12);
    Point at = {0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])};
    std::string anchor = "middle";
    if (along_x && d.shift == 0.0) at = {b[0] - 10, b[1] - 6}, anchor = "end";              // within the body: above its line
    else if (along_x && length < text + 18) at = {b[0] + ux * 18, b[1] + 4}, anchor = ux > 0 ? "start" : "end";
    else if (along_x) at[1] -= 5;
    else at = {at[0] + (d.shift < 0.0 ? -7 : 7), at[1] + 4}, anchor = d.shift < 0.0 ? "end" : "start";
    const double left = anchor == "middle" ? at[0] - 0.5 * text : anchor == "end" ? at[0] - text : at[0];
    svg.rect({left - 2, at[1] - 11}, text, 14, {.fill = "#ffffff", .opacity = 0.75});   // keeps labels readable on fills
    svg.text(at, d.label, {.anchor = anchor});
  }

  double y = head + 26;
  const double x = svg.width() - legend_width + 10;
  const auto has = [&](SectionDrawing::Fill f) { return std::any_of(s.areas.begin(), s.areas.end(), [f](const auto& a) { return a.fill == f; }); };
  for (const auto& [fill, label] : {std::pair{SectionDrawing::Fill::silicone, "silicone"}, {SectionDrawing::Fill::carrier, "rigid carrier"},
                                    {SectionDrawing::Fill::air, "lateral void (air)"}, {SectionDrawing::Fill::led, "LED"}}) {
    if (!has(fill)) continue;
    svg.rect({x, y - 11}, 18, 14, detail::paint(fill));
    svg.text({x + 26, y}, label);
    y += 22;
  }
  y += 8;
  for (const auto& note : s.notes) {
    svg.text({x, y}, note, {.size = 11, .fill = std::string(detail::grey)});
    y += 17;
  }
  return svg.str();
}

}  // namespace lumo::program
