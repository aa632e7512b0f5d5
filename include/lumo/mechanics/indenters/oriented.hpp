#pragma once

#include "lumo/mechanics/indenters/indenter.hpp"

#include <Eigen/LU>

#include <cmath>

namespace lumo {

/// A tool turned in the finger's frame: `turn` takes vectors of the tool's own frame there.
template <Indenter Tool> struct Oriented {
  Tool tool;
  Mat3d turn{{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}};

  bool operator==(const Oriented&) const = default;

  double radius_m() const { return tool.radius_m(); }
  double contact_radius_m() const { return contact_radius(tool); }
  bool symmetric(int axis) const {  // where an axis of the tool lies along it
    for (int k = 0; k < 3; ++k)
      if (std::abs(turn(axis, k)) == 1.0) return is_symmetric(tool, k);
    return false;
  }
  template <class S> auto distance(const Vec3<S>& p) const -> decltype(tool.distance(p)) {
    return tool.distance(Vec3<S>(turn.template cast<S>().transpose() * p));
  }
  DistanceSample sample(const Vec3d& p) const {
    const auto d = tool.sample(turn.transpose() * p);
    return {d.distance, turn * d.gradient, turn * d.hessian * turn.transpose()};
  }
};

template <Indenter Tool> Oriented(Tool, Mat3d) -> Oriented<Tool>;

/// A tool that is long along its own z, laid along y, the finger: its z becomes y.
template <Indenter Tool> Oriented<Tool> lying_along_y(const Tool& tool) {
  Mat3d turn;
  turn << 1, 0, 0, 0, 0, 1, 0, -1, 0;
  return {tool, turn};
}

/// The same, laid along x, across the finger.
template <Indenter Tool> Oriented<Tool> lying_along_x(const Tool& tool) {
  Mat3d turn;
  turn << 0, 0, 1, 0, 1, 0, -1, 0, 0;
  return {tool, turn};
}

template <Indenter Tool> void validate(const Oriented<Tool>& o) {
  validate(o.tool);
  if (!((o.turn.transpose() * o.turn - Mat3d::Identity()).norm() < 1e-9 && o.turn.determinant() > 0.0))
    throw InvalidArgument(message("turn of a tool: its determinant is ", o.turn.determinant(), ", must be a rotation"));
}

static_assert(Indenter<Oriented<Sphere>>);

}  // namespace lumo
