#pragma once

#include "lumo/core/error.hpp"
#include "lumo/optics/exit_power.hpp"

#include <cmath>
#include <optional>
#include <vector>

namespace own {

//! [readout]
/// Ends of optical fibres in a row along y, before the side x > 0: each takes the light within its cone about +x that
/// comes out of its stretch of the side.
struct FibreRow {
  int count = 8;
  double half_range_m = 20e-3;      ///< the row's, about y = 0
  double numerical_aperture = 0.5;  ///< sine of the half angle that a fibre accepts

  int channels(const lumo::Body&) const { return count; }
  int channel(const lumo::Escape& light) const {
    if (light.direction.x() <= std::sqrt(1.0 - numerical_aperture * numerical_aperture)) return -1;
    const double place = 0.5 * count * (1.0 + light.position.y() / half_range_m);
    return place >= 0.0 && place < count ? int(place) : -1;
  }
  /// May be left out; with it one of two contacts at ±y stands for both.
  std::optional<std::vector<int>> image_channels(const lumo::Body&, int axis) const {
    if (axis == 0) return std::nullopt;  // no fibre looks at the side x < 0
    std::vector<int> images;
    for (int k = 0; k < count; ++k) images.push_back(count - 1 - k);
    return images;
  }
};

static_assert(lumo::ExitReadout<FibreRow>);
//! [readout]

}  // namespace own
