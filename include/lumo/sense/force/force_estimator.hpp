#pragma once

#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/force/contact_filter.hpp"
#include "lumo/sense/force/force_solution.hpp"
#include "lumo/sense/joints/joint_monitor.hpp"
#include "lumo/sense/joints/planar_finger.hpp"
#include "lumo/sense/joints/torque_model.hpp"
#include "lumo/sense/localize/location_estimator.hpp"
#include "lumo/sense/profile/frame_monitor.hpp"
#include "lumo/sense/profile/green_profile.hpp"
#include "lumo/sense/profile/unloaded_reference.hpp"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace lumo::sense {

/// Settings of a ForceEstimator.
struct ForceEstimatorConfig {
  FrameMonitor::Config frames;  ///< its positions and unloaded values are filled in where empty; exposure and gain of
                                ///< the reference, where known, are the caller's
  JointMonitor::Config joints;
  ContactFilterConfig filter;
  std::vector<TorqueModel> torque{TorqueModel{}};  ///< one for each joint
  double frame_delay_s = 0.0;                      ///< from the light to the stamp, known
  double joint_delay_s = 0.0;
  double frame_timeout_s = 0.2;
  double joint_timeout_s = 0.05;
  double fault_hold_s = 0.15;    ///< a fault is reported for this long
  double map_sigma_m = 0.0;      ///< of the map from image to finger (AxisMap::variance_m2); the same in all frames, so
                                 ///< no filter lessens it
  double stiction_time_s = 0.5;  ///< how long a joint sticks on one side; assumed
  double smoothing_s = 0.01;     ///< time constant of the torques that forces of two contacts are from
  double known_location_m = 6.0_mm;  ///< standard deviation up to which y counts as known
  double known_force_N = 5.0;
  int max_frames = 4, max_samples = 256;  ///< taken in one step
};

/// Place and force of a contact from a camera and motors, as both deliver. Each `step` takes what has arrived and
/// checks it; it waits no longer than the camera's `next` does. The estimate is always finite and states which streams
/// it rests on. Faulty frames and samples are left out; `fault_hold_s` after the last fault the state is ok again.
template <Camera Camera_, Actuator Actuator_, LocationEstimator Localizer, Readout Readout_ = GreenProfile,
    ContactJacobian Jacobian = MomentArm>
requires std::same_as<typename Readout_::Sample, Frame>
class ForceEstimator {
  static_assert(!std::same_as<Readout_, PositiveGreenProfile>,
      "frames are checked by their light against the unloaded finger's: the readout must be linear in it, as "
      "GreenProfile is");

 public:
  using Config = ForceEstimatorConfig;
  struct Light {
    Readout_ readout;
    UnloadedReference unloaded;  ///< of the same readout
  };

  /// Camera and actuator stay the caller's and must outlive the estimator. Throws InvalidArgument for parts that do not
  /// fit.
  ForceEstimator(
      Camera_& camera, Actuator_& actuator, Light light, Localizer localizer, Jacobian jacobian, Config config)
      : camera_(&camera),
        actuator_(&actuator),
        readout_(std::move(light.readout)),
        localizer_(std::move(localizer)),
        unloaded_(std::move(light.unloaded)),
        config_(std::move(config)),
        frame_monitor_(completed(config_.frames, readout_, unloaded_)),
        joint_monitor_(config_.joints),
        filter_(std::move(jacobian), config_.filter) {
    const int n = filter_.jacobian().joints();
    if (int(config_.torque.size()) != n || config_.joints.joints != n)
      throw InvalidArgument(message("force estimator has ", n, " joints in its Jacobian, ", config_.torque.size(),
          " torque models and ", config_.joints.joints, " joints to watch"));
    if (unloaded_.mean().size() != readout_.positions_m().size())
      throw InvalidArgument(message(
          "unloaded reference has ", unloaded_.mean().size(), " values, the readout ", readout_.positions_m().size()));
    joint_q_ = joint_torque_ = joint_variance_ = JointVector::Zero(n);
    for (const TorqueModel& m : config_.torque) validate(m);
    require_in_range("delay of the frames", config_.frame_delay_s, -10.0, 10.0, "s");
    require_in_range("delay of the joint samples", config_.joint_delay_s, -10.0, 10.0, "s");
    require_in_range("time for which a fault is reported", config_.fault_hold_s, 0.0, 1e6, "s");
    require_in_range("time for which a joint sticks", config_.stiction_time_s, 0.0, 1e3, "s");
    require_positive("time over which torques are smoothed", config_.smoothing_s, "s");
    require_positive("frame timeout", config_.frame_timeout_s, "s");
    require_positive("joint timeout", config_.joint_timeout_s, "s");
    require_positive("location that counts as known", config_.known_location_m, "m");
    require_positive("force that counts as known", config_.known_force_N, "N");
    require_in_range("error of the map", config_.map_sigma_m, 0.0, 1.0, "m");
    require_in_range("frames in a step", config_.max_frames, 1, 1e6, "");
    require_in_range("samples in a step", config_.max_samples, 1, 1e6, "");
  }

