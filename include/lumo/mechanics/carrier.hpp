#pragma once

#include "lumo/mechanics/indenter.hpp"
#include "lumo/morphology/body.hpp"

#include <algorithm>
#include <vector>

namespace lumo {

/// Signed distance to the union of a body's rigid boxes. The origin of its frame is the finger's.
struct Carrier {
  std::vector<RigidBox> boxes;

  double distance(const Vec3& p) const {
    double least = std::numeric_limits<double>::infinity();
    for (const RigidBox& b : boxes) least = std::min(least, to_box(b, p).distance);
    return least;
  }
  DistanceSample sample(const Vec3& p) const {
    DistanceSample nearest{std::numeric_limits<double>::infinity(), Vec3::UnitZ(), Mat3::Zero()};
    for (const RigidBox& b : boxes)
      if (const DistanceSample d = to_box(b, p); d.distance < nearest.distance) nearest = d;
    return nearest;
  }

 private:
  static DistanceSample to_box(const RigidBox& b, const Vec3& p) {
    const Vec3 local = p - b.center;
    const Vec3 sign = local.unaryExpr([](double v) { return v < 0.0 ? -1.0 : 1.0; });
    const Vec3 q = local.cwiseAbs() - b.half;
    int axis;
    if (const double inside = q.maxCoeff(&axis); inside <= 0.0) return {inside, sign[axis] * Vec3::Unit(axis), Mat3::Zero()};
    const Vec3 out = q.cwiseMax(0.0);
    const double r = out.norm();
    const Vec3 n = out / r;
    Mat3 h = Mat3::Zero();  // only the directions that are outside bend the distance
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        if (out[i] > 0.0 && out[j] > 0.0) h(i, j) = ((i == j ? 1.0 : 0.0) - n[i] * n[j]) / r * sign[i] * sign[j];
    return {r, n.cwiseProduct(sign), h};
  }
};

}  // namespace lumo
