#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/contact_jacobian.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <tuple>
#include <utility>
#include <vector>

namespace lumo {

/// Fuses contact locations and joint torques into place and force of one contact (extended Kalman filter). State: y [m], F [N], offset of the
/// localiser [m], offset of each joint's torque [N·m]. The offsets are first-order Gauss–Markov processes, so that many samples of a motor that
/// sticks, or many frames of one peak, do not look like so many independent ones; the torque's is learnt while nothing touches.
/// Measurements carry their own time. One that arrives late is put where it belongs, and what came after it is done again.
template <ContactJacobian Jacobian>
class ContactFilter {
 public:
  struct Config {
    int link = 0;
    double from_m = -27.5_mm, to_m = 27.5_mm;      ///< of the pad: the prior of y is uniform on it
    double creep_m_per_sqrt_s = 5.0_mm;            ///< random walk of y
    double force_N_per_sqrt_s = 50.0;              ///< random walk of F
    double force_prior_N = 20.0;
    double location_bias_m = 1.0_mm, location_bias_s = 0.5;  ///< standard deviation and time constant
    double torque_bias_Nm = 0.02, torque_bias_s = 5.0;       ///< at rest; assumed
    double no_contact_N = 0.2;                     ///< what may act on the pad unseen
    double jump_gate = 5.0;                        ///< a location this many standard deviations off is a new contact
    std::size_t history = 512;                     ///< measurements that a late one may precede
  };

  static constexpr int max_state = 3 + max_joints;
  using State = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, max_state, 1>;
  using Covariance = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, max_state, max_state>;
  struct Belief {
    std::int64_t stamp_ns = 0;
    State mean;
    Covariance covariance;
    double y_m() const { return mean[0]; }
    double force_N() const { return mean[1]; }
  };

  /// Throws InvalidArgument for numbers that make no sense.
  explicit ContactFilter(Jacobian jacobian, const Config& config = {});

  /// Contact torque (motor minus torque model) with its variance at each joint, at joint angles q. False: older than the history, ignored.
  bool add_torque(std::int64_t stamp_ns, const JointVector& q, const JointVector& torque_Nm, const JointVector& variance) {
    return add({stamp_ns, Kind::torque, q, torque_Nm, variance, 0.0, 0.0, {}});
  }
  /// Location with the variance of its noise, without the localiser's offset.
  bool add_location(std::int64_t stamp_ns, double y_m, double variance_m2) { return add({stamp_ns, Kind::location, {}, {}, {}, y_m, variance_m2, {}}); }
  /// Nothing touches the finger.
  bool add_no_contact(std::int64_t stamp_ns) { return add({stamp_ns, Kind::no_contact, {}, {}, {}, 0.0, 0.0, {}}); }

  /// Belief at a time not before the last measurement's; prediction only.
  Belief at(std::int64_t stamp_ns) const {
    Belief b = last();
    predict(b, stamp_ns);
    return b;
  }
  void reset() { begin_ = 0, size_ = 0, started_ = false; }
  const Jacobian& jacobian() const { return jacobian_; }

 private:
  enum class Kind { torque, location, no_contact };
  struct Event {
    std::int64_t stamp_ns;
    Kind kind;
    JointVector q, torque, torque_variance;
    double y, y_variance;
    Belief after;
  };

  Event& event(std::size_t i) { return events_[(begin_ + i) % events_.size()]; }
  const Event& event(std::size_t i) const { return events_[(begin_ + i) % events_.size()]; }
  double prior_variance(int i) const {
    const double sigma = i == 0 ? (config_.to_m - config_.from_m) / std::sqrt(12.0) : i == 1 ? config_.force_prior_N : i == 2 ? config_.location_bias_m : config_.torque_bias_Nm;
    return sigma * sigma;
  }
  const Belief& last() const { return size_ ? event(size_ - 1).after : prior_; }
  bool add(Event e);
  void predict(Belief& b, std::int64_t stamp_ns) const;
  void apply(Belief& b, const Event& e) const;
  void update(Belief& b, const State& h, double innovation, double variance) const;

