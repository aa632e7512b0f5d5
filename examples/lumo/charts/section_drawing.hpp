#pragma once

#include "charts/chart.hpp"

namespace lumo::program {

/// A cross-section to draw, lengths in mm, x to the right and z upwards.
struct SectionDrawing {
  enum class Fill { silicone, carrier, air, led };
  struct Area {
    Fill fill;
    std::vector<Point> loop;
  };
  /// A measured length between two points; the dimension line runs along x or z, `shift` mm away from `from` across it,
  /// or straight from one to the other.
  struct Dimension {
    enum class Along { x, z, straight };
    Along along;
    Point from, to;
    double shift;
    std::string label;

    /// Ends of the dimension line.
    Point start() const {
      if (along == Along::straight) return from;
      return along == Along::x ? Point{from[0], from[1] + shift} : Point{from[0] + shift, from[1]};
    }
    Point end() const {
      if (along == Along::straight) return to;
      return along == Along::x ? Point{to[0], from[1] + shift} : Point{from[0] + shift, to[1]};
    }
  };

  std::string title, subtitle;
  std::vector<Area> areas;  ///< painted in order
  std::vector<Dimension> dimensions;
};

namespace drawing {

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
  svg.polygon({{tip, {tip[0] - length * dx - half * dy, tip[1] - length * dy + half * dx},
                  {tip[0] - length * dx + half * dy, tip[1] - length * dy - half * dx}}},
      {.fill = plot::ink});
}

/// Where a label may stand.
struct Place {
  Point at;
  Svg::Anchor anchor;
};

/// For the label of a dimension line from a to b, the best places first. Lines within the body (no shift) have less
/// room about them.
inline std::vector<Place> label_places(const SectionDrawing::Dimension& d, Point a, Point b) {
  const double left = std::min(a[0], b[0]), right = std::max(a[0], b[0]), top = std::min(a[1], b[1]),
               bottom = std::max(a[1], b[1]);
  const double x = 0.5 * (left + right), y = 0.5 * (top + bottom);
  std::vector<Place> places;
  if (d.along == SectionDrawing::Dimension::Along::x && d.shift != 0.0)  // on it, beside it, below it
    return {{{x, y - 6}, Svg::middle}, {{right + 18, y + 4}, Svg::start}, {{left - 18, y + 4}, Svg::end},
        {{x, y + 15}, Svg::middle}};
  if (d.along == SectionDrawing::Dimension::Along::x) {
    for (const double away : {-6.0, -12.0, -18.0, 15.0, 21.0}) {
      for (const double from_end : {10.0, 4.0, 16.0, 24.0}) places.push_back({{right - from_end, y + away}, Svg::end});
      for (const double from_end : {4.0, 10.0}) places.push_back({{left + from_end, y + away}, Svg::start});
    }
    return places;
  }
  const std::array<Place, 2> sides = {{{{x + 7, 0}, Svg::start}, {{x - 7, 0}, Svg::end}}};
  for (const double part : {0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8})
    for (const Place& side : sides)
      if (d.shift == 0.0 || (d.shift < 0.0) == (side.anchor == Svg::end))
        places.push_back({{side.at[0], bottom + part * (top - bottom) + 4}, side.anchor});
  if (d.along == SectionDrawing::Dimension::Along::straight)  // nearly level, it has room above and below only
    for (const double away : {6.0, 12.0, 18.0})
      for (const double across : {x, left, right})
        for (const double level : {top - away, bottom + away + 9}) places.push_back({{across, level}, Svg::middle});
  return places;
}

/// Lays a section out: all lines first, then all labels, each where it touches none of them.
class SectionPicture {
 public:
  explicit SectionPicture(const SectionDrawing& s) : s_(s) {
    cover();
    svg_.text({margin, 26}, s.title, {.size = 15, .bold = true});
    svg_.text({margin, 45}, s.subtitle, {.fill = plot::grey});
    for (const auto& area : s.areas) draw_area(area);
    for (const auto& d : s.dimensions) draw_lines(d);
    for (const auto& d : s.dimensions) draw_label(d);
    draw_legend();
  }
  std::string str() const { return svg_.str(); }

 private:
  static constexpr double label_room = 100, legend_width = 180, margin = 24, head = 62, drawing_width = 560;

