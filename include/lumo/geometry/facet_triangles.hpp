#pragma once

#include "lumo/core/types.hpp"
#include "lumo/geometry/predicates.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

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
