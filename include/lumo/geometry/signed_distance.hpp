#pragma once

#include "lumo/geometry/triangle_surface.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
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

/// Boxes about the triangles of a surface, for the distance to it. Own code: the promise is that lumo needs Eigen only.
class TriangleTree {
 public:
  explicit TriangleTree(const TriangleSurface& surface) {
    for (const auto& t : surface.triangles) {
      const auto at = [&](std::size_t k) -> const Vec3d& { return surface.vertices[std::size_t(t[k])]; };
      leaves_.push_back({{at(0), at(1), at(2)}, int(leaves_.size())});
    }
    if (!leaves_.empty()) build(0, int(leaves_.size()));
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
  struct Leaf {
    std::array<Vec3d, 3> corners;
    int triangle;
  };
  struct Node {
    std::array<double, 3> low{}, high{};  // corners of its box
    int first = 0, count = 0;             // leaves; count 0: the children are the next node and the one at `first`

    double squared_distance(const Vec3d& p) const {
      double sum = 0.0;
      for (std::size_t a = 0; a < 3; ++a) {
        const double off = std::max(std::max(low[a] - p[Eigen::Index(a)], p[Eigen::Index(a)] - high[a]), 0.0);
        sum += off * off;
      }
      return sum;
    }
  };

  int build(int begin, int end) {
    const int self = int(nodes_.size());
    Eigen::AlignedBox3d box;
    for (int i = begin; i < end; ++i)
      for (const Vec3d& corner : leaves_[std::size_t(i)].corners) box.extend(corner);
    const Vec3d low = box.min(), high = box.max();
    nodes_.push_back({{low[0], low[1], low[2]}, {high[0], high[1], high[2]}, begin, end - begin});
    if (end - begin <= 2) return self;
    int axis;
    box.sizes().maxCoeff(&axis);
    const auto middle = [&](const Leaf& t) { return t.corners[0][axis] + t.corners[1][axis] + t.corners[2][axis]; };
    const int half = (begin + end) / 2;
    std::nth_element(
        leaves_.begin() + begin, leaves_.begin() + half, leaves_.begin() + end, [&](const Leaf& a, const Leaf& b) {
          const double x = middle(a), y = middle(b);
          return x < y || (x == y && a.triangle < b.triangle);
        });
    build(begin, half);
    const int right = build(half, end);
    nodes_[std::size_t(self)].first = right;
    nodes_[std::size_t(self)].count = 0;
    return self;
  }

  void search(int self, const Vec3d& p, double& least, Nearest& best) const {
    const Node& n = nodes_[std::size_t(self)];
    if (n.count > 0) {
      for (int i = n.first; i < n.first + n.count; ++i) {
        const Leaf& t = leaves_[std::size_t(i)];
        const TrianglePoint on = closest_point(p, t.corners[0], t.corners[1], t.corners[2]);
        if (const double squared = (on.point - p).squaredNorm(); squared < least) {
          least = squared;
          best.triangle = t.triangle;
          best.at = on;
        }
      }
      return;
    }
    int near = self + 1, far = n.first;
    double to_near = nodes_[std::size_t(near)].squared_distance(p),
           to_far = nodes_[std::size_t(far)].squared_distance(p);
    if (to_far < to_near) {
      std::swap(near, far);
      std::swap(to_near, to_far);
    }
    if (to_near < least) search(near, p, least, best);
    if (to_far < least) search(far, p, least, best);
  }

  std::vector<Leaf> leaves_;
  std::vector<Node> nodes_;
};

/// Exact signed distance to a closed surface of triangles, negative inside. The sign is that of the outward direction
/// at the nearest place, with the normals of the triangles that meet there weighted by their angles. Source: Bærentzen
/// & Aanæs 2005. The surface must outlive it and be valid (unchecked). Of a point that is not finite, all is NaN.
class SignedDistance {
 public:
  explicit SignedDistance(const TriangleSurface& surface);

  /// Distance [m] with its first two derivatives; at the surface itself the gradient is the outward direction there.
  struct Sample {
    double distance;
    Vec3d gradient;
    Mat3d hessian;  ///< [1/m]
  };
  Sample sample(const Vec3d& p) const;

