#pragma once

#include "lumo/core/units.hpp"
#include "lumo/sense/recording/alignment.hpp"
#include "lumo/sense/recording/csv.hpp"
#include "lumo/sense/recording/session.hpp"
#include "lumo/sense/recording/tables.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <istream>
#include <optional>
#include <string>
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

/// What the force sensor reads in the unloaded segments, mean normal force [N]; 0 without any.
inline double force_tare_N(const Session& session, const std::vector<WrenchSample>& wrenches) {
  double sum = 0.0;
  long count = 0;
  for (const WrenchSample& w : wrenches) {
    const std::int64_t at = session.wrench_clock(w.stamp_ns);
    for (const Segment& s : session.segments)
      if (s.kind == SegmentKind::unloaded && s.holds(at)) {
        sum += w.normal_force_N();
        ++count;
      }
  }
  return count > 0 ? sum / double(count) : 0.0;
}

/// The true contacts of a log, for comparison with its estimates. Estimators do not read it.
class LogTruth {
 public:
  struct Touch {
    std::optional<double> y_m, force_N;
  };
  static constexpr double max_gap_s = 0.1;  ///< between samples of the force sensor; beyond, the force is unknown

  /// From the jig's places (segments) and the force sensor, which is tared on its unloaded segments. Throws
  /// InvalidArgument if the session's clock leads two of its samples to the same time.
  static LogTruth from_log(const Session& session, const std::vector<WrenchSample>& wrenches) {
    LogTruth t;
    t.segments_ = session.segments;
    t.force_ = normal_force(wrenches, session.wrench_clock, force_tare_N(session, wrenches));
    return t;
  }
  /// From a lab's truth.csv: stamp_ns, contact, y_mm, force_N and columns that are not read. Throws InputError.
  static LogTruth from_table(std::istream& in, const std::string& name) {
    CsvReader csv(in, name);
    StampColumn stamp(csv);
    const int contact = csv.require("contact"), y = csv.require("y_mm"), force = csv.require("force_N");
    LogTruth t;
    while (csv.next()) {
      const std::int64_t at = stamp.read(csv);
      t.table_.push_back(
          {at, {csv.integer(contact) < 0 ? std::nullopt : std::optional(1e-3 * csv.number(y)), csv.number(force)}});
    }
    return t;
  }

  /// Place and force at a time; unknown values are empty. Without contact the place is empty and a known force is 0.
  Touch at(std::int64_t stamp_ns) const {
    if (!force_) {
      const auto row = std::lower_bound(
          table_.begin(), table_.end(), stamp_ns, [](const auto& r, std::int64_t t) { return r.first < t; });
      return row != table_.end() && row->first == stamp_ns ? row->second : Touch{};
    }
    Touch touch;
    if (const auto f = force_->at(stamp_ns, max_gap_s)) touch.force_N = (*f)[0];
    for (const Segment& s : segments_)
      if (s.place >= 0 && s.holds(stamp_ns)) {
        touch.y_m = 1e-3 * s.y_mm;
        if (!touch.force_N) touch.force_N = s.load_N;
      }
    return touch;
  }

 private:
  std::optional<TimeSeries> force_;  ///< of a log's sensor; none of a table
  std::vector<Segment> segments_;
  std::vector<std::pair<std::int64_t, Touch>> table_;
};

}  // namespace lumo::sense
