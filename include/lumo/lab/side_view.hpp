#pragma once

#include "lumo/core/units.hpp"
#include "lumo/lab/side_camera.hpp"
#include "lumo/optics/camera_cone.hpp"
#include "lumo/optics/photodiode.hpp"
#include "lumo/optics/pinhole_camera.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <utility>
#include <vector>

namespace lumo {

/// A camera before the side x > 0 of a pad, aimed at its middle. The same lens is a readout (CameraCone: power by
/// region) and a picture (PinholeCamera).
struct SideView {
  double distance_m = 0.25;               ///< from what it is aimed at
  double yaw_rad = 0.0, pitch_rad = 0.0;  ///< of where it stands: towards +y, and above the base plane
  double roll_rad = 0.0;                  ///< about the line of sight
  double along_m = 0.0, height_m = 0.0;   ///< of what it is aimed at, beside the middle of the side
  double aperture_m = 0.48e-3;  ///< radius of the lens' opening: 1.93 mm at f/2 (Intel RealSense D435, colour)

  /// From the pad towards the camera.
  Vec3d back() const {
    return {std::cos(pitch_rad) * std::cos(yaw_rad), std::cos(pitch_rad) * std::sin(yaw_rad), std::sin(pitch_rad)};
  }
  Vec3d position_m(const SideGeometry& side) const {
    return Vec3d(side.half_width_m, along_m, 0.5 * (side.low_m + side.high_m) + height_m) + distance_m * back();
  }
  CameraCone cone(const SideGeometry& side) const {
    return CameraCone({.position = position_m(side), .view = -back(), .aperture_m = aperture_m});
  }
  PinholeCamera picture(const SideGeometry& side, double focal_px, int columns, int rows) const {
    const Vec3d up = Eigen::AngleAxisd(roll_rad, Eigen::Vector3d(-back())) * Eigen::Vector3d::UnitZ();
    return PinholeCamera({.position = position_m(side),
        .view = -back(),
        .up = up,
        .field_of_view_rad = 2.0 * std::atan(0.5 * columns / focal_px),
        .columns = columns,
        .rows = rows,
        .aperture_m = aperture_m,
        .focus_m = distance_m});
  }
};

/// A row of square photodiodes that face the side x > 0 at half its height, each before the middle of one of `count`
/// equal parts of |y| ≤ half_range_m.
struct PhotodiodeRow {
  int count = 11;
  double half_range_m = 27.5e-3;
  double gap_m = 5e-3;   ///< to the side
  double edge_m = 2e-3;  ///< of a photodiode

  Photodiodes before(const SideGeometry& side) const {
    const double half = 0.5 * edge_m, x = side.half_width_m + gap_m, z = 0.5 * (side.low_m + side.high_m);
    std::vector<Photodiode> row;
    for (int k = 0; k < count; ++k) {
      // Whole parts of the range: places on both sides of y = 0 are mirror images to the bit.
      const double y = half_range_m * (2 * k + 1 - count) / count;
      row.push_back({{x, y, z}, {0.0, 0.0, half}, {0.0, half, 0.0}});
    }
    return Photodiodes(std::move(row));
  }
};

}  // namespace lumo