  /// Takes all that has arrived and answers for the time `now_ns`, on the clock of the stamps.
  ForceEstimate step(std::int64_t now_ns) {
    if (!begun_) begin_ns_ = now_ns_ = frame_ns_ = joint_ns_ = now_ns;
    begun_ = true;
    now_ns_ = std::max(now_ns_, now_ns);
    for (int i = 0; i < config_.max_samples; ++i) {
      const auto s = actuator_->next();
      if (!s) break;
      take(*s);
    }
    for (int i = 0; i < config_.max_frames; ++i) {
      const auto f = camera_->next();
      if (!f) break;
      take(*f);
    }
    if (camera_->state() == StreamState::failed) note(Fault::camera_lost);
    if (actuator_->state() == StreamState::failed) note(Fault::actuator_lost);
    const bool frames = within(frame_seen_, frame_ns_, config_.frame_timeout_s),
               joints = within(joint_seen_, joint_ns_, config_.joint_timeout_s);
    const double since_s = 1e-9 * double(now_ns_ - begin_ns_);  // what begins is not missing yet
    if (!frames && since_s > config_.frame_timeout_s) note(Fault::frames_missing);
    if (!joints && since_s > config_.joint_timeout_s) note(Fault::joint_missing);

    ForceEstimate e;
    e.stamp_ns = now_ns_;
    e.frame_stamp_ns = frame_ns_;
    e.joint_stamp_ns = joint_ns_;
    for (unsigned i = 0; i < unsigned(Fault::count); ++i)
      if (faulty_[i] && 1e-9 * double(now_ns_ - fault_ns_[i]) <= config_.fault_hold_s) e.faults.add(Fault(i));
    using enum EstimatorState;
    e.state = frames && joints ? (e.faults.any() ? degraded : ok)
              : joints         ? torque_only
              : frames         ? vision_only
                               : invalid;
    e.contacts = location_.contacts;
    if (e.contacts == 2 && frames) describe_two(e, joints);
    else describe_one(e);
    return e;
  }

  /// What the newest usable frame said.
  const LocationEstimate& location() const { return location_; }
  /// Its profile minus the unloaded one.
  const Profile& response() const { return profile_; }
  const ContactFilter<Jacobian>& filter() const { return filter_; }

