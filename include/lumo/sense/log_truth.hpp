#pragma once

#include "lumo/core/units.hpp"
#include "lumo/sense/csv.hpp"
#include "lumo/sense/log.hpp"
#include "lumo/sense/session.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <istream>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace lumo {

/// What a log says of the contacts that its estimates are compared with. Only whoever compares reads it.
class LogTruth {
 public:
  struct Touch {
    std::optional<double> y_m, force_N;
  };

  /// From the jig's places (segments) and the force sensor. The sensor is tared on what it reads where segments say unloaded.
  static LogTruth from_log(const Session& session, const std::vector<WrenchSample>& wrenches) {
    LogTruth t;
    t.segments_ = session.segments;
    double tare = 0.0;
    long count = 0;
    for (const WrenchSample& w : wrenches) t.force_.push_back({session.wrench_clock(w.stamp_ns), -w.force_N.z()});
    for (const auto& f : t.force_)
      for (const Segment& s : t.segments_)
        if (s.kind == "unloaded" && f.first >= s.from_ns && f.first <= s.to_ns) tare += f.second, ++count;
    if (count > 0)
      for (auto& f : t.force_) f.second -= tare / double(count);
    return t;
  }
  /// From a lab's truth.csv: stamp_ns, contact, y_mm, force_N and columns that are not read. Throws InputError.
  static LogTruth from_table(std::istream& in, const std::string& name) {
    CsvReader csv(in, name);
    detail::StampColumn stamp(csv);
    const int contact = csv.require("contact"), y = csv.require("y_mm"), force = csv.require("force_N");
    LogTruth t;
    t.tabled_ = true;
    while (csv.next()) {
      const std::int64_t at = stamp.read(csv);
      t.force_.push_back({at, csv.number(force)});
      t.place_m_.push_back(csv.integer(contact) < 0 ? std::nullopt : std::optional(1e-3 * csv.number(y)));
    }
    return t;
  }

  /// Place and force at a time; empty is what is not known there. No contact: a force of 0 where that is known, and no place.
  Touch at(std::int64_t stamp_ns) const {
    Touch touch;
    const auto after = std::lower_bound(force_.begin(), force_.end(), stamp_ns, [](const auto& f, std::int64_t t) { return f.first < t; });
    if (tabled_) {
      if (after != force_.end() && after->first == stamp_ns) touch = {place_m_[std::size_t(after - force_.begin())], after->second};
      return touch;
    }
    if (after != force_.end() && after != force_.begin()) {
      const auto& b = *after;
      const auto& a = *(after - 1);
      if (b.first - a.first < 100'000'000) touch.force_N = a.second + (b.second - a.second) * double(stamp_ns - a.first) / double(b.first - a.first);
    }
    for (const Segment& s : segments_)
      if (s.place >= 0 && stamp_ns >= s.from_ns && stamp_ns <= s.to_ns) {
        touch.y_m = 1e-3 * s.y_mm;
        if (!touch.force_N) touch.force_N = s.load_N;
      }
    return touch;
  }

 private:
  bool tabled_ = false;
  std::vector<std::pair<std::int64_t, double>> force_;
  std::vector<std::optional<double>> place_m_;  ///< of a table, row by row
  std::vector<Segment> segments_;
};

}  // namespace lumo
