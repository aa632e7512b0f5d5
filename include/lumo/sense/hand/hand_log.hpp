#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/hand/hand_observer.hpp"
#include "lumo/sense/recording/alignment.hpp"
#include "lumo/sense/recording/csv.hpp"
#include "lumo/sense/recording/session.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <istream>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace lumo::sense {

/// The observer of the hand that a log's session describes. Throws InvalidArgument without a hand.
inline HandObserver hand_observer(const Session& session, HandObserver::Config config = {}) {
  std::vector<HandLink> links;
  std::vector<LinkMap> first;
  for (const SessionLink& l : session.links) {
    links.push_back(l.link);
    first.push_back(LinkMap::fit(l.link.hole_m, l.hole_px, l.link.z_clockwise));
  }
  return {std::move(links), std::move(first), std::move(config)};
}

/// Positions of all joints over time, on the frames' clock, delay taken off. Throws InvalidArgument for samples of
/// different size or order.
inline TimeSeries joint_positions(std::span<const JointSample> samples, const Session& session) {
  std::vector<std::int64_t> stamp;
  Eigen::MatrixXd position(samples.empty() ? 0 : samples.front().position_rad.size(), Eigen::Index(samples.size()));
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const JointSample& s = samples[i];
    if (s.position_rad.size() != position.rows())
      throw InvalidArgument(
          message("joint sample ", i, " has ", s.position_rad.size(), " joints, the first one has ", position.rows()));
    stamp.push_back(session.joint_clock(s.stamp_ns) - std::llround(1e9 * session.joint_delay_s));
    position.col(Eigen::Index(i)) = s.position_rad;
  }
  return {std::move(stamp), std::move(position)};
}

/// Whether a segment states that nothing touches the hand then.
inline bool is_unloaded(const Session& session, std::int64_t stamp_ns) {
  return std::any_of(session.segments.begin(), session.segments.end(), [&](const Segment& s) {
    return (s.kind == SegmentKind::free || s.kind == SegmentKind::unloaded) && s.holds(stamp_ns);
  });
}

/// Plays a log to a hand's observer, frame by frame. `each(estimate, image)` gets a std::optional<HandEstimate>:
/// nullopt if the frame lies in a segment of kind `free` or `unloaded` and becomes a reference. No link is seen while
/// the joints are unknown, between samples more than `max_gap_s` apart. Returns the number of references.
template <Camera C, class Each> int observe_hand(C& camera, HandObserver& hand, const TimeSeries& positions,
    const Session& session, Each each, double max_gap_s = 0.1) {
  int references = 0;
  for (auto frame = camera.next(); frame; frame = camera.next()) {
    const auto joints = positions.at(frame->stamp_ns - std::llround(1e9 * session.frame_delay_s), max_gap_s);
    std::optional<HandEstimate> estimate;
    if (is_unloaded(session, frame->stamp_ns)) references += joints && hand.add_reference(*joints, frame->image) > 0;
    else estimate = joints ? hand.observe(frame->stamp_ns, *joints, frame->image) : hand.unseen(frame->stamp_ns);
    each(estimate, frame->image);
  }
  return references;
}

/// Shows a hand's observer only a log's pictures of the unloaded hand. Returns the number of references.
template <Camera C> int add_references(
    C& camera, HandObserver& hand, const TimeSeries& positions, const Session& session, double max_gap_s = 0.1) {
  int references = 0;
  for (auto frame = camera.next(); frame; frame = camera.next())
    if (is_unloaded(session, frame->stamp_ns))
      if (const auto joints = positions.at(frame->stamp_ns - std::llround(1e9 * session.frame_delay_s), max_gap_s))
        references += hand.add_reference(*joints, frame->image) > 0;
  return references;
}

/// True contacts on a hand, frame by frame, by a lab's truth.csv: stamp_ns, link, y_mm, force_N, one row for each
/// contact of a frame. Estimators do not read it.
class HandTouches {
 public:
  struct Touch {
    int link;
    double y_m, force_N;
  };

  /// Throws InputError.
  static HandTouches from_table(std::istream& in, const std::string& name) {
    CsvReader csv(in, name);
    const int stamp = csv.require("stamp_ns"), link = csv.require("link"), y = csv.require("y_mm"),
              force = csv.require("force_N");
    HandTouches t;
    while (csv.next()) {
      const std::int64_t number = csv.integer(link);
      const double y_m = 1e-3 * csv.number(y);
      if (number < 0 || number > 15) csv.fail(link, "must lie in [0, 15]");
      if (std::abs(y_m) > 10.0) csv.fail(y, "must lie within 10000 mm");
      t.rows_.push_back({csv.integer(stamp), {int(number), y_m, csv.number(force)}});
    }
    std::stable_sort(t.rows_.begin(), t.rows_.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    return t;
  }
  std::vector<Touch> at(std::int64_t stamp_ns) const {
    std::vector<Touch> touches;
    for (auto row = std::lower_bound(
             rows_.begin(), rows_.end(), stamp_ns, [](const auto&r, std::int64_t t) { return r.first < t; });
         row != rows_.end() && row->first == stamp_ns; ++row)
      touches.push_back(row->second);
    return touches;
  }

 private:
  std::vector<std::pair<std::int64_t, Touch>> rows_;
};

/// How well a hand's contacts agree with the truth.
struct HandScore {
  int touches = 0;     ///< in all frames, of at least the least force
  int found = 0;       ///< of them, those with a contact on their link within 8 mm, `near_m`
  double mae_m = 0.0;  ///< along the link, over those found
  int contacts = 0;    ///< in all estimates
  int unfounded = 0;   ///< of them, those with no touch, however weak, so near on their link

  static constexpr double near_m = 8.0_mm;

  /// One frame.
  void add(const HandEstimate& e, const std::vector<HandTouches::Touch>& truth, double least_N = 5.0) {
    for (const auto& t : truth) {
      if (t.force_N < least_N) continue;
      ++touches;
      double off = near_m;
      bool hit = false;
      for (const HandContact& c : e.contacts)
        if (c.link == t.link && std::abs(c.y_m - t.y_m) <= off) {
          off = std::abs(c.y_m - t.y_m);
          hit = true;
        }
      if (hit) mae_m += (off - mae_m) / double(++found);
    }
    for (const HandContact& c : e.contacts) {
      ++contacts;
      unfounded += std::none_of(truth.begin(), truth.end(),
          [&](const auto& t) { return t.link == c.link && std::abs(c.y_m - t.y_m) <= near_m; });
    }
  }
};

}  // namespace lumo::sense
