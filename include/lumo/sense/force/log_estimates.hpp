#pragma once

#include "lumo/core/stopwatch.hpp"
#include "lumo/sense/devices/replay.hpp"
#include "lumo/sense/force/force_baselines.hpp"
#include "lumo/sense/force/force_estimator.hpp"
#include "lumo/sense/joints/standstill.hpp"
#include "lumo/sense/localize/bayes_localizer.hpp"
#include "lumo/sense/profile/finger_view.hpp"
#include "lumo/sense/recording/log_truth.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace lumo::sense {

/// An estimate at one frame of a log, and later what was true there.
struct LogEstimate {
  std::int64_t stamp_ns = 0;
  LocationEstimate location;              ///< of the localiser
  ForceEstimate force;                    ///< of the filter
  std::optional<Eigen::VectorXd> joints;  ///< positions, then contact torques, interpolated
  double seconds = 0.0;                   ///< from decoded picture to estimate
};

/// What a run without contact tells of each joint.
struct JointReference {
  std::vector<TorqueModel> torque;    ///< none without joint samples
  std::vector<double> standstill_Nm;  ///< what may stick unseen
  double effort_step =
      0.0;  ///< of which all efforts are whole multiples apart, the coarsest joint's [A or N·m]; 0: none is seen
};

/// Knowledge of a log's finger from its unloaded stretch: what estimators start from.
struct LogReference {
  FingerView view;
  UnloadedReference unloaded;
  JointReference joints;
};

/// The probabilistic localiser for a whole finger of 60 mm with clear ends. Contacts are sought on the pad's regions
/// only. `bias_m`: how far bumps lie from contacts; chosen, as the ends' mirror images were, by seeds 1 to 10 of the
/// virtual lab, so these do not judge it.
inline BayesLocalizer::Config finger_localizer(const GreenProfile& readout, const UnloadedReference& unloaded,
                                               double bias_m = 0.75_mm, double end_bias_m = 1.25_mm) {
  BayesLocalizer::Config c;
  c.position_m = readout.positions_m(), c.noise = unloaded.noise(), c.unloaded = unloaded.mean();
  c.from_m = -27.5_mm, c.to_m = 27.5_mm;
  c.bias_sigma_m = bias_m;
  c.end_m = 30.0_mm, c.end_bias_sigma_m = end_bias_m;
  return c;
}

/// Localises in profiles of a log. Frames that cannot be read are left out.
template <LocationEstimator L>
std::vector<LogEstimate> locate(const std::vector<Profile>& profiles, const UnloadedReference& unloaded, L localizer) {
  std::vector<LogEstimate> list;
  for (Profile p : profiles) {
    unloaded.subtract(p);
    LogEstimate e;
    e.stamp_ns = p.stamp_ns;
    e.location = localizer.update(p);
    list.push_back(std::move(e));
  }
  return list;
}

/// The step in which a joint's efforts come, as a driver's few bits make it; 0 where they are not whole multiples of
/// one apart.
inline double effort_step(const std::vector<JointSample>& samples, int joint) {
  double step = std::numeric_limits<double>::infinity();
  int changes = 0;
  for (std::size_t i = 1; i < samples.size(); ++i)
    if (const double d = std::abs(samples[i].effort[joint] - samples[i - 1].effort[joint]); d > 0.0)
      step = std::min(step, d), ++changes;
  if (changes < 20) return 0.0;  // too few to tell by
  for (std::size_t i = 1; i < samples.size(); ++i) {
    const double steps = (samples[i].effort[joint] - samples[i - 1].effort[joint]) / step;
    if (std::abs(steps - std::round(steps)) > 1e-3) return 0.0;
  }
  return step;
}