  /// Distance alone; `near`: a bound [m] that its size is known to keep.
  double distance(const Vec3d& p, double near = std::numeric_limits<double>::infinity()) const {
    const TriangleTree::Nearest n = tree_.nearest(p, near);
    if (n.triangle < 0) return p.allFinite() ? n.distance : std::numeric_limits<double>::quiet_NaN();
    return (p - n.at.point).dot(outward(n)) < 0.0 ? -n.distance : n.distance;
  }

 private:
  struct Normals {
    Vec3d own{0.0, 0.0, 0.0};
    std::array<Vec3d, 3> at_edge;  // sums with the neighbour's; by TrianglePoint's edges
  };

  const Vec3d& corner(const std::array<int, 3>& t, std::size_t k) const {
    return surface_->vertices[std::size_t(t[k])];
  }
  const Vec3d& outward(const TriangleTree::Nearest& n) const {
    const Normals& own = normals_[std::size_t(n.triangle)];
    if (n.at.feature == TrianglePoint::inside) return own.own;
    if (n.at.feature > 2) return own.at_edge[std::size_t(n.at.feature) - 3];
    return at_corner_[std::size_t(surface_->triangles[std::size_t(n.triangle)][std::size_t(n.at.feature)])];
  }

  const TriangleSurface* surface_;
  TriangleTree tree_;
  std::vector<Normals> normals_;
  std::vector<Vec3d> at_corner_;
};

inline SignedDistance::SignedDistance(const TriangleSurface& surface)
    : surface_(&surface),
      tree_(surface),
      normals_(surface.triangles.size()),
      at_corner_(surface.vertices.size(), Vec3d::Zero()) {
  std::map<std::pair<int, int>, Vec3d> at_edge;
  const auto edge = [&](const std::array<int, 3>& t, std::size_t k) -> Vec3d& {
    return at_edge.try_emplace(std::minmax(int(t[k]), int(t[(k + 1) % 3])), Vec3d::Zero()).first->second;
  };
  for (std::size_t i = 0; i < normals_.size(); ++i) {
    const auto& t = surface.triangles[i];
    const Vec3d n = (corner(t, 1) - corner(t, 0)).cross(corner(t, 2) - corner(t, 0)).normalized();
    normals_[i].own = n;
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3d forth = corner(t, (k + 1) % 3) - corner(t, k), back = corner(t, (k + 2) % 3) - corner(t, k);
      at_corner_[std::size_t(t[k])] += std::atan2(forth.cross(back).norm(), forth.dot(back)) * n;
      edge(t, k) += n;
    }
  }
  for (std::size_t i = 0; i < normals_.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k) normals_[i].at_edge[k] = edge(surface.triangles[i], k);
}

inline SignedDistance::Sample SignedDistance::sample(const Vec3d& p) const {
  const TriangleTree::Nearest n = tree_.nearest(p);
  if (n.triangle < 0) {
    constexpr double none = std::numeric_limits<double>::quiet_NaN();
    return {none, Vec3d::Constant(none), Mat3d::Constant(none)};
  }
  const Vec3d &out = outward(n), way = p - n.at.point;
  const double sign = way.dot(out) < 0.0 ? -1.0 : 1.0;
  Sample s{sign * n.distance, out.normalized(), Mat3d::Zero()};
  // A way that is as short as what rounding leaves of it has no direction.
  const double rounding = 8.0 * std::numeric_limits<double>::epsilon() * p.cwiseAbs().maxCoeff();
  if (n.at.feature == TrianglePoint::inside || !(n.distance > rounding)) return s;
  s.gradient = way / s.distance;
  // A plane's distance is straight, an edge's bends across it, a corner's all around.
  Mat3d turning = Mat3d::Identity() - s.gradient * s.gradient.transpose();
  if (n.at.feature > 2) {
    const auto& t = surface_->triangles[std::size_t(n.triangle)];
    const std::size_t k = std::size_t(n.at.feature) - 3;
    const Vec3d along = (corner(t, (k + 1) % 3) - corner(t, k)).normalized();
    turning -= along * along.transpose();
  }
  s.hessian = turning / s.distance;
  return s;
}

}  // namespace lumo
