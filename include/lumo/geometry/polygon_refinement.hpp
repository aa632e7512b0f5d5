#pragma once

#include "lumo/geometry/polygon_triangles.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <map>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

namespace lumo {

/// A simple polygon filled with well-shaped triangles of wanted size: Delaunay refinement after Ruppert 1995. Signs of
/// areas are exact, so that every state is a valid triangulation; whether a circle holds a point is rounded, which
/// costs at most quality. Same input, same bits. Own code: CGAL's meshes are heavy, Triangle is not free, and a mapped
/// sweep cannot follow a wanted size.
class PolygonRefinement {
 public:
  static constexpr std::size_t most_points = 200'000;
  struct Triangle {
    std::array<int, 3> corners;  ///< counter-clockwise
    std::array<int, 3> across;   ///< the triangle on the other side of the edge opposite to each corner, or −1
  };
  /// A piece of the outline from one point to the next, and the edge of the polygon that it is part of.
  struct Piece {
    int from, to, edge;
  };

  /// The polygon counter-clockwise, its corners the first points; edge i runs from corner i to the next. nullopt if
  /// it is not simple.
  static std::optional<PolygonRefinement> of(const std::vector<Point2>& polygon);

  /// Adds points until no triangle's circumradius is above that of an equilateral triangle of the wanted edge length,
  /// nor above √2 times its shortest edge, as far as points do not come closer than a tenth of both the wanted length
  /// and the polygon's shortest edge. False: there would be too many.
  bool refine(const std::function<double(const Point2&)>& edge_length);

  const std::vector<Point2>& points() const { return points_; }
  const std::vector<Triangle>& triangles() const { return triangles_; }
  std::vector<Piece> outline() const;

 private:
  struct Circle {
    Point2 center;
    double radius, shortest_edge;
  };
  struct Place {
    int triangle;
    bool beyond;  ///< the outline is in between, at `side`
    int side;
  };

  const Point2& at(int point) const { return points_[std::size_t(point)]; }
  Triangle& triangle(int t) { return triangles_[std::size_t(t)]; }
  const Triangle& triangle(int t) const { return triangles_[std::size_t(t)]; }
  static double distance(const Point2& a, const Point2& b) { return std::hypot(b[0] - a[0], b[1] - a[1]); }
  static std::pair<int, int> key(int a, int b) { return std::minmax(a, b); }
  static int corner_of(const Triangle& t, int neighbour) {
    return int(std::find(t.across.begin(), t.across.end(), neighbour) - t.across.begin());
  }

  std::pair<int, int> ends(int t, int k) const {
    return {triangle(t).corners[std::size_t(k + 1) % 3], triangle(t).corners[std::size_t(k + 2) % 3]};
  }  // of the edge opposite to corner k
  Circle circle(const Triangle& t) const;
  bool in_circle(const Triangle& t, const Point2& p) const;
  Place walk(int from, const Point2& p) const;
  void reconnect(int neighbour, int before, int now);
  bool flip(int t, int k);
  void settle(int point, std::vector<int>& changed);
  std::optional<std::pair<int, int>> encroached(int t, const Point2& p) const;
  void insert(int t, const Point2& p, std::vector<int>& changed);
  void split_inside(int t, const Point2& p, std::vector<int>& changed);
  void split_edge(int t, int k, const Point2& p, std::vector<int>& changed);
  bool split_outline(int t, int k, double closest, std::vector<int>& changed);

