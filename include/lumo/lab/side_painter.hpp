#pragma once

#include "lumo/lab/random_stream.hpp"
#include "lumo/lab/rig.hpp"
#include "lumo/lab/side_camera.hpp"
#include "lumo/sense/devices/frame.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <vector>

namespace lumo {

/// Paints the side of a pad as a camera sees it: pinhole, lens blur, vignetting (cos⁴), shot, read, row and pixel
/// noise, gamma, 8 bits. The light of a bin fills the height of the visible side evenly (the responses hold no
/// more). LEDs are spots behind the side: in the pad's middle, as deep as refraction lets them seem, so that their
/// pitch looks smaller than the side's.
class SidePainter {
 public:
  /// `position_m`: middles of the light's bins, evenly spaced. Throws InvalidArgument when the side does not lie in the
  /// window.
  SidePainter(const SideCamera& view, const LightRig& light, const Eigen::VectorXd& position_m, std::uint64_t seed);

  /// `light`: of each bin [DN before gamma]. `lamps`: factor of the lamps' spots. `room_DN`: of the room at the
  /// window's middle.
  sense::Image paint(
      const Eigen::VectorXd& light, double lamps, double room_DN, double noise, RandomStream draws) const;

  /// How it stands before the pad.
  const SideCamera& view() const { return view_; }

 private:
  struct Pixel {
    int bin;      ///< left one of the two that it lies between; −1: no light of the side
    float share;  ///< of the right one
    float side, spot, vignette, gain, room;
  };

  SideCamera view_;
  std::vector<Pixel> pixels_;
};

inline SidePainter::SidePainter(
    const SideCamera& view, const LightRig& light, const Eigen::VectorXd& position_m, std::uint64_t seed)
    : view_(view) {
  const CameraRig& camera = view_.camera();
  const SideGeometry& side = view_.side();
  for (const double y : {-side.half_length_m, side.half_length_m})
    for (const double z : {side.low_m, side.high_m})
      if (!view_.shows(y, z)) {
        const Eigen::Vector2d corner = view_.pixel(y, z);
        throw InvalidArgument(message("virtual camera: the pad's corner is seen at (", corner.x(), ", ", corner.y(),
            "), outside the window of ", camera.width, " x ", camera.height, " px"));
      }
  const double spacing = position_m[1] - position_m[0], scale = camera.distance_m / camera.focal_px,
               blur = camera.blur_px * scale;
  const auto edge = [&](double distance) { return 0.5 * std::erfc(-distance / (std::sqrt(2.0) * blur)); };
  const Eigen::Index bins = position_m.size();
  pixels_.resize(std::size_t(camera.width) * std::size_t(camera.height));
  RandomStream sensitivity(seed, 101);
  for (int v = 0; v < camera.height; ++v)
    for (int u = 0; u < camera.width; ++u) {
      Pixel& p = pixels_[std::size_t(v) * std::size_t(camera.width) + std::size_t(u)];
      const Eigen::Vector2d off = view_.off_axis(u, v);
      const Eigen::Vector3d at = view_.on_side(u, v);
      const double cover = edge(at.y() + side.half_length_m) * edge(side.half_length_m - at.y()) *
                           edge(at.z() - side.low_m) * edge(side.high_m - at.z());
      const double place_in_bins = std::clamp((at.y() - position_m[0]) / spacing, 0.0, double(bins - 1) - 1e-9);
      p.bin = cover > 1e-4 ? int(place_in_bins) : -1;
      p.share = float(place_in_bins - std::floor(place_in_bins));
      p.side = float(cover);
      double spot = 0.0;
      for (const double y : side.lamp_m) {
        const double sigma = std::hypot(light.spot_sigma_m / scale, camera.blur_px),
                     d = (Eigen::Vector2d(u, v) - view_.lamp_pixel(y)).norm() / sigma;
        spot += light.spot_DN * std::exp(-0.5 * d * d);
      }
      p.spot = float(spot);
      const double cosine = 1.0 / std::sqrt(1.0 + off.squaredNorm());
      p.vignette = float(cosine * cosine * cosine * cosine);
      p.gain = float(sensitivity.normal());
      p.room = float(1.0 + light.ambient_slope * (double(u) / (camera.width - 1) - 0.5));
    }
}

inline sense::Image SidePainter::paint(
    const Eigen::VectorXd& light, double lamps, double room_DN, double noise, RandomStream draws) const {
  const CameraRig& camera = view_.camera();
  sense::Image image = sense::Image::black(camera.width, camera.height, sense::PixelFormat::grey);
  for (int v = 0; v < camera.height; ++v) {
    std::uint8_t* row = image.row(v);
    const double row_offset = noise * camera.row_DN * draws.normal();
    for (int u = 0; u < camera.width; ++u) {
      const Pixel& p = pixels_[std::size_t(v) * std::size_t(camera.width) + std::size_t(u)];
      double signal = room_DN * p.room + lamps * p.spot;
      if (p.bin >= 0) signal += p.side * ((1.0 - p.share) * light[p.bin] + p.share * light[p.bin + 1]);
      signal *= p.vignette * (1.0 + noise * camera.pixel_gain * p.gain);
      row[u] = sensed(camera, signal, noise, draws.normal(), row_offset);
    }
  }
  return image;
}

}  // namespace lumo
