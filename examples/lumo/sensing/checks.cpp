#include "sensing/checks.hpp"

#include "console/text.hpp"

#include "lumo/sense/recording/wrench_drift.hpp"

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

namespace lumo::program {

using namespace sense;

namespace {

constexpr double least_light_DN = 6.0;

std::string stretch_text(const SensedLog& s) {
  const std::int64_t first = s.log.frames.empty() ? 0 : s.log.frames.front().stamp_ns;
  return cell(1e-9 * double(std::max<std::int64_t>(0, s.stretch.from_ns - first)), 2) + " to " +
         cell(1e-9 * double(s.stretch.to_ns - first), 2) + " s";
}

}  // namespace

void tell_reference(const SensedLog& s, const CheckedReference& checked, Progress& progress) {
  const std::string& path = s.log.path;
  const std::string of =
      " of the " + std::to_string(checked.pictures) + " pictures of the unloaded finger (" + stretch_text(s) + ")";
  if (checked.left_out > 0)
    progress.note(path + ": " + std::to_string(checked.left_out) + of +
                  " do not agree with the rest and are left out (exposure that settles, or a touch)");
  if (checked.repeated > 0)
    progress.note(path + ": " + std::to_string(checked.repeated) + of + " repeat the one before and are counted once");
  if (checked.repeats)
    progress.note(path + ": pictures repeat each other's pixels" +
                  (s.view.unchanged > 0.0 ? " (up to " + cell(100.0 * s.view.unchanged, 0) + " %)" : std::string()) +
                  ", as a video codec makes them; their noise is taken as at least " + cell(checked.least_noise, 1) +
                  " DN, small contacts may be missed");
  if (checked.bands > 0.0)
    progress.note(path + ": light moves along the unloaded finger in bands (" + stretch_text(s) + "), " +
                  cell(100.0 * checked.bands, 1) +
                  " % of it, as a rolling shutter sees lamps that flicker; noise is taken as at least " +
                  cell(checked.least_noise, 1) +
                  " DN, small contacts are missed; expose for whole periods of the lamps, or turn the camera's rows "
                  "across the finger");
  if (checked.scatters)
    progress.note(path + ": the pictures of the unloaded finger (" + stretch_text(s) + ") scatter by " +
                  cell(100.0 * checked.scatter, 1) + " % of the light, " + cell(100.0 * checked.together, 1) +
                  " % all together (lamps or room that flicker, exposure), too much for a finger at rest; small "
                  "contacts are missed; --unloaded chooses another stretch");
  if (s.flicker.half_range > 0.0)
    progress.note(path + ": all light rises and falls by " + cell(100.0 * s.flicker.half_range, 1) + " % (about " +
                  cell(s.flicker.rate_Hz, 1) +
                  " times a second in these pictures; lamps on mains or on pulses); that is divided out, and a change "
                  "that a contact makes to all light with it");
  if (checked.saturated > 0.01)
    progress.note(path + ": " + cell(100.0 * checked.saturated, 1) +
                  " % of the finger's pixels are full (255) in the pictures of the unloaded finger: contacts there "
                  "cannot be seen; expose shorter");
  if (const double light = checked.reference.mean().mean(); light < least_light_DN)
    progress.note(path + ": the unloaded finger has " + cell(light, 1) +
                  " DN of light, steps of 8 bits are no longer small; expose longer");
  if (s.view.lit != 1)
    progress.note(path + ": the LEDs are seen in " + (s.view.lit == 2 ? "red" : "blue") +
                  " and not, or hardly, in green: that channel is measured");
  if (const auto full = std::count_if(s.profiles.begin(), s.profiles.end(),
          [](const Profile& p) { return p.saturated > FrameMonitor::Config{}.saturated; });
      100 * full > std::ptrdiff_t(s.profiles.size()))
    progress.note(path + ": in " + std::to_string(full) + " of " + std::to_string(s.profiles.size()) +
                  " pictures more than 5 % of the finger's pixels are full (255): strong contacts are cut");
  if (const auto touched = touched_reference(s.profiles, s.bins.centres_m(), checked.reference))
    progress.note(path + ": the finger may have been touched while it was taken for unloaded (" + stretch_text(s) +
                  "): " + std::to_string(touched->frames) + " of " + std::to_string(touched->of) +
                  " pictures are darker by " + cell(touched->darker_DN, 1) +
                  " DN at y = " + cell(1e3 * touched->y_m, 1) + " mm; --unloaded says when it was unloaded");
}

namespace {

void tell_effort(const OpenLog& log, int joint, Progress& progress) {
  const EffortCheck check = about(log.path, [&] { return check_effort(log.joints, joint); });
  const std::string of = log.path + ": efforts of joint " + std::to_string(joint);
  const char* const unit = log.joints.front().unit == Effort::current_A ? " A" : " N·m";
  if (check.never_changes)
    throw InputError(lumo::message(log.path, ": the effort of joint ", joint, " never changes: it is ",
        log.joints.front().effort[joint], unit, " in all ", log.joints.size(), " samples"));
  if (check.milli) progress.note(of + " are mostly beyond 100 A: they seem to be mA");
  if (check.wraps) progress.note(of + " lie near 0 and near 65536: negative numbers of 16 bits are read as unsigned");
  if (check.at_limit > 0.0)
    progress.note(of + " stand at " + short_number(check.limit) + unit + " in " + cell(100.0 * check.at_limit, 1) +
                  " % of the samples: a limit of the driver, forces there are lower bounds");
  if (check.stuck_share > 0.0)
    progress.note(of + " are the very same for more than a second in " + cell(100.0 * check.stuck_share, 1) +
                  " % of the log: the driver was stuck");
}

}  // namespace

void tell_joints(const OpenLog& log, Progress& progress) {
  std::vector<JointSample> samples = log.joints;
  const auto joints = samples.empty() ? 0 : int(samples.front().effort.size());
  for (int j = 0; j < joints; ++j) tell_effort(log, j, progress);
  about(log.path, [&] {
    for (const std::string& note : mend_velocities(samples)) progress.note(log.path + ": " + note);
  });
}

void tell_torques(const SensedLog& s, std::span<const FrameEstimate> estimates, const FingerModel<>& finger,
    double noise_Nm, Progress& progress) {
  const OpenLog& log = s.log;
  if (touched_reference(s.profiles, s.bins.centres_m(), finger.optics.unloaded)) return;  // contacts are not known
  const PadRange range{finger.link, finger.optics.from_m, finger.optics.to_m};
  const TorqueAgreement t = torque_agreement(estimates, finger.jacobian, range, noise_Nm);
  const std::string seen = " in the " + std::to_string(t.contacts) + " frames in which the pictures see a contact";
  for (const int j : t.reversed)
    progress.note(log.path + ": the torque of joint " + std::to_string(j) + " falls" + seen +
                  ", which no push can do: its sign is reversed; a torque constant of " +
                  short_number(-finger.joints.torque[std::size_t(j)].torque_constant_Nm_per_A) +
                  " N·m/A in session.json turns it");
  if (!t.better_order.empty())
    progress.note(log.path + ": the joints seem to be listed in another order than along the finger: in the order " +
                  listing(t.better_order, [](int j) { return std::to_string(j); }) + " their torques fit" + seen);
  const SensorAgreement sensor =
      finger.jacobian.joints() == 1
          ? sensor_agreement(estimates, MomentArm{log.session.joint_to_origin_m}, log.session, log.wrenches)
          : SensorAgreement{};
  if (sensor.scale != 1.0)
    progress.note(log.path + ": torques are " + short_number(sensor.scale) +
                  " times what the force sensor and the places seen ask for" + seen +
                  ": torque_constant_Nm_per_A (the gear?) or the joint's distance in session.json, or the unit of "
                  "the efforts or forces is another");
  if (t.mirrored || sensor.mirrored)
    progress.note(log.path + ": places by torque run against places by light" + seen +
                  ": leds.distal in session.json may name the other end");
  if (force_falls_in_contacts(estimates, log.session, log.wrenches) && !check_loads(log.session, log.wrenches).reversed)
    progress.note(log.path + ": the normal force of wrench.csv falls" + seen +
                  ": the sensor reports the force of the finger on the object; --wrench-axes=-x,-y,-z turns its sign");
  if (const auto torque = torque_without_contact(estimates, finger.jacobian, noise_Nm, s.stretch.to_ns))
    progress.note(log.path + ": where the pictures see no contact the torque of the pad's joint is " +
                  cell(*torque, 2) +
                  " N·m (median): its friction, weight and offset seem to be learnt in a contact, or something touches "
                  "the finger out of sight; --unloaded says when nothing did");
}

void tell_wrenches(OpenLog& log, Progress& progress) {
  if (const auto most = remove_wrench_drift(log.wrenches, log.session))
    progress.note(log.path + ": the force sensor drifts: without load its normal force is up to " + cell(*most, 2) +
                  " N from its middle one; it is tared before each contact");
}

void tell_learnt(const SensedLog& s, const UnloadedStretch& learnt, const JointReference& joints, Progress& progress) {
  if (is_stated(s.log.session, s.stretch) || s.joints.empty()) return;
  const std::int64_t first = s.joints.front().stamp_ns;
  progress.note(
      s.log.path +
      ": no segment says when the joints were free; friction, weight and offset are learnt from "
      "the first " +
      cell(1e-9 * double(learnt.to_ns - first), 1) + " s, " +
      (learnt.to_ns > s.stretch.to_ns ? "up to the first contact that pictures show" : "which are taken for unloaded") +
      (joints.left_out > 0.0
              ? ", less " + cell(100.0 * joints.left_out, 0) + " % whose torque is far off the rest's, as in contact"
              : std::string()));
}

std::optional<Latency> tell_latency(
    const SensedLog& s, const FingerModel<>& finger, double moved_s, Progress& progress) {
  const Session& session = finger.session;
  const ContactTorques torques(s.joints, finger.joints.torque, {}, session.joint_delay_s);
  const auto latency = joint_latency(s.profiles, finger.optics.unloaded, torques, session.frame_delay_s);
  if (latency && latency->is_significant) {
    const double all_ms = 1e3 * (latency->seconds + session.joint_delay_s - session.frame_delay_s + moved_s);
    progress.note(s.log.path + ": joint samples are stamped " + cell(1e3 * std::abs(latency->seconds), 0) + " ± " +
                  cell(1e3 * latency->sigma_s, 0) + " ms " + (latency->seconds > 0.0 ? "later" : "earlier") +
                  " than pictures of the same moment, as " + std::to_string(latency->events) +
                  " contacts show; --latency " + cell(all_ms, 0) + " takes that into account");
  }
  return latency;
}

LoadCheck tell_loads(const OpenLog& log, Progress& progress) {
  const LoadCheck check = check_loads(log.session, log.wrenches);
  if (check.reversed)
    progress.note(log.path +
                  ": the normal force of wrench.csv is negative in the holds: the sensor reports the force of "
                  "the finger on the object; --wrench-axes=-x,-y,-z turns its sign");
  else if (check.holds > 0 && !check.follows)
    progress.note(log.path + ": the force sensor does not follow the loads of the holds; the nominal ones are taken");
  else if (check.differs)
    progress.note(log.path + ": the force sensor says that " + cell(100.0 * check.share, 0) +
                  " % of each load was reached (" + std::to_string(check.holds) +
                  " holds, median); slopes are per newton that it measured");
  return check;
}

std::vector<HoldResponse> measured_holds(const SensedLog& s, Progress& progress) {
  auto holds = about(s.log.path, [&] { return hold_responses(s.profiles, s.log.session.segments); });
  if (tell_loads(s.log, progress).follows) take_measured_loads(holds, s.log.session, s.log.wrenches);
  return holds;
}

}  // namespace lumo::program
