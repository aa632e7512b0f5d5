#pragma once

#include "lumo/core/error.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <ostream>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace lumo {

/// A number with at most `digits` decimals and no trailing zeros; the same in every locale. "?" where that takes more
/// than 400 characters.
inline std::string short_number(double v, int digits = 2) {
  std::array<char, 400> buffer;
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), v, std::chars_format::fixed, digits);
  if (end.ec != std::errc{}) return "?";
  std::string s(buffer.data(), end.ptr);
  if (s.find('.') != std::string::npos) {
    while (s.back() == '0') s.pop_back();
    if (s.back() == '.') s.pop_back();
  }
  return s == "-0" ? "0" : s;
}

/// Writes an SVG picture, element by element; coordinates in px or in the page's unit, x to the right, y downwards.
class Svg {
 public:
  using Point = std::array<double, 2>;
  using Points = std::vector<Point>;

  struct Page {
    double width, height;
    std::string unit = {};  ///< of width and height on paper; empty: px
    std::string title = {};
    int digits = 2;  ///< decimals of all numbers
  };
  /// How a shape is painted; an empty colour means none.
  struct Paint {
    std::string fill = {};
    std::string stroke = {};
    double width = 1.0;
    double opacity = 1.0;
    std::string dash = {};
    bool round_ends = false;
  };
  /// Which end of a text stands at its place; `left_out` is `start`, too, but not written.
  enum Anchor { start, middle, end, left_out };
  struct TextStyle {
    double size = 12.0;
    Anchor anchor = start;
    std::string fill = "#222222";
    double rotate_deg = 0.0;  ///< about the anchor point
    bool bold = false;
    std::string stroke = {};  ///< empty: that of the group
  };

  explicit Svg(Page page) : page_(std::move(page)) {}
  Svg(double width, double height) : Svg(Page{width, height}) {}

  double width() const { return page_.width; }
  double height() const { return page_.height; }

  void line(Point a, Point b, const Paint& p) {
    body_ += "<line" + place("x1", "y1", a) + place("x2", "y2", b) + style(p) + "/>\n";
  }
  /// Corners are rounded by `radius`.
  void rect(Point corner, double w, double h, const Paint& p, double radius = 0.0) {
    body_ += box(corner, w, h) + (radius > 0.0 ? quoted("rx", n(radius)) : "") + style(p) + "/>\n";
  }
  void circle(Point c, double r, const Paint& p) {
    body_ += "<circle" + place("cx", "cy", c) + quoted("r", n(r)) + style(p) + "/>\n";
  }
  void polyline(const Points& points, const Paint& p) { path(trace(points), p); }
  /// Several lines as one element.
  void polylines(const std::vector<Points>& lines, const Paint& p) {
    std::string d;
    for (const Points& line : lines) d += trace(line);
    path(d, p);
  }
  /// One filled shape of several closed loops; holes by the even–odd rule.
  void polygon(const std::vector<Points>& loops, const Paint& p) {
    std::string d;
    for (const Points& loop : loops) d += trace(loop) + "Z";
    path(d, p);
  }
  /// A line that is painted as its group says.
  void outline(const Points& points, bool closed) {
    body_ += "<path d=\"" + trace(points) + (closed ? "Z\"/>\n" : "\"/>\n");
  }
  void text(Point at, std::string_view words) { text(at, words, TextStyle{}); }
  void text(Point at, std::string_view words, const TextStyle& t) {
    body_ += "<text" + place("x", "y", at) + quoted("font-size", n(t.size)) + given("text-anchor", words_of(t.anchor)) +
             quoted("fill", t.fill) + given("stroke", t.stroke);
    if (t.bold) body_ += " font-weight=\"bold\"";
    if (t.rotate_deg != 0.0)
      body_ += quoted("transform", "rotate(" + n(t.rotate_deg) + " " + n(at[0]) + " " + n(at[1]) + ")");
    body_ += ">" + escaped(words) + "</text>\n";
  }
  /// All elements up to end_group(), under a name that other programs show as a layer.
  void begin_group(const std::string& name, const Paint& p) { body_ += "<g" + quoted("id", name) + style(p) + ">\n"; }
  /// Only what lies in a box is shown of the elements up to end_group(). Once in a picture.
  void begin_clip(Point corner, double w, double h) {
    body_ += "<clipPath id=\"plot\">" + box(corner, w, h) + "/></clipPath>\n<g clip-path=\"url(#plot)\">\n";
  }
  void end_group() { body_ += "</g>\n"; }

