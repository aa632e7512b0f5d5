#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/joints/contact_jacobian.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <tuple>
#include <utility>
#include <vector>

namespace lumo::sense {

/// Kalman filter of a random walk x that is seen together with a slowly changing offset b (first-order Gauss–Markov):
/// two states, linear, exact. The offset keeps many equal measurements (a motor that sticks, frames of one peak) from
/// counting as independent ones.
struct OffsetWalk {
  double x = 0.0, b = 0.0;
  double xx = 0.0, xb = 0.0, bb = 0.0;  ///< covariance

  /// `walk`: growth of the variance of x per second, up to `most`. `offset`: stationary variance of b, which forgets
  /// within `time_s`.
  void predict(double dt, double walk, double most, double offset, double time_s) {
    const double keep = std::exp(-dt / time_s);
    b *= keep;
    xb *= keep;
    bb = keep * keep * bb + (1.0 - keep * keep) * offset;
    xx += walk * dt;
    if (xx > most) {
      xb *= std::sqrt(most / xx);
      xx = most;
    }
  }
  /// Takes z = x + share · b + noise.
  void update(double z, double variance, double share = 1.0) {
    const double px = xx + share * xb, pb = xb + share * bb, s = px + share * pb + variance;
    const double innovation = (z - x - share * b) / s;
    x += px * innovation;
    b += pb * innovation;
    xx = std::max(xx - px * px / s, 0.0);
    bb = std::max(bb - pb * pb / s, 0.0);
    xb -= px * pb / s;
  }
  /// Variance of what is seen, without noise.
  double seen() const { return xx + 2.0 * xb + bb; }
};

/// Place and normal force of one contact with their covariance.
struct ContactBelief {
  double y_m = 0.0;
  double force_N = 0.0;
  Eigen::Matrix2d covariance{{0.0, 0.0}, {0.0, 0.0}};  ///< of (y [m], F [N])
};

/// Settings of a ContactFilter.
struct ContactFilterConfig {
  int link = 0;
  double from_m = -27.5_mm, to_m = 27.5_mm;  ///< of the pad: the prior of y is uniform on it
  double creep_m_per_sqrt_s = 5.0_mm;        ///< random walk of y
  double torque_Nm_per_sqrt_s = 0.3;         ///< random walk of the contact's torques
  double torque_prior_Nm = 2.0, force_prior_N = 100.0;
  double location_bias_m = 1.0_mm,
         location_bias_s = 0.5;  ///< standard deviation and time constant of the localiser's offset
  double torque_bias_Nm = 0.02, torque_bias_s = 5.0;  ///< of the torques'; assumed
  double no_contact_Nm = 0.01;                        ///< torque of what may act on the pad unseen
  double jump_gate = 5.0;     ///< a location or torque this many standard deviations off is a new contact or load
  std::size_t history = 512;  ///< measurements that a late one may precede
  static constexpr double outside_m = 5.0_mm;  ///< how far beyond the pad's ends a place may be estimated
  // Gauss–Newton for place and force: iterations, and steps after which no further one is made.
  static constexpr int iterations = 8;
  static constexpr double place_step_m = 1e-9, force_step_N = 1e-7;
};

/// Fuses contact locations and joint torques, which come at different rates and with different delays. The filters hold
/// what is measured: y, and the contact's torque on each joint, each with the offset of its sensor; they are linear.
/// Place and force follow from them when asked (posterior mode, Gauss–Newton), so that no linearisation about an old
/// guess remains: an extended Kalman filter on (y, F) would come to believe that one joint's torque gives the place.
/// The torque's offset is learnt while nothing touches. A late measurement is inserted at its time, and later ones are
/// applied again.
template <ContactJacobian Jacobian> class ContactFilter {
 public:
  using Config = ContactFilterConfig;

  /// Throws InvalidArgument for numbers out of range.
  explicit ContactFilter(Jacobian jacobian, const Config& config = {});

  /// Contact torques (motor minus torque model) of all joints with the variances of their noises. False: older than the
  /// history, ignored. Throws InvalidArgument, as add_location does, for numbers that are not finite or belong to no
  /// finger.
  bool add_torque(std::int64_t stamp_ns, const JointVector& torque_Nm, const JointVector& variance) {
    if (torque_Nm.size() != jacobian_.joints() || variance.size() != jacobian_.joints())
      throw InvalidArgument(message("contact filter has ", jacobian_.joints(), " joints, got ", torque_Nm.size(),
          " torques and ", variance.size(), " variances"));
    for (Eigen::Index j = 0; j < torque_Nm.size(); ++j) {
      require_in_range("contact torque", torque_Nm[j], -1e9, 1e9, "N·m");
      require_in_range("variance of a contact torque", variance[j], 1e-18, 1e12, "N²·m²");
    }
    return add({stamp_ns, Kind::torque, torque_Nm, variance, 0.0, 0.0, {}});
  }
  /// Location with the variance of its noise, without the localiser's offset.
  bool add_location(std::int64_t stamp_ns, double y_m, double variance_m2) {
    require_in_range("place of a contact", y_m, -10.0, 10.0, "m");
    require_in_range("variance of a place", variance_m2, 1e-18, 100.0, "m²");
    return add({stamp_ns, Kind::location, {}, {}, y_m, variance_m2, {}});
  }
  /// Nothing touches the finger.
  bool add_no_contact(std::int64_t stamp_ns) { return add({stamp_ns, Kind::no_contact, {}, {}, 0.0, 0.0, {}}); }

  /// At a time not before the last measurement's (prediction only), at joint angles q.
  ContactBelief at(std::int64_t stamp_ns, const JointVector& q) const;
  /// Offset of a joint's torque that has been learnt [N·m].
  double torque_offset(int joint) const { return last().torque[std::size_t(joint)].b; }
  void reset() {
    begin_ = 0;
    size_ = 0;
    started_ = false;
  }
  const Jacobian& jacobian() const { return jacobian_; }

 private:
  static constexpr double least_variance = 1e-14;  ///< [m² or N²·m²] of what is known exactly: keeps weights finite

  enum class Kind { torque, location, no_contact };
  struct Seen {
    std::int64_t stamp_ns = 0;
    OffsetWalk place;
    std::array<OffsetWalk, std::size_t(max_joints)> torque;
  };
  struct Event {
    std::int64_t stamp_ns;
    Kind kind;
    JointVector torque, torque_variance;
    double y, y_variance;
    Seen after;
  };

  Event& event(std::size_t i) { return events_[(begin_ + i) % events_.size()]; }
  const Event& event(std::size_t i) const { return events_[(begin_ + i) % events_.size()]; }
  const Seen& last() const { return size_ ? event(size_ - 1).after : prior_; }
  double pad_variance() const { return (config_.to_m - config_.from_m) * (config_.to_m - config_.from_m) / 12.0; }
  bool add(Event e) {
    if (!started_) {
      prior_.stamp_ns = e.stamp_ns;
      started_ = true;
    }
    if (e.stamp_ns < prior_.stamp_ns) return false;
    if (size_ == events_.size()) {  // the oldest measurement becomes part of the prior
      if (e.stamp_ns < event(0).stamp_ns) return false;
      prior_ = event(0).after;
      begin_ = (begin_ + 1) % events_.size();
      --size_;
    }
    std::size_t place = size_++;
    for (; place > 0 && event(place - 1).stamp_ns > e.stamp_ns; --place) event(place) = event(place - 1);
    event(place) = std::move(e);
    for (std::size_t i = place; i < size_; ++i) {
      Event& now = event(i);
      now.after = i ? event(i - 1).after : prior_;
      predict(now.after, now.stamp_ns);
      apply(now.after, now);
    }
    return true;
  }
  void predict(Seen& s, std::int64_t stamp_ns) const {
    const double dt = 1e-9 * double(stamp_ns - s.stamp_ns);
    if (!(dt > 0.0)) return;
    s.stamp_ns = stamp_ns;
    const auto square = [](double v) { return v * v; };
    s.place.predict(dt, square(config_.creep_m_per_sqrt_s), pad_variance(), square(config_.location_bias_m),
        config_.location_bias_s);
    for (int j = 0; j < jacobian_.joints(); ++j)
      s.torque[std::size_t(j)].predict(dt, square(config_.torque_Nm_per_sqrt_s), square(config_.torque_prior_Nm),
          square(config_.torque_bias_Nm), config_.torque_bias_s);
  }
  void apply(Seen& s, const Event& e) const {
    if (e.kind == Kind::location) {
      const double off = e.y - s.place.x - s.place.b;
      if (off * off > config_.jump_gate * config_.jump_gate * (s.place.seen() + e.y_variance))  // another contact
        s.place = {e.y, 0.0, pad_variance(), 0.0, config_.location_bias_m * config_.location_bias_m};
      s.place.update(e.y, e.y_variance);
    } else {
      for (int j = 0; j < jacobian_.joints(); ++j) {
        OffsetWalk& t = s.torque[std::size_t(j)];
        if (e.kind == Kind::torque) {
          const double off = e.torque[j] - t.x - t.b;
          // Loads jump, offsets do not.
          if (off * off > config_.jump_gate * config_.jump_gate * (t.seen() + e.torque_variance[j])) {
            t.xx = config_.torque_prior_Nm * config_.torque_prior_Nm;
            t.xb = 0.0;
          }
          t.update(e.torque[j], e.torque_variance[j]);
        } else {
          t.update(0.0, config_.no_contact_Nm * config_.no_contact_Nm, 0.0);
        }
      }
    }
  }

  Jacobian jacobian_;
  Config config_;
  std::vector<Event> events_;  ///< ring, in the order of stamps
  std::size_t begin_ = 0, size_ = 0;
  Seen prior_;
  bool started_ = false;
};

template <ContactJacobian Jacobian> ContactFilter<Jacobian>::ContactFilter(Jacobian jacobian, const Config& config)
    : jacobian_(std::move(jacobian)), config_(config) {
  require_in_range("pad's end", config.to_m, config.from_m, 10.0, "m");
  require_in_range("joints of the Jacobian", jacobian_.joints(), 1, max_joints, "");
  using Row = std::tuple<const char*, double, const char*>;
  for (const auto& [what, value, unit] : {Row{"creep of the contact", config.creep_m_per_sqrt_s, "m/sqrt(s)"},
           Row{"random walk of the torque", config.torque_Nm_per_sqrt_s, "N·m/sqrt(s)"},
           Row{"prior of the torque", config.torque_prior_Nm, "N·m"},
           Row{"prior of the force", config.force_prior_N, "N"},
           Row{"time of the localiser's offset", config.location_bias_s, "s"},
           Row{"time of the torque's offset", config.torque_bias_s, "s"},
           Row{"torque without contact", config.no_contact_Nm, "N·m"}, Row{"jump gate", config.jump_gate, ""}})
    require_positive(what, value, unit);
  require_in_range("offset of the localiser", config.location_bias_m, 0.0, 1.0, "m");
  require_in_range("offset of the torque", config.torque_bias_Nm, 0.0, 1e3, "N·m");
  require_in_range("history of the filter", double(config.history), 2.0, 1e6, "measurements");
  events_.resize(config.history);
  prior_.place = {
      0.5 * (config.from_m + config.to_m), 0.0, pad_variance(), 0.0, config.location_bias_m * config.location_bias_m};
  prior_.torque.fill(
      {0.0, 0.0, config.torque_prior_Nm * config.torque_prior_Nm, 0.0, config.torque_bias_Nm * config.torque_bias_Nm});
}

template <ContactJacobian Jacobian>
ContactBelief ContactFilter<Jacobian>::at(std::int64_t stamp_ns, const JointVector& q) const {
  Seen s = last();
  predict(s, stamp_ns);
  const int n = jacobian_.joints();
  const double place = s.place.x, place_weight = 1.0 / std::max(s.place.xx, least_variance),
               force_weight = 1.0 / (config_.force_prior_N * config_.force_prior_N);
  // Mode of exp(−½ [(y − place)²/P_y + Σ (T_j − F a_j(y))²/P_j + F²/P_F]).
  ContactBelief belief;
  double y = place, force = 0.0;
  Eigen::Matrix2d information;
  for (int k = 0; k < Config::iterations; ++k) {
    const double inside = std::clamp(y, config_.from_m, config_.to_m);
    const JointVector a = jacobian_.column(q, {config_.link, inside}),
                      slope = jacobian_.slope(q, {config_.link, inside});
    double aa = force_weight, at = 0.0;
    for (int j = 0; j < n; ++j) {
      const OffsetWalk& t = s.torque[std::size_t(j)];
      const double weight = 1.0 / std::max(t.xx, least_variance);
      aa += weight * a[j] * a[j];
      at += weight * a[j] * t.x;
    }
    if (k == 0) force = at / aa;  // of that place
    information << place_weight, 0.0, 0.0, aa;
    Eigen::Vector2d gradient(place_weight * (place - y), at - aa * force);
    for (int j = 0; j < n; ++j) {
      const OffsetWalk& t = s.torque[std::size_t(j)];
      const double weight = 1.0 / std::max(t.xx, least_variance), h = slope[j] * force;
      information(0, 0) += weight * h * h;
      information(0, 1) += weight * h * a[j];
      gradient[0] += weight * h * (t.x - a[j] * force);
    }
    information(1, 0) = information(0, 1);
    belief.covariance = information.inverse();
    const Eigen::Vector2d step = belief.covariance * gradient;
    y = std::clamp(y + step[0], config_.from_m - Config::outside_m, config_.to_m + Config::outside_m);
    force += step[1];
    if (std::abs(step[0]) < Config::place_step_m && std::abs(step[1]) < Config::force_step_N) break;
  }
  belief.y_m = y;
  belief.force_N = force;
  return belief;
}

}  // namespace lumo::sense
