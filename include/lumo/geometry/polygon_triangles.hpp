#pragma once

#include "lumo/geometry/facet_triangles.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

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