  std::vector<Point2> points_;
  std::vector<Triangle> triangles_;
  std::map<std::pair<int, int>, int> edge_of_;  // pieces of the outline
  double shortest_given_ = 0.0;
};

inline auto PolygonRefinement::of(const std::vector<Point2>& polygon) -> std::optional<PolygonRefinement> {
  if (polygon.size() < 3 || outline_crosses(polygon)) return std::nullopt;
  PolygonRefinement r;
  r.points_ = polygon;
  std::vector<int> loop;
  const int n = int(polygon.size());
  r.shortest_given_ = distance(polygon.back(), polygon.front());
  for (int i = 0; i < n; ++i) {
    loop.push_back(i);
    r.edge_of_[key(i, (i + 1) % n)] = i;
    r.shortest_given_ = std::min(r.shortest_given_, distance(r.at(i), r.at((i + 1) % n)));
  }
  std::vector<Vec3d> corners;
  for (const Point2& p : polygon) corners.emplace_back(p[0], p[1], 0.0);
  const auto cut = PolygonTriangles(corners, Vec3d(0, 0, 1)).cut(loop, {});
  if (!cut) return std::nullopt;
  std::map<std::pair<int, int>, std::pair<int, int>> waiting;  // directed edge → triangle and corner opposite
  for (const auto& ear : *cut) {
    const int t = int(r.triangles_.size());
    r.triangles_.push_back({ear, {-1, -1, -1}});
    for (int k = 0; k < 3; ++k) {
      const auto [a, b] = r.ends(t, k);
      if (const auto other = waiting.find({b, a}); other != waiting.end()) {
        r.triangle(t).across[std::size_t(k)] = other->second.first;
        r.triangle(other->second.first).across[std::size_t(other->second.second)] = t;
      }
      waiting[{a, b}] = {t, k};
    }
  }
  for (bool again = true; again;) {  // ears are cut as they come; a flip makes the least angle larger, so this ends
    again = false;
    for (int t = 0; t < int(r.triangles_.size()); ++t)
      for (int k = 0; k < 3; ++k) again = r.flip(t, k) || again;
  }
  return r;
}

inline auto PolygonRefinement::circle(const Triangle& t) const -> Circle {
  const Point2 &a = at(t.corners[0]), &b = at(t.corners[1]), &c = at(t.corners[2]);
  const double bx = b[0] - a[0], by = b[1] - a[1], cx = c[0] - a[0], cy = c[1] - a[1];
  const double bb = bx * bx + by * by, cc = cx * cx + cy * cy, twice = 2.0 * (bx * cy - by * cx);
  const double x = (cy * bb - by * cc) / twice, y = (bx * cc - cx * bb) / twice;
  return {{a[0] + x, a[1] + y}, std::hypot(x, y), std::min({std::sqrt(bb), std::sqrt(cc), distance(b, c)})};
}

/// Clearly inside, so that two triangles on one circle stay as they are.
inline bool PolygonRefinement::in_circle(const Triangle& t, const Point2& p) const {
  double rows[3][3];
  double size = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    const double x = at(t.corners[i])[0] - p[0], y = at(t.corners[i])[1] - p[1];
    rows[i][0] = x;
    rows[i][1] = y;
    rows[i][2] = x * x + y * y;
    size = std::max(size, rows[i][2]);
  }
  const auto minor = [&](int i, int j) { return rows[i][0] * rows[j][1] - rows[i][1] * rows[j][0]; };
  return rows[0][2] * minor(1, 2) + rows[1][2] * minor(2, 0) + rows[2][2] * minor(0, 1) > 1e-12 * size * size;
}

/// From triangle to triangle towards a point, as far as the outline allows.
inline auto PolygonRefinement::walk(int t, const Point2& p) const -> Place {
  for (std::size_t steps = 0; steps <= 4 * triangles_.size(); ++steps) {
    int next = -2, side = 0;
    for (int k = 0; k < 3 && next == -2; ++k)
      if (const auto [a, b] = ends(t, k); orient2d(at(a), at(b), p) < 0) {
        next = triangle(t).across[std::size_t(k)];
        side = k;
      }
    if (next == -2) return {t, false, 0};
    if (next == -1) return {t, true, side};
    t = next;
  }
  return {-1, false, 0};  // rounded circles may let a walk turn about
}

inline void PolygonRefinement::reconnect(int neighbour, int before, int now) {
  if (neighbour < 0) return;
  Triangle& n = triangle(neighbour);
  n.across[std::size_t(corner_of(n, before))] = now;
}

