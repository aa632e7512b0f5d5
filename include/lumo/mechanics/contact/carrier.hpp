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

  template <class Vec3 = Vec3>
  double distance(In<Vec3> p) const {
    double least = std::numeric_limits<double>::infinity();
    for (const RigidBox& b : boxes) least = std::min(least, to_box(b, p).distance);
    return least;
  }
  template <class Vec3 = Vec3, class Mat3 = Mat3>
  DistanceSample sample(In<Vec3> p) const {
    DistanceSample nearest{std::numeric_limits<double>::infinity(), Vec3::UnitZ(), Mat3::Zero()};
    for (const RigidBox& b : boxes)
      if (const DistanceSample d = to_box(b, p); d.distance < nearest.distance) nearest = d;
    return nearest;
  }

 private:
  template <class Vec3 = Vec3>
  static DistanceSample to_box(const RigidBox& b, In<Vec3> p) { return detail::distance_to_box(b.half, p - b.center); }
};

}  // namespace lumo
