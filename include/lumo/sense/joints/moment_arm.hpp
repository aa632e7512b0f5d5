#pragma once

#include "lumo/sense/joints/contact_jacobian.hpp"

namespace lumo::sense {

/// One joint whose axis crosses the finger at right angles: the torque is force times distance.
struct MomentArm {
  double joint_to_origin_m = 0.05;  ///< from the joint's axis to the finger's origin, along y
  double sign = 1.0;                ///< −1 where the motor turns the other way: positive torque lifts the pad off

  int joints() const { return 1; }
  JointVector column(const JointVector&, const ContactPoint& c) const {
    return JointVector::Constant(1, sign * (joint_to_origin_m + c.y_m));
  }
  JointVector slope(const JointVector&, const ContactPoint&) const { return JointVector::Constant(1, sign); }
};

static_assert(ContactJacobian<MomentArm>);

}  // namespace lumo::sense
