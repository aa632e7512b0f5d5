#include "commands/estimating.hpp"
#include "console/text.hpp"
#include "sensing/checks.hpp"
#include "sensing/findings.hpp"

#include "lumo/sense/live/live.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace lumo::program {

using namespace sense;

namespace {

struct Force : EstimatingCommand {
  int alpha_from = 0;                ///< number of a sequence
  std::optional<double> latency_ms;  ///< of joint samples behind pictures; empty: as the session says

  void declare(CLI::App& app) {
    add_log(app);
    add_localizer(app);
    add_unloaded(app);
    add_value(app, "--latency", "MS",
        "By how much joint samples are stamped later than pictures of the same moment [ms]; default: as the session's "
        "delays say",
        [this](const std::string& typed) {
          latency_ms = number_in("--latency", typed, {-5000.0, 5000.0}, "ms");
        });
    add_whole(app, "--alpha-from", alpha_from, 0, 100000,
        "Sequence of the log, from 0 (default), that a factor on torque is fitted on and tried on all");
    declare_live(app,
        "Number of a live camera instead of a log's pictures; the first second must show the unloaded finger. LOG "
        "gives the joints, by its part without contact, and describes the finger",
        true);
  }
  void check() const {
    check_localizer();
    check_torques("force");
    if (camera.number && unloaded)
      throw UsageError("--unloaded is of a log; a live camera's first second shows the unloaded finger");
  }
  /// Throws UsageError.
  std::optional<TorqueScale> fitted(const ForceScore& score) const;
  Result on_log(Output& files, Progress& progress) const override;
  void live(LiveLines& lines, Progress& progress) const override;
};

/// What was found at each frame, whatever the truth was.
struct ForceFound {
  std::size_t frames = 0, touched = 0, with_force = 0;
  std::map<std::string, int> states = {}, faults = {};
  std::vector<TouchSpell> spells = {};
  int in_contact = 0;                       ///< frames, by the truth
  std::map<std::string, int> without = {};  ///< of them, those without a force, by why

