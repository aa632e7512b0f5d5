#pragma once

#include "lumo/lab/rig.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace lumo {

/// What a pixel says of the light on it [DN before gamma]: shot and read noise (`normal`, a standard normal number,
/// times `noise`), the row's offset, black level, full well, gamma, 8 bits (EMVA 1288's linear model).
inline std::uint8_t sensed(const CameraRig& camera, double signal, double noise, double normal, double row_offset) {
  signal = std::max(signal, 0.0);
  signal += noise * std::sqrt(camera.shot_DN * signal + camera.read_DN * camera.read_DN) * normal + row_offset;
  double value = std::clamp(signal + camera.black_DN, 0.0, camera.full_DN);
  const double inverse_gamma = 1.0 / camera.gamma;
  if (inverse_gamma != 1.0) value = camera.full_DN * std::pow(value / camera.full_DN, inverse_gamma);
  return std::uint8_t(std::lround(value));
}

}  // namespace lumo
