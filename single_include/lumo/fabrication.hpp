// lumo/fabrication.hpp in one file; made by single_include/generate, not to be edited. Needs C++20 and Eigen.
//
// MIT License
//
// Copyright (c) 2026 the lumo authors
//
// Permission is hereby granted, free of charge, to any person obtaining a copy
// of this software and associated documentation files (the "Software"), to deal
// in the Software without restriction, including without limitation the rights
// to use, copy, modify, merge, publish, distribute, sublicense, and/or sell
// copies of the Software, and to permit persons to whom the Software is
// furnished to do so, subject to the following conditions:
//
// The above copyright notice and this permission notice shall be included in all
// copies or substantial portions of the Software.
//
// THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR
// IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY,
// FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE
// AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER
// LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM,
// OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE
// SOFTWARE.

#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <limits>
#include <locale>
#include <map>
#include <memory>
#include <numbers>
#include <numeric>
#include <optional>
#include <ostream>
#include <span>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <tuple>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

// ---- lumo/version.hpp
#ifndef SINGLE_INCLUDE_LUMO_VERSION_HPP
#define SINGLE_INCLUDE_LUMO_VERSION_HPP

namespace lumo {

/// Version of this library, by semantic versioning: before 1.0 a new minor version may break its users, a new patch
/// does not. These three numbers are the only place where it stands; CMake and pkg-config read them here.
inline constexpr int version_major = 0;
inline constexpr int version_minor = 1;
inline constexpr int version_patch = 0;

}  // namespace lumo

#endif

// ---- lumo/core/error.hpp
#ifndef SINGLE_INCLUDE_LUMO_CORE_ERROR_HPP
#define SINGLE_INCLUDE_LUMO_CORE_ERROR_HPP

namespace lumo {

/// Base of everything that lumo throws. The text is one line: what, value, limit, unit.
class Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The caller broke a contract: an argument out of its range, not finite, or of the wrong shape.
class InvalidArgument : public Error {
 public:
  using Error::Error;
};

/// A design outside its space; names the broken constraint and by how much it is broken.
class InfeasibleDesign : public Error {
 public:
  InfeasibleDesign(std::string constraint, double value, double limit, std::string unit, const std::string& text)
      : Error(text), constraint_(std::move(constraint)), value_(value), limit_(limit), unit_(std::move(unit)) {}

  const std::string& constraint() const { return constraint_; }
  double value() const { return value_; }
  double limit() const { return limit_; }
  const std::string& unit() const { return unit_; }
  /// How far beyond the limit, in `unit()`; NaN if the value is not a number.
  double excess() const { return std::abs(value_ - limit_); }

 private:
  std::string constraint_;
  double value_;
  double limit_;
  std::string unit_;
};

/// The input was sound, and yet there is no result.
class NumericalError : public Error {
 public:
  using Error::Error;
};

/// A surface that cannot be meshed, or a mesh that fails a quality gate.
class MeshError : public NumericalError {
 public:
  enum class Reason {
    not_finite,         ///< a coordinate is NaN, infinite or absurdly large
    bad_index,          ///< a facet names a vertex that is not there
    degenerate,         ///< a facet without area, or a body without volume
    duplicate,          ///< two vertices at one place
    open,               ///< an edge without a partner
    not_manifold,       ///< an edge with more than two facets, or facets of opposite orientation
    self_intersecting,  ///< facets that cross
    crashed,            ///< the mesher died
    timed_out,          ///< the mesher ran out of time
    out_of_memory,      ///< the mesher ran out of memory
    inverted,           ///< an element whose Jacobian is not positive everywhere
    inaccurate,         ///< the mesh's volume or surface is not the body's
    asymmetric          ///< not its own mirror image where it claims to be
  };
  MeshError(Reason reason, const std::string& text) : NumericalError(text), reason_(reason) {}
  Reason reason() const { return reason_; }

 private:
  Reason reason_;
};

/// A press found no equilibrium where one is needed to go on.
class PressFailure : public NumericalError {
 public:
  using NumericalError::NumericalError;
};

/// A file or stream that cannot be read or written, or whose contents are not valid.
class InputError : public Error {
 public:
  using Error::Error;
};

/// The shortest spelling that reads back as the same number: a message must not round a value onto the limit that it
/// breaks. NaN has no sign.
inline std::string exact(double value) {
  if (std::isnan(value)) return "nan";
  char digits[32];
  return {digits, std::to_chars(digits, digits + sizeof digits, value).ptr};
}

/// Foreign text as a message may show it: at most `most` characters, '?' for what is not ASCII.
inline std::string printable(std::string_view s, std::size_t most = 40) {
  std::string p;
  for (const char c : s.substr(0, most)) p += c >= ' ' && c <= '~' ? c : '?';
  return p + (s.size() > most ? "..." : "");
}

/// Joins its arguments into one line of text, the same under every locale: it also becomes SQL and files.
template <class... Args> std::string message(const Args&... args) {
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out.precision(10);
  (out << ... << args);
  return out.str();
}

/// Throws InvalidArgument unless `value` is finite and lies in [low, high].
inline void require_in_range(const char* what, double value, double low, double high, const char* unit) {
  if (std::isfinite(value) && value >= low && value <= high) return;
  throw InvalidArgument(message(what, " is ", exact(value), " ", unit, ", must lie in [", low, ", ", high, "] ", unit));
}

/// What a quantity may be, ends included.
struct Limits {
  double low, high;
};

inline void require_in_range(const char* what, double value, const Limits& limits, const char* unit) {
  require_in_range(what, value, limits.low, limits.high, unit);
}

/// Throws InvalidArgument unless `value` is finite.
inline void require_finite(const char* what, double value, const char* unit) {
  if (std::isfinite(value)) return;
  throw InvalidArgument(message(what, " is ", exact(value), " ", unit, ", must be finite"));
}

/// Throws InvalidArgument unless `value` is finite and positive.
inline void require_positive(const char* what, double value, const char* unit) {
  if (std::isfinite(value) && value > 0.0) return;
  throw InvalidArgument(message(what, " is ", value, " ", unit, ", must be finite and > 0 ", unit));
}

/// The parts of a list with commas between them; `text(part)` is what stands for one.
template <class List, class Text> std::string listing(const List& list, Text&& text) {
  std::string all;
  for (const auto& part : list) all += (all.empty() ? "" : ", ") + std::string(text(part));
  return all;
}

}  // namespace lumo

#endif

// ---- lumo/drawing/svg.hpp
#ifndef SINGLE_INCLUDE_LUMO_DRAWING_SVG_HPP
#define SINGLE_INCLUDE_LUMO_DRAWING_SVG_HPP

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

#endif

// ---- lumo/fabrication/drawing.hpp
#ifndef SINGLE_INCLUDE_LUMO_FABRICATION_DRAWING_HPP
#define SINGLE_INCLUDE_LUMO_FABRICATION_DRAWING_HPP

namespace lumo {

/// A length in mm with at most six digits after the point: nanometres. The same in every locale.
inline std::string in_mm(double length_m) { return short_number(1e3 * length_m, 6); }

/// A flat drawing for cutting and checking; lengths in m, x to the right, y upwards.
struct Drawing {
  using Point = std::array<double, 2>;
  struct Layer {
    std::string name;    ///< capitals and _ only
    int dxf_color;       ///< AutoCAD's colour index, 1 to 255
    std::string stroke;  ///< the same, as CSS writes it
  };
  struct Line {
    int layer;
    std::vector<Point> points;
    bool closed = true;
  };
  struct Label {
    int layer;
    Point at;           ///< left end of its baseline
    double height;      ///< of capitals
    std::string words;  ///< ASCII
  };

  std::string title;
  std::vector<Layer> layers;
  std::vector<Line> lines;
  std::vector<Label> labels;

  /// Lower left and upper right corner of all lines.
  std::array<Point, 2> box() const {
    constexpr double far = std::numeric_limits<double>::infinity();
    Point low{far, far}, high{-far, -far};
    for (const Line& line : lines)
      for (const Point& p : line.points) {
        low = {std::min(low[0], p[0]), std::min(low[1], p[1])};
        high = {std::max(high[0], p[0]), std::max(high[1], p[1])};
      }
    return {low, high};
  }
};

/// The drawing as an SVG file at scale 1:1: its user unit is a mm, and so is its size on paper. Each layer is a group.
/// Throws InputError when the stream fails.
inline void write_svg(std::ostream& out, const Drawing& drawing) {
  constexpr double margin = 5.0e-3, line_mm = 0.15;
  constexpr int nanometres = 6;          // decimals of a mm
  constexpr double capitals = 0.73;      // height of DejaVu's capitals over its size
  constexpr double letter_width = 0.85;  // over their height: most letters are narrower
  auto [low, high] = drawing.box();
  for (const Drawing::Label& label : drawing.labels) {
    const double right = label.at[0] + letter_width * label.height * double(label.words.size());
    low = {std::min(low[0], label.at[0]), std::min(low[1], label.at[1])};
    high = {std::max(high[0], right), std::max(high[1], label.at[1] + label.height)};
  }
  const double left = low[0] - margin, top = high[1] + margin;
  Svg svg({1e3 * (high[0] + margin - left), 1e3 * (top - low[1] + margin), "mm", drawing.title, nanometres});
  const auto at = [&](const Drawing::Point& p) { return Svg::Point{1e3 * (p[0] - left), 1e3 * (top - p[1])}; };
  for (std::size_t k = 0; k < drawing.layers.size(); ++k) {
    const Drawing::Layer& layer = drawing.layers[k];
    svg.begin_group(layer.name, {.stroke = layer.stroke, .width = line_mm});
    for (const Drawing::Line& line : drawing.lines) {
      if (std::size_t(line.layer) != k) continue;
      Svg::Points points;
      for (const Drawing::Point& p : line.points) points.push_back(at(p));
      svg.outline(points, line.closed);
    }
    for (const Drawing::Label& label : drawing.labels)
      if (std::size_t(label.layer) == k)
        svg.text(at(label.at), label.words,
            {.size = 1e3 * (label.height / capitals), .anchor = Svg::left_out, .fill = layer.stroke, .stroke = "none"});
    svg.end_group();
  }
  svg.write(out);
}

/// The drawing as a DXF file, one drawing unit a mm: AutoCAD R12 in ASCII, which every laser cutter's program reads.
/// The format has no place for a unit, so that the drawings state it in words. Throws InputError when the stream fails.
/// Own code, as of .stl and .3mf: a page each, and the same input gives the same bits. Source: Autodesk, DXF Reference,
/// release 12.
inline void write_dxf(std::ostream& out, const Drawing& drawing) {
  using Pairs = std::initializer_list<std::pair<int, std::string>>;
  const auto write = [&out](const Pairs& pairs) {
    for (const auto& [code, value] : pairs) out << std::to_string(code) << "\n" << value << "\n";
  };
  const auto point = [&write](const Drawing::Point& p) { write({{10, in_mm(p[0])}, {20, in_mm(p[1])}, {30, "0"}}); };
  const auto name = [&drawing](int layer) { return drawing.layers[std::size_t(layer)].name; };
  const auto box = drawing.box();

  write({{999, drawing.title + ", mm, 1:1, by lumo"}});
  write({{0, "SECTION"}, {2, "HEADER"}, {9, "$ACADVER"}, {1, "AC1009"}, {9, "$EXTMIN"}});
  point(box[0]);
  write({{9, "$EXTMAX"}});
  point(box[1]);
  write({{0, "ENDSEC"}, {0, "SECTION"}, {2, "TABLES"}, {0, "TABLE"}, {2, "LTYPE"}, {70, "1"}});
  write({{0, "LTYPE"}, {2, "CONTINUOUS"}, {70, "0"}, {3, "Solid line"}, {72, "65"}, {73, "0"}, {40, "0"}});
  write({{0, "ENDTAB"}, {0, "TABLE"}, {2, "LAYER"}, {70, std::to_string(drawing.layers.size())}});
  for (const Drawing::Layer& l : drawing.layers)
    write({{0, "LAYER"}, {2, l.name}, {70, "0"}, {62, std::to_string(l.dxf_color)}, {6, "CONTINUOUS"}});
  write({{0, "ENDTAB"}, {0, "ENDSEC"}, {0, "SECTION"}, {2, "ENTITIES"}});
  for (const Drawing::Line& line : drawing.lines) {
    write({{0, "POLYLINE"}, {8, name(line.layer)}, {66, "1"}});
    point({0.0, 0.0});
    write({{70, line.closed ? "1" : "0"}});
    for (const Drawing::Point& p : line.points) {
      write({{0, "VERTEX"}, {8, name(line.layer)}});
      point(p);
    }
    write({{0, "SEQEND"}, {8, name(line.layer)}});
  }
  for (const Drawing::Label& label : drawing.labels) {
    write({{0, "TEXT"}, {8, name(label.layer)}});
    point(label.at);
    write({{40, in_mm(label.height)}, {1, label.words}});
  }
  write({{0, "ENDSEC"}, {0, "EOF"}});
  if (!out) throw InputError("writing a .dxf file failed");
}

}  // namespace lumo

#endif

// ---- lumo/core/units.hpp
#ifndef SINGLE_INCLUDE_LUMO_CORE_UNITS_HPP
#define SINGLE_INCLUDE_LUMO_CORE_UNITS_HPP

namespace lumo {

/// Literals that turn the field's units into SI: `5.0_mm`, `106.0_kPa`, `3.1_dB_per_cm`.
inline namespace literals {

constexpr double operator""_m(long double v) { return double(v); }
constexpr double operator""_mm(long double v) { return double(v * 1e-3L); }
constexpr double operator""_um(long double v) { return double(v * 1e-6L); }
constexpr double operator""_N(long double v) { return double(v); }
constexpr double operator""_Pa(long double v) { return double(v); }
constexpr double operator""_kPa(long double v) { return double(v * 1e3L); }
constexpr double operator""_MPa(long double v) { return double(v * 1e6L); }
constexpr double operator""_W(long double v) { return double(v); }
constexpr double operator""_kg_per_m3(long double v) { return double(v); }
constexpr double operator""_N_per_m3(long double v) { return double(v); }
constexpr double operator""_deg(long double v) { return double(v * 3.14159265358979323846264338327950288L / 180.0L); }
constexpr double operator""_per_m(long double v) { return double(v); }
/// Power attenuation: 10 dB are a factor of ten, so 1 dB/cm = 100 ln(10)/10 per metre.
constexpr double operator""_dB_per_cm(long double v) { return double(v * 23.0258509299404568401799145468436421L); }

}  // namespace literals

inline constexpr double pi = 3.14159265358979323846;

}  // namespace lumo

#endif

// ---- lumo/core/types.hpp
#ifndef SINGLE_INCLUDE_LUMO_CORE_TYPES_HPP
#define SINGLE_INCLUDE_LUMO_CORE_TYPES_HPP

namespace lumo {

/// A small matrix of fixed size: Eigen's, with sums and products that are computed at once instead of expressions.
/// Their order of summation is fixed, whatever the processor's vectors, so results do not depend on them; and a
/// compiler makes no type for each formula. An operand that is an expression of Eigen's (a block, a transpose) takes
/// Eigen's own operators.
template <class S, int Rows, int Cols> class SmallMatrix : public Eigen::Matrix<S, Rows, Cols> {
 public:
  using Base = Eigen::Matrix<S, Rows, Cols>;
  using Base::Base;
  SmallMatrix() = default;
  template <class E> SmallMatrix& operator=(const Eigen::EigenBase<E>& e) {
    Base::operator=(e.derived());
    return *this;
  }

  SmallMatrix eval() const { return *this; }
  SmallMatrix normalized() const { return Base::normalized(); }
  SmallMatrix cross(const SmallMatrix& b) const requires(Rows == 3 && Cols == 1) { return Base::cross(b); }
};

template <class S> using Vec3 = SmallMatrix<S, 3, 1>;
template <class S> using Mat3 = SmallMatrix<S, 3, 3>;
/// Derivative of a 3 × 3 tensor by another, both flattened column by column: row i + 3 j, column k + 3 l.
template <class S> using Mat9 = SmallMatrix<S, 9, 9>;

using Vec3d = Vec3<double>;
using Mat3d = Mat3<double>;
using Mat9d = Mat9<double>;

/// What may scale a matrix of scalars S.
template <class F, class S>
concept ScaleOf = std::same_as<F, S> || std::is_arithmetic_v<F>;

template <class S, int R, int C>
SmallMatrix<S, R, C> operator+(const SmallMatrix<S, R, C>& a, const SmallMatrix<S, R, C>& b) {
  SmallMatrix<S, R, C> sum;
  for (int k = 0; k < R * C; ++k) sum.data()[k] = a.data()[k] + b.data()[k];
  return sum;
}

template <class S, int R, int C>
SmallMatrix<S, R, C> operator-(const SmallMatrix<S, R, C>& a, const SmallMatrix<S, R, C>& b) {
  SmallMatrix<S, R, C> difference;
  for (int k = 0; k < R * C; ++k) difference.data()[k] = a.data()[k] - b.data()[k];
  return difference;
}

template <class S, int R, int C> SmallMatrix<S, R, C> operator-(const SmallMatrix<S, R, C>& a) {
  SmallMatrix<S, R, C> opposite;
  for (int k = 0; k < R * C; ++k) opposite.data()[k] = -a.data()[k];
  return opposite;
}

template <class S, int R, int C, ScaleOf<S> F>
SmallMatrix<S, R, C> operator*(const SmallMatrix<S, R, C>& a, const F& factor) {
  SmallMatrix<S, R, C> product;
  for (int k = 0; k < R * C; ++k) product.data()[k] = a.data()[k] * S(factor);
  return product;
}

template <class S, int R, int C, ScaleOf<S> F>
SmallMatrix<S, R, C> operator*(const F& factor, const SmallMatrix<S, R, C>& a) {
  return a * factor;
}

template <class S, int R, int C, ScaleOf<S> F>
SmallMatrix<S, R, C> operator/(const SmallMatrix<S, R, C>& a, const F& divisor) {
  SmallMatrix<S, R, C> quotient;
  for (int k = 0; k < R * C; ++k) quotient.data()[k] = a.data()[k] / S(divisor);
  return quotient;
}

template <class S, int C> SmallMatrix<S, 3, C> operator*(const Mat3<S>& a, const SmallMatrix<S, 3, C>& b) {
  SmallMatrix<S, 3, C> product;
  for (int j = 0; j < C; ++j)
    for (int i = 0; i < 3; ++i)
      product.data()[i + 3 * j] =
          a.data()[i] * b.data()[3 * j] + a.data()[i + 3] * b.data()[1 + 3 * j] + a.data()[i + 6] * b.data()[2 + 3 * j];
  return product;
}

/// a bᵀ.
template <class S, class B>
requires std::same_as<std::remove_const_t<B>, Eigen::Matrix<S, 3, 1>> Mat3<S>
operator*(const Vec3<S>& a, const Eigen::Transpose<B>& b) {
  Mat3<S> dyad;
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i) dyad.data()[i + 3 * j] = a.data()[i] * b.nestedExpression().data()[j];
  return dyad;
}

template <class S> Vec3<S> elementwise_min(const Vec3<S>& a, const Vec3<S>& b) {
  return {std::min(a.x(), b.x()), std::min(a.y(), b.y()), std::min(a.z(), b.z())};
}
template <class S> Vec3<S> elementwise_max(const Vec3<S>& a, const Vec3<S>& b) {
  return {std::max(a.x(), b.x()), std::max(a.y(), b.y()), std::max(a.z(), b.z())};
}

/// Two unit tangents that make a right-handed frame with the unit vector `n` (after Duff et al., JCGT 6(1), 2017).
template <class S> void tangents(const Vec3<S>& n, Vec3<S>& t1, Vec3<S>& t2) {
  const double sign =
      n.z() < -0.6180339887 ? -1.0 : 1.0;  // not at 0: walls are upright, and rounding must not turn their frames
  const S a = -1.0 / (sign + n.z()), b = n.x() * n.y() * a;
  t1 = {1.0 + sign * n.x() * n.x() * a, sign * b, -sign * n.x()};
  t2 = {b, sign + n.y() * n.y() * a, -n.y()};
}

/// Planes of mirror symmetry of a body. `x` is the plane x = 0, `y` the plane y = 0.
struct Symmetry {
  bool x = false;
  bool y = false;
  bool operator==(const Symmetry&) const = default;
};

}  // namespace lumo

#endif

// ---- lumo/core/design_space.hpp
#ifndef SINGLE_INCLUDE_LUMO_CORE_DESIGN_SPACE_HPP
#define SINGLE_INCLUDE_LUMO_CORE_DESIGN_SPACE_HPP

namespace lumo {

/// One design variable: bounds and, when `step` > 0, a lattice of multiples of `step` counted from `origin`.
struct Variable {
  std::string name;
  double lower = 0.0;
  double upper = 1.0;
  double step = 0.0;
  std::string unit;
  double origin = 0.0;

  /// The lattice node nearest to `x`, which may lie outside the bounds.
  double nearest_node(double x) const { return origin + std::round((x - origin) / step) * step; }
  /// Is `x` a node, but for rounding?
  bool on_lattice(double x) const {
    return std::abs(x - nearest_node(x)) <=
           4.0 * std::numeric_limits<double>::epsilon() * std::max(std::abs(x), std::abs(origin));
  }
};

/// lower ≤ Σ coefficients · x ≤ upper. Coefficients as many as variables.
struct LinearConstraint {
  std::string name;
  std::vector<double> coefficients;
  double lower = -std::numeric_limits<double>::infinity();
  double upper = std::numeric_limits<double>::infinity();
  std::string unit;

  double sum(std::span<const double> x) const {
    double total = 0.0;
    for (std::size_t i = 0; i < x.size(); ++i) total += coefficients[i] * x[i];
    return total;
  }
  /// By how much rounding may have moved the sum: 0.1 + 0.2 must not break a limit of 0.3.
  double rounding(std::span<const double> x) const {
    double size = 0.0;
    for (std::size_t i = 0; i < x.size(); ++i) size += std::abs(coefficients[i] * x[i]);
    return 2.0 * std::numeric_limits<double>::epsilon() * size;
  }
};

/// A constraint of any form. Both are called only where bounds, lattice, linear constraints and the rules before hold.
struct DesignRule {
  std::function<bool(std::span<const double>)> holds;
  std::function<InfeasibleDesign(std::span<const double>)> refusal;  ///< what check() throws if it does not hold
};

/// The designs that may be tried, in any number of dimensions: a box or lattice, linear constraints, and further rules.
struct DesignSpace {
  std::vector<Variable> variables;
  std::vector<LinearConstraint> constraints;
  std::vector<DesignRule> rules;

  /// Throws InfeasibleDesign naming the first broken constraint, or InvalidArgument when the number of values is wrong.
  void check(std::span<const double> x) const;

  /// Whether check() would pass. Throws InvalidArgument when the number of values is wrong.
  bool contains(std::span<const double> x) const;

  /// Throws InvalidArgument when the number of values is wrong, or one lies more than a million widths off the bounds:
  /// all else can be a result, if not a design to try.
  void check_result(std::span<const double> x) const;

  /// The same constraints without bounds and lattices.
  DesignSpace unbounded() const {
    DesignSpace wide = *this;
    for (Variable& v : wide.variables) {
      v.upper = std::numeric_limits<double>::max();
      v.lower = -v.upper;
      v.step = 0.0;
    }
    return wide;
  }

  /// Whether bounds and linear constraints hold, on the lattice or not. Throws as check_result().
  bool encloses(std::span<const double> x) const;
};

inline void DesignSpace::check(std::span<const double> x) const {
  if (x.size() != variables.size())
    throw InvalidArgument(message("design has ", x.size(), " values, the space has ", variables.size(), " variables"));
  for (std::size_t i = 0; i < x.size(); ++i) {
    const Variable& v = variables[i];
    const std::string unit = v.unit.empty() ? "" : " " + v.unit;
    if (!std::isfinite(x[i]))
      throw InfeasibleDesign(v.name + " finite", x[i], v.upper, v.unit,
          message("infeasible design: ", v.name, " = ", exact(x[i]), unit, ", must lie in [", v.lower, ", ", v.upper,
              "]", unit));
    if (x[i] < v.lower)
      throw InfeasibleDesign(v.name + " lower bound", x[i], v.lower, v.unit,
          message(
              "infeasible design: ", v.name, " = ", exact(x[i]), unit, " is below its lower bound ", v.lower, unit));
    if (x[i] > v.upper)
      throw InfeasibleDesign(v.name + " upper bound", x[i], v.upper, v.unit,
          message(
              "infeasible design: ", v.name, " = ", exact(x[i]), unit, " is above its upper bound ", v.upper, unit));
    if (v.step > 0.0 && !v.on_lattice(x[i]))
      throw InfeasibleDesign(v.name + " lattice", x[i], v.nearest_node(x[i]), v.unit,
          message("infeasible design: ", v.name, " = ", exact(x[i]), unit, " is off the ", v.step, unit,
              " lattice; nearest is ", v.nearest_node(x[i]), unit));
  }
  for (const LinearConstraint& c : constraints) {
    const double sum = c.sum(x), rounding = c.rounding(x);
    const std::string unit = c.unit.empty() ? "" : " " + c.unit;
    if (sum > c.upper + rounding)
      throw InfeasibleDesign(c.name, sum, c.upper, c.unit,
          message("infeasible design: ", c.name, " = ", sum, unit, " exceeds its limit ", c.upper, unit));
    if (sum < c.lower - rounding)
      throw InfeasibleDesign(c.name, sum, c.lower, c.unit,
          message("infeasible design: ", c.name, " = ", sum, unit, " is below its limit ", c.lower, unit));
  }
  for (const DesignRule& r : rules)
    if (!r.holds(x)) throw r.refusal(x);
}

inline bool DesignSpace::contains(std::span<const double> x) const {
  if (x.size() != variables.size())
    throw InvalidArgument(message("design has ", x.size(), " values, the space has ", variables.size(), " variables"));
  for (std::size_t i = 0; i < x.size(); ++i) {
    const Variable& v = variables[i];
    if (!(x[i] >= v.lower && x[i] <= v.upper) || (v.step > 0.0 && !v.on_lattice(x[i]))) return false;
  }
  for (const LinearConstraint& c : constraints) {
    const double sum = c.sum(x), rounding = c.rounding(x);
    if (sum > c.upper + rounding || sum < c.lower - rounding) return false;
  }
  return std::all_of(rules.begin(), rules.end(), [&](const DesignRule& r) { return r.holds(x); });
}

inline void DesignSpace::check_result(std::span<const double> x) const {
  constexpr double widths = 1e6;
  if (x.size() != variables.size())
    throw InvalidArgument(message("design has ", x.size(), " values, the space has ", variables.size(), " variables"));
  for (std::size_t i = 0; i < x.size(); ++i) {
    const Variable& v = variables[i];
    const double reach = widths * std::max(v.upper - v.lower, std::numeric_limits<double>::min());
    if (!(x[i] >= v.lower - reach && x[i] <= v.upper + reach))
      throw InvalidArgument(message("design has ", v.name, " = ", exact(x[i]), ", more than a million widths off [",
          v.lower, ", ", v.upper, "]"));
  }
}

inline bool DesignSpace::encloses(std::span<const double> x) const {
  check_result(x);
  for (std::size_t i = 0; i < x.size(); ++i)
    if (!(x[i] >= variables[i].lower && x[i] <= variables[i].upper)) return false;
  return std::all_of(constraints.begin(), constraints.end(), [&](const LinearConstraint& c) {
    const double sum = c.sum(x), rounding = c.rounding(x);
    return sum <= c.upper + rounding && sum >= c.lower - rounding;
  });
}

}  // namespace lumo