/// Exchanges the diagonal of the two triangles at the edge opposite to corner k, where that is better.
inline bool PolygonRefinement::flip(int t, int k) {
  const int other = triangle(t).across[std::size_t(k)];
  if (other < 0) return false;
  const int j = corner_of(triangle(other), t);
  const auto corner = [&](int of, int i) { return triangle(of).corners[std::size_t(i % 3)]; };
  const auto beyond = [&](int of, int i) { return triangle(of).across[std::size_t(i % 3)]; };
  const int apex = corner(t, k), a = corner(t, k + 1), b = corner(t, k + 2), far = corner(other, j);
  if (!in_circle(triangle(t), at(far)) || orient2d(at(apex), at(a), at(far)) <= 0 ||
      orient2d(at(apex), at(far), at(b)) <= 0)
    return false;
  // What lies across the four other edges; in `other` the common edge runs from b to a.
  const int b_apex = beyond(t, k + 1), apex_a = beyond(t, k + 2), a_far = beyond(other, j + 1),
            far_b = beyond(other, j + 2);
  triangle(t) = {{apex, a, far}, {a_far, other, apex_a}};
  triangle(other) = {{apex, far, b}, {far_b, b_apex, t}};
  reconnect(a_far, other, t);
  reconnect(b_apex, t, other);
  return true;
}

/// Lawson's flips around a new point.
inline void PolygonRefinement::settle(int point, std::vector<int>& changed) {
  for (std::size_t i = 0; i < changed.size(); ++i) {
    const auto& corners = triangle(changed[i]).corners;
    const auto found = std::find(corners.begin(), corners.end(), point);
    if (found == corners.end()) continue;
    const int k = int(found - corners.begin()), other = triangle(changed[i]).across[std::size_t(k)];
    if (!flip(changed[i], k)) continue;
    changed.push_back(changed[i]);
    changed.push_back(other);
  }
}

inline void PolygonRefinement::split_inside(int t, const Point2& p, std::vector<int>& changed) {
  const int point = int(points_.size()), second = int(triangles_.size()), third = second + 1;
  points_.push_back(p);
  const Triangle old = triangle(t);
  const auto [a, b, c] = old.corners;
  triangle(t) = {{point, b, c}, {old.across[0], second, third}};
  triangles_.push_back({{point, c, a}, {old.across[1], third, t}});
  triangles_.push_back({{point, a, b}, {old.across[2], t, second}});
  reconnect(old.across[1], t, second);
  reconnect(old.across[2], t, third);
  changed.insert(changed.end(), {t, second, third});
  settle(point, changed);
}

/// A point on the edge opposite to corner k; on the outline, too.
inline void PolygonRefinement::split_edge(int t, int k, const Point2& p, std::vector<int>& changed) {
  const int point = int(points_.size()), new_t = int(triangles_.size());
  points_.push_back(p);
  const auto corner = [&](int of, int i) { return triangle(of).corners[std::size_t(i % 3)]; };
  const auto beyond = [&](int of, int i) { return triangle(of).across[std::size_t(i % 3)]; };
  const int other = beyond(t, k), apex = corner(t, k), a = corner(t, k + 1), b = corner(t, k + 2),
            b_apex = beyond(t, k + 1), apex_a = beyond(t, k + 2);
  const int new_other = other < 0 ? -1 : new_t + 1;
  triangles_.push_back({{apex, point, b}, {other, b_apex, t}});
  reconnect(b_apex, t, new_t);
  if (other >= 0) {
    const int j = corner_of(triangle(other), t), far = corner(other, j), a_far = beyond(other, j + 1),
              far_b = beyond(other, j + 2);
    // `other` keeps the side of b, which lies against the new triangle.
    triangles_.push_back({{far, point, a}, {t, a_far, other}});
    reconnect(a_far, other, new_other);
    triangle(other) = {{far, b, point}, {new_t, new_other, far_b}};
    changed.insert(changed.end(), {other, new_other});
  }
  triangle(t) = {{apex, a, point}, {new_other, new_t, apex_a}};
  changed.insert(changed.end(), {t, new_t});
  if (const auto piece = edge_of_.find(key(a, b)); piece != edge_of_.end()) {
    const int edge = piece->second;
    edge_of_.erase(piece);
    edge_of_[key(a, point)] = edge_of_[key(point, b)] = edge;
  }
  settle(point, changed);
}

