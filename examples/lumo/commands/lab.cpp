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
    add_text(app, "--cache", light.cache, "DIR", "Folder that keeps computed responses, default: beside DIR");
    add_flag(
        app, "--coarse", light.coarse, "Coarse mesh, few places, few rays: seconds instead of minutes, for trying out");
    add_text(app, "--out", folder, "DIR", "Folder of the log; must not be there, or be empty")->required();
    add_threads(app, light.threads);
    add_common(app, *this);
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
    const PadLight computed(responses(wanted, folder, progress));
    const Pad& pad = asked().pad;
    const SideGeometry side = side_geometry(finger(pad.design(), pad.silicone, pad.finger));
    const auto whole_seed = std::uint64_t(settings.seed);
    Rig instruments;
    instruments.specimen = {settings.stiffness, settings.lamps};
    instruments.motor.joints = settings.joints;
    if (!plan) {
      const std::vector<double> places = light.coarse ? computed.places_m() : std::vector<double>{};
      const HandLab hand(
          computed, hand_plan(whole_seed, 12, places), whole_seed, settings.noise, {.rig = instruments, .side = side});
      leave(hand, {}, pad.finger, made, progress);
      return summary(hand, "grasps", hand.plan().grasps.size());
    }
    const double shift = computed.responses().equal_ends() ? 0.0 : built_finger_shift_m;
    const VirtualRig rig(
        computed, up_to(moved(plan(), shift), computed.max_load_N()), whole_seed, settings.noise, instruments, side);
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