/// Friction, weight and offset of each joint from all samples before `until_ns` (frames' clock), which must be without
/// contact; what moves tells of friction, what rests of what sticks. `start`: what such a run does not tell.
inline JointReference identify_joints(const std::vector<JointSample>& samples, const Session& session,
                                      std::int64_t until_ns) {
  JointReference reference;
  std::vector<JointSample> free, moving;
  for (const JointSample& s : samples)
    if (s.stamp_ns <= until_ns) {
      free.push_back(s);
      if (s.velocity_rad_per_s.cwiseAbs().maxCoeff() > 0.05) moving.push_back(s);
    }
  if (free.empty()) return reference;
  const auto joints = int(free.front().effort.size());
  for (int j = 0; j < joints; ++j) {
    TorqueModel start;
    start.torque_constant_Nm_per_A = session.torque_constant_Nm_per_A[std::size_t(j)];
    reference.torque.push_back(identify_unloaded(moving.size() >= 100 ? moving : free, j, start).model);
    reference.standstill_Nm.push_back(standstill_scatter(free, j, reference.torque.back()).value_or(0.02));
    reference.effort_step = std::max(reference.effort_step, effort_step(free, j));
  }
  return reference;
}

/// Settings of a force estimator for joints that were identified without contact (`reference`). Periods are those of
/// the streams.
template <class Estimator>
typename Estimator::Config force_config(const JointReference& reference, const Session& session, Effort unit,
                                        double joint_period_s, double frame_period_s, double map_sigma_m, int link) {
  typename Estimator::Config config;
  config.torque = reference.torque;
  config.filter.link = link;
  config.joints.joints = int(reference.torque.size());
  config.joints.period_s = joint_period_s;
  double scatter = 0.05,
         quietest =
             config.joints.max_effort;  // of efforts: one limit for all joints, that of the one that scatters most
  for (const TorqueModel& m : reference.torque) {
    const double noise = unit == Effort::current_A ? std::abs(m.noise_Nm / m.torque_constant_Nm_per_A) : m.noise_Nm;
    scatter = std::max(scatter, noise), quietest = std::min(quietest, noise);
  }
  config.joints.quantum = std::min(reference.effort_step, config.joints.max_effort), config.joints.noise = quietest;
  config.joints.spike = 6.0 * scatter;
  config.frames.period_s = frame_period_s;
  config.filter.torque_bias_Nm =
      std::max(0.005, *std::max_element(reference.standstill_Nm.begin(), reference.standstill_Nm.end()));
  config.filter.torque_bias_s = 0.5;  // what sticks at rest tells nothing of what sticks under the next contact
  config.frame_delay_s = session.frame_delay_s, config.joint_delay_s = session.joint_delay_s;
  config.frame_timeout_s = std::max(0.2, 4.0 * frame_period_s),
  config.joint_timeout_s = std::max(0.05, 10.0 * joint_period_s);
  config.map_sigma_m = map_sigma_m;
  return config;
}

/// Plays a log to the force estimator as it came, one step at each frame. `make_camera()` gives the log's camera from
/// its start; `samples` are on the frames' clock. Throws InputError without joint samples, InvalidArgument for parts
/// that do not fit.
template <class MakeCamera, LocationEstimator L, ContactJacobian J>
std::vector<LogEstimate> estimate_forces(MakeCamera make_camera, const std::vector<JointSample>& samples,
                                         const std::vector<std::int64_t>& frame_ns, const LogReference& reference,
                                         const LongitudinalBins& bins, const L& localizer, const J& jacobian,
                                         const Session& session, double map_sigma_m = 0.0, int link = 0) {
  if (samples.size() < 2 || reference.joints.torque.empty())
    throw InputError("the log has no joint samples to estimate a force from");
  using Source = decltype(make_camera());
  Replay<Source> camera(make_camera());
  Replay<RecordedActuator> actuator{RecordedActuator(samples)};
  using Estimator = ForceEstimator<Replay<Source>, Replay<RecordedActuator>, L, GreenProfile, J>;
  const double joint_period_s =
      1e-9 * double(samples.back().stamp_ns - samples.front().stamp_ns) / double(samples.size() - 1);
  const double frame_period_s = frame_ns.size() > 1
                                    ? 1e-9 * double(frame_ns.back() - frame_ns.front()) / double(frame_ns.size() - 1)
                                    : FrameMonitor::Config{}.period_s;
  Estimator estimator(camera, actuator, reference.view.readout(bins), localizer, jacobian, reference.unloaded,
                      force_config<Estimator>(reference.joints, session, samples.front().unit, joint_period_s,
                                              frame_period_s, map_sigma_m, link));
  const ContactTorques torques(samples, reference.joints.torque);
  std::vector<LogEstimate> list;
  for (const std::int64_t now : frame_ns) {
    camera.until(now);
    actuator.until(now);
    LogEstimate e;
    e.stamp_ns = now;
    const Stopwatch watch;
    e.force = estimator.step(now);
    e.seconds = watch.seconds();
    e.location = estimator.location();
    e.joints = torques.at(now, std::max(0.02, 5.0 * joint_period_s));
    list.push_back(std::move(e));
  }
  return list;
}

