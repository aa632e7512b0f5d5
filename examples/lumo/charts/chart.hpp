#pragma once

#include "lumo/drawing/plot.hpp"
#include "lumo/drawing/svg.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace lumo::program {

using Point = Svg::Point;
using Points = Svg::Points;
using Paint = Svg::Paint;

/// Colours that people with any colour vision distinguish (Okabe & Ito 2008), darkest contrasts first.
inline constexpr std::array<const char*, 7> palette = {
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000"};

/// Shade k of n from light to dark: ordered things (loads) differ in lightness, which survives greyscale print.
inline std::string shade(int k, int n) {
  constexpr std::array<std::array<double, 3>, 2> ends{{{0xa9, 0xcf, 0xea}, {0x08, 0x2c, 0x5c}}};
  return colour_between(ends, n > 1 ? double(k) / (n - 1) : 1.0);
}

}  // namespace lumo::program

/// How much room a text takes, and whether something is in its way. All in px, y downwards.
namespace lumo::program::drawing {

/// Advance widths of DejaVu Sans from ' ' to '~', in thousandths of the size (from the font's table hmtx,
/// version 2.37). It is the first font of every picture.
inline constexpr std::array<int, 95> advance_widths = {318, 401, 460, 838, 636, 950, 780, 275, 390, 390, 500, 838, 318,
    361, 318, 337, 636, 636, 636, 636, 636, 636, 636, 636, 636, 636, 337, 337, 838, 838, 838, 531, 1000, 684, 686, 698,
    770, 632, 575, 775, 752, 295, 295, 656, 557, 863, 748, 787, 603, 787, 695, 635, 611, 732, 684, 989, 685, 611, 685,
    390, 337, 390, 838, 500, 500, 613, 635, 550, 635, 615, 352, 635, 634, 278, 278, 579, 278, 974, 634, 612, 635, 635,
    411, 521, 392, 634, 592, 818, 592, 592, 525, 636, 337, 636, 838};

/// Width of a text in DejaVu Sans; other than ASCII characters count as one mean width each.
inline double text_width(std::string_view s, double size) {
  double width = 0.0;
  for (const char c : s) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte >= 32 && byte < 127) width += advance_widths[byte - 32u];
    else if ((byte & 0xC0u) != 0x80u) width += 620.0;  // the bytes of one character count once
  }
  return 1e-3 * size * width;
}

struct Box {
  double left, top, right, bottom;
};

/// What a text covers when it stands at `at`: from the height of its capitals to the depth of its tails.
inline Box text_box(Point at, std::string_view words, const Svg::TextStyle& t) {
  const double width = text_width(words, t.size), left = t.anchor == Svg::end      ? at[0] - width
                                                         : t.anchor == Svg::middle ? at[0] - 0.5 * width
                                                                                   : at[0];
  return {left, at[1] - 0.76 * t.size, left + width, at[1] + 0.24 * t.size};
}

inline Box grown(const Box& b, double by) { return {b.left - by, b.top - by, b.right + by, b.bottom + by}; }

inline bool overlap(const Box& a, const Box& b) {
  return a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
}

/// Whether the line from a to b passes through the box (Liang, Barsky 1984: the part of it that lies between each pair
/// of sides).
inline bool overlap(const Box& box, Point a, Point b) {
  double from = 0.0, to = 1.0;
  for (const auto& [start, step, low, high] :
      {std::array{a[0], b[0] - a[0], box.left, box.right}, std::array{a[1], b[1] - a[1], box.top, box.bottom}}) {
    if (step == 0.0) {
      if (start <= low || start >= high) return false;
      continue;
    }
    const auto [enters, leaves] = std::minmax({(low - start) / step, (high - start) / step});
    from = std::max(from, enters);
    to = std::min(to, leaves);
  }
  return from < to;
}

/// What labels are to keep off.
struct Obstacles {
  std::vector<std::pair<Point, Point>> lines;
  std::vector<Box> boxes;

  auto hits(const Box& b) const {
    return std::count_if(lines.begin(), lines.end(), [&](const auto& l) { return overlap(b, l.first, l.second); }) +
           std::count_if(boxes.begin(), boxes.end(), [&](const Box& other) { return overlap(b, other); });
  }
};

}  // namespace lumo::program::drawing

