#pragma once

#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/joints/torque_model.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

namespace lumo::sense {

/// What a run without contact gives for each joint.
struct JointReference {
  std::vector<TorqueModel> torque;    ///< friction, weight, offset and noise; empty without joint samples
  std::vector<double> standstill_Nm;  ///< what may stick unseen
  /// All efforts are whole multiples of it apart, the coarsest joint's [A or N·m]; 0: no step is seen.
  double effort_step = 0.0;
  double left_out = 0.0;  ///< share of the run whose torque is far off the rest's: contact (free_run)
};

/// Limits of the identification of joints; chosen on the virtual lab, none is critical.
struct JointIdentification {
  double moving_rad_per_s = 0.05;  ///< a faster sample shows friction: beyond the speeds of a held joint
  std::size_t least_moving = 100;  ///< moving samples that six parameters need; with fewer, all samples are taken
  /// Where there are too few rests. A scatter of 0.08 explains the paper's force error of 1.29 N
  /// (lab::MotorRig::stiction_Nm); a model from one rest and the next contact have √2 times that between them.
  double assumed_standstill_Nm = 0.11;
  double least_rest_s = 0.1;  ///< a shorter stop is a reversal, no rest; a longer pause of the samples ends one
  int least_rest_samples = 3, least_rests = 3;  ///< for a mean; for its scatter
  double rest_velocities = 1.5;                 ///< of TorqueModel::rest_velocity_rad_per_s: slower is at rest
  int least_changes = 20;                       ///< of an effort, before a step counts as the driver's
  double step_tolerance = 1e-3;  ///< part of a step by which efforts may be off its multiples: rounding of texts
};

/// Means of the torque of an unloaded joint at rest, less the model's.
struct RestScatter {
  double squares = 0.0;  ///< their sum [N²m²]
  int rests = 0;

  double rms() const { return std::sqrt(squares / rests); }
};

/// How far each rest of a run is off the model. What sticks differs from rest to rest, and adds unseen to the torque of
/// a contact. nullopt for too few rests.
inline std::optional<RestScatter> standstill_scatter(
    std::span<const JointSample> samples, int joint, const TorqueModel& model, const JointIdentification& limits = {}) {
  RestScatter scatter;
  double sum = 0.0;
  int count = 0;
  std::int64_t from = 0, last = 0;
  const auto close = [&] {
    if (count >= limits.least_rest_samples && 1e-9 * double(last - from) >= limits.least_rest_s) {
      scatter.squares += std::pow(sum / count, 2);
      ++scatter.rests;
    }
    sum = 0.0;
    count = 0;
  };
  for (const JointSample& s : samples) {
    const bool moves = std::abs(s.velocity_rad_per_s[joint]) > limits.rest_velocities * model.rest_velocity_rad_per_s;
    if (moves || 1e-9 * double(s.stamp_ns - last) > limits.least_rest_s) close();
    if (moves) continue;
    if (count == 0) from = s.stamp_ns;
    last = s.stamp_ns;
    sum += model.motor_torque(s.effort[joint], s.unit) - model.unloaded(s.position_rad[joint], 0.0);
    ++count;
  }
  close();
  return scatter.rests >= limits.least_rests ? std::optional(scatter) : std::nullopt;
}

/// The step in which a driver of few bits gives a joint's efforts [A or N·m]; 0 where they are not whole multiples of
/// one apart.
inline double effort_step(std::span<const JointSample> samples, int joint, const JointIdentification& limits = {}) {
  double step = std::numeric_limits<double>::infinity();
  int changes = 0;
  for (std::size_t i = 1; i < samples.size(); ++i)
    if (const double d = std::abs(samples[i].effort[joint] - samples[i - 1].effort[joint]); d > 0.0) {
      step = std::min(step, d);
      ++changes;
    }
  if (changes < limits.least_changes) return 0.0;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    const double steps = (samples[i].effort[joint] - samples[i - 1].effort[joint]) / step;
    if (std::abs(steps - std::round(steps)) > limits.step_tolerance) return 0.0;
  }
  return step;
}

/// Friction, weight and offset of each joint from samples without contact. Moving samples show friction, resting ones
/// what sticks; where the run has too few rests, those of `later` samples without contact do.
/// `torque_constant_Nm_per_A`: of each joint, which such a run does not show; joints that give torques need none.
/// Throws InvalidArgument for numbers that are not finite.
inline JointReference identify_joints(std::span<const JointSample> free,
    std::span<const double> torque_constant_Nm_per_A, const JointIdentification& limits = {},
    std::span<const JointSample> later = {}) {
  JointReference reference;
  if (free.empty()) return reference;
  std::vector<JointSample> moving;
  for (const JointSample& s : free)
    if (s.velocity_rad_per_s.cwiseAbs().maxCoeff() > limits.moving_rad_per_s) moving.push_back(s);
  const auto joints = int(free.front().effort.size());
  for (int j = 0; j < joints; ++j) {
    TorqueModel start;
    if (std::size_t(j) < torque_constant_Nm_per_A.size())
      start.torque_constant_Nm_per_A = torque_constant_Nm_per_A[std::size_t(j)];
    reference.torque.push_back(
        identify_unloaded(moving.size() >= limits.least_moving ? std::span<const JointSample>(moving) : free, j, start)
            .model);
    const TorqueModel& model = reference.torque.back();
    double stuck = limits.assumed_standstill_Nm;
    if (const auto run = standstill_scatter(free, j, model, limits)) {
      stuck = run->rms();
    } else if (auto few = standstill_scatter(later, j, model, limits)) {  // the assumption counts as some rests more
      few->squares += limits.least_rests * std::pow(stuck, 2);
      few->rests += limits.least_rests;
      stuck = few->rms();
    }
    reference.standstill_Nm.push_back(stuck);
    reference.effort_step = std::max(reference.effort_step, effort_step(free, j, limits));
  }
  return reference;
}

/// From the samples up to `until_ns`.
inline JointReference identify_joints(std::span<const JointSample> samples,
    std::span<const double> torque_constant_Nm_per_A, std::int64_t until_ns, const JointIdentification& limits = {}) {
  std::vector<JointSample> free;
  for (const JointSample& s : samples)
    if (s.stamp_ns <= until_ns) free.push_back(s);
  return identify_joints(free, torque_constant_Nm_per_A, limits);
}

}  // namespace lumo::sense
