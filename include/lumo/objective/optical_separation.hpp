#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mechanics/contact/scenario.hpp"
#include "lumo/objective/contact_progression.hpp"
#include "lumo/optics/response.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <vector>

namespace lumo {

/// Response of one state with the quantities that it is compared by (paper Eq. 6–7).
struct ObservedState {
  std::size_t scenario;  ///< the caller's number of the scenario
  double diameter_m, angle_rad, y_m, load_N;
  Eigen::MatrixXd change;  ///< (r − r_0)/P_emit, replicates × regions
  TiltPlane tilt = TiltPlane::xz;
  double load_rise = 0.0;   ///< see load_rises()
  double area_error = 0.0;  ///< of the contact area, by the mesh, as a fraction (MechanicalError)
  double x_m = 0.0;
};

/// The closest pair of places: J_obs = min over matched diameter, angle and load, and over pairs of places, of the
/// distance between their response changes; with its error from replicates and the two states that set it.
struct Separation {
  Estimate distance;
  std::size_t first, second;  ///< indices into the states
};

/// How far a response change is from that on a fine mesh: a mesh that has the contact area wrong has the light of
/// another load, and of another dent. Where light that the dent took under less load and light that it gives now nearly
/// cancel, that is much more than the same part of the change. The number covers 95 of 100 differences
/// (benchmarks/refinement/results.md).
struct OpticalError {
  double area = 2.0;  ///< of change and rise (load_rises()), times the relative error of the contact area

