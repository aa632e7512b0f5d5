#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/sense/devices/device.hpp"

#include <concepts>
#include <span>

namespace lumo::sense {

/// A place on the pad of one of the links.
struct ContactPoint {
  int link = 0;      ///< counted from the base; the link after joint `link`
  double y_m = 0.0;  ///< finger coordinate on it
};

/// A stretch of one link's pad on which contacts are looked for.
struct PadRange {
  int link = 0;
  double from_m = -27.5e-3, to_m = 27.5e-3;  ///< finger coordinates; the paper's 11 regions of 5 mm

  double middle_m() const { return 0.5 * (from_m + to_m); }
};

/// How a normal force on a pad shows in the motors. The force is that of the object on the finger, against the pad's
/// outward normal, at the contact point; `column` is the torque that the motors add to hold it, n × 1 [N·m per N = m],
/// positive along each joint's axis. Laws: joints beyond the contact's link carry nothing; `slope` is the derivative of
/// `column` by y_m.
template <class J>
concept ContactJacobian = requires(const J& j, const JointVector& q, const ContactPoint& c) {
  { j.joints() } -> std::convertible_to<int>;
  { j.column(q, c) } -> std::same_as<JointVector>;
  { j.slope(q, c) } -> std::same_as<JointVector>;
};

/// Throws InvalidArgument for a place or an angle that is not finite.
inline void require_finite_pose(const JointVector& q, const ContactPoint& c) {
  require_finite("place of a contact", c.y_m, "m");
  for (const double angle : q) require_finite("angle of a joint", angle, "rad");
}

/// Torques of unit normal forces at several contacts, joints × contacts [m].
template <ContactJacobian J>
Eigen::MatrixXd contact_columns(const J& jacobian, const JointVector& q, std::span<const ContactPoint> contacts) {
  Eigen::MatrixXd a(jacobian.joints(), Eigen::Index(contacts.size()));
  for (std::size_t i = 0; i < contacts.size(); ++i) a.col(Eigen::Index(i)) = jacobian.column(q, contacts[i]);
  return a;
}

}  // namespace lumo::sense
