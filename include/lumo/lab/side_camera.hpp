#pragma once

#include "lumo/lab/rig.hpp"
#include "lumo/lab/side_geometry.hpp"

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace lumo {

/// Where the camera stands, from what it should be.
struct CameraPlace {
  double yaw_rad = 0.0, pitch_rad = 0.0, roll_rad = 0.0;
  double along_m = 0.0, height_m = 0.0;
};

/// A pinhole camera before the side of a pad.
class SideCamera {
 public:
  SideCamera(const CameraRig& camera, const SideGeometry& side, const CameraPlace& place)
      : camera_(camera), side_(side), centre_(0.5 * (camera.width - 1), 0.5 * (camera.height - 1)) {
    // Level, looking along −x; distal to the right. It turns about the middle of the side: whoever places it aims at
    // that.
    Eigen::Matrix3d level;
    level << 0, 0, -1, 1, 0, 0, 0, -1, 0;
    const Eigen::Vector3d aim(side.half_width_m, place.along_m, 0.5 * (side.low_m + side.high_m) + place.height_m);
    const Eigen::Matrix3d turn = (Eigen::AngleAxisd(place.yaw_rad, Eigen::Vector3d::UnitZ()) *
                                  Eigen::AngleAxisd(place.pitch_rad, Eigen::Vector3d::UnitY()) *
                                  Eigen::AngleAxisd(place.roll_rad, Eigen::Vector3d::UnitX()))
                                     .toRotationMatrix();
    axes_ = turn * level;
    eye_ = aim - camera.distance_m * axes_.col(2);
  }

  /// From a pixel to the middle of the window, over the focal length.
  Eigen::Vector2d off_axis(double u, double v) const { return (Eigen::Vector2d(u, v) - centre_) / camera_.focal_px; }
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
    return centre_ + camera_.focal_px / d.z() * d.template head<2>();
  }

  CameraRig camera_;
  SideGeometry side_;
  Eigen::Vector3d eye_;
  Eigen::Matrix3d axes_;  ///< columns: right, down, forward
  Eigen::Vector2d centre_;
};

}  // namespace lumo
