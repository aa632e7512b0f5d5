#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"

#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace lumo::sense {

/// How a force sensor is mounted: along the finger's x, y and z lie these axes of the sensor, each with a sign. All
/// three reversed: the sensor reports the force of the finger on the object.
struct SensorAxes {
  std::array<int, 3> axis{1, 2, 3};  ///< ±1: the sensor's x, ±2: y, ±3: z; each once
  bool operator==(const SensorAxes&) const = default;

  /// A force or torque of the sensor, in the finger's frame.
  Vec3d turned(const Vec3d& of_sensor) const {
    Vec3d v;
    for (int k = 0; k < 3; ++k) {
      const int a = axis[std::size_t(k)];
      v[k] = a < 0 ? -of_sensor[-a - 1] : of_sensor[a - 1];
    }
    return v;
  }
};

/// "x", "-y" …, one for each axis of the finger.
inline std::vector<std::string> names_of(const SensorAxes& axes) {
  std::vector<std::string> names;
  for (const int a : axes.axis) names.push_back(std::string(a < 0 ? "-" : "") + "xyz"[std::size_t(a < 0 ? -a : a) - 1]);
  return names;
}

/// Reads them. Throws InvalidArgument.
inline SensorAxes sensor_axes(const std::vector<std::string>& names) {
  SensorAxes axes;
  std::array<int, 3> seen{};
  for (std::size_t k = 0; k < names.size() && k < 3; ++k) {
    std::string_view name = names[k];
    const bool reversed = name.starts_with('-');
    if (reversed || name.starts_with('+')) name.remove_prefix(1);
    const std::size_t at = name.size() == 1 ? std::string_view("xyz").find(name[0]) : std::string_view::npos;
    if (at == std::string_view::npos) break;
    ++seen[at];
    axes.axis[k] = reversed ? -int(at) - 1 : int(at) + 1;
  }
  if (names.size() != 3 || seen != std::array{1, 1, 1})
    throw InvalidArgument("axes of the force sensor are '" + listing(names, [](const std::string& n) {
      return printable(n);
    }) + "', must be x, y and z, each once and with or without a minus, such as x, -y, -z");
  return axes;
}

}  // namespace lumo::sense
