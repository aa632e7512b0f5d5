#pragma once

#include <Eigen/Core>

#include <cstdint>

namespace lumo::sense {

/// A finger or hand has at most this many joints; vectors of joints need no heap.
inline constexpr int max_joints = 8;

using JointVector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, max_joints, 1>;

/// Quantity of a motor driver's effort. The torque model's constants turn a current into a torque.
enum class Effort { current_A, torque_Nm };

/// State of all joints at one time.
struct JointSample {
  std::int64_t stamp_ns = 0;  ///< on the clock that the session names
  JointVector position_rad;
  JointVector velocity_rad_per_s;
  JointVector effort;  ///< of the motor on the joint, positive along the joint's axis
  Effort unit = Effort::current_A;
  bool saturated = false;  ///< a value stands at the end of the driver's range: it may be more
};

}  // namespace lumo::sense
