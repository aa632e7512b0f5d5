#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/localize/location_estimator.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace lumo::sense {

/// The paper's localiser: the strongest peak of the low-passed response above a noise threshold. No labels, no
/// training. A contact starts above `threshold` noises and ends below `release`. The filter is first order in time and
/// starts anew after a gap.
class PeakLocalizer {
 public:
  struct Config {
    Eigen::VectorXd position_m;     ///< of the profile's values
    Eigen::VectorXd noise;          ///< standard deviation of each, unloaded
    double time_constant_s = 0.05;  ///< of the filter
    double gap_s = 0.5;             ///< longer without a profile: forget
    double threshold = 6.0;         ///< in noises of the filtered profile
    double release = 4.0;
    double bias_sigma_m = 1.0_mm;  ///< how far the brightest place is believed to lie from the contact; assumed
  };

  /// Throws InvalidArgument for lengths that differ or numbers out of range.
  explicit PeakLocalizer(Config config) : config_(std::move(config)) {
    const Eigen::Index n = config_.position_m.size();
    if (n < 3 || config_.noise.size() != n)
      throw InvalidArgument(message(
          "localiser has ", n, " positions and ", config_.noise.size(), " noises, must have at least 3 of each"));
    for (Eigen::Index i = 0; i < n; ++i) require_positive("noise of a profile's value", config_.noise[i], "");
    require_ascending_positions(config_.position_m);
    require_positive("time constant of the localiser", config_.time_constant_s, "s");
    require_positive("gap of the localiser", config_.gap_s, "s");
    require_in_range("release threshold", config_.release, 0.0, config_.threshold, "noises");
    require_in_range("bias of the peak", config_.bias_sigma_m, 0.0, 1.0, "m");
    reset();
  }

  void reset() {
    fresh_ = true;
    touching_ = false;
    share_ = 1.0;
  }

  LocationEstimate update(const Profile& response) {
    if (response.value.size() != config_.position_m.size())
      throw InvalidArgument(
          message("response has ", response.value.size(), " values, the localiser ", config_.position_m.size()));
    const double step_s = 1e-9 * double(response.stamp_ns - stamp_ns_);
    if (!fresh_ && step_s <= 0.0) return answer(response.stamp_ns);
    if (!is_usable(response)) {
      if (step_s > config_.gap_s) reset();
      return answer(response.stamp_ns);
    }
    if (fresh_ || step_s > config_.gap_s) {
      filtered_ = response.value;
      share_ = 1.0;
      fresh_ = touching_ = false;
    } else {
      const double weight = -std::expm1(-step_s / config_.time_constant_s);
      filtered_ += weight * (response.value - filtered_);
      share_ = (1.0 - weight) * (1.0 - weight) * share_ + weight * weight;  // of the white noise's variance
    }
    stamp_ns_ = response.stamp_ns;
    return answer(stamp_ns_);
  }

 private:
  LocationEstimate answer(std::int64_t stamp_ns) {
    LocationEstimate e{stamp_ns, 0, {}, 1.0};
    if (fresh_) return e;
    Eigen::Index top = 0;
    filtered_.maxCoeff(&top);
    const double sigma = config_.noise[top] * std::sqrt(share_), peak = filtered_[top];
    touching_ = peak > (touching_ ? config_.release : config_.threshold) * sigma;
    if (!touching_) return e;
    e.contacts = 1;
    e.contact[0] = vertex(top, sigma);
    return e;
  }

  /// The parabola through the peak and its neighbours; at the ends of the profile, the end itself.
  ContactLocation vertex(Eigen::Index top, double sigma) const {
    const auto& x = config_.position_m;
    const double bias2 = config_.bias_sigma_m * config_.bias_sigma_m, peak = filtered_[top];
    const double width = top == 0 ? x[1] - x[0] : x[top] - x[top - 1];
    const auto at = [&](double y, double variance) {  // noise of one profile: white
      return ContactLocation{y, variance + bias2, peak, bias2, variance / share_};
    };
    if (top == 0 || top + 1 == x.size()) return at(x[top], width * width / 3.0);
    const double left = x[top - 1] - x[top], right = x[top + 1] - x[top];
    const double a = (filtered_[top - 1] - peak) / left, b = (filtered_[top + 1] - peak) / right;
    const double curvature = (b - a) / (right - left);  // ≤ 0 at a peak
    if (!(curvature < 0.0)) return at(x[top], width * width / 12.0);
    const double slope = a - curvature * left;  // at the peak's own place
    const double y = std::clamp(-0.5 * slope / curvature, 0.5 * left, 0.5 * right);
    // Noise moves the vertex by the slope's error over the curvature, at most within the bin.
    const double slope_sigma = sigma * std::sqrt(2.0) / (right - left);
    const double moved = std::min(0.5 * slope_sigma / -curvature, 0.5 * (right - left));
    return at(x[top] + y, moved * moved);
  }

  Config config_;
  Eigen::VectorXd filtered_;
  std::int64_t stamp_ns_ = 0;
  double share_ = 1.0;
  bool fresh_ = true, touching_ = false;
};

static_assert(LocationEstimator<PeakLocalizer>);

}  // namespace lumo::sense
