#pragma once

#include "drawing/chart.hpp"

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

/// Ends of the dimension line, in px.
template <class ToPixels>
std::pair<Point, Point> ends(const SectionDrawing::Dimension& d, const ToPixels& px) {
  if (d.along == SectionDrawing::Dimension::Along::x) return {px({d.from[0], d.from[1] + d.shift}), px({d.to[0], d.from[1] + d.shift})};
  return {px({d.from[0] + d.shift, d.from[1]}), px({d.from[0] + d.shift, d.to[1]})};
}

/// Where a label may stand.
struct Place {
  Point at;
  std::string anchor;
};

/// For the label of a dimension line from a to b, the best places first. Lines within the body (no shift) have less room about them.
inline std::vector<Place> label_places(const SectionDrawing::Dimension& d, Point a, Point b) {
  const double left = std::min(a[0], b[0]), right = std::max(a[0], b[0]), top = std::min(a[1], b[1]), bottom = std::max(a[1], b[1]);
  const double x = 0.5 * (left + right), y = 0.5 * (top + bottom);
  std::vector<Place> places;
  if (d.along == SectionDrawing::Dimension::Along::x && d.shift != 0.0)   // on it, beside it, below it
    return {{{x, y - 6}, "middle"}, {{right + 18, y + 4}, "start"}, {{left - 18, y + 4}, "end"}, {{x, y + 15}, "middle"}};
  if (d.along == SectionDrawing::Dimension::Along::x) {
    for (const double away : {-6.0, -12.0, -18.0, 15.0, 21.0}) {
      for (const double from_end : {10.0, 4.0, 16.0, 24.0}) places.push_back({{right - from_end, y + away}, "end"});
      for (const double from_end : {4.0, 10.0}) places.push_back({{left + from_end, y + away}, "start"});
    }
    return places;
  }
  const std::array<Place, 2> sides = {{{{x + 7, 0}, "start"}, {{x - 7, 0}, "end"}}};
  for (const double part : {0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8})
    for (const Place& side : sides)
      if (d.shift == 0.0 || (d.shift < 0.0) == (side.anchor == "end")) places.push_back({{side.at[0], bottom + part * (top - bottom) + 4}, side.anchor});
  return places;
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
  // All lines first, then all labels, each where it touches none of them.
  detail::Obstacles obstacles;
  const auto keep_off = [&obstacles](const std::vector<Point>& loop) {
    for (std::size_t i = 0; i < loop.size(); ++i) obstacles.lines.emplace_back(loop[i], loop[(i + 1) % loop.size()]);
  };
  for (const auto& a : s.areas) {
    std::vector<Point> loop;
    for (const Point& p : a.loop) loop.push_back(px(p));
    svg.polygon({loop}, detail::paint(a.fill));
    keep_off(loop);
  }
  const Paint thin{.stroke = std::string(ink), .width = 0.9}, extension{.stroke = std::string(detail::grey), .width = 0.6};
  const auto line = [&](Point a, Point b, const Paint& paint) {
    svg.line(a, b, paint);
    obstacles.lines.emplace_back(a, b);
  };
  for (const auto& d : s.dimensions) {
    const bool along_x = d.along == SectionDrawing::Dimension::Along::x;
    const auto [a, b] = detail::ends(d, px);
    line(px(d.from), a, extension);
    line(px(d.to), b, extension);
    const double length = along_x ? std::abs(b[0] - a[0]) : std::abs(b[1] - a[1]);
    const double ux = along_x ? (b[0] > a[0] ? 1 : -1) : 0, uy = along_x ? 0 : (b[1] > a[1] ? 1 : -1);
    const bool inside = length > 22;   // else the arrows point inwards from outside
    line(inside ? a : Point{a[0] - 14 * ux, a[1] - 14 * uy}, inside ? b : Point{b[0] + 14 * ux, b[1] + 14 * uy}, thin);
    detail::arrow(svg, b, inside ? ux : -ux, inside ? uy : -uy);
    detail::arrow(svg, a, inside ? -ux : ux, inside ? -uy : uy);
  }
  for (const auto& d : s.dimensions) {
    const auto [a, b] = detail::ends(d, px);
    const auto places = detail::label_places(d, a, b);
    const auto box = [&d](const detail::Place& p) { return detail::text_box(p.at, d.label, {.anchor = p.anchor}); };
    const auto hits = [&](const detail::Place& p) { return obstacles.hits(detail::grown(box(p), 2.0)); };
    const auto best = std::min_element(places.begin(), places.end(), [&](const detail::Place& p, const detail::Place& q) { return hits(p) < hits(q); });
    const detail::Box taken = box(*best);
    if (hits(*best) > 0) svg.rect({taken.left, taken.top}, taken.right - taken.left, taken.bottom - taken.top, {.fill = "#ffffff", .opacity = 0.75});   // readable all the same
    svg.text(best->at, d.label, {.anchor = best->anchor});
    obstacles.boxes.push_back(taken);
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
