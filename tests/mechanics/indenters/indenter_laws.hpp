#pragma once

#include "catch.hpp"
#include "lumo/core/types.hpp"
#include "lumo/mechanics/indenters/indenter.hpp"
#include "mechanics/dual.hpp"

#include <random>

// One suite for every signed distance field: the laws that stand beside the concept Indenter.
namespace lumo::test {

/// At random points within `size` [m]. Distances may differ by 1 + `slack` times the way between points, gradients from
/// unit length by `unit`.
template <class Thing>
void check_distance_laws(const Thing& thing, double size, double slack = 1e-12, double unit = 1e-12) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> u(-size, size);
  int compared = 0;
  for (int k = 0; k < 200; ++k) {
    const Vec3d p(u(random), u(random), u(random)), q(u(random), u(random), u(random));
    CHECK(std::abs(thing.distance(p) - thing.distance(q)) <= (p - q).norm() * (1 + slack));
    const DistanceSample d = thing.sample(p);
    CHECK(d.distance == Approx(thing.distance(p)).margin(1e-15));
    CHECK(d.gradient.norm() == Approx(1.0).margin(unit));
    const double h = 1e-5 * size;
    bool smooth = true;
    for (int i = 0; i < 3; ++i)
      for (double sign : {-2.0, 2.0})
        smooth = smooth && (thing.sample(p + sign * h * Vec3d::Unit(i)).gradient - d.gradient).norm() < 1e-3;
    if (!smooth) continue;  // edges of a box
    ++compared;
    if constexpr (requires(const Vec3<Dual>& x) {
                    { thing.distance(x) } -> std::same_as<Dual>;
                  })
      for (int i = 0; i < 3; ++i) CHECK(thing.distance(by_entry(p, i)).slope == Approx(d.gradient[i]).margin(1e-12));
    for (int i = 0; i < 3; ++i) {
      const Vec3d step = h * Vec3d::Unit(i);
      CHECK((thing.distance(p + step) - thing.distance(p - step)) / (2 * h) == Approx(d.gradient[i]).margin(1e-7));
      const Vec3d bend = (thing.sample(p + step).gradient - thing.sample(p - step).gradient) / (2 * h);
      CHECK((bend - d.hessian.col(i)).norm() < 1e-5 / size);
    }
  }
  CHECK(compared > 100);
}

}  // namespace lumo::test
