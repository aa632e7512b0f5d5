#pragma once

#include "lumo/core/bytes.hpp"
#include "lumo/core/error.hpp"
#include "lumo/core/files.hpp"
#include "lumo/geometry/polygon_triangles.hpp"
#include "lumo/geometry/surface_mending.hpp"
#include "lumo/geometry/triangle_surface.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace lumo {

/// A surface from a file, and what had to be mended of it.
struct SurfaceFromFile : TriangleSurface {
  SurfaceMending mended;
};

/// What was mended, in one line for whoever reads the file; empty: nothing.
inline std::string mending_text(const SurfaceMending& mended);

/// Reads a closed surface from a Wavefront .obj or a .stl file (text or binary), whose numbers are in units of `unit_m`
/// [m]; by default mm, as CAD writes them; the ending may be in capitals. All solids of an .stl are read. Polygons of
/// an .obj, concave ones too, are cut into triangles; its lines, points and unused vertices are passed over.
///
/// Vertices at one place become one. What the file's own precision did to a closed surface is mended and reported:
/// corners beside their twins by a few steps of float32 or the last printed digit, facets without area. Nothing else
/// is: holes, crossings and edges of three facets are refused. Throws InputError when the file is none, cannot be read
/// or breaks its format (with the line), MeshError when its surface does not bound a solid (an open edge with its
/// place, in the file's own numbers).
inline SurfaceFromFile read_surface(const std::string& path, double unit_m = 1e-3);

namespace detail {

/// Words of a text, line by line.
class SurfaceText {
 public:
  /// `continued`: a line that ends with a backslash goes on in the next.
  SurfaceText(std::string_view text, std::string name, bool continued)
      : rest_(text), name_(std::move(name)), continued_(continued) {}

  /// The words of the next line that has any, without a comment; none at the end.
  std::vector<std::string_view> next() {
    std::vector<std::string_view> words;
    bool more = false;
    while ((more || words.empty()) && !rest_.empty()) {
      const std::size_t end = std::min(rest_.find('\n'), rest_.size());
      std::string_view line = rest_.substr(0, end);
      rest_.remove_prefix(std::min(end + 1, rest_.size()));
      ++line_;
      line = line.substr(0, std::min(line.find('#'), line.size()));
      const std::size_t last = line.find_last_not_of(" \t\r");
      more = continued_ && last != std::string_view::npos && line[last] == '\\';
      if (more) line = line.substr(0, last);
      for (;;) {
        const std::size_t begin = line.find_first_not_of(" \t\r");
        if (begin == std::string_view::npos) break;
        line.remove_prefix(begin);
        const std::size_t stop = std::min(line.find_first_of(" \t\r"), line.size());
        words.push_back(line.substr(0, stop));
        line.remove_prefix(stop);
      }
    }
    return words;
  }

  [[noreturn]] void refuse(const std::string& what) const {
    throw InputError(message("surface file '", name_, "', line ", line_, ": ", what));
  }

  template <class Number> Number number(std::string_view word) const {
    Number value{};
    if (!word.empty() && word.front() == '+') word.remove_prefix(1);
    const auto [end, fault] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (fault != std::errc{} || end != word.data() + word.size())
      refuse(message("'", printable(word), "' is no number"));
    return value;
  }
  Vec3d point(const std::vector<std::string_view>& words, std::size_t first) {
    if (words.size() < first + 3) refuse("a point needs three coordinates");
    Vec3d p;
    for (std::size_t a = 0; a < 3; ++a) {
      p[Eigen::Index(a)] = number<double>(words[first + a]);
      digits_ = std::max(digits_, significant_digits(words[first + a]));
    }
    return p;
  }

  /// Of the coordinate that was printed with most.
  int digits() const { return digits_; }

 private:
  static int significant_digits(std::string_view word) {
    int digits = 0;
    for (const char c : word.substr(0, word.find_first_of("eE")))
      if (c >= (digits > 0 ? '0' : '1') && c <= '9') ++digits;
    return digits;
  }

