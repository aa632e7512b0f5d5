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
      least = std::min(least, rounded_box_distance(b.half, b.edge_radius, Vec3d(p - b.center)));
    return least;
  }
  DistanceSample sample(const Vec3d& p) const {
    DistanceSample nearest{std::numeric_limits<double>::infinity(), Vec3d::UnitZ(), Mat3d::Zero()};
    for (const RigidBox& b : boxes)
      if (const DistanceSample d = distance_to_rounded_box(b.half, b.edge_radius, p - b.center);
          d.distance < nearest.distance)
        nearest = d;
    return nearest;
  }
};

}  // namespace lumo
