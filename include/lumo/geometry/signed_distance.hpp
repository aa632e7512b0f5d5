#pragma once

#include "lumo/geometry/triangle_tree.hpp"

#include <Eigen/Geometry>

#include <array>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

namespace lumo {

/// Exact signed distance to a closed surface of triangles, negative inside. The sign is that of the outward direction at the nearest place, with the normals
/// of the triangles that meet there weighted by their angles. Source: Bærentzen & Aanæs 2005. The surface must outlive it and be valid (unchecked).
class SignedDistance {
 public:
  template <class Vec3 = Vec3>
  explicit SignedDistance(const TriangleSurface& surface) : surface_(&surface), tree_(surface), at_corner_(surface.vertices.size(), Vec3::Zero()) {
    for (const auto& t : surface.triangles) {
      const Vec3 n = (corner(t, 1) - corner(t, 0)).cross(corner(t, 2) - corner(t, 0)).normalized();
      normal_.push_back(n);
      for (std::size_t k = 0; k < 3; ++k) {
        const Vec3 forth = corner(t, (k + 1) % 3) - corner(t, k), back = corner(t, (k + 2) % 3) - corner(t, k);
        at_corner_[std::size_t(t[k])] += std::atan2(forth.cross(back).norm(), forth.dot(back)) * n;
        at_edge_.try_emplace(key(t, k), Vec3::Zero()).first->second += n;
      }
    }
  }

  /// Distance [m] with its first two derivatives; at the surface itself the gradient is the outward direction there.
  struct Sample {
    double distance;
    Vec3 gradient;
    Mat3 hessian;   ///< [1/m]
  };
  template <class Vec3 = Vec3, class Mat3 = Mat3, class Sample = Sample>
  Sample sample(In<Vec3> p) const {
    const TriangleTree::Nearest n = tree_.nearest(p);
    const Vec3 out = outward(n), way = p - n.at.point;
    const double sign = way.dot(out) < 0.0 ? -1.0 : 1.0;
    Sample s{sign * n.distance, n.distance > 0.0 ? Vec3(sign / n.distance * way) : Vec3(out.normalized()), Mat3::Zero()};
    if (n.at.feature == TrianglePoint::inside || !(n.distance > 0.0)) return s;
    Mat3 turning = Mat3::Identity() - s.gradient * s.gradient.transpose();   // a plane's distance is straight, an edge's bends across it, a corner's all around
    if (n.at.feature > 2) {
      const auto& t = surface_->triangles[std::size_t(n.triangle)];
      const std::size_t k = std::size_t(n.at.feature) - 3;
      const Vec3 &end = corner(t, (k + 1) % 3), &start = corner(t, k), along = (end - start).normalized();
      turning -= along * along.transpose();
    }
    s.hessian = turning / s.distance;
    return s;
  }

  /// Distance alone; `near`: a bound [m] that its size is known to keep.
  template <class Vec3 = Vec3>
  double distance(In<Vec3> p, double near = std::numeric_limits<double>::infinity()) const {
    const TriangleTree::Nearest n = tree_.nearest(p, near);
    return n.triangle >= 0 && (p - n.at.point).dot(outward(n)) < 0.0 ? -n.distance : n.distance;
  }

 private:
  const Vec3& corner(const std::array<int, 3>& t, std::size_t k) const { return surface_->vertices[std::size_t(t[k])]; }
  static std::pair<int, int> key(const std::array<int, 3>& t, std::size_t k) { return std::minmax(int(t[k]), int(t[(k + 1) % 3])); }

  template <class = void>
  Vec3 outward(const TriangleTree::Nearest& n) const {
    const auto& t = surface_->triangles[std::size_t(n.triangle)];
    if (n.at.feature < 3) return at_corner_[std::size_t(t[std::size_t(n.at.feature)])];
    if (n.at.feature < TrianglePoint::inside) return at_edge_.at(key(t, std::size_t(n.at.feature) - 3));
    return normal_[std::size_t(n.triangle)];
  }

  const TriangleSurface* surface_;
  TriangleTree tree_;
  std::vector<Vec3> normal_, at_corner_;
  std::map<std::pair<int, int>, Vec3> at_edge_;
};

}  // namespace lumo
