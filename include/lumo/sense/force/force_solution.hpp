#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/golden_section.hpp"
#include "lumo/sense/devices/faults.hpp"
#include "lumo/sense/joints/contact_jacobian.hpp"
#include "lumo/sense/joints/torque_model.hpp"

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
#include <optional>

namespace lumo::sense {

/// Numbers of both solutions.
struct ForceSolutionConfig {
  static constexpr double on_axis_m = 1e-4;           ///< contacts so near all axes count as on them
  static constexpr double rank_tolerance = 1e-3;      ///< singular values below this share of the largest count as 0
  static constexpr double place_unit_m = 0.01;        ///< of y beside a force of 1 N, for the rank
  static constexpr int cells = 64, refinements = 40;  ///< of the search along the pad, and within the best cells
};

/// Normal forces [N] at known places from the torques that contacts put on the motors. Forces that the torques do not
/// separate come back as null directions: three contacts on two joints, two on one link of one joint, any at a
/// joint's axis.
template <ContactJacobian J> Identification solve_forces(const J& jacobian, const JointVector& q,
    const JointVector& contact_torque_Nm, std::span<const ContactPoint> contacts, double torque_sigma_Nm) {
  for (const double t : contact_torque_Nm) require_in_range("torque of the contacts", t, -1e6, 1e6, "N·m");
  require_in_range("error of the torque", torque_sigma_Nm, 0.0, 1e6, "N·m");
  const auto m = Eigen::Index(contacts.size());
  const Eigen::MatrixXd a = contact_columns(jacobian, q, contacts);
  const double largest = a.size() ? a.cwiseAbs().maxCoeff() : 0.0;
  if (largest < ForceSolutionConfig::on_axis_m)
    return {Eigen::VectorXd::Zero(m), Eigen::MatrixXd::Zero(m, m), 0, Eigen::MatrixXd::Identity(m, m), 0.0};
  return identify(a, contact_torque_Nm, Eigen::VectorXd::Ones(m), torque_sigma_Nm, ForceSolutionConfig::rank_tolerance);
}

/// One contact from torques alone: place and force together, as far as the joints determine them.
struct TorqueOnlySolution {
  double y_m = 0.0;
  double force_N = 0.0;
  int rank = 0;                                        ///< of (y, force): 2 both, 1 a combination, 0 nothing
  Eigen::Vector2d null_direction{0.0, 0.0};            ///< (y in units of 10 mm, force in N), unit; where the rank is 1
  Eigen::Matrix2d covariance{{0.0, 0.0}, {0.0, 0.0}};  ///< of (y [m], force [N]); where the rank is 2
};

/// Within `range`: two joints before the contact give the place by the ratio of their torques
/// (paper's torque-only baseline is τ₁/τ₂). A single joint has rank 1. The value along a null direction is that of the
/// range's middle.
template <ContactJacobian J> TorqueOnlySolution solve_torque_only(const J& jacobian, const JointVector& q,
    const JointVector& contact_torque_Nm, const PadRange& range, double torque_sigma_Nm) {
  using Config = ForceSolutionConfig;
  const int link = range.link;
  const double from_m = range.from_m, to_m = range.to_m;
  require_in_range("start of the finger", from_m, -10.0, 10.0, "m");
  require_in_range("end of the finger", to_m, from_m, 10.0, "m");
  for (const double t : contact_torque_Nm) require_in_range("torque of the contacts", t, -1e6, 1e6, "N·m");
  if (contact_torque_Nm.size() != jacobian.joints())
    throw InvalidArgument(
        message("torques of ", contact_torque_Nm.size(), " joints, the finger has ", jacobian.joints()));
  require_positive("error of the torque", torque_sigma_Nm, "N·m");
  const auto force_at = [&](double y, double& misfit) {
    const JointVector a = jacobian.column(q, {link, y});
    const double force = a.dot(contact_torque_Nm) / std::max(a.squaredNorm(), 1e-12);
    misfit = (contact_torque_Nm - force * a).squaredNorm();
    return force;
  };
  TorqueOnlySolution s;
  s.y_m = range.middle_m();
  double misfit = 0.0;
  s.force_N = force_at(s.y_m, misfit);
  const auto sensitivity = [&] {
    Eigen::MatrixXd h(jacobian.joints(), 2);
    h.col(0) = Config::place_unit_m * s.force_N * jacobian.slope(q, {link, s.y_m});
    h.col(1) = jacobian.column(q, {link, s.y_m});
    return h;
  };
  const auto look = [&] {
    return identify(sensitivity(), Eigen::VectorXd(contact_torque_Nm), Eigen::Vector2d::Ones(), torque_sigma_Nm,
        Config::rank_tolerance);
  };
  Identification local = look();
  if (local.complete()) {
    constexpr int cells = Config::cells;
    double least = std::numeric_limits<double>::infinity();
    int best = 0;
    for (int k = 0; k <= cells; ++k) {
      force_at(from_m + (to_m - from_m) * k / cells, misfit);
      if (misfit < least) {
        least = misfit;
        best = k;
      }
    }
    const double a = from_m + (to_m - from_m) * std::max(0, best - 1) / cells,
                 b = from_m + (to_m - from_m) * std::min(cells, best + 1) / cells;
    s.y_m = golden_section([&](double y) { return force_at(y, misfit), misfit; }, a, b, Config::refinements);
    s.force_N = force_at(s.y_m, misfit);
    local = look();
  }
  s.rank = int(local.rank);
  if (s.rank == 1) s.null_direction = local.null_space.col(0);
  if (s.rank == 2) {
    const Eigen::Vector2d unit(Config::place_unit_m, 1.0);
    s.covariance = unit.asDiagonal() * local.covariance * unit.asDiagonal();
  }
  return s;
}

/// Which streams an estimate rests on.
enum class EstimatorState {
  ok,           ///< both, without faults
  degraded,     ///< both, but something is or was just wrong with one
  torque_only,  ///< no usable frame for too long
  vision_only,  ///< no usable joint sample for too long
  invalid       ///< neither
};

constexpr const char* to_string(EstimatorState s) {
  constexpr std::array<const char*, 5> names{"ok", "degraded", "torque_only", "vision_only", "invalid"};
  return names[std::size_t(s)];
}

/// One contact: the place on the finger and the normal force of the object on the pad. What is not known is empty;
/// the rest is finite.
struct ContactForce {
  std::optional<double> y_m;
  std::optional<double> force_N;
  double y_variance_m2 = 0.0;      ///< also where y is empty
  double force_variance_N2 = 0.0;  ///< the prior's where the force is not known
  double covariance_m_N = 0.0;
};

struct ForceEstimate {
  std::int64_t stamp_ns = 0;  ///< the time that it is for
  EstimatorState state = EstimatorState::invalid;
  Faults faults;
  int contacts = 0;
  std::array<ContactForce, 2> contact;  ///< the first max(1, contacts) mean something
  /// Unknowns are (y, F) of one contact or (F₁, F₂) of two, in units of what counts as known; `rank` of them (or
  /// combinations) are.
  int rank = 0;
  Eigen::Matrix2d null_directions{
      {0.0, 0.0}, {0.0, 0.0}};      ///< the last 2 − rank columns: unit directions that the data leave open
  std::int64_t frame_stamp_ns = 0;  ///< of the newest usable frame
  std::int64_t joint_stamp_ns = 0;  ///< of the newest usable joint sample
};

}  // namespace lumo::sense
