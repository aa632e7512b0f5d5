#pragma once

#include "lumo/core/colour.hpp"
#include "console/text.hpp"

#include <array>
#include <charconv>
#include <cmath>
#include <string>
#include <string_view>
#include <vector>

namespace lumo::program {

using Point = std::array<double, 2>;

/// Colours that people with any colour vision tell apart (Okabe & Ito 2008), darkest contrasts first.
inline constexpr std::array<std::string_view, 7> palette = {"#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000"};

/// Shade k of n from light to dark: ordered things (loads) differ in lightness, which survives greyscale print.
inline std::string shade(int k, int n) {
  const double t = n > 1 ? double(k) / (n - 1) : 1.0;
  const auto mix = [t](int light, int dark) { return int(std::lround(light + t * (dark - light))); };
  return lumo::detail::hex_colour({mix(0xa9, 0x08), mix(0xcf, 0x2c), mix(0xea, 0x5c)});
}

/// How a shape is painted; an empty colour means none.
struct Paint {
  std::string fill = {};
  std::string stroke = {};
  double width = 1.0;       ///< [px]
  double opacity = 1.0;
  std::string dash = {};
};

struct TextStyle {
  double size = 12.0;                ///< [px]
  std::string anchor = "start";      ///< start, middle or end
  std::string fill = "#222222";
  double rotate_deg = 0.0;           ///< about the anchor point
  bool bold = false;
};

/// Collects SVG elements; coordinates in px, y downwards.
class Svg {
 public:
  Svg(double width, double height) : width_(width), height_(height) {}

  void line(Point a, Point b, const Paint& p) {
    body_ += "<line x1=\"" + n(a[0]) + "\" y1=\"" + n(a[1]) + "\" x2=\"" + n(b[0]) + "\" y2=\"" + n(b[1]) + "\"" + style(p) + "/>\n";
  }
  void rect(Point corner, double w, double h, const Paint& p) {
    body_ += "<rect x=\"" + n(corner[0]) + "\" y=\"" + n(corner[1]) + "\" width=\"" + n(w) + "\" height=\"" + n(h) + "\"" + style(p) + "/>\n";
  }
  void circle(Point c, double r, const Paint& p) {
    body_ += "<circle cx=\"" + n(c[0]) + "\" cy=\"" + n(c[1]) + "\" r=\"" + n(r) + "\"" + style(p) + "/>\n";
  }
  void polyline(const std::vector<Point>& points, const Paint& p) { path(trace(points), p); }
  /// One filled shape of several closed loops; holes by the even–odd rule.
  void polygon(const std::vector<std::vector<Point>>& loops, const Paint& p) {
    std::string d;
    for (const auto& loop : loops) d += trace(loop) + "Z";
    path(d, p);
  }
  void text(Point at, std::string_view words, const TextStyle& t = {}) {
    body_ += "<text x=\"" + n(at[0]) + "\" y=\"" + n(at[1]) + "\" font-size=\"" + n(t.size) + "\" text-anchor=\"" + t.anchor + "\" fill=\"" + t.fill + "\"";
    if (t.bold) body_ += " font-weight=\"bold\"";
    if (t.rotate_deg != 0.0) body_ += " transform=\"rotate(" + n(t.rotate_deg) + " " + n(at[0]) + " " + n(at[1]) + ")\"";
    body_ += ">" + escaped(words) + "</text>\n";
  }
  std::string str() const {
    return "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" + n(width_) + "\" height=\"" + n(height_) + "\" viewBox=\"0 0 " + n(width_) + " " + n(height_) +
           "\" font-family=\"DejaVu Sans, Verdana, Helvetica, sans-serif\">\n<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n" + body_ + "</svg>\n";
  }
  double width() const { return width_; }
  double height() const { return height_; }

 private:
  static std::string n(double v) { return short_number(v, 2); }
  static std::string escaped(std::string_view s) {
    std::string out;
    for (const char c : s) {
      if (c == '&') out += "&amp;";
      else if (c == '<') out += "&lt;";
      else if (c == '>') out += "&gt;";
      else if (static_cast<unsigned char>(c) >= 0x20) out += c;   // XML has no control characters
      else out += ' ';
    }
    return out;
  }
  static std::string trace(const std::vector<Point>& points) {
    std::string d;
    for (const Point& p : points) d += (d.empty() ? "M" : "L") + n(p[0]) + " " + n(p[1]);
    return d;
  }
  static std::string style(const Paint& p) {
    std::string s = " fill=\"" + (p.fill.empty() ? "none" : p.fill) + "\"";
    if (!p.stroke.empty()) s += " stroke=\"" + p.stroke + "\" stroke-width=\"" + n(p.width) + "\" stroke-linejoin=\"round\"";
    if (p.opacity < 1.0) s += " opacity=\"" + n(p.opacity) + "\"";
    if (!p.dash.empty()) s += " stroke-dasharray=\"" + p.dash + "\"";
    return s;
  }
  void path(const std::string& d, const Paint& p) { body_ += "<path fill-rule=\"evenodd\" d=\"" + d + "\"" + style(p) + "/>\n"; }

  double width_, height_;
  std::string body_;
};

}  // namespace lumo::program