#endif

// ---- lumo/core/golden_section.hpp
#ifndef SINGLE_INCLUDE_LUMO_CORE_GOLDEN_SECTION_HPP
#define SINGLE_INCLUDE_LUMO_CORE_GOLDEN_SECTION_HPP

namespace lumo {

/// Where a function of one number is least between a and b, if it has one minimum there: `steps` sections, each of
/// which leaves 0.618 of the stretch. Source: Kiefer 1953.
template <class Function> double golden_section(Function function, double a, double b, int steps) {
  constexpr double golden = 0.61803398874989484820;
  for (int k = 0; k < steps; ++k) {
    const double c = b - golden * (b - a), d = a + golden * (b - a);
    if (function(c) <= function(d)) b = d;
    else a = c;
  }
  return 0.5 * (a + b);
}

}  // namespace lumo

#endif

// ---- lumo/morphology/design.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_DESIGN_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_DESIGN_HPP

namespace lumo {

/// The paper's design vector θ = [h_fp, h_ep, w_s, h_s, w_v] in mm (paper §III-A).
struct FingerDesign {
  double h_fp = 6.0;  ///< height of the flat sides
  double h_ep = 6.0;  ///< height of the half ellipse above them
  double w_s = 8.0;   ///< width of the rigid stem
  double h_s = 5.0;   ///< height of the stem
  double w_v = 0.0;   ///< width of the lateral void on each side of the stem

  static constexpr double lattice_mm = 0.5;  ///< all five are multiples of it

  /// Values that are multiples of the lattice but for rounding become them, so that 0.1 + 0.4 is 0.5 in every bit;
  /// others are taken as they are.
  static FingerDesign from(std::span<const double> x);
  std::array<double, 5> values() const { return {h_fp, h_ep, w_s, h_s, w_v}; }
  bool operator==(const FingerDesign&) const = default;
};

/// What is meant by the smallest thickness of silicone.
enum class Thickness {
  euclidean,   ///< least distance between the half ellipse and the cavity's walls and roof
  along_axes,  ///< above the cavity along z, beside it along x
  above        ///< above the cavity along z only
};

/// How the silicone sits on the stem.
enum class Stem {
  bonded,  ///< it holds to the stem's top, and to its sides where there is no void
  free     ///< it lies on the stem, which only pushes
};

/// What the paper leaves open about the pad, shared by all designs; lengths in mm. Its defaults are those of the pad
/// that the paper's authors cast: a stair-shaped carrier, bonded shoulders beside its block, a solid distal cap.
/// Source: the first author's public code (dokkev/fingertip-design-framework, August 2026), lumo/fingertip/.
struct PadDimensions {
  double width = 30.0;
  double length = 55.0;          ///< of the part that has a cavity, centred on y = 0
  double cap_length = 5.0;       ///< of a solid end beyond it, at positive y
  double shoulder_width = 5.0;   ///< of silicone that hangs down beside the carrier's block; 0: the base is flat
  double shoulder_height = 8.0;  ///< how far it hangs down below z = 0
  double carrier_height = 10.0;  ///< of the carrier below z = 0
  Stem stem = Stem::free;
  double t_min = 5.0;  ///< smallest silicone thickness
  Thickness thickness = Thickness::euclidean;

  double lip_end() const { return 0.5 * width - shoulder_width; }  ///< |x| up to which the base z = 0 is silicone
  double proximal_end() const { return -0.5 * length; }            ///< y
  double distal_end() const { return 0.5 * length + cap_length; }  ///< y
  bool operator==(const PadDimensions&) const = default;
};

/// The default, by name.
inline PadDimensions built_pad() { return {}; }
/// A pad on a flat base, free at both ends, as lumo had it before the built one was known. At its width w_s + 2 w_v ≤
/// 19.5 says the same as 5 mm of silicone at each side.
inline PadDimensions plain_pad() {
  return {.width = 29.5,
      .length = 60.0,
      .cap_length = 0.0,
      .shoulder_width = 0.0,
      .shoulder_height = 0.0,
      .stem = Stem::bonded,
      .thickness = Thickness::along_axes};
}

/// Silicone above the voids and the stem: min over |x| ≤ w_s/2 + w_v of z_outer(x) − h_s, in mm.
double vertical_thickness(const FingerDesign& d, const PadDimensions& pad = {});
/// Silicone beside the voids: min over 0 ≤ z ≤ h_s of x_outer(z) − (w_s/2 + w_v), in mm.
double horizontal_thickness(const FingerDesign& d, const PadDimensions& pad = {});
/// Least distance between the half ellipse, its ends included, and the cavity's walls and roof, or between cavity and
/// side if that is less, in mm. 0 if the cavity's corner is not under the dome.
double euclidean_thickness(const FingerDesign& d, const PadDimensions& pad = {});

/// The space of θ: bounds, 0.5 mm lattice, the two sums and the thickness rule (paper Table I), decided exactly on the
/// lattice where it is counted along the axes, to 1e-9 mm where it is a distance.
inline DesignSpace finger_space(const PadDimensions& pad = {});

/// The hand-designed finger of the paper's authors, off the lattice. Source: as built_pad().
inline FingerDesign built_baseline() { return {5.0, 9.0, 7.6, 6.0, 2.0}; }
/// The designs that started the authors' campaigns of inclined contacts. Source: as built_pad().
inline std::vector<FingerDesign> built_references() {
  return {{14.5, 4.0, 5.0, 12.5, 5.0}, {13.5, 1.5, 7.0, 9.5, 5.5}, {5.5, 2.0, 9.0, 2.0, 0.5},
      {13.0, 7.0, 7.5, 14.5, 0.0}, {2.5, 17.5, 7.0, 2.0, 3.5}};
}

/// Throws InfeasibleDesign unless the design lies in finger_space(pad); designs that are known by name may lie off its
/// lattice.
inline void require_feasible(const FingerDesign& d, const PadDimensions& pad);

/// The plain finger's nominal design, and the five that start its campaigns.
inline FingerDesign plain_baseline() { return {6.0, 6.0, 8.0, 5.0, 0.0}; }
inline std::vector<FingerDesign> plain_references() {
  return {plain_baseline(), {4.0, 8.0, 8.0, 5.0, 2.0}, {8.0, 4.0, 6.0, 4.0, 2.0}, {5.0, 10.0, 10.0, 6.0, 3.0},
      {10.0, 5.0, 8.0, 6.0, 1.0}};
}

inline FingerDesign FingerDesign::from(std::span<const double> x) {
  if (x.size() != 5)
    throw InvalidArgument(message("theta has ", x.size(), " values, must have 5 (h_fp, h_ep, w_s, h_s, w_v in mm)"));
  const Variable lattice{"length", 0.0, 0.0, lattice_mm, "mm"};
  const auto snapped = [&](double value) { return lattice.on_lattice(value) ? lattice.nearest_node(value) : value; };
  return {snapped(x[0]), snapped(x[1]), snapped(x[2]), snapped(x[3]), snapped(x[4])};
}

inline double vertical_thickness(const FingerDesign& d, const PadDimensions& pad) {
  const double r = (d.w_s + 2.0 * d.w_v) / pad.width;
  return d.h_fp + d.h_ep * std::sqrt(std::max(0.0, 1.0 - r * r)) - d.h_s;
}

inline double euclidean_thickness(const FingerDesign& d, const PadDimensions& pad) {
  // The corner is the point of the cavity that comes nearest: above the roof the ellipse falls towards it, beside the
  // wall it leans towards it.
  const double a = 0.5 * pad.width, c = 0.5 * d.w_s + d.w_v, up = d.h_s - d.h_fp;
  const double under = d.h_ep * d.h_ep * (1.0 - c * c / (a * a));
  if (c >= a || (up > 0.0 && up * up >= under)) return 0.0;
  const auto squared = [&](double t) {
    const double x = a * std::cos(t) - c, z = d.h_ep * std::sin(t) - up;
    return x * x + z * z;
  };
  constexpr int pieces = 64;
  const double step = 0.5 * pi / pieces;
  int nearest = 0;
  for (int k = 1; k <= pieces; ++k)
    if (squared(k * step) < squared(nearest * step)) nearest = k;
  const double low = std::max(0, nearest - 1) * step, high = std::min(pieces, nearest + 1) * step;
  const double least = std::min(squared(0.0), squared(golden_section(squared, low, high, 60)));
  return std::min(a - c, std::sqrt(least));
}

inline double horizontal_thickness(const FingerDesign& d, const PadDimensions& pad) {
  const double above = std::max(0.0, d.h_s - d.h_fp) / d.h_ep;
  return 0.5 * pad.width * std::sqrt(std::max(0.0, 1.0 - above * above)) - 0.5 * (d.w_s + 2.0 * d.w_v);
}

namespace detail {

// Squared forms of the two thickness rules: on the lattice every term is a dyadic rational of few bits, so doubles
// decide them exactly.
inline bool vertically_thick(const FingerDesign& d, const PadDimensions& pad) {
  const double inner = d.w_s + 2.0 * d.w_v, need = pad.t_min + d.h_s - d.h_fp, w2 = pad.width * pad.width;
  if (inner >= pad.width) return false;
  return need <= 0.0 || d.h_ep * d.h_ep * (w2 - inner * inner) >= w2 * need * need;
}

inline bool horizontally_thick(const FingerDesign& d, const PadDimensions& pad) {
  const double need = d.w_s + 2.0 * d.w_v + 2.0 * pad.t_min, above = d.h_s - d.h_fp;
  if (above <= 0.0) return pad.width >= need;
  if (above > d.h_ep) return false;
  return pad.width * pad.width * (d.h_ep * d.h_ep - above * above) >= need * need * d.h_ep * d.h_ep;
}

}  // namespace detail

inline DesignSpace finger_space(const PadDimensions& pad) {
  DesignSpace space;
  const double step = FingerDesign::lattice_mm;
  space.variables = {{"h_fp", 2.0, 29.0, step, "mm"}, {"h_ep", 1.0, 20.0, step, "mm"}, {"w_s", 4.0, 15.0, step, "mm"},
      {"h_s", 2.0, 15.0, step, "mm"}, {"w_v", 0.0, 7.5, step, "mm"}};
  const double unbounded = -std::numeric_limits<double>::infinity();
  space.constraints = {
      {"h_fp + h_ep", {1, 1, 0, 0, 0}, unbounded, 20.0, "mm"}, {"w_s + 2 w_v", {0, 0, 1, 0, 2}, unbounded, 19.5, "mm"}};
  const auto refusal = [pad](const char* where, double value) {
    return InfeasibleDesign(std::string("t_min ") + where, value, pad.t_min, "mm",
        message("infeasible design: smallest silicone thickness t_min (", where, ") = ", value,
            " mm is below its limit ", pad.t_min, " mm"));
  };
  if (pad.thickness == Thickness::euclidean) {
    constexpr double rounding_mm = 1e-9;
    space.rules = {{[pad](std::span<const double> x) {
                      return euclidean_thickness(FingerDesign::from(x), pad) >= pad.t_min - rounding_mm;
                    },
        [pad, refusal](std::span<const double> x) {
          return refusal("distance", euclidean_thickness(FingerDesign::from(x), pad));
        }}};
    return space;
  }
  space.rules = {{[pad](std::span<const double> x) { return detail::vertically_thick(FingerDesign::from(x), pad); },
      [pad, refusal](
          std::span<const double> x) { return refusal("vertical", vertical_thickness(FingerDesign::from(x), pad)); }}};
  if (pad.thickness == Thickness::along_axes)
    space.rules.push_back(
        {[pad](std::span<const double> x) { return detail::horizontally_thick(FingerDesign::from(x), pad); },
            [pad, refusal](std::span<const double> x) {
              return refusal("horizontal", horizontal_thickness(FingerDesign::from(x), pad));
            }});
  return space;
}

inline void require_feasible(const FingerDesign& d, const PadDimensions& pad) {
  DesignSpace space = finger_space(pad);
  if (d == built_baseline())
    for (Variable& v : space.variables) v.step = 0.0;
  space.check(d.values());
}

}  // namespace lumo

#endif

// ---- lumo/morphology/section.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_SECTION_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_SECTION_HPP

namespace lumo {

/// Matched variants of a design. The twins without a carrier are for mechanics only (paper §IV-A).
enum class Twin {
  none,              ///< the finger itself
  no_void,           ///< the same θ with w_v = 0
  bonded_base,       ///< the stem's volume is silicone, voids stay, base bonded under the stem too
  unsupported_base,  ///< the same, but bonded at the two end faces only: a soft finger that can bend
  held_top           ///< silicone alone in the outline of pad and carrier, held on all of the carrier's back
};

constexpr std::string_view to_string(Twin twin) {
  switch (twin) {
    case Twin::no_void: return "no_void";
    case Twin::bonded_base: return "bonded_base";
    case Twin::unsupported_base: return "unsupported_base";
    case Twin::held_top: return "held_top";
    default: return "design";
  }
}

/// Is there a rigid stem under the silicone?
constexpr bool has_stem(Twin twin) { return twin == Twin::none || twin == Twin::no_void; }

/// What a boundary edge of the section is.
enum class SectionTag {
  mirror,
  stem_top,
  stem_side,
  void_inner,
  void_roof,
  void_wall,
  base,
  shoulder_wall,
  shoulder_top,
  side,
  dome
};

/// Half cross-section x ≥ 0 as a closed polygon in (x, z), counter-clockwise, in metres; edge i runs from point i to
/// i + 1, the last point is the dome's apex.
struct HalfSection {
  FingerDesign design;
  PadDimensions pad;
  Twin twin = Twin::none;
  std::vector<double> x, z;
  std::vector<SectionTag> tag;

  double half_width_m() const { return 0.5e-3 * pad.width; }
  double height_m() const { return z.back(); }  ///< of the dome's apex over the base
  bool lies_on_stem() const { return has_stem(twin) && pad.stem == Stem::free; }
  double length_m() const { return 1e-3 * (pad.length + pad.cap_length); }
  /// Exact area of the half section [m²].
  double exact_area_m2() const;
};

/// How a curve is cut into chords.
struct Chords {
  double longest_m;
  double max_turn_rad;
  double shortest_m = 0.0;  ///< about; turning does not ask for shorter ones
};

/// The section of a feasible design, its curve cut into chords, its straight edges left whole. Throws InfeasibleDesign.
inline HalfSection half_section(
    const FingerDesign& design, Twin twin, const Chords& chords, const PadDimensions& pad = {});

/// The same of the solid distal cap. Throws likewise, and InvalidArgument for a pad without one.
inline HalfSection cap_section(
    const FingerDesign& design, Twin twin, const Chords& chords, const PadDimensions& pad = {});

/// Half x ≥ 0 of the carrier under the cavity, counter-clockwise from the middle of its back, (x, z) in m.
inline std::vector<std::array<double, 2>> carrier_outline(const FingerDesign& design, const PadDimensions& pad = {});

namespace detail {

// Angles of points on the quarter ellipse from the side (0) to the apex (π/2): each chord is as long and turns as much
// as allowed, evened out.
inline std::vector<double> ellipse_angles(double a, double b, const Chords& chords) {
  constexpr int fine = 20000;
  std::vector<double> measure(fine + 1, 0.0);
  const auto tangent = [&](double t) { return std::atan2(b * std::cos(t), -a * std::sin(t)); };
  for (int i = 1; i <= fine; ++i) {
    const double t0 = 0.5 * pi * (i - 1) / fine, t1 = 0.5 * pi * i / fine;
    const double arc = std::hypot(a * (std::cos(t1) - std::cos(t0)), b * (std::sin(t1) - std::sin(t0)));
    measure[std::size_t(i)] =
        measure[std::size_t(i) - 1] + arc / chords.longest_m +
        std::min(std::abs(tangent(t1) - tangent(t0)) / chords.max_turn_rad, arc / std::max(chords.shortest_m, 1e-12));
  }
  const int count = std::max(2, int(std::ceil(measure.back() - 1e-9)));
  std::vector<double> angles;
  std::size_t at = 0;
  for (int k = 0; k <= count; ++k) {
    const double want = measure.back() * k / count;
    while (at + 1 < measure.size() && measure[at + 1] < want) ++at;
    if (k == 0) angles.push_back(0.0);
    else if (k == count) angles.push_back(0.5 * pi);
    else angles.push_back(0.5 * pi * (double(at) + (want - measure[at]) / (measure[at + 1] - measure[at])) / fine);
  }
  return angles;
}

// The polygon of a section, point by point.
struct SectionPen {
  HalfSection& section;
  void add(double x, double z, SectionTag tag) const {
    section.x.push_back(x);
    section.z.push_back(z);
    section.tag.push_back(tag);
  }
  // From the lower end of the side to the apex.
  void add_outside(double low, const Chords& chords) const {
    const double w = section.half_width_m(), fp = 1e-3 * section.design.h_fp, ep = 1e-3 * section.design.h_ep;
    add(w, low, SectionTag::side);
    const std::vector<double> angles = ellipse_angles(w, ep, chords);
    for (std::size_t k = 0; k + 1 < angles.size(); ++k)
      add(k == 0 ? w : w * std::cos(angles[k]), fp + ep * std::sin(angles[k]), SectionTag::dome);
    add(0.0, fp + ep, SectionTag::mirror);
  }
};

inline bool has_soft_stem(Twin twin) { return twin == Twin::bonded_base || twin == Twin::unsupported_base; }

// Edges from the middle of the cavity to the base beside it.
inline void add_cavity(const SectionPen& pen, const HalfSection& s) {
  const FingerDesign& d = s.design;
  const double stem = 0.5e-3 * d.w_s, hs = 1e-3 * d.h_s, outer = stem + 1e-3 * d.w_v;
  const bool has_void = d.w_v > 0.0;
  if (has_soft_stem(s.twin)) {
    pen.add(0.0, 0.0, SectionTag::base);
    if (!has_void) return;
    pen.add(stem, 0.0, SectionTag::void_inner);
  } else if (!s.lies_on_stem()) {
    pen.add(0.0, hs, SectionTag::stem_top);
    if (!has_void) {
      pen.add(stem, hs, SectionTag::stem_side);
      pen.add(stem, 0.0, SectionTag::base);
      return;
    }
  }
  pen.add(s.lies_on_stem() ? 0.0 : stem, hs, SectionTag::void_roof);
  pen.add(outer, hs, SectionTag::void_wall);
  pen.add(outer, 0.0, SectionTag::base);
}

inline HalfSection empty_section(const FingerDesign& given, Twin twin, const PadDimensions& pad) {
  require_feasible(given, pad);
  HalfSection s{given, pad, twin, {}, {}, {}};
  if (twin == Twin::no_void) s.design.w_v = 0.0;
  return s;
}

}  // namespace detail

inline HalfSection half_section(const FingerDesign& given, Twin twin, const Chords& chords, const PadDimensions& pad) {
  HalfSection s = detail::empty_section(given, twin, pad);
  const detail::SectionPen pen{s};
  if (twin == Twin::held_top) {
    const double low = -1e-3 * pad.carrier_height;
    pen.add(0.0, low, SectionTag::base);
    pen.add_outside(low, chords);
    return s;
  }
  detail::add_cavity(pen, s);
  const double low = -1e-3 * pad.shoulder_height;
  if (low < 0.0) {
    pen.add(1e-3 * pad.lip_end(), 0.0, SectionTag::shoulder_wall);
    pen.add(1e-3 * pad.lip_end(), low, SectionTag::shoulder_top);
  }
  pen.add_outside(low, chords);
  return s;
}

inline HalfSection cap_section(const FingerDesign& given, Twin twin, const Chords& chords, const PadDimensions& pad) {
  require_positive("length of the cap", pad.cap_length, "mm");
  HalfSection s = detail::empty_section(given, twin, pad);
  const detail::SectionPen pen{s};
  const double low = twin == Twin::held_top ? -1e-3 * pad.carrier_height : -1e-3 * pad.shoulder_height;
  pen.add(0.0, low, twin == Twin::held_top ? SectionTag::base : SectionTag::shoulder_top);
  pen.add_outside(low, chords);
  return s;
}

inline std::vector<std::array<double, 2>> carrier_outline(const FingerDesign& d, const PadDimensions& pad) {
  const double w = 0.5e-3 * pad.width, lip = 1e-3 * pad.lip_end(), shoulder = -1e-3 * pad.shoulder_height,
               back = -1e-3 * pad.carrier_height, stem = 0.5e-3 * d.w_s, top = 1e-3 * d.h_s;
  std::vector<std::array<double, 2>> outline = {{0.0, back}, {w, back}};
  if (shoulder < 0.0) outline.insert(outline.end(), {{w, shoulder}, {lip, shoulder}});
  outline.insert(outline.end(), {{lip, 0.0}, {stem, 0.0}, {stem, top}, {0.0, top}});
  return outline;
}

inline double HalfSection::exact_area_m2() const {
  const double w = 0.5e-3 * pad.width;
  const double outside = w * 1e-3 * design.h_fp + 0.25 * pi * w * 1e-3 * design.h_ep;
  if (x.front() == 0.0 && z.front() < 0.0) return outside - w * z.front();  // solid: a cap, or a held twin
  const double cut = (detail::has_soft_stem(twin) ? 0.0 : 0.5e-3 * design.w_s) + 1e-3 * design.w_v;
  return outside + 1e-6 * pad.shoulder_width * pad.shoulder_height - cut * 1e-3 * design.h_s;
}

}  // namespace lumo

#endif

// ---- lumo/morphology/silicone.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_SILICONE_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_SILICONE_HPP

namespace lumo {

/// A homogeneous medium: refractive index [–], extinction coefficient [1/m], and what a scattering reading of the
/// extinction needs.
struct Medium {
  double refractive_index = 1.0;
  double extinction_per_m = 0.0;   ///< absorption and scattering together
  double scattering_albedo = 0.0;  ///< share of the extinction that is scattering
  double anisotropy = 0.0;         ///< mean cosine of the angle of scattering
};

/// How light meets a surface.
struct Dielectric {
  bool operator==(const Dielectric&) const = default;
};  ///< smooth interface: Fresnel reflection and refraction
struct Lambertian {
  double albedo = 0.8;
  bool operator==(const Lambertian&) const = default;
};  ///< diffuse, opaque
struct Mirror {
  double reflectance = 1.0;
  bool operator==(const Mirror&) const = default;
};  ///< specular, opaque
struct Absorber {
  bool operator==(const Absorber&) const = default;
};  ///< black
using SurfaceOptics = std::variant<Dielectric, Lambertian, Mirror, Absorber>;

/// A flat opaque face of the rigid carrier that light can meet through air, as a convex polygon; counter-clockwise seen
/// from the lit side.
struct RigidFace {
  std::string name;
  std::vector<Vec3d> corners;  ///< [m]
  SurfaceOptics optics = Lambertian{};
};

/// Material card of a transparent silicone. Source: paper Table I (both have Poisson's ratio 0.495), where extinction
/// is one number: all of it is absorption here, as the paper uses it.
struct Silicone {
  std::string name;
  double density_kg_per_m3;
  double mu_Pa;      ///< shear modulus
  double lambda_Pa;  ///< Lamé's first parameter
  double refractive_index;
  double absorption_per_m;
  double scattering_per_m = 0.0;  ///< for a ScatteringMedium; BeerLambert takes it as absorption, too
  double anisotropy = 0.0;        ///< mean cosine of the angle of scattering

  double extinction_per_m() const { return absorption_per_m + scattering_per_m; }
  Medium medium() const {
    const double extinction = extinction_per_m();
    return {refractive_index, extinction, scattering_per_m > 0.0 ? scattering_per_m / extinction : 0.0, anisotropy};
  }
  bool operator==(const Silicone&) const = default;
};

/// The silicone with the same extinction, of which only `absorbed_per_m` [1/m] is absorption; more than there is
/// absorbs all. The paper gives one extinction for each silicone and takes it as absorption.
inline Silicone scattering_the_rest(Silicone card, double absorbed_per_m, double anisotropy) {
  const double extinction = card.extinction_per_m();
  card.absorption_per_m = std::min(absorbed_per_m, extinction);
  card.scattering_per_m = extinction - card.absorption_per_m;
  card.anisotropy = anisotropy;
  return card;
}

inline Silicone dragon_skin() { return {"DS", 1070.0, 106.0_kPa, 10.494_MPa, 1.4348, 71.3801_per_m}; }
inline Silicone solaris() { return {"Sol", 990.0, 98.5_kPa, 9.750_MPa, 1.4100, 14.5063_per_m}; }

/// What validate() admits.
inline constexpr Limits densities_kg_per_m3{1.0, 1e5}, shear_moduli_Pa{1.0, 1e12}, lame_parameters_Pa{0.0, 1e15},
    refractive_indices{1.0, 4.0}, extinctions_per_m{0.0, 1e6}, anisotropies{-0.999, 0.999};

/// Throws InvalidArgument for a number that is out of range.
inline void validate(const Silicone& s) {
  require_in_range("density of the silicone", s.density_kg_per_m3, densities_kg_per_m3, "kg/m3");
  require_in_range("shear modulus of the silicone", s.mu_Pa, shear_moduli_Pa, "Pa");
  require_in_range("first Lame parameter of the silicone", s.lambda_Pa, lame_parameters_Pa, "Pa");
  require_in_range("refractive index of the silicone", s.refractive_index, refractive_indices, "");
  require_in_range("absorption of the silicone", s.absorption_per_m, extinctions_per_m, "1/m");
  require_in_range("scattering of the silicone", s.scattering_per_m, extinctions_per_m, "1/m");
  require_in_range("anisotropy of scattering", s.anisotropy, anisotropies, "");
}

/// Card by its short name, "DS" or "Sol"; none for any other.
inline std::optional<Silicone> find_silicone(std::string_view name) {
  for (const Silicone& card : {dragon_skin(), solaris()})
    if (card.name == name) return card;
  return std::nullopt;
}

/// The same. Throws InvalidArgument for any other name.
inline Silicone silicone(std::string_view name) {
  if (const std::optional<Silicone> card = find_silicone(name)) return *card;
  throw InvalidArgument(message("material is '", name, "', must be DS or Sol"));
}

}  // namespace lumo

#endif

// ---- lumo/morphology/finger_options.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_FINGER_OPTIONS_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_FINGER_OPTIONS_HPP

