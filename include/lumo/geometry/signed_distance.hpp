#pragma once

#include "lumo/geometry/triangle_surface.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <utility>
#include <vector>

namespace lumo {

/// Where on a triangle abc a point is nearest to another, and on what of it.
struct TrianglePoint {
  Vec3d point{0.0, 0.0, 0.0};
  int feature = inside;  ///< corner a, b, c: 0, 1, 2; edge ab, bc, ca: 3, 4, 5; or
  static constexpr int inside = 6;
};

/// Point of the triangle abc nearest to p. Source: Ericson 2005, §5.1.5.
inline TrianglePoint closest_point(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  const Vec3d ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0.0 && d2 <= 0.0) return {a, 0};
  const Vec3d bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0.0 && d4 <= d3) return {b, 1};
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return {a + d1 / (d1 - d3) * ab, 3};
  const Vec3d cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0.0 && d5 <= d6) return {c, 2};
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return {a + d2 / (d2 - d6) * ac, 5};
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0.0 && d4 >= d3 && d5 >= d6) return {b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b), 4};
  const double scale = 1.0 / (va + vb + vc);
  return {a + vb * scale * ab + vc * scale * ac, TrianglePoint::inside};
}

inline Vec3d closest_on_triangle(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  return closest_point(p, a, b, c).point;
}

/// Boxes about the triangles of a surface, for the distance to it. The surface must outlive the tree. Own code: the
/// promise is that lumo needs Eigen only.
class TriangleTree {
 public:
  explicit TriangleTree(const TriangleSurface& surface) : surface_(&surface), order_(surface.triangles.size()) {
    std::iota(order_.begin(), order_.end(), 0);
    if (!order_.empty()) build(0, int(order_.size()));
  }

  /// The place on the surface that is nearest to a point.
  struct Nearest {
    int triangle = -1;  ///< −1: there is none so near
    TrianglePoint at;
    double distance = std::numeric_limits<double>::infinity();  ///< unsigned [m]
  };

  /// Looks no farther than `near` [m] from p.
  Nearest nearest(const Vec3d& p, double near = std::numeric_limits<double>::infinity()) const {
    Nearest best;
    double least = near * near;
    if (!nodes_.empty()) search(0, p, least, best);
    best.distance = std::sqrt(least);
    return best;
  }

  /// Unsigned distance [m] from p to the surface; `near` or more when it is farther than that.
  double distance(const Vec3d& p, double near = std::numeric_limits<double>::infinity()) const {
    return nearest(p, near).distance;
  }

 private:
  struct Node {
    Vec3d low, high;   ///< corners of its box
    int first, count;  ///< triangles of a leaf; count 0: the children are at `first` and `second`
    int second;
  };

  const Vec3d& corner(int triangle, std::size_t k) const {
    return surface_->vertices[std::size_t(surface_->triangles[std::size_t(triangle)][k])];
  }

  int build(int begin, int end) {
    const int self = int(nodes_.size());
    nodes_.push_back({{}, {}, begin, end - begin, -1});
    Eigen::AlignedBox3d box;
    for (int i = begin; i < end; ++i)
      for (std::size_t k = 0; k < 3; ++k) box.extend(corner(order_[std::size_t(i)], k));
    nodes_[std::size_t(self)].low = box.min();
    nodes_[std::size_t(self)].high = box.max();
    if (end - begin <= 4) return self;
    int axis;
    box.sizes().maxCoeff(&axis);
    const auto middle = [&](int t) { return corner(t, 0)[axis] + corner(t, 1)[axis] + corner(t, 2)[axis]; };
    const int half = (begin + end) / 2;
    std::nth_element(order_.begin() + begin, order_.begin() + half, order_.begin() + end, [&](int a, int b) {
      const double x = middle(a), y = middle(b);
      return x < y || (x == y && a < b);
    });
    const int left = build(begin, half), right = build(half, end);
    nodes_[std::size_t(self)].first = left;
    nodes_[std::size_t(self)].count = 0;
    nodes_[std::size_t(self)].second = right;
    return self;
  }

