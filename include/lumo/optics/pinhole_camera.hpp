#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/emitter.hpp"
#include "lumo/optics/exit_power.hpp"
#include "lumo/optics/view.hpp"

#include <array>
#include <cmath>

namespace lumo {

/// A camera with one small round opening. Channel row·columns + column holds the power [W] that passes the opening into
/// that pixel; pixels are numbered from the upper left corner of the upright image. The opening holds an ideal thin
/// lens focused at `focus_m`: what lies at another distance z is blurred to a disc of about 2 aperture_m |z/focus_m −
/// 1| there. There is no other approximation.
class PinholeCamera {
 public:
  struct Config {
    Vec3d position{0.0, 0.0, 0.0};                 ///< of the opening [m]
    Vec3d view{0.0, 0.0, 1.0};                     ///< the way that the camera looks
    Vec3d up{0.0, 1.0, 0.0};                       ///< upwards in the image; not along `view`
    double field_of_view_rad = 60.0 * pi / 180.0;  ///< across all columns
    int columns = 32;
    int rows = 32;
    double aperture_m = 0.25e-3;  ///< radius of the opening
    double focus_m = 20e-3;       ///< distance along `view` that is sharp
  };

  /// Throws InvalidArgument for numbers out of range.
  explicit PinholeCamera(const Config& config) : config_(config) {
    require_in_range("columns of the camera", config.columns, 1, 4096, "");
    require_in_range("rows of the camera", config.rows, 1, 4096, "");
    require_in_range("field of view", config.field_of_view_rad * 180.0 / pi, 0.1, 170.0, "deg");
    require_in_range("radius of the camera's opening", config.aperture_m * 1e3, 1e-6, 1e3, "mm");
    require_positive("focus distance of the camera", config.focus_m, "m");
    if (!config.position.allFinite()) throw InvalidArgument("camera: its position is not finite");
    view_ = config.view.normalized();
    right_ = view_.cross(config.up).normalized();
    up_ = right_.cross(view_);
    if (!(std::abs(up_.norm() - 1.0) < 1e-9))
      throw InvalidArgument("camera: the directions of view and up are not finite, or are parallel");
    half_width_ = std::tan(0.5 * config.field_of_view_rad);
    half_height_ = half_width_ * config.rows / config.columns;
  }

  const Config& config() const { return config_; }
  int channels(const Body&) const { return config_.columns * config_.rows; }
  int channel(const Escape& escape) const {
    const double toward = -escape.direction.dot(view_), z = (escape.position - config_.position).dot(view_);
    if (!(toward > 0.0 && z > 0.0)) return -1;
    const Vec3d hit = escape.position + (z / toward) * escape.direction;
    if (!((hit - config_.position).squaredNorm() < config_.aperture_m * config_.aperture_m)) return -1;
    return pixel(hit - (config_.focus_m / toward) * escape.direction);
  }
  int openings() const { return 1; }
  Connection connect(int, const Vec3d& from, double u, double v) const {
    return to_disc(config_.position, view_, config_.aperture_m, from, on_unit_disc(u, v, right_, up_));
  }
  /// Pixel that sees the point `p` [m], by the ray through the middle of the opening; −1: outside the image.
  int pixel(const Vec3d& p) const {
    const Vec3d way = p - config_.position;
    const double z = way.dot(view_);
    return z > 0.0 ? pixel_of(way.dot(right_) / z, way.dot(up_) / z) : -1;
  }
  int pixels() const { return config_.columns * config_.rows; }
  /// Through a place of the pixel, by the first two numbers, and a place of the opening, by the other two. The mean of
  /// a pixel's lines times etendue_m2_sr() is the power that passes the opening into it: they count cos⁴ of their angle
  /// to the axis, as light does behind a real lens (natural vignetting).
  SightLine line(int pixel, const std::array<double, 4>& u) const {
    const double column = pixel % config_.columns + u[0], row = pixel / config_.columns + u[1];
    const Vec3d way = view_ + (2.0 * column / config_.columns - 1.0) * half_width_ * right_ +
                      (1.0 - 2.0 * row / config_.rows) * half_height_ * up_,
                at = config_.aperture_m * on_unit_disc(u[2], u[3], right_, up_);
    const Vec3d d = (config_.focus_m * way - at).normalized();
    return {config_.position + at, d, std::pow(d.dot(view_), 4)};
  }
  /// Area of the opening × solid angle of a pixel on the axis.
  double etendue_m2_sr() const {
    return pi * config_.aperture_m * config_.aperture_m * 4.0 * half_width_ * half_height_ / pixels();
  }

 private:
  int pixel_of(double right, double up) const {
    const double column = 0.5 * (right / half_width_ + 1.0) * config_.columns,
                 row = 0.5 * (1.0 - up / half_height_) * config_.rows;
    if (!(column >= 0.0 && column < config_.columns && row >= 0.0 && row < config_.rows)) return -1;
    return int(row) * config_.columns + int(column);
  }

  Config config_;
  Vec3d view_, right_, up_;
  double half_width_, half_height_;  ///< of the image at distance 1
};

static_assert(ConnectedReadout<PinholeCamera> && View<PinholeCamera>);

}  // namespace lumo