namespace lumo {

/// About which point of the section an approach is tilted.
enum class TiltPivot {
  flat_top,  ///< x = 0, z = h_fp: where the flat sides end
  base       ///< x = 0, z = 0
};

/// What may be chosen about a finger besides θ, where the paper leaves a choice open. Its defaults are the finger that
/// the paper's authors built. Source: as PadDimensions; lengths of LEDs and recesses, albedo and pivot are of the same
/// code. Ours: the mesh, that a side is seen by its normals, and that the film of air over an LED never closes.
struct FingerOptions {
  /// Mesh size [m]; the defaults come from the reference study, benchmarks/reference.
  struct Mesh {
    double contact_edge = 2.5e-3;    ///< on the surface that an indenter can touch, away from where it does
    double coarsest_edge = 8.0e-3;   ///< at depth
    double growth = 0.5;             ///< edge length gained per length of depth
    double stretch_y = 1.0;          ///< edges along y are this much longer
    double max_turn_rad = 0.6;       ///< largest turning of the profile along one edge
    double shortest_chord = 0.4e-3;  ///< of the profile; turning does not ask for shorter ones
    double support_edge = 2.5e-3;    ///< on the surface that lies free on the carrier
    double seam_edge = 1.0e-3;       ///< at the edges of a bonded stem, below a tool
    double stem_edge = 0.4e-3;       ///< at the rounded edges of a stem on which silicone lies free, below a tool

    /// All edges `factor` times as long; the stretch stays.
    constexpr Mesh scaled(double factor) const {
      return {factor * contact_edge, factor * coarsest_edge, factor * growth, stretch_y, factor * max_turn_rad,
          factor * shortest_chord, factor * support_edge, factor * seam_edge, factor * stem_edge};
    }
    static constexpr double quick_edges = 1.8;  ///< for a look in a fifth of the time
    /// The same, but for a stem's rounded edges: elements that are longer than the rounding lose equilibria there.
    constexpr Mesh coarser(double factor) const {
      Mesh longer = scaled(factor);
      longer.shortest_chord = shortest_chord;
      longer.stem_edge = stem_edge;
      return longer;
    }
    bool operator==(const Mesh&) const = default;
  };
  /// The five LEDs, lengths in m. On the sides there are as many on each, at half the stem's height, with half the
  /// power; beside a void they shine into its air.
  struct Leds {
    enum class Place { top, sides };
    Place place = Place::top;
    int count = 5;
    double pitch = 11.0e-3;
    double length_y = 1.6e-3;
    double width_x = 1.8e-3;  ///< on the sides, their height
    double power_W = 1.0;     ///< of all together

    bool operator==(const Leds&) const = default;
  };
  /// Hollows in the top of a stem on which the silicone lies free, one for each LED on the top, across the stem's whole
  /// width: the LED lies on the floor and shines into the film of air above it.
  struct Recess {
    double depth = 0.19e-3;  ///< 0: there are none, and LEDs touch the silicone
    double length_y = 5.1e-3;
    std::optional<double> film_closes;  ///< Body::film_closes_m

    bool operator==(const Recess&) const = default;
  };
  /// Readout regions on the outer surface.
  struct Readout {
    int bins = 11;
    double half_range = 27.5e-3;  ///< |y| beyond it is not seen [m]
    double min_abs_nx = 0.5;      ///< the undeformed normal must point this much sideways
    bool one_side = true;         ///< only x > 0 is seen
    /// Light is seen by its direction, wherever it leaves, and `min_abs_nx` says nothing.
    bool by_direction = false;
    bool in_space = false;  ///< bins stay where they are; otherwise they move with the material

    bool operator==(const Readout&) const = default;
  };

  Twin twin = Twin::none;
  PadDimensions pad = {};
  Mesh mesh = {};
  Leds leds = {};
  Recess recess = {};
  Readout readout = {};
  TiltPivot pivot = TiltPivot::base;
  /// Of the edges of a stem on which silicone lies free, its ridges' too; 0: sharp [m]. Ours: the drawings have sharp
  /// edges, over which no equilibrium is certain.
  double stem_edge_radius = 0.4e-3;
  double carrier_albedo = 0.7;
  bool bonded_ends = false;              ///< the end faces are held, by something clear: light passes them as before
  SurfaceOptics touched = Dielectric{};  ///< Body::touched

  bool operator==(const FingerOptions&) const = default;
};

/// The default, by name.
inline FingerOptions built_finger(const FingerOptions::Mesh& mesh = {}) {
  FingerOptions o;
  o.mesh = mesh;
  return o;
}

/// A pad on a flat carrier, bonded to the stem, with free ends and LEDs in the silicone: lumo's reading of the paper
/// before the built one was known.
inline FingerOptions plain_finger(const FingerOptions::Mesh& mesh = {}) {
  FingerOptions o = built_finger(mesh);
  o.pad = plain_pad();
  o.leds.width_x = 0.8e-3;
  o.recess.depth = 0.0;
  o.recess.film_closes = 0.0;
  o.readout.one_side = false;
  o.pivot = TiltPivot::flat_top;
  o.carrier_albedo = 0.8;
  return o;
}

/// Another finger by one choice. By its key, a word without blanks, it is asked for.
struct FingerVariant {
  const char *key, *quantity, *value;
  void (*apply)(FingerOptions&);
};

/// What distinguishes the plain finger's pad from the built one's, and may be chosen by itself.
inline std::vector<FingerVariant> finger_variants() {
  return {{"bonded_stem", "stem", "bonded, as on a primed one", [](FingerOptions& o) { o.pad.stem = Stem::bonded; }},
      {"tilt_about_flat_top", "tilt", "about z = h_fp", [](FingerOptions& o) { o.pivot = TiltPivot::flat_top; }},
      {"thickness_along_axes", "t_min", "along the axes",
          [](FingerOptions& o) { o.pad.thickness = Thickness::along_axes; }}};
}

/// Throws InvalidArgument for an option that is out of range.
inline void validate(const FingerOptions& options);

inline void validate(const FingerOptions& o) {
  require_in_range("mesh edge at the contact surface", o.mesh.contact_edge * 1e3, 0.2, 10.0, "mm");
  require_in_range("coarsest mesh edge", o.mesh.coarsest_edge * 1e3, o.mesh.contact_edge * 1e3, 30.0, "mm");
  require_in_range("mesh growth with depth", o.mesh.growth, 0.0, 100.0, "");
  require_in_range("mesh stretch along y", o.mesh.stretch_y, 0.5, 4.0, "");
  require_in_range("largest turning along an edge", o.mesh.max_turn_rad, 0.01, 1.6, "rad");
  require_in_range("shortest chord", o.mesh.shortest_chord * 1e3, 0.0, 10.0, "mm");
  require_in_range("pad width", o.pad.width, 1.0, 200.0, "mm");
  require_in_range("pad length", o.pad.length, 1.0, 1000.0, "mm");
  require_in_range("smallest silicone thickness", o.pad.t_min, 0.0, 100.0, "mm");
  if ((o.pad.shoulder_width > 0.0) != (o.pad.shoulder_height > 0.0))
    throw InvalidArgument(message("shoulders are ", o.pad.shoulder_width, " mm wide and ", o.pad.shoulder_height,
        " mm high, must be 0 both or neither"));
  require_in_range("length of the pad's cap", o.pad.cap_length, 0.0, 1000.0, "mm");
  require_in_range("width of the shoulders", o.pad.shoulder_width, 0.0, 0.5 * o.pad.width - 1e-3, "mm");
  require_in_range("height of the shoulders", o.pad.shoulder_height, 0.0, 100.0, "mm");
  require_in_range(
      "height of the carrier below the base", o.pad.carrier_height, o.pad.shoulder_height + 1e-3, 200.0, "mm");
  require_in_range("depth of the LEDs' recesses", o.recess.depth * 1e3, 0.0, 1.0, "mm");
  if (o.recess.film_closes)
    require_in_range("height at which the film over an LED closes", *o.recess.film_closes * 1e3, 0.0, 1.0, "mm");
  if (o.recess.depth > 0.0)  // walls are left between them
    require_in_range(
        "length of the LEDs' recesses", o.recess.length_y * 1e3, o.leds.length_y * 1e3, o.leds.pitch * 1e3 - 1.0, "mm");
  require_in_range("mesh edge on the carrier", o.mesh.support_edge * 1e3, 0.1, 30.0, "mm");
  require_in_range("mesh edge at a bonded stem's edges", o.mesh.seam_edge * 1e3, 0.05, 30.0, "mm");
  require_in_range("mesh edge at a free stem's edges", o.mesh.stem_edge * 1e3, 0.05, 30.0, "mm");
  require_in_range("radius of a free stem's edges", o.stem_edge_radius * 1e3, 0.0, 1.0, "mm");
  require_in_range("number of LEDs", o.leds.count, 0, 1000, "");
  require_in_range("LED pitch", o.leds.pitch * 1e3, 0.0, 1000.0, "mm");
  require_in_range("LED length", o.leds.length_y * 1e3, 1e-3, 100.0, "mm");
  require_in_range("LED width", o.leds.width_x * 1e3, 1e-3, 100.0, "mm");
  require_positive("LED power", o.leds.power_W, "W");
  require_in_range("readout bins", o.readout.bins, 0, 10000, "");
  require_in_range("readout half range", o.readout.half_range * 1e3, 1e-3, 1000.0, "mm");
  require_in_range("least sideways part of a visible normal", o.readout.min_abs_nx, 0.0, 1.0, "");
  require_in_range("carrier albedo", o.carrier_albedo, 0.0, 1.0, "");
  if (const auto* white = std::get_if<Lambertian>(&o.touched))
    require_in_range("albedo of a tool that wets the pad", white->albedo, 0.0, 1.0, "");
  if (const auto* mirror = std::get_if<Mirror>(&o.touched))
    require_in_range("reflectance of a tool that wets the pad", mirror->reflectance, 0.0, 1.0, "");
}

}  // namespace lumo

#endif

// ---- lumo/fabrication/casting_options.hpp
#ifndef SINGLE_INCLUDE_LUMO_FABRICATION_CASTING_OPTIONS_HPP
#define SINGLE_INCLUDE_LUMO_FABRICATION_CASTING_OPTIONS_HPP

namespace lumo {

inline constexpr Chords casting_chords{.longest_m = 0.5e-3, .max_turn_rad = 0.05, .shortest_m = 0.05e-3};

/// The section of a feasible design for making things, where it has a cavity: its chords leave the curve by less than 5
/// µm, a tenth of what printers resolve. Throws InfeasibleDesign.
inline HalfSection casting_section(const FingerDesign& design, const PadDimensions& pad = {}) {
  return half_section(design, Twin::none, casting_chords, pad);
}

/// The same of the cap of a pad that has one. Throws InvalidArgument for one without.
inline HalfSection casting_cap_section(const HalfSection& section) {
  return cap_section(section.design, section.twin, casting_chords, section.pad);
}

/// What may be chosen about the parts that a pad is cast with; lengths in m. Every default is our own choice, within
/// what the sources in docs/fabrication.md advise.
struct CastingOptions {
  double clearance = 0.2e-3;      ///< on each side between printed parts that are put together: FDM 0.2 mm, SLA 0.1 mm
  double plate = 4.0e-3;          ///< thickness of a flat carrier's plate; that of a stair is the pad's own
  double flange = 3.0e-3;         ///< of the plate beyond the pad's long sides: the mould seals on it
  double tab = 7.0e-3;            ///< of the plate beyond the pad's ends, with the mounting holes
  double hole_diameter = 3.4e-3;  ///< of the mounting holes: M3, ISO 273 medium
  double strip_width = 2.0e-3;    ///< of the LED strip
  double strip_height = 0.9e-3;   ///< of the LED strip with its LEDs: 0.3 mm flexible circuit and 0.6 mm LED
  double wall = 8.0e-3;           ///< of the mould about the pad
  double rim = 3.0e-3;            ///< how far the mould reaches down the plate's edge, which it is centred by; less on
                                  ///< a stair
  double gate_diameter = 4.0e-3;  ///< at the pad; a Luer tip fits
  double vent_diameter = 2.0e-3;  ///< at the pad: the smallest hole that FDM prints well
  double circuit = 0.3e-3;  ///< of strip_height, without LEDs: it lies below the stem's recesses, if there are any
  FingerOptions::Leds leds = {};      ///< on the strip, centred on the stem, facing up
  FingerOptions::Recess recess = {};  ///< of a stem on which the silicone lies free

  /// Of the smallest wall that is printed: two lines of a 0.4 mm nozzle.
  static constexpr double thinnest_wall = 0.8e-3;

  /// The same for a finger with these LEDs and recesses.
  CastingOptions made_for(const FingerOptions& finger) const {
    CastingOptions o = *this;
    o.leds = finger.leds;
    o.recess = finger.recess;
    return o;
  }
  bool operator==(const CastingOptions&) const = default;
};

/// Limits of the options in mm, for checks and for help texts.
namespace casting_limits {
inline constexpr Limits clearance_mm{0.05, 0.4}, plate_mm{3.0, 20.0}, wall_mm{7.0, 30.0}, strip_width_mm{0.8, 10.0},
    strip_height_mm{0.2, 1.5};
inline constexpr Limits stair_plate_mm{1.5, 20.0}, shoulder_height_mm{2.0, 30.0};
inline constexpr Limits gate_mm{2.0, 4.0}, vent_mm{0.8, 2.0};
/// Least silicone above the stem and beside the voids with their fits [mm]: the design's 5 mm less what clearances and
/// rounding take.
inline constexpr double above_stem_mm = 4.9, beside_void_mm = 4.55;
/// Least wall of the stem on each side of the LED strip's pocket, and of its end beyond the strip [m].
inline constexpr double beside_strip = 0.6e-3, beyond_strip = 1.0e-3;
/// Least thickness of a recess's floor over the LED strip, which LEDs reach through: two layers [mm].
inline constexpr double over_circuit_mm = 0.4;
}  // namespace casting_limits

}  // namespace lumo

#endif

// ---- lumo/geometry/closed_surface.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_CLOSED_SURFACE_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_CLOSED_SURFACE_HPP

namespace lumo {

/// A flat polygon of a surface, by vertex numbers, counter-clockwise seen from outside.
struct Facet {
  std::vector<int> loop;
  int patch = -1;  ///< number of the part of the surface that it belongs to; negative: of none
};

/// A closed polyhedral surface.
struct ClosedSurface {
  std::vector<Vec3d> vertices;  ///< [m] or any unit: what reads it is scale-free
  std::vector<Facet> facets;    ///< closed, manifold, counter-clockwise seen from outside
};

}  // namespace lumo

#endif

// ---- lumo/morphology/emitter.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_EMITTER_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_EMITTER_HPP

namespace lumo {

/// Sine (≥ 0) and cosine of the angle between a direction and an axis.
struct Polar {
  double sine, cosine;
};

/// A source of light in the medium that it touches: a flat or pointlike place, from all of which light goes the same
/// ways, evenly round an axis. Optional: `double intensity(double cosine) const` [W/sr], power_W times the density of
/// the directions that polar() draws; with it direct light is gathered backwards, which has less noise, without it (a
/// collimated beam has no such density) it is traced forward. `bool in_air`: it radiates into the air beside the body,
/// not into the body; its light is traced forward. `double area_m2() const` and `bool covers(const Vec3d& p) const`
/// (does it cover a point of its plane [m]?): with them and the intensity, a camera's paths see it. Laws: |axis| = 1;
/// point(u, v) is uniform in area [m] over (0, 1)² (there is less noise where point(1−u, 1−v) lies opposite it about
/// `center`); polar(u) is monotone; mirrored(m), m = (±1, ±1, 1), radiates to the mirror image of the axis, and points
/// do not depend on which of several ways the same source is described; power_W is all that it radiates [W]; `channel`
/// ≥ 0 is its colour.
template <class E>
concept EmitterModel = requires(const E& e, double u, const Vec3d& m) {
  { e.center } -> std::convertible_to<Vec3d>;
  { e.power_W } -> std::convertible_to<double>;
  { e.channel } -> std::convertible_to<int>;
  { e.axis() } -> std::convertible_to<Vec3d>;
  { e.point(u, u) } -> std::convertible_to<Vec3d>;
  { e.polar(u) } -> std::convertible_to<Polar>;
  { e.mirrored(m) } -> std::convertible_to<E>;
};

/// A flat rectangular emitter with a cosine law (Lambert 1760). It radiates to `half_u` × `half_v`.
struct RectangleEmitter {
  Vec3d center{0.0, 0.0, 0.0};  ///< [m]
  Vec3d half_u{1.0, 0.0, 0.0};  ///< half edge [m]
  Vec3d half_v{0.0, 1.0, 0.0};  ///< half edge [m]
  double power_W = 1.0;
  int channel = 0;      ///< colour channel
  bool in_air = false;  ///< radiates into the air beside the body

  Vec3d axis() const {
    const Vec3d &u = half_u, &v = half_v;
    return u.cross(v).normalized();
  }
  Vec3d point(double u, double v) const {
    const Vec3d &c = center, &to_u = half_u, &to_v = half_v;
    return c + (2.0 * u - 1.0) * to_u + (2.0 * v - 1.0) * to_v;
  }
  Polar polar(double u) const { return {std::sqrt(u), std::sqrt(1.0 - u)}; }
  double intensity(double cosine) const { return cosine > 0.0 ? power_W / pi * cosine : 0.0; }
  double area_m2() const { return 4.0 * half_u.cross(half_v).norm(); }
  bool covers(const Vec3d& p) const {
    const Vec3d from = p - center, n = half_u.cross(half_v);
    const double of_one = n.squaredNorm();
    return std::abs(from.cross(half_v).dot(n)) <= of_one && std::abs(half_u.cross(from).dot(n)) <= of_one;
  }
  RectangleEmitter mirrored(const Vec3d& m) const;
};

static_assert(EmitterModel<RectangleEmitter>);

/// Throws InvalidArgument for an emitter without area or with a coordinate that is not finite.
inline void validate(const RectangleEmitter& e) {
  if (!e.half_u.allFinite() || !e.half_v.allFinite()) throw InvalidArgument("emitter: a coordinate is not finite");
  require_positive("emitter area", e.area_m2(), "m2");
}

/// Any model of EmitterModel: a value, cheap to copy.
class Emitter {
 public:
  template <class E>
  requires(!std::same_as<E, Emitter> && EmitterModel<E>) Emitter(const E& model)
      : model_(std::make_shared<const E>(model.mirrored(Vec3d(1.0, 1.0, 1.0)))), calls_(&calls<E>) {}

  Vec3d center() const { return calls_->center(model_.get()); }
  double power_W() const { return calls_->power_W(model_.get()); }
  int channel() const { return calls_->channel(model_.get()); }
  Vec3d axis() const { return calls_->axis(model_.get()); }
  Vec3d point(double u, double v) const { return calls_->point(model_.get(), u, v); }
  Polar polar(double u) const { return calls_->polar(model_.get(), u); }
  bool has_intensity() const { return calls_->intensity != nullptr; }
  bool in_air() const { return calls_->in_air(model_.get()); }
  /// [W/sr]; only where has_intensity().
  double intensity(double cosine) const { return calls_->intensity(model_.get(), cosine); }
  /// Has it a brightness, and a shape that is known?
  bool can_be_seen() const { return has_intensity() && calls_->area != nullptr && area_m2() > 0.0; }
  /// [m²]; this and covers() only where can_be_seen().
  double area_m2() const { return calls_->area(model_.get()); }
  bool covers(const Vec3d& p) const { return calls_->covers(model_.get(), p); }
  Emitter mirrored(const Vec3d& m) const { return calls_->mirrored(model_.get(), m); }
  /// Its model, if it is an E.
  template <EmitterModel E> const E* as() const {
    return calls_ == &calls<E> ? static_cast<const E*>(model_.get()) : nullptr;
  }
  bool same_model(const Emitter& other) const { return calls_ == other.calls_; }
  /// Throws InvalidArgument for a power that is not positive, a channel below 0, numbers that are not finite, and what
  /// the model's own validate() refuses.
  void validate() const;

 private:
  struct Calls {
    Vec3d (*center)(const void*);
    double (*power_W)(const void*);
    int (*channel)(const void*);
    Vec3d (*axis)(const void*);
    Vec3d (*point)(const void*, double, double);
    Polar (*polar)(const void*, double);
    double (*intensity)(const void*, double);   ///< or null
    double (*area)(const void*);                ///< or null
    bool (*covers)(const void*, const Vec3d&);  ///< or null
    bool (*in_air)(const void*);
    Emitter (*mirrored)(const void*, const Vec3d&);
    void (*validate)(const void*);
  };
  template <class E> static const E& model(const void* e) { return *static_cast<const E*>(e); }
  template <class E> static constexpr auto intensity_of() -> double (*)(const void*, double) {
    if constexpr (requires(const E& e) {
                    { e.intensity(0.5) } -> std::convertible_to<double>;
                  })
      return [](const void* e, double c) -> double { return model<E>(e).intensity(c); };
    else return nullptr;
  }
  template <class E> static constexpr bool has_shape = requires(const E& e, const Vec3d& p) {
    { e.area_m2() } -> std::convertible_to<double>;
    { e.covers(p) } -> std::convertible_to<bool>;
  };
  template <class E> static constexpr auto area_of() -> double (*)(const void*) {
    if constexpr (has_shape<E>) return [](const void* e) -> double { return model<E>(e).area_m2(); };
    else return nullptr;
  }
  template <class E> static constexpr auto covers_of() -> bool (*)(const void*, const Vec3d&) {
    if constexpr (has_shape<E>) return [](const void* e, const Vec3d& p) -> bool { return model<E>(e).covers(p); };
    else return nullptr;
  }
  template <class E> static const Calls calls;

  std::shared_ptr<const void> model_;
  const Calls* calls_;
};

/// Throws InvalidArgument for no emitters, a broken one, or a colour channel below the highest one that no emitter has.
inline void validate(const std::vector<Emitter>& emitters);

/// Number of colour channels: one more than the highest; 0 without emitters.
inline int color_count(const std::vector<Emitter>& emitters) {
  int count = 0;
  for (const Emitter& e : emitters) count = std::max(count, e.channel() + 1);
  return count;
}

// A mirror image changes the handedness of the edges, which is mended; of the two ways to name the edges, one is
// standard.
inline RectangleEmitter RectangleEmitter::mirrored(const Vec3d& m) const {
  RectangleEmitter image = *this;
  image.center = m.cwiseProduct(center);
  image.half_u = m.cwiseProduct(half_u);
  image.half_v = m.cwiseProduct(half_v) * m.prod();
  Eigen::Index k = 0;
  image.half_u.cwiseAbs().maxCoeff(&k);
  if (image.half_u[k] < 0.0) {
    image.half_u = -image.half_u;
    image.half_v = -image.half_v;
  }
  return image;
}

namespace detail {

/// What the model's own validate() says, if it has one.
template <class E> void validate_model(const E& model) {
  if constexpr (requires { validate(model); }) validate(model);
}

}  // namespace detail

template <class E> const Emitter::Calls Emitter::calls = {[](const void* e) -> Vec3d { return model<E>(e).center; },
    [](const void* e) -> double { return model<E>(e).power_W; },
    [](const void* e) -> int { return model<E>(e).channel; }, [](const void* e) -> Vec3d { return model<E>(e).axis(); },
    [](const void* e, double u, double v) -> Vec3d { return model<E>(e).point(u, v); },
    [](const void* e, double u) -> Polar { return model<E>(e).polar(u); }, intensity_of<E>(), area_of<E>(),
    covers_of<E>(),
    [](const void* e) -> bool {
      if constexpr (requires {
                      { model<E>(e).in_air } -> std::convertible_to<bool>;
                    })
        return model<E>(e).in_air;
      else return false;
    },
    [](const void* e, const Vec3d& m) { return Emitter(model<E>(e).mirrored(m)); },
    [](const void* e) { detail::validate_model(model<E>(e)); }};

inline void Emitter::validate() const {
  require_positive("emitter power", power_W(), "W");
  require_in_range("emitter channel", channel(), 0, 255, "");
  if (!center().allFinite()) throw InvalidArgument("emitter: its centre is not finite");
  calls_->validate(model_.get());
  if (!point(0.3, 0.6).allFinite()) throw InvalidArgument("emitter: a point of it is not finite");
  if (!(std::abs(axis().norm() - 1.0) < 1e-9))
    throw InvalidArgument(message("emitter: its axis has length ", axis().norm(), ", must be 1"));
}

inline void validate(const std::vector<Emitter>& emitters) {
  if (emitters.empty()) throw InvalidArgument("emitters: none given, at least one is needed");
  for (const Emitter& e : emitters) e.validate();
  for (int c = 0; c < color_count(emitters); ++c)
    if (std::none_of(emitters.begin(), emitters.end(), [&](const Emitter& e) { return e.channel() == c; }))
      throw InvalidArgument(message("emitters: none has colour channel ", c, ", but one has a higher one"));
}

/// Point of the unit disc from two numbers in (0, 1), uniform in area; opposite numbers give opposite points. Source:
/// Shirley & Chiu, "A Low Distortion Map Between Disk and Square", J. Graphics Tools 2 (1997).
inline Vec3d on_unit_disc(double u, double v, const Vec3d& t1, const Vec3d& t2) {
  const double a = 2.0 * u - 1.0, b = 2.0 * v - 1.0;
  if (a == 0.0 && b == 0.0) return Vec3d::Zero();
  const bool steep = std::abs(b) > std::abs(a);
  const double r = steep ? b : a, turn = steep ? 0.5 * pi - 0.25 * pi * (a / b) : 0.25 * pi * (b / a);
  return r * (std::cos(turn) * t1 + std::sin(turn) * t2);
}

/// Point of the disc about `center` with unit normal `n`; the same for every description of it.
inline Vec3d on_disc(const Vec3d& center, const Vec3d& n, double radius_m, double u, double v) {
  Vec3d t1, t2;
  tangents(n, t1, t2);
  return center + radius_m * on_unit_disc(u, v, t1, t2);
}

/// A flat round emitter with a cosine law (Lambert 1760). It radiates to `normal`.
struct DiscEmitter {
  Vec3d center{0.0, 0.0, 0.0};  ///< [m]
  Vec3d normal{0.0, 0.0, 1.0};  ///< unit
  double radius_m = 0.5e-3;
  double power_W = 1.0;
  int channel = 0;  ///< colour channel

  Vec3d axis() const { return normal; }
  Vec3d point(double u, double v) const { return on_disc(center, normal, radius_m, u, v); }
  Polar polar(double u) const { return {std::sqrt(u), std::sqrt(1.0 - u)}; }
  double intensity(double cosine) const { return cosine > 0.0 ? power_W / pi * cosine : 0.0; }
  double area_m2() const { return pi * radius_m * radius_m; }
  bool covers(const Vec3d& p) const { return (p - center).squaredNorm() <= radius_m * radius_m; }
  DiscEmitter mirrored(const Vec3d& m) const {
    return {m.cwiseProduct(center), m.cwiseProduct(normal), radius_m, power_W, channel};
  }
};

inline void validate(const DiscEmitter& e) { require_positive("radius of a disc emitter", e.radius_m, "m"); }

static_assert(EmitterModel<DiscEmitter>);

/// A point that radiates alike in all directions. It must lie inside the medium: of a point on its surface half the
/// light starts out of it.
struct PointEmitter {
  Vec3d center{0.0, 0.0, 0.0};  ///< [m]
  double power_W = 1.0;
  int channel = 0;  ///< colour channel

