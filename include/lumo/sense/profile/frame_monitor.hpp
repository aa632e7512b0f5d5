#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/devices/faults.hpp"
#include "lumo/sense/recording/alignment.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace lumo::sense {

/// Checks each frame's profile against the unloaded one and its predecessor.
class FrameMonitor {
 public:
  struct Config {
    Eigen::VectorXd position_m;  ///< of the profile's values
    Eigen::VectorXd unloaded;    ///< mean profile without contact
    std::vector<double> led_m{-22.0_mm, -11.0_mm, 0.0, 11.0_mm, 22.0_mm};
    double period_s = 1.0 / 30.0;  ///< of the frames
    double max_age_s = 0.15;       ///< from stamp to arrival
    double max_ahead_s = 0.01;     ///< how far a stamp may lie in the future
    double black = 0.25;           ///< mean light, relative to unloaded, below which a frame is black
    double saturated = 0.05;       ///< share of full pixels that is too many
    /// Light about one LED, relative to unloaded and where all is darker to the median over the finger, below which it
    /// is dead. A contact brightens half a finger to twice its light and leaves the other LEDs as they were, or darkens
    /// one to half (lab, built finger under 30 mm, 1 to 2 N).
    double led_dark = 0.4;
    /// Change of the median over the finger that counts, where all places agree to that, in ratio or in difference: a
    /// camera's exposure, or room light. A contact changes near places more than far ones (lab, built finger at 5 to 15
    /// N, spheres of 10 and 30 mm: the median by up to 117 %, the 95 % and 5 % quantiles of ratios apart by 41 % and
    /// more).
    double exposure = 0.15;
    double uniform = 0.5;  ///< of the unloaded light's spread, below which a bright picture shows no finger
    /// Light anywhere, relative to unloaded, outside of which the picture is damaged; contacts reach 0.3 and 10 (lab).
    double corrupt_low = 0.2, corrupt_high = 20.0;
    double exposure_s = 0.0, gain = 0.0;  ///< of the reference; 0: unknown
    double metadata_change = 0.01;        ///< relative, of exposure or gain: more than rounding
    double dropped_periods = 1.6;         ///< between two stamps, beyond which a frame is missing; assumed
  };

  /// Throws InvalidArgument for lengths that differ or numbers out of range.
  explicit FrameMonitor(Config config) : config_(std::move(config)) {
    const Eigen::Index n = config_.position_m.size();
    if (n < 1 || config_.unloaded.size() != n)
      throw InvalidArgument(message(
          "frame monitor has ", n, " positions and ", config_.unloaded.size(), " unloaded values, must have as many"));
    for (Eigen::Index i = 0; i < n; ++i) require_positive("unloaded light at every position", config_.unloaded[i], "");
    require_positive("period of the frames", config_.period_s, "s");
    require_positive("greatest age of a frame", config_.max_age_s, "s");
    unloaded_spread_ = spread_of(config_.unloaded);
    unloaded_median_ = sorted_[n / 2];
  }

  struct Verdict {
    Faults faults;
    bool usable = true;
  };

  /// Checks the time before a frame is read. A frame that fails must not be read.
  Verdict check_time(std::int64_t stamp_ns, std::int64_t now_ns) {
    Verdict v;
    if (stamp_ns < -stamp_limit_ns || stamp_ns > stamp_limit_ns) return reject(Fault::frame_time);
    if (const double ahead = 1e-9 * double(stamp_ns - now_ns); ahead > config_.max_ahead_s)
      return reject(Fault::frame_time);
    if (seen_ && stamp_ns == stamp_ns_) return reject(Fault::frame_repeated);
    if (seen_ && stamp_ns < stamp_ns_) return reject(Fault::frame_time);
    if (1e-9 * double(now_ns - stamp_ns) > config_.max_age_s) v.faults.add(Fault::frame_late);
    if (seen_ && 1e-9 * double(stamp_ns - stamp_ns_) > config_.dropped_periods * config_.period_s)
      v.faults.add(Fault::frame_dropped);
    seen_ = true;
    stamp_ns_ = stamp_ns;
    return v;
  }

  /// Checks the light before the reference is subtracted.
  Verdict check_light(const Profile& p, double exposure_s, double gain) {
    Verdict v;
    const bool same = last_.size() == p.value.size() && last_ == p.value;
    last_ = p.value;
    if (same) return reject(Fault::frame_repeated);
    if (!p.value.allFinite()) return reject(Fault::frame_corrupt);
    const auto differs = [&](double a, double b) {
      return a > 0.0 && b > 0.0 && std::abs(a / b - 1.0) > config_.metadata_change;
    };
    if (differs(exposure_s, config_.exposure_s) || differs(gain, config_.gain)) v.faults.add(Fault::exposure_changed);
    if (p.value.mean() < config_.black * config_.unloaded.mean()) v.faults.add(Fault::frame_black);
    if (p.saturated > config_.saturated) v.faults.add(Fault::frame_saturated);
    ratio_ = p.value.cwiseQuotient(config_.unloaded);
    const double median = sort(ratio_)[ratio_.size() / 2];
    if (!v.faults.any()) {
      const bool dead = std::any_of(config_.led_m.begin(), config_.led_m.end(),
          [&](double y) { return led_ratio(y) < config_.led_dark * std::min(median, 1.0); });
      if (dead) v.faults.add(Fault::led_dead);
      else if (ratio_.minCoeff() < config_.corrupt_low || ratio_.maxCoeff() > config_.corrupt_high)
        v.faults.add(Fault::frame_corrupt);
      else if (median > 1.0 && spread_of(p.value) < config_.uniform * unloaded_spread_)
        v.faults.add(Fault::frame_corrupt);
      if (std::abs(median - 1.0) > config_.exposure && all_alike(p.value)) v.faults.add(Fault::exposure_changed);
    }
    v.usable = !v.faults.any();
    return v;
  }

  static Verdict reject(Fault f) {
    Verdict v;
    v.faults.add(f);
    v.usable = false;
    return v;
  }

 private:
  const Eigen::VectorXd& sort(const Eigen::VectorXd& values) {
    sorted_ = values;
    std::sort(sorted_.data(), sorted_.data() + sorted_.size());
    return sorted_;
  }
  /// 95 % quantile less 5 % quantile.
  double range_of(const Eigen::VectorXd& values) {
    const Eigen::Index end = values.size() / 20;
    return sort(values)[values.size() - 1 - end] - sorted_[end];
  }
  /// Relative to the median.
  double spread_of(const Eigen::VectorXd& value) {
    const double range = range_of(value);
    return range / sorted_[sorted_.size() / 2];
  }
  bool all_alike(const Eigen::VectorXd& value) {
    const double ratios = range_of(ratio_), least = sorted_[ratio_.size() / 20];
    if (ratios < config_.exposure * least) return true;
    difference_ = value - config_.unloaded;
    return range_of(difference_) < config_.exposure * unloaded_median_;
  }
  /// Light at the position nearest to the LED, relative to unloaded.
  double led_ratio(double y) const {
    const Eigen::VectorXd& position_m = config_.position_m;
    Eigen::Index i = 0;
    (position_m.array() - y).abs().minCoeff(&i);
    return ratio_[i];
  }

  Config config_;
  Eigen::VectorXd last_, ratio_, difference_, sorted_;
  double unloaded_spread_ = 0.0, unloaded_median_ = 0.0;
  std::int64_t stamp_ns_ = 0;
  bool seen_ = false;
};

}  // namespace lumo::sense