  std::string str() const {
    const std::string w = n(page_.width), h = n(page_.height);
    return "<svg xmlns=\"http://www.w3.org/2000/svg\"" + quoted("width", w + page_.unit) +
           quoted("height", h + page_.unit) + quoted("viewBox", "0 0 " + w + " " + h) +
           " font-family=\"DejaVu Sans, Verdana, Helvetica, sans-serif\">\n" +
           (page_.title.empty() ? "" : "<title>" + escaped(page_.title) + "</title>\n") +
           "<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n" + body_ + "</svg>\n";
  }
  /// Throws InputError when the stream fails.
  void write(std::ostream& out) const {
    if (!(out << str())) throw InputError("writing an .svg file failed");
  }

 private:
  std::string n(double v) const { return short_number(v, page_.digits); }
  static std::string quoted(const char* key, const std::string& value) {
    return std::string(" ") + key + "=\"" + value + "\"";
  }
  static std::string given(const char* key, const std::string& value) {
    return value.empty() ? "" : quoted(key, value);
  }
  static std::string words_of(Anchor a) {
    return a == left_out ? "" : a == end ? "end" : a == middle ? "middle" : "start";
  }
  std::string place(const char* x, const char* y, Point p) const { return quoted(x, n(p[0])) + quoted(y, n(p[1])); }
  std::string box(Point corner, double w, double h) const {
    return "<rect" + place("x", "y", corner) + quoted("width", n(w)) + quoted("height", n(h));
  }
  static std::string escaped(std::string_view s) {
    std::string out;
    for (const char c : s) {
      if (c == '&') out += "&amp;";
      else if (c == '<') out += "&lt;";
      else if (c == '>') out += "&gt;";
      else out += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;  // XML has no control characters
    }
    return out;
  }
  std::string trace(const Points& points) const {
    std::string d;
    for (const Point& p : points) d += (d.empty() ? "M" : "L") + n(p[0]) + " " + n(p[1]);
    return d;
  }
  std::string style(const Paint& p) const {
    std::string s = quoted("fill", p.fill.empty() ? "none" : p.fill);
    if (!p.stroke.empty())
      s += quoted("stroke", p.stroke) + quoted("stroke-width", n(p.width)) + " stroke-linejoin=\"round\"";
    if (p.opacity < 1.0) s += quoted("opacity", n(p.opacity));
    if (p.round_ends) s += " stroke-linecap=\"round\"";
    return s + given("stroke-dasharray", p.dash);
  }
  void path(const std::string& d, const Paint& p) {
    body_ += "<path fill-rule=\"evenodd\"" + quoted("d", d) + style(p) + "/>\n";
  }

  Page page_;
  std::string body_;
};

/// "#rrggbb" of red, green and blue, each 0 … 255.
inline std::string hex_colour(const std::array<int, 3>& rgb) {
  std::string colour = "#";
  for (const int c : rgb)
    for (const int digit : {c / 16, c % 16}) colour += "0123456789abcdef"[digit];
  return colour;
}

/// "#rrggbb" at `part`, 0 … 1, of the way through evenly spaced stops: red, green and blue, each 0 … 255.
template <std::size_t N> std::string colour_between(const std::array<std::array<double, 3>, N>& stops, double part) {
  const double t = double(N - 1) * std::clamp(part, 0.0, 1.0);
  const std::size_t low = std::min(N - 2, std::size_t(t));
  std::array<int, 3> rgb{};
  for (std::size_t k = 0; k < 3; ++k)
    rgb[k] = int(std::lround(stops[low][k] + (t - double(low)) * (stops[low + 1][k] - stops[low][k])));
  return hex_colour(rgb);
}

}  // namespace lumo
