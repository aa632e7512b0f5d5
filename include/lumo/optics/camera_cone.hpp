#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/emitter.hpp"
#include "lumo/optics/exit_power.hpp"

#include <cmath>
#include <optional>
#include <vector>

namespace lumo {

/// Light that leaves through each region of the body into the narrow cone that ends in a camera's lens [W]: what
/// ExitPower counts, of one direction only. PinholeCamera has its picture.
class CameraCone {
 public:
  static constexpr bool gathers_emitters = true;  ///< see WholeReadout

  struct Config {
    Vec3d position{0.0, 0.0, 0.0};  ///< of the lens [m]
    Vec3d view{0.0, 0.0, 1.0};      ///< the way that it looks
    double aperture_m = 0.48e-3;    ///< radius of its opening
  };

  CameraCone() : CameraCone(Config{}) {}
  /// Throws InvalidArgument for numbers out of range.
  explicit CameraCone(const Config& config) : config_(config), view_(config.view.normalized()) {
    require_in_range("radius of the camera's opening", config.aperture_m * 1e3, 1e-6, 1e3, "mm");
    if (!config.position.allFinite()) throw InvalidArgument("camera: its position is not finite");
    if (!(std::abs(view_.norm() - 1.0) < 1e-9)) throw InvalidArgument("camera: its direction of view is none");
    tangents(view_, right_, up_);
  }

  int channels(const Body& body) const { return body.regions; }
  int channel(const Escape& escape) const {
    const double toward = -escape.direction.dot(view_), z = (escape.position - config_.position).dot(view_);
    if (escape.region < 0 || !(toward > 0.0 && z > 0.0)) return -1;
    const Vec3d hit = escape.position + (z / toward) * escape.direction;
    return (hit - config_.position).squaredNorm() < config_.aperture_m * config_.aperture_m ? escape.region : -1;
  }
  int openings() const { return 1; }
  Connection connect(int, const Vec3d& from, double u, double v) const {
    return to_disc(config_.position, view_, config_.aperture_m, from, on_unit_disc(u, v, right_, up_));
  }
  /// nullopt unless the images of all regions are regions, and the camera stands in the plane. Throws as
  /// region_images() does.
  std::optional<std::vector<int>> image_channels(const Body& body, int axis) const {
    if (config_.position[axis] != 0.0 || view_[axis] != 0.0) return std::nullopt;
    return ExitPower{}.image_channels(body, axis);
  }

 private:
  Config config_;
  Vec3d view_, right_, up_;
};

static_assert(WholeReadout<CameraCone>);

}  // namespace lumo
