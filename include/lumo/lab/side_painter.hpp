#pragma once

#include "lumo/lab/draws.hpp"
#include "lumo/lab/rig.hpp"
#include "lumo/lab/sensor.hpp"
#include "lumo/lab/side_geometry.hpp"
#include "lumo/sense/frame.hpp"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <vector>

namespace lumo {

/// Where the camera stands, from what it should be.
struct CameraPlace {
  double yaw_rad = 0.0, pitch_rad = 0.0, roll_rad = 0.0;
  double along_m = 0.0, height_m = 0.0;
};

/// Paints the side of a pad as a camera sees it: pinhole, lens blur, vignetting (cos⁴), shot, read, row and pixel noise, gamma, 8 bits.
/// The light of a bin fills the height of the visible side evenly (the responses do not tell more). LEDs are spots behind the side: in the pad's middle, as deep as
/// refraction lets them seem, so that their pitch looks smaller than the side's.
class SidePainter {
 public:
  /// `position_m`: middles of the light's bins, evenly spaced. Throws InvalidArgument when the side does not lie in the window.
  template <class VectorXd = Eigen::VectorXd, class Vector2d = Eigen::Vector2d, class Vector3d = Eigen::Vector3d, class Matrix3d = Eigen::Matrix3d, class AngleAxisd = Eigen::AngleAxisd>
  SidePainter(const CameraRig& camera, const LightRig& light, const SideGeometry& side, const CameraPlace& place, In<VectorXd> position_m, std::uint64_t seed);

  /// `light`: of each bin [DN before gamma]. `lamps`: factor of the lamps' spots. `room_DN`: of the room at the window's middle.
  Image paint(const Eigen::VectorXd& light, double lamps, double room_DN, double noise, Draws draws) const;

  /// Pixel of a point on the facing side.
  template <class Vector2d = Eigen::Vector2d>
  Eigen::Vector2d pixel(double y_m, double z_m) const { return project({side_.half_width_m, y_m, z_m}); }
  /// Pixel at which an LED is seen.
  template <class Vector2d = Eigen::Vector2d>
  Eigen::Vector2d lamp_pixel(double y_m) const { return project({side_.half_width_m - side_.half_width_m / side_.refractive_index, y_m, side_.lamp_height_m}); }

 private:
  struct Pixel {
    int bin;            ///< left one of the two that it lies between; −1: no light of the side
    float share;        ///< of the right one
    float side, spot, vignette, gain, room;
  };
  template <class Vector2d = Eigen::Vector2d, class Vector3d = Eigen::Vector3d>
  Eigen::Vector2d project(In<Vector3d> p) const {
    const Vector3d d = axes_.transpose() * (p - eye_);
    return centre_ + camera_.focal_px / d.z() * d.template head<2>();
  }