  Vec3d axis() const { return Vec3d::UnitZ(); }
  Vec3d point(double, double) const { return center; }
  Polar polar(double u) const { return {2.0 * std::sqrt(u * (1.0 - u)), 1.0 - 2.0 * u}; }
  double intensity(double) const { return power_W / (4.0 * pi); }
  PointEmitter mirrored(const Vec3d& m) const { return {m.cwiseProduct(center), power_W, channel}; }
};

static_assert(EmitterModel<PointEmitter>);

}  // namespace lumo

#endif

// ---- lumo/morphology/shape.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_SHAPE_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_SHAPE_HPP

namespace lumo {

/// An exact surface that a patch of a body lies on.
/// Laws: closest_point is idempotent; normal(p) is the outward unit normal at closest_point(p). A `validate(shape)`
/// beside it is called before the shape is used.
template <class S>
concept SurfaceShape = requires(const S& shape, const Vec3d& p) {
  { shape.closest_point(p) } -> std::convertible_to<Vec3d>;
  { shape.normal(p) } -> std::convertible_to<Vec3d>;
};

/// The plane through `point` with outward unit normal `direction`.
struct Plane {
  Vec3d point{0.0, 0.0, 0.0};
  Vec3d direction{0.0, 0.0, 1.0};

  Vec3d closest_point(const Vec3d& p) const { return p - direction.dot(p - point) * direction; }
  Vec3d normal(const Vec3d&) const { return direction; }
};

/// The upper half (z ≥ centre) of the elliptic cylinder along y: ((x−cx)/semi_x)² + ((z−cz)/semi_z)² = 1, lengths in m.
struct EllipticCylinder {
  Vec3d center{0.0, 0.0, 0.0};
  double semi_x = 1.0;
  double semi_z = 1.0;

  Vec3d closest_point(const Vec3d& p) const;
  Vec3d normal(const Vec3d& p) const;
};

/// Sphere of `radius` [m] about `center`; the body is inside.
struct SphereShape {
  Vec3d center{0.0, 0.0, 0.0};
  double radius = 1.0;

  Vec3d closest_point(const Vec3d& p) const { return center + radius * normal(p); }
  Vec3d normal(const Vec3d& p) const {
    const Vec3d d = p - center;
    const double r = d.norm();
    return r > 0.0 ? Vec3d(d / r) : Vec3d(Vec3d::UnitZ());
  }
};

/// Throws InvalidArgument unless the direction of a surface has length 1, within 1e-6.
inline void require_unit(const char* what, const Vec3d& direction) {
  if (!(std::abs(direction.norm() - 1.0) <= 1e-6))
    throw InvalidArgument(message(what, " has length ", direction.norm(), ", must be 1"));
}

inline void validate(const Plane& plane) { require_unit("direction of a plane", plane.direction); }

/// Any other model of SurfaceShape: a value, cheap to copy.
class OwnShape {
 public:
  template <class S>
  requires(!std::same_as<S, OwnShape> && SurfaceShape<S>) OwnShape(const S& model)
      : model_(std::make_shared<const S>(model)), calls_(&calls<S>) {}

  Vec3d closest_point(const Vec3d& p) const { return calls_->closest_point(model_.get(), p); }
  Vec3d normal(const Vec3d& p) const { return calls_->normal(model_.get(), p); }
  /// What the model's own validate() throws, if it has one.
  void validate() const { calls_->validate(model_.get()); }
  /// Its model, if it is an S.
  template <SurfaceShape S> const S* as() const {
    return calls_ == &calls<S> ? static_cast<const S*>(model_.get()) : nullptr;
  }

 private:
  struct Calls {
    Vec3d (*closest_point)(const void*, const Vec3d&);
    Vec3d (*normal)(const void*, const Vec3d&);
    void (*validate)(const void*);
  };
  template <class S> static const Calls calls;

  std::shared_ptr<const void> model_;
  const Calls* calls_;
};

/// The surface of a patch: any SurfaceShape. Three that bodies have most are called directly, all others through
/// OwnShape.
using Shape = std::variant<Plane, EllipticCylinder, SphereShape, OwnShape>;

inline Vec3d closest_point(const Shape& shape, const Vec3d& p) {
  return std::visit([&](const auto& s) -> Vec3d { return s.closest_point(p); }, shape);
}
inline Vec3d outward_normal(const Shape& shape, const Vec3d& p) {
  return std::visit([&](const auto& s) -> Vec3d { return s.normal(p); }, shape);
}

namespace detail {

// What a shape says of its own numbers.
template <class S> void validate_shape(const S& shape) {
  if constexpr (requires { shape.validate(); }) shape.validate();
  else if constexpr (requires { validate(shape); }) validate(shape);
}

}  // namespace detail

/// Throws what the shape's own validate() throws. Not for what could become a Shape: that would ask itself.
template <std::same_as<Shape> S> void validate(const S& shape) {
  std::visit([](const auto& s) { detail::validate_shape(s); }, shape);
}

template <class S> const OwnShape::Calls OwnShape::calls = {
    [](const void* s, const Vec3d& p) -> Vec3d { return static_cast<const S*>(s)->closest_point(p); },
    [](const void* s, const Vec3d& p) -> Vec3d { return static_cast<const S*>(s)->normal(p); },
    [](const void* s) { detail::validate_shape(*static_cast<const S*>(s)); }};

// The foot of the perpendicular on an ellipse, after Eberly, "Distance from a Point to an Ellipse" (2013): the root of
// a convex, falling function; Newton's method from the surface, where most points are, and bisection where a step would
// leave the bracket, so that it converges for every aspect ratio and every point.
inline Vec3d EllipticCylinder::closest_point(const Vec3d& p) const {
  const double px = std::abs(p.x() - center.x());
  const double pz = std::max(0.0, p.z() - center.z());
  const double side = p.x() < center.x() ? -1.0 : 1.0;
  const bool x_major = semi_x >= semi_z;
  const double a = x_major ? semi_x : semi_z, b = x_major ? semi_z : semi_x;
  const double u = x_major ? px : pz, v = x_major ? pz : px;  // along the major and the minor axis
  double fu = 0.0, fv = 0.0;
  if (v > 0.0) {
    if (u > 0.0) {
      const double r = (a / b) * (a / b), e = r - 1.0, zu = r * u / a, zv = v / b;
      double low = zv, high = std::hypot(zu, zv), t = std::clamp(1.0, low, high);  // 1: on the surface
      for (int i = 0; i < 200; ++i) {
        const double x = zu / (t + e), y = zv / t, excess = x * x + y * y - 1.0;
        (excess > 0.0 ? low : high) = t;
        const double step = 0.5 * excess / (x * x / (t + e) + y * y / t), next = t + step;
        const bool close = std::abs(step) <= 1e-9 * t;  // then the error that is left is the square of this
        t = close || (next >= low && next <= high) ? next : 0.5 * (low + high);
        if (close || !(low < high)) break;
      }
      fu = r * u / (t + e);
      fv = v / t;
    } else {
      fv = b;
    }
  } else {
    const double c = a * a - b * b;
    if (a * u < c) {
      fu = a * a * u / c;
      fv = b * std::sqrt(std::max(0.0, 1.0 - (fu / a) * (fu / a)));
    } else {
      fu = a;
    }
  }
  return {center.x() + side * (x_major ? fu : fv), p.y(), center.z() + (x_major ? fv : fu)};
}

inline Vec3d EllipticCylinder::normal(const Vec3d& p) const {
  const Vec3d foot = closest_point(p) - center;
  return Vec3d(foot.x() / (semi_x * semi_x), 0.0, foot.z() / (semi_z * semi_z)).normalized();
}

static_assert(SurfaceShape<Plane> && SurfaceShape<EllipticCylinder> && SurfaceShape<SphereShape>);
static_assert(SurfaceShape<OwnShape> && !SurfaceShape<Shape>);

}  // namespace lumo

#endif

// ---- lumo/morphology/body.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_BODY_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_BODY_HPP

namespace lumo {

/// A part of a body's closed surface on which all tags are the same.
struct Patch {
  std::string name;
  Shape shape = Plane{};       ///< the exact surface; mesh nodes of the patch lie on it
  bool bonded = false;         ///< fixed to the carrier (closed set: its edge nodes are fixed too)
  bool contactable = false;    ///< the indenter may touch it
  bool meets_carrier = false;  ///< may come to rest on the carrier
  SurfaceOptics optics = Dielectric{};
  bool visible = true;  ///< on the outside: light that leaves here may lie in a region
};

/// A rigid axis-aligned box that the silicone can come to rest on.
struct RigidBox {
  Vec3d center{0.0, 0.0, 0.0};  ///< [m]
  Vec3d half{1.0, 1.0, 1.0};    ///< half edges [m]
  /// Of all its edges and corners, inside the box; 0: sharp [m]. Where silicone slides over sharp edges, what becomes
  /// of a press depends on the steps that lead to it.
  double edge_radius = 0.0;
};

/// Wanted edge length of the mesh [m] at a place: across and along y. Elements are stretched by the ratio of the two.
struct Sizing {
  std::function<double(const Vec3d&)> edge;  ///< across y [m]
  double stretch_y = 1.0;                    ///< edges along y are this much longer
  /// Finer edges [m] at a place when a tool touches the body at another; empty: none are wanted.
  std::function<double(const Vec3d& place, const Vec3d& touch)> edge_under_touch;
};

/// One soft, transparent body on a rigid carrier: all that meshing, mechanics and optics need to know.
/// SI units, finger frame (x lateral, y along the finger, z outward normal).
struct Body {
  static constexpr int mirror_patch = -1;

  std::string name;
  std::vector<Patch> patches;
  std::vector<Vec3d> vertices;  ///< of the boundary of the meshed sector [m]
  /// Closed boundary of the sector x ≥ 0 and/or y ≥ 0 that `symmetry` leaves. Facet::patch: index into `patches`, or
  /// mirror_patch for a face in a symmetry plane.
  std::vector<Facet> facets;
  Symmetry symmetry;  ///< the whole body is the sector and its mirror images
  Sizing sizing;
  double exact_volume_m3 = 0.0;  ///< of the whole body; 0 when not known

  std::vector<RigidBox> carrier;  ///< union of boxes; what patches rest on
  Vec3d pivot{0.0, 0.0, 0.0};     ///< approach directions turn about this point (shifted by the place) [m]

  Medium medium;        ///< inside
  Medium surroundings;  ///< outside (air)
  /// What light in the body meets where a tool touches; Dielectric: a film of air is left between
  SurfaceOptics touched = Dielectric{};
  std::vector<RigidFace> rigid_faces;  ///< carrier faces seen through air
  std::vector<Emitter> emitters;
  /// Height of the film of air over an emitter in air at which it begins to close [m]; 0: where the body reaches the
  /// emitter; nullopt: never.
  std::optional<double> film_closes_m = 0.0;
  int regions = 0;  ///< number of readout regions
  /// Region of a point of the surface, from its position [m] and exact undeformed outward normal: 0 … regions−1, or −1.
  std::function<int(const Vec3d& position, const Vec3d& normal)> region;
  bool regions_in_space = false;  ///< region() is asked for where a point is, not for where it was undeformed
  /// Light that leaves against this direction is not seen; 0: all is.
  Vec3d seen_towards = Vec3d::Zero();
  /// Region → its mirror image in x = 0 and y = 0; empty: itself; nullopt: what region() says of mirror images
  /// (region_images). One that contradicts region() is refused.
  std::optional<std::vector<int>> region_image_x, region_image_y;
};

/// Exact outward normal at the point of a patch nearest to `p`, also in the mirror images of the sector that the patch
/// describes.
inline Vec3d outward_normal(const Body& body, int patch, const Vec3d& p) {
  const Vec3d fold(body.symmetry.x && p.x() < 0.0 ? -1.0 : 1.0, body.symmetry.y && p.y() < 0.0 ? -1.0 : 1.0, 1.0);
  return fold.cwiseProduct(outward_normal(body.patches[std::size_t(patch)].shape, fold.cwiseProduct(p)));
}

}  // namespace lumo

#endif

// ---- lumo/morphology/stem_faces.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_STEM_FACES_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_STEM_FACES_HPP

namespace lumo {

/// A stretch along y of the top of a stem on which the silicone lies, between two recesses or the stem's ends [m].
struct Ridge {
  double low, high;
};

/// Stretches of the recesses' floors between ridges, low and high end along y [m].
inline std::vector<std::array<double, 2>> recess_floors(const std::vector<Ridge>& ridges) {
  std::vector<std::array<double, 2>> floors;
  for (std::size_t k = 0; k + 1 < ridges.size(); ++k) floors.push_back({ridges[k].high, ridges[k + 1].low});
  return floors;
}

/// A stem on which silicone lies, with edges of one radius [m].
struct FreeStem {
  double half_width, half_length, height;
  double floor;  ///< height of the floors between ridges
  std::vector<Ridge> ridges;
  double edge_radius;
};

namespace detail {

/// Collects carrier faces; those without area are left out.
struct FaceList {
  std::vector<RigidFace>& faces;
  SurfaceOptics optics;

  void add(std::string name, std::vector<Vec3d> corners) const {
    Vec3d area = Vec3d::Zero();
    for (std::size_t k = 1; k + 1 < corners.size(); ++k)
      area += (corners[k] - corners[0]).cross(corners[k + 1] - corners[0]);
    if (area.norm() > 1e-12) faces.push_back({std::move(name), std::move(corners), optics});  // [m²]
  }
  /// The face and its image at negative x.
  void add_pair(const std::string& name, std::vector<Vec3d> corners) const {
    std::vector<Vec3d> image(corners);
    std::reverse(image.begin() + 1, image.end());
    for (Vec3d& p : image) p.x() = -p.x();
    add(name + " +x", std::move(corners));
    add(name + " -x", std::move(image));
  }
};

// A rounded edge between two faces as chords: how far each point is from the sharp edge along the first face, and how
// far behind that face. Chords lie inside the edge: silicone that rests on it does not cross them.
inline std::array<std::array<double, 2>, 3> rounded_edge(double radius) {
  const double middle = (1.0 - std::sqrt(0.5)) * radius;
  return {{{radius, 0.0}, {middle, middle}, {0.0, radius}}};
}

// How far behind its sharp end a ridge meets a floor that lies `depth` below its top.
inline double ridge_foot(double radius, double depth) {
  const auto edge = rounded_edge(radius);
  for (std::size_t k = 0; k + 1 < edge.size(); ++k)
    if (edge[k + 1][1] > depth) {
      const double t = (depth - edge[k][1]) / (edge[k + 1][1] - edge[k][1]);
      return edge[k][0] + t * (edge[k + 1][0] - edge[k][0]);
    }
  return 0.0;
}

// One end of a ridge; `side`: −1 the low one, 1 the high one. An end of the stem goes down to its base, one at a recess
// to the floor.
inline void add_ridge_end(const FaceList& list, const FreeStem& stem, const Ridge& ridge, double side) {
  const double r = stem.edge_radius, w = stem.half_width, inner = w - r, h = stem.height;
  const double end = side < 0.0 ? ridge.low : ridge.high;
  const bool outer = std::abs(end) >= stem.half_length - 1e-9;
  const double bottom = outer ? 0.0 : stem.floor, side_bottom = outer ? 0.0 : stem.floor - r;
  const auto edge = rounded_edge(r);
  // Lit from outside: the order of corners that holds at the high end is turned round at the low one.
  const auto turned = [&](std::vector<Vec3d> corners) {
    if (side < 0.0) std::reverse(corners.begin() + 1, corners.end());
    return corners;
  };
  const auto across = [&](const std::string& name, double y0, double z0, double y1, double z1) {
    list.add(name, turned({{-inner, y0, z0}, {inner, y0, z0}, {inner, y1, z1}, {-inner, y1, z1}}));
  };
  for (std::size_t k = 0; k + 1 < edge.size(); ++k) {
    const double z0 = h - edge[k][1], z1 = std::max(h - edge[k + 1][1], bottom);
    if (z0 <= bottom) break;
    const double y1 = h - edge[k + 1][1] < bottom ? ridge_foot(r, h - bottom) : edge[k + 1][0];
    across(outer ? "stem edge" : "recess wall", end - side * edge[k][0], z0, end - side * y1, z1);
  }
  if (h - r > bottom) across(outer ? "stem end" : "recess wall", end, h - r, end, bottom);

  // The corner: an eighth of a sphere, and the upright edge below it. Towards a recess half of that is in the floor.
  const Vec3d middle(inner, end - side * r, h - r);
  const auto at = [&](double x, double y, double z) { return Vec3d(middle + r * Vec3d(x, side * y, z).normalized()); };
  const Vec3d top = at(0, 0, 1), right = at(1, 0, 0), front = at(0, 1, 0), top_right = at(1, 0, 1),
              top_front = at(0, 1, 1), right_front = at(1, 1, 0);
  const auto triangle = [&](const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    list.add_pair("stem corner", turned({a, b, c}));
  };
  triangle(top, top_right, top_front);
  triangle(top_right, right, right_front);
  triangle(top_right, right_front, top_front);
  triangle(top_front, right_front, front);
  const auto upright = [&](const Vec3d& a, const Vec3d& b) {
    list.add_pair("stem edge", turned({{a.x(), a.y(), side_bottom}, {b.x(), b.y(), side_bottom}, b, a}));
  };
  upright(right, right_front);
  if (outer) upright(right_front, front);
}

// Its ridges, the floors between them, and its sides; rounded edges as chords.
inline void add_free_stem(const FaceList& list, const FreeStem& stem) {
  const double r = stem.edge_radius, w = stem.half_width, inner = w - r, h = stem.height, l = stem.half_length - r;
  const auto edge = rounded_edge(r);
  const auto level = [&](const char* name, double y0, double y1, double z) {
    list.add(name, {{-inner, y0, z}, {inner, y0, z}, {inner, y1, z}, {-inner, y1, z}});
  };
  const auto long_edge = [&](double y0, double y1, double z) {
    for (std::size_t k = 0; k + 1 < edge.size(); ++k) {
      const double x0 = w - edge[k][0], z0 = z - edge[k][1], x1 = w - edge[k + 1][0], z1 = z - edge[k + 1][1];
      list.add_pair("stem edge", {{x1, y0, z1}, {x1, y1, z1}, {x0, y1, z0}, {x0, y0, z0}});
    }
  };
  list.add_pair("stem", {{w, -l, 0}, {w, l, 0}, {w, l, stem.floor - r}, {w, -l, stem.floor - r}});
  for (const Ridge& ridge : stem.ridges) {
    const double y0 = ridge.low + r, y1 = ridge.high - r;
    level("ridge", y0, y1, h);
    long_edge(y0, y1, h);
    list.add_pair("ridge side", {{w, y0, stem.floor - r}, {w, y1, stem.floor - r}, {w, y1, h - r}, {w, y0, h - r}});
    for (const double side : {-1.0, 1.0}) add_ridge_end(list, stem, ridge, side);
  }
  const double foot = ridge_foot(r, h - stem.floor);
  for (const auto& [from, to] : recess_floors(stem.ridges)) {
    level("recess floor", from - foot, to + foot, stem.floor);
    long_edge(from - r, to + r, stem.floor);
  }
}

}  // namespace detail
}  // namespace lumo

#endif

// ---- lumo/morphology/finger_carrier.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_FINGER_CARRIER_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_FINGER_CARRIER_HPP

namespace lumo {

/// Where the LEDs lie along the finger [m].
inline std::vector<double> led_places(const FingerOptions::Leds& leds) {
  std::vector<double> y;
  for (int k = 0; k < leds.count; ++k) y.push_back((k - 0.5 * (leds.count - 1)) * leds.pitch);
  return y;
}

/// Ridges of a stem; one if it has no recesses.
inline std::vector<Ridge> stem_ridges(const FingerOptions& o) {
  const double half = 0.5e-3 * o.pad.length;
  std::vector<Ridge> ridges{{-half, half}};
  if (o.recess.depth > 0.0)
    for (const double y : led_places(o.leds)) {
      ridges.back().high = y - 0.5 * o.recess.length_y;
      ridges.push_back({y + 0.5 * o.recess.length_y, half});
    }
  return ridges;
}

/// Lengths of a finger's carrier [m].
struct StemLengths {
  double stem, outer, lip, height, half_length;
  double floor;  ///< height of the recesses' floors

  StemLengths(const HalfSection& s, const FingerOptions& o)
      : stem(0.5e-3 * s.design.w_s),
        outer(stem + 1e-3 * s.design.w_v),
        lip(1e-3 * s.pad.lip_end()),
        height(1e-3 * s.design.h_s),
        half_length(0.5e-3 * s.pad.length),
        floor(height - o.recess.depth) {}
};

/// The carrier's boxes. Throws InvalidArgument where a stem's edges cannot be as round as asked for.
inline std::vector<RigidBox> carrier_boxes(const HalfSection& s, const FingerOptions& o) {
  if (s.twin == Twin::unsupported_base || s.twin == Twin::held_top) return {};
  const StemLengths at(s, o);
  const double back = -1e-3 * s.pad.carrier_height;
  const auto box = [&](double x, double y0, double y1, double z0, double z1) {
    return RigidBox{{0, 0.5 * (y0 + y1), 0.5 * (z0 + z1)}, {x, 0.5 * (y1 - y0), 0.5 * (z1 - z0)}};
  };
  std::vector<RigidBox> boxes{box(at.lip, -at.half_length, at.half_length, back, 0.0)};
  if (s.twin == Twin::bonded_base) return boxes;
  const double low = s.pad.stem == Stem::bonded ? 0.5 * back : back;  // inside the block
  if (s.pad.stem == Stem::bonded || o.recess.depth == 0.0) {
    boxes.push_back(box(at.stem, -at.half_length, at.half_length, low, at.height));
  } else {
    boxes.push_back(box(at.stem, -at.half_length, at.half_length, low, at.floor));
    for (const Ridge& ridge : stem_ridges(o)) boxes.push_back(box(at.stem, ridge.low, ridge.high, low, at.height));
  }
  if (s.lies_on_stem())
    for (std::size_t k = 1; k < boxes.size(); ++k) {
      boxes[k].edge_radius = o.stem_edge_radius;
      require_in_range(
          "radius of a free stem's edges", o.stem_edge_radius * 1e3, 0.0, boxes[k].half.minCoeff() * 1e3, "mm");
    }
  return boxes;
}

namespace detail {

// Faces of a bonded stem beside voids.
inline void add_bonded_stem(const FaceList& list, const StemLengths& at, bool capped) {
  const double w = at.stem, l = at.half_length, h = at.height;
  list.add_pair("stem", {{w, -l, 0}, {w, l, 0}, {w, l, h}, {w, -l, h}});
  if (capped) list.add("stem end", {{w, l, 0}, {-w, l, 0}, {-w, l, h}, {w, l, h}});
}

// The end of the block, at which a solid cap looks.
inline void add_block_end(const FaceList& list, const StemLengths& at, double shoulder) {
  const double y = at.half_length;
  list.add("block end", {{at.lip, y, shoulder}, {-at.lip, y, shoulder}, {-at.lip, y, 0}, {at.lip, y, 0}});
}

}  // namespace detail

/// Faces of the carrier that light meets through air.
inline std::vector<RigidFace> carrier_faces(const HalfSection& s, const FingerOptions& o) {
  const StemLengths at(s, o);
  std::vector<RigidFace> faces;
  const detail::FaceList list{faces, Lambertian{o.carrier_albedo}};
  const double l = at.half_length;
  if (!has_stem(s.twin) || (!s.lies_on_stem() && s.design.w_v <= 0.0)) return faces;
  const bool capped = s.pad.cap_length > 0.0;
  if (s.lies_on_stem())
    detail::add_free_stem(list, {at.stem, l, at.height, at.floor, stem_ridges(o), o.stem_edge_radius});
  else detail::add_bonded_stem(list, at, capped);
  list.add_pair("base", {{at.stem, -l, 0}, {at.outer, -l, 0}, {at.outer, l, 0}, {at.stem, l, 0}});
  if (capped) detail::add_block_end(list, at, -1e-3 * s.pad.shoulder_height);
  return faces;
}

}  // namespace lumo

#endif

// ---- lumo/fabrication/casting_layout.hpp
#ifndef SINGLE_INCLUDE_LUMO_FABRICATION_CASTING_LAYOUT_HPP
#define SINGLE_INCLUDE_LUMO_FABRICATION_CASTING_LAYOUT_HPP

namespace lumo {

/// Throws InvalidArgument for an option that is out of range, or does not fit the section.
inline void validate(const CastingOptions& options, const HalfSection& section);

/// The lengths that all parts share, so that they fit each other in every bit; in m, the pad's frame.
struct CastingLayout {
  double half_width, top, half_length;  ///< of the pad; half_length is that of the cavity, too
  double middle_y;                      ///< of pad, plate and mould
  double pour;                          ///< 1: poured with the end at positive y up, −1: with the other one
  double seat, plate, rim;              ///< z of the plate's top; its thickness; the mould's reach below its top
  double block_x;                       ///< half the block on the plate; 0: the plate is flat
  double stem_x, stem_height;           ///< half the stem's width, and its height, which is the voids', too
  double stem_low, stem_high;           ///< y of the ends of stem and block
  double void_x, void_width;            ///< a void's outer wall, and its width; 0: there are none
  double plate_x, plate_y;              ///< half the plate
  double rim_x, rim_y;                  ///< where the mould's rim begins: the plate with its clearance
  double mould_x, mould_y, mould_top;   ///< half the mould, and its height above the base
  double notch_inner, notch_outer, notch_roof;  ///< of the openings for the cores, from the middle out
  double recess_floor;                          ///< height of the recesses' floors, or of the stem
  double pocket_x, pocket_y, pocket_floor;  ///< half the LED strip's pocket, and the height of the strip's underside
  double strip_y;                           ///< half the LED strip

  CastingLayout(const HalfSection& s, const CastingOptions& o) {
    const double c = o.clearance;
    half_width = s.half_width_m();
    top = s.height_m();
    half_length = 0.5 * s.length_m();
    middle_y = 0.5e-3 * s.pad.cap_length;
    pour = has_cap(s) ? -1.0 : 1.0;
    const bool stair = s.pad.shoulder_height > 0.0;
    seat = stair ? -1e-3 * s.pad.shoulder_height : 0.0;
    plate = stair ? 1e-3 * (s.pad.carrier_height - s.pad.shoulder_height) : o.plate;
    rim = stair ? std::min(o.rim, stair_rim * plate) : o.rim;
    block_x = stair ? 1e-3 * s.pad.lip_end() : 0.0;
    stem_x = 0.5e-3 * s.design.w_s;
    stem_height = 1e-3 * s.design.h_s;
    stem_low = middle_y - half_length + 0.5 * c;
    stem_high = has_cap(s) ? 0.5e-3 * s.pad.length : -stem_low;
    void_width = 1e-3 * s.design.w_v;
    void_x = stem_x + void_width;
    plate_x = half_width + o.flange;
    plate_y = half_length + o.tab;
    rim_x = plate_x + c;
    rim_y = plate_y + c;
    mould_x = half_width + o.wall;
    mould_y = rim_y + (mould_x - rim_x);
    mould_top = top + o.wall;
    notch_inner = stem_x - c;
    notch_outer = void_x + c;
    notch_roof = stem_height + c;
    recess_floor = stem_height - (s.lies_on_stem() ? o.recess.depth : 0.0);
    strip_y = 0.5 * ((o.leds.count - 1) * o.leds.pitch + strip_margin);
    pocket_x = 0.5 * o.strip_width + c;
    pocket_y = strip_y + c;
    pocket_floor = recess_floor - o.strip_height;
  }

