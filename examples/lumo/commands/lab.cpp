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
template <class Lab> void leave(const Lab& rig, Recording log, NewFolder& folder, Progress& progress) {
  progress.stage("pictures", int(rig.frames().size()));
  for (std::size_t k = 0; k < rig.frames().size(); ++k) {
    write_bytes(
        (folder.path() / "frames" / rig.frames()[k].file).string(), pictures().encode(".png", rig.image(k).view()));
    progress.step();
  }
  log.path = folder.path().string();
  log.session = rig.session();
  log.frames = rig.frames();
  log.joints = rig.joints();
  write_log_folder(log);
  write_whole((folder.path() / "truth.csv").string(), truth_text(rig.truth()));
  folder.keep();
  progress.finish();
}

/// The log of a virtual rig in a new folder.
struct Lab : Common {
  std::function<LabPlan()> plan;  ///< none: of a hand
  bool to_20_N = false;           ///< with joint torque
  ResponsesRequest pad;
  std::string folder;
  int seed = 1, joints = 1;
  double noise = 1.0;                   ///< times the rig's
  double stiffness = 1.0, lamps = 1.0;  ///< of the specimen, times the computed pad's

  explicit Lab(std::function<LabPlan()> p, bool with_torque = false) : plan(std::move(p)), to_20_N(with_torque) {
    pad.material = "Sol";
    pad.threads = all_threads();
  }

  void declare(CLI::App& app) {
    add_theta(app, pad);
    add_material(app, pad.material, "Silicone: Sol (Solaris, default) or DS (Dragon Skin)");
    add_seed(app, seed, "Of everything random, default 1");
    add_number(app, "--noise", noise, {0.0, 100.0}, "", "Times the rig's noises, default 1");
    if (to_20_N)
      add_whole(
          app, "--joints", joints, 1, 2, "Of the finger: 1 (default), or 2, whose torques alone give the place, too");
    add_number(app, "--stiffness", stiffness, {0.8, 2.0}, "",
        "Of this specimen's silicone, times the nominal one, 0.8 to 2, default 1");
    add_number(app, "--lamps", lamps, {0.1, 3.0}, "",
        "Power of this specimen's LEDs, times the nominal one, 0.1 to 3, default 1");
    add_text(app, "--cache", pad.cache, "DIR", "Folder that keeps computed responses, default: beside DIR");
    add_flag(
        app, "--coarse", pad.coarse, "Coarse mesh, few places, few rays: seconds instead of minutes, for trying out");
    add_text(app, "--out", folder, "DIR", "Folder of the log; must not be there, or be empty")->required();
    add_threads(app, pad.threads);
    add_common(app, *this);
  }
  void check() const {
    if (to_20_N && stiffness < 1.0)
      throw UsageError(lumo::message("--stiffness is ", stiffness,
          ", lab force goes to 20 N, which a softer pad than the computed one cannot be given"));
    check_design(pad);
    pictures();
  }

  Result run(Output&, Progress& progress) const {
    NewFolder made(folder);
    const PadLight light(responses(pad, folder, progress));
    const SideGeometry side = side_geometry(finger(FingerDesign::from(pad.theta_mm), silicone(pad.material)));
    const auto whole_seed = std::uint64_t(seed);
    Rig instruments;
    instruments.specimen = {stiffness, lamps};
    instruments.motor.joints = joints;
    if (!plan) {
      const HandLab hand(light, hand_plan(whole_seed, 12, pad.coarse ? 13.0_mm : 0.0), whole_seed, noise,
          {.rig = instruments, .side = side});
      leave(hand, {}, made, progress);
      return summary(hand, "grasps", hand.plan().grasps.size());
    }
    const VirtualRig rig(light, plan(), whole_seed, noise, instruments, side);
    Recording log;
    log.wrenches = rig.wrenches();
    log.markers = rig.markers();
    leave(rig, std::move(log), made, progress);
    return summary(rig, "contacts", rig.plan().contacts.size());
  }

  template <class AnyRig> std::string summary(const AnyRig& rig, const char* what, std::size_t count) const {
    const auto touched =
        std::count_if(rig.truth().begin(), rig.truth().end(), [](const auto& t) { return in_contact(t); });
    const std::size_t frames = rig.frames().size(), samples = rig.joints().size();
    if (json)
      return Json{{"out", folder}, {"frames", frames}, {"contact_frames", touched}, {what, count},
                 {"joint_samples", samples}, {"seed", seed}, {"noise", noise}}
                 .dump(2) +
             "\n";
    return lumo::message(folder, ": ", rig.plan().title, "; ", count, " ", what, ", ", frames, " pictures, ", touched,
        " of them in contact, ", samples, " joint samples, seed ", seed, ", noise ", noise, "\n");
  }
};

}  // namespace

void add_lab(CommandLine& line) {
  line.add("lab recontact", "Six places, five re-contacts each, up to 15 N", Lab([] { return recontact_plan(); }));
  line.add("lab cycle", "Cycles within contact at three places", Lab([] { return cycle_plan(); }));
  line.add("lab imaging", "Other camera places, other room light, LEDs off", Lab([] { return imaging_plan(); }));
  line.add("lab force", "Six sequences up to 20 N, with joint torque", Lab([] { return force_plan(); }, true));
  line.add("lab hand", "Grasps of two fingers with two links each, seen from beside", Lab({}));
}

}  // namespace lumo::program
