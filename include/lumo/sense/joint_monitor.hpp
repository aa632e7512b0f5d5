#pragma once

#include "lumo/core/error.hpp"
#include "lumo/sense/faults.hpp"
#include "lumo/sense/joint_sample.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace lumo {

/// Says of each joint sample whether it can be trusted.
class JointMonitor {
 public:
  struct Config {
    int joints = 1;
    double period_s = 1e-3;
    double max_ahead_s = 0.01;        ///< how far a stamp may lie in the future
    double stuck_s = 0.1;             ///< the very same effort for this long is stuck; at least 20 samples. Real currents are noisy
    double spike = 0.5;               ///< jump against the median of the last five [A or N·m, as the effort]
    double max_effort = 40.0;         ///< of the motor, same unit
    double max_velocity_rad_per_s = 65.0;
  };

  /// Throws InvalidArgument for numbers that make no sense.
  explicit JointMonitor(const Config& config) : config_(config) {
    require_in_range("number of joints", config.joints, 1, max_joints, "");
    require_positive("period of the joint samples", config.period_s, "s");
    require_positive("time after which an effort is stuck", config.stuck_s, "s");
    require_positive("spike", config.spike, "");
    require_positive("largest effort", config.max_effort, "");
    require_positive("largest velocity", config.max_velocity_rad_per_s, "rad/s");
  }

  struct Verdict {
    Faults faults;
    bool usable = true;
  };

  Verdict check(const JointSample& s, std::int64_t now_ns) {
    Verdict v;
    const auto reject = [&](Fault f) { v.faults.add(f), v.usable = false; };
    if (1e-9 * double(s.stamp_ns - now_ns) > config_.max_ahead_s || (seen_ && s.stamp_ns <= stamp_ns_)) return reject(Fault::joint_time), v;
    const double step_s = seen_ ? 1e-9 * double(s.stamp_ns - stamp_ns_) : 0.0;
    if (step_s > 2.5 * config_.period_s) v.faults.add(Fault::joint_dropped);
    stamp_ns_ = s.stamp_ns;
    const Eigen::Index n = config_.joints;
    if (s.effort.size() != n || s.position_rad.size() != n || s.velocity_rad_per_s.size() != n || !s.effort.allFinite() || !s.position_rad.allFinite() ||
        !s.velocity_rad_per_s.allFinite())
      return seen_ = true, reject(Fault::joint_not_finite), v;
    if (!filled_) position_ = s.position_rad, changed_ns_ = s.stamp_ns, same_ = 0;

    const double reach = config_.max_velocity_rad_per_s * std::max(1e-9 * double(s.stamp_ns - position_ns_), config_.period_s);
    if (filled_ && (s.position_rad - position_).cwiseAbs().maxCoeff() > 1.5 * reach) reject(Fault::position_jump);
    if (v.usable) position_ = s.position_rad, position_ns_ = s.stamp_ns;
    if (s.effort.cwiseAbs().maxCoeff() > config_.max_effort) reject(Fault::torque_saturated);

    if (filled_ && s.effort == last_) {
      ++same_;
      if (same_ >= 20 && 1e-9 * double(s.stamp_ns - changed_ns_) > config_.stuck_s) reject(Fault::torque_stuck);
    } else {
      same_ = 0;
      changed_ns_ = s.stamp_ns;
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
  int next_ = 0, same_ = 0;
  std::int64_t stamp_ns_ = 0, position_ns_ = 0, changed_ns_ = 0;
  bool seen_ = false;
};

}  // namespace lumo
