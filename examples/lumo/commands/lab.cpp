#include "commands/commands.hpp"
#include "console/new_folder.hpp"
#include "report/json.hpp"
#include "sensing/log.hpp"
#include "sensing/responses.hpp"

#include "lumo/core/files.hpp"
#include "lumo/lab/hand_lab.hpp"
#include "lumo/lab/virtual_rig.hpp"
#include "lumo/morphology/finger.hpp"

#include <algorithm>
#include <functional>
#include <utility>

namespace lumo::program {

using namespace sense;

namespace {

bool in_contact(const TruthSample& s) { return s.contact >= 0; }
bool in_contact(const HandTruth& s) { return !s.touches.empty(); }

/// The log that a virtual rig or hand leaves, and its truth beside it.
template <class Lab>
void leave(const Lab& rig, Recording log, const FingerOptions& finger, NewFolder& folder, Progress& progress) {
  progress.stage("pictures", int(rig.frames().size()));
  for (std::size_t k = 0; k < rig.frames().size(); ++k) {
    write_bytes(
        (folder.path() / "frames" / rig.frames()[k].file).string(), pictures().encode(".png", rig.image(k).view()));
    progress.step();
  }
  log.path = folder.path().string();
  log.session = rig.session();
  log.session.finger = name(finger);
  log.frames = rig.frames();
  log.joints = rig.joints();
  write_log_folder(log);
  write_whole((folder.path() / "truth.csv").string(), truth_text(rig.truth()));
  folder.keep();
  progress.finish();
}

/// One exposure for all pads of a kind of finger [DN per emitted power through a bin of 1 mm]: the baseline in Solaris
/// then has 70 DN at rest, or at most 220 DN under 15 N if that is less (31 DN at rest on the built finger).
double one_exposure_DN(const FingerOptions& finger) {
  constexpr double plain_DN = 1.4e5, built_DN = 4.9e5;
  return finger.pad.cap_length == 0.0 ? plain_DN : built_DN;
}

/// The rig with what was asked for, by what is assumed of assemblies.
Rig rig_of(const LabSettings& s, const FingerOptions& finger) {
  constexpr double rad_per_deg = pi / 180.0;
  Rig rig;
  rig.specimen = {s.stiffness, s.lamps};
  rig.motor.joints = s.joints;
  if (s.exposure == "one") rig.camera.exposure_DN = one_exposure_DN(finger);
  rig.assembly.pad_sigma_m = s.assembly * 1.0_mm;
  rig.assembly.strip_sigma_m = s.assembly * 0.5_mm;
  rig.assembly.distance_sigma = s.assembly * 0.02;
  rig.assembly.distortion_sigma = s.assembly * 0.1;
  for (double& part : rig.silicone.part) part *= s.creep;
  rig.light.ambient_DN *= s.room;
  rig.light.shadow = s.shadow;
  rig.light.one_lamp_sigma = 0.01 * s.one_lamp_percent;
  rig.contact.slide_m = 1e-3 * s.slide_mm;
  rig.motor.cogging_Nm = 1e-3 * s.cogging_mNm;
  rig.motor.backlash_rad = rad_per_deg * s.backlash_deg;
  rig.motor.clock_offset_s = 1e-3 * s.clock_offset_ms;
  return rig;
}

/// The log of a virtual rig in a new folder.
struct Lab : Configured {
  std::function<LabPlan()> plan;  ///< none: of a hand
  bool to_last_load = false;      ///< with joint torque
  ResponsesRequest light;
  std::string folder;

  explicit Lab(std::function<LabPlan()> p, bool with_torque = false) : plan(std::move(p)), to_last_load(with_torque) {
    light.threads = all_threads();
    Configuration defaults;
    defaults.pad.silicone = solaris();
    effective = Effective(defaults);
  }

