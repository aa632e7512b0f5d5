#pragma once

#include "lumo/geometry/triangle_tree.hpp"

#include <Eigen/Geometry>

#include <array>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

namespace lumo {

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
