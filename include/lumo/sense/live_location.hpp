#pragma once

#include "lumo/core/error.hpp"
#include "lumo/sense/camera.hpp"
#include "lumo/sense/finger_view.hpp"
#include "lumo/sense/location_estimator.hpp"

#include <chrono>
#include <cstdint>
#include <thread>
#include <vector>

namespace lumo {

/// Where a finger is touched, as its camera's pictures come. The pictures of the first `rest_s` seconds must show it unloaded: they tell where it lies and what its light is at
/// rest. `make(readout, unloaded)` gives the localiser; `told(estimate)` is called for each picture after that which can be read, and says whether to go on. Ends with
/// the camera. Returns how many pictures could not be read. Throws InputError, with `name` before the message, where the rest shows no finger.
template <Camera C, class MakeLocalizer, class Told>
int locate_live(C& camera, const Session& session, const LongitudinalBins& bins, MakeLocalizer make, Told told, const std::string& name, double rest_s = 1.0) {
  require_in_range("time that the finger rests", rest_s, 0.05, 60.0, "s");
  const auto next = [&] {
    auto frame = camera.next();
    while (!frame && camera.state() == StreamState::open) {
      std::this_thread::sleep_for(std::chrono::microseconds(200));   // cameras that wait by themselves have done so
      frame = camera.next();
    }
    return frame;
  };
  MeanImage mean;
  std::vector<Frame> rest;
  std::vector<std::vector<std::uint8_t>> pixels;
  auto frame = next();
  for (const std::int64_t first = frame ? frame->stamp_ns : 0; frame && 1e-9 * double(frame->stamp_ns - first) <= rest_s; frame = next()) {
    const ImageView& v = frame->image;
    if (v.empty() || rest.size() >= 300) continue;
    mean.add(v);
    // The camera's own pixels are gone with the next picture.
    const std::size_t row = std::size_t(v.width) * std::size_t(channels(v.format));
    pixels.emplace_back();
    for (int y = 0; y < v.height; ++y) pixels.back().insert(pixels.back().end(), v.row(y), v.row(y) + row);
    rest.push_back(*frame);
    rest.back().image = {pixels.back().data(), v.width, v.height, std::ptrdiff_t(row), v.format};
  }
  if (rest.empty()) throw InputError(detail::text(name, ": gives no pictures"));
  GreenProfile readout = view_finger(mean.image().view(), session, name).readout(bins);
  UnloadedReference unloaded;
  Profile p;
  for (const Frame& f : rest)
    if (readout.read(f, p)) unloaded.add(p);
  if (unloaded.count() < 2) throw InputError(detail::text(name, ": ", unloaded.count(), " pictures of the unloaded finger can be read, must be at least 2"));
  rest.clear(), pixels.clear();
  auto localizer = make(readout, unloaded);
  int unreadable = 0;
  for (; frame; frame = next()) {
    if (!readout.read(*frame, p)) {
      ++unreadable;
      continue;
    }
    unloaded.subtract(p);
    if (!told(localizer.update(p))) break;
  }
  return unreadable;
}

}  // namespace lumo
