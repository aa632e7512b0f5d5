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
    for (const RigidBox& b : boxes) least = std::min(least, box_distance(core(b), p - b.center) - b.edge_radius);
    return least;
  }
  DistanceSample sample(const Vec3d& p) const {
    DistanceSample nearest{std::numeric_limits<double>::infinity(), Vec3d::UnitZ(), Mat3d::Zero()};
    for (const RigidBox& b : boxes) {
      DistanceSample d = distance_to_box(core(b), p - b.center);
      d.distance -= b.edge_radius;
      if (d.distance < nearest.distance) nearest = d;
    }
    return nearest;
  }

 private:
  static Vec3d core(const RigidBox& b) { return b.half - Vec3d::Constant(b.edge_radius); }  // the box without its rim
};

}  // namespace lumo
