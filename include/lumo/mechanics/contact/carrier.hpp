#pragma once

#include "lumo/mechanics/indenters/box.hpp"
#include "lumo/morphology/body.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace lumo {

/// Signed distance to a union of rigid boxes. The origin of its frame is the finger's.
struct BoxUnion {
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

/// A point of a body's surface: where it is while the body is undeformed [m], and the number of its patch.
struct MaterialPoint {
  Vec3d reference;
  int patch;
};

/// What a body rests on, as a gap of its points: the signed distance to the union of its rigid boxes or, if it has
/// supports, the height over the one that the point belongs to. The origin of its frame is the finger's.
class Carrier {
 public:
  explicit Carrier(const Body& body) : supported_(!body.supports.empty()), boxes_{body.carrier} {
    rests_.resize(body.patches.size());
    for (std::size_t k = 0; k < body.patches.size(); ++k)
      for (const Support& s : body.supports)
        if (s.patch == body.patches[k].name) rests_[k].push_back({s, s.half_u.cross(s.half_v).normalized()});
  }

  /// Gap of a point that is at p now [m]; infinite if it belongs to no support.
  double distance(const Vec3d& p, const MaterialPoint& point) const {
    if (!supported_) return boxes_.distance(p);
    const Rest* rest = under(point);
    return rest ? rest->height(p) : std::numeric_limits<double>::infinity();
  }
  DistanceSample sample(const Vec3d& p, const MaterialPoint& point) const {
    if (!supported_) return boxes_.sample(p);
    const Rest* rest = under(point);
    return rest ? DistanceSample{rest->height(p), rest->normal, Mat3d::Zero()}
                : DistanceSample{std::numeric_limits<double>::infinity(), Vec3d::Zero(), Mat3d::Zero()};
  }
  /// May points of a patch that are within `radius` of p be in contact?
  bool reaches(const Vec3d& p, double radius, int patch) const {
    if (!supported_) return boxes_.distance(p) <= radius;
    const std::vector<Rest>& rests = rests_[std::size_t(patch)];
    return std::any_of(rests.begin(), rests.end(), [&](const Rest& r) { return r.height(p) <= radius; });
  }

 private:
  struct Rest {
    Support support;
    Vec3d normal;

    double height(const Vec3d& p) const { return normal.dot(p - support.center); }
    bool is_under(const Vec3d& p) const {
      constexpr double slack = 1e-9;  // [m]
      const Vec3d d = p - support.center;
      const auto within = [&](const Vec3d& half) {
        const double length = half.norm();
        return std::abs(half.dot(d)) <= length * (length + slack);
      };
      return height(p) >= -slack && within(support.half_u) && within(support.half_v);
    }
  };
  // The one that the undeformed point is nearest to of those that it lies over; null: none.
  const Rest* under(const MaterialPoint& point) const {
    const Rest* nearest = nullptr;
    for (const Rest& r : rests_[std::size_t(point.patch)])
      if (r.is_under(point.reference) && (!nearest || r.height(point.reference) < nearest->height(point.reference)))
        nearest = &r;
    return nearest;
  }

  bool supported_;
  BoxUnion boxes_;
  std::vector<std::vector<Rest>> rests_;  ///< per patch
};

}  // namespace lumo