  bool is_stair() const { return block_x > 0.0; }
  bool has_recesses() const { return recess_floor < stem_height; }
  /// Of the slot that a strip below recesses lies in: where its circuit ends, and the recesses' floors are left.
  double slot_ceiling(const CastingOptions& o) const { return pocket_floor + o.circuit; }
  static bool has_cap(const HalfSection& s) { return s.pad.cap_length > 0.0; }

  static constexpr double strip_margin = 8.0e-3;  ///< of the strip beyond the outer LEDs' centres, both together
  static constexpr double duct_length = 3.0e-3;   ///< of the opening for the wires, along y
  static constexpr double hole_inset = 5.0e-3;    ///< of the mounting holes' centres from the pad's sides
  static constexpr double vent_inset = 2.5e-3;    ///< of the vents' centres from the pad's sides and the plate
  static constexpr double stair_rim = 0.75;       ///< of the plate's thickness: as the defaults on a flat carrier
};

/// Half outline (x, z) of the pad, from the plate at x > 0 up and over to the apex [m].
inline std::vector<std::array<double, 2>> pad_outline(const HalfSection& s) {
  std::vector<std::array<double, 2>> outline;
  for (std::size_t i = 0; i < s.x.size(); ++i)
    if (s.tag[i] == SectionTag::side || s.tag[i] == SectionTag::dome || s.tag[i] == SectionTag::mirror)
      outline.push_back({s.x[i], s.z[i] + 0.0});  // −0 is 0
  return outline;
}

namespace detail {

inline FingerOptions known_of_finger(const HalfSection& s, const CastingOptions& o) {
  return {.twin = s.twin, .pad = s.pad, .leds = o.leds, .recess = o.recess};
}

inline void require_lengths(const CastingOptions& o, const PadDimensions& pad) {
  namespace limits = casting_limits;
  require_in_range("clearance of printed parts", o.clearance * 1e3, limits::clearance_mm, "mm");
  require_in_range("plate thickness", o.plate * 1e3, limits::plate_mm, "mm");
  require_in_range("mould wall", o.wall * 1e3, limits::wall_mm, "mm");
  require_in_range("LED strip width", o.strip_width * 1e3, limits::strip_width_mm, "mm");
  require_in_range("LED strip height", o.strip_height * 1e3, limits::strip_height_mm, "mm");
  require_in_range("gate diameter", o.gate_diameter * 1e3, limits::gate_mm, "mm");
  require_in_range("vent diameter", o.vent_diameter * 1e3, limits::vent_mm, "mm");
  require_in_range("mounting hole diameter", o.hole_diameter * 1e3, 1.0, 5.0, "mm");
  require_in_range("plate beyond the pad's ends", o.tab * 1e3, o.hole_diameter * 1e3 + 3.0, 30.0, "mm");
  require_in_range("plate beyond the pad's sides", o.flange * 1e3, 1.0, (o.wall - o.clearance) * 1e3 - 2.0, "mm");
  require_in_range("mould rim", o.rim * 1e3, 1.0, o.plate * 1e3, "mm");
  if (pad.shoulder_height <= 0.0) return;
  // Below a core's opening the mould needs a wall, and a vent opens between block and side.
  require_in_range("height of the shoulders", pad.shoulder_height, limits::shoulder_height_mm, "mm");
  require_in_range("width of the shoulders", pad.shoulder_width,
      1e3 * (CastingLayout::vent_inset + 0.5 * o.vent_diameter), 100.0, "mm");
  require_in_range(
      "thickness of the carrier's plate", pad.carrier_height - pad.shoulder_height, limits::stair_plate_mm, "mm");
}

inline void require_room_for_strip(const CastingOptions& o, const HalfSection& s, const CastingLayout& at) {
  namespace limits = casting_limits;
  const double widest = 1e3 * (2.0 * at.stem_x - 2.0 * o.clearance - 2.0 * limits::beside_strip);
  if (o.strip_width * 1e3 > widest + 1e-9)
    throw InvalidArgument(message("LED strip width is ", exact(o.strip_width * 1e3), " mm, must be at most ", widest,
        " mm: 0.6 mm of wall on each side of it in a stem of ", 2.0 * at.stem_x * 1e3, " mm"));
  const double half_stem = 0.5e-3 * s.pad.length;
  if (at.pocket_y > half_stem - limits::beyond_strip)
    throw InvalidArgument(message("LED strip is ", 2e3 * at.strip_y, " mm long, must be at most ",
        2e3 * (half_stem - o.clearance - limits::beyond_strip), " mm"));
  if (!at.has_recesses()) return;
  const double thickest = o.strip_height * 1e3 - limits::over_circuit_mm;
  require_in_range("circuit of the LED strip", o.circuit * 1e3, 0.05, thickest + 1e-9, "mm");
  require_in_range("LED width", o.leds.width_x * 1e3, 0.1, o.strip_width * 1e3, "mm");
  require_in_range("length of the LEDs' recesses", o.recess.length_y * 1e3,
      1e3 * (o.leds.length_y + 2.0 * o.clearance + CastingOptions::thinnest_wall),
      2e3 * (half_stem - led_places(o.leds).back() - limits::beyond_strip), "mm");
}

}  // namespace detail

inline void validate(const CastingOptions& o, const HalfSection& s) {
  namespace limits = casting_limits;
  if (!has_stem(s.twin)) throw InvalidArgument("a twin whose stem is of silicone cannot be cast on a carrier");
  validate(detail::known_of_finger(s, o));
  if (o.leds.place != FingerOptions::Leds::Place::top)
    throw InvalidArgument("LEDs are on the stem's sides, must be on its top: one strip holds all of them");
  require_in_range("number of LEDs on the strip", o.leds.count, 1, 1000, "");
  detail::require_lengths(o, s.pad);
  const CastingLayout at(s, o);
  require_in_range("pad width", 2e3 * at.half_width, 20.0, 200.0, "mm");
  const double lowest = at.has_recesses() ? 1e3 * o.recess.depth + limits::over_circuit_mm : o.strip_height * 1e3 + 0.5;
  require_in_range("stem height", at.stem_height * 1e3, lowest, 1e3 * at.top - limits::above_stem_mm, "mm");
  detail::require_room_for_strip(o, s, at);
  if (at.notch_outer > at.half_width - 1e-3 * limits::beside_void_mm)
    throw InvalidArgument(message("the pad is ", 1e3 * (at.half_width - at.notch_outer + o.clearance),
        " mm thick beside its voids, must be at least ", limits::beside_void_mm + 1e3 * o.clearance, " mm"));
  if (at.is_stair() && at.void_x >= at.block_x)
    throw InvalidArgument(message("stem and voids are ", 2e3 * at.void_x,
        " mm wide, must be narrower than the block of ", 2e3 * at.block_x, " mm below them"));
}

}  // namespace lumo

#endif

// ---- lumo/geometry/predicates.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_PREDICATES_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_PREDICATES_HPP

// Exact signs of orientation determinants. A rounded value with an error bound decides nearly always; what is too close
// to call is computed without error as an unevaluated sum of doubles of falling size. Own code: exact predicates of
// libraries come with CGAL or as C that sets the processor's rounding. Source: Shewchuk 1997, Adaptive
// precision floating-point arithmetic and fast robust geometric predicates; his error bounds, his expansions, without
// his intermediate stages. Needs IEEE doubles rounded to nearest (no -ffast-math); exact as long as nothing overflows
// or underflows (lengths 1e-60 … 1e60).

namespace lumo {

using Point2 = std::array<double, 2>;

/// Sign of (b − a) × (c − a): +1 if a, b, c turn left, −1 right, 0 if they are exactly on a line.
inline int orient2d(const Point2& a, const Point2& b, const Point2& c);

/// Sign of (b − a) × (c − a) · (d − a): +1 if d is on the side from which a, b, c run counter-clockwise, 0 if exactly
/// in the plane.
inline int orient3d(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d);

namespace detail {

inline constexpr double half_ulp = 0.5 * std::numeric_limits<double>::epsilon();

/// A sum of doubles that do not overlap, smallest first, without zeros.
struct Expansion {
  std::size_t size = 0;
  std::array<double, 192> parts;  // as many as a 3 × 3 determinant of differences can need

  void push(double part) {
    if (part != 0.0) parts[size++] = part;
  }
  int sign() const { return size == 0 ? 0 : parts[size - 1] > 0.0 ? 1 : -1; }
};

struct SumAndError {
  double sum;
  double error;
};

inline SumAndError two_sum(double a, double b) {
  const double sum = a + b;
  const double b_part = sum - a;
  const double a_part = sum - b_part;
  return {sum, (a - a_part) + (b - b_part)};
}

/// a − b without error.
inline Expansion exact_difference(double a, double b) {
  const auto [sum, error] = two_sum(a, -b);
  Expansion result;
  result.push(error);
  result.push(sum);
  return result;
}

/// Merges by size, then carries the rounding errors along.
inline Expansion operator+(const Expansion& e, const Expansion& f) {
  Expansion result;
  double carry = 0.0;
  for (std::size_t i = 0, j = 0; i < e.size || j < f.size;) {
    const bool from_e = j == f.size || (i < e.size && std::abs(e.parts[i]) < std::abs(f.parts[j]));
    const auto [sum, error] = two_sum(carry, from_e ? e.parts[i++] : f.parts[j++]);
    result.push(error);
    carry = sum;
  }
  result.push(carry);
  return result;
}

inline Expansion operator*(const Expansion& e, double factor) {
  Expansion result;
  double carry = 0.0;
  for (std::size_t i = 0; i < e.size; ++i) {
    const double product = e.parts[i] * factor;
    const double tail = std::fma(e.parts[i], factor, -product);
    const auto low = two_sum(carry, tail);
    const auto high = two_sum(product, low.sum);
    result.push(low.error);
    result.push(high.error);
    carry = high.sum;
  }
  result.push(carry);
  return result;
}

inline Expansion operator*(const Expansion& e, const Expansion& f) {  // f is a difference: at most two parts
  Expansion result;
  for (std::size_t i = 0; i < f.size; ++i) result = result + e * f.parts[i];
  return result;
}

/// a d − b c of differences, without error.
inline Expansion exact_minor(const Expansion& a, const Expansion& b, const Expansion& c, const Expansion& d) {
  return a * d + (b * c) * -1.0;
}

}  // namespace detail

/// The sign if rounding errors cannot change it, else 0.
inline int sure_orient2d(const Point2& a, const Point2& b, const Point2& c) {
  const double left = (b[0] - a[0]) * (c[1] - a[1]);
  const double right = (b[1] - a[1]) * (c[0] - a[0]);
  const double bound = 4.0 * detail::half_ulp * (std::abs(left) + std::abs(right));
  return left - right > bound ? 1 : left - right < -bound ? -1 : 0;
}

/// The sign if rounding errors cannot change it, else 0.
inline int sure_orient3d(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) {
  const Vec3d u = b - a;
  const Vec3d v = c - a;
  const Vec3d w = d - a;
  double value = 0.0;
  double size = 0.0;
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    const int k = (i + 2) % 3;
    const double left = u[j] * v[k];
    const double right = u[k] * v[j];
    value += w[i] * (left - right);
    size += std::abs(w[i]) * (std::abs(left) + std::abs(right));
  }
  const double bound = 8.0 * detail::half_ulp * size;
  return value > bound ? 1 : value < -bound ? -1 : 0;
}

inline int orient2d(const Point2& a, const Point2& b, const Point2& c) {
  if (const int sure = sure_orient2d(a, b, c); sure != 0) return sure;
  return detail::exact_minor(detail::exact_difference(b[0], a[0]), detail::exact_difference(b[1], a[1]),
      detail::exact_difference(c[0], a[0]), detail::exact_difference(c[1], a[1]))
      .sign();
}

inline int orient3d(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) {
  if (const int sure = sure_orient3d(a, b, c, d); sure != 0) return sure;
  std::array<std::array<detail::Expansion, 3>, 3> rows;
  for (int k = 0; k < 3; ++k) {
    rows[0][static_cast<std::size_t>(k)] = detail::exact_difference(b[k], a[k]);
    rows[1][static_cast<std::size_t>(k)] = detail::exact_difference(c[k], a[k]);
    rows[2][static_cast<std::size_t>(k)] = detail::exact_difference(d[k], a[k]);
  }
  detail::Expansion sum;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t j = (i + 1) % 3;
    const std::size_t k = (i + 2) % 3;
    sum = sum + detail::exact_minor(rows[0][j], rows[0][k], rows[1][j], rows[1][k]) * rows[2][i];
  }
  return sum.sign();
}

}  // namespace lumo

#endif

// ---- lumo/geometry/facet_triangles.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_FACET_TRIANGLES_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_FACET_TRIANGLES_HPP

namespace lumo {

/// A triangle of a surface, by vertex numbers, and the facet that it is part of.
struct SurfaceTriangle {
  std::array<int, 3> corners;
  int facet;
};

/// Twice the area vector of a polygon (Newell's sum), taken about its first corner to keep digits.
inline Vec3d polygon_normal(const std::vector<Vec3d>& vertices, const std::vector<int>& loop) {
  const Vec3d& origin = vertices[static_cast<std::size_t>(loop[0])];
  Vec3d sum = Vec3d::Zero();
  for (std::size_t i = 1; i + 1 < loop.size(); ++i)
    sum += (vertices[static_cast<std::size_t>(loop[i])] - origin)
               .cross(vertices[static_cast<std::size_t>(loop[i + 1])] - origin);
  return sum;
}

/// Drops one coordinate and keeps the sense of rotation of what faces along `normal`. Exact: nothing is computed.
struct Projection {
  std::size_t first = 0;
  std::size_t second = 1;

  explicit Projection(const Vec3d& normal) {
    int axis = 0;
    normal.cwiseAbs().maxCoeff(&axis);
    first = static_cast<std::size_t>((axis + 1) % 3);
    second = static_cast<std::size_t>((axis + 2) % 3);
    if (normal[axis] < 0.0) std::swap(first, second);
  }
  Point2 operator()(const Vec3d& p) const {
    return {p[static_cast<Eigen::Index>(first)], p[static_cast<Eigen::Index>(second)]};
  }
};

/// Whether p, known to be on the line through a and b, is between them or at an end.
inline bool between_ends(const Point2& a, const Point2& b, const Point2& p) {
  const std::size_t axis = std::abs(b[0] - a[0]) >= std::abs(b[1] - a[1]) ? 0 : 1;
  return std::min(a[axis], b[axis]) <= p[axis] && p[axis] <= std::max(a[axis], b[axis]);
}

/// Whether two closed line segments of the plane have a point in common. Exact.
inline bool segments_meet(const Point2& a, const Point2& b, const Point2& c, const Point2& d) {
  const int ac = orient2d(a, b, c);
  const int ad = orient2d(a, b, d);
  const int ca = orient2d(c, d, a);
  const int cb = orient2d(c, d, b);
  if (ac * ad < 0 && ca * cb < 0) return true;
  return (ac == 0 && between_ends(a, b, c)) || (ad == 0 && between_ends(a, b, d)) ||
         (ca == 0 && between_ends(c, d, a)) || (cb == 0 && between_ends(c, d, b));
}

/// Whether the outline of a polygon meets itself anywhere but at its corners, or turns back on itself. Quadratic in the
/// number of corners.
inline bool outline_crosses(const std::vector<Point2>& points) {
  const std::size_t n = points.size();
  for (std::size_t i = 0; i < n; ++i) {
    const Point2& a = points[i];
    const Point2& b = points[(i + 1) % n];
    const Point2& c = points[(i + 2) % n];
    const bool back = (a[0] - b[0]) * (c[0] - b[0]) + (a[1] - b[1]) * (c[1] - b[1]) > 0.0;
    if (back && orient2d(a, b, c) == 0) return true;
    for (std::size_t j = i + 2; j < n; ++j)
      if ((j + 1) % n != i && segments_meet(a, b, points[j], points[(j + 1) % n])) return true;
  }
  return false;
}

/// Signed height of p over the line from a to b, positive on its left.
inline double height_over(const Point2& a, const Point2& b, const Point2& p) {
  const double x = b[0] - a[0];
  const double y = b[1] - a[1];
  return (x * (p[1] - a[1]) - y * (p[0] - a[0])) / std::hypot(x, y);
}

/// Cuts a flat, simple, perhaps concave polygon with corners on straight edges into triangles that use all corners and
/// no others. Exact, by cutting off ears; first choice are ears to which no other corner comes closer than `slack`.
/// nullopt if the outline is not simple or not counter-clockwise about `normal`.
inline std::optional<std::vector<SurfaceTriangle>> facet_triangles(
    const std::vector<Vec3d>& vertices, const std::vector<int>& loop, const Vec3d& normal, int facet, double slack) {
  std::vector<SurfaceTriangle> triangles;
  if (loop.size() == 3) {
    triangles.push_back({{loop[0], loop[1], loop[2]}, facet});
    return triangles;
  }
  const Projection project(normal);
  std::vector<Point2> points;
  for (int vertex : loop) points.push_back(project(vertices[static_cast<std::size_t>(vertex)]));
  if (outline_crosses(points)) return std::nullopt;

  std::vector<std::size_t> left(loop.size());
  for (std::size_t i = 0; i < left.size(); ++i) left[i] = i;
  const auto is_ear = [&](std::size_t at, bool careful) {
    const std::size_t before = left[(at + left.size() - 1) % left.size()];
    const std::size_t here = left[at];
    const std::size_t after = left[(at + 1) % left.size()];
    const Point2& a = points[before];
    const Point2& b = points[here];
    const Point2& c = points[after];
    if (orient2d(a, b, c) <= 0 || (careful && height_over(a, c, b) > -slack)) return false;
    return std::none_of(left.begin(), left.end(), [&](std::size_t other) {
      if (other == before || other == here || other == after) return false;
      const Point2& p = points[other];
      if (careful)
        return height_over(a, b, p) > -slack && height_over(b, c, p) > -slack && height_over(c, a, p) > -slack;
      return orient2d(a, b, p) >= 0 && orient2d(b, c, p) >= 0 && orient2d(c, a, p) >= 0;
    });
  };
  for (std::size_t at = 0; left.size() > 3;) {
    std::size_t tried = 0;
    while (tried < 2 * left.size() && !is_ear(at % left.size(), tried < left.size())) {
      ++at;
      ++tried;
    }
    if (tried == 2 * left.size()) return std::nullopt;
    at %= left.size();
    triangles.push_back(
        {{loop[left[(at + left.size() - 1) % left.size()]], loop[left[at]], loop[left[(at + 1) % left.size()]]},
            facet});
    left.erase(left.begin() + static_cast<std::ptrdiff_t>(at));
    ++at;  // the next corner but one: fewer slender triangles than a fan
  }
  if (orient2d(points[left[0]], points[left[1]], points[left[2]]) <= 0) return std::nullopt;
  triangles.push_back({{loop[left[0]], loop[left[1]], loop[left[2]]}, facet});
  return triangles;
}

}  // namespace lumo

#endif

// ---- lumo/geometry/polygon_triangles.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_POLYGON_TRIANGLES_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_POLYGON_TRIANGLES_HPP

namespace lumo {

/// Cuts a flat polygon with holes into triangles that use all of its corners and no others.
/// Each hole is joined to the outline by a bridge to a corner that it sees (Held 2001, section 4), then ears are cut
/// off, the best shaped first. All decisions are exact. Corners on straight edges are allowed.
class PolygonTriangles {
 public:
  using Triangle = std::array<int, 3>;
  using Loop = std::vector<int>;

  PolygonTriangles(const std::vector<Vec3d>& vertices, const Vec3d& normal) {
    const Projection project(normal);
    for (const Vec3d& v : vertices) points_.push_back(project(v));
  }

  /// By vertex numbers; the outline counter-clockwise about the normal, the holes clockwise. nullopt if outline and
  /// holes cross or touch.
  std::optional<std::vector<Triangle>> cut(std::vector<int> outline, std::vector<std::vector<int>> holes) const;

 private:
  const Point2& at(int vertex) const { return points_[std::size_t(vertex)]; }
  int turn(int a, int b, int c) const { return orient2d(at(a), at(b), at(c)); }
  bool crosses(int a, int b, const std::vector<int>& loop) const;
  bool opens_to(const std::vector<int>& loop, std::size_t corner, int to) const;
  bool bridge(Loop& loop, const std::vector<int>& hole, const std::vector<std::vector<int>>& others) const;
  double shape_of_ear(const std::vector<int>& loop, std::size_t corner) const;

  std::vector<Point2> points_;
};

/// Whether the segment a b meets an edge of the loop that does not end in a or b.
inline bool PolygonTriangles::crosses(int a, int b, const std::vector<int>& loop) const {
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const int p = loop[i], q = loop[(i + 1) % loop.size()];
    const bool shared = p == a || p == b || q == a || q == b;
    if (!shared && segments_meet(at(a), at(b), at(p), at(q))) return true;
  }
  return false;
}

/// Whether `to` is seen from the inside of the loop's corner: bridges make a vertex a corner more than once.
inline bool PolygonTriangles::opens_to(const std::vector<int>& loop, std::size_t corner, int to) const {
  const int before = loop[(corner + loop.size() - 1) % loop.size()], here = loop[corner],
            after = loop[(corner + 1) % loop.size()];
  const bool left_of_in = turn(before, here, to) > 0, left_of_out = turn(here, after, to) > 0;
  return turn(before, here, after) > 0 ? left_of_in && left_of_out : left_of_in || left_of_out;
}

inline bool PolygonTriangles::bridge(
    Loop& loop, const std::vector<int>& hole, const std::vector<std::vector<int>>& others) const {
  const auto start = std::size_t(
      std::max_element(hole.begin(), hole.end(), [&](int p, int q) { return at(p) < at(q); }) - hole.begin());
  const int from = hole[start];
  struct Candidate {
    double distance2;
    std::size_t corner;
    auto operator<=>(const Candidate&) const = default;
  };
  std::vector<Candidate> nearest;
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const double dx = at(loop[i])[0] - at(from)[0], dy = at(loop[i])[1] - at(from)[1];
    nearest.push_back({dx * dx + dy * dy, i});
  }
  std::sort(nearest.begin(), nearest.end());
  for (const auto& candidate : nearest) {
    const std::size_t corner = candidate.corner;
    const int to = loop[corner];
    if (!opens_to(loop, corner, from) || !opens_to(hole, start, to) || crosses(from, to, loop) ||
        crosses(from, to, hole))
      continue;
    if (std::any_of(
            others.begin(), others.end(), [&](const std::vector<int>& other) { return crosses(from, to, other); }))
      continue;
    std::vector<int> detour{to};
    for (std::size_t k = 0; k <= hole.size(); ++k) detour.push_back(hole[(start + k) % hole.size()]);
    loop.insert(loop.begin() + std::ptrdiff_t(corner), detour.begin(), detour.end());
    return true;
  }
  return false;
}

/// Sine of the smallest angle or so, at most one; 0 where the corner is no ear.
inline double PolygonTriangles::shape_of_ear(const std::vector<int>& loop, std::size_t corner) const {
  const int a = loop[(corner + loop.size() - 1) % loop.size()], b = loop[corner], c = loop[(corner + 1) % loop.size()];
  if (a == c || turn(a, b, c) <= 0) return 0.0;
  for (const int p : loop)
    if (p != a && p != b && p != c && turn(a, b, p) >= 0 && turn(b, c, p) >= 0 && turn(c, a, p) >= 0) return 0.0;
  const auto squared = [&](int p, int q) {
    return (at(q)[0] - at(p)[0]) * (at(q)[0] - at(p)[0]) + (at(q)[1] - at(p)[1]) * (at(q)[1] - at(p)[1]);
  };
  const double twice_area =
      (at(b)[0] - at(a)[0]) * (at(c)[1] - at(a)[1]) - (at(b)[1] - at(a)[1]) * (at(c)[0] - at(a)[0]);
  return twice_area / std::max({squared(a, b), squared(b, c), squared(c, a)});
}

inline auto PolygonTriangles::cut(std::vector<int> loop, std::vector<std::vector<int>> holes) const
    -> std::optional<std::vector<Triangle>> {
  const auto farthest = [&](const std::vector<int>& hole) {
    return at(*std::max_element(hole.begin(), hole.end(), [&](int p, int q) { return at(p) < at(q); }));
  };
  std::sort(holes.begin(), holes.end(), [&](const auto& a, const auto& b) { return farthest(a) < farthest(b); });
  while (!holes.empty()) {
    const std::vector<int> hole = std::move(holes.back());
    holes.pop_back();
    if (!bridge(loop, hole, holes)) return std::nullopt;
  }
  std::vector<Triangle> triangles;
  std::vector<double> shape;  // of the ear at each corner
  for (std::size_t i = 0; i < loop.size(); ++i) shape.push_back(shape_of_ear(loop, i));
  while (loop.size() > 3) {
    const auto ear = std::size_t(std::max_element(shape.begin(), shape.end()) - shape.begin());
    if (!(shape[ear] > 0.0)) return std::nullopt;
    const std::size_t n = loop.size();
    triangles.push_back({loop[(ear + n - 1) % n], loop[ear], loop[(ear + 1) % n]});
    loop.erase(loop.begin() + std::ptrdiff_t(ear));
    shape.erase(shape.begin() + std::ptrdiff_t(ear));
    // Only its neighbours change, for what was free of corners stays free; what was not may have become so.
    for (std::size_t i = 0; i < loop.size(); ++i)
      if (shape[i] == 0.0 || i == ear % loop.size() || (i + 1) % loop.size() == ear % loop.size())
        shape[i] = shape_of_ear(loop, i);
  }
  if (turn(loop[0], loop[1], loop[2]) <= 0) return std::nullopt;
  triangles.push_back({loop[0], loop[1], loop[2]});
  return triangles;
}

}  // namespace lumo

#endif

// ---- lumo/geometry/self_intersection.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_SELF_INTERSECTION_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_SELF_INTERSECTION_HPP

namespace lumo {

/// Two triangles that meet elsewhere than in corners that they share, or come closer than `gap` without sharing any.
/// First what is certain in rounded numbers, then exact predicates; a sweep along the longest axis finds the
/// candidates.
class SelfIntersection {
 public:
  SelfIntersection(const std::vector<Vec3d>& vertices, const std::vector<SurfaceTriangle>& triangles, double gap)
      : vertices_(vertices), triangles_(triangles), gap_(gap) {}

  /// The first offending pair of triangle numbers, if any. Triangles of one facet are not compared: cutting it up made
  /// them disjoint.
  std::optional<std::pair<int, int>> find() const;

