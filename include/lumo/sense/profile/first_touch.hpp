#pragma once

#include "lumo/core/statistics.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/profile/unloaded_reference.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace lumo::sense {

/// Limits of a touch that pictures show beyond doubt; chosen on the virtual lab.
struct FirstTouchLimits {
  int smoothing = 5;       ///< values of a profile that are averaged first
  double noises = 8.0;     ///< by which a place must be brighter than unloaded …
  double share = 0.08;     ///< … and this share of its light
  int pictures = 3;        ///< in a row
  double before_s = 0.25;  ///< a touch begins so much before it is beyond doubt
};

/// Up to when pictures show the finger untouched, in the order of their stamps: shortly before the first few in a row
/// in which it is brighter at one place than unloaded, or the last one's stamp. What changes all light alike is no
/// touch. 0 without pictures.
inline std::int64_t untouched_until_ns(
    const std::vector<Profile>& profiles, const UnloadedReference& unloaded, const FirstTouchLimits& limits = {}) {
  const Eigen::VectorXd& mean = unloaded.mean();
  const Eigen::VectorXd noise = unloaded.noise();
  const Eigen::Index n = mean.size(), half = limits.smoothing / 2;
  int in_a_row = 0;
  std::int64_t first_ns = 0;
  for (const Profile& p : profiles) {
    if (p.value.size() != n || n <= 2 * half || !p.value.allFinite()) continue;
    const Eigen::VectorXd ratio = p.value.cwiseQuotient(mean.cwiseMax(1e-9));
    const Eigen::VectorXd change = p.value - median({ratio.data(), ratio.data() + n}) * mean;
    bool touched = false;
    for (Eigen::Index i = half; i < n - half && !touched; ++i) {
      const auto smooth = [&](const Eigen::VectorXd& v) { return v.segment(i - half, 2 * half + 1).mean(); };
      touched = smooth(change) > std::max(limits.noises * smooth(noise), limits.share * smooth(mean));
    }
    if (!touched) {
      in_a_row = 0;
      continue;
    }
    if (in_a_row++ == 0) first_ns = p.stamp_ns;
    if (in_a_row == limits.pictures) return first_ns - std::llround(1e9 * limits.before_s);
  }
  return profiles.empty() ? 0 : profiles.back().stamp_ns;
}

}  // namespace lumo::sense