  Jacobian jacobian_;
  Config config_;
  std::vector<Event> events_;  ///< ring, in the order of stamps
  std::size_t begin_ = 0, size_ = 0;
  Belief prior_;
  bool started_ = false;
};

template <ContactJacobian Jacobian>
ContactFilter<Jacobian>::ContactFilter(Jacobian jacobian, const Config& config) : jacobian_(std::move(jacobian)), config_(config) {
  require_in_range("pad's end", config.to_m, config.from_m, 10.0, "m");
  for (const auto& [what, value, unit] : {std::tuple{"creep of the contact", config.creep_m_per_sqrt_s, "m/sqrt(s)"}, {"random walk of the force", config.force_N_per_sqrt_s, "N/sqrt(s)"},
                                          {"prior of the force", config.force_prior_N, "N"}, {"time of the localiser's offset", config.location_bias_s, "s"},
                                          {"offset of the torque", config.torque_bias_Nm, "N·m"}, {"time of the torque's offset", config.torque_bias_s, "s"},
                                          {"force without contact", config.no_contact_N, "N"}, {"jump gate", config.jump_gate, ""}})
    require_positive(what, value, unit);
  require_in_range("offset of the localiser", config.location_bias_m, 0.0, 1.0, "m");
  require_in_range("history of the filter", double(config.history), 2.0, 1e6, "measurements");
  events_.resize(config.history);
  const int n = jacobian_.joints();
  prior_.mean = State::Zero(3 + n);
  prior_.mean[0] = 0.5 * (config.from_m + config.to_m);
  prior_.covariance = Covariance::Zero(3 + n, 3 + n);
  for (int i = 0; i < 3 + n; ++i) prior_.covariance(i, i) = prior_variance(i);
}

template <ContactJacobian Jacobian>
bool ContactFilter<Jacobian>::add(Event e) {
  if (!started_) prior_.stamp_ns = e.stamp_ns, started_ = true;
  if (e.stamp_ns < prior_.stamp_ns) return false;
  if (size_ == events_.size()) {  // the oldest measurement becomes part of the prior
    if (e.stamp_ns < event(0).stamp_ns) return false;
    prior_ = event(0).after;
    begin_ = (begin_ + 1) % events_.size();
    --size_;
  }
  std::size_t place = size_;
  ++size_;
  for (; place > 0 && event(place - 1).stamp_ns > e.stamp_ns; --place) event(place) = std::move(event(place - 1));
  event(place) = std::move(e);
  for (std::size_t i = place; i < size_; ++i) {
    Belief b = i ? event(i - 1).after : prior_;
    predict(b, event(i).stamp_ns);
    apply(b, event(i));
    event(i).after = std::move(b);
  }
  return true;
}

template <ContactJacobian Jacobian>
void ContactFilter<Jacobian>::predict(Belief& b, std::int64_t stamp_ns) const {
  const double dt = std::max(0.0, 1e-9 * double(stamp_ns - b.stamp_ns));
  b.stamp_ns = std::max(b.stamp_ns, stamp_ns);
  if (dt == 0.0) return;
  State keep = State::Ones(b.mean.size()), noise(b.mean.size());
  const double location = std::exp(-dt / config_.location_bias_s), torque = std::exp(-dt / config_.torque_bias_s);
  keep[2] = location;
  keep.tail(b.mean.size() - 3).setConstant(torque);
  noise << config_.creep_m_per_sqrt_s * config_.creep_m_per_sqrt_s * dt, config_.force_N_per_sqrt_s * config_.force_N_per_sqrt_s * dt,
      (1.0 - location * location) * config_.location_bias_m * config_.location_bias_m,
      State::Constant(b.mean.size() - 3, (1.0 - torque * torque) * config_.torque_bias_Nm * config_.torque_bias_Nm);
  b.mean = b.mean.cwiseProduct(keep).eval();
  b.covariance = (keep.asDiagonal() * b.covariance * keep.asDiagonal()).eval();
  b.covariance.diagonal() += noise;
  // Neither walk knows more than its prior leaves open.
  for (const int i : {0, 1})
    if (const double most = prior_variance(i), now = b.covariance(i, i); now > most) {
      const double shrink = std::sqrt(most / now);
      b.covariance.row(i) *= shrink;
      b.covariance.col(i) *= shrink;
    }
}

template <ContactJacobian Jacobian>
void ContactFilter<Jacobian>::update(Belief& b, const State& h, double innovation, double variance) const {
  const State ph = b.covariance * h;
  const double s = h.dot(ph) + variance;
  const State gain = ph / s;
  b.mean += gain * innovation;
  // Joseph's form: stays symmetric and positive.
  Covariance left = Covariance::Identity(b.mean.size(), b.mean.size());
  left.noalias() -= gain * h.transpose();
  b.covariance = (left * b.covariance * left.transpose()).eval();
  b.covariance.noalias() += variance * gain * gain.transpose();
}

template <ContactJacobian Jacobian>
void ContactFilter<Jacobian>::apply(Belief& b, const Event& e) const {
  const Eigen::Index size = b.mean.size();
  State h = State::Zero(size);
  if (e.kind == Kind::location) {
    h[0] = h[2] = 1.0;
    const double innovation = e.y - b.mean[0] - b.mean[2];
    const double s = b.covariance(0, 0) + 2.0 * b.covariance(0, 2) + b.covariance(2, 2) + e.y_variance;
    if (innovation * innovation > config_.jump_gate * config_.jump_gate * s) {  // another contact: its place and force are new
      for (const int i : {0, 1, 2}) {
        b.covariance.row(i).setZero();
        b.covariance.col(i).setZero();
      }
      b.mean[0] = e.y, b.mean[2] = 0.0;
      b.covariance(0, 0) = prior_variance(0), b.covariance(1, 1) = prior_variance(1), b.covariance(2, 2) = prior_variance(2);
    }
    update(b, h, e.y - b.mean[0] - b.mean[2], e.y_variance);
  } else if (e.kind == Kind::no_contact) {
    h[1] = 1.0;
    update(b, h, -b.mean[1], config_.no_contact_N * config_.no_contact_N);
  } else {
    for (int j = 0; j < int(e.torque.size()); ++j) {  // joints one by one: their noises are independent
      const ContactPoint c{config_.link, std::clamp(b.mean[0], config_.from_m, config_.to_m)};
      const double arm = jacobian_.column(e.q, c)[j], slope = jacobian_.slope(e.q, c)[j];
      h.setZero();
      h[0] = slope * b.mean[1], h[1] = arm, h[3 + j] = 1.0;
      // The product F · arm(y) spreads by more than its tangent when both are unsure.
      const double curved = slope * slope * b.covariance(0, 0) * b.covariance(1, 1);
      update(b, h, e.torque[j] - arm * b.mean[1] - b.mean[3 + j], e.torque_variance[j] + curved);
    }
  }
}

}  // namespace lumo
