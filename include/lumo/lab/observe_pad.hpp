#pragma once

#include "lumo/core/units.hpp"
#include "lumo/lab/pad_responses.hpp"
#include "lumo/lab/side_sight.hpp"
#include "lumo/pipeline/observe.hpp"

#include <utility>
#include <vector>

namespace lumo {

/// Where and how hard a pad is pressed for the virtual lab.
struct PadGrid {
  double diameter_m = 10.0_mm;
  std::vector<double> load_N{1.0, 2.0, 5.0, 10.0, 15.0, 20.0};
  double spacing_m = 1.0_mm;  ///< of the places; those at y < 0 are mirror images
  int places = 27;            ///< 0, 1, …, 26 mm
  double tilt_rad = 4.0_deg;  ///< of an approach from the side, from which follows what small angles do
  std::vector<double> tilt_place_m{0.0, 22.0_mm};
};

/// Presses the pad at all places of the grid and traces its light: mechanics and optics as everywhere else, read out as
/// `sight` says. The pipeline's tracer must have `sight` for its readout; `body` must be symmetric. Throws
/// InvalidArgument, MeshError, and PressFailure when a press does not converge.
template <class P, Executor E> PadResponses observe_pad(const Body& body, const SideSight& sight, const PadGrid& grid,
    const P& pipeline, const E& executor, const ProgressReport& progress = {}) {
  if (!body.symmetry.x || !body.symmetry.y) throw InvalidArgument("virtual lab: the pad must be symmetric in x and y");
  require_in_range("places of the virtual lab", grid.places, 2, 1000, "");
  require_positive("spacing of the virtual lab's places", grid.spacing_m, "m");
  require_in_range("tilt of the virtual lab", grid.tilt_rad, 0.001, 0.5, "rad");
  std::vector<Scenario<Sphere>> scenarios;
  for (int k = 0; k < grid.places; ++k)
    scenarios.push_back({Sphere{grid.diameter_m}, 0.0, grid.spacing_m * k, grid.load_N});
  for (const double y : grid.tilt_place_m)
    scenarios.push_back({Sphere{grid.diameter_m}, grid.tilt_rad, y, grid.load_N});
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
  r.unloaded = 0.5 * (r.unloaded + r.unloaded.reverse().eval());
  r.load_N = Eigen::Map<const Eigen::VectorXd>(grid.load_N.data(), loads);
  r.place_m.resize(grid.places);
  r.depth_m.resize(loads, grid.places);
  r.tilt_place_m = Eigen::Map<const Eigen::VectorXd>(grid.tilt_place_m.data(), Eigen::Index(grid.tilt_place_m.size()));
  r.error = Eigen::VectorXd::Zero(loads);
  for (std::size_t k = 0; k < scenarios.size(); ++k) {
    const bool straight = k < std::size_t(grid.places);
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
      r.error[l] += squares / double(bins * grid.places);
      r.depth_m(l, Eigen::Index(k)) = s.depth_m;
    }
    // At y = 0 the pad is its own mirror image; only the rays are not.
    if (scenarios[k].y_m == 0.0) part = (0.5 * (part + part.colwise().reverse())).eval();
    (straight ? r.change : r.tilt).push_back(std::move(part));
    if (straight) r.place_m[Eigen::Index(k)] = scenarios[k].y_m;
  }
  r.error = r.error.cwiseSqrt().eval();
  return r;
}

}  // namespace lumo