  /// Throws InvalidArgument.
  double of(const ObservedState& state) const {
    require_in_range("relative error of the contact area", state.area_error, 0.0, 1.0, "");
    require_in_range("rise of a response over load", state.load_rise, 0.0, 1e150, "");
    return area * state.area_error * (state.load_rise + state.change.colwise().mean().norm());
  }
  void require_valid() const { require_in_range("error of light per error of area", area, 0.0, 1e3, ""); }
  /// Of the distance of two states, whose meshes differ.
  double of(const ObservedState& a, const ObservedState& b) const { return std::hypot(of(a), of(b)); }
};

/// F ‖Δchange‖/ΔF of each state of one press, its loads ascending [N]; differences are to the state before, of the
/// first one to the unloaded body. Throws InvalidArgument for loads that do not ascend from above 0, and for changes
/// that are not one for each load, of one size and finite.
inline std::vector<double> load_rises(
    const std::vector<double>& loads_N, const std::vector<Eigen::RowVectorXd>& changes) {
  if (changes.size() != loads_N.size())
    throw InvalidArgument(message("rises over load: ", changes.size(), " changes for ", loads_N.size(), " loads"));
  std::vector<double> rises;
  for (std::size_t k = 0; k < loads_N.size(); ++k) {
    const double step = k == 0 ? loads_N[0] : loads_N[k] - loads_N[k - 1];
    require_positive("step of load", step, "N");
    if (changes[k].size() != changes[0].size())
      throw InvalidArgument(
          message("rises over load: changes of ", changes[0].size(), " and ", changes[k].size(), " channels"));
    const double change = k == 0 ? changes[0].norm() : (changes[k] - changes[k - 1]).norm();
    rises.push_back(loads_N[k] * change / step);
    require_in_range("rise of a response over load", rises.back(), 0.0, 1e150, "");
  }
  return rises;
}

namespace detail {

inline void require_same_shape(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  if (a.rows() != b.rows() || a.cols() != b.cols() || a.rows() < 1)
    throw InvalidArgument(message("responses of ", a.rows(), " and ", b.rows(), " replicates of ", a.cols(), " and ",
        b.cols(), " channels, must be as many, at least 1 replicate"));
  constexpr double largest = 1e150;  // squares do not overflow
  if (!(a.array().abs() <= largest).all() || !(b.array().abs() <= largest).all())
    throw InvalidArgument("responses: a number is not finite, or beyond +-1e150");
}

}  // namespace detail

/// (r − r_0)/P_emit by replicate. Throws InvalidArgument for responses of different shape or that are not finite, or
/// without emitted power.
inline Eigen::MatrixXd response_change(const Response& loaded, const Response& unloaded) {
  detail::require_same_shape(loaded.replicates, unloaded.replicates);
  require_positive("emitted power", loaded.ledger.emitted, "W");
  return (loaded.replicates - unloaded.replicates) / loaded.ledger.emitted;
}

/// May these two states be compared: same tool, angle and load, other place?
inline bool comparable(const ObservedState& a, const ObservedState& b) {
  return a.diameter_m == b.diameter_m && a.angle_rad == b.angle_rad && a.tilt == b.tilt && a.load_N == b.load_N &&
         (a.y_m != b.y_m || a.x_m != b.x_m);
}

/// Distance of two response changes and its standard error from paired replicates. The square of the distance is the
/// mean over pairs of *different* replicates of the scalar product of their differences (a U-statistic, Hoeffding
/// 1948): noise does not raise it, unlike the square of the mean difference. The distance is 0 if noise makes the
/// square negative. The error is that of the larger of distance and noise. Throws InvalidArgument for changes of
/// different shape, without replicates, or that are not finite.
inline Estimate response_distance(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  detail::require_same_shape(a, b);
  const Eigen::MatrixXd d = a - b;
  const Eigen::RowVectorXd mean = d.colwise().mean();
  const double n = double(d.rows());
  if (d.rows() < 2) return {mean.norm(), 0.0};
  const Eigen::MatrixXd off = d.rowwise() - mean;
  const double noise2 = off.squaredNorm() / (n * (n - 1.0)), square = mean.squaredNorm() - noise2;
  const double distance = std::sqrt(std::max(0.0, square)), scale = std::sqrt(std::max(square, noise2));
  if (scale == 0.0) return {0.0, 0.0};
  // The distance moves, to first order, with the replicates' components along the mean difference. This overstates the
  // error somewhat if the mean difference is mostly noise.
  return {distance, std::sqrt((off * mean.transpose()).squaredNorm() / (n * (n - 1.0))) / scale};
}

namespace detail {

/// Distances of all pairs that may be compared.
inline std::vector<Separation> separations(const std::vector<ObservedState>& states) {
  std::vector<Separation> pairs;
  for (std::size_t i = 0; i < states.size(); ++i)
    for (std::size_t j = i + 1; j < states.size(); ++j)
      if (comparable(states[i], states[j]))
        pairs.push_back({response_distance(states[i].change, states[j].change), i, j});
  return pairs;
}

}  // namespace detail

/// A state whose noise must fall, and by how much.
struct Undecided {
  std::size_t state;
  double excess;  ///< of its pair's error over the wanted one, ≥ 1
};

/// States whose noise must fall before J_obs is known to `tolerance` (a fraction of it, one standard error), or to a
/// quarter of its error by the mesh: those of all pairs that come within two errors (of the difference) of the least
/// distance and are noisier than that. Wanted is the error that decides: that one, or a third of what the pair lies
/// above the least one. Ascending; empty if done, or if no states can be compared. A pure function: a campaign that
/// retraces these states (Tracer::refined) stays deterministic. Retraced states need the unloaded body retraced with
/// the same rays.
inline std::vector<Undecided> undecided_states(
    const std::vector<ObservedState>& states, double tolerance = 0.02, const OpticalError& mesh = {}) {
  constexpr double of_mesh = 0.25;  // two standard errors are half of it, and add an eighth
  require_in_range("tolerance of J_obs", tolerance, 0.0, 1e3, "");
  mesh.require_valid();
  const std::vector<Separation> pairs = detail::separations(states);
  // The least of the upper bounds, so that one very noisy pair does not stand for all.
  const auto upper = [](const Separation& p) { return p.distance.value + 2.0 * p.distance.error; };
  const auto least = std::min_element(
      pairs.begin(), pairs.end(), [&](const Separation& a, const Separation& b) { return upper(a) < upper(b); });
  std::map<std::size_t, double> wanted;
  for (const Separation& p : pairs) {
    const double above = p.distance.value - least->distance.value;
    const double enough = of_mesh * mesh.of(states[p.first], states[p.second]);
    const bool within_reach = above <= 2.0 * std::hypot(p.distance.error, least->distance.error);
    if (!within_reach || !(p.distance.error > std::max(enough, tolerance * p.distance.value))) continue;
    // A distance that its noise hides may be as large as that.
    const double known = std::max(enough, tolerance * std::max(p.distance.value, p.distance.error)),
                 excess = std::max(1.0, p.distance.error / std::max(known, above / 3.0));
    for (const std::size_t state : {p.first, p.second}) wanted[state] = std::max(wanted[state], excess);
  }
  std::vector<Undecided> all;
  for (const auto& [state, excess] : wanted) all.push_back({state, excess});
  return all;
}

/// nullopt if no two states can be compared. Cost: all pairs.
inline std::optional<Separation> optical_separation(
    const std::vector<ObservedState>& states, const OpticalError& error = {}) {
  error.require_valid();
  const std::vector<Separation> pairs = detail::separations(states);
  const auto closest = std::min_element(pairs.begin(), pairs.end(),
      [](const Separation& a, const Separation& b) { return a.distance.value < b.distance.value; });
  if (closest == pairs.end()) return std::nullopt;
  Separation least = *closest;
  least.distance.error = std::hypot(2.0 * least.distance.error, error.of(states[least.first], states[least.second]));
  return least;
}

}  // namespace lumo
