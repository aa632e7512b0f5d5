#pragma once

#include "lumo/core/statistics.hpp"
#include "lumo/sense/devices/device.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace lumo::sense {

/// Divides out what changes all light alike: lamps on alternating current or on pulses, seen by a camera of another
/// rate. The factor of a profile is the mean of the half of its places whose factors lie closest together, which leaves
/// out what a contact brightens. No memory is allocated after the first call.
class SteadyLight {
 public:
  SteadyLight() = default;
  /// `unloaded`: the light that profiles are brought to.
  explicit SteadyLight(Eigen::VectorXd unloaded) : unloaded_(std::move(unloaded)) {}

  bool is_set() const { return unloaded_.size() > 0; }
  const Eigen::VectorXd& unloaded() const { return unloaded_; }
  /// 1 for a profile of another length, or without light.
  double factor(const Eigen::VectorXd& value) {
    constexpr double least = 1e-3;
    if (value.size() != unloaded_.size() || value.size() < 2 || !value.allFinite()) return 1.0;
    ratio_.resize(std::size_t(value.size()));
    for (Eigen::Index i = 0; i < value.size(); ++i) ratio_[std::size_t(i)] = value[i] / std::max(unloaded_[i], 1e-9);
    std::sort(ratio_.begin(), ratio_.end());
    const std::size_t half = ratio_.size() / 2 + 1, from = closest_together(ratio_, half);
    double sum = 0.0;
    for (std::size_t i = from; i < from + half; ++i) sum += ratio_[i];
    return sum > least * double(half) ? sum / double(half) : 1.0;
  }
  void divide(Eigen::VectorXd& value) { value /= factor(value); }

 private:
  Eigen::VectorXd unloaded_;
  std::vector<double> ratio_;
};

/// Limits of what is taken for lamps that flicker; chosen on the virtual lab, whose lamps scatter by 1.7 % from picture
/// to picture.
struct FlickerLimits {
  std::size_t least = 12;     ///< pictures
  double half_range = 0.045;  ///< of the common factor, from its 10 % to its 90 % quantile
  double crossings = 0.125;   ///< of that range's middle, by picture: an exposure that settles crosses once
};

/// Light that rises and falls as a whole from picture to picture.
struct Flicker {
  double half_range = 0.0;  ///< relative; 0: none beyond what lamps do
  double rate_Hz = 0.0;     ///< as the pictures show it: lamps may be much faster
  Eigen::VectorXd middle;   ///< profile
};

/// Of pictures of the unloaded finger in the order of time.
inline Flicker flicker_of(const std::vector<const Profile*>& profiles, const FlickerLimits& limits = {}) {
  Flicker flicker;
  if (profiles.size() < limits.least) return flicker;
  Eigen::MatrixXd value(profiles.front()->value.size(), Eigen::Index(profiles.size()));
  for (std::size_t k = 0; k < profiles.size(); ++k) {
    if (profiles[k]->value.size() != value.rows() || !profiles[k]->value.allFinite()) return flicker;
    value.col(Eigen::Index(k)) = profiles[k]->value;
  }
  flicker.middle = pointwise_median(value);
  SteadyLight steady(flicker.middle);
  std::vector<double> factor;
  for (const Profile* p : profiles) factor.push_back(steady.factor(p->value));
  const double low = quantile(factor, 0.1), high = quantile(factor, 0.9), middle = 0.5 * (low + high),
               range = 0.5 * (high - low);
  int crossings = 0;
  for (std::size_t k = 1; k < factor.size(); ++k) crossings += (factor[k] > middle) != (factor[k - 1] > middle);
  if (range <= limits.half_range || crossings < limits.crossings * double(factor.size())) return flicker;
  flicker.half_range = range;
  const double seconds = 1e-9 * double(profiles.back()->stamp_ns - profiles.front()->stamp_ns);
  flicker.rate_Hz = seconds > 0.0 ? 0.5 * crossings / seconds : 0.0;
  return flicker;
}

}  // namespace lumo::sense
