#pragma once

#include "lumo/mechanics/indenters/box.hpp"
#include "lumo/morphology/body.hpp"

#include <algorithm>
#include <limits>
#include <vector>

namespace lumo {

/// What a body rests on, as a signed distance: to the union of its rigid boxes, +infinity if there are none. The origin
/// of its frame is the finger's.
struct Carrier {
  std::vector<RigidBox> boxes;

  double distance(const Vec3d& p) const {
    double least = std::numeric_limits<double>::infinity();
    for (const RigidBox& b : boxes)
      if (may_be_nearer(b, p, least))
        least = std::min(least, rounded_box_distance(b.half, b.edge_radius, Vec3d(p - b.center)));
    return least;
  }
  DistanceSample sample(const Vec3d& p) const {
    DistanceSample nearest{std::numeric_limits<double>::infinity(), Vec3d::UnitZ(), Mat3d::Zero()};
    for (const RigidBox& b : boxes) {
      if (!may_be_nearer(b, p, nearest.distance)) continue;
      const DistanceSample d = distance_to_rounded_box(b.half, b.edge_radius, p - b.center);
      if (d.distance < nearest.distance) nearest = d;
    }
    return nearest;
  }

 private:
  /// Most of a surface's points are far from most boxes: the distance along one axis decides, but for rounding.
  static bool may_be_nearer(const RigidBox& b, const Vec3d& p, double distance) {
    return ((p - b.center).cwiseAbs() - b.half).maxCoeff() < distance + 1e-12;
  }
};

}  // namespace lumo
