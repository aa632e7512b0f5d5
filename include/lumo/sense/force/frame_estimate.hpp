#pragma once

#include "lumo/sense/force/force_baselines.hpp"
#include "lumo/sense/force/force_solution.hpp"
#include "lumo/sense/localize/location_estimator.hpp"
#include "lumo/sense/recording/log_truth.hpp"

#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

namespace lumo::sense {

/// What is estimated at one frame of a recording.
struct FrameEstimate {
  std::int64_t stamp_ns = 0;
  LocationEstimate location;              ///< of the localiser
  ForceEstimate force;                    ///< of the filter
  std::optional<Eigen::VectorXd> joints;  ///< positions [rad], then contact torques [N·m], interpolated
  double seconds = 0.0;                   ///< from decoded picture to estimate

  /// Where the localiser sees exactly one contact.
  std::optional<ContactLocation> contact() const {
    return location.contacts == 1 ? std::optional(location.contact[0]) : std::nullopt;
  }
};

/// Half of a normal's 90 % interval, in standard deviations.
inline constexpr double sigmas_of_90_percent = 1.6448536269514722;

/// How well locations agree with the truth.
struct LocationScore {
  int samples = 0;           ///< frames to be located
  int located = 0;           ///< of them, those with exactly one contact found
  double mae_m = 0.0;        ///< over the located ones
  double coverage_90 = 0.0;  ///< share of the located ones whose 90 % interval holds the truth
};

/// Over the frames with a true force of at least `from_N` at a known place.
inline LocationScore location_score(std::span<const FrameEstimate> estimates, const LogTruth& truth, double from_N) {
  LocationScore s;
  int covered = 0;
  for (const FrameEstimate& e : estimates) {
    const LogTruth::Touch t = truth.at(e.stamp_ns);
    if (!t.y_m || !t.force_N || *t.force_N < from_N) continue;
    ++s.samples;
    const std::optional<ContactLocation> at = e.contact();
    if (!at) continue;
    ++s.located;
    const double off = std::abs(at->y_m - *t.y_m);
    s.mae_m += off;
    covered += off <= sigmas_of_90_percent * std::sqrt(at->variance_m2);
  }
  if (s.located > 0) {
    s.mae_m /= s.located;
    s.coverage_90 = double(covered) / s.located;
  }
  return s;
}

/// Errors of forces against the truth.
struct ForceScore {
  ForceErrors errors;
  int samples = 0;
  double coverage_90 = 0.0;  ///< of the fused force's 90 % interval
  /// At the places seen, with torque constants as given: fitted on none of these samples (torque_scale fits a factor).
  std::vector<TorqueForce> optical;
};

/// Over the frames with a true force of at least `from_N`. Where the localiser saw no single contact the optical way
/// takes the middle of the tested range, so that all ways stand on the same samples; nothing is filled in from later
/// frames, so that each estimate is causal. A sequence ends where the true force falls below `from_N` or the true place
/// changes.
template <ContactJacobian J> ForceScore force_score(std::span<const FrameEstimate> estimates, const LogTruth& truth,
    const J& jacobian, const PadRange& tested, double torque_sigma_Nm, double from_N = 0.5) {
  std::vector<ForceSample> samples;
  int given = 0, covered = 0;
  bool touched = false;
  for (const FrameEstimate& e : estimates) {
    const LogTruth::Touch t = truth.at(e.stamp_ns);
    if (t.force_N && *t.force_N < from_N) touched = false;
    if (!t.y_m || !t.force_N || *t.force_N < from_N || !e.joints) continue;
    ForceSample s;
    if (!samples.empty()) s.sequence = samples.back().sequence + (touched && samples.back().true_y_m == *t.y_m ? 0 : 1);
    touched = true;
    const Eigen::Index n = e.joints->size() / 2;
    s.stamp_ns = e.stamp_ns;
    s.position_rad = e.joints->head(n);
    s.contact_torque_Nm = e.joints->tail(n);
    s.true_y_m = *t.y_m;
    s.true_force_N = *t.force_N;
    const std::optional<ContactLocation> at = e.contact();
    s.estimated_y_m = at ? at->y_m : tested.middle_m();
    const ContactForce& fused = e.force.contact[0];
    s.fused_N = fused.force_N;
    if (fused.force_N) {
      ++given;
      covered += std::abs(*fused.force_N - *t.force_N) <= sigmas_of_90_percent * std::sqrt(fused.force_variance_N2);
    }
    samples.push_back(std::move(s));
  }
  ForceScore score;
  score.samples = int(samples.size());
  const std::span<const ForceSample> all(samples);
  if (!all.empty()) score.errors = force_errors(jacobian, all, tested, torque_sigma_Nm);
  score.optical = optical_forces(jacobian, all, tested.link, torque_sigma_Nm);
  score.coverage_90 = given > 0 ? double(covered) / given : 0.0;
  return score;
}

}  // namespace lumo::sense
