#pragma once

#include "lumo/sense/devices/joint_sample.hpp"
#include "lumo/sense/joints/torque_model.hpp"

#include <cmath>
#include <cstdint>
#include <optional>
#include <span>

namespace lumo::sense {

/// How far the torque of an unloaded joint at rest is off the model: RMS over the rests of a run of each rest's mean
/// [N·m]. What sticks is another at each rest, and under a contact it adds to the contact's torque unseen. Rests count
/// from 0.1 s on. Nothing for fewer than three.
inline std::optional<double> standstill_scatter(std::span<const JointSample> samples, int joint,
                                                const TorqueModel& model) {
  double squares = 0.0, sum = 0.0;
  int rests = 0, count = 0;
  std::int64_t from = 0, last = 0;
  const auto close = [&] {
    if (count >= 3 && 1e-9 * double(last - from) >= 0.1) squares += std::pow(sum / count, 2), ++rests;
    sum = 0.0, count = 0;
  };
  for (const JointSample& s : samples) {
    if (std::abs(s.velocity_rad_per_s[joint]) > 1.5 * model.rest_velocity_rad_per_s) {
      close();
      continue;
    }
    if (count == 0) from = s.stamp_ns;
    last = s.stamp_ns;
    sum += model.motor_torque(s.effort[joint], s.unit) - model.unloaded(s.position_rad[joint], 0.0);
    ++count;
  }
  close();
  return rests >= 3 ? std::optional(std::sqrt(squares / rests)) : std::nullopt;
}

}  // namespace lumo::sense
