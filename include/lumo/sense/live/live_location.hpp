#pragma once

#include "lumo/sense/live/live_rest.hpp"
#include "lumo/sense/localize/location_estimator.hpp"

#include <cstdint>
#include <optional>
#include <string>

namespace lumo::sense {

/// Where a finger is touched, as its camera's pictures come. The pictures of the first `wait.rest_s` seconds must show
/// it unloaded: they tell where it lies and what its light is at rest. `make(readout, unloaded)` gives the localiser;
/// `told(stamp_ns, estimate, faults)` is called for each picture after that, without an estimate where it cannot be
/// read or FrameMonitor does not trust it, and says whether to go on. Ends with the camera. Throws as look_at_rest, and
/// where no picture comes for `wait.patience_s`.
template <Camera C, class MakeLocalizer, class Told>
void locate_live(C& camera, const Session& session, const LongitudinalBins& bins, MakeLocalizer make, Told told,
                 const std::string& name, const LiveWait& wait = {}) {
  LiveRest rest = look_at_rest(camera, session, bins, wait, name, [] {});
  FrameMonitor monitor(rest.trusted);
  auto localizer = make(rest.readout, rest.unloaded);
  Profile p;
  for (auto frame = rest.next; frame; frame = next_picture(camera, wait, name, [] {})) {
    std::optional<LocationEstimate> estimate;
    auto verdict = monitor.check_time(frame->stamp_ns, frame->stamp_ns);
    if (verdict.usable) {
      const Faults time = verdict.faults;
      if (!rest.readout.read(*frame, p))
        verdict = FrameMonitor::reject(Fault::frame_corrupt);
      else
        verdict = monitor.check_light(p, frame->exposure_s, frame->gain);
      verdict.faults |= time;
    }
    if (verdict.usable) {
      rest.unloaded.subtract(p);
      estimate = localizer.update(p);
    }
    if (!told(frame->stamp_ns, estimate, verdict.faults)) break;
  }
}

}  // namespace lumo::sense
