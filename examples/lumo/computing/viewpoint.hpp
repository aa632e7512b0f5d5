#pragma once

#include "configuration/configuration.hpp"

#include "lumo/core/units.hpp"
#include "lumo/lab/side_view.hpp"

/// Where a pad is looked at from.
namespace lumo::program {

inline SideView side_view(const CameraSettings& c) {
  const double degree = pi / 180.0;
  return {.distance_m = 1e-3 * c.distance_mm,
      .yaw_rad = c.yaw_deg * degree,
      .pitch_rad = c.pitch_deg * degree,
      .roll_rad = c.roll_deg * degree,
      .along_m = 1e-3 * c.along_mm,
      .height_m = 1e-3 * c.height_mm,
      .aperture_m = 1e-3 * c.aperture_mm};
}

inline PhotodiodeRow photodiode_row(const Configuration& o) {
  const auto& read = o.pad.finger.readout;
  return {.count = read.bins,
      .half_range_m = read.half_range,
      .gap_m = 1e-3 * o.observation.diode_gap_mm,
      .edge_m = 1e-3 * o.observation.diode_mm};
}

}  // namespace lumo::program
