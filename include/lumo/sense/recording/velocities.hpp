#pragma once

#include "lumo/core/error.hpp"
#include "lumo/sense/devices/device.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace lumo::sense {

/// Gives those samples a velocity that have none (an empty vector): the slope of the line through the positions of
/// `half_s` before and after, by least squares; 0 where there is no second sample. Throws InputError for positions
/// beyond all bounds.
inline void find_velocities(std::vector<JointSample>& samples, double half_s = 0.01) {
  const auto half_ns = std::llround(1e9 * half_s);
  std::size_t from = 0, to = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (samples[i].velocity_rad_per_s.size() == samples[i].position_rad.size()) continue;
    const std::int64_t at = samples[i].stamp_ns;
    while (at - samples[from].stamp_ns > half_ns) ++from;
    while (to < samples.size() && samples[to].stamp_ns - at <= half_ns) ++to;
    std::size_t first = from, end = to;
    if (end - first < 2) {  // few samples: the nearest ones
      first = i > 0 ? i - 1 : i;
      end = std::min(samples.size(), i + 2);
    }
    const Eigen::Index joints = samples[i].position_rad.size();
    JointVector sum_tq = JointVector::Zero(joints);
    double mean_t = 0.0, sum_tt = 0.0;
    for (std::size_t k = first; k < end; ++k) mean_t += 1e-9 * double(samples[k].stamp_ns - at) / double(end - first);
    for (std::size_t k = first; k < end; ++k) {
      const double t = 1e-9 * double(samples[k].stamp_ns - at) - mean_t;
      sum_tt += t * t;
      sum_tq += t * (samples[k].position_rad - samples[i].position_rad);
    }
    if (!sum_tq.allFinite())
      throw InputError(message("positions about ", at, " ns are too far apart to give a velocity"));
    samples[i].velocity_rad_per_s = sum_tt > 0.0 ? JointVector(sum_tq / sum_tt) : JointVector::Zero(joints);
  }
}

}  // namespace lumo::sense
