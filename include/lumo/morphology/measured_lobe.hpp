#pragma once

#include "lumo/morphology/emitter.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <utility>
#include <vector>

namespace lumo {

/// Intensity against the angle from an axis, as data sheets give it, in any unit; linear in the angle's cosine between
/// entries, 0 beyond the last.
class LobeTable {
 public:
  /// `angles_rad` ascend from 0 to at most π, `relative` intensities ≥ 0 are not all 0. Throws InvalidArgument.
  LobeTable(const std::vector<double>& angles_rad, std::vector<double> relative);

  /// Share of the power per solid angle [1/sr]; its integral over all directions is 1.
  double density(double cosine) const;
  /// Cosine of the angle below which the share `u` of the power lies: the inverse of a distribution that is quadratic
  /// between entries.
  double cosine(double u) const;

 private:
  std::vector<double> cosine_, density_, below_;  ///< descending; [1/sr]; share of the power up to each entry
};

/// A round flat emitter, or a point where the radius is 0, with a measured lobe.
struct MeasuredLobe {
  LobeTable lobe;
  Vec3d center{0.0, 0.0, 0.0};     ///< [m]
  Vec3d direction{0.0, 0.0, 1.0};  ///< unit, of the lobe's axis
  double radius_m = 0.0;
  double power_W = 1.0;
  int channel = 0;  ///< colour channel

  Vec3d axis() const { return direction; }
  Vec3d point(double u, double v) const { return on_disc(center, direction, radius_m, u, v); }
  Polar polar(double u) const {
    const double c = lobe.cosine(u);
    return {std::sqrt(std::max(0.0, 1.0 - c * c)), c};
  }
  double intensity(double cosine) const { return power_W * lobe.density(cosine); }
  double area_m2() const { return pi * radius_m * radius_m; }
  bool covers(const Vec3d& p) const { return (p - center).squaredNorm() <= radius_m * radius_m; }
  MeasuredLobe mirrored(const Vec3d& m) const {
    return {lobe, m.cwiseProduct(center), m.cwiseProduct(direction), radius_m, power_W, channel};
  }
};

inline void validate(const MeasuredLobe& e) {
  require_in_range("radius of a measured lobe", e.radius_m * 1e3, 0.0, 1e3, "mm");
}

static_assert(EmitterModel<MeasuredLobe>);

inline LobeTable::LobeTable(const std::vector<double>& angles_rad, std::vector<double> relative)
    : density_(std::move(relative)) {
  const std::size_t n = angles_rad.size();
  if (n < 2 || density_.size() != n)
    throw InvalidArgument(
        message("lobe: ", n, " angles and ", density_.size(), " intensities, needs as many, at least 2"));
  if (angles_rad[0] != 0.0)
    throw InvalidArgument(message("lobe: the first angle is ", angles_rad[0], " rad, must be 0 rad"));
  for (std::size_t k = 0; k < n; ++k) {
    require_in_range(
        "angle of a lobe", angles_rad[k], k > 0 ? angles_rad[k - 1] + 1e-9 : 0.0, pi * (1.0 + 1e-12), "rad");
    require_in_range("intensity of a lobe", density_[k], 0.0, 1e300, "");
    cosine_.push_back(std::cos(angles_rad[k]));
  }
  below_.assign(n, 0.0);
  for (std::size_t k = 1; k < n; ++k)
    below_[k] = below_[k - 1] + pi * (density_[k - 1] + density_[k]) * (cosine_[k - 1] - cosine_[k]);
  const double all = below_.back();
  require_positive("intensity of a lobe, summed over its angles,", all, "");
  for (double& d : density_) d /= all;
  for (double& b : below_) b /= all;
}

inline double LobeTable::density(double c) const {
  if (!(c >= cosine_.back())) return 0.0;
  const auto next =
      std::lower_bound(cosine_.begin() + 1, cosine_.end() - 1, c, std::greater<>());  // first entry with a cosine ≤ c
  const std::size_t k = std::size_t(next - cosine_.begin());
  const double t = (cosine_[k - 1] - std::min(c, cosine_[k - 1])) / (cosine_[k - 1] - cosine_[k]);
  return density_[k - 1] + t * (density_[k] - density_[k - 1]);
}

inline double LobeTable::cosine(double u) const {
  const auto next = std::upper_bound(below_.begin() + 1, below_.end() - 1, u);
  const std::size_t k = std::size_t(next - below_.begin());
  const double width = cosine_[k - 1] - cosine_[k], a = density_[k - 1], b = density_[k];
  // 2π width (a t + (b − a) t²/2) = what is left of u: the root in [0, 1], in the form that does not cancel.
  const double left = std::clamp(u - below_[k - 1], 0.0, below_[k] - below_[k - 1]) / (2.0 * pi * width);
  const double root = std::sqrt(std::max(0.0, a * a + 2.0 * (b - a) * left));
  const double t = a + root > 0.0 ? std::min(1.0, 2.0 * left / (a + root)) : 0.0;
  return cosine_[k - 1] - t * width;
}

}  // namespace lumo
