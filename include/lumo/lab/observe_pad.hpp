#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/lab/pad_responses.hpp"
#include "lumo/morphology/body.hpp"
#include "lumo/optics/exit_power.hpp"
#include "lumo/pipeline/observe.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
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
  body.seen_towards = Vec3d::Zero();
  body.region_image_x = other_side;
  body.region_image_y = other_end;
  body.region = [n, half = sight.half_range_m, min_abs_nx](const Vec3d& p, const Vec3d& normal) {
    if (std::abs(normal.x()) < min_abs_nx || std::abs(p.y()) > half) return -1;
    const int b = std::clamp(int((p.y() + half) / (2.0 * half) * n), 0, n - 1);
    return p.x() > 0.0 ? b : b + n;
  };
  return body;
}

/// `from`, `from` + `spacing` … `to` [m].
inline std::vector<double> even_places(double from, double to, double spacing) {
  std::vector<double> y;
  for (int k = 0; from + spacing * k < to + 0.5 * spacing; ++k) y.push_back(from + spacing * k);
  return y;
}

/// Where and how hard a pad is pressed for the virtual lab.
struct PadGrid {
  double diameter_m = 10.0_mm;
  std::vector<double> load_N{1.0, 2.0, 5.0, 10.0, 15.0};
  /// Ascending; from 0 for a pad with equal ends. Loads and places are the built finger's: at 20 N its silicone folds
  /// over the carrier's edge at some places, and its open proximal end gives way at 15 N from y = −26 mm on.
  std::vector<double> place_m = even_places(-24.0_mm, 28.0_mm, 2.0_mm);
  double tilt_rad = 4.0_deg;  ///< of an approach from the side, from which follows what small angles do
  std::vector<double> tilt_place_m{-22.0_mm, 0.0, 22.0_mm};

  /// The straight approaches, then the tilted ones.
  std::vector<Scenario<Sphere>> scenarios() const {
    std::vector<Scenario<Sphere>> all;
    for (const double y : place_m) all.push_back({Sphere{diameter_m}, 0.0, y, load_N});
    for (const double y : tilt_place_m) all.push_back({Sphere{diameter_m}, tilt_rad, y, load_N});
    return all;
  }
};

/// Presses the pad at all places of the grid and traces its light: mechanics and optics as everywhere else, read out as
/// `sight` says. The pipeline's tracer must have `sight` for its readout; `body` must be symmetric in x.
/// Throws InvalidArgument, MeshError, and PressFailure when a press does not converge.
template <class P, Executor E> PadResponses observe_pad(const Body& body, const SideSight& sight, const PadGrid& grid,
    const P& pipeline, const E& executor, const ProgressReport& progress = {}) {
  if (!body.symmetry.x) throw InvalidArgument("virtual lab: the pad must be symmetric in x");
  const bool equal_ends = body.symmetry.y;
  require_in_range("places of the virtual lab", double(grid.place_m.size()), 2, 1000, "");
  if (equal_ends != (grid.place_m[0] == 0.0))
    throw InvalidArgument(message("virtual lab: the first place is y = ", 1e3 * grid.place_m[0], " mm, must be ",
        equal_ends ? "0: the pad has equal ends" : "below 0: the pad's ends are not alike"));
  require_in_range("tilt of the virtual lab", grid.tilt_rad, 0.001, 0.5, "rad");
  const std::vector<Scenario<Sphere>> scenarios = grid.scenarios();
  const Observations seen = observe(seen_from_sides(body, sight), scenarios, pipeline, executor, progress);
  for (const ScenarioRecord& s : seen.scenarios)
    if (s.status != Status::converged)
      throw PressFailure(message("virtual lab: no equilibrium at ", s.states.back().load_N, " N, y = ", 1e3 * s.y_m,
          " mm (", to_string(s.status), ")"));

  const Eigen::Index bins = sight.bins, loads = Eigen::Index(grid.load_N.size());
  PadResponses r;
  r.diameter_m = grid.diameter_m;
  const std::vector<double> at = sight.positions_m();
  r.position_m = Eigen::Map<const Eigen::VectorXd>(at.data(), bins);
  const Eigen::Map<const Eigen::VectorXd> rest(seen.unloaded_response.data(), 2 * bins);
  r.unloaded = 0.5 * (rest.head(bins) + rest.tail(bins));
  if (equal_ends) r.unloaded = 0.5 * (r.unloaded + r.unloaded.reverse().eval());
  r.load_N = Eigen::Map<const Eigen::VectorXd>(grid.load_N.data(), loads);
  const auto is_straight = [](const Scenario<Sphere>& s) { return s.angle_rad == 0.0; };
  const auto places = Eigen::Index(grid.place_m.size());
  r.place_m.resize(places);
  r.depth_m.resize(loads, places);
  r.tilt_place_m.resize(Eigen::Index(scenarios.size()) - places);
  r.error = Eigen::VectorXd::Zero(loads);
  for (std::size_t k = 0; k < scenarios.size(); ++k) {
    const bool straight = is_straight(scenarios[k]);
    Eigen::MatrixXd part(bins, loads);
    for (Eigen::Index l = 0; l < loads; ++l) {
      const StateRecord& s = seen.scenarios[k].states[std::size_t(l)];
      const Eigen::MatrixXd right = s.change.leftCols(bins), left = s.change.rightCols(bins),
                            wanted = straight ? Eigen::MatrixXd(0.5 * (right + left))
                                              : Eigen::MatrixXd(0.5 * (right - left) / grid.tilt_rad);
      part.col(l) = wanted.colwise().mean().transpose();
      if (!straight) continue;
      double squares = 0.0;
      for (const double e : standard_error(wanted)) squares += e * e;
      r.error[l] += squares / double(bins * places);
      r.depth_m(l, Eigen::Index(k)) = s.depth_m;
    }
    // At y = 0 a pad with equal ends is its own mirror image; only the rays are not.
    if (equal_ends && scenarios[k].y_m == 0.0) part = (0.5 * (part + part.colwise().reverse())).eval();
    (straight ? r.change : r.tilt).push_back(std::move(part));
    (straight ? r.place_m[Eigen::Index(k)] : r.tilt_place_m[Eigen::Index(k) - places]) = scenarios[k].y_m;
  }
  r.error = r.error.cwiseSqrt().eval();
  return r;
}

}  // namespace lumo