 private:
  using Corners = std::array<int, 3>;

  const Vec3d& at(int vertex) const { return vertices_[static_cast<std::size_t>(vertex)]; }
  static bool has(const Corners& t, int vertex) { return t[0] == vertex || t[1] == vertex || t[2] == vertex; }
  Vec3d normal(const Corners& t) const { return (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])); }

  bool clash(const Corners& a, const Corners& b) const;
  bool surely_apart(const Corners& a, const Corners& b) const;
  bool surely_beside(const Corners& a, const Corners& b, const Projection& project) const;
  bool folded(const Corners& a, const Corners& b) const;
  bool meets(int p, int q, const Corners& t) const;
  bool close(const Corners& a, const Corners& b) const;

  const std::vector<Vec3d>& vertices_;
  const std::vector<SurfaceTriangle>& triangles_;
  double gap_;
};

/// Squared distance between two line segments. Source: Ericson 2005, section 5.1.9.
inline double segment_distance2(const Vec3d& p1, const Vec3d& q1, const Vec3d& p2, const Vec3d& q2) {
  const Vec3d d1 = q1 - p1;
  const Vec3d d2 = q2 - p2;
  const Vec3d r = p1 - p2;
  const double a = d1.squaredNorm();
  const double e = d2.squaredNorm();
  const double b = d1.dot(d2);
  const double c = d1.dot(r);
  const double f = d2.dot(r);
  const double det = a * e - b * b;
  double s = det > 0.0 ? std::clamp((b * f - c * e) / det, 0.0, 1.0) : 0.0;
  const double t = std::clamp((b * s + f) / e, 0.0, 1.0);
  s = std::clamp((b * t - c) / a, 0.0, 1.0);
  return (r + s * d1 - t * d2).squaredNorm();
}

/// All vertices of b strictly on one side of the plane of a, but those that are also a's; or the same with a and b
/// exchanged.
inline bool SelfIntersection::surely_apart(const Corners& a, const Corners& b) const {
  int side = 0;
  for (int vertex : b) {
    if (has(a, vertex)) continue;
    const int sign = sure_orient3d(at(a[0]), at(a[1]), at(a[2]), at(vertex));
    if (sign == 0 || sign == -side) return false;
    side = sign;
  }
  return true;
}

/// Seen along one axis, an edge of a has a on one side and b, but shared corners, strictly on the other. What is
/// disjoint in a projection is disjoint in space.
inline bool SelfIntersection::surely_beside(const Corners& a, const Corners& b, const Projection& project) const {
  for (std::size_t i = 0; i < 3; ++i) {
    const int p = a[i];
    const int q = a[(i + 1) % 3];
    const Point2 from = project(at(p));
    const Point2 to = project(at(q));
    const int side = sure_orient2d(from, to, project(at(a[(i + 2) % 3])));
    if (side == 0) continue;
    const auto beyond = [&](int vertex) {
      return vertex == p || vertex == q || sure_orient2d(from, to, project(at(vertex))) == -side;
    };
    if (std::all_of(b.begin(), b.end(), beyond)) return true;
  }
  return false;
}

/// Neighbours across an edge that lie on each other, or nearly (dihedral angle below 1e-6).
inline bool SelfIntersection::folded(const Corners& a, const Corners& b) const {
  int apex_a = 0, apex_b = 0;
  std::array<int, 2> edge{};
  std::size_t shared = 0;
  for (int vertex : a) {
    if (has(b, vertex)) edge[shared++] = vertex;
    else apex_a = vertex;
  }
  for (int vertex : b)
    if (!has(a, vertex)) apex_b = vertex;
  const Vec3d along = at(edge[1]) - at(edge[0]);
  const Vec3d u = along.cross(at(apex_a) - at(edge[0]));
  const Vec3d v = along.cross(at(apex_b) - at(edge[0]));
  return u.dot(v) > 0.0 && u.cross(v).norm() < 1e-6 * u.norm() * v.norm();
}

/// Whether the closed segment p q meets the closed triangle t. Exact.
inline bool SelfIntersection::meets(int p, int q, const Corners& t) const {
  const int side_p = orient3d(at(t[0]), at(t[1]), at(t[2]), at(p));
  const int side_q = orient3d(at(t[0]), at(t[1]), at(t[2]), at(q));
  if (side_p * side_q > 0) return false;
  if (side_p != 0 || side_q != 0) {
    int low = 0, high = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      const int sign = orient3d(at(p), at(q), at(t[i]), at(t[(i + 1) % 3]));
      low = std::min(low, sign);
      high = std::max(high, sign);
    }
    return low == 0 || high == 0;
  }
  const Projection project(normal(t));
  const std::array<Point2, 3> corners{project(at(t[0])), project(at(t[1])), project(at(t[2]))};
  const Point2 from = project(at(p));
  const Point2 to = project(at(q));
  bool inside = true;
  for (std::size_t i = 0; i < 3; ++i) {
    if (segments_meet(from, to, corners[i], corners[(i + 1) % 3])) return true;
    inside = inside && orient2d(corners[i], corners[(i + 1) % 3], from) > 0;
  }
  return inside;
}

inline bool SelfIntersection::close(const Corners& a, const Corners& b) const {
  for (const auto& [t, other] : {std::pair{&a, &b}, std::pair{&b, &a}}) {
    const Vec3d n = normal(*t).normalized();
    int above = 0, below = 0;
    for (int vertex : *other) {
      const double height = n.dot(at(vertex) - at((*t)[0]));
      above += height > gap_;
      below += height < -gap_;
      if (std::abs(height) > gap_) continue;
      bool inside = true;  // of the prism over the triangle
      for (std::size_t i = 0; i < 3; ++i) {
        const Vec3d& corner = at((*t)[i]);
        inside = inside && n.dot((at((*t)[(i + 1) % 3]) - corner).cross(at(vertex) - corner)) >= 0.0;
      }
      if (inside) return true;
    }
    if (above == 3 || below == 3) return false;
  }
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      if (segment_distance2(at(a[i]), at(a[(i + 1) % 3]), at(b[j]), at(b[(j + 1) % 3])) < gap_ * gap_) return true;
  return false;
}

inline bool SelfIntersection::clash(const Corners& a, const Corners& b) const {
  const auto shared = std::count_if(a.begin(), a.end(), [&](int vertex) { return has(b, vertex); });
  if (shared == 3) return true;
  if (shared == 2) return folded(a, b);
  if (shared == 0 && close(a, b)) return true;
  if (surely_apart(a, b) || surely_apart(b, a)) return false;
  for (int axis = 0; axis < 3; ++axis) {
    const Projection project(Vec3d::Unit(axis));
    if (surely_beside(a, b, project) || surely_beside(b, a, project)) return false;
  }
  // One shared corner: whatever else they share reaches an edge opposite to it.
  for (const auto& [t, other] : {std::pair{&a, &b}, std::pair{&b, &a}})
    for (std::size_t i = 0; i < 3; ++i) {
      const int p = (*t)[i];
      const int q = (*t)[(i + 1) % 3];
      if (has(*other, p) || has(*other, q)) continue;
      if (meets(p, q, *other)) return true;
    }
  return false;
}

inline std::optional<std::pair<int, int>> SelfIntersection::find() const {
  struct TriangleBox {
    Vec3d low, high;
    int triangle;
  };
  std::vector<TriangleBox> boxes;
  const Vec3d margin = Vec3d::Constant(0.5 * gap_);
  Vec3d low = Vec3d::Constant(HUGE_VAL), high = Vec3d::Constant(-HUGE_VAL);
  for (std::size_t i = 0; i < triangles_.size(); ++i) {
    const Corners& t = triangles_[i].corners;
    const Vec3d &a = at(t[0]), &b = at(t[1]), &c = at(t[2]);
    boxes.push_back({elementwise_min(elementwise_min(a, b), c) - margin,
        elementwise_max(elementwise_max(a, b), c) + margin, static_cast<int>(i)});
    low = elementwise_min(low, boxes.back().low);
    high = elementwise_max(high, boxes.back().high);
  }
  int axis = 0;
  (high - low).maxCoeff(&axis);
  std::sort(boxes.begin(), boxes.end(), [axis](const TriangleBox& a, const TriangleBox& b) {
    return a.low[axis] != b.low[axis] ? a.low[axis] < b.low[axis] : a.triangle < b.triangle;
  });
  for (std::size_t i = 0; i < boxes.size(); ++i)
    for (std::size_t j = i + 1; j < boxes.size() && boxes[j].low[axis] <= boxes[i].high[axis]; ++j) {
      if ((boxes[i].low.array() > boxes[j].high.array()).any() || (boxes[j].low.array() > boxes[i].high.array()).any())
        continue;
      const SurfaceTriangle& a = triangles_[static_cast<std::size_t>(boxes[i].triangle)];
      const SurfaceTriangle& b = triangles_[static_cast<std::size_t>(boxes[j].triangle)];
      if (a.facet != b.facet && clash(a.corners, b.corners)) return std::pair{boxes[i].triangle, boxes[j].triangle};
    }
  return std::nullopt;
}

}  // namespace lumo

#endif

// ---- lumo/geometry/shells.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_SHELLS_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_SHELLS_HPP

namespace lumo {

/// A connected part of a surface. It faces outwards (volume > 0, a solid) or inwards (a cavity).
struct Shell {
  std::vector<int> triangles;
  double area = 0.0;
  double volume = 0.0;
};

/// Union–find with path halving.
class Groups {
 public:
  explicit Groups(std::size_t count) : parent_(count) { std::iota(parent_.begin(), parent_.end(), 0); }
  int find(int i) {
    while (at(i) != i) i = at(i) = at(at(i));
    return i;
  }
  void join(int i, int j) { at(find(i)) = find(j); }

 private:
  int& at(int i) { return parent_[static_cast<std::size_t>(i)]; }
  std::vector<int> parent_;
};

/// Every edge has two facets that run along it in opposite directions, and the facets around each vertex form one fan.
/// Throws MeshError (open, not_manifold).
inline void check_edges(const ClosedSurface& input) {
  using Reason = MeshError::Reason;
  struct Side {
    int low, high;
    bool up;  // runs from the lower vertex number to the higher
    int facet;
    int from, to;  // corners, numbered through all facets
  };
  std::vector<Side> sides;
  std::vector<int> vertex_of;
  for (std::size_t f = 0; f < input.facets.size(); ++f) {
    const std::vector<int>& loop = input.facets[f].loop;
    const int base = static_cast<int>(vertex_of.size());
    const int n = static_cast<int>(loop.size());
    for (int i = 0; i < n; ++i) {
      const int a = loop[static_cast<std::size_t>(i)];
      const int b = loop[static_cast<std::size_t>((i + 1) % n)];
      sides.push_back({std::min(a, b), std::max(a, b), a < b, static_cast<int>(f), base + i, base + (i + 1) % n});
      vertex_of.push_back(a);
    }
  }
  std::sort(sides.begin(), sides.end(),
      [](const Side& a, const Side& b) { return std::tie(a.low, a.high, a.from) < std::tie(b.low, b.high, b.from); });
  Groups fans(vertex_of.size());
  for (std::size_t i = 0; i < sides.size();) {
    std::size_t end = i + 1;
    while (end < sides.size() && sides[end].low == sides[i].low && sides[end].high == sides[i].high) ++end;
    const auto place = [&](int vertex) {
      const Vec3d& p = input.vertices[static_cast<std::size_t>(vertex)];
      return message(vertex, " at (", p.x(), ", ", p.y(), ", ", p.z(), ")");
    };
    const auto edge = message(
        "the edge from vertex ", place(sides[i].low), " to ", place(sides[i].high), " of facet ", sides[i].facet);
    if (end - i == 1) throw MeshError(Reason::open, message("surface: ", edge, " has 1 facet, must have 2"));
    if (end - i > 2)
      throw MeshError(Reason::not_manifold, message("surface: ", edge, " has ", end - i, " facets, must have 2"));
    const Side& a = sides[i];
    const Side& b = sides[i + 1];
    if (a.up == b.up)
      throw MeshError(
          Reason::not_manifold, message("surface: ", edge, " has a facet of opposite orientation, ", b.facet));
    fans.join(a.from, b.to);
    fans.join(a.to, b.from);
    i = end;
  }
  std::vector<int> fan_of(input.vertices.size(), -1);
  for (std::size_t corner = 0; corner < vertex_of.size(); ++corner) {
    int& known = fan_of[static_cast<std::size_t>(vertex_of[corner])];
    const int fan = fans.find(static_cast<int>(corner));
    if (known >= 0 && known != fan)
      throw MeshError(Reason::not_manifold,
          message("surface: vertex ", vertex_of[corner], " joins more than 1 fan of facets, must be 1"));
    known = fan;
  }
}

/// The connected parts of a surface, with areas and enclosed volumes.
inline std::vector<Shell> find_shells(const ClosedSurface& input, const std::vector<SurfaceTriangle>& triangles) {
  Groups groups(input.vertices.size());
  for (const SurfaceTriangle& t : triangles) {
    groups.join(t.corners[0], t.corners[1]);
    groups.join(t.corners[0], t.corners[2]);
  }
  std::vector<int> number(input.vertices.size(), -1);
  std::vector<Shell> shells;
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    int& shell = number[static_cast<std::size_t>(groups.find(triangles[i].corners[0]))];
    if (shell < 0) {
      shell = static_cast<int>(shells.size());
      shells.emplace_back();
    }
    shells[static_cast<std::size_t>(shell)].triangles.push_back(static_cast<int>(i));
  }
  const auto at = [&](int vertex) -> const Vec3d& { return input.vertices[static_cast<std::size_t>(vertex)]; };
  for (Shell& shell : shells) {
    const Vec3d origin = at(triangles[static_cast<std::size_t>(shell.triangles[0])].corners[0]);
    for (int i : shell.triangles) {
      const auto& [a, b, c] = triangles[static_cast<std::size_t>(i)].corners;
      const Vec3d doubled = (at(b) - at(a)).cross(at(c) - at(a));
      shell.area += 0.5 * doubled.norm();
      shell.volume += doubled.dot(at(a) - origin) / 6.0;
    }
  }
  return shells;
}

/// Solid angle of the triangle abc seen from `point`, positive from behind. Source: van Oosterom and Strackee 1983.
inline double solid_angle(const Vec3d& from_a, const Vec3d& from_b, const Vec3d& from_c, const Vec3d& point) {
  const Vec3d a = from_a - point, b = from_b - point, c = from_c - point;
  const double la = a.norm(), lb = b.norm(), lc = c.norm();
  return 2.0 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
}

/// How often a shell winds around a point: 1 inside, 0 outside.
inline double winding(const std::vector<Vec3d>& vertices, const std::vector<SurfaceTriangle>& triangles,
    const Shell& shell, const Vec3d& point) {
  double angle = 0.0;
  for (int i : shell.triangles) {
    const auto& corners = triangles[static_cast<std::size_t>(i)].corners;
    angle += solid_angle(vertices[static_cast<std::size_t>(corners[0])], vertices[static_cast<std::size_t>(corners[1])],
        vertices[static_cast<std::size_t>(corners[2])], point);
  }
  return angle / (4.0 * std::numbers::pi);
}

/// Solids lie outside each other, cavities in a solid, interior points in the material.
/// Throws MeshError (not_manifold for shells, bad_index for points).
inline void check_inside(
    const ClosedSurface& input, const std::vector<SurfaceTriangle>& triangles, const std::vector<Shell>& shells) {
  const auto total = [&](const Vec3d& point, const Shell* without) {
    double sum = 0.0;
    for (const Shell& shell : shells)
      if (&shell != without) sum += winding(input.vertices, triangles, shell, point);
    return sum;
  };
  for (std::size_t i = 0; shells.size() > 1 && i < shells.size(); ++i) {
    const SurfaceTriangle& first = triangles[static_cast<std::size_t>(shells[i].triangles[0])];
    const double around = total(input.vertices[static_cast<std::size_t>(first.corners[0])], &shells[i]);
    const double wanted = shells[i].volume > 0.0 ? 0.0 : 1.0;
    if (std::abs(around - wanted) > 0.25)
      throw MeshError(MeshError::Reason::not_manifold,
          message("surface: the shell of facet ", first.facet, " with volume ", shells[i].volume,
              " is wound by other shells ", around, " times, must be ", wanted));
  }
  std::vector<char> used(input.vertices.size(), 0);
  for (const SurfaceTriangle& t : triangles)
    for (int vertex : t.corners) used[static_cast<std::size_t>(vertex)] = 1;
  for (std::size_t i = 0; i < used.size(); ++i)
    if (!used[i] && total(input.vertices[i], nullptr) < 0.75)
      throw MeshError(MeshError::Reason::bad_index,
          message("surface: vertex ", i, " belongs to no facet and is not inside the body"));
}

/// A point inside each cavity: half way from one of its triangles to what faces it.
inline std::vector<Vec3d> cavity_points(const std::vector<Vec3d>& vertices,
    const std::vector<SurfaceTriangle>& triangles, const std::vector<Shell>& shells) {
  std::vector<Vec3d> points;
  const auto at = [&](int vertex) -> const Vec3d& { return vertices[static_cast<std::size_t>(vertex)]; };
  for (const Shell& shell : shells) {
    if (shell.volume > 0.0) continue;
    const auto& [a, b, c] = triangles[static_cast<std::size_t>(shell.triangles[0])].corners;
    const Vec3d from = (at(a) + at(b) + at(c)) / 3.0;
    const Vec3d ray = (at(b) - at(a)).cross(at(c) - at(a)).normalized();  // out of the material
    double nearest = HUGE_VAL;
    for (std::size_t i = 0; i < triangles.size(); ++i) {
      if (static_cast<int>(i) == shell.triangles[0]) continue;
      const auto& [p, q, r] = triangles[i].corners;
      const Vec3d normal = (at(q) - at(p)).cross(at(r) - at(p));
      const double distance = normal.dot(at(p) - from) / normal.dot(ray);
      if (!(distance > 0.0 && distance < nearest)) continue;
      const Vec3d hit = from + distance * ray;
      const double slack = -1e-9 * normal.squaredNorm();
      const auto left = [&](int v, int w) { return normal.dot((at(w) - at(v)).cross(hit - at(v))) >= slack; };
      if (left(p, q) && left(q, r) && left(r, p)) nearest = distance;
    }
    points.push_back(from + 0.5 * nearest * ray);
  }
  return points;
}

}  // namespace lumo

#endif

// ---- lumo/geometry/surface_check.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_SURFACE_CHECK_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_SURFACE_CHECK_HPP

namespace lumo {

/// What is known of a surface once it is found good.
struct SurfaceReport {
  Vec3d low{0.0, 0.0, 0.0};  ///< bounding box
  Vec3d high{0.0, 0.0, 0.0};
  double area = 0.0;
  double volume = 0.0;          ///< enclosed, cavities not counted
  std::vector<Vec3d> cavities;  ///< a point inside each cavity (a closed inner shell that faces inwards)
};

/// Checks that a surface bounds a solid: numbers finite and below 1e6, indices valid, facets flat (1e-8 of their size),
/// simple and not degenerate, no two vertices at one place (1e-8 of the body's size), every edge shared by two facets
/// of one orientation, one fan of facets around each vertex, positive volume, and no facets that cross, touch (1e-8 of
/// the body's size) or lie on each other. Vertices of no facet are interior points. Several separate solids and
/// cavities are legal. Throws MeshError with the reason of the first broken rule; an inside-out surface is
/// not_manifold, no volume is degenerate. Time about n log n for n triangles, quadratic in the corners of a facet.
/// An own engine: each fault is an error with its kind, place and limit, and nothing but Eigen is needed.
inline SurfaceReport validate_surface(const ClosedSurface& input);

namespace detail {

// In the unit of the coordinates; the other two relative to the facet or the body. Own choice: far above what doubles
// round, far below what is made.
inline constexpr double largest_coordinate = 1e6;
inline constexpr double flatness = 1e-8;
inline constexpr double closeness = 1e-8;

[[noreturn]] inline void refuse_surface(MeshError::Reason reason, const std::string& line) {
  throw MeshError(reason, "surface: " + line);
}

inline std::string point_text(const Vec3d& p) { return message("(", p.x(), ", ", p.y(), ", ", p.z(), ")"); }

inline void check_numbers(const ClosedSurface& input) {
  using Reason = MeshError::Reason;
  if (input.vertices.empty() || input.facets.empty())
    refuse_surface(Reason::degenerate, message("has ", input.vertices.size(), " vertices and ", input.facets.size(),
                                           " facets, must have some of both"));
  if (input.vertices.size() > 100'000'000 || input.facets.size() > 100'000'000)
    refuse_surface(Reason::out_of_memory,
        message("has ", input.vertices.size(), " vertices and ", input.facets.size(), " facets, at most 1e8 of each"));
  for (std::size_t i = 0; i < input.vertices.size(); ++i)
    if (!(input.vertices[i].cwiseAbs().maxCoeff() <= largest_coordinate) || !input.vertices[i].allFinite())
      refuse_surface(Reason::not_finite, message("vertex ", i, " is at ", point_text(input.vertices[i]),
                                             ", coordinates must be finite and at most ", largest_coordinate));
  const auto count = static_cast<int>(input.vertices.size());
  std::vector<int> seen(input.vertices.size(), -1);
  for (std::size_t f = 0; f < input.facets.size(); ++f) {
    const std::vector<int>& loop = input.facets[f].loop;
    for (int vertex : loop)
      if (vertex < 0 || vertex >= count)
        refuse_surface(
            Reason::bad_index, message("facet ", f, " names vertex ", vertex, ", must lie in [0, ", count - 1, "]"));
    if (loop.size() < 3)
      refuse_surface(Reason::degenerate, message("facet ", f, " has ", loop.size(), " corners, must have at least 3"));
    for (int vertex : loop)
      if (std::exchange(seen[static_cast<std::size_t>(vertex)], static_cast<int>(f)) == static_cast<int>(f))
        refuse_surface(Reason::degenerate, message("facet ", f, " has vertex ", vertex, " more than once"));
  }
}

/// Vertices closer than `tolerance`, found by sorting along a direction in which hardly any two agree by accident.
inline void check_duplicates(const std::vector<Vec3d>& vertices, double tolerance) {
  const Vec3d direction = Vec3d(0.5477, 0.6083, 0.5744).normalized();
  struct Placed {
    double along;
    int vertex;
    auto operator<=>(const Placed&) const = default;
  };
  std::vector<Placed> order;
  for (std::size_t i = 0; i < vertices.size(); ++i) order.push_back({direction.dot(vertices[i]), static_cast<int>(i)});
  std::sort(order.begin(), order.end());
  for (std::size_t i = 0; i < order.size(); ++i)
    for (std::size_t j = i + 1; j < order.size() && order[j].along - order[i].along <= tolerance; ++j) {
      const Vec3d& a = vertices[static_cast<std::size_t>(order[i].vertex)];
      const double distance = (vertices[static_cast<std::size_t>(order[j].vertex)] - a).norm();
      if (distance <= tolerance)
        refuse_surface(MeshError::Reason::duplicate,
            message("vertices ", order[i].vertex, " and ", order[j].vertex, " at ", point_text(a), " are ", distance,
                " apart, must be more than ", tolerance));
    }
}

}  // namespace detail

/// Checks each facet alone and cuts it into triangles.
inline std::vector<SurfaceTriangle> check_facets(const ClosedSurface& input, double gap) {
  using Reason = MeshError::Reason;
  std::vector<SurfaceTriangle> triangles;
  for (std::size_t f = 0; f < input.facets.size(); ++f) {
    const std::vector<int>& loop = input.facets[f].loop;
    const auto corner = [&](std::size_t i) -> const Vec3d& {
      return input.vertices[static_cast<std::size_t>(loop[i % loop.size()])];
    };
    double size = 0.0;
    for (std::size_t i = 0; i < loop.size(); ++i)
      size = std::max({size, (corner(i) - corner(0)).norm(), (corner(i + 1) - corner(i)).norm()});
    const Vec3d doubled = polygon_normal(input.vertices, loop);
    if (!(doubled.norm() > 2.0 * detail::flatness * size * size))
      detail::refuse_surface(
          Reason::degenerate, message("facet ", f, " at ", detail::point_text(corner(0)), " has area ",
                                  0.5 * doubled.norm(), ", must be more than ", detail::flatness * size * size));
    const Vec3d normal = doubled.normalized();
    for (std::size_t i = 1; i < loop.size(); ++i) {
      const double height = std::abs(normal.dot(corner(i) - corner(0)));
      if (loop.size() > 3 && height > detail::flatness * size)
        detail::refuse_surface(
            Reason::degenerate, message("facet ", f, " at ", detail::point_text(corner(i)), " is not flat: ", height,
                                    " off its plane, at most ", detail::flatness * size));
    }
    const auto pieces = facet_triangles(input.vertices, loop, normal, static_cast<int>(f), 2.0 * gap);
    if (!pieces)
      detail::refuse_surface(Reason::self_intersecting,
          message("the outline of facet ", f, " at ", detail::point_text(corner(0)), " crosses or touches itself"));
    triangles.insert(triangles.end(), pieces->begin(), pieces->end());
  }
  return triangles;
}

inline SurfaceReport validate_surface(const ClosedSurface& input) {
  using Reason = MeshError::Reason;
  detail::check_numbers(input);
  SurfaceReport report;
  report.low = report.high = input.vertices[0];
  for (const Vec3d& vertex : input.vertices) {
    report.low = elementwise_min(report.low, vertex);
    report.high = elementwise_max(report.high, vertex);
  }
  const double size = (report.high - report.low).norm();
  if (!(size >= 1e-30))
    detail::refuse_surface(Reason::degenerate, message("has a size of ", size, ", must be at least 1e-30"));
  detail::check_duplicates(input.vertices, detail::closeness * size);
  const std::vector<SurfaceTriangle> triangles = check_facets(input, detail::closeness * size);
  check_edges(input);

  const std::vector<Shell> shells = find_shells(input, triangles);
  for (const Shell& shell : shells) {
    report.area += shell.area;
    report.volume += shell.volume;
    if (!(std::abs(shell.volume) > 1e-9 * shell.area * size))
      detail::refuse_surface(Reason::degenerate,
          message("the shell of facet ", triangles[static_cast<std::size_t>(shell.triangles[0])].facet,
              " encloses a volume of ", shell.volume, ", must be more than ", 1e-9 * shell.area * size));
  }
  if (!(report.volume > 0.0))
    detail::refuse_surface(
        Reason::not_manifold, message("is inside out: the enclosed volume is ", report.volume, ", must be > 0"));
  if (const auto pair = SelfIntersection(input.vertices, triangles, detail::closeness * size).find()) {
    const SurfaceTriangle& a = triangles[static_cast<std::size_t>(pair->first)];
    const SurfaceTriangle& b = triangles[static_cast<std::size_t>(pair->second)];
    detail::refuse_surface(Reason::self_intersecting,
        message("facets ", std::min(a.facet, b.facet), " and ", std::max(a.facet, b.facet), " cross or touch near ",
            detail::point_text(input.vertices[static_cast<std::size_t>(a.corners[0])]), ", must be more than ",
            detail::closeness * size, " apart"));
  }
  check_inside(input, triangles, shells);
  report.cavities = cavity_points(input.vertices, triangles, shells);
  return report;
}

}  // namespace lumo

