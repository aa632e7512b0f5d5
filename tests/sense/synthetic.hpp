#pragma once

#include "lumo/core/sobol.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/profile/axis_map.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

/// Pictures and noise for tests: smooth, known in closed form, and nothing that an estimator is tuned to.
namespace synthetic {

inline constexpr std::int64_t ms = 1'000'000;  // in nanoseconds

/// Standard normal numbers from a counter: the same on every machine.
class Normal {
 public:
  explicit Normal(std::uint64_t seed) : seed_(seed) {}
  double uniform() { return double(lumo::combine(seed_, ++count_) >> 11) * 0x1p-53 + 0x1p-54; }
  double operator()() {
    const double u = uniform(), v = uniform();
    return std::sqrt(-2.0 * std::log(u)) * std::cos(6.283185307179586 * v);
  }

 private:
  std::uint64_t seed_, count_ = 0;
};

/// How a finger lies in the image: the finger's y axis along `direction` from `origin`, `px_per_m` there, perspective
/// `c` as in AxisMap.
struct View {
  int width = 640, height = 480;
  Eigen::Vector2d origin{320.0, 240.0};
  double angle_rad = 0.0;
  double px_per_m = 9000.0;
  double perspective = 0.0;  ///< relative change of scale per metre

  double u(double y) const { return px_per_m * y / (1.0 + perspective * y); }
  double y(double u) const { return u / (px_per_m - perspective * u); }
  Eigen::Vector2d direction() const { return {std::cos(angle_rad), std::sin(angle_rad)}; }
  Eigen::Vector2d pixel(double y) const { return origin + u(y) * direction(); }
};

/// Green [DN] of `light(y, across in m)` seen through the view, plus Gaussian noise.
template <class Light> lumo::sense::Image paint(const View& view, Light light, double noise, std::uint64_t seed,
    lumo::sense::PixelFormat format = lumo::sense::PixelFormat::bgr) {
  lumo::sense::Image image = lumo::sense::Image::black(view.width, view.height, format);
  Normal normal(seed);
  const Eigen::Vector2d d = view.direction();
  for (int y = 0; y < view.height; ++y)
    for (int x = 0; x < view.width; ++x) {
      const Eigen::Vector2d p = Eigen::Vector2d(x, y) - view.origin;
      const double along = p.dot(d), across = (-p.x() * d.y() + p.y() * d.x()) / view.px_per_m;
      const double green = light(view.y(along), across) + (noise > 0.0 ? noise * normal() : 0.0);
      const auto value = std::uint8_t(std::clamp(std::lround(green), 0L, 255L));
      if (format == lumo::sense::PixelFormat::grey) {
        image.row(y)[x] = value;
      } else {
        image.row(y)[3 * x] = std::uint8_t(value / 2);
        image.row(y)[3 * x + 1] = value;
        image.row(y)[3 * x + 2] = std::uint8_t(255 - value);
      }
    }
  return image;
}

/// Five LEDs 11 mm apart on a dim finger.
inline double leds(double y, double across, double peak = 120.0, double sigma = 1.2e-3) {
  double sum = std::abs(across) < 9e-3 && std::abs(y) < 29e-3 ? 40.0 : 8.0;
  for (int k = -2; k <= 2; ++k)
    sum += peak * std::exp(-0.5 * (std::pow(y - 11e-3 * k, 2) + across * across) / (sigma * sigma));
  return sum;
}

}  // namespace synthetic
