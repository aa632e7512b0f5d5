#pragma once

#include "lumo/sense/devices/faults.hpp"

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <optional>

namespace lumo::sense {

/// Which streams an estimate rests on.
enum class EstimatorState {
  ok,           ///< both, without faults
  degraded,     ///< both, but something is or was just wrong with one
  torque_only,  ///< no usable frame for too long
  vision_only,  ///< no usable joint sample for too long
  invalid       ///< neither
};

constexpr const char* to_string(EstimatorState s) {
  constexpr std::array<const char*, 5> names{"ok", "degraded", "torque_only", "vision_only", "invalid"};
  return names[std::size_t(s)];
}

/// One contact: the place on the finger and the normal force of the object on the pad. What is not known is empty;
/// the rest is finite.
struct ContactForce {
  std::optional<double> y_m;
  std::optional<double> force_N;
  double y_variance_m2 = 0.0;      ///< also where y is empty
  double force_variance_N2 = 0.0;  ///< the prior's where the force is not known
  double covariance_m_N = 0.0;
};

struct ForceEstimate {
  std::int64_t stamp_ns = 0;  ///< the time that it is for
  EstimatorState state = EstimatorState::invalid;
  Faults faults;
  int contacts = 0;
  std::array<ContactForce, 2> contact;  ///< the first max(1, contacts) mean something
  /// Unknowns are (y, F) of one contact or (F₁, F₂) of two, in units of what counts as known; `rank` of them (or
  /// combinations) are.
  int rank = 0;
  Eigen::Matrix2d null_directions{
      {0.0, 0.0}, {0.0, 0.0}};      ///< the last 2 − rank columns: unit directions that the data leave open
  std::int64_t frame_stamp_ns = 0;  ///< of the newest usable frame
  std::int64_t joint_stamp_ns = 0;  ///< of the newest usable joint sample
};

}  // namespace lumo::sense
