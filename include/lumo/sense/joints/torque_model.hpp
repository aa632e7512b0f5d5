#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/golden_section.hpp"
#include "lumo/core/types.hpp"
#include "lumo/sense/devices/device.hpp"

#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

namespace lumo::sense {

/// Parameters from a linear least-squares problem, with what the data leave open.
struct Identification {
  Eigen::VectorXd value;       ///< of least norm in units of the scales: nothing is added along null directions
  Eigen::MatrixXd covariance;  ///< along the identified directions only
  Eigen::Index rank = 0;
  Eigen::MatrixXd
      null_space;  ///< parameters × (parameters − rank), unit columns in units of the scales: may be added at will
  double residual = 0.0;  ///< RMS of what the fit leaves

  Eigen::Index unknowns() const { return value.size(); }
  bool complete() const { return rank == unknowns(); }
};

/// Solves a x ≈ b for equal, independent errors. `scale` makes parameters of unlike units comparable (a typical size of
/// each). Singular values below `tolerance` times the largest do not count. `sigma`: standard deviation of an entry of
/// b; where it is 0, that of the residual is taken. `known` > 0: nor do directions whose standard deviation exceeds
/// that many scales, for which the data add nothing to what was known before. Throws InvalidArgument for shapes that do
/// not fit or numbers that are not finite.
inline Identification identify(const Eigen::MatrixXd& a, const Eigen::VectorXd& b, const Eigen::VectorXd& scale,
    double sigma = 0.0, double tolerance = 1e-6, double known = 0.0) {
  const Eigen::Index n = a.cols();
  if (n < 1 || a.rows() != b.size() || scale.size() != n)
    throw InvalidArgument(message("identification has ", a.rows(), " × ", n, " coefficients, ", b.size(),
        " observations and ", scale.size(), " scales"));
  if (!a.allFinite() || !b.allFinite() || !(scale.array() > 0.0).all() || !(scale.array() <= 1e100).all())
    throw InvalidArgument("identification: numbers must be finite, scales positive and at most 1e100");
  require_in_range("standard deviation of an observation", sigma, 0.0, 1e100, "");
  require_in_range("tolerance of the identification", tolerance, 0.0, 1.0, "");
  require_in_range("known scales of the identification", known, 0.0, 1e100, "");
  Identification r;
  const Eigen::MatrixXd scaled = a * scale.asDiagonal();
  if (a.rows() == 0 || scaled.cwiseAbs().maxCoeff() == 0.0) {
    r.value = Eigen::VectorXd::Zero(n);
    r.covariance = Eigen::MatrixXd::Zero(n, n);
    r.null_space = Eigen::MatrixXd::Identity(n, n);
    r.residual = b.size() ? b.norm() / std::sqrt(double(b.size())) : 0.0;
    return r;
  }
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(scaled, Eigen::ComputeThinU | Eigen::ComputeFullV);
  const Eigen::VectorXd& s = svd.singularValues();
  r.rank = (s.array() > tolerance * s[0]).count();
  const Eigen::VectorXd projection = svd.matrixU().transpose() * b;
  const auto deviation = [&] {
    const double left = std::max(b.squaredNorm() - projection.head(r.rank).squaredNorm(), 0.0);
    return sigma > 0.0 ? sigma : b.size() > r.rank ? std::sqrt(left / double(b.size() - r.rank)) : 0.0;
  };
  while (known > 0.0 && r.rank > 0 && deviation() > known * s[r.rank - 1]) --r.rank;
  const Eigen::MatrixXd v = svd.matrixV().leftCols(r.rank);
  const Eigen::VectorXd inverse = s.head(r.rank).cwiseInverse();
  r.value = scale.asDiagonal() * (v * inverse.cwiseProduct(projection.head(r.rank)));
  r.null_space = svd.matrixV().rightCols(n - r.rank);
  const double left = (a * r.value - b).squaredNorm();
  r.residual = std::sqrt(left / double(b.size()));
  const double variance = sigma > 0.0 ? sigma * sigma : b.size() > r.rank ? left / double(b.size() - r.rank) : 0.0;
  const Eigen::MatrixXd half = scale.asDiagonal() * v * inverse.asDiagonal();
  r.covariance = variance * half * half.transpose();
  return r;
}

/// One joint without contact: what the motor spends on friction, weight and offset. Friction is Coulomb's, Stribeck's
/// rise towards standstill and a viscous part (Armstrong-Hélouvry, Dupont & Canudas de Wit 1994); weight is that of one
/// rigid link, gravity_sin · sin q + gravity_cos · cos q.
struct TorqueModel {
  double torque_constant_Nm_per_A = 1.0;  ///< at the joint, gear included; not seen by an unloaded run
  double coulomb_Nm = 0.0;
  double stribeck_Nm = 0.0;  ///< by which friction at standstill exceeds Coulomb's
  double viscous_Nm_s_per_rad = 0.0;
  double bias_Nm = 0.0;
  double gravity_sin_Nm = 0.0, gravity_cos_Nm = 0.0;
  double stribeck_velocity_rad_per_s = 0.1;
  double rest_velocity_rad_per_s = 0.02;  ///< below, the joint may stand, and the sign of friction is not known
  double noise_Nm = 0.01;                 ///< of one sample

  /// Torque of the motor [N·m] from its effort.
  double motor_torque(double effort, Effort unit) const {
    return unit == Effort::current_A ? torque_constant_Nm_per_A * effort : effort;
  }
  double friction(double velocity) const {
    return std::tanh(velocity / rest_velocity_rad_per_s) * magnitude(velocity) + viscous_Nm_s_per_rad * velocity;
  }
  double unloaded(double position, double velocity) const {
    return friction(velocity) + bias_Nm + gravity_sin_Nm * std::sin(position) + gravity_cos_Nm * std::cos(position);
  }
  /// What friction at standstill leaves open [N·m]: uniform between its two signs.
  double stiction_sigma(double velocity) const {
    const double t = std::tanh(velocity / rest_velocity_rad_per_s);
    return (1.0 - t * t) * magnitude(velocity) / std::sqrt(3.0);
  }

