#pragma once

#include "console/progress.hpp"
#include "sensing/camera_options.hpp"
#include "sensing/pictures.hpp"

#include "lumo/support/socketcan.hpp"

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

/// Before a live camera: one line on standard output for each picture, until --seconds are over, the camera goes, or
/// nobody reads.
namespace lumo::program {

using namespace sense;

/// Listens on the bus; whoever controls the motors commands them.
MiniCheetahMotors motors_of(const CameraOptions& o);

/// As many motors as the log's joints; said before a device is opened. Throws UsageError.
void require_motors(const CameraOptions& o, int joints);

/// One line for each picture, and how long after its stamp it came.
class LiveLines {
 public:
  explicit LiveLines(const CameraOptions& o) : o_(o) {}

  /// Since the first line.
  double seconds(std::int64_t stamp_ns);
  /// A line about a picture, or none (of a time without pictures). Says whether to go on.
  bool operator()(std::optional<std::int64_t> picture_ns, bool used, const std::string& line);
  /// Notes how many there were. Throws InputError if none.
  void close(Progress& progress) const;

 private:
  const CameraOptions& o_;
  std::vector<double> late_ms_;
  int unused_ = 0;
  std::int64_t first_ = 0, begun_ = 0;
};

/// Runs `work(lines)` before the camera; returns nothing to print. Throws InputError.
std::string before_camera(const CameraOptions& o, Progress& progress, const std::function<void(LiveLines&)>& work);

/// Records camera and motors as a log in `folder`, by the plan that the session of `log` is, if there is one. Throws
/// InputError.
struct Recorded {
  std::string counts;  ///< what was recorded, in words
  std::size_t frames = 0, samples = 0, lost_frames = 0, lost_samples = 0, segments = 0;
};
Recorded record(const CameraOptions& o, const std::string& log, const std::string& folder, Progress& progress);

}  // namespace lumo::program
