#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/devices/device.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace lumo::sense {

/// Limits of what is believed of a driver's velocities.
struct VelocityLimits {
  double window_s = 0.1;           ///< over which way and velocity are compared
  double moving_rad_per_s = 0.02;  ///< slower joints show nothing (RMS over the windows)
  double wrong_scale = 0.25;       ///< of the scale's distance from 1; noise and delays stay far below
  double smoothing_s = 0.02;       ///< velocities from positions are slopes over as much
  double largest_step_rad = 3.0;   ///< in a window: beyond, an encoder wraps round or jumps
  int least_windows = 10;
};

/// Velocities against the positions of a joint.
struct VelocityCheck {
  bool moves = false;  ///< enough to tell
  double scale = 1.0;  ///< velocity over change of position: 1; 0 where velocities are zeros, 57.3 in degrees
  bool agrees = true;
};

/// Throws InvalidArgument for a joint that the samples do not have.
inline VelocityCheck check_velocity(
    std::span<const JointSample> samples, int joint, const VelocityLimits& limits = {}) {
  VelocityCheck check;
  double ways = 0.0, products = 0.0, seconds = 0.0;
  int windows = 0;
  std::size_t from = 0;
  double integral = 0.0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (joint < 0 || joint >= samples[i].position_rad.size() || joint >= samples[i].velocity_rad_per_s.size())
      throw InvalidArgument(message("velocities: sample ", i, " has no joint ", joint));
    if (i == 0) continue;
    const double step_s = 1e-9 * double(samples[i].stamp_ns - samples[i - 1].stamp_ns);
    integral += 0.5 * step_s * (samples[i].velocity_rad_per_s[joint] + samples[i - 1].velocity_rad_per_s[joint]);
    const double span_s = 1e-9 * double(samples[i].stamp_ns - samples[from].stamp_ns);
    if (span_s < limits.window_s) continue;
    const double way = samples[i].position_rad[joint] - samples[from].position_rad[joint];
    const bool usable = span_s < 2.0 * limits.window_s && std::abs(way) < limits.largest_step_rad &&
                        std::isfinite(way) && std::isfinite(integral);
    if (usable) {
      ways += way * way;
      products += way * integral;
      seconds += span_s;
      ++windows;
    }
    from = i;
    integral = 0.0;
  }
  check.moves =
      windows >= limits.least_windows && std::sqrt(ways / windows) > limits.moving_rad_per_s * seconds / windows;
  if (!check.moves) return check;
  check.scale = products / ways;
  check.agrees = std::abs(check.scale - 1.0) <= limits.wrong_scale;
  return check;
}

/// Slope of a joint's positions over `smoothing_s` about sample i, and over its neighbours at least (least squares); 0
/// for a sample alone.
inline double slope_of_positions(
    std::span<const JointSample> samples, std::size_t i, Eigen::Index joint, double smoothing_s) {
  const double half_s = 0.5 * smoothing_s;
  const auto apart_s = [&](std::size_t k) { return 1e-9 * double(samples[k].stamp_ns - samples[i].stamp_ns); };
  std::size_t a = i > 0 ? i - 1 : i, b = std::min(i + 1, samples.size() - 1);
  while (a > 0 && apart_s(a - 1) >= -half_s) --a;
  while (b + 1 < samples.size() && apart_s(b + 1) <= half_s) ++b;
  double t = 0.0, q = 0.0, tt = 0.0, tq = 0.0;
  for (std::size_t k = a; k <= b; ++k) {
    const double at = apart_s(k), way = samples[k].position_rad[joint] - samples[i].position_rad[joint];
    t += at;
    q += way;
    tt += at * at;
    tq += at * way;
  }
  const double n = double(b - a + 1), det = n * tt - t * t;
  return det > 0.0 ? (n * tq - t * q) / det : 0.0;
}

/// Gives those samples a velocity that have none (an empty vector), from their positions. Throws InputError for
/// positions beyond all bounds.
inline void find_velocities(std::vector<JointSample>& samples, const VelocityLimits& limits = {}) {
  for (std::size_t i = 0; i < samples.size(); ++i) {
    JointVector& velocity = samples[i].velocity_rad_per_s;
    const Eigen::Index joints = samples[i].position_rad.size();
    if (velocity.size() == joints) continue;
    velocity.resize(joints);
    for (Eigen::Index j = 0; j < joints; ++j) velocity[j] = slope_of_positions(samples, i, j, limits.smoothing_s);
    if (!velocity.allFinite())
      throw InputError(message("positions about ", samples[i].stamp_ns, " ns are too far apart to give a velocity"));
  }
}

/// Sets the velocity of a joint to the slope of its positions.
inline void take_velocity_from_positions(
    std::vector<JointSample>& samples, int joint, const VelocityLimits& limits = {}) {
  for (std::size_t i = 0; i < samples.size(); ++i)
    samples[i].velocity_rad_per_s[joint] = slope_of_positions(samples, i, joint, limits.smoothing_s);
}

/// Takes the velocities of those joints from the positions that move, but not as their velocities say: zeros, degrees
/// or turns a minute. Returns a line for each, for whoever reads the log. Throws InvalidArgument for positions in
/// degrees.
inline std::vector<std::string> mend_velocities(std::vector<JointSample>& samples, const VelocityLimits& limits = {}) {
  std::vector<std::string> notes;
  if (samples.empty()) return notes;
  const auto joints = int(samples.front().position_rad.size());
  for (int j = 0; j < joints; ++j) {
    const VelocityCheck check = check_velocity(samples, j, limits);
    if (check.agrees) continue;
    const auto [least, most] = std::minmax_element(samples.begin(), samples.end(),
        [j](const JointSample& a, const JointSample& b) { return a.position_rad[j] < b.position_rad[j]; });
    if (std::abs(check.scale * 180.0 / pi - 1.0) <= limits.wrong_scale &&
        most->position_rad[j] - least->position_rad[j] > pi)
      throw InvalidArgument(message("positions of joint ", j,
          " change 57.3 times as fast as its velocities say: they seem to be in degrees, must be in rad"));
    take_velocity_from_positions(samples, j, limits);
    notes.push_back(message("velocities of joint ", j, " are ", 0.01 * std::round(100.0 * check.scale),
        " times the change of its positions"
        " (zeros, or not rad/s); they are taken from the positions"));
  }
  return notes;
}

}  // namespace lumo::sense