#endif

// ---- lumo/geometry/triangle_surface.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_TRIANGLE_SURFACE_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_TRIANGLE_SURFACE_HPP

namespace lumo {

/// A surface of triangles, counter-clockwise seen from outside.
struct TriangleSurface {
  std::vector<Vec3d> vertices;  ///< [m]
  std::vector<std::array<int, 3>> triangles;
};

/// Removes the vertices that no triangle has; the others keep their order.
inline void drop_unused_vertices(TriangleSurface& surface) {
  std::vector<int> number(surface.vertices.size(), -1);
  for (const auto& t : surface.triangles)
    for (const int v : t) number[std::size_t(v)] = 0;
  std::vector<Vec3d> used;
  for (std::size_t v = 0; v < number.size(); ++v)
    if (number[v] == 0) {
      number[v] = int(used.size());
      used.push_back(surface.vertices[v]);
    }
  surface.vertices = std::move(used);
  for (auto& t : surface.triangles)
    for (int& v : t) v = number[std::size_t(v)];
}

/// Throws MeshError unless the surface is closed, manifold, faces outwards and does not cross itself; see
/// validate_surface.
inline SurfaceReport validate_surface(const TriangleSurface& surface) {
  ClosedSurface input;
  input.vertices = surface.vertices;
  for (const auto& t : surface.triangles) input.facets.push_back({{t[0], t[1], t[2]}, 0});
  return validate_surface(input);
}

/// How often the surface winds around a point: 1 inside, 0 outside.
inline double winding_number(const TriangleSurface& surface, const Vec3d& point) {
  double angle = 0.0;
  const auto at = [&](int vertex) -> const Vec3d& { return surface.vertices[std::size_t(vertex)]; };
  for (const auto& t : surface.triangles) angle += solid_angle(at(t[0]), at(t[1]), at(t[2]), point);
  return angle / (4.0 * std::numbers::pi);
}

}  // namespace lumo

#endif

// ---- lumo/fabrication/faceted_solid.hpp
#ifndef SINGLE_INCLUDE_LUMO_FABRICATION_FACETED_SOLID_HPP
#define SINGLE_INCLUDE_LUMO_FABRICATION_FACETED_SOLID_HPP

namespace lumo {

/// A solid that is given face by face: flat polygons with holes, and bands between loops. Corners at one place (in
/// every bit) are one vertex, and an edge along an axis takes up the corners of its neighbours that lie on it, so that
/// faces meet edge to edge however they are cut. There are no boolean operations; surface() checks that the faces bound
/// a solid.
class FacetedSolid {
 public:
  using Loop = std::vector<Vec3d>;

  /// A flat face; outline counter-clockwise seen from outside, holes clockwise.
  void face(const Loop& outline, const std::vector<Loop>& holes = {});
  /// Quadrilaterals between two chains of corners: from[i], from[i+1], to[i+1], to[i], which must be flat. With
  /// `closed` the last joins the first. Outward for a loop that is counter-clockwise seen from the side of `to`.
  void band(const Loop& from, const Loop& to, bool closed = true);

  /// The solid's triangles. Throws MeshError unless they bound a solid (see validate_surface).
  TriangleSurface surface() const;

 private:
  struct Face {
    std::vector<int> outline;
    std::vector<std::vector<int>> holes;
  };

  int vertex(const Vec3d& p);
  std::vector<int> numbers(const Loop& loop);
  std::vector<int> with_corners_between(const std::vector<int>& loop) const;

  std::vector<Vec3d> vertices_;
  std::map<std::array<double, 3>, int> known_;
  std::vector<Face> faces_;
};

/// The loop the other way round.
inline std::vector<Vec3d> reversed(std::type_identity_t<std::vector<Vec3d>> loop) {
  std::reverse(loop.begin(), loop.end());
  return loop;
}

inline int FacetedSolid::vertex(const Vec3d& p) {
  const auto [place, fresh] =
      known_.try_emplace({p.x() + 0.0, p.y() + 0.0, p.z() + 0.0}, int(vertices_.size()));  // −0 is 0
  if (fresh) vertices_.push_back(p);
  return place->second;
}

inline std::vector<int> FacetedSolid::numbers(const Loop& loop) {
  std::vector<int> n;
  for (const Vec3d& p : loop) n.push_back(vertex(p));
  return n;
}

inline void FacetedSolid::face(const Loop& outline, const std::vector<Loop>& holes) {
  Face f{numbers(outline), {}};
  for (const Loop& hole : holes) f.holes.push_back(numbers(hole));
  faces_.push_back(std::move(f));
}

inline void FacetedSolid::band(const Loop& from, const Loop& to, bool closed) {
  const std::size_t n = from.size();
  for (std::size_t i = 0; i + (closed ? 0 : 1) < n; ++i) face({from[i], from[(i + 1) % n], to[(i + 1) % n], to[i]});
}

/// The loop with all vertices of the solid that lie on its edges along an axis; exact, for two coordinates are the same
/// there.
inline std::vector<int> FacetedSolid::with_corners_between(const std::vector<int>& loop) const {
  std::vector<int> full;
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const int from = loop[i], to = loop[(i + 1) % loop.size()];
    const Vec3d &a = vertices_[std::size_t(from)], &b = vertices_[std::size_t(to)];
    full.push_back(from);
    for (int axis = 0; axis < 3; ++axis) {
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      if (a[u] != b[u] || a[v] != b[v]) continue;
      struct Corner {
        double way;
        int vertex;
        auto operator<=>(const Corner&) const = default;
      };
      std::vector<Corner> between;
      for (std::size_t k = 0; k < vertices_.size(); ++k) {
        const Vec3d& p = vertices_[k];
        if (p[u] == a[u] && p[v] == a[v] && (p[axis] - a[axis]) * (p[axis] - b[axis]) < 0.0)
          between.push_back({std::abs(p[axis] - a[axis]), int(k)});
      }
      std::sort(between.begin(), between.end());
      for (const auto& corner : between) full.push_back(corner.vertex);
    }
  }
  return full;
}

inline auto FacetedSolid::surface() const -> TriangleSurface {
  TriangleSurface s{vertices_, {}};
  for (const Face& f : faces_) {
    const std::vector<int> outline = with_corners_between(f.outline);
    std::vector<std::vector<int>> holes;
    for (const auto& hole : f.holes) holes.push_back(with_corners_between(hole));
    const Vec3d normal = polygon_normal(vertices_, f.outline);
    // Numbers of the corners alone: the projection of thousands of others would cost more than the cut.
    std::vector<int> of = outline;
    for (const auto& hole : holes) of.insert(of.end(), hole.begin(), hole.end());
    std::sort(of.begin(), of.end());
    of.erase(std::unique(of.begin(), of.end()), of.end());
    std::vector<Vec3d> corners;
    for (const int vertex : of) corners.push_back(vertices_[std::size_t(vertex)]);
    const auto local = [&](std::vector<int> loop) {
      for (int& vertex : loop) vertex = int(std::lower_bound(of.begin(), of.end(), vertex) - of.begin());
      return loop;
    };
    std::vector<std::vector<int>> local_holes;
    for (const auto& hole : holes) local_holes.push_back(local(hole));
    const auto triangles = PolygonTriangles(corners, normal).cut(local(outline), std::move(local_holes));
    if (!triangles)
      throw MeshError(
          MeshError::Reason::self_intersecting, "solid: a face's outline crosses or touches itself or its holes");
    for (const auto& t : *triangles)
      s.triangles.push_back({of[std::size_t(t[0])], of[std::size_t(t[1])], of[std::size_t(t[2])]});
  }
  validate_surface(s);
  return s;
}

}  // namespace lumo

#endif

// ---- lumo/fabrication/solids.hpp
#ifndef SINGLE_INCLUDE_LUMO_FABRICATION_SOLIDS_HPP
#define SINGLE_INCLUDE_LUMO_FABRICATION_SOLIDS_HPP

namespace lumo {

namespace detail {

/// Corners of a regular polygon in a circle, in the plane of u and v, counter-clockwise seen from u × v.
inline std::vector<Vec3d> ring(const Vec3d& center, const Vec3d& u, const Vec3d& v, double radius, int corners = 32) {
  std::vector<Vec3d> loop;
  for (int k = 0; k < corners; ++k)
    loop.push_back(center + radius * (std::cos(2.0 * pi * k / corners) * u + std::sin(2.0 * pi * k / corners) * v));
  return loop;
}

/// A rectangle in a plane of constant z, counter-clockwise seen from above.
inline std::vector<Vec3d> rectangle(double x0, double x1, double y0, double y1, double z) {
  return {{x0, y0, z}, {x1, y0, z}, {x1, y1, z}, {x0, y1, z}};
}

}  // namespace detail

/// Outline (y, z) of the core that keeps a void free, counter-clockwise seen along −x [m]: a bar of the void's height
/// from one end of the cavity out through the other, a handle behind it, and a step that stops at the mould.
inline std::vector<std::array<double, 2>> core_outline(const HalfSection& s, const CastingOptions& o = {}) {
  const CastingLayout at(s, o);
  constexpr double handle = 10.0e-3;
  const double inner = CastingLayout::has_cap(s) ? -at.stem_high : -at.half_length, outer = at.mould_y - at.middle_y;
  std::vector<std::array<double, 2>> outline{{inner, 0.0}, {outer, 0.0}, {outer, -at.rim}, {outer + handle, -at.rim},
      {outer + handle, at.stem_height}, {inner, at.stem_height}};
  if (at.pour > 0.0) return outline;
  for (auto& p : outline) p[0] = -p[0];
  std::reverse(outline.begin(), outline.end());
  return outline;
}

/// The core of the void at x > 0, as thick as the void is wide; the other one is the same, shifted. It comes out at the
/// end that is poured. Throws InvalidArgument for a design without voids, MeshError.
inline TriangleSurface core_solid(const HalfSection& s, const CastingOptions& o = {}) {
  validate(o, s);
  const CastingLayout at(s, o);
  require_positive("void width", at.void_width * 1e3, "mm");
  const auto side = [&](double x) {
    std::vector<Vec3d> loop;
    for (const auto& p : core_outline(s, o)) loop.emplace_back(x, p[0], p[1]);
    return loop;
  };
  const auto inner = side(at.stem_x), outer = side(at.void_x);
  FacetedSolid solid;
  solid.band(inner, outer);
  solid.face(reversed(inner));
  solid.face(outer);
  return solid.surface();
}

/// The bar that fills the slot below an LED strip whose LEDs lie in recesses, and holds the strip up; the wires go past
/// its end. Throws InvalidArgument for a stem without recesses, MeshError.
inline TriangleSurface led_bar_solid(const HalfSection& s, const CastingOptions& o = {}) {
  validate(o, s);
  const CastingLayout at(s, o);
  require_positive("depth of the LEDs' recesses", (at.stem_height - at.recess_floor) * 1e3, "mm");
  const auto level = [&](double z) {
    return detail::rectangle(
        -0.5 * o.strip_width, 0.5 * o.strip_width, CastingLayout::duct_length - at.strip_y, at.strip_y, z);
  };
  const auto low = level(at.seat - at.plate), high = level(at.pocket_floor);
  FacetedSolid solid;
  solid.band(low, high);
  solid.face(reversed(low));
  solid.face(high);
  return solid.surface();
}

}  // namespace lumo

#endif

// ---- lumo/fabrication/casting_drawings.hpp
#ifndef SINGLE_INCLUDE_LUMO_FABRICATION_CASTING_DRAWINGS_HPP
#define SINGLE_INCLUDE_LUMO_FABRICATION_CASTING_DRAWINGS_HPP

namespace lumo {

/// The cross-section of the closed mould through an LED, seen along y, at scale 1:1. Throws InvalidArgument.
inline Drawing section_drawing(const HalfSection& section, const CastingOptions& options = {});
/// The LED strip from above, y to the right: its outline and its LEDs. Throws InvalidArgument.
inline Drawing strip_drawing(const HalfSection& section, const CastingOptions& options = {});
/// The side of a core, for cutting it from sheet. Throws InvalidArgument for a design without voids.
inline Drawing core_drawing(const HalfSection& section, const CastingOptions& options = {});

namespace detail {

inline constexpr double caption_height = 1.8e-3;  ///< of capitals [m], about 7 pt

/// Words under a drawing, and a line of 10 mm by which a print can be measured.
inline void add_caption(Drawing& d, const std::string& words) {
  const int layer = int(d.layers.size());
  d.layers.push_back({"NOTES", 8, "#666666"});
  const auto box = d.box();
  const double x = box[0][0], y = box[0][1] - 5.0e-3;
  d.lines.push_back({layer, {{x, y + 1.0e-3}, {x, y}, {x + 10.0e-3, y}, {x + 10.0e-3, y + 1.0e-3}}, false});
  d.labels.push_back({layer, {x + 12.0e-3, y}, caption_height, "10 mm"});
  d.labels.push_back({layer, {x, y - 4.0e-3}, caption_height, words});
  d.title = words;
}

inline Drawing::Line box_line(int layer, double x0, double x1, double y0, double y1) {
  return {layer, {{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}}};
}

/// A half outline at x > 0 and its mirror image in one loop.
inline std::vector<Drawing::Point> mirrored(std::vector<Drawing::Point> half) {
  for (std::size_t i = half.size(); i-- > 0;)
    if (half[i][0] != 0.0) half.push_back({-half[i][0], half[i][1]});
  return half;
}

}  // namespace detail

namespace detail {

/// Half of the silicone, from the middle of the stem's top to the apex.
inline std::vector<Drawing::Point> silicone_half(const HalfSection& s, const CastingLayout& at) {
  const auto outline = pad_outline(s);
  std::vector<Drawing::Point> half{{at.stem_x, at.stem_height}};
  if (at.void_width > 0.0) half.insert(half.end(), {{at.void_x, at.stem_height}, {at.void_x, 0.0}});
  else half.push_back({at.stem_x, 0.0});
  if (at.is_stair()) half.insert(half.end(), {{at.block_x, 0.0}, {at.block_x, at.seat}});
  half.insert(half.end(), outline.begin(), outline.end());
  return half;
}

/// The carrier through an LED: in one piece about a pocket, in two beside a slot.
inline void add_carrier(Drawing& d, int layer, const CastingLayout& at, const CastingOptions& o) {
  const double bottom = at.seat - at.plate, top = at.recess_floor;
  std::vector<Drawing::Point> half;
  if (at.has_recesses()) {
    const double window = 0.5 * o.leds.width_x + o.clearance, ceiling = at.slot_ceiling(o);
    half = {{at.pocket_x, bottom}, {at.pocket_x, ceiling}, {window, ceiling}, {window, top}};
  } else {
    half = {{at.pocket_x, at.pocket_floor}, {at.pocket_x, top}};
  }
  half.insert(half.end(), {{at.stem_x, top}, {at.stem_x, 0.0}});
  if (at.is_stair()) half.insert(half.end(), {{at.block_x, 0.0}, {at.block_x, at.seat}});
  half.insert(half.end(), {{at.plate_x, at.seat}, {at.plate_x, bottom}});
  if (!at.has_recesses()) {
    d.lines.push_back({layer, mirrored(std::move(half))});
    return;
  }
  d.lines.push_back({layer, half});
  for (auto& p : half) p[0] = -p[0];
  d.lines.push_back({layer, std::move(half)});
}

/// The strip through an LED; its circuit and the LED apart where windows let the LEDs through.
inline void add_strip(Drawing& d, int layer, const CastingLayout& at, const CastingOptions& o) {
  const double led = 0.5 * o.leds.width_x, half = 0.5 * o.strip_width, top = at.recess_floor;
  const double circuit_top = at.has_recesses() ? at.slot_ceiling(o) : top;
  d.lines.push_back(box_line(layer, -half, half, at.pocket_floor, circuit_top));
  if (at.has_recesses()) d.lines.push_back(box_line(layer, -led, led, circuit_top, top));
  else d.lines.push_back({layer, {{-led, top}, {led, top}}, false});
}

}  // namespace detail

inline Drawing section_drawing(const HalfSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  const bool voids = at.void_width > 0.0;
  const auto outline = pad_outline(s);
  Drawing d;
  d.layers = {
      {"SILICONE", 4, "#0072b2"}, {"CARRIER", 8, "#444444"}, {"LED_STRIP", 2, "#b07400"}, {"MOULD", 3, "#009e73"}};
  std::vector<std::string> legend{"silicone", "carrier", "LED strip", "mould"};
  const auto add_layer = [&](const Drawing::Layer& layer, const char* words) {
    d.layers.push_back(layer);
    legend.push_back(words);
  };
  if (voids) add_layer({"CORES", 1, "#d55e00"}, "cores");
  d.lines.push_back({0, detail::mirrored(detail::silicone_half(s, at))});
  detail::add_carrier(d, 1, at, o);
  detail::add_strip(d, 2, at, o);
  for (const double side : {1.0, -1.0}) {
    std::vector<Drawing::Point> half{{at.half_width, at.seat}, {at.rim_x, at.seat}, {at.rim_x, at.seat - at.rim},
        {at.mould_x, at.seat - at.rim}, {at.mould_x, at.mould_top}, {0.0, at.mould_top}};
    half.insert(half.end(), outline.rbegin(), outline.rend() - 1);
    for (auto& p : half) p[0] *= side;
    d.lines.push_back({3, std::move(half)});
    if (voids) d.lines.push_back(detail::box_line(4, side * at.stem_x, side * at.void_x, 0.0, at.stem_height));
  }
  if (at.has_recesses()) {
    const double half = 0.5 * o.strip_width;
    add_layer({"LED_BAR", 6, "#aa4499"}, "LED bar");
    d.lines.push_back(detail::box_line(int(d.layers.size()) - 1, -half, half, at.seat - at.plate, at.pocket_floor));
  }
  for (int layer = 0; layer < int(legend.size()); ++layer)
    d.labels.push_back({layer, {at.mould_x + 3.0e-3, at.mould_top - (2.0 + 4.0 * layer) * 1e-3}, detail::caption_height,
        legend[std::size_t(layer)]});
  detail::add_caption(d, "Section at scale 1:1");
  return d;
}

inline Drawing strip_drawing(const HalfSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  Drawing d;
  d.layers = {{"OUTLINE", 7, "#222222"}, {"LEDS", 2, "#b07400"}};
  d.lines.push_back(detail::box_line(0, -at.strip_y, at.strip_y, -0.5 * o.strip_width, 0.5 * o.strip_width));
  for (const double y : led_places(o.leds))
    d.lines.push_back(detail::box_line(
        1, y - 0.5 * o.leds.length_y, y + 0.5 * o.leds.length_y, -0.5 * o.leds.width_x, 0.5 * o.leds.width_x));
  detail::add_caption(d, message("LED strip at scale 1:1, ", 2e3 * at.strip_y, " x ", 1e3 * o.strip_width,
                             " mm, LEDs every ", 1e3 * o.leds.pitch, " mm"));
  return d;
}

inline Drawing core_drawing(const HalfSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  require_positive("void width", at.void_width * 1e3, "mm");
  Drawing d;
  d.layers = {{"OUTLINE", 7, "#222222"}};
  d.lines.push_back({0, core_outline(s, o)});
  detail::add_caption(d, message("Core at scale 1:1, ", 1e3 * at.void_width, " mm thick, two of them"));
  return d;
}

}  // namespace lumo

#endif

// ---- lumo/fabrication/carrier_solid.hpp
#ifndef SINGLE_INCLUDE_LUMO_FABRICATION_CARRIER_SOLID_HPP
#define SINGLE_INCLUDE_LUMO_FABRICATION_CARRIER_SOLID_HPP

namespace lumo {

/// The rigid carrier: a plate with mounting holes, on it the block between the pad's shoulders, if it has any, and the
/// stem. Without recesses the LED strip lies in a pocket of the stem's top, and its wires leave by a duct through the
/// plate. Recesses are left whole but for windows: the strip comes from below, by a slot, and its LEDs end in the
/// recesses' floors. Stem and block are shorter than the pad by half a clearance at each end that the mould closes. The
/// carrier stands on its plate. Throws InvalidArgument, MeshError.
inline TriangleSurface carrier_solid(const HalfSection& section, const CastingOptions& options = {});

namespace detail {

/// Adds the faces of a carrier.
class CarrierSolid {
 public:
  CarrierSolid(const HalfSection& s, const CastingOptions& o)
      : o_(o),
        at_(s, o),
        led_y_(led_places(o.leds)),
        bottom_(at_.seat - at_.plate),
        holes_below_(holes(bottom_)),
        holes_above_(holes(at_.seat)) {
    if (at_.has_recesses()) ridges_ = stem_ridges(known_of_finger(s, o));
    else ridges_ = {{at_.stem_low, at_.stem_high}};
    ridges_.front().low = at_.stem_low;
    ridges_.back().high = at_.stem_high;
  }

  TriangleSurface surface() {
    for (std::size_t k = 0; k < holes_below_.size(); ++k) solid_.band(holes_below_[k], holes_above_[k]);
    solid_.band(plate(bottom_), plate(at_.seat));
    rail();
    if (at_.has_recesses()) slot();
    else pocket();
    underside();
    std::vector<Loop> openings = holes_above_;
    openings.push_back(reversed(foot()));
    solid_.face(plate(at_.seat), openings);
    if (at_.has_recesses()) recessed_top();
    else flat_top();
    return solid_.surface();
  }

 private:
  using Loop = typename FacetedSolid::Loop;

  Loop plate(double z) const {
    return rectangle(-at_.plate_x, at_.plate_x, at_.middle_y - at_.plate_y, at_.middle_y + at_.plate_y, z);
  }
  /// What stands on the plate.
  Loop foot() const {
    const double x = at_.is_stair() ? at_.block_x : at_.stem_x;
    return rectangle(-x, x, at_.stem_low, at_.stem_high, at_.seat);
  }
  Loop pocket(double z) const { return rectangle(-at_.pocket_x, at_.pocket_x, -at_.pocket_y, at_.pocket_y, z); }
  Loop duct(double z) const {
    const double x = 0.5 * o_.strip_width;
    return rectangle(-x, x, -at_.strip_y, CastingLayout::duct_length - at_.strip_y, z);
  }
  Loop window(double y, double z) const {
    const double half_x = 0.5 * o_.leds.width_x + o_.clearance, half_y = 0.5 * o_.leds.length_y + o_.clearance;
    return rectangle(-half_x, half_x, y - half_y, y + half_y, z);
  }
  /// Mounting holes, clockwise seen from above.
  std::vector<Loop> holes(double z) const {
    std::vector<Loop> loops;
    for (const double x : {-1.0, 1.0})
      for (const double y : {-1.0, 1.0})
        loops.push_back(reversed(ring(Vec3d(x * (at_.half_width - CastingLayout::hole_inset),
                                          at_.middle_y + y * (at_.half_length + 0.5 * o_.tab), z),
            Vec3d::UnitX(), Vec3d::UnitY(), 0.5 * o_.hole_diameter)));
    return loops;
  }

  Loop rail_end(double y, double side) const;
  Loop stem_side(double side) const;
  void rail();
  void pocket();
  void slot();
  void underside();
  void flat_top();
  void recessed_top();

  const CastingOptions& o_;
  CastingLayout at_;
  std::vector<double> led_y_;
  double bottom_;
  std::vector<Loop> holes_below_, holes_above_;
  std::vector<Ridge> ridges_;
  FacetedSolid solid_;
};

/// Of stem and block: seen along +y for `side` 1, from the other end for −1, counter-clockwise.
inline auto CarrierSolid::rail_end(double y, double side) const -> Loop {
  const double w = side * at_.stem_x, b = side * at_.block_x, top = at_.stem_height;
  if (!at_.is_stair()) return {{-w, y, at_.seat}, {w, y, at_.seat}, {w, y, top}, {-w, y, top}};
  return {{-b, y, at_.seat}, {b, y, at_.seat}, {b, y, 0.0}, {w, y, 0.0}, {w, y, top}, {-w, y, top}, {-w, y, 0.0},
      {-b, y, 0.0}};
}

/// At x > 0 for `side` 1, at x < 0 for −1, counter-clockwise from outside, with the recesses' ends.
inline auto CarrierSolid::stem_side(double side) const -> Loop {
  const double x = side * at_.stem_x, from = side > 0.0 ? at_.stem_low : at_.stem_high,
               to = side > 0.0 ? at_.stem_high : at_.stem_low, h = at_.stem_height, floor = at_.recess_floor;
  Loop recesses;  // towards +y
  for (const auto& [low, high] : recess_floors(ridges_))
    recesses.insert(recesses.end(), {{x, low, h}, {x, low, floor}, {x, high, floor}, {x, high, h}});
  if (side > 0.0) recesses = reversed(recesses);
  Loop loop{{x, from, 0.0}, {x, to, 0.0}, {x, to, h}};
  loop.insert(loop.end(), recesses.begin(), recesses.end());
  loop.emplace_back(x, from, h);
  return loop;
}

/// The sides and ends of stem and block, and the block's top.
inline void CarrierSolid::rail() {
  const double w = at_.stem_x, b = at_.block_x, low = at_.stem_low, high = at_.stem_high, seat = at_.seat;
  solid_.face(rail_end(low, 1.0));
  solid_.face(stem_side(1.0));
  solid_.face(rail_end(high, -1.0));
  solid_.face(stem_side(-1.0));
  if (!at_.is_stair()) return;
  solid_.face({{b, low, seat}, {b, high, seat}, {b, high, 0.0}, {b, low, 0.0}});
  solid_.face({{-b, high, seat}, {-b, low, seat}, {-b, low, 0.0}, {-b, high, 0.0}});
  solid_.face(rectangle(w, b, low, high, 0.0));
  solid_.face(rectangle(-b, -w, low, high, 0.0));
}

/// From above; the wires' duct goes on through the plate.
inline void CarrierSolid::pocket() {
  solid_.band(reversed(duct(bottom_)), reversed(duct(at_.pocket_floor)));
  solid_.band(reversed(pocket(at_.pocket_floor)), reversed(pocket(at_.stem_height)));
}

/// From below, with a window for each LED.
inline void CarrierSolid::slot() {
  const double ceiling = at_.slot_ceiling(o_);
  solid_.band(reversed(pocket(bottom_)), reversed(pocket(ceiling)));
  std::vector<Loop> windows;
  for (const double y : led_y_) {
    solid_.band(reversed(window(y, ceiling)), reversed(window(y, at_.recess_floor)));
    windows.push_back(window(y, ceiling));
  }
  solid_.face(reversed(pocket(ceiling)), windows);
}

inline void CarrierSolid::underside() {
  std::vector<Loop> openings;  // seen from below
  for (const Loop& loop : holes_below_) openings.push_back(reversed(loop));
  openings.push_back(at_.has_recesses() ? pocket(bottom_) : duct(bottom_));
  solid_.face(reversed(plate(bottom_)), openings);
}

inline void CarrierSolid::flat_top() {
  solid_.face(pocket(at_.pocket_floor), {reversed(duct(at_.pocket_floor))});
  solid_.face(rectangle(-at_.stem_x, at_.stem_x, at_.stem_low, at_.stem_high, at_.stem_height),
      {reversed(pocket(at_.stem_height))});
}

inline void CarrierSolid::recessed_top() {
  const double w = at_.stem_x, h = at_.stem_height, floor = at_.recess_floor;
  for (const Ridge& r : ridges_) solid_.face(rectangle(-w, w, r.low, r.high, h));
  const auto floors = recess_floors(ridges_);
  for (std::size_t k = 0; k < floors.size(); ++k) {
    const auto [from, to] = floors[k];
    solid_.face(rectangle(-w, w, from, to, floor), {reversed(window(led_y_[k], floor))});
    solid_.face({{w, from, floor}, {-w, from, floor}, {-w, from, h}, {w, from, h}});
    solid_.face({{-w, to, floor}, {w, to, floor}, {w, to, h}, {-w, to, h}});
  }
}

}  // namespace detail

inline TriangleSurface carrier_solid(const HalfSection& s, const CastingOptions& o) {
  validate(o, s);
  return detail::CarrierSolid(s, o).surface();
}

}  // namespace lumo