 private:
  void take(const JointSample& s) {
    const auto verdict = joint_monitor_.check(s, now_ns_);
    note(verdict.faults);
    if (!verdict.usable) return;
    const Eigen::Index n = s.effort.size();
    JointVector torque(n), variance(n);
    for (Eigen::Index j = 0; j < n; ++j) {
      const TorqueModel& m = config_.torque[std::size_t(j)];
      torque[j] = m.motor_torque(s.effort[j], s.unit) - m.unloaded(s.position_rad[j], s.velocity_rad_per_s[j]);
      const double stick = m.stiction_sigma(s.velocity_rad_per_s[j]);
      variance[j] = std::clamp(
          m.noise_Nm * m.noise_Nm + stick * stick * std::max(1.0, config_.stiction_time_s / config_.joints.period_s),
          1e-12, 1e12);
    }
    filter_.add_torque(s.stamp_ns - std::int64_t(1e9 * config_.joint_delay_s), torque, variance);
    const double weight = joint_seen_ ? -std::expm1(-1e-9 * double(s.stamp_ns - joint_ns_) / config_.smoothing_s) : 1.0;
    joint_torque_ += weight * (torque - joint_torque_);
    joint_variance_ = (1.0 - weight) * (1.0 - weight) * joint_variance_ + weight * weight * variance;
    joint_q_ = s.position_rad;
    joint_ns_ = s.stamp_ns;
    joint_seen_ = true;
  }
  void take(const Frame& f) {
    const auto time = frame_monitor_.check_time(f.stamp_ns, now_ns_);
    note(time.faults);
    if (!time.usable) return;
    if (!readout_.read(f, reading_)) return note(Fault::frame_corrupt);
    const auto light = frame_monitor_.check_light(reading_, f.exposure_s, f.gain);
    note(light.faults);
    if (!light.usable) return;
    std::swap(profile_, reading_);
    unloaded_.subtract(profile_);
    location_ = localizer_.update(profile_);
    const std::int64_t taken = f.stamp_ns - std::int64_t(1e9 * config_.frame_delay_s);
    if (location_.unknown) note(Fault::response_unknown);
    else if (location_.contacts == 0) filter_.add_no_contact(taken);
    if (location_.contacts == 1) {
      // The filter has the localiser's offset as a state, and takes noises as independent.
      const ContactLocation& c = location_.contact[0];
      filter_.add_location(taken, c.y_m,
          std::clamp(c.noise_variance_m2 > 0.0 ? c.noise_variance_m2 : c.variance_m2 - c.bias_variance_m2, 1e-10, 1.0));
    }
    frame_ns_ = f.stamp_ns;
    frame_seen_ = true;
  }
  void note(Faults faults) {
    for (unsigned i = 0; i < unsigned(Fault::count); ++i)
      if (faults.has(Fault(i))) {
        fault_ns_[i] = now_ns_;
        faulty_[i] = true;
      }
  }
  void note(Fault f) {
    Faults one;
    one.add(f);
    note(one);
  }
  bool within(bool seen, std::int64_t stamp_ns, double limit_s) const {
    return seen && 1e-9 * double(now_ns_ - stamp_ns) <= limit_s;
  }
  void describe_one(ForceEstimate& e) const {
    ContactBelief b = filter_.at(now_ns_, joint_q_);
    const ContactPoint point{config_.filter.link, std::clamp(b.y_m, config_.filter.from_m, config_.filter.to_m)};
    const JointVector arm = filter_.jacobian().column(joint_q_, point),
                      slope = filter_.jacobian().slope(joint_q_, point);
    const Eigen::Vector2d shift(
        1.0, -b.force_N * slope.dot(arm) / std::max(arm.squaredNorm(), 1e-8));  // a shift of y moves F along the torque
    b.covariance += config_.map_sigma_m * config_.map_sigma_m * shift * shift.transpose();
    ContactForce& c = e.contact[0];
    c.y_variance_m2 = b.covariance(0, 0);
    c.force_variance_N2 = b.covariance(1, 1);
    c.covariance_m_N = b.covariance(0, 1);
    const double force = std::max(0.0, b.force_N);  // pads are pushed, not pulled
    if (e.state == EstimatorState::torque_only || e.state == EstimatorState::invalid)
      e.contacts = force > 3.0 * std::sqrt(c.force_variance_N2) ? 1 : 0;
    e.contacts = std::min(e.contacts, 1);
    if (std::sqrt(c.y_variance_m2) <= config_.known_location_m) c.y_m = point.y_m;
    if (std::sqrt(c.force_variance_N2) <= config_.known_force_N) c.force_N = force;
    // Directions of the posterior that are wider than what counts as known are open.
    const Eigen::Vector2d unit(config_.known_location_m, config_.known_force_N);
    const Eigen::Matrix2d scaled = unit.cwiseInverse().asDiagonal() * b.covariance * unit.cwiseInverse().asDiagonal();
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes;
    axes.computeDirect(scaled);  // ascending
    e.rank = int((axes.eigenvalues().array() <= 1.0).count());
    e.null_directions = axes.eigenvectors();
  }
  void describe_two(ForceEstimate& e, bool with_forces) const {
    const int link = config_.filter.link;
    const double map2 = config_.map_sigma_m * config_.map_sigma_m,
                 force2 = config_.filter.force_prior_N * config_.filter.force_prior_N;
    std::array<ContactPoint, 2> points;
    for (std::size_t i = 0; i < 2; ++i) {
      points[i] = {link, location_.contact[i].y_m};
      e.contact[i].y_m = location_.contact[i].y_m;
      e.contact[i].y_variance_m2 = location_.contact[i].variance_m2 + map2;
      e.contact[i].force_variance_N2 = force2;
    }
    e.rank = 0;
    e.null_directions.setIdentity();
    if (!with_forces) return;

    JointVector torque = joint_torque_;
    for (int j = 0; j < int(torque.size()); ++j) torque[j] -= filter_.torque_offset(j);
    const double bias = config_.filter.torque_bias_Nm,
                 sigma = std::sqrt(bias * bias + joint_variance_.maxCoeff());  // of the joint that is worst
    const Identification forces = solve_forces(filter_.jacobian(), joint_q_, torque, points, sigma);
    // A place that is off by dy takes F a'(y) dy of torque for force: dF = −A⁺ a' F dy, with A⁺ = (AᵀA)⁺ Aᵀ. The map's
    // error is the same for both.
    const Eigen::MatrixXd inverse =
        forces.covariance / (sigma * sigma) *
        contact_columns(filter_.jacobian(), joint_q_, std::span<const ContactPoint>(points)).transpose();
    Eigen::Matrix2d by_place;
    for (Eigen::Index i = 0; i < 2; ++i)
      by_place.col(i) = -forces.value[i] * (inverse * filter_.jacobian().slope(joint_q_, points[std::size_t(i)]));
    Eigen::Matrix2d place = Eigen::Matrix2d::Constant(map2);
    for (Eigen::Index i = 0; i < 2; ++i) place(i, i) += location_.contact[std::size_t(i)].variance_m2;
    const Eigen::Matrix2d covariance = forces.covariance + by_place * place * by_place.transpose() +
                                       force2 * forces.null_space * forces.null_space.transpose();
    const Eigen::Matrix2d mixed = place * by_place.transpose();  // of places with forces
    for (Eigen::Index i = 0; i < 2; ++i) {
      ContactForce& c = e.contact[std::size_t(i)];
      c.force_variance_N2 = covariance(i, i);
      c.covariance_m_N = mixed(i, i);
      if (forces.complete() && std::sqrt(c.force_variance_N2) <= config_.known_force_N)
        c.force_N = std::max(0.0, forces.value[i]);
    }
    // As for one contact: forces that are separated in principle, but worse than what counts as known, are open.
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes;
    axes.computeDirect(Eigen::Matrix2d(covariance / (config_.known_force_N * config_.known_force_N)));  // ascending
    e.rank = int((axes.eigenvalues().array() <= 1.0).count());
    e.null_directions = axes.eigenvectors();
  }

  Camera_* camera_;
  Actuator_* actuator_;
  Readout_ readout_;
  Localizer localizer_;
  UnloadedReference unloaded_;
  Config config_;
  FrameMonitor frame_monitor_;
  JointMonitor joint_monitor_;
  ContactFilter<Jacobian> filter_;
  Profile reading_, profile_;
  LocationEstimate location_;
  JointVector joint_q_, joint_torque_,
      joint_variance_;  ///< newest angles, smoothed contact torque and the variance of its noise
  std::array<std::int64_t, std::size_t(Fault::count)> fault_ns_{};
  std::array<bool, std::size_t(Fault::count)> faulty_{};
  std::int64_t begin_ns_ = 0, now_ns_ = 0, frame_ns_ = 0, joint_ns_ = 0;
  bool begun_ = false, frame_seen_ = false, joint_seen_ = false;

  static FrameMonitor::Config completed(
      FrameMonitor::Config c, const Readout_& readout, const UnloadedReference& unloaded) {
    if (c.position_m.size() == 0) c.position_m = readout.positions_m();
    if (c.unloaded.size() == 0) c.unloaded = unloaded.mean();
    return c;
  }
};

}  // namespace lumo::sense
