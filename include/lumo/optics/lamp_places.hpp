#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/morphology/emitter.hpp"
#include "lumo/optics/intersector.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <vector>

namespace lumo {

/// Distance of the point p from a triangle. Source: Ericson, "Real-Time Collision Detection" (2005), 5.1.5.
inline double distance_to_triangle(const Vec3d& p, const std::array<Vec3d, 3>& corners) {
  const auto& [a, b, c] = corners;
  const Vec3d ab = b - a, ac = c - a, bc = c - b, n = ab.cross(ac);
  const auto to_edge = [&](const Vec3d& from, const Vec3d& along) {
    const double l2 = along.squaredNorm(), t = l2 > 0.0 ? std::clamp(along.dot(p - from) / l2, 0.0, 1.0) : 0.0;
    return (p - from - t * along).norm();
  };
  const bool over = n.dot(ab.cross(p - a)) >= 0.0 && n.dot(bc.cross(p - b)) >= 0.0 && n.dot((p - a).cross(ac)) >= 0.0;
  if (const double length = n.norm(); over && length > 0.0) return std::abs(n.dot(p - a)) / length;
  return std::min({to_edge(a, ab), to_edge(b, bc), to_edge(a, ac)});
}

/// Where light may start in a scene. `triangles`: of the body, then of carrier faces, as the scene was built from.
template <RayScene Scene> class LampPlaces {
 public:
  /// Within `precision_m` of the surface a lamp is on it, which is right for each; where nodes have moved by up to
  /// `moved_m`, within both.
  LampPlaces(const std::vector<SceneTriangle>& triangles, const Scene& scene, double precision_m, double moved_m)
      : triangles_(triangles), scene_(scene), step_m_(precision_m), tolerance_m_(precision_m + moved_m) {}

  /// Throws InvalidArgument for an emitter of which a part lies out of the medium that it radiates into: outside the
  /// body, or, of one in air, inside it. The message names the lamp, the place and how far from the surface it lies.
  void require(const std::vector<Emitter>& emitters) const {
    for (std::size_t k = 0; k < emitters.size(); ++k) {
      const Worst worst = worst_of(emitters[k]);
      if (!(worst.distance_m > tolerance_m_)) continue;
      throw InvalidArgument(message("emitter ", k, " at ", text(emitters[k].center()), " mm radiates into the ",
          emitters[k].in_air() ? "air, but lies up to " : "body, but lies up to ", worst.distance_m * 1e3,
          emitters[k].in_air() ? " mm inside the body, at " : " mm outside of it, at ", text(worst.at), " mm"));
    }
  }

 private:
  struct Worst {
    double distance_m = 0.0;
    Vec3d at = Vec3d::Zero();
  };
  static std::string text(const Vec3d& p) {
    return message("(", 1e3 * p.x(), ", ", 1e3 * p.y(), ", ", 1e3 * p.z(), ")");
  }
  // Light finds first how to leave the body, or first how to enter it. Two of three directions decide: one may meet an
  // edge. `reach_m`: the surface is at most this far.
  bool inside(const Vec3d& p, const Vec3d& axis, double& reach_m) const {
    Vec3d t1, t2;
    tangents(axis, t1, t2);
    int votes = 0;
    for (const Vec3d& side : {Vec3d(0.313 * t1 + 0.171 * t2), Vec3d(-0.289 * t1 + 0.233 * t2), Vec3d(-0.127 * t2)}) {
      const Vec3d d = (axis + side).normalized();
      const RayHit leaving = scene_.first_hit(p, d, true), entering = scene_.first_hit(p, d, false);
      votes += leaving.t < entering.t ? 1 : -1;
      reach_m = std::min(reach_m, leaving.t);
      if (entering && !triangles_[std::size_t(entering.triangle)].in_air_only) reach_m = std::min(reach_m, entering.t);
    }
    return votes > 0;
  }
  double distance(const Vec3d& p) const {
    double least = std::numeric_limits<double>::infinity();
    for (const SceneTriangle& t : triangles_)
      if (!t.in_air_only) least = std::min(least, distance_to_triangle(p, t.corners));
    return least;
  }
  // A point on the surface is on either side, so its neighbours along the axis are looked at.
  Worst worst_of(const Emitter& e) const {
    static constexpr std::array<double, 5> places{1e-12, 0.25, 0.5, 0.75, 1.0 - 1e-12};
    Worst worst;
    for (const double u : places)
      for (const double v : places) {
        const Vec3d at = e.point(u, v), axis = e.axis(), step = step_m_ * axis;
        double reach_m = std::numeric_limits<double>::infinity();
        if (inside(at + step, axis, reach_m) != e.in_air() || inside(at - step, axis, reach_m) != e.in_air()) continue;
        if (reach_m + step_m_ <= tolerance_m_) continue;
        if (const double apart = distance(at); apart > worst.distance_m) worst = {apart, at};
      }
    return worst;
  }

  const std::vector<SceneTriangle>& triangles_;
  const Scene& scene_;
  double step_m_, tolerance_m_;
};

}  // namespace lumo