  std::string_view rest_;
  std::string name_;
  bool continued_;
  int line_ = 0, digits_ = 0;
};

/// Adds the triangles of a plane polygon; of one that crosses itself a fan, which is refused with its surface.
inline void add_polygon(TriangleSurface& surface, const std::vector<int>& loop) {
  std::vector<Vec3d> corners;
  std::vector<int> order;
  for (const int vertex : loop) {
    order.push_back(int(order.size()));
    corners.push_back(surface.vertices[std::size_t(vertex)]);
  }
  auto triangles = PolygonTriangles(corners, polygon_normal(corners, order)).cut(order, {});
  if (!triangles) {
    triangles.emplace();
    for (std::size_t k = 1; k + 1 < order.size(); ++k) triangles->push_back({0, order[k], order[k + 1]});
  }
  for (const auto& t : *triangles)
    surface.triangles.push_back({loop[std::size_t(t[0])], loop[std::size_t(t[1])], loop[std::size_t(t[2])]});
}

/// Statements of an .obj that say nothing about its facets: normals, groups, materials, loose lines and points.
inline constexpr std::array<std::string_view, 12> passed_over{
    "vn", "vt", "o", "g", "s", "mg", "l", "p", "usemtl", "mtllib", "usemap", "maplib"};

inline TriangleSurface read_obj(SurfaceText& text) {
  TriangleSurface s;
  for (auto words = text.next(); !words.empty(); words = text.next()) {
    if (words[0] == "v") {
      if (words.size() != 4 && words.size() != 5 && words.size() != 7)
        text.refuse("a vertex has 3 coordinates, and perhaps a weight or a colour");
      s.vertices.push_back(text.point(words, 1));
    } else if (words[0] == "f") {
      if (words.size() < 4) text.refuse("a face needs at least 3 corners");
      std::vector<int> loop;
      for (std::size_t k = 1; k < words.size(); ++k) {
        const int n = text.number<int>(words[k].substr(0, words[k].find('/'))), count = int(s.vertices.size()),
                  at = n < 0 ? count + n : n - 1;
        if (n == 0 || at < 0 || at >= count) text.refuse(message("a face names vertex ", n, " of ", count));
        if (loop.empty() || loop.back() != at) loop.push_back(at);
      }
      if (loop.size() > 1 && loop.front() == loop.back()) loop.pop_back();
      if (loop.size() > 2) add_polygon(s, loop);
    } else if (std::find(passed_over.begin(), passed_over.end(), words[0]) == passed_over.end()) {
      text.refuse(message("'", printable(words[0]), "' is no statement of a polygon surface"));
    }
  }
  return s;
}

/// One solid after the other, as one surface.
inline TriangleSurface read_stl_text(SurfaceText& text) {
  TriangleSurface s;
  const auto expect = [&](const std::vector<std::string_view>& words, std::initializer_list<std::string_view> wanted) {
    std::size_t k = 0;
    for (std::string_view w : wanted)
      if (k >= words.size() || words[k++] != w) text.refuse(message("'", w, "' was expected"));
  };
  expect(text.next(), {"solid"});
  for (;;) {
    const auto words = text.next();
    if (!words.empty() && words[0] == "endsolid") {
      const auto another = text.next();
      if (another.empty()) return s;
      expect(another, {"solid"});
      continue;
    }
    expect(words, {"facet", "normal"});
    expect(text.next(), {"outer", "loop"});
    const int first = int(s.vertices.size());
    for (int k = 0; k < 3; ++k) {
      const auto corner = text.next();
      expect(corner, {"vertex"});
      if (corner.size() != 4) text.refuse("a vertex has 3 coordinates");
      s.vertices.push_back(text.point(corner, 1));
    }
    s.triangles.push_back({first, first + 1, first + 2});
    expect(text.next(), {"endloop"});
    expect(text.next(), {"endfacet"});
  }
}

/// 80 bytes of anything, the number of triangles, then 50 bytes each: normal, three corners (little-endian float32), 2
/// bytes of anything.
inline TriangleSurface read_stl_binary(std::string_view bytes) {
  TriangleSurface s;
  for (std::size_t at = 84; at + 50 <= bytes.size(); at += 50) {
    const int first = int(s.vertices.size());
    for (std::size_t k = 0; k < 3; ++k) {
      Vec3d p;
      for (int i = 0; i < 3; ++i)
        p[i] = double(std::bit_cast<float>(
            number_at<std::uint32_t>(&bytes[at + 12 + 12 * k + 4 * std::size_t(i)], ByteOrder::little)));
      s.vertices.push_back(p);
    }
    s.triangles.push_back({first, first + 1, first + 2});
  }
  return s;
}

/// One vertex for each place, in order of first mention.
inline TriangleSurface welded(const TriangleSurface& loose) {
  TriangleSurface s;
  using Place = std::array<double, 3>;
  std::map<Place, int> known;
  std::vector<int> number;
  for (const Vec3d& v : loose.vertices) {
    const auto [it, fresh] =
        known.try_emplace(Place{v.x() + 0.0, v.y() + 0.0, v.z() + 0.0}, int(s.vertices.size()));  // −0 is 0
    if (fresh) s.vertices.push_back(v);
    number.push_back(it->second);
  }
  for (const auto& t : loose.triangles)
    s.triangles.push_back({number[std::size_t(t[0])], number[std::size_t(t[1])], number[std::size_t(t[2])]});
  return s;
}

/// How far twins of a corner may lie apart, in the file's numbers: some steps of float32 at the largest, or what the
/// last printed digit is worth there. Texts of few digits, such as whole numbers, are not that inexact.
inline double file_precision(const TriangleSurface& surface, int digits) {
  constexpr double steps = 4.0, float_step = 1.2e-7, coarsest = 1e-4;  // the last two of the largest coordinate
  double largest = 0.0;
  for (const auto& t : surface.triangles)
    for (const int n : t) largest = std::max(largest, surface.vertices[std::size_t(n)].cwiseAbs().maxCoeff());
  const double last_digit =
      digits > 0 && largest > 0.0 ? std::pow(10.0, std::floor(std::log10(largest)) + 1.0 - digits) : 0.0;
  return std::max(steps * float_step * largest, std::min(1.01 * last_digit, coarsest * largest));
}

/// Refuses a surface with open edges by the place of the first, in the file's numbers.
inline void require_closed(const TriangleSurface& surface, double precision, const std::string& name) {
  const std::vector<TriangleSide> open = open_sides(surface);
  if (open.empty()) return;
  const auto place = [&](int vertex) { return point_text(surface.vertices[std::size_t(vertex)]); };
  throw MeshError(
      MeshError::Reason::open, message("surface file '", name, "': the edge from ", place(open[0].from), " to ",
                                   place(open[0].to), " in the file's unit has 1 facet, must have 2; ", open.size(),
                                   " such edges; corners are joined up to ", precision, " apart"));
}

}  // namespace detail