#endif

// ---- lumo/fabrication/mould_half.hpp
#ifndef SINGLE_INCLUDE_LUMO_FABRICATION_MOULD_HALF_HPP
#define SINGLE_INCLUDE_LUMO_FABRICATION_MOULD_HALF_HPP

namespace lumo {

/// An opening through the mould's wall at the end at which the pad is poured: the frustum of a cone along y; lengths in
/// m, places in (x, z).
struct Opening {
  std::array<double, 2> at_pad, outside;  ///< centres at the pad's end and at the mould's outer face
  double radius, outer_radius;

  /// Volume of the opening, which is cut as a frustum over a regular polygon [m³].
  double volume_m3(double length, int corners = 32) const {
    const double unit = 0.5 * corners * std::sin(2.0 * pi / corners);
    return unit * length / 3.0 * (radius * radius + radius * outer_radius + outer_radius * outer_radius);
  }
};

/// A gate near the dome's middle, and a vent in each lower corner, where air would stay: poured with this end up, the
/// end face is the highest place of the cavity.
inline std::vector<Opening> pour_openings(const HalfSection& section, const CastingOptions& options = {});

/// Mould half A: the pad's side at x > 0 and its whole distal end. Half B is the other side and the other end. The end
/// that is poured has gate, vents and openings for the cores: the distal one, or the proximal one of a pad with a cap.
/// The parting runs along the crown (x = 0) and round the ends, so that no face of the pad needs draft of its own:
/// opened along (cos β, sin β, 0) the ends draw at β and the crown at its own slope. A cone and a socket on the parting
/// face centre the halves; the rim below takes in the carrier's plate. Throws InvalidArgument, MeshError.
inline TriangleSurface mould_half_a(const HalfSection& section, const CastingOptions& options = {});
inline TriangleSurface mould_half_b(const HalfSection& section, const CastingOptions& options = {});

inline std::vector<Opening> pour_openings(const HalfSection& s, const CastingOptions& o) {
  // Own choices: a funnel of 15° half angle that widens upwards only, as far as the mould allows, high up in a thick
  // dome; vents in the corners that open outwards, at most to the mould's wall there.
  constexpr double gate_depth = 4.5e-3, above_funnel = 2.0e-3, widest_vent = 1.9e-3;
  const CastingLayout at(s, o);
  const double length = at.mould_y - at.half_length, gate = 0.5 * o.gate_diameter, vent = 0.5 * o.vent_diameter;
  const double z = std::max(0.5 * (at.stem_height + at.top), at.top - gate_depth);
  const double funnel =
      std::max(gate, std::min(gate + length * std::tan(15.0_deg), 0.5 * (at.mould_top - above_funnel - (z - gate))));
  const double corner_x = at.half_width - CastingLayout::vent_inset, corner_z = at.seat + CastingLayout::vent_inset;
  std::vector<Opening> list{{{0.0, z}, {0.0, z - gate + funnel}, gate, funnel}};
  for (const double side : {-1.0, 1.0})
    list.push_back({{side * corner_x, corner_z}, {side * corner_x, corner_z}, vent,
        std::min(vent + length * std::tan(3.0_deg), widest_vent)});
  return list;
}

namespace detail {

/// Adds the faces of one half, as of half A with the pad's middle at y = 0; `poured` is that with the openings, and
/// with notches for the cores, which are closed below by the mould where the plate lies lower than they.
class MouldHalf {
 public:
  MouldHalf(const HalfSection& s, const CastingOptions& o, bool poured)
      : o_(o),
        at_(s, o),
        outline_(pad_outline(s)),
        near_(-at_.half_length),
        end_(at_.half_length),
        rim_(at_.seat - at_.rim) {
    if (!poured) return;
    for (const Opening& opening : pour_openings(s, o))
      passages_.push_back(
          {round(opening.at_pad, end_, opening.radius), round(opening.outside, at_.mould_y, opening.outer_radius)});
    if (at_.void_width <= 0.0) return;
    const std::vector<Notch> cores{{-at_.notch_outer, -at_.notch_inner}, {at_.notch_inner, at_.notch_outer}};
    if (!at_.is_stair()) notches_ = cores;
    else
      for (const Notch& core : cores) passages_.push_back({window(core, end_), window(core, at_.mould_y)});
  }

  TriangleSurface surface() {
    cavity();
    parting();
    underside();
    outside();
    notches();
    for (const Passage& p : passages_) solid_.band(reversed(p.outside), reversed(p.at_pad));
    return solid_.surface();
  }

 private:
  using Loop = typename FacetedSolid::Loop;
  using Corners = std::vector<std::array<double, 2>>;

  struct Notch {
    double from, to;  ///< along x
  };
  /// Through the end wall; counter-clockwise seen along +y.
  struct Passage {
    Loop at_pad, outside;
  };

  static Loop round(const std::array<double, 2>& center, double y, double radius) {
    return ring(Vec3d(center[0], y, center[1]), Vec3d::UnitX(), Vec3d::UnitZ(), radius);
  }
  /// Of a core's opening where it is closed below.
  Loop window(const Notch& n, double y) const {
    const double low = -o_.clearance, roof = at_.notch_roof;
    return upright({{n.from, low}, {n.to, low}, {n.to, roof}, {n.from, roof}}, y);
  }

  /// Of corners (x, z), in a plane of constant y.
  static Loop upright(const Corners& corners, double y) {
    Loop loop;
    for (const auto& c : corners) loop.emplace_back(c[0], y, c[1]);
    return loop;
  }
  /// Of corners (y, z), in a plane of constant x.
  static Loop lengthwise(const Corners& corners, double x) {
    Loop loop;
    for (const auto& c : corners) loop.emplace_back(x, c[0], c[1]);
    return loop;
  }
  /// Of corners (x, y), in a plane of constant z.
  static Loop level(const Corners& corners, double z) {
    Loop loop;
    for (const auto& c : corners) loop.emplace_back(c[0], c[1], z);
    return loop;
  }

  /// A line at height z from the mould's left side, with a step up to `up` over each core.
  Corners stepped(double z, double up) const {
    Corners line{{-at_.mould_x, z}};
    for (const auto& [a, b] : notches_) line.insert(line.end(), {{a, z}, {a, up}, {b, up}, {b, z}});
    return line;
  }

  void cavity();
  void parting();
  void underside();
  void outside();
  void notches();

  const CastingOptions& o_;
  CastingLayout at_;
  Corners outline_;
  std::vector<Passage> passages_;
  std::vector<Notch> notches_;  ///< open towards the plate
  double near_, end_, rim_;     ///< y of the cavity's ends, z of the rim's foot
  FacetedSolid solid_;
};

/// The pad's side, the end that closes it, and the flat face at which the other half's end closes it.
inline void MouldHalf::cavity() {
  solid_.band(upright(outline_, near_), upright(outline_, end_), false);
  const Corners crown(outline_.rbegin(), outline_.rend());
  Corners face{{at_.half_width, at_.seat}, {at_.rim_x, at_.seat}, {at_.rim_x, rim_}, {at_.mould_x, rim_},
      {at_.mould_x, at_.mould_top}, {0.0, at_.mould_top}};
  face.insert(face.end(), crown.begin(), crown.end() - 1);
  solid_.face(upright(face, near_));

  Corners wall = stepped(at_.seat, at_.notch_roof);
  wall.insert(wall.end(), outline_.begin(), outline_.end());
  wall.insert(wall.end(), {{0.0, at_.mould_top}, {-at_.mould_x, at_.mould_top}});
  std::vector<Loop> holes;
  for (const Passage& p : passages_) holes.push_back(reversed(p.at_pad));
  solid_.face(upright(wall, end_), holes);
}

/// The face on the crown with a cone towards +y and a socket for the other half's towards −y. Their 20° let them go
/// along any opening direction up to that.
inline void MouldHalf::parting() {
  constexpr double radius = 2.5e-3, height = 3.0e-3;
  const double tip = radius - height * std::tan(20.0_deg), c = o_.clearance, z = at_.top + 0.5 * o_.wall,
               y = 0.67 * at_.half_length;
  const auto around = [&](double x, double place, double r) {
    return ring(Vec3d(x, place, z), Vec3d::UnitZ(), Vec3d::UnitY(), r);
  };  // seen from −x
  solid_.face(lengthwise({{near_, at_.top}, {near_, at_.mould_top}, {end_, at_.mould_top}, {end_, at_.top}}, 0.0),
      {reversed(around(0.0, y, radius)), reversed(around(0.0, -y, radius + c))});
  solid_.band(around(0.0, y, radius), around(-height, y, tip));
  solid_.face(around(-height, y, tip));
  solid_.band(reversed(around(height + c, -y, tip + c)), reversed(around(0.0, -y, radius + c)));
  solid_.face(around(height + c, -y, tip + c));
}

/// The ledge that lies on the carrier's plate, and the rim round it.
inline void MouldHalf::underside() {
  const double left = -at_.mould_x, seat = at_.seat, from = notches_.empty() ? left : at_.notch_outer;
  solid_.face(reversed(level({{at_.half_width, near_}, {at_.rim_x, near_}, {at_.rim_x, at_.rim_y}, {from, at_.rim_y},
                                 {from, end_}, {at_.half_width, end_}},
      seat)));
  if (!notches_.empty())
    for (const auto& [a, b] : {std::pair{left, -at_.notch_outer}, std::pair{-at_.notch_inner, at_.notch_inner}})
      solid_.face(reversed(rectangle(a, b, end_, at_.rim_y, seat)));
  solid_.face(reversed(level({{at_.rim_x, near_}, {at_.mould_x, near_}, {at_.mould_x, at_.mould_y}, {left, at_.mould_y},
                                 {left, at_.rim_y}, {at_.rim_x, at_.rim_y}},
      rim_)));
  solid_.face(reversed(lengthwise({{near_, rim_}, {at_.rim_y, rim_}, {at_.rim_y, seat}, {near_, seat}}, at_.rim_x)));
  Corners inner = stepped(seat, -o_.clearance);  // along its top
  std::reverse(inner.begin(), inner.end());
  inner.insert(inner.end(), {{left, rim_}, {at_.rim_x, rim_}, {at_.rim_x, seat}});
  solid_.face(upright(inner, at_.rim_y));
}

inline void MouldHalf::outside() {
  const double right = at_.mould_x, top = at_.mould_top, far = at_.mould_y;
  solid_.face(level({{0.0, near_}, {right, near_}, {right, far}, {-right, far}, {-right, end_}, {0.0, end_}}, top));
  solid_.face(lengthwise({{near_, rim_}, {far, rim_}, {far, top}, {near_, top}}, right));
  solid_.face(reversed(lengthwise(
      {{end_, at_.seat}, {at_.rim_y, at_.seat}, {at_.rim_y, rim_}, {far, rim_}, {far, top}, {end_, top}}, -right)));
  std::vector<Loop> holes;
  for (const Notch& n : notches_) holes.push_back(window(n, far));
  for (const Passage& p : passages_) holes.push_back(p.outside);
  solid_.face(reversed(upright({{-right, rim_}, {right, rim_}, {right, top}, {-right, top}}, far)), holes);
}

/// Through the end wall, open to the plate; the rim below it is a clearance lower, so that the core lies on the plate.
inline void MouldHalf::notches() {
  const double low = -o_.clearance, roof = at_.notch_roof, far = at_.mould_y;
  const Corners cheek{{end_, 0.0}, {at_.rim_y, 0.0}, {at_.rim_y, low}, {far, low}, {far, roof}, {end_, roof}};
  for (const auto& [a, b] : notches_) {
    solid_.face(lengthwise(cheek, a));
    solid_.face(reversed(lengthwise(cheek, b)));
    solid_.face(reversed(rectangle(a, b, end_, far, roof)));
    solid_.face(rectangle(a, b, at_.rim_y, far, low));
  }
}

}  // namespace detail

inline TriangleSurface mould_half_a(const HalfSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  TriangleSurface half = detail::MouldHalf(s, o, at.pour > 0.0).surface();
  for (Vec3d& v : half.vertices) v.y() += at.middle_y;
  return half;
}

inline TriangleSurface mould_half_b(const HalfSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  TriangleSurface half = detail::MouldHalf(s, o, at.pour < 0.0).surface();
  for (Vec3d& v : half.vertices) v = Vec3d(-v.x(), at.middle_y - v.y(), v.z());
  return half;
}

}  // namespace lumo

#endif

// ---- lumo/fabrication/three_mf.hpp
#ifndef SINGLE_INCLUDE_LUMO_FABRICATION_THREE_MF_HPP
#define SINGLE_INCLUDE_LUMO_FABRICATION_THREE_MF_HPP

namespace lumo {

/// A file within an archive.
struct ArchivedFile {
  std::string name;  ///< with its folders, as in "3D/3dmodel.model"
  std::string contents;
};

/// Packs files into the bytes of one .zip file. Laws: same files, same bits; unpacked, the files are the same. Throws
/// InputError.
template <class A>
concept Archiver = requires(const A& archiver, std::span<const ArchivedFile> files) {
  { archiver.pack(files) } -> std::same_as<std::string>;
};

/// A thing to be printed, `copies` times, standing on z = 0 with its corner at the origin.
struct PrintItem {
  std::string name;  ///< letters, digits, blanks and _ only
  TriangleSurface surface;
  int copies = 1;
};

/// The files of a 3MF package in mm: one object each, the copies beside each other, `spacing` [m] apart. Throws
/// InvalidArgument for a name with other characters. Source: 3MF Consortium, 3D Manufacturing Format Core
/// Specification 1.3; ECMA-376 part 2 (open packaging).
inline std::vector<ArchivedFile> three_mf_files(std::span<const PrintItem> items, double spacing = 5.0e-3);

/// The package in one. Throws InputError when the stream fails.
template <Archiver A> void write_3mf(std::ostream& out, std::span<const PrintItem> items, const A& archiver) {
  const std::string bytes = archiver.pack(three_mf_files(items));
  out.write(bytes.data(), std::streamsize(bytes.size()));
  if (!out) throw InputError("writing a .3mf file failed");
}

inline std::vector<ArchivedFile> three_mf_files(std::span<const PrintItem> items, double spacing) {
  std::string objects, build;
  double x = 0.0;
  for (std::size_t k = 0; k < items.size(); ++k) {
    const PrintItem& item = items[k];
    for (const char c : item.name)
      if (!((c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == ' ' || c == '_'))
        throw InvalidArgument(
            message("name of a printed part is '", item.name, "', must be of letters, digits, blanks and _"));
    const std::string id = std::to_string(k + 1);
    objects += "<object id=\"" + id + "\" type=\"model\" name=\"" + item.name + "\"><mesh><vertices>\n";
    double width = 0.0;
    for (const Vec3d& v : item.surface.vertices) {
      objects += "<vertex x=\"" + in_mm(v.x()) + "\" y=\"" + in_mm(v.y()) + "\" z=\"" + in_mm(v.z()) + "\"/>\n";
      width = std::max(width, v.x());
    }
    objects += "</vertices><triangles>\n";
    for (const auto& t : item.surface.triangles)
      objects += "<triangle v1=\"" + std::to_string(t[0]) + "\" v2=\"" + std::to_string(t[1]) + "\" v3=\"" +
                 std::to_string(t[2]) + "\"/>\n";
    objects += "</triangles></mesh></object>\n";
    for (int copy = 0; copy < item.copies; ++copy, x += width + spacing)
      build += "<item objectid=\"" + id + "\" transform=\"1 0 0 0 1 0 0 0 1 " + in_mm(x) + " 0 0\"/>\n";
  }
  const std::string xml = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
  return {
      {"[Content_Types].xml",
          xml + "<Types xmlns=\"http://schemas.openxmlformats.org/package/2006/content-types\">"
                "<Default Extension=\"rels\" ContentType=\"application/vnd.openxmlformats-package.relationships+xml\"/>"
                "<Default Extension=\"model\" "
                "ContentType=\"application/vnd.ms-package.3dmanufacturing-3dmodel+xml\"/></Types>\n"},
      {"_rels/.rels", xml +
                          "<Relationships xmlns=\"http://schemas.openxmlformats.org/package/2006/relationships\">"
                          "<Relationship Target=\"/3D/3dmodel.model\" Id=\"rel0\" "
                          "Type=\"http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel\"/></Relationships>\n"},
      {"3D/3dmodel.model", xml +
                               "<model unit=\"millimeter\" xml:lang=\"en\" "
                               "xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\">\n<resources>\n" +
                               objects + "</resources>\n<build>\n" + build + "</build>\n</model>\n"}};
}

}  // namespace lumo

#endif

// ---- lumo/fabrication/casting_kit.hpp
#ifndef SINGLE_INCLUDE_LUMO_FABRICATION_CASTING_KIT_HPP
#define SINGLE_INCLUDE_LUMO_FABRICATION_CASTING_KIT_HPP

namespace lumo {

/// A part to be printed.
struct CastingPart {
  std::string name;
  TriangleSurface assembled;  ///< where it is in the closed mould, the pad's frame [m]
  TriangleSurface printed;    ///< as it prints best: on z = 0, without supports, its corner at the origin [m]
  int copies = 1;
  bool stays = false;        ///< in the finger
  double volume_m3 = 0.0;    ///< of one
  Vec3d box{0.0, 0.0, 0.0};  ///< edges of the printed one's bounding box [m]
};

/// Silicone that a cast takes [m³].
struct CastVolume {
  double pad = 0.0;       ///< the design's, exact
  double fits = 0.0;      ///< clearance about a strip in the stem's top and at the carrier's ends, which fills up too
  double openings = 0.0;  ///< gate and vents up to the mould's outer face: cut off
  double total() const { return pad + fits + openings; }
};

/// All that one pad is made with: carrier, mould halves a and b, for a pad with voids the cores, and for a stem with
/// recesses the bar below its LED strip. Throws InvalidArgument, MeshError.
inline std::vector<CastingPart> casting_kit(const HalfSection& section, const CastingOptions& options = {});

inline CastVolume cast_volume(const HalfSection& section, const CastingOptions& options = {});

/// What a printer or a caster has to know about this finger beside docs/fabrication.md, a sentence each. Throws
/// InvalidArgument.
inline std::vector<std::string> casting_notes(const HalfSection& section, const CastingOptions& options = {});

/// Smallest angle [rad] between the opening direction and the faces of a mould half that touch the pad; negative: an
/// undercut. Faces of the half that lie within the pad's box are such.
inline double least_draft(const TriangleSurface& half, const HalfSection& section, const Vec3d& direction);

/// Along which mould half A comes off; half B goes the other way. Ten degrees out of the parting's normal are the draft
/// of the pad's ends.
inline Vec3d opening_direction(double angle = 10.0_deg) { return {std::cos(angle), std::sin(angle), 0.0}; }

namespace detail {

/// Turned by a rotation and moved to the corner of the printer's bed.
inline CastingPart print_part(std::string name, TriangleSurface surface, const Mat3d& turn) {
  CastingPart part{std::move(name), surface, std::move(surface)};
  for (Vec3d& v : part.printed.vertices) v = turn * v;
  const SurfaceReport report = validate_surface(part.printed);
  for (Vec3d& v : part.printed.vertices) v -= report.low;
  part.volume_m3 = report.volume;
  part.box = report.high - report.low;
  return part;
}

}  // namespace detail

inline std::vector<CastingPart> casting_kit(const HalfSection& s, const CastingOptions& o) {
  // A mould half stands on its end wall: the dome's curve is then drawn by the printer's axes and not stepped by its
  // layers.
  const Mat3d flat = Mat3d::Identity(), on_far_end = (Mat3d() << 1, 0, 0, 0, 0, 1, 0, -1, 0).finished(),
              on_near_end = (Mat3d() << 1, 0, 0, 0, 0, -1, 0, 1, 0).finished(),
              on_side = (Mat3d() << 0, 1, 0, 0, 0, 1, 1, 0, 0).finished();
  std::vector<CastingPart> kit;
  kit.push_back(detail::print_part("carrier", carrier_solid(s, o), flat));
  kit.back().stays = true;
  kit.push_back(detail::print_part("mould_a", mould_half_a(s, o), on_far_end));
  kit.push_back(detail::print_part("mould_b", mould_half_b(s, o), on_near_end));
  if (s.design.w_v > 0.0) {
    kit.push_back(detail::print_part("core", core_solid(s, o), on_side));
    kit.back().copies = 2;
  }
  if (CastingLayout(s, o).has_recesses()) {
    kit.push_back(detail::print_part("led_bar", led_bar_solid(s, o), on_side));
    kit.back().stays = true;
  }
  return kit;
}

inline CastVolume cast_volume(const HalfSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  CastVolume v{2.0 * s.exact_area_m2() * (1e-3 * s.pad.length), 0.0, 0.0};
  if (CastingLayout::has_cap(s)) v.pad += 2.0 * casting_cap_section(s).exact_area_m2() * (1e-3 * s.pad.cap_length);
  if (!at.has_recesses())
    v.fits = 4.0 * (at.pocket_x * at.pocket_y - 0.5 * o.strip_width * at.strip_y) * o.strip_height;
  const double ends = CastingLayout::has_cap(s) ? 0.5 * o.clearance : o.clearance;  // that the mould closes
  v.fits += (2.0 * at.stem_x * at.stem_height - 2.0 * at.block_x * at.seat) * ends;
  for (const Opening& opening : pour_openings(s, o)) v.openings += opening.volume_m3(at.mould_y - at.half_length);
  return v;
}

inline std::vector<std::string> casting_notes(const HalfSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  const auto mm = [](double length_m) { return short_number(1e3 * length_m); };
  std::vector<std::string> list;
  if (at.void_width > 0.0 && at.void_width < CastingOptions::thinnest_wall)
    list.push_back("the cores are " + mm(at.void_width) +
                   " mm thick, less than two lines of a 0.4 mm nozzle: cut them from sheet, by core.dxf");
  const double beside = at.stem_x - 0.5 * o.strip_width - o.clearance;
  if (beside < CastingOptions::thinnest_wall - 1e-9)
    list.push_back(
        "the carrier is " + mm(beside) + " mm thick beside the LED strip, less than two lines of a 0.4 mm nozzle");
  if (s.lies_on_stem())
    list.push_back("the silicone lies free on the stem: coat the stem's top" +
                   std::string(at.void_width > 0.0 ? "" : " and sides") +
                   (CastingLayout::has_cap(s) ? " and the carrier's end under the cap" : "") +
                   " with a release agent, and prime the other faces of the carrier that silicone touches");
  if (at.has_recesses())
    list.push_back("the recesses must stay full of air: before the stem is coated, cover each of the " +
                   std::to_string(o.leds.count) + ", " + mm(o.recess.length_y) + " mm long, with thin clear film");
  if (at.pour < 0.0)
    list.push_back(
        "the proximal end is poured: lean the mould with its plate down until silicone covers the stem's other "
        "end, below which air would stay");
  return list;
}

inline double least_draft(const TriangleSurface& half, const HalfSection& s, const Vec3d& direction) {
  constexpr double rounding = 1e-9;  // [m]
  const double width = s.half_width_m() + rounding, top = s.height_m() + rounding,
               length = 0.5 * s.length_m() + rounding, middle_y = 0.5e-3 * s.pad.cap_length,
               low = pad_outline(s).front()[1];
  double least = 0.5 * pi;
  for (const auto& t : half.triangles) {
    const Vec3d &a = half.vertices[std::size_t(t[0])], &b = half.vertices[std::size_t(t[1])],
                &c = half.vertices[std::size_t(t[2])];
    const Vec3d middle = (a + b + c) / 3.0;
    if (std::abs(middle.x()) > width || std::abs(middle.y() - middle_y) > length || middle.z() < low ||
        middle.z() > top)
      continue;
    const Vec3d normal = (b - a).cross(c - a).normalized();
    least = std::min(least, std::asin(std::clamp(-normal.dot(direction.normalized()), -1.0, 1.0)));
  }
  return least;
}

}  // namespace lumo

#endif

// ---- lumo/fabrication/stl.hpp
#ifndef SINGLE_INCLUDE_LUMO_FABRICATION_STL_HPP
#define SINGLE_INCLUDE_LUMO_FABRICATION_STL_HPP

namespace lumo {

/// The surface as a binary .stl file in mm, the format's unit by habit. Throws InputError when the stream fails.
/// Source: 3D Systems, StereoLithography Interface Specification, 1989: 80 bytes, the number of triangles, then 50
/// bytes each, little-endian.
inline void write_stl(std::ostream& out, const TriangleSurface& surface) {
  std::string bytes = "binary STL, mm, by lumo";  // not "solid", by which texts are known
  bytes.resize(80, ' ');
  const auto word = [&bytes](std::uint32_t value) {
    for (int shift = 0; shift < 32; shift += 8) bytes += char(value >> shift & 0xFFu);
  };
  const auto point = [&word](const Vec3d& p) {
    for (int i = 0; i < 3; ++i) word(std::bit_cast<std::uint32_t>(float(p[i])));
  };
  word(std::uint32_t(surface.triangles.size()));
  for (const auto& t : surface.triangles) {
    const std::array<Vec3d, 3> corner{1e3 * surface.vertices[std::size_t(t[0])],
        1e3 * surface.vertices[std::size_t(t[1])], 1e3 * surface.vertices[std::size_t(t[2])]};
    point((corner[1] - corner[0]).cross(corner[2] - corner[0]).normalized());
    for (const Vec3d& p : corner) point(p);
    bytes.append(2, '\0');
  }
  out.write(bytes.data(), std::streamsize(bytes.size()));
  if (!out) throw InputError("writing an .stl file failed");
}

}  // namespace lumo

#endif

// ---- lumo/fabrication.hpp
#ifndef SINGLE_INCLUDE_LUMO_FABRICATION_HPP
#define SINGLE_INCLUDE_LUMO_FABRICATION_HPP

// What casts a finger: kit, drawings, files for printers. Needs Eigen only.

#endif
