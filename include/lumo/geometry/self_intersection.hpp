#pragma once

#include "lumo/geometry/facet_triangles.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <optional>
#include <utility>
#include <vector>

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
