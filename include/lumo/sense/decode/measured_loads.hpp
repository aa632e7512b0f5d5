#pragma once

#include "lumo/core/statistics.hpp"
#include "lumo/sense/decode/segment_responses.hpp"
#include "lumo/sense/recording/log_truth.hpp"
#include "lumo/sense/recording/session.hpp"
#include "lumo/sense/recording/tables.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

namespace lumo::sense {

/// Limits of what is believed of nominal loads; chosen on the virtual lab, whose controller stays within 1 %.
struct LoadLimits {
  double wrong_force_N = 0.5;  ///< on the wrong side in the holds (median): the sensor's sign is the other one
  double load_share = 0.03;    ///< by which measured loads may be off the nominal ones (median)
  double correlation = 0.8;    ///< of measured and nominal loads, at least, or the sensor measured something else
};

/// The force sensor against what the log's segments say of the holds.
struct LoadCheck {
  int holds = 0;          ///< with a measured load
  bool reversed = false;  ///< the sensor reports the force of the finger on the object
  double share = 1.0;     ///< measured over nominal load, median
  bool follows = false;   ///< measured loads rise with the nominal ones: slopes are per newton that it measured
  bool differs = false;   ///< by more than sensors and controllers do
};

/// Mean of the tared normal force over a segment [N]; nullopt without samples there.
inline std::optional<double> measured_load_N(
    const Segment& segment, const Session& session, const std::vector<WrenchSample>& wrenches, double tare_N) {
  double sum = 0.0;
  long count = 0;
  for (const WrenchSample& w : wrenches)
    if (segment.holds(session.wrench_clock(w.stamp_ns))) {
      sum += w.normal_force_N() - tare_N;
      ++count;
    }
  return count > 0 ? std::optional(sum / double(count)) : std::nullopt;
}

/// Whether the correlation of two lists is at least `least`; true where the second one does not vary.
inline bool rise_together(const std::vector<double>& a, const std::vector<double>& b, double least) {
  const Eigen::Map<const Eigen::VectorXd> first(a.data(), Eigen::Index(a.size())),
      second(b.data(), Eigen::Index(b.size()));
  const Eigen::VectorXd x = first.array() - first.mean(), y = second.array() - second.mean();
  return y.norm() <= 1e-9 * second.norm() || x.dot(y) >= std::max(least * x.norm() * y.norm(), 1e-12);
}

inline LoadCheck check_loads(
    const Session& session, const std::vector<WrenchSample>& wrenches, const LoadLimits& limits = {}) {
  LoadCheck check;
  const double tare = force_tare_N(session, wrenches);
  std::vector<double> load, nominal, share;
  for (const Segment& s : session.segments)
    if (s.kind == SegmentKind::hold && s.load_N > 0.0)
      if (const auto measured = measured_load_N(s, session, wrenches, tare)) {
        load.push_back(*measured);
        nominal.push_back(s.load_N);
        share.push_back(*measured / s.load_N);
      }
  check.holds = int(load.size());
  if (load.empty()) return check;
  check.share = median(share);
  check.reversed = median(load) < -limits.wrong_force_N;
  check.follows = !check.reversed && median(load) > 0.0 && rise_together(load, nominal, limits.correlation);
  check.differs = check.follows && std::abs(check.share - 1.0) > limits.load_share;
  return check;
}

/// Sets the load of each hold to what the force sensor measured in it, less its tare; holds without samples, or where
/// it measured nothing, keep theirs.
inline void take_measured_loads(
    std::vector<HoldResponse>& holds, const Session& session, const std::vector<WrenchSample>& wrenches) {
  const double tare = force_tare_N(session, wrenches);
  for (HoldResponse& h : holds)
    if (const auto measured = measured_load_N(h.segment, session, wrenches, tare); measured && *measured > 0.0)
      h.load_N = *measured;
}

}  // namespace lumo::sense
