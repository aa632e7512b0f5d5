#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/sense/devices/device.hpp"

#include <algorithm>
#include <limits>
#include <type_traits>

namespace lumo::sense {

/// Mean profile of the unloaded finger and the scatter of single profiles about it. Responses are measured against it.
class UnloadedReference {
 public:
  /// Adds a profile of the unloaded finger (Welford's running moments). Throws InvalidArgument for another length or
  /// values that are not finite.
  void add(const Profile& p) {
    if (count_ == 0) mean_ = squares_ = Eigen::VectorXd::Zero(p.value.size());
    if (p.value.size() != mean_.size())
      throw InvalidArgument(message("unloaded profile has ", p.value.size(), " values, the reference ", mean_.size()));
    if (!p.value.allFinite()) throw InvalidArgument("unloaded profile: values must be finite");
    ++count_;
    const Eigen::VectorXd before = p.value - mean_;
    mean_ += before / double(count_);
    squares_ += before.cwiseProduct(p.value - mean_);
  }

  int count() const { return count_; }
  const Eigen::VectorXd& mean() const { return mean_; }
  /// Standard deviation of one response at each position, the mean's own error included. It is at least `floor`: an
  /// 8-bit camera that repeats a number is not free of noise, and at least set_least_noise's. Throws InvalidArgument
  /// for a floor that is not positive.
  Eigen::VectorXd noise(double floor = 0.02) const {
    require_in_range("least noise of a profile", floor, 0.0, std::numeric_limits<double>::max(), "");
    floor = std::max(floor, least_noise_);
    if (count_ < 2) return Eigen::VectorXd::Constant(mean_.size(), floor);
    const double n = count_;
    const Eigen::VectorXd& squares = squares_;
    return (squares / (n - 1.0) * (1.0 + 1.0 / n)).cwiseSqrt().cwiseMax(floor);
  }
  /// What noise is at least, whatever the scatter [the profile's unit]: a codec's steps. Throws InvalidArgument.
  void set_least_noise(double least) {
    require_in_range("least noise of a reference", least, 0.0, std::numeric_limits<double>::max(), "");
    least_noise_ = least;
  }
  /// Profile minus the mean. Lengths must agree (unchecked).
  void subtract(std::type_identity_t<Profile>& p) const { p.value -= mean_; }

 private:
  int count_ = 0;
  double least_noise_ = 0.0;
  Eigen::VectorXd mean_, squares_;
};

}  // namespace lumo::sense
