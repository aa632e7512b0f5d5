#pragma once

#include "lumo/objective/contact_progression.hpp"
#include "lumo/optics/response.hpp"

#include <optional>
#include <vector>

namespace lumo {

/// Response of one state with what it is compared by (paper Eq. 4–5).
struct ObservedState {
  std::size_t scenario;       ///< the caller's number of the scenario
  double diameter_m, angle_rad, y_m, load_N;
  Eigen::MatrixXd change;     ///< (r − r_0)/P_emit, replicates × regions
};

/// The closest pair of places: J_obs = min over matched diameter, angle and load, and over pairs of places, of the distance between
/// their response changes; with its error from replicates and the two states that set it.
struct Separation {
  Estimate distance;
  std::size_t first, second;  ///< indices into the states
};

/// Relative error of response changes by the mesh, from the refinement study (docs/refinement.md).
struct OpticalError {
  double mesh = 0.01;
};

/// (r − r_0)/P_emit by replicate.
inline Eigen::MatrixXd response_change(const Response& loaded, const Response& unloaded) {
  return (loaded.replicates - unloaded.replicates) / loaded.ledger.emitted;
}

/// Distance of two response changes and its standard error from paired replicates.
Estimate response_distance(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

/// Empty when no two states can be compared. Cost: all pairs.
std::optional<Separation> optical_separation(const std::vector<ObservedState>& states, const OpticalError& error = {});

inline Estimate response_distance(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  const Eigen::MatrixXd d = a - b;
  const Eigen::RowVectorXd mean = d.colwise().mean();
  const double norm = mean.norm(), n = double(d.rows());
  if (d.rows() < 2 || norm == 0.0) return {norm, 0.0};
  // To first order the distance moves with the replicates' components along the mean difference.
  const Eigen::VectorXd along = (d.rowwise() - mean) * mean.transpose() / norm;
  return {norm, std::sqrt(along.squaredNorm() / (n * (n - 1.0)))};
}

inline std::optional<Separation> optical_separation(const std::vector<ObservedState>& states, const OpticalError& error) {
  std::optional<Separation> least;
  for (std::size_t i = 0; i < states.size(); ++i)
    for (std::size_t j = i + 1; j < states.size(); ++j) {
      const ObservedState &a = states[i], &b = states[j];
      if (a.diameter_m != b.diameter_m || a.angle_rad != b.angle_rad || a.load_N != b.load_N || a.y_m == b.y_m) continue;
      const Estimate d = response_distance(a.change, b.change);
      if (!least || d.value < least->distance.value) least = Separation{d, i, j};
    }
  if (least) least->distance.error = std::hypot(2.0 * least->distance.error, error.mesh * least->distance.value);
  return least;
}

}  // namespace lumo