/// How well places agree with the truth, over frames with a true force of at least `from_N` where the truth tells the
/// place.
struct LocationScore {
  int samples = 0;           ///< frames to be located
  int located = 0;           ///< of them, those with exactly one contact found
  double mae_m = 0.0;        ///< over the located ones
  double coverage_90 = 0.0;  ///< share of the located ones whose 90 % interval holds the truth
};

template <class PlaceOf>
LocationScore location_score(const std::vector<LogEstimate>& estimates, const LogTruth& truth, double from_N,
                             PlaceOf place_of) {
  LocationScore s;
  int covered = 0;
  for (const LogEstimate& e : estimates) {
    const LogTruth::Touch t = truth.at(e.stamp_ns);
    if (!t.y_m || !t.force_N || *t.force_N < from_N) continue;
    ++s.samples;
    const std::optional<ContactLocation> at = place_of(e);
    if (!at) continue;
    ++s.located;
    const double off = std::abs(at->y_m - *t.y_m);
    s.mae_m += off;
    covered += off <= 1.6448536269514722 * std::sqrt(at->variance_m2);
  }
  if (s.located > 0) s.mae_m /= s.located, s.coverage_90 = double(covered) / s.located;
  return s;
}

/// Errors of forces over the frames with a true force of at least `from_N`. Where the localiser saw no single contact
/// the optical way takes the middle of the tested range, so that all ways stand on the same samples.
struct ForceScore {
  ForceErrors errors;
  int samples = 0;
  double coverage_90 = 0.0;  ///< of the fused force's 90 % interval
};

template <ContactJacobian J>
ForceScore force_score(const std::vector<LogEstimate>& estimates, const LogTruth& truth, const J& jacobian,
                       double from_m, double to_m, double torque_sigma_Nm, double from_N = 0.5, int link = 0) {
  std::vector<ForceSample> samples;
  int given = 0, covered = 0;
  for (const LogEstimate& e : estimates) {
    const LogTruth::Touch t = truth.at(e.stamp_ns);
    if (!t.y_m || !t.force_N || *t.force_N < from_N || !e.joints) continue;
    ForceSample s;
    const Eigen::Index n = e.joints->size() / 2;
    s.stamp_ns = e.stamp_ns, s.position_rad = e.joints->head(n), s.contact_torque_Nm = e.joints->tail(n),
    s.true_y_m = *t.y_m, s.true_force_N = *t.force_N;
    s.estimated_y_m = e.location.contacts == 1 ? e.location.contact[0].y_m : 0.5 * (from_m + to_m);
    const ContactForce& fused = e.force.contact[0];
    s.fused_N = fused.force_N;
    if (fused.force_N)
      ++given,
          covered += std::abs(*fused.force_N - *t.force_N) <= 1.6448536269514722 * std::sqrt(fused.force_variance_N2);
    samples.push_back(std::move(s));
  }
  ForceScore score;
  score.samples = int(samples.size());
  if (!samples.empty())
    score.errors = force_errors(jacobian, std::span<const ForceSample>(samples), link, from_m, to_m, torque_sigma_Nm);
  score.coverage_90 = given > 0 ? double(covered) / given : 0.0;
  return score;
}

}  // namespace lumo::sense
