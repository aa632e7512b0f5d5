#pragma once

#include "lumo/sense/devices/device.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
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

/// Joint samples that are in memory, given as fast as they are asked for. `read_joint_log` (sense/recording/tables.hpp)
/// reads them from a file.
class RecordedActuator {
 public:
  explicit RecordedActuator(std::vector<JointSample> samples) : samples_(std::move(samples)) {}

  std::optional<JointSample> next() {
    return next_ == samples_.size() ? std::nullopt : std::optional<JointSample>(samples_[next_++]);
  }
  StreamState state() const { return next_ == samples_.size() ? StreamState::ended : StreamState::open; }

 private:
  std::vector<JointSample> samples_;
  std::size_t next_ = 0;
};

static_assert(Actuator<RecordedActuator>);

/// A recorded stream in its own time: no item is there before its stamp. One item is read ahead, so that the time to
/// read a picture does not count.
template <class Source> class Replay {
 public:
  explicit Replay(Source source) : source_(std::move(source)), ahead_(source_.next()) {}

  /// Lets all up to this time through.
  void until(std::int64_t now_ns) {
    now_ns_ = now_ns;
    if (!ahead_) ahead_ = source_.next();
  }
  auto next() {
    if (!ahead_ || ahead_->stamp_ns > now_ns_) return decltype(ahead_)();
    auto item = std::move(ahead_);
    ahead_.reset();
    // A sample owns its values; a picture stays valid until the next one is read.
    if constexpr (Actuator<Source>) ahead_ = source_.next();
    return item;
  }
  StreamState state() const { return ahead_ ? StreamState::open : source_.state(); }

 private:
  Source source_;
  decltype(std::declval<Source&>().next()) ahead_;
  std::int64_t now_ns_ = INT64_MIN;
};

}  // namespace lumo::sense
