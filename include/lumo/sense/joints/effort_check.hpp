#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/statistics.hpp"
#include "lumo/sense/devices/device.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace lumo::sense {

/// Limits of what is believed of a driver's efforts.
struct EffortLimits {
  double most = 1e6;          ///< [A or N·m]; beyond, a number is no effort
  double milli_from = 100.0;  ///< median magnitude beyond which amperes are milliamperes; no finger's motor holds it
  double wrap = 65536.0;      ///< of unsigned 16 bits …
  double wrap_near = 0.25;    ///< … and the share of it that values stay away from both ends
  double limit_share = 0.01;  ///< of the samples at their very largest or smallest value, beyond which that is a limit
  std::size_t least_limit = 20;
  double stuck_s = 1.0;       ///< the very same value for so long …
  double stuck_share = 0.02;  ///< … in this share of the log, in joints whose values change otherwise
};

/// What speaks against the efforts of a joint.
struct EffortCheck {
  bool never_changes = false;
  bool milli = false;        ///< milliamperes are given for amperes
  bool wraps = false;        ///< negative values of 16 bits are read as unsigned
  double limit = 0.0;        ///< value at which the driver or its controller stops; 0: none
  double at_limit = 0.0;     ///< share of the samples there
  double stuck_share = 0.0;  ///< of the log, in stretches that are stuck
};

namespace detail {

/// Share of the samples whose effort stays the very same for longer than `stuck_s`.
inline double stuck_share(std::span<const JointSample> samples, int joint, double stuck_s) {
  std::size_t stuck = 0, from = 0;
  for (std::size_t i = 1; i <= samples.size(); ++i)
    if (i == samples.size() || samples[i].effort[joint] != samples[from].effort[joint]) {
      if (1e-9 * double(samples[i - 1].stamp_ns - samples[from].stamp_ns) > stuck_s) stuck += i - from;
      from = i;
    }
  return double(stuck) / double(samples.size());
}

}  // namespace detail

/// Throws InvalidArgument for a joint that the samples do not have, or efforts that are not finite or beyond `most`.
inline EffortCheck check_effort(std::span<const JointSample> samples, int joint, const EffortLimits& limits = {}) {
  EffortCheck check;
  std::vector<double> effort, magnitude;
  for (const JointSample& s : samples) {
    if (joint < 0 || joint >= s.effort.size()) throw InvalidArgument(message("efforts: there is no joint ", joint));
    const double e = s.effort[joint];
    require_in_range("effort", e, -limits.most, limits.most, s.unit == Effort::current_A ? "A" : "N·m");
    effort.push_back(e);
    magnitude.push_back(std::abs(e));
  }
  if (effort.size() < 2) return check;
  const auto [least, most] = std::minmax_element(effort.begin(), effort.end());
  check.never_changes = *least == *most;
  if (check.never_changes) return check;
  const auto high = std::count_if(effort.begin(), effort.end(),
      [&](double e) { return e > (1.0 - limits.wrap_near) * limits.wrap && e < limits.wrap; });
  const auto low = std::count_if(
      effort.begin(), effort.end(), [&](double e) { return e >= 0.0 && e < limits.wrap_near * limits.wrap; });
  check.wraps = high > 0 && low > 0 && std::size_t(high + low) == effort.size();
  check.milli = !check.wraps && samples.front().unit == Effort::current_A && median(magnitude) > limits.milli_from;
  for (const double end : {*least, *most})
    if (const auto there = std::count(effort.begin(), effort.end(), end);
        std::size_t(there) >= limits.least_limit && double(there) > limits.limit_share * double(effort.size()) &&
        double(there) > check.at_limit * double(effort.size()) && std::abs(end) > median(magnitude)) {
      check.limit = end;
      check.at_limit = double(there) / double(effort.size());
    }
  check.stuck_share = detail::stuck_share(samples, joint, limits.stuck_s);
  if (check.stuck_share < limits.stuck_share) check.stuck_share = 0.0;
  return check;
}

}  // namespace lumo::sense
