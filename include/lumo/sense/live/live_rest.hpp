#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/stopwatch.hpp"
#include "lumo/sense/devices/camera.hpp"
#include "lumo/sense/profile/finger_view.hpp"
#include "lumo/sense/profile/frame_monitor.hpp"
#include "lumo/sense/profile/green_profile.hpp"
#include "lumo/sense/profile/unloaded_reference.hpp"
#include "lumo/sense/recording/session.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace lumo::sense {

/// How live streams are waited for.
struct LiveWait {
  double rest_s = 1.0;                   ///< how long the finger rests unloaded at the start
  double patience_s = 2.0;               ///< without any picture
  std::int64_t (*now_ns)() = steady_ns;  ///< on the clock of the stamps
};

/// Throws InvalidArgument.
inline void validate(const LiveWait& w) {
  require_in_range("time that the finger rests", w.rest_s, 0.05, 60.0, "s");
  require_positive("patience with the camera", w.patience_s, "s");
}

/// Lets others run; cameras that wait by themselves have done so before.
inline void idle() { pause_for(200e-6); }

/// The next picture, or nothing when the camera has ended; `meanwhile()` is called while none is there. Throws
/// InputError, with `name` before the message, where none comes in time.
template <Camera C, class Meanwhile>
std::optional<Frame> next_picture(C& camera, const LiveWait& w, const std::string& name, Meanwhile meanwhile) {
  const std::int64_t from = w.now_ns();
  auto frame = camera.next();
  while (!frame && camera.state() == StreamState::open) {
    if (1e-9 * double(w.now_ns() - from) > w.patience_s)
      throw InputError(message(name, ": has given no picture for ", w.patience_s, " s"));
    meanwhile();
    idle();
    frame = camera.next();
  }
  return frame;
}

/// What the first pictures of a live camera tell about a finger that nothing touches.
struct LiveRest {
  FingerView view;
  GreenProfile readout;
  UnloadedReference unloaded;
  FrameMonitor::Config trusted;  ///< pictures like those
  std::optional<Frame> next;     ///< the first one after the rest; its pixels are the camera's
};

/// Looks at the finger for `wait.rest_s`; `meanwhile()` is called while no picture is there. Throws InputError, with
/// `name` before the message, where no finger is seen or no picture comes for `wait.patience_s`.
template <Camera C, class Meanwhile>
LiveRest look_at_rest(C& camera, const Session& session, const LongitudinalBins& bins, const LiveWait& wait,
                      const std::string& name, Meanwhile meanwhile) {
  validate(wait);
  MeanImage mean;
  std::vector<Image> kept;  // a camera's own pixels are gone with its next picture
  std::vector<Frame> rest;
  auto frame = next_picture(camera, wait, name, meanwhile);
  const std::int64_t first = frame ? frame->stamp_ns : 0, from = wait.now_ns();
  for (; frame && 1e-9 * double(frame->stamp_ns - first) <= wait.rest_s &&
         1e-9 * double(wait.now_ns() - from) <= wait.rest_s + wait.patience_s;
       frame = next_picture(camera, wait, name, meanwhile)) {
    const ImageView& v = frame->image;
    if (v.empty() || rest.size() >= 300) continue;
    mean.add(v);
    kept.push_back(Image::black(v.width, v.height, v.format));
    for (int y = 0; y < v.height; ++y)
      std::copy_n(v.row(y), std::size_t(v.width) * std::size_t(channels(v.format)), kept.back().row(y));
    rest.push_back(*frame);
  }
  if (rest.empty()) throw InputError(message(name, ": gives no pictures"));
  const FingerView view = view_finger(mean.image().view(), session, name);
  GreenProfile readout = view.readout(bins);
  UnloadedReference unloaded;
  Profile p;
  for (std::size_t k = 0; k < rest.size(); ++k) {
    rest[k].image = kept[k].view();
    if (readout.read(rest[k], p)) unloaded.add(p);
  }
  if (unloaded.count() < 2)
    throw InputError(
        message(name, ": ", unloaded.count(), " pictures of the unloaded finger can be read, must be at least 2"));
  FrameMonitor::Config trusted;
  trusted.position_m = readout.positions_m(), trusted.unloaded = unloaded.mean();
  if (rest.size() > 1)
    trusted.period_s =
        std::max(1e-4, 1e-9 * double(rest.back().stamp_ns - rest.front().stamp_ns) / double(rest.size() - 1));
  trusted.exposure_s = rest.front().exposure_s, trusted.gain = rest.front().gain;
  trusted.led_m.clear();
  for (int k = 0; k < session.led_count; ++k) trusted.led_m.push_back(session.led_first_y_m + k * session.led_pitch_m);
  return {view, std::move(readout), std::move(unloaded), std::move(trusted), frame};
}

}  // namespace lumo::sense
