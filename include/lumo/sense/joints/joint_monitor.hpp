#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/devices/faults.hpp"
#include "lumo/sense/recording/alignment.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace lumo::sense {

/// Decides for each joint sample whether it can be trusted.
class JointMonitor {
 public:
  struct Config {
    int joints = 1;
    double period_s = 1e-3;
    double max_ahead_s = 0.01;  ///< how far a stamp may lie in the future
    /// The very same effort of a joint for this long is stuck; at least 20 samples. Real currents are noisy
    double stuck_s = 0.1;
    /// Step in which efforts come, and standard deviation of their noise before they are rounded to it, both in the
    /// effort's unit. Where there is a step, as many samples more must be the same as noise alone would not make so in
    /// 10⁹ trials; noise far below half a step never changes it. 0: no step.
    double quantum = 0.0, noise = 0.0;
    double spike = 0.5;        ///< jump against the median of the last five [A or N·m, as the effort]
    double max_effort = 40.0;  ///< of the motor, same unit
    double max_velocity_rad_per_s = 65.0;
    double max_position_rad = 1e4;  ///< beyond, the encoder is broken
  };

  /// Throws InvalidArgument for numbers out of range.
  explicit JointMonitor(const Config& config) : config_(config) {
    require_in_range("number of joints", config.joints, 1, max_joints, "");
    require_in_range("period of the joint samples", config.period_s, 1e-6, 1e3, "s");
    require_positive("time after which an effort is stuck", config.stuck_s, "s");
    require_positive("spike", config.spike, "");
    require_in_range("largest effort", config.max_effort, 1e-9, 1e4, "");
    require_in_range("largest velocity", config.max_velocity_rad_per_s, 1e-6, 1e4, "rad/s");
    require_in_range("largest position", config.max_position_rad, 1e-3, 1e9, "rad");
    require_in_range("step of the effort", config.quantum, 0.0, config.max_effort, "");
    require_in_range("noise of the effort", config.noise, 0.0, config.max_effort, "");
    if (config.quantum > 0.0) {
      const double same = config.noise > 0.0 ? std::erf(config.quantum / (2.8284271247461901 * config.noise))
                                             : 1.0;  // share of samples on a step's middle
      least_same_ =
          std::max(least_same_, same < 1.0 ? std::log(1e-9) / std::log(same) : std::numeric_limits<double>::infinity());
    }
  }

  struct Verdict {
    Faults faults;
    bool usable = true;
  };

  Verdict check(const JointSample& s, std::int64_t now_ns) {
    Verdict v;
    const auto reject = [&](Fault f) {
      v.faults.add(f);
      v.usable = false;
    };
    if (s.stamp_ns < -stamp_limit_ns || s.stamp_ns > stamp_limit_ns) return reject(Fault::joint_time), v;
    if (1e-9 * double(s.stamp_ns - now_ns) > config_.max_ahead_s || (seen_ && s.stamp_ns <= stamp_ns_))
      return reject(Fault::joint_time), v;
    const double step_s = seen_ ? 1e-9 * double(s.stamp_ns - stamp_ns_) : 0.0;
    if (step_s > 2.5 * config_.period_s) v.faults.add(Fault::joint_dropped);
    stamp_ns_ = s.stamp_ns;
    const Eigen::Index n = config_.joints;
    if (s.effort.size() != n || s.position_rad.size() != n || s.velocity_rad_per_s.size() != n ||
        !s.effort.allFinite() || !s.position_rad.allFinite() || !s.velocity_rad_per_s.allFinite())
      return seen_ = true, reject(Fault::joint_not_finite), v;
    if (s.position_rad.cwiseAbs().maxCoeff() > config_.max_position_rad ||
        s.velocity_rad_per_s.cwiseAbs().maxCoeff() > config_.max_velocity_rad_per_s)
      return seen_ = true, reject(Fault::position_jump), v;
    if (!filled_) position_ = s.position_rad;

    const double reach =
        config_.max_velocity_rad_per_s * std::max(1e-9 * double(s.stamp_ns - position_ns_), config_.period_s);
    if (filled_ && (s.position_rad - position_).cwiseAbs().maxCoeff() > 1.5 * reach) reject(Fault::position_jump);
    if (v.usable) {
      position_ = s.position_rad;
      position_ns_ = s.stamp_ns;
    }
    if (s.saturated || s.effort.cwiseAbs().maxCoeff() > config_.max_effort) reject(Fault::torque_saturated);

    for (Eigen::Index j = 0; j < n; ++j) {
      Sameness& same = same_[std::size_t(j)];
      if (!filled_ || s.effort[j] != last_[j]) same = {0, s.stamp_ns};
      else if (++same.samples >= least_same_ && 1e-9 * double(s.stamp_ns - same.since_ns) > config_.stuck_s)
        reject(Fault::torque_stuck);
    }
    last_ = s.effort;

    // A real step fills the window within three samples and then is no spike.
    if (filled_ >= window)
      for (Eigen::Index j = 0; j < n; ++j) {
        std::array<double, window> sorted{};
        for (std::size_t k = 0; k < window; ++k) sorted[k] = recent_[k][j];
        std::nth_element(sorted.begin(), sorted.begin() + window / 2, sorted.end());
        if (std::abs(s.effort[j] - sorted[window / 2]) > config_.spike) reject(Fault::torque_spike);
      }
    recent_[std::size_t(next_)] = s.effort;
    next_ = (next_ + 1) % int(window);
    filled_ = std::min<std::size_t>(filled_ + 1, window);
    seen_ = true;
    return v;
  }

 private:
  static constexpr std::size_t window = 5;
  Config config_;
  std::array<JointVector, window> recent_;
  JointVector position_, last_;
  std::size_t filled_ = 0;
  struct Sameness {
    double samples = 0.0;  ///< that repeated the one before
    std::int64_t since_ns = 0;
  };
  std::array<Sameness, std::size_t(max_joints)> same_;
  double least_same_ = 20.0;
  int next_ = 0;
  std::int64_t stamp_ns_ = 0, position_ns_ = 0;
  bool seen_ = false;
};

}  // namespace lumo::sense
