#include "program/lab.hpp"

#include "lumo/core/write_whole.hpp"
#include "lumo/lab/hand_lab.hpp"
#include "lumo/lab/pad_file.hpp"
#include "lumo/lab/virtual_rig.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/sense/force/calibration.hpp"
#include "lumo/sense/recording/normal_force.hpp"
#include "program/commands.hpp"
#include "program/interrupt.hpp"
#include "program/json.hpp"
#include "program/new_folder.hpp"
#include "program/sensing_log.hpp"
#include "program/text.hpp"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <system_error>

namespace lumo::program {

namespace fs = std::filesystem;

namespace {

/// The file that a key's responses are kept in; its name tells pads and settings apart.
std::string cache_file(const Options& o, const std::string& key) {
  std::error_code error;
  const fs::path log = fs::absolute(o.log, error).lexically_normal();
  const fs::path folder = o.cache ? fs::path(*o.cache) : (log.has_filename() ? log : log.parent_path()).parent_path();
  fs::create_directories(folder, error);
  char name[48];
  std::snprintf(name, sizeof name, "lumo-pad-%016llx.txt", static_cast<unsigned long long>(lumo::checksum(key)));
  return (folder / name).string();
}

PadResponses responses(const Options& o, Progress& progress) {
  const std::string key = pad_responses_key(o), file = cache_file(o, key);
  try {
    if (auto kept = read_pad_responses(file, key)) return std::move(*kept);
  } catch (const InputError& e) {
    progress.note(std::string(e.what()) + "; computed anew");
  }
  PadResponses r = make_pad_responses(o, progress);
  {
    const FilesBeingWritten whole;
    write_pad_responses(file, r, key);
  }
  progress.finish();
  progress.note("kept in " + file);
  return r;
}

LabPlan plan_of(Command c) {
  switch (c) {
    case Command::lab_recontact: return recontact_plan();
    case Command::lab_cycle: return cycle_plan();
    case Command::lab_imaging: return imaging_plan();
    default: return force_plan();
  }
}

/// Means over the segments of one kind.
MeanImage mean_picture(const OpenLog& log, SegmentKind kind, PhotonTransfer* transfer = nullptr) {
  MeanImage mean;
  LogCamera camera(log);
  const Segment* used = nullptr;
  for (const Segment& s : log.session.segments)
    if (s.kind == kind && !used) used = &s;
  for (auto f = camera.next(); f && used; f = camera.next())
    if (f->stamp_ns >= used->from_ns && f->stamp_ns <= used->to_ns && !f->image.empty()) {
      mean.add(f->image);
      if (transfer) transfer->add(f->image);
    }
  if (mean.count() == 0) throw InputError(log.path + ": has no pictures in a segment of kind \"" + std::string(to_string(kind)) + "\"");
  return mean;
}

/// Depths and forces of the holds of the first contact, and what it was: place and number of holds.
struct PressCurve {
  std::vector<double> depth_m, force_N;
  double y_m = 0.0;
  int holds = 0;
};

PressCurve press_curve(const Recording& log) {
  PressCurve curve;
  const auto& all = log.session.segments;
  const auto first = std::find_if(all.begin(), all.end(), [](const Segment& s) { return s.kind == SegmentKind::hold && s.place >= 0; });
  if (first == all.end() || log.wrenches.empty() || log.markers.empty()) throw InputError(log.path + ": has no press: holds, forces (wrench.csv) and displacements (marker.csv) are needed");
  curve.y_m = 1e-3 * first->y_mm;
  const TimeSeries series = normal_force(log.wrenches, log.session.wrench_clock);
  for (auto s = first; s != all.end() && s->kind == SegmentKind::hold && s->place == first->place && s->repetition == first->repetition; ++s, ++curve.holds)
    for (const MarkerSample& m : log.markers)
      if (const std::int64_t t = log.session.wrench_clock(m.stamp_ns); 2 * t >= s->from_ns + s->to_ns && t <= s->to_ns)
        if (const auto f = series.at(t, 0.1)) curve.depth_m.push_back(m.displacement_m), curve.force_N.push_back((*f)[0]);
  return curve;
}

bool in_contact(const TruthSample& s) { return s.contact >= 0; }
bool in_contact(const HandTruth& s) { return !s.touches.empty(); }

Json interval(const Interval& i) { return {{"value", number(i.value)}, {"low", number(i.low)}, {"high", number(i.high)}}; }

}  // namespace

std::string calibrate(const Options& typed, Progress& progress) {
  Options o = typed;
  const OpenLog log = open_log(o.log, progress);
  if (log.session.theta_mm.size() != 5 || (log.session.material != "DS" && log.session.material != "Sol"))
    throw InputError(log.session_place() + ": theta_mm and material (DS or Sol) must tell the nominal pad");
  std::copy(log.session.theta_mm.begin(), log.session.theta_mm.end(), o.theta_mm.begin());
  o.material = log.session.material;
  try {
    check_design(o);
    PhotonTransfer transfer;
    const Image lit = mean_picture(log, SegmentKind::unloaded, &transfer).image(), dark = mean_picture(log, SegmentKind::dark).image();
    const PressCurve press = press_curve(log);
    const PadLight nominal(responses(o, progress));
    const StiffnessFit stiffness = fit_stiffness(press.depth_m, press.force_N, [&](double d) { return nominal.load_N(press.y_m, d); }, press.holds);
    const auto gain = transfer.result().gain_DN_per_electron;
    const LampLevel lamps = lamp_level(lit.view(), dark.view(), gain);
    const double mu = silicone(o.material).mu_Pa;
    const Interval mu_Pa{mu * stiffness.factor.value, mu * stiffness.factor.low, mu * stiffness.factor.high};
    progress.finish();
    if (o.json)
      return Json{{"mu_Pa", interval(mu_Pa)}, {"onset_mm", number(1e3 * stiffness.onset_m)}, {"residual_N", number(stiffness.residual_N)}, {"gain_DN_per_electron", interval(gain)},
                  {"lamps_DN", number(lamps.level_DN)}, {"lamps_electrons", interval(lamps.electrons)}}.dump(2) + "\n";
    const auto range = [](const Interval& i, double scale, int digits) { return cell(scale * i.value, digits) + " (95 % from " + cell(scale * i.low, digits) + " to " + cell(scale * i.high, digits) + ")"; };
    return "shear modulus  " + range(mu_Pa, 1e-3, 1) + " kPa, nominal " + cell(1e-3 * mu, 1) + "\ncamera gain    " + range(gain, 1e3, 2) + " mDN per electron\nlamps          " + cell(lamps.level_DN, 1) + " DN, " +
           range(lamps.electrons, 1.0, 0) + " electrons a pixel\n";
  } catch (const InvalidArgument& e) {
    throw InputError(o.log + ": " + e.what());
  } catch (const InfeasibleDesign& e) {
    throw InputError(log.session_place() + ": " + e.what());
  }
}

namespace {

/// The log that a virtual rig or hand leaves, and its truth beside it.
template <class Lab>
void leave(const Lab& rig, Recording log, NewFolder& folder, Progress& progress) {
  progress.stage("pictures", int(rig.frames().size()));
  for (std::size_t k = 0; k < rig.frames().size(); ++k) {
    write_image((folder.path() / "frames" / rig.frames()[k].file).string(), rig.image(k).view());
    progress.step();
  }
  log.path = folder.path().string();
  log.session = rig.session(), log.frames = rig.frames(), log.joints = rig.joints();
  write_log_folder(log);
  write_whole((folder.path() / "truth.csv").string(), truth_text(rig.truth()));
  folder.keep();
  progress.finish();
}

}  // namespace

std::string lab(const Options& o, Progress& progress) {
  NewFolder folder(o.log);
  const PadLight light(responses(o, progress));
  const SideGeometry side = side_geometry(finger(FingerDesign::from(o.theta_mm), silicone(o.material)));
  const auto seed = std::uint64_t(o.seed);
  Rig instruments;
  instruments.specimen = {o.stiffness, o.lamps};
  instruments.motor.joints = o.joints;
  const auto told = [&](const auto& rig, const char* what, std::size_t count) {
    const auto touched = std::count_if(rig.truth().begin(), rig.truth().end(), [](const auto& t) { return in_contact(t); });
    if (o.json)
      return Json{{"out", o.log}, {"frames", rig.frames().size()}, {"contact_frames", touched}, {what, count}, {"joint_samples", rig.joints().size()}, {"seed", o.seed}, {"noise", o.noise}}.dump(2) + "\n";
    return lumo::message(o.log, ": ", rig.plan().title, "; ", count, " ", what, ", ", rig.frames().size(), " pictures, ", touched, " of them in contact, ", rig.joints().size(),
                              " joint samples, seed ", o.seed, ", noise ", o.noise, "\n");
  };
  if (o.command == Command::lab_hand) {
    const HandLab hand(light, hand_plan(seed, 12, o.coarse ? 13.0_mm : 0.0), seed, o.noise, instruments, {}, side);
    leave(hand, {}, folder, progress);
    return told(hand, "grasps", hand.plan().grasps.size());
  }
  const VirtualRig rig(light, plan_of(o.command), seed, o.noise, instruments, side);
  Recording log;
  log.wrenches = rig.wrenches(), log.markers = rig.markers();
  leave(rig, std::move(log), folder, progress);
  return told(rig, "contacts", rig.plan().contacts.size());
}

}  // namespace lumo::program