  void declare(CLI::App& app) {
    declare_configuration(app);
    add_theta(app, effective);
    add_material(app, effective, "Silicone: Sol (Solaris, default) or DS (Dragon Skin)");
    add_setting(app, effective, "--seed", "lab.seed", "Of everything random, default 1");
    add_setting(app, effective, "--noise", "lab.noise", "Times the rig's noises, default 1");
    if (to_last_load)
      add_setting(app, effective, "--joints", "lab.joints",
          "Of the finger: 1 (default), or 2, whose torques alone give the place, too");
    add_setting(app, effective, "--stiffness", "lab.stiffness",
        "Of this specimen's silicone, times the nominal one, 0.8 to 2, default 1");
    add_setting(app, effective, "--lamps", "lab.lamps",
        "Power of this specimen's LEDs, times the nominal one, 0.1 to 3, default 1");
    add_disturbances(app);
    add_text(app, "--cache", light.cache, "DIR", "Folder that keeps computed responses, default: beside DIR");
    add_flag(
        app, "--coarse", light.coarse, "Coarse mesh, few places, few rays: seconds instead of minutes, for trying out");
    add_text(app, "--out", folder, "DIR", "Folder of the log; must not be there, or be empty")->required();
    add_threads(app, light.threads);
    add_common(app, *this);
  }
  /// Off unless asked for, but the exposure.
  void add_disturbances(CLI::App& app) {
    const auto add = [&](const char* flag, const char* path, const char* help) {
      add_setting(app, effective, flag, path, help);
    };
    add("--exposure", "lab.exposure",
        "one (default): the camera's for all pads, as in the paper; pad: each pad its own, 70 DN at rest");
    add("--diameter", "lab.diameter_mm", "Of the sphere [mm], default 10");
    add("--angle", "lab.angle_deg", "Of approach from the side, -10 to 10 [°], default 0");
    add("--slide", "lab.slide_mm", "Way of each contact along the finger, from touch to leaving [mm], default 0");
    add("--creep", "lab.creep", "Times the parts of the silicone's stiffness that relax, default 1");
    add("--room", "lab.room", "Times the room's light, default 1");
    add("--shadow", "lab.shadow", "Share of the room's light that the tool takes away before it, default 0");
    add("--assembly", "lab.assembly",
        "Times the errors of an assembly (pad 1 mm, LEDs 0.5 mm, camera's distance 2 %, distortion 0.1), default 0");
    add("--one-lamp", "lab.one_lamp_percent", "Change of each LED by itself [%], standard deviation, default 0");
    add("--cogging", "lab.cogging_mNm", "Amplitude of the motor's cogging [mN·m], default 0");
    add("--backlash", "lab.backlash_deg", "Of the joint's gear [°], default 0");
    add("--clock-offset", "lab.clock_offset_ms",
        "Of the joints' stamps [ms], which the session does not state, default 0");
  }
  void check() const {
    if (to_last_load && asked().lab.stiffness < 1.0)
      throw UsageError(lumo::message("--stiffness is ", asked().lab.stiffness,
          ", lab force goes to 15 N (plain finger: 20 N), which a softer pad than the computed one cannot be given"));
    Configured::check();
    pictures();
  }

  Result run(Output&, Progress& progress) const {
    NewFolder made(folder);
    const LabSettings& settings = asked().lab;
    ResponsesRequest wanted = light;
    wanted.pad = asked().pad;
    wanted.diameter_mm = settings.diameter_mm;
    const PadLight computed(responses(wanted, folder, progress));
    const Pad& pad = asked().pad;
    const SideGeometry side = side_geometry(finger(pad.design(), pad.silicone, pad.finger));
    const auto whole_seed = std::uint64_t(settings.seed);
    const Rig instruments = rig_of(settings, pad.finger);
    if (!plan) {
      const std::vector<double> places = light.coarse ? computed.places_m() : std::vector<double>{};
      const HandLab hand(
          computed, hand_plan(whole_seed, 12, places), whole_seed, settings.noise, {.rig = instruments, .side = side});
      leave(hand, {}, pad.finger, made, progress);
      return summary(hand, "grasps", hand.plan().grasps.size());
    }
    const double shift = computed.responses().equal_ends() ? 0.0 : built_finger_shift_m;
    LabPlan planned = up_to(moved(plan(), shift), computed.max_load_N());
    for (LabContact& c : planned.contacts) c.angle_rad += settings.angle_deg * pi / 180.0;
    const VirtualRig rig(computed, planned, whole_seed, settings.noise, instruments, side);
    Recording log;
    log.wrenches = rig.wrenches();
    log.markers = rig.markers();
    leave(rig, std::move(log), pad.finger, made, progress);
    return summary(rig, "contacts", rig.plan().contacts.size());
  }

  template <class AnyRig> std::string summary(const AnyRig& rig, const char* what, std::size_t count) const {
    const auto touched =
        std::count_if(rig.truth().begin(), rig.truth().end(), [](const auto& t) { return in_contact(t); });
    const LabSettings& settings = asked().lab;
    const std::size_t frames = rig.frames().size(), samples = rig.joints().size();
    if (json)
      return Json{{"out", folder}, {"frames", frames}, {"contact_frames", touched}, {what, count},
                 {"joint_samples", samples}, {"seed", settings.seed}, {"noise", settings.noise},
                 {"configuration", tree_of(asked())}}
                 .dump(2) +
             "\n";
    return lumo::message(folder, ": ", rig.plan().title, "; ", count, " ", what, ", ", frames, " pictures, ", touched,
        " of them in contact, ", samples, " joint samples, seed ", settings.seed, ", noise ", settings.noise, "\n");
  }
};

}  // namespace

void add_lab(CommandLine& line) {
  line.add("lab recontact", "Six places, five re-contacts each, up to 15 N", Lab([] { return recontact_plan(); }));
  line.add("lab cycle", "Cycles within contact at three places", Lab([] { return cycle_plan(); }));
  line.add("lab imaging", "Other camera places, other room light, LEDs off", Lab([] { return imaging_plan(); }));
  line.add("lab force", "Six sequences up to 15 N (plain finger: 20 N), with joint torque",
      Lab([] { return force_plan(); }, true));
  line.add("lab hand", "Grasps of two fingers with two links each, seen from beside", Lab({}));
}

}  // namespace lumo::program
