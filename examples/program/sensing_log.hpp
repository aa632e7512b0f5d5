#pragma once

#include "lumo/sense/log_estimates.hpp"
#include "lumo/support/json.hpp"
#include "lumo/support/opencv.hpp"

#include <string>
#include <variant>
#include <vector>

namespace lumo::program {

/// A log's pictures, from a folder or a video.
class LogCamera {
 public:
  explicit LogCamera(const LogFolder& log) : source_(open(log)) {}
  std::optional<Frame> next() {
    return std::visit([](auto& c) { return c.next(); }, source_);
  }
  StreamState state() const {
    return std::visit([](const auto& c) { return c.state(); }, source_);
  }

 private:
  static std::variant<FolderCamera, VideoCamera> open(const LogFolder& log) {
    if (!log.session.video.empty()) return VideoCamera(log.path + '/' + log.session.video, log.frames);
    if (log.frames.empty()) throw InputError(log.path + ": has no frames.csv, or it is empty");
    return FolderCamera(log.path + "/frames", log.frames);
  }
  std::variant<FolderCamera, VideoCamera> source_;
};

static_assert(Camera<LogCamera>);

/// A log as the sensing commands need it: read once.
struct SensedLog {
  LogFolder log;
  std::vector<JointSample> joints;       ///< on the frames' clock
  std::vector<std::int64_t> frame_ns;
  UnloadedStretch stretch;
  FingerView view;
  std::vector<Profile> profiles;         ///< of `bins`
  LongitudinalBins bins = LongitudinalBins::uniform(-27.5_mm, 27.5_mm, 55);
};

/// Throws InputError.
SensedLog read_sensed_log(const std::string& path, const LongitudinalBins& bins);

}  // namespace lumo::program
