#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/lab/random_stream.hpp"
#include "lumo/lab/rig.hpp"
#include "lumo/morphology/body.hpp"
#include "lumo/sense/devices/device.hpp"

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace lumo {

/// What a pad's side looks like, apart from the light itself.
struct SideGeometry {
  double half_width_m = 14.75_mm;       ///< of the pad: the facing side is taken as the plane x = half_width_m
  double half_length_m = 30.0_mm;       ///< where the pad ends along y
  double low_m = 0.0, high_m = 9.0_mm;  ///< heights between which light leaves the visible side
  double lamp_height_m = 5.0_mm;        ///< z of the LEDs
  double refractive_index = 1.41;
  std::vector<double> lamp_m{-22.0_mm, -11.0_mm, 0.0, 11.0_mm, 22.0_mm};
};

/// Of a body that is symmetric in x and y: its visible surface reaches as high as its regions do, found to 1 % of the
/// pad's height. Throws InvalidArgument for a body without LEDs or visible surface.
inline SideGeometry side_geometry(const Body& body) {
  if (body.emitters.empty() || body.vertices.empty())
    throw InvalidArgument("virtual lab: the pad has no LEDs or no surface");
  constexpr double infinity = std::numeric_limits<double>::infinity();
  constexpr int parts = 64;  // of an edge: heights to better than 1 % of the pad's
  SideGeometry g{0.0, 0.0, infinity, -infinity, body.emitters.front().center().z(), body.medium.refractive_index, {}};
  for (const Vec3d& v : body.vertices) {
    g.half_width_m = std::max(g.half_width_m, v.x());
    g.half_length_m = std::max(g.half_length_m, std::abs(v.y()));
  }
  for (const Facet& f : body.facets) {
    if (f.patch < 0 || !body.patches[std::size_t(f.patch)].contactable) continue;
    for (std::size_t k = 0; k < f.loop.size(); ++k)
      for (int part = 0; part <= parts; ++part) {
        const Vec3d &a = body.vertices[std::size_t(f.loop[k])],
                    &b = body.vertices[std::size_t(f.loop[(k + 1) % f.loop.size()])];
        Vec3d p = a + part / double(parts) * (b - a);
        p.y() = 0.0;
        p = closest_point(body.patches[std::size_t(f.patch)].shape, p);
        if (body.region(p, outward_normal(body, f.patch, p)) < 0) continue;
        g.low_m = std::min(g.low_m, p.z());
        g.high_m = std::max(g.high_m, p.z());
      }
  }
  if (!(g.high_m > g.low_m))
    throw InvalidArgument("virtual lab: no part of the pad's surface is visible from the side");
  for (const Emitter& e : body.emitters) g.lamp_m.push_back(e.center().y());
  std::sort(g.lamp_m.begin(), g.lamp_m.end());
  g.lamp_m.erase(std::unique(g.lamp_m.begin(), g.lamp_m.end()), g.lamp_m.end());  // one on each side
  return g;
}

/// Where the camera stands, from what it should be.
struct CameraPlace {
  double yaw_rad = 0.0, pitch_rad = 0.0, roll_rad = 0.0;
  double along_m = 0.0, height_m = 0.0;
};

/// A pinhole camera before the side of a pad.
class SideCamera {
 public:
  /// `distortion`: radial, a ray's tangent is tan (1 + distortion tan²) of its picture's.
  SideCamera(const CameraRig& camera, const SideGeometry& side, const CameraPlace& place, double distortion = 0.0)
      : camera_(camera),
        side_(side),
        distortion_(distortion),
        centre_(0.5 * (camera.width - 1), 0.5 * (camera.height - 1)) {
    // Level, looking along −x; distal to the right. It turns about the middle of the side, at which it is aimed.
    Eigen::Matrix3d level;
    level << 0, 0, -1, 1, 0, 0, 0, -1, 0;
    const Eigen::Vector3d aim(side.half_width_m, place.along_m, 0.5 * (side.low_m + side.high_m) + place.height_m);
    const Eigen::Matrix3d turn = (Eigen::AngleAxisd(place.yaw_rad, Eigen::Vector3d::UnitZ()) *
                                  Eigen::AngleAxisd(place.pitch_rad, Eigen::Vector3d::UnitY()) *
                                  Eigen::AngleAxisd(place.roll_rad, Eigen::Vector3d::UnitX()))
                                     .toRotationMatrix();
    axes_ = turn * level;
    eye_ = aim - camera.distance_m * axes_.col(2);
    place_ = place;
  }

  const CameraPlace& place() const { return place_; }

  /// From a pixel to the middle of the window, over the focal length.
  Eigen::Vector2d off_axis(double u, double v) const {
    const Eigen::Vector2d seen = (Eigen::Vector2d(u, v) - centre_) / camera_.focal_px;
    return distortion_ == 0.0 ? seen : Eigen::Vector2d((1.0 + distortion_ * seen.squaredNorm()) * seen);
  }
  /// Where the ray through a pixel meets the plane of the facing side.
  Eigen::Vector3d on_side(double u, double v) const {
    const Eigen::Vector2d off = off_axis(u, v);
    const Eigen::Vector3d ray = axes_ * Eigen::Vector3d(off.x(), off.y(), 1.0);
    return eye_ + (side_.half_width_m - eye_.x()) / ray.x() * ray;
  }
  /// Pixel of a point on the facing side.
  Eigen::Vector2d pixel(double y_m, double z_m) const { return project({side_.half_width_m, y_m, z_m}); }
  /// Pixel at which an LED is seen.
  Eigen::Vector2d lamp_pixel(double y_m) const {
    return project({side_.half_width_m - side_.half_width_m / side_.refractive_index, y_m, side_.lamp_height_m});
  }
  /// Does a point of the facing side lie in the window, a pixel from its edge at least?
  bool shows(double y_m, double z_m) const {
    const Eigen::Vector2d p = pixel(y_m, z_m);
    return p.x() >= 1.0 && p.y() >= 1.0 && p.x() <= camera_.width - 2.0 && p.y() <= camera_.height - 2.0;
  }
  /// The whole side?
  bool shows_side() const {
    return shows(-side_.half_length_m, side_.low_m) && shows(-side_.half_length_m, side_.high_m) &&
           shows(side_.half_length_m, side_.low_m) && shows(side_.half_length_m, side_.high_m);
  }

  const CameraRig& camera() const { return camera_; }
  const SideGeometry& side() const { return side_; }

 private:
  Eigen::Vector2d project(const Eigen::Vector3d& p) const {
    const Eigen::Vector3d d = axes_.transpose() * (p - eye_);
    if (distortion_ == 0.0) return centre_ + camera_.focal_px / d.z() * d.head<2>();
    const Eigen::Vector2d ray = d.head<2>() / d.z();
    Eigen::Vector2d seen = ray;
    for (int k = 0; k < 20; ++k) seen = ray / (1.0 + distortion_ * seen.squaredNorm());  // a contraction in the window
    return centre_ + camera_.focal_px * seen;
  }

  CameraRig camera_;
  SideGeometry side_;
  CameraPlace place_;
  double distortion_;
  Eigen::Vector3d eye_;
  Eigen::Matrix3d axes_;  ///< columns: right, down, forward
  Eigen::Vector2d centre_;
};

/// A tool between the room's light and the side.
struct Shadow {
  double share = 0.0;  ///< of the room's light that it takes away at y
  double y_m = 0.0, sigma_m = 1.0;
};

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
  sense::Image paint(const Eigen::VectorXd& light, double lamps, double room_DN, double noise, RandomStream draws,
      const Shadow& shadow = {}) const;

  /// How it stands before the pad.
  const SideCamera& view() const { return view_; }

 private:
  struct Pixel {
    int bin;      ///< left one of the two that it lies between; −1: no light of the side
    float share;  ///< of the right one
    float side, spot, vignette, gain, room;
    float y_m;  ///< where it meets the plane of the side
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
      p.y_m = float(at.y());
      const double cosine = 1.0 / std::sqrt(1.0 + off.squaredNorm());
      p.vignette = float(cosine * cosine * cosine * cosine);
      p.gain = float(sensitivity.normal());
      p.room = float(1.0 + light.ambient_slope * (double(u) / (camera.width - 1) - 0.5));
    }
}

