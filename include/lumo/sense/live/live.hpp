#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/stopwatch.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/force/finger_model.hpp"
#include "lumo/sense/hand/hand_log.hpp"
#include "lumo/sense/profile/frame_monitor.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace lumo::sense {

/// How live streams are waited for.
struct LiveWait {
  std::string name = "camera";           ///< of the camera, before messages
  double rest_s = 1.0;                   ///< how long the finger rests unloaded at the start
  double patience_s = 2.0;               ///< without any picture
  double max_gap_s = 0.1;                ///< of joint samples about a picture of a hand
  std::int64_t (*now_ns)() = steady_ns;  ///< now, on the clock of the stamps
};

/// Throws InvalidArgument.
inline void validate(const LiveWait& w) {
  require_in_range("time that the finger rests", w.rest_s, 0.05, 60.0, "s");
  require_positive("patience with the camera", w.patience_s, "s");
}

namespace detail {

constexpr double pause_s = 200e-6;          ///< between looks at a silent camera: far below a picture's period
constexpr std::size_t most_at_rest = 300;   ///< pictures whose copies are kept while a finger rests
constexpr double shortest_period_s = 1e-4;  ///< of pictures: stamps closer than that are a driver's fault
constexpr double report_patience = 0.1;     ///< of LiveWait::patience_s, then a state without a picture is reported
constexpr std::size_t most_recent = 4096;   ///< joint samples kept about a picture: 4 s at 1 kHz

/// Empties a stream: what queued up before is not of this time.
template <class Stream> void discard_backlog(Stream& stream) {
  while (stream.next()) {
  }
}

}  // namespace detail

/// The next picture; nullopt when the camera has ended. `meanwhile()` is called while none is there. Throws InputError
/// where none comes in time.
template <Camera C, class Meanwhile>
std::optional<Frame> next_picture(C& camera, const LiveWait& w, Meanwhile meanwhile) {
  const std::int64_t from = w.now_ns();
  auto frame = camera.next();
  while (!frame && camera.state() == StreamState::open) {
    if (1e-9 * double(w.now_ns() - from) > w.patience_s)
      throw InputError(message(w.name, ": has given no picture for ", w.patience_s, " s"));
    meanwhile();
    pause_for(detail::pause_s);
    frame = camera.next();
  }
  return frame;
}

/// What the first pictures of a live camera show of a finger that nothing touches.
struct LiveRest {
  FingerOptics optics;
  FrameMonitor::Config trusted;  ///< pictures like those
  std::optional<Frame> next;     ///< the first one after the rest; its pixels are the camera's
};

