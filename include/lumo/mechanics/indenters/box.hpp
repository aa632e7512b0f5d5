#pragma once

#include "lumo/mechanics/indenters/indenter.hpp"

#include <algorithm>
#include <cmath>

namespace lumo {

namespace detail {

/// Signed distance from p to the box |x| ≤ half about the origin.
template <class Vec3 = Vec3, class Mat3 = Mat3>
inline DistanceSample distance_to_box(In<Vec3> half, In<Vec3> p) {
  Vec3 sign, beyond, out;
  int axis = 0;
  for (int i = 0; i < 3; ++i) {
    sign[i] = p[i] < 0.0 ? -1.0 : 1.0;
    beyond[i] = std::abs(p[i]) - half[i];
    out[i] = std::max(beyond[i], 0.0);
    if (beyond[i] > beyond[axis]) axis = i;
  }
  if (beyond[axis] <= 0.0) {
    Vec3 n = Vec3::Zero();
    n[axis] = sign[axis];
    return {beyond[axis], n, Mat3::Zero()};
  }
  const double r = out.norm();
  Vec3 n = out / r;
  Mat3 h = Mat3::Zero();  // only the directions that are outside bend the distance
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      if (out[i] > 0.0 && out[j] > 0.0) h(i, j) = ((i == j ? 1.0 : 0.0) - n[i] * n[j]) / r * sign[i] * sign[j];
  for (int i = 0; i < 3; ++i) n[i] *= sign[i];
  return {r, n, h};
}

}  // namespace detail

/// Rigid box with edges along the finger's axes, rounded where `edge_radius_m` > 0. Sharp edges concentrate stress without limit: round them.
struct Box {
  Vec3 size_m{10e-3, 10e-3, 10e-3};
  double edge_radius_m = 0.5e-3;

  bool operator==(const Box&) const = default;

  template <class = void>
  double radius_m() const { return 0.5 * size_m.norm(); }
  template <class = void>
  double contact_radius_m() const { return 0.5 * size_m.minCoeff(); }
  bool symmetric(int) const { return true; }
  template <class Vec3 = Vec3>
  double distance(In<Vec3> p) const { return sample(p).distance; }
  template <class Vec3 = Vec3>
  DistanceSample sample(In<Vec3> p) const {
    DistanceSample d = detail::distance_to_box(0.5 * size_m - Vec3::Constant(edge_radius_m), p);
    d.distance -= edge_radius_m;
    return d;
  }
};

template <class = void>
inline void validate(const Box& b) {
  for (double side : {b.size_m.x(), b.size_m.y(), b.size_m.z()}) require_in_range("box side", side * 1e3, 0.1, 1000.0, "mm");
  require_in_range("edge radius of the box", b.edge_radius_m * 1e3, 0.0, 0.499 * b.size_m.minCoeff() * 1e3, "mm");
}

static_assert(Indenter<Box>);

}  // namespace lumo