  int estimated() const {
    const auto count = [&](EstimatorState s) {
      const auto found = states.find(to_string(s));
      return found == states.end() ? 0 : found->second;
    };
    return count(EstimatorState::ok) + count(EstimatorState::degraded);
  }
};

struct ForceResult {
  ForceFound found;
  ForceScore score;
  std::optional<TorqueScale> scale;  ///< none: fewer than two sequences
  std::vector<double> times_ms;      ///< from a frame to its estimate
  double off_rad, off_Nm;            ///< what a joint sample and the line through its neighbours differ by (RMS)
  double clock_s;                    ///< by what the joints' clock is off
  std::optional<Latency> latency;    ///< as the log shows it
};

/// The factors on torque, each with what it was fitted on.
Json alphas(const std::optional<TorqueScale>& scale) {
  const Json given = {{"alpha", 1.0}, {"fitted_on_sequence", nullptr}};
  if (!scale) return {{"of_mae_N", given}, {"one_sequence", nullptr}, {"one_left_out", nullptr}};
  Json sequences = Json::array();
  for (const SequenceScale& s : scale->sequences)
    sequences.push_back({{"sequence", s.sequence}, {"y_mm", number(1e3 * s.y_m)}, {"samples", s.samples},
        {"alpha", number(s.alpha)}, {"mae_in_sample_N", number(s.mae_in_sample_N)},
        {"alpha_of_others", number(s.alpha_of_others)}, {"mae_out_of_sample_N", number(s.mae_out_of_sample_N)}});
  return {{"of_mae_N", given},
      {"one_sequence", {{"alpha", number(scale->fitted_on.alpha)}, {"fitted_on_sequence", scale->fitted_on.sequence},
                           {"mae_in_sample_N", number(scale->mae_in_sample_N)},
                           {"mae_without_it_N", number(scale->mae_without_it_N)}}},
      {"one_left_out", {{"mae_out_of_sample_N", number(scale->mae_out_of_sample_N)}, {"sequences", sequences}}}};
}

std::string alphas_text(const std::optional<TorqueScale>& scale) {
  if (!scale) return "alpha            no second sequence to fit a factor on torque on\n";
  double low = scale->sequences.front().alpha_of_others, high = low;
  for (const SequenceScale& s : scale->sequences) {
    low = std::min(low, s.alpha_of_others);
    high = std::max(high, s.alpha_of_others);
  }
  const SequenceScale& from = scale->fitted_on;
  return lumo::message("optical, torque times a fitted alpha\n  in sample       ", cell(scale->mae_in_sample_N, 2),
      ", alpha ", cell(from.alpha, 3), " fitted on sequence ", from.sequence, " of ", scale->sequences.size(), " (y ",
      cell(1e3 * from.y_m, 1), " mm), which is among them; ", cell(scale->mae_without_it_N, 2),
      " without it\n  out of sample   ", cell(scale->mae_out_of_sample_N, 2),
      ", each sequence by the alpha fitted on the others (", cell(low, 3), " to ", cell(high, 3), ")\n");
}

/// Why a frame has no force.
std::string why_without(const ForceEstimate& e) {
  if (e.state != EstimatorState::ok && e.state != EstimatorState::degraded)
    return to_string(e.state) + (e.faults.any() ? " (" + to_string(e.faults) + ")" : std::string());
  return e.contacts == 0 ? "no contact seen" : "force not known";
}

ForceFound found_in(const std::vector<FrameEstimate>& estimates, const LogTruth& truth) {
  constexpr double from_N = 0.5;  // as force_score has it
  ForceFound found;
  found.frames = estimates.size();
  std::vector<TouchedFrame> touched;
  for (const FrameEstimate& e : estimates) {
    ++found.states[to_string(e.force.state)];
    for (std::size_t f = 0; f < std::size_t(Fault::count); ++f)
      if (e.force.faults.has(Fault(f))) {
        Faults one;
        one.add(Fault(f));
        ++found.faults[to_string(one)];
      }
    const std::optional<double> force = e.force.contact[0].force_N;
    if (e.force.contacts > 0) {
      touched.push_back({e.stamp_ns, e.force.contact[0].y_m, force});
      found.with_force += force.has_value();
    }
    const auto t = truth.at(e.stamp_ns);
    if (!t.y_m || !t.force_N || *t.force_N < from_N) continue;
    ++found.in_contact;
    if (!force) ++found.without[why_without(e.force)];
  }
  found.touched = touched.size();
  found.spells = touch_spells(touched);
  return found;
}

Json found_json(const ForceFound& f) {
  return {{"rows", f.frames}, {"estimated", f.estimated()}, {"touched", f.touched}, {"with_force", f.with_force},
      {"states", f.states}, {"faults", f.faults}, {"in_contact", f.in_contact}, {"without_force", f.without}};
}

std::string found_text(const ForceFound& f) {
  std::string text = lumo::message(f.frames, " frames: touched in ", f.touched, ", with a force in ", f.with_force,
      "\n  states: ", counts_text(f.states), "\n");
  if (!f.faults.empty()) text += "  faults: " + counts_text(f.faults) + "\n";
  return text + spells_text(f.spells, true);
}

/// Errors against the truth, each with the number of frames that it is the mean of.
std::string errors_text(const ForceResult& r) {
  const ForceErrors& e = r.score.errors;
  if (r.found.in_contact == 0)
    return "no errors: the log has no truth.csv, and no holds at known places with forces in wrench.csv\n";
  const auto line = [](const char* way, const ForceErrors::Error& error) {
    return "\n  " + pad(way, -16) + cell(error.samples > 0 ? error.mae_N : undefined, 2) +
           lumo::message(", of ", error.samples, " frames");
  };
  std::string text = lumo::message(r.found.in_contact, " frames in contact",
      r.found.in_contact > r.score.samples ? lumo::message(", joints known in ", r.score.samples) : std::string(),
      "; mean error [N], alpha 1: torque constants of the session, fitted on no sequence", line("fused", e.fused),
      line("optical", e.optical), line("fixed arm", e.fixed_arm), line("known location", e.known_location),
      line("torque only", e.torque_only), "\n");
  if (!r.found.without.empty()) text += "  in contact without a fused force: " + counts_text(r.found.without) + "\n";
  return text + alphas_text(r.scale) + "90 % interval holds the truth in " +
         cell(e.fused.samples > 0 ? 100.0 * r.score.coverage_90 : undefined, 1) +
         lumo::message(" % of ", e.fused.samples, " frames\n");
}

Json latency_json(const std::optional<Latency>& latency) {
  if (!latency) return nullptr;
  return {{"joints_later_ms", number(1e3 * latency->seconds)}, {"sigma_ms", number(1e3 * latency->sigma_s)},
      {"contacts", latency->events}};
}

std::string latency_text(const std::optional<Latency>& latency) {
  if (!latency) return "latency          not known: too few contacts whose light and torque change alike\n";
  return lumo::message("latency          joint samples are stamped ", cell(1e3 * std::abs(latency->seconds), 0), " ± ",
      cell(1e3 * latency->sigma_s, 0), " ms ", latency->seconds < 0.0 ? "earlier" : "later",
      " than pictures of the same moment (", latency->events, " contacts)\n");
}

std::string shown(const ForceResult& r, const SensedLog& s, const std::vector<std::string>& notes, bool as_json) {
  const auto mae = [](const ForceErrors::Error& e) { return e.samples > 0 ? e.mae_N : undefined; };
  const ForceErrors& e = r.score.errors;
  const double middle = r.times_ms.empty() ? undefined : quantile(r.times_ms, 0.5),
               slow = r.times_ms.empty() ? undefined : quantile(r.times_ms, 0.95);
  if (as_json)
    return text_of(
               Json{{"samples", r.score.samples},
                   {"mae_N",
                       {{"fused", number(mae(e.fused))}, {"optical", number(mae(e.optical))},
                           {"fixed_arm", number(mae(e.fixed_arm))}, {"known_location", number(mae(e.known_location))},
                           {"torque_only", number(mae(e.torque_only))}}},
                   {"alpha", alphas(r.scale)},
                   {"coverage_90", r.score.samples > 0 ? number(r.score.coverage_90) : Json(nullptr)},
                   {"frame_ms", {{"median", number(middle)}, {"p95", number(slow)}}},
                   {"alignment", {{"clock_s", number(r.clock_s)}, {"position_rad", number(r.off_rad)},
                                     {"torque_Nm", number(r.off_Nm)}}},
                   {"latency", latency_json(r.latency)},
                   {"samples_of",
                       {{"fused", e.fused.samples}, {"optical", e.optical.samples}, {"fixed_arm", e.fixed_arm.samples},
                           {"known_location", e.known_location.samples}, {"torque_only", e.torque_only.samples}}},
                   {"frames", found_json(r.found)}, {"contacts", spells_json(r.found.spells, true)},
                   {"log", findings_json(s.log, s.pictures, notes)}},
               2) +
           "\n";
  return found_text(r.found) + findings_text(s.log, s.pictures) + errors_text(r) +
         lumo::message("frame to estimate ", cell(middle, 3), " ms (median), ", cell(slow, 3),
             " ms (95 %)\nalignment        a joint sample and the line through its neighbours differ by ",
             cell(1e3 * r.off_rad, 2), " mrad, ", cell(1e3 * r.off_Nm, 1),
             " mN·m (RMS: noise, and what interpolation at the pictures' times misses)",
             r.clock_s > 0.0 ? lumo::message(", their clock by ", cell(1e3 * r.clock_s, 3), " ms") : std::string(),
             "\n", latency_text(r.latency));
}

/// A table and a chart of all estimates.
void add_estimates(const std::vector<FrameEstimate>& estimates, const LogTruth& truth, Output& files) {
  std::string table = "stamp_ns,state,force_N,force_sigma_N,y_mm,y_sigma_mm,true_force_N,true_y_mm,faults\n";
  Timeline chart{"Force", "normal force [N]"};
  for (const FrameEstimate& e : estimates) {
    const auto t = truth.at(e.stamp_ns);
    const ContactForce& c = e.force.contact[0];
    table += std::to_string(e.stamp_ns) + ',' + to_string(e.force.state) + field(c.force_N) +
             field(std::sqrt(c.force_variance_N2)) + field(c.y_m, 1e3) + field(std::sqrt(c.y_variance_m2), 1e3) +
             field(t.force_N) + field(t.y_m, 1e3) + ',' + to_string(e.force.faults) + '\n';
    const double seconds = seconds_between(estimates.front(), e);
    if (t.force_N) chart.truth.push_back({seconds, *t.force_N});
    if (c.force_N) chart.estimate.push_back({seconds, *c.force_N});
  }
  files.add("forces.csv", table);
  if (!chart.estimate.empty()) files.add("forces.svg", draw(chart));
}

std::optional<TorqueScale> Force::fitted(const ForceScore& score) const {
  const auto& forces = score.optical;
  if (!forces.empty() &&
      std::none_of(forces.begin(), forces.end(), [&](const TorqueForce& f) { return f.sequence == alpha_from; }))
    throw UsageError(lumo::message("--alpha-from is ", alpha_from, ", a number that no sequence of ", log, " has"));
  return torque_scale(score.optical, alpha_from);
}

/// Places that are judged, ± from the middle.
constexpr double judged_m = 25.0_mm;

/// Moves the joints' stamps so that they are `latency_s` later than pictures of the same moment, rather than what the
/// session's delays say: a log has all samples, so that none needs to be predicted, as delays are. Returns by how much
/// they go back.
double move_joints(SensedLog& s, double latency_s) {
  Session& session = s.log.session;
  const double back_s = latency_s - (session.joint_delay_s - session.frame_delay_s);
  session.joint_clock.offset_s -= back_s;
  s.joints = on_frames_clock(s.log);
  return back_s;
}

Result Force::on_log(Output& files, Progress& progress) const {
  const std::optional<KnownPad> known = known_pad(progress);
  progress.stage("reading the log");
  SensedLog s = read_sensed_log(log, SensedLog{}.bins, progress, topics, unloaded);
  const double moved_s = latency_ms ? move_joints(s, 1e-3 * *latency_ms) : 0.0;
  if (known) tell_other_pad(*known, s.log.session, log, progress);
  FingerModel<> finger = finger_model(s.log.session);
  finger.optics = optics_of(s, log, progress);
  require_readable(s.log, LogStream::joints);
  require_common_time(s.log);
  tell_joints(s.log, progress);
  tell_loads(s.log, progress);
  const UnloadedStretch learnt = joint_stretch(s.log.session, s.stretch, s.profiles, finger.optics.unloaded);
  finger.joints = about(log, [&] { return unloaded_joints(s.log, learnt); });
  tell_learnt(s, learnt, finger.joints, progress);
  const std::vector<TorqueModel>& torque = finger.joints.torque;
  const auto estimates = about(log, [&] {
    return with_maker(localizer, known, s.log.session, [&](auto make) {
      return estimate(
          s.log, [&] { return LogCamera(s.log); }, finger, make);
    });
  });
  const Eigen::VectorXd residual = ContactTorques(s.joints, torque).residual();  // positions, torques
  const Eigen::Index joints = residual.size() / 2;
  double noise_Nm = 0.0;
  for (const TorqueModel& t : torque) noise_Nm = std::max(noise_Nm, t.noise_Nm);
  tell_torques(s, estimates, finger, noise_Nm, progress);
  const LogTruth truth = truth_of(s.log);
  ForceScore score = about(log, [&] {
    return force_score(estimates, truth, finger.jacobian, {finger.link, -judged_m, judged_m}, noise_Nm);
  });
  ForceResult r{found_in(estimates, truth), std::move(score), {}, {}, residual.head(joints).maxCoeff(),
      residual.tail(joints).maxCoeff(), s.log.session.joint_clock.residual_s,
      about(log, [&] { return tell_latency(s, finger, moved_s, progress); })};
  r.scale = fitted(r.score);
  for (const FrameEstimate& e : estimates) r.times_ms.push_back(1e3 * e.seconds);
  add_estimates(estimates, truth, files);
  tell_findings(s.log, s.pictures, progress);
  std::string text = shown(r, s, progress.notes(), json);
  if (r.found.estimated() > 0) return text;
  return {std::move(text), log + ": no frame has a force: " + counts_text(r.found.states)};
}

void Force::live(LiveLines& lines, Progress& progress) const {
  const OpenLog opened = open_log(log, progress, topics);
  FingerModel<> finger = about(opened.session_place(), [&] { return finger_model(opened.session); });
  finger.joints = about(log, [&] { return unloaded_joints(opened, unloaded_stretch(opened)); });
  require_motors(camera, finger.jacobian.joints());
  const std::optional<KnownPad> known = known_pad(progress);
  const auto source = pictures().live(settings_of(camera));
  MiniCheetahMotors motors = motors_of(camera);
  progress.tell("leave the finger alone for a second");
  std::int64_t newest = 0;
  const auto line = [&](const ForceEstimate& e) {
    const double seconds = lines.seconds(e.stamp_ns);
    const bool good = e.state == EstimatorState::ok || e.state == EstimatorState::degraded,
               fresh = e.frame_stamp_ns > newest;
    newest = std::max(newest, e.frame_stamp_ns);
    const auto picture = fresh ? std::optional(e.frame_stamp_ns) : std::nullopt;
    Json contacts = Json::array();
    std::string text;
    for (int k = 0; k < e.contacts; ++k) {
      const ContactForce& c = e.contact[std::size_t(k)];
      const auto y = c.y_m ? std::optional(1e3 * *c.y_m) : std::nullopt;
      const double force_sigma = std::sqrt(c.force_variance_N2), y_sigma = 1e3 * std::sqrt(c.y_variance_m2);
      contacts.push_back({{"force_N", maybe(c.force_N)}, {"force_sigma_N", number(force_sigma)}, {"y_mm", maybe(y)},
          {"y_sigma_mm", number(y_sigma)}});
      text += (c.force_N ? "  F " + cell(*c.force_N, 2) + " ± " + cell(force_sigma, 2) + " N" : "  F not known") +
              (y ? ", y " + cell(*y, 1) + " ± " + cell(y_sigma, 1) + " mm" : ", y not known");
    }
    if (json)
      return lines(picture, good,
          Json{{"stamp_ns", e.stamp_ns}, {"frame_stamp_ns", e.frame_stamp_ns}, {"state", to_string(e.state)},
              {"contacts", contacts}, {"faults", to_string(e.faults)}}
              .dump());
    return lines(picture, good,
        cell(seconds, 3) + " s  " + to_string(e.state) + (e.faults.any() ? ", " + to_string(e.faults) : std::string()) +
            (text.empty() ? "  no contact" : text));
  };
  with_maker(localizer, known, opened.session,
      [&](auto make) { estimate_live(*source, motors, finger, make, line, {.name = camera.device()}); });
}

}  // namespace

void add_force(CommandLine& line) {
  line.add<Force>("force", "How hard, from joint torque at the place seen, with its baselines");
}

}  // namespace lumo::program
