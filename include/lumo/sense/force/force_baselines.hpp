#pragma once

#include "lumo/core/error.hpp"
#include "lumo/sense/force/force_solution.hpp"
#include "lumo/sense/force/torque_scale.hpp"
#include "lumo/sense/joints/torque_model.hpp"
#include "lumo/sense/recording/alignment.hpp"
#include "lumo/sense/recording/tables.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <vector>

namespace lumo::sense {

/// One moment of a log at which a force is asked for: joints there, what was estimated of the place, and the truth to
/// compare with.
struct ForceSample {
  std::int64_t stamp_ns = 0;
  JointVector position_rad, contact_torque_Nm;  ///< torque: motor minus torque model
  std::optional<double> estimated_y_m;          ///< of the localiser
  std::optional<double> fused_N;                ///< of the force estimator
  double true_y_m = 0.0, true_force_N = 0.0;
  int sequence = 0;  ///< of samples in one contact
};

/// Mean absolute errors [N] of the ways to a force, over the samples for which each gave one.
struct ForceErrors {
  struct Error {
    double mae_N = 0.0;
    int samples = 0;
  };
  Error fused;           ///< the filter
  Error optical;         ///< sample by sample, at the localiser's place
  Error fixed_arm;       ///< at the middle of the tested range
  Error known_location;  ///< at the true place
  Error torque_only;     ///< from the ratio of torques; none for a single joint
  struct Common {
    Error optical, fixed_arm, known_location;
  };
  Common common;  ///< over the samples for which all three gave one
  /// Share of the gap between fixed arm and known location that the optical location recovers (paper: 89.5 %), over the
  /// common samples; empty where there is no gap.
  std::optional<double> recovery() const {
    const double gap = common.fixed_arm.mae_N - common.known_location.mae_N;
    return common.optical.samples && gap > 0.0 ? std::optional((common.fixed_arm.mae_N - common.optical.mae_N) / gap)
                                               : std::nullopt;
  }
};

/// Contact torques of the joints at a time, interpolated in the joint log and moved to the frames' clock; nullopt in
/// gaps of more than `max_gap_s`.
class ContactTorques {
 public:
  /// Throws InvalidArgument for no samples, or models that do not fit the joints.
  ContactTorques(std::span<const JointSample> samples, const std::vector<TorqueModel>& models,
      const ClockMap& clock = {}, double delay_s = 0.0)
      : joints_(int(models.size())), series_(series(samples, models, clock, delay_s)) {}

  /// Positions, then torques.
  std::optional<Eigen::VectorXd> at(std::int64_t stamp_ns, double max_gap_s = 0.02) const {
    return series_.at(stamp_ns, max_gap_s);
  }
  int joints() const { return joints_; }
  /// RMS misfit of interpolation in position [rad] and torque [N·m], joint by joint.
  Eigen::VectorXd residual() const { return series_.interpolation_residual(); }

 private:
  static TimeSeries series(std::span<const JointSample> samples, const std::vector<TorqueModel>& models,
      const ClockMap& clock, double delay_s) {
    const auto n = Eigen::Index(models.size());
    std::vector<std::int64_t> stamp;
    Eigen::MatrixXd value(2 * n, Eigen::Index(samples.size()));
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const JointSample& s = samples[i];
      if (s.effort.size() != n || s.position_rad.size() != n || s.velocity_rad_per_s.size() != n)
        throw InvalidArgument(
            message("contact torques: sample ", i, " has ", s.effort.size(), " joints, there are ", n, " models"));
      stamp.push_back(clock(s.stamp_ns) - std::llround(1e9 * delay_s));
      for (Eigen::Index j = 0; j < n; ++j) {
        const TorqueModel& m = models[std::size_t(j)];
        value(j, Eigen::Index(i)) = s.position_rad[j];
        value(n + j, Eigen::Index(i)) =
            m.motor_torque(s.effort[j], s.unit) - m.unloaded(s.position_rad[j], s.velocity_rad_per_s[j]);
      }
    }
    if (stamp.empty() || n == 0) throw InvalidArgument("contact torques: no samples or no joints");
    return {std::move(stamp), std::move(value)};
  }

  int joints_;
  TimeSeries series_;
};

/// Force at an assumed place by a sample's torques [N], of either sign; nullopt where they do not give it.
template <ContactJacobian J>
std::optional<double> force_at(const J& jacobian, const ForceSample& s, const ContactPoint& point, double sigma_Nm) {
  const Identification f = solve_forces(jacobian, s.position_rad, s.contact_torque_Nm, std::span(&point, 1), sigma_Nm);
  return f.complete() ? std::optional(f.value[0]) : std::nullopt;
}

/// Forces at the places seen, for torque_scale.
template <ContactJacobian J> std::vector<TorqueForce> optical_forces(
    const J& jacobian, std::span<const ForceSample> samples, int link, double torque_sigma_Nm) {
  std::vector<TorqueForce> list;
  for (const ForceSample& s : samples)
    if (s.estimated_y_m)
      if (const auto f = force_at(jacobian, s, {link, *s.estimated_y_m}, torque_sigma_Nm))
        list.push_back({s.sequence, s.true_y_m, *f, s.true_force_N});
  return list;
}

/// Compares the ways to a force on the same samples. The middle of the `tested` range is the fixed arm. All ways alike
/// give forces of at least 0.
template <ContactJacobian J> ForceErrors force_errors(
    const J& jacobian, std::span<const ForceSample> samples, const PadRange& tested, double torque_sigma_Nm) {
  require_in_range("end of the tested range", tested.to_m, tested.from_m, 10.0, "m");
  ForceErrors e;
  const auto count = [](ForceErrors::Error& error, double force, double truth) {
    error.mae_N += (std::abs(std::max(0.0, force) - truth) - error.mae_N) / double(++error.samples);
  };
  for (const ForceSample& s : samples) {
    const auto at = [&](ForceErrors::Error& error, double y) {
      const auto f = force_at(jacobian, s, {tested.link, y}, torque_sigma_Nm);
      if (f) count(error, *f, s.true_force_N);
      return f;
    };
    if (s.fused_N) count(e.fused, *s.fused_N, s.true_force_N);
    const auto optical = s.estimated_y_m ? at(e.optical, *s.estimated_y_m) : std::nullopt;
    const auto fixed = at(e.fixed_arm, tested.middle_m()), known = at(e.known_location, s.true_y_m);
    if (optical && fixed && known) {
      count(e.common.optical, *optical, s.true_force_N);
      count(e.common.fixed_arm, *fixed, s.true_force_N);
      count(e.common.known_location, *known, s.true_force_N);
    }
    const TorqueOnlySolution alone =
        solve_torque_only(jacobian, s.position_rad, s.contact_torque_Nm, tested, torque_sigma_Nm);
    if (alone.rank == 2) count(e.torque_only, alone.force_N, s.true_force_N);
  }
  return e;
}

}  // namespace lumo::sense