 private:
  double magnitude(double velocity) const {
    return coulomb_Nm + stribeck_Nm * std::exp(-std::pow(velocity / stribeck_velocity_rad_per_s, 2));
  }
};

/// Throws InvalidArgument for numbers out of range.
inline void validate(const TorqueModel& m) {
  if (!(std::abs(m.torque_constant_Nm_per_A) >= 1e-6 && std::abs(m.torque_constant_Nm_per_A) <= 1e3))
    throw InvalidArgument(message("torque constant is ", m.torque_constant_Nm_per_A,
        " N·m/A, must lie in [1e-6, 1000] N·m/A, on either side of 0"));
  for (const double v : {m.coulomb_Nm, m.stribeck_Nm, m.bias_Nm, m.gravity_sin_Nm, m.gravity_cos_Nm})
    require_in_range("friction, offset or weight of a torque model", v, -1e3, 1e3, "N·m");
  require_in_range("viscous friction", m.viscous_Nm_s_per_rad, -1e3, 1e3, "N·m·s/rad");
  require_in_range("Stribeck velocity", m.stribeck_velocity_rad_per_s, 1e-9, 1e6, "rad/s");
  require_in_range("velocity below which a joint may stand", m.rest_velocity_rad_per_s, 1e-9, 1e6, "rad/s");
  require_in_range("noise of the torque", m.noise_Nm, 0.0, 1e3, "N·m");
}

/// A torque model from an unloaded run, and what that run left open.
struct TorqueIdentification {
  static constexpr std::array<const char*, 6> names{
      "coulomb_Nm", "stribeck_Nm", "viscous_Nm_s_per_rad", "bias_Nm", "gravity_sin_Nm", "gravity_cos_Nm"};
  TorqueModel model;      ///< what is not identified stays 0 along the null directions
  Identification linear;  ///< of `names`, in this order
};

/// Fits friction, bias and weight of joint `joint` to samples without contact. `start` gives the constants that such a
/// run leaves open. The Stribeck velocity is searched for by sections; all else is linear. Throws InvalidArgument for
/// no samples or numbers that are not finite.
inline TorqueIdentification identify_unloaded(
    std::span<const JointSample> samples, int joint, const TorqueModel& start = {}) {
  std::vector<double> q, v, t;
  for (const JointSample& s : samples) {
    if (joint < 0 || joint >= s.effort.size() || joint >= s.position_rad.size() || joint >= s.velocity_rad_per_s.size())
      throw InvalidArgument(message("unloaded run has no joint ", joint));
    q.push_back(s.position_rad[joint]);
    v.push_back(s.velocity_rad_per_s[joint]);
    t.push_back(start.motor_torque(s.effort[joint], s.unit));
  }
  if (t.empty()) throw InvalidArgument("unloaded run has no samples");
  const auto n = Eigen::Index(t.size());
  const Eigen::VectorXd torque = Eigen::Map<const Eigen::VectorXd>(t.data(), n);
  const auto fit = [&](double stribeck_velocity) {
    Eigen::MatrixXd a(n, 6);
    for (Eigen::Index i = 0; i < n; ++i) {
      const double w = v[std::size_t(i)], sign = std::tanh(w / start.rest_velocity_rad_per_s);
      a.row(i) << sign, sign * std::exp(-std::pow(w / stribeck_velocity, 2)), w, 1.0, std::sin(q[std::size_t(i)]),
          std::cos(q[std::size_t(i)]);
    }
    // What the run does not give to half of a typical parameter stays out: noise would fill it.
    constexpr double typical_Nm = 0.05, tolerance = 1e-6, known = 0.5;
    return identify(a, torque, Eigen::VectorXd::Constant(6, typical_Nm), 0.0, tolerance, known);
  };
  // Golden sections in the logarithm, after a coarse look: the residual has one minimum near its smallest coarse value.
  double fastest = 0.0;
  for (const double w : v) fastest = std::max(fastest, std::abs(w));
  const double low = std::log(std::max(1.5 * start.rest_velocity_rad_per_s, 1e-6)),
               high = std::max(low + 1e-3, std::log(std::max(fastest, 1e-6)));
  constexpr int looks = 13;
  int least = 0;
  double smallest = std::numeric_limits<double>::infinity();
  for (int k = 0; k < looks; ++k)
    if (const double r = fit(std::exp(low + (high - low) * k / (looks - 1))).residual; r < smallest * (1.0 - 1e-9)) {
      smallest = r;
      least = k;
    }
  const double a = low + (high - low) * std::max(0, least - 1) / (looks - 1),
               b = low + (high - low) * std::min(looks - 1, least + 1) / (looks - 1);
  const double best = std::exp(golden_section([&](double at) { return fit(std::exp(at)).residual; }, a, b, 24));
  TorqueIdentification result{start, fit(best)};
  const Eigen::VectorXd& x = result.linear.value;
  TorqueModel& m = result.model;
  m.stribeck_velocity_rad_per_s = best;
  m.coulomb_Nm = x[0];
  m.stribeck_Nm = x[1];
  m.viscous_Nm_s_per_rad = x[2];
  m.bias_Nm = x[3];
  m.gravity_sin_Nm = x[4];
  m.gravity_cos_Nm = x[5];
  m.noise_Nm = result.linear.residual;
  return result;
}

}  // namespace lumo::sense