inline std::string mending_text(const SurfaceMending& mended) {
  std::string text;
  const auto add = [&](int count, const char* one, const char* many, const std::string& how) {
    if (count > 0) text += message(text.empty() ? "" : ", ", count, ' ', count == 1 ? one : many, how);
  };
  add(mended.joined, "corner", "corners", message(" joined to twins at most ", 1e3 * mended.farthest_m, " mm away"));
  add(mended.dropped, "facet", "facets", " without area dropped");
  add(mended.split, "edge", "edges", " split at corners on them");
  return text.empty() ? text : "surface mended: " + text;
}

/// Reads a surface from a file's bytes; `kind`: ".obj" or ".stl", `name`: for messages. Throws as read_surface does.
inline SurfaceFromFile parse_surface(
    std::string_view kind, const std::string& bytes, const std::string& name, double unit_m) {
  SurfaceFromFile s;
  TriangleSurface& surface = s;
  detail::SurfaceText text(bytes, name, kind == ".obj");
  if (kind == ".obj") {
    surface = detail::read_obj(text);
  } else {
    // A text, too, may begin with any 80 bytes; only the length distinguishes a binary file.
    const std::uint64_t count = bytes.size() >= 84 ? number_at<std::uint32_t>(&bytes[80], ByteOrder::little) : 0;
    if (bytes.size() >= 84 && bytes.size() == 84 + 50 * count) surface = detail::read_stl_binary(bytes);
    else if (bytes.rfind("solid", 0) == 0) surface = detail::read_stl_text(text);
    else
      throw InputError(message("surface file '", name, "' has ", bytes.size(), " bytes, a binary .stl of ", count,
          " triangles has ", 84 + 50 * count));
  }
  for (const Vec3d& v : surface.vertices)
    if (!v.allFinite())
      throw InputError(message("surface file '", name, "': a coordinate is not finite"));  // before they are sorted
  surface = detail::welded(surface);
  const double precision = detail::file_precision(surface, text.digits());
  s.mended = SurfaceMender(surface, precision).mend();
  s.mended.farthest_m *= unit_m;
  detail::require_closed(surface, precision, name);
  for (Vec3d& v : surface.vertices) v *= unit_m;
  validate_surface(surface);
  return s;
}

inline SurfaceFromFile read_surface(const std::string& path, double unit_m) {
  require_in_range("unit of a surface file", unit_m, 1e-9, 1e3, "m");
  const std::size_t dot = std::min(path.find_last_of("./"), path.size());
  std::string kind = path.substr(dot);
  for (char& c : kind) c = c >= 'A' && c <= 'Z' ? char(c - 'A' + 'a') : c;
  if (kind != ".obj" && kind != ".stl")
    throw InputError(message("surface file '", path, "': its name must end in .obj or .stl"));
  const auto size = file_size(path);
  if (!size) throw InputError(message("cannot read surface file '", path, "': there is no such file"));
  constexpr std::uintmax_t most = 500'000'000;
  if (*size > most) throw InputError(message("surface file '", path, "' is larger than ", most, " bytes"));
  const auto bytes = read_whole(path);
  if (!bytes) throw InputError(message("cannot read surface file '", path, "'"));
  return parse_surface(kind, *bytes, path, unit_m);
}

}  // namespace lumo