/// Looks at the finger for `wait.rest_s`; `meanwhile()` is called while no picture is there. View and light of `finger`
/// are replaced by what is seen. Throws InputError where no finger is seen or no picture comes for `wait.patience_s`.
template <Camera C, class Meanwhile> LiveRest look_at_rest(
    C& camera, const Session& session, const FingerOptics& finger, const LiveWait& wait, Meanwhile meanwhile) {
  validate(wait);
  MeanImage mean;
  std::vector<Image> kept;  // a camera's own pixels are gone with its next picture
  std::vector<Frame> rest;
  auto frame = next_picture(camera, wait, meanwhile);
  const std::int64_t first = frame ? frame->stamp_ns : 0, from = wait.now_ns();
  for (; frame && 1e-9 * double(frame->stamp_ns - first) <= wait.rest_s &&
         1e-9 * double(wait.now_ns() - from) <= wait.rest_s + wait.patience_s;
       frame = next_picture(camera, wait, meanwhile)) {
    const ImageView& v = frame->image;
    if (v.empty() || rest.size() >= detail::most_at_rest) continue;
    mean.add(v);
    kept.push_back(Image::copy(v));
    rest.push_back(*frame);
  }
  if (rest.empty()) throw InputError(message(wait.name, ": gives no pictures"));
  LiveRest seen{finger, {}, frame};
  seen.optics.view = view_finger(mean.image().view(), session, wait.name);
  GreenProfile readout = seen.optics.readout();
  RepeatedPixels repeated;
  std::vector<Profile> profiles(rest.size());
  std::vector<const Profile*> read;
  for (std::size_t k = 0; k < rest.size(); ++k) {
    rest[k].image = kept[k].view();
    repeated.add(rest[k].image);
    if (readout.read(rest[k], profiles[k])) read.push_back(&profiles[k]);
  }
  seen.optics.view.unchanged = repeated.share();
  seen.optics.unloaded = checked_reference(read, seen.optics.view.repeats(seen.optics.bins)).reference;
  const UnloadedReference& unloaded = seen.optics.unloaded;
  if (unloaded.count() < 2)
    throw InputError(
        message(wait.name, ": ", unloaded.count(), " pictures of the unloaded finger can be read, must be at least 2"));
  seen.trusted.position_m = readout.positions_m();
  seen.trusted.unloaded = unloaded.mean();
  if (rest.size() > 1)
    seen.trusted.period_s = std::max(detail::shortest_period_s,
        1e-9 * double(rest.back().stamp_ns - rest.front().stamp_ns) / double(rest.size() - 1));
  seen.trusted.exposure_s = rest.front().exposure_s;
  seen.trusted.gain = rest.front().gain;
  seen.trusted.led_m.clear();
  for (int k = 0; k < session.led_count; ++k)
    seen.trusted.led_m.push_back(session.led_first_y_m + k * session.led_pitch_m);
  return seen;
}

/// Where a finger is touched, as its camera's pictures come. The pictures of the first `wait.rest_s` seconds must show
/// it unloaded. `make(optics)` gives the localiser. `report(stamp_ns, estimate, faults)` is called for each later
/// picture, without an estimate where FrameMonitor does not trust it, and returns whether to go on. Ends with the
/// camera. Throws as look_at_rest, and where no picture comes for `wait.patience_s`.
template <Camera C, ContactJacobian J, class MakeLocalizer, class Report> void locate_live(
    C& camera, const FingerModel<J>& finger, MakeLocalizer make, Report report, const LiveWait& wait = {}) {
  LiveRest rest = look_at_rest(camera, finger.session, finger.optics, wait, [] {});
  GreenProfile readout = rest.optics.readout();
  FrameMonitor monitor(rest.trusted);
  auto localizer = make(rest.optics);
  Profile p;
  for (auto frame = rest.next; frame; frame = next_picture(camera, wait, [] {})) {
    std::optional<LocationEstimate> estimate;
    auto verdict = monitor.check_time(frame->stamp_ns, frame->stamp_ns);
    if (verdict.usable) {
      const Faults time = verdict.faults;
      if (!readout.read(*frame, p)) verdict = FrameMonitor::reject(Fault::frame_corrupt);
      else verdict = monitor.check_light(p, frame->exposure_s, frame->gain);
      verdict.faults |= time;
    }
    if (verdict.usable) {
      rest.optics.unloaded.subtract(p);
      estimate = localizer.update(p);
    }
    if (!report(frame->stamp_ns, estimate, verdict.faults)) break;
  }
}

