#pragma once

#include "lumo/core/error.hpp"
#include "lumo/sense/joints/contact_jacobian.hpp"

#include <cmath>
#include <utility>
#include <vector>

namespace lumo::sense {

/// One joint whose axis crosses the finger at right angles: the torque is force times distance.
struct MomentArm {
  double joint_to_origin_m = 0.05;  ///< from the joint's axis to the finger's origin, along y
  double sign = 1.0;                ///< −1 where the motor turns the other way: positive torque lifts the pad off

  int joints() const { return 1; }
  /// Throws InvalidArgument for numbers that are not finite.
  JointVector column(const JointVector&, const ContactPoint& c) const {
    const double arm_m = sign * (joint_to_origin_m + c.y_m);
    require_finite("moment arm of a contact", arm_m, "m");
    return JointVector::Constant(1, arm_m);
  }
  JointVector slope(const JointVector&, const ContactPoint&) const { return JointVector::Constant(1, sign); }
};

static_assert(ContactJacobian<MomentArm>);

/// A finger whose joints have parallel axes across it, its pad on the last link; at angle 0 all lie on one line along
/// y, and positive angles turn the tip towards the pad's outward normal. With one joint it is the moment arm. Lengths
/// in m.
class PlanarFinger {
 public:
  /// `joint_to_joint_m`: from each joint's axis to the next one's; `joint_to_origin_m`: from the last one's to the
  /// pad's origin. Throws InvalidArgument.
  PlanarFinger(std::vector<double> joint_to_joint_m, double joint_to_origin_m)
      : way_m_(std::move(joint_to_joint_m)), last_m_(joint_to_origin_m) {
    if (way_m_.size() >= std::size_t(max_joints))
      throw InvalidArgument(
          message("planar finger has ", way_m_.size() + 1, " joints, must have at most ", max_joints));
    for (const double l : way_m_) require_in_range("way from joint to joint", 1e3 * l, 0.0, 10000.0, "mm");
    require_in_range("way from joint to origin", 1e3 * std::abs(last_m_), 0.0, 10000.0, "mm");
  }

  int joints() const { return int(way_m_.size()) + 1; }
  int pad_link() const { return joints() - 1; }

  /// Seen from a joint, the normal force at y acts on the way along the pad's link to y, and on that part of each link
  /// between which lies along the pad's.
  JointVector column(const JointVector& q, const ContactPoint& c) const {
    check(q, c);
    JointVector torque = JointVector::Constant(joints(), last_m_ + c.y_m);
    double turn = 0.0;  // of the pad's link against the one looked at
    for (int j = joints() - 2; j >= 0; --j) {
      turn += q[j + 1];
      torque.head(j + 1).array() += way_m_[std::size_t(j)] * std::cos(turn);
    }
    return torque;
  }
  JointVector slope(const JointVector& q, const ContactPoint& c) const {
    check(q, c);
    return JointVector::Ones(joints());
  }

 private:
  void check(const JointVector& q, const ContactPoint& c) const {
    if (c.link != pad_link())
      throw InvalidArgument(message("contact lies on link ", c.link, ", the planar finger's pad on link ", pad_link()));
    if (q.size() != joints())
      throw InvalidArgument(message("planar finger has ", joints(), " joints, got ", q.size(), " angles"));
    require_finite_pose(q, c);
  }
  std::vector<double> way_m_;
  double last_m_;
};

static_assert(ContactJacobian<PlanarFinger>);

}  // namespace lumo::sense
