#pragma once

#include "lumo/core/error.hpp"
#include "lumo/sense/camera.hpp"
#include "lumo/sense/finger_view.hpp"
#include "lumo/sense/frame_monitor.hpp"
#include "lumo/sense/green_profile.hpp"
#include "lumo/sense/location_estimator.hpp"
#include "lumo/sense/session.hpp"
#include "lumo/sense/unloaded_reference.hpp"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace lumo {

/// Where a finger is touched, as its camera's pictures come. The pictures of the first `rest_s` seconds must show it unloaded: they tell where it lies and what its light is at
/// rest. `make(readout, unloaded)` gives the localiser; `told(stamp_ns, estimate, faults)` is called for each picture after that, without an estimate where it cannot be read or
/// FrameMonitor does not trust it, and says whether to go on. Ends with the camera. Throws InputError, with `name` before the message, where the rest shows no
/// finger, or no picture comes for `patience_s`.
template <Camera C, class MakeLocalizer, class Told>
void locate_live(C& camera, const Session& session, const LongitudinalBins& bins, MakeLocalizer make, Told told, const std::string& name, double rest_s = 1.0, double patience_s = 2.0) {
  using Clock = std::chrono::steady_clock;
  require_in_range("time that the finger rests", rest_s, 0.05, 60.0, "s");
  require_positive("patience with the camera", patience_s, "s");
  const auto since = [](Clock::time_point t) { return std::chrono::duration<double>(Clock::now() - t).count(); };
  const auto next = [&] {
    const auto from = Clock::now();
    auto frame = camera.next();
    while (!frame && camera.state() == StreamState::open) {
      if (since(from) > patience_s) throw InputError(detail::text(name, ": has given no picture for ", patience_s, " s"));
      std::this_thread::sleep_for(std::chrono::microseconds(200));   // cameras that wait by themselves have done so
      frame = camera.next();
    }
    return frame;
  };
  MeanImage mean;
  std::vector<Image> kept;   // a camera's own pixels are gone with its next picture
  std::vector<Frame> rest;
  auto frame = next();
  const std::int64_t first = frame ? frame->stamp_ns : 0;
  for (const auto from = Clock::now(); frame && 1e-9 * double(frame->stamp_ns - first) <= rest_s && since(from) <= rest_s + patience_s; frame = next()) {
    const ImageView& v = frame->image;
    if (v.empty() || rest.size() >= 300) continue;
    mean.add(v);
    kept.push_back(Image::black(v.width, v.height, v.format));
    for (int y = 0; y < v.height; ++y) std::copy_n(v.row(y), std::size_t(v.width) * std::size_t(channels(v.format)), kept.back().row(y));
    rest.push_back(*frame);
  }
  if (rest.empty()) throw InputError(detail::text(name, ": gives no pictures"));
  GreenProfile readout = view_finger(mean.image().view(), session, name).readout(bins);
  UnloadedReference unloaded;
  Profile p;
  for (std::size_t k = 0; k < rest.size(); ++k) {
    rest[k].image = kept[k].view();
    if (readout.read(rest[k], p)) unloaded.add(p);
  }
  if (unloaded.count() < 2) throw InputError(detail::text(name, ": ", unloaded.count(), " pictures of the unloaded finger can be read, must be at least 2"));
  FrameMonitor::Config trusted;
  trusted.position_m = readout.positions_m(), trusted.unloaded = unloaded.mean();
  if (rest.size() > 1) trusted.period_s = std::max(1e-4, 1e-9 * double(rest.back().stamp_ns - rest.front().stamp_ns) / double(rest.size() - 1));
  trusted.exposure_s = rest.front().exposure_s, trusted.gain = rest.front().gain;
  trusted.led_m.clear();
  for (int k = 0; k < session.led_count; ++k) trusted.led_m.push_back(session.led_first_y_m + k * session.led_pitch_m);
  FrameMonitor monitor(trusted);
  rest.clear(), kept.clear();
  auto localizer = make(readout, unloaded);
  for (; frame; frame = next()) {
    std::optional<LocationEstimate> estimate;
    auto verdict = monitor.check_time(frame->stamp_ns, frame->stamp_ns);
    if (verdict.usable) {
      const Faults time = verdict.faults;
      if (!readout.read(*frame, p)) verdict = FrameMonitor::reject(Fault::frame_corrupt);
      else verdict = monitor.check_light(p, frame->exposure_s, frame->gain);
      verdict.faults |= time;
    }
    if (verdict.usable) {
      unloaded.subtract(p);
      estimate = localizer.update(p);
    }
    if (!told(frame->stamp_ns, estimate, verdict.faults)) break;
  }
}

}  // namespace lumo
