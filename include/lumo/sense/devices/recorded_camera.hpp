#pragma once

#include "lumo/sense/devices/camera.hpp"

#include <utility>
#include <vector>

namespace lumo::sense {

/// A frame together with its pixels.
struct RecordedFrame {
  Image image;
  std::int64_t stamp_ns = 0;
  double exposure_s = 0.0;
  double gain = 0.0;
};

/// Frames that are in memory, given as fast as they are asked for.
class RecordedCamera {
 public:
  explicit RecordedCamera(std::vector<RecordedFrame> frames) : frames_(std::move(frames)) {}

  std::optional<Frame> next() {
    if (next_ == frames_.size()) return std::nullopt;
    const RecordedFrame& f = frames_[next_];
    return Frame{f.image.view(), f.stamp_ns, f.exposure_s, f.gain, std::int64_t(next_++)};
  }
  StreamState state() const { return next_ == frames_.size() ? StreamState::ended : StreamState::open; }

 private:
  std::vector<RecordedFrame> frames_;
  std::size_t next_ = 0;
};

static_assert(Camera<RecordedCamera>);

}  // namespace lumo::sense