/// Halves the piece of the outline opposite to corner k, unless that brings points too close.
inline bool PolygonRefinement::split_outline(int t, int k, double closest, std::vector<int>& changed) {
  const auto [from, to] = ends(t, k);
  const Point2 a = at(from), b = at(to), apex = at(triangle(t).corners[std::size_t(k)]);
  if (0.5 * distance(a, b) < closest) return false;
  const Point2 middle{0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])};
  // The middle of a slanted edge is rounded: both halves must still face the apex.
  if (orient2d(apex, a, middle) <= 0 || orient2d(apex, middle, b) <= 0) return false;
  split_edge(t, k, middle, changed);
  return true;
}

/// The side of a triangle, if any, that is a piece of the outline and has the point in the circle about it: there the
/// point would leave a flat triangle. Looked for among the triangles that have the point in their circles, which hang
/// together about triangle t, where it lies.
inline std::optional<std::pair<int, int>> PolygonRefinement::encroached(int t, const Point2& p) const {
  std::vector<int> reached{t};
  for (std::size_t i = 0; i < reached.size(); ++i)
    for (int k = 0; k < 3; ++k) {
      const auto [a, b] = ends(reached[i], k);
      const int next = triangle(reached[i]).across[std::size_t(k)];
      if (next < 0) {
        if ((at(a)[0] - p[0]) * (at(b)[0] - p[0]) + (at(a)[1] - p[1]) * (at(b)[1] - p[1]) < 0.0)
          return std::pair(reached[i], k);
      } else if (in_circle(triangle(next), p) && std::find(reached.begin(), reached.end(), next) == reached.end()) {
        reached.push_back(next);
      }
    }
  return std::nullopt;
}

/// A point of the closed triangle.
inline void PolygonRefinement::insert(int t, const Point2& p, std::vector<int>& changed) {
  for (int k = 0; k < 3; ++k)
    if (const auto [a, b] = ends(t, k); orient2d(at(a), at(b), p) == 0) return split_edge(t, k, p, changed);
  split_inside(t, p, changed);
}

inline bool PolygonRefinement::refine(const std::function<double(const Point2&)>& edge_length) {
  std::vector<int> todo;
  for (int t = int(triangles_.size()); t-- > 0;) todo.push_back(t);
  std::vector<int> changed;
  while (!todo.empty()) {
    const int t = todo.back();
    todo.pop_back();
    const Circle round = circle(triangle(t));
    Point2 middle{};
    for (const int corner : triangle(t).corners) {
      middle[0] += at(corner)[0] / 3.0;
      middle[1] += at(corner)[1] / 3.0;
    }
    const double wanted = edge_length(middle);
    if (round.radius <= wanted / std::numbers::sqrt3 * 1.1 && round.radius <= std::numbers::sqrt2 * round.shortest_edge)
      continue;
    if (points_.size() >= most_points) return false;
    const double closest = 0.1 * std::min(wanted, shortest_given_);
    changed.clear();
    const Place place = walk(t, round.center);
    if (place.triangle < 0) continue;
    if (place.beyond) {
      split_outline(place.triangle, place.side, closest, changed);
    } else {
      if (const auto side = encroached(place.triangle, round.center))
        split_outline(side->first, side->second, closest, changed);
      else if (round.radius >= closest) insert(place.triangle, round.center, changed);
    }
    if (changed.empty()) continue;  // as good as the outline allows
    todo.push_back(t);
    todo.insert(todo.end(), changed.begin(), changed.end());
  }
  return true;
}

inline auto PolygonRefinement::outline() const -> std::vector<Piece> {
  std::vector<Piece> pieces;
  for (int t = 0; t < int(triangles_.size()); ++t)
    for (int k = 0; k < 3; ++k)
      if (const auto [a, b] = ends(t, k); triangle(t).across[std::size_t(k)] < 0)
        pieces.push_back({a, b, edge_of_.at(key(a, b))});
  return pieces;
}

}  // namespace lumo
