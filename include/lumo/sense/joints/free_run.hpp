#pragma once

#include "lumo/core/statistics.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/joints/torque_model.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <utility>
#include <vector>

namespace lumo::sense {

/// Limits for runs of which nobody said that they are without contact; chosen on the virtual lab.
struct FreeRunLimits {
  double block_s = 0.05;    ///< over which samples are averaged
  std::size_t least = 8;    ///< blocks, below which all are taken
  std::size_t fitted = 40;  ///< blocks that friction and weight are fitted to; fewer have one mean torque …
  double still_rad = 0.05;  ///< … if the joint moves no farther than that
  double far_sigmas = 8.0;  ///< of the closest half's scatter, from which a block is left out …
  double far_Nm = 0.05;     ///< … if it is also this far off: beyond what sticks in a joint
  int steps = 6;            ///< of concentration
};

/// A run without the stretches whose torque is far off what the rest of it shows.
struct FreeRun {
  std::vector<JointSample> samples;
  double left_out = 0.0;  ///< share of the run
};

namespace detail {

/// A run in blocks: their mean samples, and which samples each has.
struct RunBlocks {
  std::vector<JointSample> mean;
  std::vector<std::pair<std::size_t, std::size_t>> samples;  ///< first and one past the last
};

inline RunBlocks run_blocks(std::span<const JointSample> run, double block_s) {
  RunBlocks blocks;
  for (std::size_t from = 0; from < run.size();) {
    std::size_t to = from;
    JointSample mean = run[from];
    while (to < run.size() && 1e-9 * double(run[to].stamp_ns - run[from].stamp_ns) < block_s) {
      const double weight = 1.0 / double(++to - from);
      mean.position_rad += weight * (run[to - 1].position_rad - mean.position_rad);
      mean.velocity_rad_per_s += weight * (run[to - 1].velocity_rad_per_s - mean.velocity_rad_per_s);
      mean.effort += weight * (run[to - 1].effort - mean.effort);
    }
    blocks.mean.push_back(std::move(mean));
    blocks.samples.emplace_back(from, to);
    from = to;
  }
  return blocks;
}

/// How far each block's torque is off the model that is fitted to some of them [N·m]; `fitted`: with friction and
/// weight, or else their mean.
inline std::vector<double> block_misfits(const std::vector<JointSample>& blocks, const std::vector<std::size_t>& some,
    int joint, const TorqueModel& start, bool fitted) {
  std::vector<JointSample> chosen;
  for (const std::size_t i : some) chosen.push_back(blocks[i]);
  TorqueModel model = start;
  if (fitted) model = identify_unloaded(chosen, joint, start).model;
  else
    for (const JointSample& s : chosen)
      model.bias_Nm += model.motor_torque(s.effort[joint], s.unit) / double(chosen.size());
  std::vector<double> off;
  for (const JointSample& s : blocks)
    off.push_back(model.motor_torque(s.effort[joint], s.unit) -
                  model.unloaded(s.position_rad[joint], s.velocity_rad_per_s[joint]));
  return off;
}

/// The half that is least off, and the sum of its squares.
inline std::pair<std::vector<std::size_t>, double> least_half(const std::vector<double>& off) {
  std::vector<std::size_t> order(off.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::sort(
      order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return std::abs(off[a]) < std::abs(off[b]); });
  order.resize(off.size() / 2 + 1);
  double sum = 0.0;
  for (const std::size_t i : order) sum += off[i] * off[i];
  return {std::move(order), sum};
}

/// Least trimmed squares by concentration steps (Rousseeuw & Van Driessen 2006), from all blocks, and from each third.
inline std::vector<double> robust_misfits(
    const std::vector<JointSample>& blocks, int joint, const TorqueModel& start, bool fitted, int steps) {
  const std::size_t n = blocks.size();
  std::vector<double> best;
  double least = std::numeric_limits<double>::infinity();
  for (int part = 0; part < 4; ++part) {
    const std::size_t from = part == 0 ? 0 : n * std::size_t(part - 1) / 3,
                      to = part == 0 ? n : n * std::size_t(part) / 3;
    std::vector<std::size_t> some;
    for (std::size_t i = from; i < to; ++i) some.push_back(i);
    std::vector<double> off;
    for (int step = 0; step < steps; ++step) {
      off = block_misfits(blocks, some, joint, start, fitted);
      some = least_half(off).first;
    }
    if (const double sum = least_half(off).second; sum < least) {
      least = sum;
      best = std::move(off);
    }
  }
  return best;
}

}  // namespace detail

/// Leaves out of a run what is far off the rest of it: contact, or a hand that moves the finger. A run in which nothing
/// is stays as it is. `torque_constant_Nm_per_A`: as identify_joints. Throws InvalidArgument for numbers that are not
/// finite.
inline FreeRun free_run(std::span<const JointSample> run, std::span<const double> torque_constant_Nm_per_A,
    const FreeRunLimits& limits = {}) {
  FreeRun free{{run.begin(), run.end()}};
  if (run.size() < limits.least) return free;
  constexpr double most_blocks = 1000.0;
  const double run_s = 1e-9 * double(run.back().stamp_ns - run.front().stamp_ns);
  const detail::RunBlocks blocks = detail::run_blocks(run, std::max(limits.block_s, run_s / most_blocks));
  const std::size_t n = blocks.mean.size();
  if (n < limits.least) return free;
  std::vector<bool> far(n, false);
  for (int j = 0; j < int(run.front().effort.size()); ++j) {
    TorqueModel start;
    if (std::size_t(j) < torque_constant_Nm_per_A.size())
      start.torque_constant_Nm_per_A = torque_constant_Nm_per_A[std::size_t(j)];
    double low = blocks.mean.front().position_rad[j], high = low;
    for (const JointSample& s : blocks.mean) {
      low = std::min(low, s.position_rad[j]);
      high = std::max(high, s.position_rad[j]);
    }
    const bool fitted = n >= limits.fitted;
    if (!fitted && high - low > limits.still_rad) continue;
    const std::vector<double> off = detail::robust_misfits(blocks.mean, j, start, fitted, limits.steps);
    std::vector<double> size;
    for (const double o : off) size.push_back(std::abs(o));
    const double limit = std::max(limits.far_sigmas * quantile(size, 0.5) / half_of_normal, limits.far_Nm);
    for (std::size_t i = 0; i < n; ++i) far[i] = far[i] || size[i] > limit;
  }
  std::vector<bool> alone(n);  // a joint that turns round is off for a moment, too
  for (std::size_t i = 0; i < n; ++i) alone[i] = !(i > 0 && far[i - 1]) && !(i + 1 < n && far[i + 1]);
  for (std::size_t i = 0; i < n; ++i) far[i] = far[i] && !alone[i];
  const auto left_out = std::size_t(std::count(far.begin(), far.end(), true));
  if (left_out == 0 || left_out == n) return free;
  free.samples.clear();
  for (std::size_t i = 0; i < n; ++i)  // what lies beside contact is the begin of it, or its end
    if (!far[i] && !(i > 0 && far[i - 1]) && !(i + 1 < n && far[i + 1]))
      free.samples.insert(free.samples.end(), run.begin() + std::ptrdiff_t(blocks.samples[i].first),
          run.begin() + std::ptrdiff_t(blocks.samples[i].second));
  if (free.samples.empty()) free.samples.assign(run.begin(), run.end());
  free.left_out = 1.0 - double(free.samples.size()) / double(run.size());
  return free;
}

}  // namespace lumo::sense