  CameraRig camera_;
  SideGeometry side_;
  Eigen::Vector3d eye_;
  Eigen::Matrix3d axes_;   ///< columns: right, down, forward
  Eigen::Vector2d centre_;
  std::vector<Pixel> pixels_;
};

template <class VectorXd, class Vector2d, class Vector3d, class Matrix3d, class AngleAxisd>
inline SidePainter::SidePainter(const CameraRig& camera, const LightRig& light, const SideGeometry& side, const CameraPlace& place, In<VectorXd> position_m,
                                std::uint64_t seed)
    : camera_(camera), side_(side), centre_(0.5 * (camera.width - 1), 0.5 * (camera.height - 1)) {
  const double middle = 0.5 * (side.low_m + side.high_m);
  // Level, looking along −x; distal to the right. It turns about the middle of the side: whoever places it aims at that.
  Matrix3d level;
  level << 0, 0, -1, 1, 0, 0, 0, -1, 0;
  const Vector3d aim(side.half_width_m, place.along_m, middle + place.height_m);
  const Matrix3d turn = (AngleAxisd(place.yaw_rad, Vector3d::UnitZ()) * AngleAxisd(place.pitch_rad, Vector3d::UnitY()) *
                                AngleAxisd(place.roll_rad, Vector3d::UnitX())).toRotationMatrix();
  axes_ = turn * level;
  eye_ = aim - camera.distance_m * axes_.col(2);

  const double spacing = position_m[1] - position_m[0], scale = camera.distance_m / camera.focal_px, blur = camera.blur_px * scale;
  const auto edge = [&](double distance) { return 0.5 * std::erfc(-distance / (std::sqrt(2.0) * blur)); };
  const Eigen::Index bins = position_m.size();
  pixels_.resize(std::size_t(camera.width) * std::size_t(camera.height));
  Draws sensitivity(seed, 101);
  for (int v = 0; v < camera.height; ++v)
    for (int u = 0; u < camera.width; ++u) {
      Pixel& p = pixels_[std::size_t(v) * std::size_t(camera.width) + std::size_t(u)];
      const Vector2d off = (Vector2d(u, v) - centre_) / camera.focal_px;
      const Vector3d ray = axes_ * Vector3d(off.x(), off.y(), 1.0);
      const Vector3d at = eye_ + (side.half_width_m - eye_.x()) / ray.x() * ray;
      const double cover = edge(at.y() + side.half_length_m) * edge(side.half_length_m - at.y()) * edge(at.z() - side.low_m) * edge(side.high_m - at.z());
      const double place_in_bins = std::clamp((at.y() - position_m[0]) / spacing, 0.0, double(bins - 1) - 1e-9);
      p.bin = cover > 1e-4 ? int(place_in_bins) : -1;
      p.share = float(place_in_bins - std::floor(place_in_bins));
      p.side = float(cover);
      double spot = 0.0;
      for (const double y : side.lamp_m) {
        const double sigma = std::hypot(light.spot_sigma_m / scale, camera.blur_px), d = (Vector2d(u, v) - lamp_pixel(y)).norm() / sigma;
        spot += light.spot_DN * std::exp(-0.5 * d * d);
      }
      p.spot = float(spot);
      const double cosine = 1.0 / std::sqrt(1.0 + off.squaredNorm());
      p.vignette = float(cosine * cosine * cosine * cosine);
      p.gain = float(sensitivity.normal());
      p.room = float(1.0 + light.ambient_slope * (double(u) / (camera.width - 1) - 0.5));
    }
  for (const double y : {-side.half_length_m, side.half_length_m})
    for (const double z : {side.low_m, side.high_m}) {
      const Vector2d corner = pixel(y, z);
      if (!(corner.x() >= 1.0 && corner.y() >= 1.0 && corner.x() <= camera.width - 2.0 && corner.y() <= camera.height - 2.0))
        throw InvalidArgument(detail::text("virtual camera: the pad's corner is seen at (", corner.x(), ", ", corner.y(), "), outside the window of ", camera.width, " x ", camera.height, " px"));
    }
}

inline Image SidePainter::paint(const Eigen::VectorXd& light, double lamps, double room_DN, double noise, Draws draws) const {
  Image image = Image::black(camera_.width, camera_.height, PixelFormat::grey);
  for (int v = 0; v < camera_.height; ++v) {
    std::uint8_t* row = image.row(v);
    const double row_offset = noise * camera_.row_DN * draws.normal();
    for (int u = 0; u < camera_.width; ++u) {
      const Pixel& p = pixels_[std::size_t(v) * std::size_t(camera_.width) + std::size_t(u)];
      double signal = room_DN * p.room + lamps * p.spot;
      if (p.bin >= 0) signal += p.side * ((1.0 - p.share) * light[p.bin] + p.share * light[p.bin + 1]);
      signal *= p.vignette * (1.0 + noise * camera_.pixel_gain * p.gain);
      row[u] = detail::sensed(camera_, signal, noise, draws.normal(), row_offset);
    }
  }
  return image;
}

}  // namespace lumo