inline sense::Image SidePainter::paint(const Eigen::VectorXd& light, double lamps, double room_DN, double noise,
    RandomStream draws, const Shadow& shadow) const {
  const CameraRig& camera = view_.camera();
  sense::Image image = sense::Image::black(camera.width, camera.height, sense::PixelFormat::grey);
  for (int v = 0; v < camera.height; ++v) {
    std::uint8_t* row = image.row(v);
    const double row_offset = noise * camera.row_DN * draws.normal();
    for (int u = 0; u < camera.width; ++u) {
      const Pixel& p = pixels_[std::size_t(v) * std::size_t(camera.width) + std::size_t(u)];
      double room = room_DN * p.room;
      if (shadow.share > 0.0) {
        const double away = (p.y_m - shadow.y_m) / shadow.sigma_m;
        room *= 1.0 - shadow.share * std::exp(-0.5 * away * away);
      }
      double signal = room + lamps * p.spot;
      if (p.bin >= 0) signal += p.side * ((1.0 - p.share) * light[p.bin] + p.share * light[p.bin + 1]);
      signal *= p.vignette * (1.0 + noise * camera.pixel_gain * p.gain);
      row[u] = sensed(camera, signal, noise, draws.normal(), row_offset);
    }
  }
  return image;
}

}  // namespace lumo