  void cover() {
    double x1 = 0, z0 = 0;
    const auto include = [&](const Point& p) {
      x0_ = std::min(x0_, p[0]);
      x1 = std::max(x1, p[0]);
      z0 = std::min(z0, p[1]);
      z1_ = std::max(z1_, p[1]);
    };
    for (const auto& a : s_.areas)
      for (const Point& p : a.loop) include(p);
    for (const auto& d : s_.dimensions) include(d.start());
    scale_ = drawing_width / (x1 - x0_);
    svg_ = Svg(margin + 2 * label_room + scale_ * (x1 - x0_) + legend_width, head + margin + 30 + scale_ * (z1_ - z0));
  }

  Point px(const Point& p) const {
    return {margin + label_room + scale_ * (p[0] - x0_), head + 18 + scale_ * (z1_ - p[1])};
  }

  void draw_area(const SectionDrawing::Area& area) {
    Points loop;
    for (const Point& p : area.loop) loop.push_back(px(p));
    svg_.polygon({loop}, paint(area.fill));
    for (std::size_t i = 0; i < loop.size(); ++i) obstacles_.lines.emplace_back(loop[i], loop[(i + 1) % loop.size()]);
  }

  void line(Point a, Point b, const Paint& paint) {
    svg_.line(a, b, paint);
    obstacles_.lines.emplace_back(a, b);
  }

  void draw_lines(const SectionDrawing::Dimension& d) {
    constexpr double room_for_arrows = 22, outside = 14;
    const Point a = px(d.start()), b = px(d.end());
    const Paint thin{.stroke = plot::ink, .width = 0.9}, extension{.stroke = plot::grey, .width = 0.6};
    line(px(d.from), a, extension);
    line(px(d.to), b, extension);
    const double length = std::max(1e-9, std::hypot(b[0] - a[0], b[1] - a[1]));
    const Point u{(b[0] - a[0]) / length, (b[1] - a[1]) / length};
    const bool inside = length > room_for_arrows;  // else the arrows point inwards from outside
    const double back = inside ? 0 : outside, way = inside ? 1 : -1;
    line({a[0] - back * u[0], a[1] - back * u[1]}, {b[0] + back * u[0], b[1] + back * u[1]}, thin);
    arrow(svg_, b, way * u[0], way * u[1]);
    arrow(svg_, a, -way * u[0], -way * u[1]);
  }

  void draw_label(const SectionDrawing::Dimension& d) {
    const std::vector<Place> places = label_places(d, px(d.start()), px(d.end()));
    const auto box = [&d](const Place& p) { return text_box(p.at, d.label, {.anchor = p.anchor}); };
    const auto hits = [&](const Place& p) { return obstacles_.hits(grown(box(p), 2.0)); };
    const auto best = std::min_element(
        places.begin(), places.end(), [&](const Place& p, const Place& q) { return hits(p) < hits(q); });
    const Box taken = box(*best);
    if (hits(*best) > 0)  // readable all the same
      svg_.rect({taken.left, taken.top}, taken.right - taken.left, taken.bottom - taken.top,
          {.fill = "#ffffff", .opacity = 0.75});
    svg_.text(best->at, d.label, {.anchor = best->anchor});
    obstacles_.boxes.push_back(taken);
  }

  void draw_legend() {
    using Fill = SectionDrawing::Fill;
    const double x = svg_.width() - legend_width + 10;
    double y = head + 26;
    for (const auto& [fill, label] : {std::pair{Fill::silicone, "silicone"}, {Fill::carrier, "rigid carrier"},
             {Fill::air, "lateral void (air)"}, {Fill::led, "LED"}}) {
      if (std::none_of(s_.areas.begin(), s_.areas.end(), [f = fill](const auto& a) { return a.fill == f; })) continue;
      svg_.rect({x, y - 11}, 18, 14, paint(fill));
      svg_.text({x + 26, y}, label);
      y += 22;
    }
  }

  const SectionDrawing& s_;
  double x0_ = 0, z1_ = 0, scale_ = 1;  ///< left and upper end [mm], px per mm
  Svg svg_{0, 0};
  Obstacles obstacles_;
};

}  // namespace drawing

inline std::string draw(const SectionDrawing& s) { return drawing::SectionPicture(s).str(); }

}  // namespace lumo::program