namespace lumo::program {

/// One curve of a line chart.
struct Curve {
  std::string label;  ///< empty: not in the legend
  std::string colour;
  Points points;
  double width = 1.8;
  bool markers = true;
  double opacity = 1.0;
};

struct LineChart {
  std::string title, subtitle, x_label, y_label;
  std::vector<Curve> curves;
};

/// One group of bars: a value per category, with half lengths of error bars where known.
struct BarSeries {
  std::string label;
  std::string colour;
  std::vector<double> values;
  std::vector<double> errors;  ///< empty, or one per value
};

struct BarChart {
  std::string title, subtitle, x_label, y_label;
  std::vector<std::string> categories;
  std::vector<BarSeries> series;
};

/// Bars that lie, one below the other: what each of many causes changes, with an interval. What is far beyond most
/// others is cut off at an arrow, with its number.
struct TornadoChart {
  struct Row {
    std::string label;
    double value, low, high;
    std::string note;  ///< beside the plot
  };
  std::string title, subtitle, x_label;
  std::string note;  ///< heads the column of notes
  std::vector<Row> rows;
};

namespace drawing {

struct LegendEntry {
  std::string label, colour;
  bool bar;
};

/// Entries below each other, right of the plot.
inline void legend(Svg& svg, const plot::Frame& f, const std::vector<LegendEntry>& entries) {
  double y = f.top + 8;
  for (const auto& e : entries) {
    if (e.bar) svg.rect({f.right + 16, y - 6}, 14, 12, {.fill = e.colour});
    else svg.line({f.right + 14, y}, {f.right + 34, y}, {.stroke = e.colour, .width = 3});
    svg.text({f.right + 40, y + 4}, e.label);
    y += 20;
  }
}

/// Width right of the plot, for the legend.
inline double legend_room(const std::vector<LegendEntry>& entries) {
  double room = 24;
  for (const auto& e : entries) room = std::max(room, 52 + text_width(e.label, 12));
  return room;
}

inline plot::Frame frame_for(const std::vector<LegendEntry>& entries, double width, double height) {
  return {.right = width - legend_room(entries), .bottom = height - 58};
}

/// An interval about a bar's end, with a cap at each end of it; `along` is 0 for x, 1 for y.
inline void whisker(Svg& svg, std::size_t along, double across, double from, double to, double cap) {
  const auto line = [&](const Point& a, const Point& b) {
    const std::size_t x = along, y = 1 - along;  // places of the two coordinates
    svg.line({a[x], a[y]}, {b[x], b[y]}, {.stroke = plot::ink, .width = 1.1});
  };
  line({from, across}, {to, across});
  for (const double end : {from, to}) line({end, across - cap}, {end, across + cap});
}

}  // namespace drawing

inline std::string draw(const LineChart& chart) {
  std::vector<drawing::LegendEntry> entries;
  Point low{0, 0}, high{0, 0};
  for (const auto& c : chart.curves) {
    if (!c.label.empty()) entries.push_back({c.label, c.colour, false});
    for (const Point& p : c.points)
      for (std::size_t i = 0; i < 2; ++i) {
        low[i] = std::min(low[i], p[i]);
        high[i] = std::max(high[i], p[i]);
      }
  }
  Svg svg(760, 480);
  plot::Frame f = drawing::frame_for(entries, svg.width(), svg.height());
  f.x_ticks = plot::ticks(low[0], high[0], 7);
  f.y_ticks = plot::ticks(low[1], high[1], 6);
  f.fit_x();
  f.fit_y();

  plot::headline(svg, f.left, chart.title, chart.subtitle);
  plot::y_axis(svg, f, chart.y_label);
  plot::x_axis(svg, f, chart.x_label);
  svg.polyline({{f.left, f.top}, {f.left, f.bottom}, {f.right, f.bottom}}, {.stroke = plot::ink, .width = 1.2});
  for (const auto& c : chart.curves) {
    Points px;
    for (const Point& p : c.points) px.push_back({f.x(p[0]), f.y(p[1])});
    svg.polyline(px, {.stroke = c.colour, .width = c.width, .opacity = c.opacity});
    if (c.markers)
      for (const Point& p : px)
        svg.circle(p, 3.2, {.fill = c.colour, .stroke = "#ffffff", .width = 0.8, .opacity = c.opacity});
  }
  drawing::legend(svg, f, entries);
  return svg.str();
}

inline std::string draw(const BarChart& chart) {
  const auto error = [](const BarSeries& s, std::size_t i) { return i < s.errors.size() ? s.errors[i] : 0.0; };
  std::vector<drawing::LegendEntry> entries;
  double low = 0, high = 0;
  for (const auto& s : chart.series) {
    if (!s.label.empty()) entries.push_back({s.label, s.colour, true});
    for (std::size_t i = 0; i < s.values.size(); ++i) {
      low = std::min(low, s.values[i] - error(s, i));
      high = std::max(high, s.values[i] + error(s, i));
    }
  }
  Svg svg(860, 460);
  plot::Frame f = drawing::frame_for(entries, svg.width(), svg.height());
  f.y_ticks = plot::ticks(low, high, 6);
  f.fit_y();
  f.x1 = double(std::max<std::size_t>(1, chart.categories.size()));

  plot::headline(svg, f.left, chart.title, chart.subtitle);
  plot::y_axis(svg, f, chart.y_label);
  const double slot = f.x(1) - f.x(0), width = 0.8 * slot / double(std::max<std::size_t>(1, chart.series.size()));
  for (std::size_t i = 0; i < chart.categories.size(); ++i) {
    const double left = f.x(double(i));
    svg.text({f.x(double(i) + 0.5), f.bottom + 18}, chart.categories[i], {.anchor = Svg::middle});
    if (i > 0) svg.line({left, f.bottom}, {left, f.bottom + 5}, {.stroke = plot::ink});
    for (std::size_t s = 0; s < chart.series.size(); ++s) {
      const auto& series = chart.series[s];
      if (i >= series.values.size() || !std::isfinite(series.values[i])) continue;
      const double v = series.values[i], e = error(series, i), x = left + 0.1 * slot + double(s) * width;
      const double top = f.y(std::max(v, 0.0)), bottom = f.y(std::min(v, 0.0));
      svg.rect({x, top}, std::max(0.5, width - 0.6), bottom - top, {.fill = series.colour});
      if (e > 0.0) drawing::whisker(svg, 1, x + 0.5 * width, f.y(v + e), f.y(v - e), std::min(4.0, 0.4 * width));
    }
  }
  svg.line({f.left, f.y(0)}, {f.right, f.y(0)}, {.stroke = plot::ink, .width = 1.2});
  svg.line({f.left, f.top}, {f.left, f.bottom}, {.stroke = plot::ink, .width = 1.2});
  plot::x_label(svg, f, chart.x_label);
  drawing::legend(svg, f, entries);
  return svg.str();
}

namespace drawing {

/// What a tornado's axis reaches on either side: twice what seven in ten bars reach, or all.
inline double reach(const std::vector<TornadoChart::Row>& rows) {
  std::vector<double> far{0.0};
  for (const auto& r : rows) far.push_back(std::max({std::abs(r.value), std::abs(r.low), std::abs(r.high)}));
  std::sort(far.begin(), far.end());
  const double most = 2.0 * far[far.size() * 7 / 10];
  return most > 0.0 ? std::min(most, far.back()) : far.back();
}

/// A row's bar and interval, from `y` on, cut off at the ends of the axis.
inline void tornado_bar(Svg& svg, const plot::Frame& f, const TornadoChart::Row& r, double y) {
  const auto inside = [&](double v) { return std::clamp(v, f.x0, f.x1); };
  const double a = f.x(inside(std::min(0.0, r.value))), b = f.x(inside(std::max(0.0, r.value)));
  svg.rect({a, y - 7}, std::max(0.5, b - a), 14, {.fill = palette[r.value < 0.0 ? 1 : 0]});
  if (r.high > r.low) whisker(svg, 0, y, f.x(inside(r.low)), f.x(inside(r.high)), 4);
  if (r.value > f.x1)
    svg.text({f.right - 6, y + 4}, short_number(r.value, 0) + " →", {.anchor = Svg::end, .fill = "#fff"});
  else if (r.high > f.x1) svg.text({f.right + 1, y + 4}, "→");
  if (r.value < f.x0) svg.text({f.left + 6, y + 4}, "← " + short_number(r.value, 0), {.fill = "#fff"});
  else if (r.low < f.x0) svg.text({f.left - 1, y + 4}, "←", {.anchor = Svg::end});
}

}  // namespace drawing

inline std::string draw(const TornadoChart& chart) {
  double low = 0, high = 0, labels = 0, notes = drawing::text_width(chart.note, 12);
  const double reach = drawing::reach(chart.rows);
  for (const auto& r : chart.rows) {
    low = std::max(-reach, std::min({low, r.value, r.low}));
    high = std::min(reach, std::max({high, r.value, r.high}));
    labels = std::max(labels, drawing::text_width(r.label, 12));
    notes = std::max(notes, drawing::text_width(r.note, 12));
  }
  constexpr double slot = 24;
  plot::Frame f{.left = 24 + labels, .top = 84};
  f.right = f.left + 480;
  f.bottom = f.top + slot * double(std::max<std::size_t>(1, chart.rows.size()));
  Svg svg(f.right + 48 + notes, f.bottom + 58);
  f.x_ticks = plot::ticks(low, high, 7);
  f.fit_x();

  plot::headline(svg, 16, chart.title, chart.subtitle);
  svg.text({f.right + 16, f.top - 12}, chart.note, {.fill = plot::grey});
  plot::x_axis(svg, f, chart.x_label, plot::common_exponent(f.x_ticks));
  for (std::size_t k = 0; k < chart.rows.size(); ++k) {
    const auto& r = chart.rows[k];
    const double y = f.top + slot * (double(k) + 0.5);
    svg.text({f.left - 8, y + 4}, r.label, {.anchor = Svg::end});
    drawing::tornado_bar(svg, f, r, y);
    svg.text({f.right + 16, y + 4}, r.note);
  }
  svg.line({f.x(0), f.top}, {f.x(0), f.bottom}, {.stroke = plot::ink, .width = 1.2});
  svg.line({f.left, f.bottom}, {f.right, f.bottom}, {.stroke = plot::ink, .width = 1.2});
  return svg.str();
}

}  // namespace lumo::program
