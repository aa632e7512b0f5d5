#pragma once

#include "lumo/core/error.hpp"
#include "lumo/sense/recording/session.hpp"
#include "lumo/sense/recording/streams.hpp"
#include "lumo/sense/recording/tables.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace lumo::sense {

/// A log's session and tables; the pictures stay in their files. A table that is absent is empty.
struct Recording {
  std::string path;  ///< of the folder, or of the MCAP file
  Session session;
  std::vector<FrameRecord> frames;
  std::vector<JointSample> joints;
  std::vector<WrenchSample> wrenches;
  std::vector<MarkerSample> markers;
  std::vector<PhotodiodeSample> photodiodes;
  std::array<StreamReading, log_streams> reading{};  ///< of each LogStream, where it was read
  std::vector<std::string> notes{};                  ///< what readers of results should know of how it was read
  std::vector<std::string> joint_names{};            ///< of the samples' joints, in their order; empty: numbered
};

/// Throws InputError if the log has this stream and it could not be read.
inline void require_readable(const Recording& log, LogStream stream) {
  if (const std::string& fault = log.reading[std::size_t(stream)].fault; !fault.empty()) throw InputError(fault);
}

/// The same for all streams.
inline void require_readable(const Recording& log) {
  for (std::size_t s = 0; s < log_streams; ++s) require_readable(log, LogStream(s));
}

/// Throws InputError if pictures and joint samples, by the session's clocks, have no time in common.
inline void require_common_time(const Recording& log) {
  const auto frames = Stretch::of(log.frames);
  auto joints = Stretch::of(log.joints);
  if (!frames || !joints) return;
  joints = Stretch{log.session.joint_clock(joints->from_ns), log.session.joint_clock(joints->to_ns)};
  if (!joints->meets(*frames))
    throw InputError(message(log.path, ": pictures and joint samples have no time in common: pictures from ",
        to_string(*frames), ", joints from ", to_string(*joints),
        "; if their clocks differ, joint_clock of session.json must say by how much"));
}

/// Throws InputError where pictures or joint samples come faster than cameras and drives give them, more than 10,000 or
/// 100,000 times a second: their stamps are then not in ns.
inline void require_nanoseconds(const Recording& log) {
  const auto require = [&](const char* what, const auto& rows, double shortest_s) {
    if (rows.size() < 2) return;
    const double period_s = stream_period_s(rows);
    if (!(period_s > 0.0) || period_s >= shortest_s) return;
    throw InputError(message(log.path, ": ", what, " come ", std::round(1.0 / period_s),
        " times a second: stamps seem to be in ", period_s >= 1e-3 * shortest_s ? "µs" : "ms", ", must be in ns"));
  };
  require("pictures", log.frames, 1e-4);
  require("joint samples", log.joints, 1e-5);
}

/// Throws InputError if session and tables do not match: currents need a torque constant for each joint.
inline void validate(const Recording& log) {
  if (log.joints.empty() || log.joints.front().unit == Effort::torque_Nm) return;
  const auto joints = std::size_t(log.joints.front().effort.size());
  if (log.session.torque_constant_Nm_per_A.size() != joints)
    throw InputError(message(log.path, ": has currents of ", joints, " joints, its session ",
        log.session.torque_constant_Nm_per_A.size(), " torque constants"));
}

/// The segments of a session as the plan of a recording, in the order of time, each announced `notice_s` before it
/// begins. Times count from the first picture. A plan that begins within the notice, or after `latest_begin_ns` (on
/// another recording's clock), is moved as a whole to begin right after the notice.
class RecordingPlan {
 public:
  static constexpr double notice_s = 2.0;
  static constexpr std::int64_t latest_begin_ns = 60'000'000'000;

  explicit RecordingPlan(std::vector<Segment> segments) : segments_(std::move(segments)) {
    std::stable_sort(
        segments_.begin(), segments_.end(), [](const Segment& a, const Segment& b) { return a.from_ns < b.from_ns; });
    if (segments_.empty()) return;
    constexpr auto notice_ns = std::int64_t(1e9 * notice_s);
    const std::int64_t begin = segments_.front().from_ns,
                       shift = begin >= notice_ns && begin <= latest_begin_ns ? 0 : notice_ns - begin;
    for (Segment& s : segments_) {
      s.from_ns += shift;
      s.to_ns += shift;
    }
  }

  const std::vector<Segment>& segments() const { return segments_; }
  /// When the last one ends [s]; 0 without any.
  double seconds() const {
    std::int64_t end = 0;
    for (const Segment& s : segments_) end = std::max(end, s.to_ns);
    return 1e-9 * double(end);
  }
  /// The next segment to be announced by now, each once; null: none.
  const Segment* announced(double now_s) {
    return next_ < segments_.size() && 1e-9 * double(segments_[next_].from_ns) - notice_s <= now_s ? &segments_[next_++]
                                                                                                   : nullptr;
  }
  /// The segments that a recording which ended at this time holds whole.
  std::vector<Segment> done(std::int64_t end_ns) const {
    std::vector<Segment> list;
    for (const Segment& s : segments_)
      if (s.to_ns <= end_ns) list.push_back(s);
    return list;
  }

 private:
  std::vector<Segment> segments_;
  std::size_t next_ = 0;
};

}  // namespace lumo::sense
