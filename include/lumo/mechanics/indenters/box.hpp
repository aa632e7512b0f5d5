#pragma once

#include "lumo/mechanics/indenters/indenter.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lumo {

/// Signed distance from p to the box |x| ≤ half about the origin.
template <class S> S box_distance(const Vec3d& half, const Vec3<S>& p) {
  using std::abs;
  Vec3<S> out;
  S most = -std::numeric_limits<double>::infinity();
  for (int i = 0; i < 3; ++i) {
    const S beyond = abs(p[i]) - half[i];
    out[i] = beyond < 0.0 ? S(0.0) : beyond;
    if (i == 0 || beyond > most) most = beyond;
  }
  return most <= 0.0 ? most : S(out.norm());
}

/// The same with its derivatives.
inline DistanceSample distance_to_box(const Vec3d& half, const Vec3d& p) {
  Vec3d sign, beyond, out;
  int axis = 0;
  for (int i = 0; i < 3; ++i) {
    sign[i] = p[i] < 0.0 ? -1.0 : 1.0;
    beyond[i] = std::abs(p[i]) - half[i];
    out[i] = std::max(beyond[i], 0.0);
    if (beyond[i] > beyond[axis]) axis = i;
  }
  if (beyond[axis] <= 0.0) {
    Vec3d n = Vec3d::Zero();
    n[axis] = sign[axis];
    return {beyond[axis], n, Mat3d::Zero()};
  }
  const double r = out.norm();
  Vec3d n = out / r;
  Mat3d h = Mat3d::Zero();  // only the directions that are outside bend the distance
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      if (out[i] > 0.0 && out[j] > 0.0) h(i, j) = ((i == j ? 1.0 : 0.0) - n[i] * n[j]) / r * sign[i] * sign[j];
  for (int i = 0; i < 3; ++i) n[i] *= sign[i];
  return {r, n, h};
}

/// Distances to a box of half edges `half` whose edges and corners are rounded, inside it, by `radius`.
template <class S> S rounded_box_distance(const Vec3d& half, double radius, const Vec3<S>& p) {
  return box_distance(Vec3d(half - Vec3d::Constant(radius)), p) - radius;
}
inline DistanceSample distance_to_rounded_box(const Vec3d& half, double radius, const Vec3d& p) {
  DistanceSample d = distance_to_box(half - Vec3d::Constant(radius), p);
  d.distance -= radius;
  return d;
}

/// Rigid box with edges along the finger's axes, rounded where `edge_radius_m` > 0. Sharp edges concentrate stress
/// without limit: round them.
struct Box {
  Vec3d size_m{10e-3, 10e-3, 10e-3};
  double edge_radius_m = 0.5e-3;

  bool operator==(const Box&) const = default;

  double radius_m() const { return 0.5 * size_m.norm(); }
  double contact_radius_m() const { return 0.5 * size_m.minCoeff(); }
  bool symmetric(int) const { return true; }
  template <class S> S distance(const Vec3<S>& p) const {
    return rounded_box_distance(Vec3d(0.5 * size_m), edge_radius_m, p);
  }
  DistanceSample sample(const Vec3d& p) const { return distance_to_rounded_box(0.5 * size_m, edge_radius_m, p); }
};

inline void validate(const Box& b) {
  for (double side : {b.size_m.x(), b.size_m.y(), b.size_m.z()})
    require_in_range("box side", side * 1e3, 0.1, 1000.0, "mm");
  require_in_range("edge radius of the box", b.edge_radius_m * 1e3, 0.0, 0.499 * b.size_m.minCoeff() * 1e3, "mm");
}

static_assert(Indenter<Box>);

}  // namespace lumo
