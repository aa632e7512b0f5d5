#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/body.hpp"
#include "lumo/optics/exit_power.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace lumo {

/// What is seen of a pad's two sides, by the *deformed* place along the finger (a camera sees where the surface is, not
/// where it was). By default all light that leaves a visible side counts, whatever its direction, which is how the
/// paper's own model reads an image (r_b). A real lens sees a narrow cone: one that looks level or down on a pad that
/// does not scatter sees hardly more than shadows, because a dent throws light down and outwards (docs/virtual_lab.md).
/// Channels 0 … bins − 1 are the side x > 0, the others the side x < 0, each from proximal to distal.
struct SideSight {
  int bins = 60;
  double half_range_m = 30.0_mm;
  double pitch_rad = 0.0;  ///< of the line of sight above the base plane: the camera looks down on the pad by so much
  double cone_rad = pi;    ///< half angle of the cone about the line of sight; π: all directions

  int channels(const Body&) const { return 2 * bins; }
  int channel(const Escape& e) const {
    if (e.region < 0) return -1;
    const bool right = e.reference.x() > 0.0;
    const double sideways = right ? e.direction.x() : -e.direction.x();
    if (cone_rad < pi && sideways * std::cos(pitch_rad) + e.direction.z() * std::sin(pitch_rad) < std::cos(cone_rad))
      return -1;
    const double at = (e.position.y() + half_range_m) / (2.0 * half_range_m) * bins;
    return at >= 0.0 && at < bins ? int(at) + (right ? 0 : bins) : -1;
  }
  /// Middles of the bins of one side [m].
  std::vector<double> positions_m() const {
    std::vector<double> y;
    for (int b = 0; b < bins; ++b) y.push_back(half_range_m * ((2 * b + 1.0) / bins - 1.0));
    return y;
  }
};

static_assert(ExitReadout<SideSight>);

/// The body with the sight's bins for regions, on the surface that was visible before (whose ends now reach as far as
/// the sight does). `min_abs_nx`: of the undeformed normal, as FingerOptions::Readout says. Throws InvalidArgument for
/// numbers out of range.
inline Body seen_from_sides(std::type_identity_t<Body> body, const SideSight& sight, double min_abs_nx = 0.5) {
  require_in_range("bins of the side's sight", sight.bins, 2, 4096, "");
  require_positive("range of the side's sight", sight.half_range_m, "m");
  require_in_range("cone of the side's sight", sight.cone_rad, 0.01, pi, "rad");
  const int n = sight.bins;
  body.regions = 2 * n;
  std::vector<int> other_side(std::size_t(2 * n)), other_end(std::size_t(2 * n));
  for (int b = 0; b < n; ++b) {
    other_side[std::size_t(b)] = b + n;
    other_side[std::size_t(b + n)] = b;
    other_end[std::size_t(b)] = n - 1 - b;
    other_end[std::size_t(b + n)] = 2 * n - 1 - b;
  }
  body.region_image_x = other_side;
  body.region_image_y = other_end;
  body.region = [n, half = sight.half_range_m, min_abs_nx](const Vec3d& p, const Vec3d& normal) {
    if (std::abs(normal.x()) < min_abs_nx || std::abs(p.y()) > half) return -1;
    const int b = std::clamp(int((p.y() + half) / (2.0 * half) * n), 0, n - 1);
    return p.x() > 0.0 ? b : b + n;
  };
  return body;
}

}  // namespace lumo
