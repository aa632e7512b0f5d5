#pragma once

#include "drawing/svg.hpp"
#include "drawing/text_box.hpp"

#include <algorithm>
#include <limits>
#include <string>
#include <vector>

namespace lumo::program {

/// One curve of a line chart.
struct Curve {
  std::string label;              ///< empty: not in the legend
  std::string colour;
  std::vector<Point> points;
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
  std::vector<double> errors;     ///< empty, or one per value
};

struct BarChart {
  std::string title, subtitle, x_label, y_label;
  std::vector<std::string> categories;
  std::vector<BarSeries> series;
};

/// Bars that lie, one below the other: what each of many causes changes, with an interval.
struct TornadoChart {
  struct Row {
    std::string label;
    double value, low, high;
    std::string note;             ///< beside the plot
  };
  std::string title, subtitle, x_label;
  std::string note;               ///< heads the column of notes
  std::vector<Row> rows;
};

std::string draw(const LineChart& chart);
std::string draw(const BarChart& chart);
std::string draw(const TornadoChart& chart);

namespace detail {

/// Round tick values that cover [low, high].
inline std::vector<double> ticks(double low, double high, int wanted) {
  if (!(high > low)) high = low + 1.0;
  const double raw = (high - low) / wanted, power = std::pow(10.0, std::floor(std::log10(raw)));
  double step = 10.0 * power;
  for (const double s : {1.0, 2.0, 2.5, 5.0})
    if (s * power >= raw * (1.0 - 1e-9)) {
      step = s * power;
      break;
    }
  std::vector<double> out;
  // What sticks out by a millionth of a step (15.0000001 N) does not earn a tick of its own.
  const int first = int(std::floor(low / step + 1e-6)), last = std::max(int(std::ceil(high / step - 1e-6)), first + 1);
  for (int k = first; k <= last; ++k) out.push_back(k * step);
  return out;
}

inline int decimals(const std::vector<double>& t) {
  const double step = t.size() > 1 ? t[1] - t[0] : 1.0;
  int digits = 0;
  for (double s = step; digits < 9 && std::abs(s - std::round(s)) > 1e-6 * s; s *= 10.0) ++digits;
  return digits;
}

/// Plot area with axes; maps data to px.
struct Frame {
  double left = 72, top = 58, right = 0, bottom = 0;
  std::vector<double> x_ticks, y_ticks;
  double x0 = 0, x1 = 1, y0 = 0, y1 = 1;

