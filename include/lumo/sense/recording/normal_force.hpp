#pragma once

#include "lumo/sense/recording/alignment.hpp"
#include "lumo/sense/recording/tables.hpp"

#include <Eigen/Core>

#include <cstdint>
#include <utility>
#include <vector>

namespace lumo::sense {

/// Force that presses the finger over time: one channel [N], less `tare_N`. `clock` moves the stamps, for instance
/// Session::wrench_clock onto the frames'. Throws InvalidArgument if that leaves two samples at the same time.
inline TimeSeries normal_force(
    const std::vector<WrenchSample>& wrenches, const ClockMap& clock = {}, double tare_N = 0.0) {
  std::vector<std::int64_t> stamp_ns;
  Eigen::MatrixXd force_N(1, Eigen::Index(wrenches.size()));
  for (const WrenchSample& w : wrenches) {
    force_N(0, Eigen::Index(stamp_ns.size())) = w.normal_force_N() - tare_N;
    stamp_ns.push_back(clock(w.stamp_ns));
  }
  return {std::move(stamp_ns), std::move(force_N)};
}

}  // namespace lumo::sense
