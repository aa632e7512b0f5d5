#pragma once

#include "lumo/sense/devices/actuator.hpp"
#include "lumo/sense/live/live_rest.hpp"
#include "lumo/sense/hand/hand_log.hpp"

#include <cmath>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace lumo::sense {

/// Contacts on a hand as pictures and joint samples come, both stamped on one clock; `hand` has its references
/// (add_references). `told(estimate, image)` is called for each picture and says whether to go on; no link is seen in
/// pictures for which the joints are not known. Ends with the camera. Throws InputError, with `name` before the
/// message, where no picture comes for `wait.patience_s`.
template <Camera C, Actuator A, class Told>
void observe_hand_live(C& camera, A& actuator, HandObserver& hand, const Session& session, Told told,
                       const std::string& name, const LiveWait& wait = {}, double max_gap_s = 0.1) {
  validate(wait);
  Session one_clock = session;
  one_clock.joint_clock = {};
  std::vector<JointSample> recent;
  const auto drain = [&] {
    for (auto s = actuator.next(); s; s = actuator.next())
      if (recent.empty() ||
          (s->stamp_ns > recent.back().stamp_ns && s->position_rad.size() == recent.back().position_rad.size()))
        recent.push_back(std::move(*s));
    if (recent.size() > 4096) recent.erase(recent.begin(), recent.end() - 2048);
  };
  while (actuator.next()) {
  }  // what queued up before is not of this time
  for (auto frame = next_picture(camera, wait, name, drain); frame; frame = next_picture(camera, wait, name, drain)) {
    drain();
    const TimeSeries positions = joint_positions(std::span<const JointSample>(recent), one_clock);
    const std::int64_t at = frame->stamp_ns - std::llround(1e9 * session.frame_delay_s);
    auto joints = positions.at(at, max_gap_s);
    if (!joints && !recent.empty())  // the newest sample may be a little older than the picture
      if (const double age_s = 1e-9 * double(at - recent.back().stamp_ns) + session.joint_delay_s;
          age_s >= 0.0 && age_s <= max_gap_s)
        joints = recent.back().position_rad;
    if (!told(joints ? hand.observe(frame->stamp_ns, *joints, frame->image) : hand.unseen(frame->stamp_ns),
              frame->image))
      return;
  }
}

}  // namespace lumo::sense
