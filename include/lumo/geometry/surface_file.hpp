#pragma once

#include "lumo/core/bytes.hpp"
#include "lumo/core/error.hpp"
#include "lumo/core/files.hpp"
#include "lumo/geometry/polygon_triangles.hpp"
#include "lumo/geometry/triangle_surface.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cstdint>
#include <cstring>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace lumo {

/// Reads a closed surface from a Wavefront .obj or a .stl file (text or binary), whose numbers are in units of `unit_m`
/// [m]; by default mm, as CAD writes them; the ending may be in capitals. Vertices at one place become one. Polygons of
/// an .obj, concave ones too, are cut into triangles. Throws InputError when the file is none, cannot be read or breaks
/// its format (with the line), MeshError when its surface does not bound a solid.
inline TriangleSurface read_surface(const std::string& path, double unit_m = 1e-3);

namespace detail {

/// Words of a text, line by line.
class SurfaceText {
 public:
  SurfaceText(std::string_view text, std::string name) : rest_(text), name_(std::move(name)) {}

  /// The words of the next line that has any, without a comment; none at the end.
  std::vector<std::string_view> next() {
    std::vector<std::string_view> words;
    while (words.empty() && !rest_.empty()) {
      const std::size_t end = std::min(rest_.find('\n'), rest_.size());
      std::string_view line = rest_.substr(0, end);
      rest_.remove_prefix(std::min(end + 1, rest_.size()));
      ++line_;
      line = line.substr(0, std::min(line.find('#'), line.size()));
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
  Vec3d point(const std::vector<std::string_view>& words, std::size_t first) const {
    if (words.size() < first + 3) refuse("a point needs three coordinates");
    return {number<double>(words[first]), number<double>(words[first + 1]), number<double>(words[first + 2])};
  }

 private:
  std::string_view rest_;
  std::string name_;
  int line_ = 0;
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

inline TriangleSurface read_obj(SurfaceText text) {
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
        loop.push_back(at);
      }
      add_polygon(s, loop);
    } else if (words[0] != "vn" && words[0] != "vt" && words[0] != "o" && words[0] != "g" && words[0] != "s" &&
               words[0] != "usemtl" && words[0] != "mtllib") {
      text.refuse(message("'", printable(words[0]), "' is no statement of a polygon surface"));
    }
  }
  return s;
}

inline TriangleSurface read_stl_text(SurfaceText text) {
  TriangleSurface s;
  const auto expect = [&](const std::vector<std::string_view>& words, std::initializer_list<std::string_view> wanted) {
    std::size_t k = 0;
    for (std::string_view w : wanted)
      if (k >= words.size() || words[k++] != w) text.refuse(message("'", w, "' was expected"));
  };
  expect(text.next(), {"solid"});
  for (;;) {
    const auto words = text.next();
    if (!words.empty() && words[0] == "endsolid") break;
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
  if (!text.next().empty()) text.refuse("there is more after 'endsolid'; one solid a file");
  return s;
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

}  // namespace detail

/// Reads a surface from a file's bytes; `kind`: ".obj" or ".stl", `name`: for messages. Throws as read_surface does.
inline TriangleSurface parse_surface(
    std::string_view kind, const std::string& bytes, const std::string& name, double unit_m) {
  TriangleSurface s;
  if (kind == ".obj") {
    s = detail::read_obj({bytes, name});
  } else {
    // A text, too, may begin with any 80 bytes; only the length distinguishes a binary file.
    const std::uint64_t count = bytes.size() >= 84 ? number_at<std::uint32_t>(&bytes[80], ByteOrder::little) : 0;
    if (bytes.size() >= 84 && bytes.size() == 84 + 50 * count) s = detail::read_stl_binary(bytes);
    else if (bytes.rfind("solid", 0) == 0) s = detail::read_stl_text({bytes, name});
    else
      throw InputError(message("surface file '", name, "' has ", bytes.size(), " bytes, a binary .stl of ", count,
          " triangles has ", 84 + 50 * count));
  }
  for (Vec3d& v : s.vertices) {
    if (!v.allFinite())
      throw InputError(message("surface file '", name, "': a coordinate is not finite"));  // before they are sorted
    v *= unit_m;
  }
  s = detail::welded(s);
  validate_surface(s);
  return s;
}

inline TriangleSurface read_surface(const std::string& path, double unit_m) {
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
