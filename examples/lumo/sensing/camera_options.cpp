#include "sensing/camera_options.hpp"

#include <algorithm>

namespace lumo::program {

using namespace sense;

namespace {

constexpr std::size_t most_motors = 8;

/// Reads an option of the camera, which must have been chosen before.
Read of_camera(const CameraOptions& o, const std::string& flag, Read read) {
  return [&o, flag, read = std::move(read)](const std::string& typed) {
    if (!o.number) throw UsageError(flag + " is of a live camera, which --camera chooses");
    read(typed);
  };
}

Read of_motors(const CameraOptions& o, const std::string& flag, Read read) {
  return [&o, flag, read = std::move(read)](const std::string& typed) {
    if (o.can.empty()) throw UsageError(flag + " is of motors, whose bus --can chooses");
    read(typed);
  };
}

/// Fields between separators.
template <std::size_t N> std::array<double, N> numbers_in(const char* flag, const std::string& typed, char separator,
    const Limits& limits, const char* unit, const char* wanted) {
  std::array<double, N> values{};
  const auto fields = split(typed, separator);
  if (fields.size() != N) throw UsageError(std::string(flag) + " is " + in_quotes(typed) + ", must be " + wanted);
  for (std::size_t i = 0; i < N; ++i) values[i] = number_in(flag, fields[i], limits, unit);
  return values;
}

std::array<int, 2> read_pixels(const std::string& typed) {
  const auto size =
      numbers_in<2>("--pixels", typed, 'x', {16.0, 10000.0}, "px", "a width and a height such as 640x480");
  const std::array<int, 2> pixels = {int(size[0]), int(size[1])};
  if (size[0] != pixels[0] || size[1] != pixels[1])
    throw UsageError("--pixels is " + in_quotes(typed) + ", must be whole numbers");
  return pixels;
}

std::vector<int> read_motors(const std::string& typed) {
  std::vector<int> motors;
  for (const std::string_view field : split(typed)) {
    motors.push_back(whole_in("--motors", field, 0, 255));
    if (std::count(motors.begin(), motors.end(), motors.back()) > 1 || motors.size() > most_motors)
      throw UsageError("--motors is " + in_quotes(typed) + ", must be at most 8 different numbers");
  }
  return motors;
}

}  // namespace

CLI::Option* add_camera(CLI::App& app, CameraOptions& o, const std::string& help) {
  return add_value(
      app, "--camera", "N", help, [&o](const std::string& typed) { o.number = whole_in("--camera", typed, 0, 63); });
}

void add_seconds(CLI::App& app, CameraOptions& o, const std::string& help) {
  add_value(app, "--seconds", "N", help, of_camera(o, "--seconds", [&o](const std::string& typed) {
    o.seconds = number_in("--seconds", typed, {1.0, 1e6}, "s");
  }));
}

void add_picture_options(CLI::App& app, CameraOptions& o) {
  const auto number = [&](const char* flag, double& into, const Limits& limits, const char* unit, const char* help) {
    add_value(app, flag, "N", help, of_camera(o, flag, [&into, flag, limits, unit](const std::string& typed) {
      into = number_in(flag, typed, limits, unit);
    }));
  };
  number("--exposure", o.exposure_ms, {0.1, 200.0}, "ms", "Of the camera [ms], default 1");
  number("--gain", o.gain, {0.0, 1e9}, "", "Of the camera, its driver's number, default 64");
  number("--rate", o.rate_per_s, {5.0, 1000.0}, "1/s", "Pictures a second, default 30");
  add_value(app, "--pixels", "WxH", "Size of its pictures, default 640x480",
      of_camera(o, "--pixels", [&o](const std::string& typed) { o.pixels = read_pixels(typed); }));
}

void add_motor_options(CLI::App& app, CameraOptions& o) {
  const char* const wanted = "three numbers: position [rad], velocity [rad/s], torque [N·m]";
  add_value(app, "--can", "NAME",
      "Interface of the bus on which motors answer their controller (mini-cheetah protocol); lumo listens and "
      "commands nothing",
      of_camera(o, "--can", [&o](const std::string& typed) { o.can = typed; }));
  add_value(app, "--motors", "LIST", "Their CAN identifiers, in the order of the joints, default 1",
      of_motors(o, "--motors", [&o](const std::string& typed) { o.motors = read_motors(typed); }));
  add_value(app, "--motor-ranges", "LIST",
      "Ends of the protocol's ranges: position [rad], velocity [rad/s], torque [N·m], default 12.5,65,18",
      of_motors(o, "--motor-ranges", [&o, wanted](const std::string& typed) {
        o.motor_ranges = numbers_in<3>("--motor-ranges", typed, ',', {1e-3, 1e4}, "", wanted);
      }));
}

void CameraOptions::check() const {
  if (exposure_ms * rate_per_s > 1000.0)
    throw UsageError(lumo::message(
        "--exposure is ", exposure_ms, " ms, which ", rate_per_s, " pictures a second (--rate) do not leave"));
  if (number) pictures();
}

LiveSettings settings_of(const CameraOptions& o) {
  return {.device = o.device(),
      .width = o.pixels[0],
      .height = o.pixels[1],
      .frames_per_s = o.rate_per_s,
      .exposure_s = 1e-3 * o.exposure_ms,
      .gain = o.gain};
}

}  // namespace lumo::program