/// Where a finger is touched and how hard, as its camera's pictures and its motors' samples come. Both are stamped on
/// the clock of `wait.now_ns`. The first `wait.rest_s` seconds must be without contact, as for locate_live;
/// `finger.joints` is from an earlier run without contact (identify_joints). `report(estimate)` is called for each
/// usable picture, and every tenth of `wait.patience_s` where none comes, and returns whether to go on: lost pictures
/// and samples are states of the estimate, not the end. Ends when camera and motors have. Throws as look_at_rest, and
/// InputError where the motors are silent during the rest.
template <Camera C, Actuator A, ContactJacobian J, class MakeLocalizer, class Report> void estimate_live(
    C& camera, A& actuator, FingerModel<J> finger, MakeLocalizer make, Report report, const LiveWait& wait = {}) {
  std::int64_t samples = 0, first = 0, last = 0;
  StreamRates rates;
  const auto drain = [&] {
    for (auto s = actuator.next(); s; s = actuator.next()) {
      if (s->effort.size() != Eigen::Index(finger.joints.torque.size()))
        throw InputError(message("the motors give ", s->effort.size(), " joints, the run without contact has ",
            finger.joints.torque.size()));
      if (samples++ == 0) first = s->stamp_ns;
      last = s->stamp_ns;
      rates.unit = s->unit;
    }
  };
  detail::discard_backlog(actuator);
  LiveRest rest = look_at_rest(camera, finger.session, finger.optics, wait, drain);
  drain();
  if (samples < 2 || last <= first)
    throw InputError(
        message("the motors: ", samples, " samples came while the finger rested; does something command them?"));
  finger.optics = std::move(rest.optics);
  rates.joint_period_s = 1e-9 * double(last - first) / double(samples - 1);
  rates.frame_period_s = rest.trusted.period_s;
  auto localizer = make(finger.optics);
  ForceEstimatorConfig config = force_config(finger, rates);
  config.frames = std::move(rest.trusted);
  using Estimator = ForceEstimator<C, A, decltype(localizer), GreenProfile, J>;
  Estimator estimator(camera, actuator, {finger.optics.readout(), finger.optics.unloaded}, std::move(localizer),
      finger.jacobian, std::move(config));
  std::int64_t picture = estimator.step(wait.now_ns()).frame_stamp_ns, reported = wait.now_ns();
  while (camera.state() == StreamState::open || actuator.state() == StreamState::open) {
    const ForceEstimate e = estimator.step(wait.now_ns());
    const bool is_new = e.frame_stamp_ns != picture,
               overdue = 1e-9 * double(wait.now_ns() - reported) > detail::report_patience * wait.patience_s;
    if (!is_new && !overdue) {
      pause_for(detail::pause_s);
      continue;
    }
    picture = e.frame_stamp_ns;
    reported = wait.now_ns();
    if (!report(e)) return;
  }
}

/// Contacts on a hand as pictures and joint samples come, both stamped on one clock; `hand` has its references
/// (add_references). `report(estimate, image)` is called for each picture and returns whether to go on; no link is seen
/// in pictures for which the joints are not known. Ends with the camera. Throws InputError where no picture comes for
/// `wait.patience_s`.
template <Camera C, Actuator A, class Report> void observe_hand_live(
    C& camera, A& actuator, HandObserver& hand, const Session& session, Report report, const LiveWait& wait = {}) {
  validate(wait);
  Session one_clock = session;
  one_clock.joint_clock = {};
  std::vector<JointSample> recent;
  const auto drain = [&] {
    for (auto s = actuator.next(); s; s = actuator.next())
      if (recent.empty() ||
          (s->stamp_ns > recent.back().stamp_ns && s->position_rad.size() == recent.back().position_rad.size()))
        recent.push_back(std::move(*s));
    if (recent.size() > detail::most_recent) recent.erase(recent.begin(), recent.end() - detail::most_recent / 2);
  };
  detail::discard_backlog(actuator);
  for (auto frame = next_picture(camera, wait, drain); frame; frame = next_picture(camera, wait, drain)) {
    drain();
    const TimeSeries positions = joint_positions(std::span<const JointSample>(recent), one_clock);
    const std::int64_t at = frame->stamp_ns - std::llround(1e9 * session.frame_delay_s);
    auto joints = positions.at(at, wait.max_gap_s);
    if (!joints && !recent.empty())  // the newest sample may be a little older than the picture
      if (const double age_s = 1e-9 * double(at - recent.back().stamp_ns) + session.joint_delay_s;
          age_s >= 0.0 && age_s <= wait.max_gap_s)
        joints = recent.back().position_rad;
    if (!report(
            joints ? hand.observe(frame->stamp_ns, *joints, frame->image) : hand.unseen(frame->stamp_ns), frame->image))
      return;
  }
}

}  // namespace lumo::sense