  double x(double v) const { return left + (v - x0) / (x1 - x0) * (right - left); }
  double y(double v) const { return bottom - (v - y0) / (y1 - y0) * (bottom - top); }
};

inline constexpr std::string_view ink = "#222222", faint = "#dddddd", grey = "#666666";

inline void headline(Svg& svg, double left, const std::string& title, const std::string& subtitle) {
  svg.text({left, 24}, title, {.size = 15, .bold = true});
  svg.text({left, 43}, subtitle, {.size = 12, .fill = std::string(grey)});
}

/// Small magnitudes get a common power of ten in the axis label, not zeros at every tick.
inline int common_exponent(const std::vector<double>& t) {
  const double largest = std::max(std::abs(t.front()), std::abs(t.back()));
  if (largest == 0.0) return 0;
  const int e = int(std::floor(std::log10(largest) + 1e-9));
  return e < -2 || e > 4 ? e : 0;
}

inline std::string superscript(int e) {
  static constexpr std::array<std::string_view, 10> digit = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  std::string s = e < 0 ? "⁻" : "";
  for (const char c : std::to_string(std::abs(e))) s += digit[std::size_t(c - '0')];
  return s;
}

/// A number at an axis, with a true minus sign.
inline std::string tick(double v, int digits) {
  const std::string s = short_number(v, digits);
  return s.starts_with('-') ? "−" + s.substr(1) : s;
}

/// A label with the power of ten by which the axis is divided in its unit.
inline std::string with_power(const std::string& label, int e) {
  if (e == 0) return label;
  const std::string power = "10" + superscript(e);
  const std::size_t unit = label.rfind('[');
  return unit == std::string::npos ? label + " [" + power + "]" : label.substr(0, unit + 1) + power + " " + label.substr(unit + 1);
}

/// Tick values as they stand at an axis that is divided by a power of ten.
inline std::vector<std::string> tick_texts(std::vector<double> values, int exponent) {
  for (double& v : values) v /= std::pow(10.0, exponent);
  std::vector<std::string> texts;
  for (const double v : values) texts.push_back(tick(v, decimals(values)));
  return texts;
}

inline void y_axis(Svg& svg, const Frame& f, const std::string& label) {
  const int e = common_exponent(f.y_ticks);
  const std::vector<std::string> texts = tick_texts(f.y_ticks, e);
  for (std::size_t k = 0; k < texts.size(); ++k) {
    const double y = f.y(f.y_ticks[k]);
    svg.line({f.left, y}, {f.right, y}, {.stroke = std::string(faint)});
    svg.text({f.left - 8, y + 4}, texts[k], {.anchor = "end"});
  }
  svg.text({22, 0.5 * (f.top + f.bottom)}, with_power(label, e), {.size = 13, .anchor = "middle", .rotate_deg = -90});
}

/// Divided by 10 to the `exponent`.
inline void x_axis(Svg& svg, const Frame& f, const std::string& label, int exponent = 0) {
  const std::vector<std::string> texts = tick_texts(f.x_ticks, exponent);
  for (std::size_t k = 0; k < texts.size(); ++k) {
    const double x = f.x(f.x_ticks[k]);
    svg.line({x, f.top}, {x, f.bottom}, {.stroke = std::string(faint)});
    svg.text({x, f.bottom + 18}, texts[k], {.anchor = "middle"});
  }
  svg.text({0.5 * (f.left + f.right), f.bottom + 42}, with_power(label, exponent), {.size = 13, .anchor = "middle"});
}

struct LegendEntry {
  std::string label, colour;
  bool bar;
};

/// Entries below each other, right of the plot.
inline void legend(Svg& svg, const Frame& f, const std::vector<LegendEntry>& entries) {
  double y = f.top + 8;
  for (const auto& e : entries) {
    if (e.bar) svg.rect({f.right + 16, y - 6}, 14, 12, {.fill = e.colour});
    else svg.line({f.right + 14, y}, {f.right + 34, y}, {.stroke = e.colour, .width = 3});
    svg.text({f.right + 40, y + 4}, e.label);
    y += 20;
  }
}

inline Frame frame_for(const std::vector<LegendEntry>& entries, double width, double height) {
  Frame f;
  double room = 24;
  for (const auto& e : entries) room = std::max(room, 52 + text_width(e.label, 12));
  f.right = width - room;
  f.bottom = height - 58;
  return f;
}

}  // namespace detail

inline std::string draw(const LineChart& chart) {
  std::vector<detail::LegendEntry> entries;
  double x_high = 0, y_high = 0, x_low = 0, y_low = 0;
  for (const auto& c : chart.curves) {
    if (!c.label.empty()) entries.push_back({c.label, c.colour, false});
    for (const Point& p : c.points) {
      x_low = std::min(x_low, p[0]), x_high = std::max(x_high, p[0]);
      y_low = std::min(y_low, p[1]), y_high = std::max(y_high, p[1]);
    }
  }
  Svg svg(760, 480);
  detail::Frame f = detail::frame_for(entries, svg.width(), svg.height());
  f.x_ticks = detail::ticks(x_low, x_high, 7);
  f.y_ticks = detail::ticks(y_low, y_high, 6);
  f.x0 = f.x_ticks.front(), f.x1 = f.x_ticks.back(), f.y0 = f.y_ticks.front(), f.y1 = f.y_ticks.back();

  detail::headline(svg, f.left, chart.title, chart.subtitle);
  detail::y_axis(svg, f, chart.y_label);
  detail::x_axis(svg, f, chart.x_label);
  svg.polyline({{f.left, f.top}, {f.left, f.bottom}, {f.right, f.bottom}}, {.stroke = std::string(detail::ink), .width = 1.2});
  for (const auto& c : chart.curves) {
    std::vector<Point> px;
    for (const Point& p : c.points) px.push_back({f.x(p[0]), f.y(p[1])});
    svg.polyline(px, {.stroke = c.colour, .width = c.width, .opacity = c.opacity});
    if (c.markers)
      for (const Point& p : px) svg.circle(p, 3.2, {.fill = c.colour, .stroke = "#ffffff", .width = 0.8, .opacity = c.opacity});
  }
  detail::legend(svg, f, entries);
  return svg.str();
}

inline std::string draw(const BarChart& chart) {
  std::vector<detail::LegendEntry> entries;
  double low = 0, high = 0;
  for (const auto& s : chart.series) {
    if (!s.label.empty()) entries.push_back({s.label, s.colour, true});
    for (std::size_t i = 0; i < s.values.size(); ++i) {
      const double e = i < s.errors.size() ? s.errors[i] : 0.0;
      low = std::min(low, s.values[i] - e), high = std::max(high, s.values[i] + e);
    }
  }
  Svg svg(860, 460);
  detail::Frame f = detail::frame_for(entries, svg.width(), svg.height());
  f.y_ticks = detail::ticks(low, high, 6);
  f.y0 = f.y_ticks.front(), f.y1 = f.y_ticks.back();
  f.x0 = 0, f.x1 = double(std::max<std::size_t>(1, chart.categories.size()));

  detail::headline(svg, f.left, chart.title, chart.subtitle);
  detail::y_axis(svg, f, chart.y_label);
  const std::size_t bars = std::max<std::size_t>(1, chart.series.size());
  const double slot = f.x(1) - f.x(0), width = 0.8 * slot / double(bars);
  for (std::size_t i = 0; i < chart.categories.size(); ++i) {
    svg.text({f.x(double(i) + 0.5), f.bottom + 18}, chart.categories[i], {.anchor = "middle"});
    if (i > 0) svg.line({f.x(double(i)), f.bottom}, {f.x(double(i)), f.bottom + 5}, {.stroke = std::string(detail::ink)});
    for (std::size_t s = 0; s < chart.series.size(); ++s) {
      const auto& series = chart.series[s];
      if (i >= series.values.size() || !std::isfinite(series.values[i])) continue;
      const double v = series.values[i], x = f.x(double(i)) + 0.1 * slot + double(s) * width;
      const double top = f.y(std::max(v, 0.0)), bottom = f.y(std::min(v, 0.0));
      svg.rect({x, top}, std::max(0.5, width - 0.6), bottom - top, {.fill = series.colour});
      if (i < series.errors.size() && series.errors[i] > 0.0) {
        const double cx = x + 0.5 * width, a = f.y(v + series.errors[i]), b = f.y(v - series.errors[i]), cap = std::min(4.0, 0.4 * width);
        const Paint whisker{.stroke = std::string(detail::ink), .width = 1.1};
        svg.line({cx, a}, {cx, b}, whisker);
        svg.line({cx - cap, a}, {cx + cap, a}, whisker);
        svg.line({cx - cap, b}, {cx + cap, b}, whisker);
      }
    }
  }
  svg.line({f.left, f.y(0)}, {f.right, f.y(0)}, {.stroke = std::string(detail::ink), .width = 1.2});
  svg.line({f.left, f.top}, {f.left, f.bottom}, {.stroke = std::string(detail::ink), .width = 1.2});
  svg.text({0.5 * (f.left + f.right), f.bottom + 42}, chart.x_label, {.size = 13, .anchor = "middle"});
  detail::legend(svg, f, entries);
  return svg.str();
}

inline std::string draw(const TornadoChart& chart) {
  double low = 0, high = 0, labels = 0, notes = detail::text_width(chart.note, 12);
  for (const auto& r : chart.rows) {
    low = std::min({low, r.value, r.low}), high = std::max({high, r.value, r.high});
    labels = std::max(labels, detail::text_width(r.label, 12)), notes = std::max(notes, detail::text_width(r.note, 12));
  }
  constexpr double slot = 24;
  detail::Frame f;
  f.left = 24 + labels, f.top = 84, f.right = f.left + 480, f.bottom = f.top + slot * double(std::max<std::size_t>(1, chart.rows.size()));
  Svg svg(f.right + 48 + notes, f.bottom + 58);
  f.x_ticks = detail::ticks(low, high, 7);
  f.x0 = f.x_ticks.front(), f.x1 = f.x_ticks.back();

  detail::headline(svg, 16, chart.title, chart.subtitle);
  svg.text({f.right + 16, f.top - 12}, chart.note, {.fill = std::string(detail::grey)});
  detail::x_axis(svg, f, chart.x_label, detail::common_exponent(f.x_ticks));
  for (std::size_t k = 0; k < chart.rows.size(); ++k) {
    const auto& r = chart.rows[k];
    const double y = f.top + slot * (double(k) + 0.5), a = f.x(std::min(0.0, r.value)), b = f.x(std::max(0.0, r.value));
    svg.text({f.left - 8, y + 4}, r.label, {.anchor = "end"});
    svg.rect({a, y - 7}, std::max(0.5, b - a), 14, {.fill = std::string(palette[r.value < 0.0 ? 1 : 0])});
    if (r.high > r.low) {
      const Paint whisker{.stroke = std::string(detail::ink), .width = 1.1};
      svg.line({f.x(r.low), y}, {f.x(r.high), y}, whisker);
      for (const double end : {r.low, r.high}) svg.line({f.x(end), y - 4}, {f.x(end), y + 4}, whisker);
    }
    svg.text({f.right + 16, y + 4}, r.note);
  }
  svg.line({f.x(0), f.top}, {f.x(0), f.bottom}, {.stroke = std::string(detail::ink), .width = 1.2});
  svg.line({f.left, f.bottom}, {f.right, f.bottom}, {.stroke = std::string(detail::ink), .width = 1.2});
  return svg.str();
}

}  // namespace lumo::program
