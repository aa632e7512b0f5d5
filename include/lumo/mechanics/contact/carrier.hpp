#pragma once

#include "lumo/mechanics/indenters/box.hpp"
#include "lumo/morphology/body.hpp"

#include <algorithm>
#include <limits>
#include <vector>

namespace lumo {

/// Signed distance to the union of a body's rigid boxes. The origin of its frame is the finger's.
struct Carrier {
  std::vector<RigidBox> boxes;

  double distance(const Vec3d& p) const {
    double least = std::numeric_limits<double>::infinity();
    for (const RigidBox& b : boxes) least = std::min(least, box_distance(b.half, p - b.center));
    return least;
  }
  DistanceSample sample(const Vec3d& p) const {
    DistanceSample nearest{std::numeric_limits<double>::infinity(), Vec3d::UnitZ(), Mat3d::Zero()};
    for (const RigidBox& b : boxes)
      if (const DistanceSample d = distance_to_box(b.half, p - b.center); d.distance < nearest.distance) nearest = d;
    return nearest;
  }
};

}  // namespace lumo
