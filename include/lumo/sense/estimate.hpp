#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/stopwatch.hpp"
#include "lumo/sense/devices/replay.hpp"
#include "lumo/sense/force/finger_model.hpp"
#include "lumo/sense/force/frame_estimate.hpp"
#include "lumo/sense/recording/recording.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

namespace lumo::sense {

/// Of a reference, so that light relative to it is a number [DN].
inline constexpr double least_light_DN = 1e-6;

/// Picture → profile → unloaded reference; torques → joints: what a recording's unloaded stretch gives.
/// `make_camera()` gives the pictures from their start. Throws InputError if no unloaded finger is seen or felt.
template <class MakeCamera>
FingerModel<> known_finger(const Recording& recording, MakeCamera make_camera, const FingerOptics& assumed = {}) {
  require_nanoseconds(recording);
  const std::int64_t start_ns = recording.frames.empty() ? 0 : recording.frames.front().stamp_ns;
  const UnloadedStretch rest = UnloadedStretch::of(recording.session, start_ns);
  FingerModel<> finger = finger_model(recording.session);
  finger.optics = assumed;
  auto first = make_camera();
  finger.optics.view = view_finger(first, recording.session, rest, recording.path);
  auto pictures = make_camera();
  GreenProfile readout = finger.optics.readout();
  std::vector<Profile> profiles = read_profiles(pictures, readout);
  take_out_flicker(finger.optics.view, profiles, rest);
  finger.optics.unloaded =
      unloaded_reference(profiles, rest, recording.path, finger.optics.view.repeats(finger.optics.bins));
  finger.joints = unloaded_joints(recording, joint_stretch(recording.session, rest, profiles, finger.optics.unloaded));
  require_common_time(recording);
  return finger;
}

/// Profile → unloaded reference → location. Pictures that cannot be read have no profile and no estimate. Nor have
/// those that are black, damaged (no number) or dark about one LED: their state is `invalid`, and `force.faults` says
/// why. Light that changes as a whole is reported in `force.faults` only. Throws InvalidArgument for profiles of other
/// bins.
template <class MakeLocalizer> std::vector<FrameEstimate> locate(
    const std::vector<Profile>& profiles, const FingerOptics& finger, MakeLocalizer make_localizer) {
  auto localizer = make_localizer(finger);
  FrameMonitor::Config watched;
  watched.position_m = finger.readout().positions_m();
  watched.unloaded = finger.unloaded.mean().cwiseMax(least_light_DN);
  FrameMonitor monitor(watched);
  std::vector<FrameEstimate> list;
  for (Profile p : profiles) {
    FrameEstimate e;
    e.stamp_ns = e.location.stamp_ns = p.stamp_ns;
    e.force.faults = monitor.check_light(p, 0.0, 0.0).faults;
    if (e.force.faults.has(Fault::frame_black) || e.force.faults.has(Fault::led_dead) || !p.value.allFinite()) {
      list.push_back(std::move(e));
      continue;
    }
    finger.unloaded.subtract(p);
    e.force.state = EstimatorState::vision_only;
    e.location = localizer.update(p);
    if (e.location.unknown) e.force.faults.add(Fault::response_unknown);
    list.push_back(std::move(e));
  }
  return list;
}

/// Picture → profile → unloaded reference → location → torque → force: the recording plays as it came, one step at
/// each frame. Throws InputError without joint samples, InvalidArgument for parts that do not fit.
template <class MakeCamera, ContactJacobian J, class MakeLocalizer = BayesLocalizer (*)(const FingerOptics&)>
std::vector<FrameEstimate> estimate(const Recording& recording, MakeCamera make_camera, const FingerModel<J>& finger,
    MakeLocalizer make_localizer = bayes_localizer) {
  const std::vector<JointSample> samples = on_frames_clock(recording);
  if (samples.size() < 2 || finger.joints.torque.empty())
    throw InputError("the log has no joint samples to estimate a force from");
  const StreamRates rates = stream_rates(recording.frames, samples);
  Replay camera(make_camera());
  Replay motors{RecordedActuator(samples)};
  auto localizer = make_localizer(finger.optics);
  using Estimator = ForceEstimator<decltype(camera), decltype(motors), decltype(localizer), GreenProfile, J>;
  Estimator estimator(camera, motors, {finger.optics.readout(), finger.optics.unloaded}, std::move(localizer),
      finger.jacobian, force_config(finger, rates));
  const ContactTorques torques(samples, finger.joints.torque, {}, finger.session.joint_delay_s);
  const std::int64_t delay_ns = std::llround(1e9 * finger.session.frame_delay_s);
  const StreamAssumptions& assumed = finger.assumptions;
  const double gap_s = std::max(assumed.joint_gap_s, assumed.joint_gap_periods * rates.joint_period_s);
  std::vector<FrameEstimate> list;
  for (const FrameRecord& frame : recording.frames) {
    camera.until(frame.stamp_ns);
    motors.until(frame.stamp_ns);
    FrameEstimate e;
    e.stamp_ns = frame.stamp_ns;
    const Stopwatch watch;
    e.force = estimator.step(frame.stamp_ns);
    e.seconds = watch.seconds();
    e.location = estimator.location();
    e.joints = torques.at(frame.stamp_ns - delay_ns, gap_s);
    list.push_back(std::move(e));
  }
  return list;
}

}  // namespace lumo::sense
