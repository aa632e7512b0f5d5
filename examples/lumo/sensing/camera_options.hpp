#pragma once

#include "options/options.hpp"
#include "sensing/pictures.hpp"

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace lumo::program {

using namespace sense;

/// A live camera and motors.
struct CameraOptions {
  std::optional<int> number;
  double exposure_ms = 1.0, gain = 64.0, rate_per_s = 30.0;
  std::array<int, 2> pixels = {640, 480};
  double seconds = 0.0;                                     ///< to look through it; 0: until interrupted
  std::string can;                                          ///< interface of the motors' bus; empty: no motors
  std::vector<int> motors = {1};                            ///< on it, in the order of the joints
  std::array<double, 3> motor_ranges = {12.5, 65.0, 18.0};  ///< position [rad], velocity [rad/s], torque [N·m]

  /// Throws UsageError for options that do not go together, Error where cameras cannot be used.
  void check() const;
  std::string device() const { return "/dev/video" + std::to_string(*number); }
};

CLI::Option* add_camera(CLI::App& app, CameraOptions& o, const std::string& help);
/// What follows is of the camera or of the motors, and registered after what chooses them.
void add_seconds(CLI::App& app, CameraOptions& o, const std::string& help);
void add_picture_options(CLI::App& app, CameraOptions& o);
void add_motor_options(CLI::App& app, CameraOptions& o);

LiveSettings settings_of(const CameraOptions& o);

/// Rate, exposure and LEDs of a live camera, looked through for two seconds. Throws InputError.
std::string watch(const CameraOptions& o, bool as_json);

}  // namespace lumo::program