  void search(int at, const Vec3d& p, double& least, Nearest& best) const {
    const Node& n = nodes_[std::size_t(at)];
    if (n.count > 0) {
      for (int i = n.first; i < n.first + n.count; ++i) {
        const int t = order_[std::size_t(i)];
        const TrianglePoint on = closest_point(p, corner(t, 0), corner(t, 1), corner(t, 2));
        if (const double squared = (on.point - p).squaredNorm(); squared < least) {
          least = squared;
          best.triangle = t;
          best.at = on;
        }
      }
      return;
    }
    int near = n.first, far = n.second;
    const auto away = [&](const Node& child) {
      return Eigen::AlignedBox3d(child.low, child.high).squaredExteriorDistance(p);
    };
    double to_near = away(nodes_[std::size_t(near)]), to_far = away(nodes_[std::size_t(far)]);
    if (to_far < to_near) {
      std::swap(near, far);
      std::swap(to_near, to_far);
    }
    if (to_near < least) search(near, p, least, best);
    if (to_far < least) search(far, p, least, best);
  }

  const TriangleSurface* surface_;
  std::vector<int> order_;
  std::vector<Node> nodes_;
};

/// Exact signed distance to a closed surface of triangles, negative inside. The sign is that of the outward direction
/// at the nearest place, with the normals of the triangles that meet there weighted by their angles. Source: Bærentzen
/// & Aanæs 2005. The surface must outlive it and be valid (unchecked).
class SignedDistance {
 public:
  explicit SignedDistance(const TriangleSurface& surface)
      : surface_(&surface), tree_(surface), at_corner_(surface.vertices.size(), Vec3d::Zero()) {
    for (const auto& t : surface.triangles) {
      const Vec3d n = (corner(t, 1) - corner(t, 0)).cross(corner(t, 2) - corner(t, 0)).normalized();
      normal_.push_back(n);
      for (std::size_t k = 0; k < 3; ++k) {
        const Vec3d forth = corner(t, (k + 1) % 3) - corner(t, k), back = corner(t, (k + 2) % 3) - corner(t, k);
        at_corner_[std::size_t(t[k])] += std::atan2(forth.cross(back).norm(), forth.dot(back)) * n;
        at_edge_.try_emplace(key(t, k), Vec3d::Zero()).first->second += n;
      }
    }
  }

  /// Distance [m] with its first two derivatives; at the surface itself the gradient is the outward direction there.
  struct Sample {
    double distance;
    Vec3d gradient;
    Mat3d hessian;  ///< [1/m]
  };
  Sample sample(const Vec3d& p) const {
    const TriangleTree::Nearest n = tree_.nearest(p);
    const Vec3d out = outward(n), way = p - n.at.point;
    const double sign = way.dot(out) < 0.0 ? -1.0 : 1.0;
    Sample s{
        sign * n.distance, n.distance > 0.0 ? Vec3d(sign / n.distance * way) : Vec3d(out.normalized()), Mat3d::Zero()};
    if (n.at.feature == TrianglePoint::inside || !(n.distance > 0.0)) return s;
    Mat3d turning =
        Mat3d::Identity() -
        s.gradient *
            s.gradient.transpose();  // a plane's distance is straight, an edge's bends across it, a corner's all around
    if (n.at.feature > 2) {
      const auto& t = surface_->triangles[std::size_t(n.triangle)];
      const std::size_t k = std::size_t(n.at.feature) - 3;
      const Vec3d &end = corner(t, (k + 1) % 3), &start = corner(t, k), along = (end - start).normalized();
      turning -= along * along.transpose();
    }
    s.hessian = turning / s.distance;
    return s;
  }

  /// Distance alone; `near`: a bound [m] that its size is known to keep.
  double distance(const Vec3d& p, double near = std::numeric_limits<double>::infinity()) const {
    const TriangleTree::Nearest n = tree_.nearest(p, near);
    return n.triangle >= 0 && (p - n.at.point).dot(outward(n)) < 0.0 ? -n.distance : n.distance;
  }

 private:
  const Vec3d& corner(const std::array<int, 3>& t, std::size_t k) const {
    return surface_->vertices[std::size_t(t[k])];
  }
  static std::pair<int, int> key(const std::array<int, 3>& t, std::size_t k) {
    return std::minmax(int(t[k]), int(t[(k + 1) % 3]));
  }

  Vec3d outward(const TriangleTree::Nearest& n) const {
    const auto& t = surface_->triangles[std::size_t(n.triangle)];
    if (n.at.feature < 3) return at_corner_[std::size_t(t[std::size_t(n.at.feature)])];
    if (n.at.feature < TrianglePoint::inside) return at_edge_.at(key(t, std::size_t(n.at.feature) - 3));
    return normal_[std::size_t(n.triangle)];
  }

  const TriangleSurface* surface_;
  TriangleTree tree_;
  std::vector<Vec3d> normal_, at_corner_;
  std::map<std::pair<int, int>, Vec3d> at_edge_;
};

}  // namespace lumo
