#pragma once

#include "lumo/core/svg.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

/// Headline and axes of a picture with a plot in it.
namespace lumo::plot {

inline constexpr const char *ink = "#222222", *faint = "#dddddd", *grey = "#666666";

/// Plot area; maps data to px. Ticks in units of the data.
struct Frame {
  double left = 72, top = 58, right = 0, bottom = 0;
  std::vector<double> x_ticks = {}, y_ticks = {};
  double x0 = 0, x1 = 1, y0 = 0, y1 = 1;

  double x(double v) const { return left + (v - x0) / (x1 - x0) * (right - left); }
  double y(double v) const { return bottom - (v - y0) / (y1 - y0) * (bottom - top); }
  /// The axes end at the first and at the last tick.
  void fit_x() {
    x0 = x_ticks.front();
    x1 = x_ticks.back();
  }
  void fit_y() {
    y0 = y_ticks.front();
    y1 = y_ticks.back();
  }
};

/// Round tick values that cover [low, high].
inline std::vector<double> ticks(double low, double high, int wanted) {
  if (!(high > low)) high = low + 1.0;
  const double raw = (high - low) / wanted, power = std::pow(10.0, std::floor(std::log10(raw)));
  double step = 10.0 * power;
  for (const double s : {5.0, 2.5, 2.0, 1.0})
    if (s * power >= raw * (1.0 - 1e-9)) step = s * power;
  std::vector<double> out;
  // What sticks out by a millionth of a step (15.0000001 N) does not earn a tick of its own.
  const int first = int(std::floor(low / step + 1e-6));
  const int last = std::max(int(std::ceil(high / step - 1e-6)), first + 1);
  for (int k = first; k <= last; ++k) out.push_back(k * step);
  return out;
}

/// Small magnitudes get a common power of ten in the axis label, not zeros at every tick.
inline int common_exponent(const std::vector<double>& t) {
  const double largest = std::max(std::abs(t.front()), std::abs(t.back()));
  if (largest == 0.0) return 0;
  const int e = int(std::floor(std::log10(largest) + 1e-9));
  return e < -2 || e > 4 ? e : 0;
}

/// A label with the power of ten by which the axis is divided in its unit.
inline std::string with_power(const std::string& label, int e) {
  if (e == 0) return label;
  static constexpr std::array<std::string_view, 10> raised = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  std::string power = e < 0 ? "10⁻" : "10";
  for (const char c : std::to_string(std::abs(e))) power += raised[std::size_t(c - '0')];
  const std::size_t unit = label.rfind('[');
  return unit == std::string::npos ? label + " [" + power + "]"
                                   : label.substr(0, unit + 1) + power + " " + label.substr(unit + 1);
}

/// Tick values as they stand at an axis that is divided by a power of ten, with a true minus sign.
inline std::vector<std::string> tick_texts(std::vector<double> values, int exponent) {
  for (double& v : values) v /= std::pow(10.0, exponent);
  int digits = 0;
  for (double s = values.size() > 1 ? values[1] - values[0] : 1.0; digits < 9 && std::abs(s - std::round(s)) > 1e-6 * s;
       s *= 10.0)
    ++digits;
  std::vector<std::string> texts;
  for (const double v : values) {
    const std::string s = short_number(v, digits);
    texts.push_back(s.starts_with('-') ? "−" + s.substr(1) : s);
  }
  return texts;
}

inline void headline(Svg& svg, double left, const std::string& title, const std::string& subtitle) {
  svg.text({left, 24}, title, {.size = 15, .bold = true});
  svg.text({left, 43}, subtitle, {.fill = grey});
}

inline void x_grid(Svg& svg, const Frame& f, int exponent = 0) {
  const std::vector<std::string> texts = tick_texts(f.x_ticks, exponent);
  for (std::size_t k = 0; k < texts.size(); ++k) {
    const double x = f.x(f.x_ticks[k]);
    svg.line({x, f.top}, {x, f.bottom}, {.stroke = faint});
    svg.text({x, f.bottom + 18}, texts[k], {.anchor = Svg::middle});
  }
}

inline void y_grid(Svg& svg, const Frame& f, int exponent = 0) {
  const std::vector<std::string> texts = tick_texts(f.y_ticks, exponent);
  for (std::size_t k = 0; k < texts.size(); ++k) {
    const double y = f.y(f.y_ticks[k]);
    svg.line({f.left, y}, {f.right, y}, {.stroke = faint});
    svg.text({f.left - 8, y + 4}, texts[k], {.anchor = Svg::end});
  }
}

inline void x_label(Svg& svg, const Frame& f, const std::string& label) {
  svg.text({0.5 * (f.left + f.right), f.bottom + 42}, label, {.size = 13, .anchor = Svg::middle});
}

/// `at`: the baseline's place, in px from the left.
inline void y_label(Svg& svg, const Frame& f, const std::string& label, double at = 22) {
  svg.text({at, 0.5 * (f.top + f.bottom)}, label, {.size = 13, .anchor = Svg::middle, .rotate_deg = -90});
}

/// Grid and label, divided by 10 to the `exponent`.
inline void x_axis(Svg& svg, const Frame& f, const std::string& label, int exponent = 0) {
  x_grid(svg, f, exponent);
  x_label(svg, f, with_power(label, exponent));
}

/// Grid and label, divided by a power of ten where the numbers ask for it.
inline void y_axis(Svg& svg, const Frame& f, const std::string& label) {
  const int exponent = common_exponent(f.y_ticks);
  y_grid(svg, f, exponent);
  y_label(svg, f, with_power(label, exponent));
}

}  // namespace lumo::plot
