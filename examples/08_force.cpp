// 08 Force: where and how hard, from pictures and motor current, as they would come live; then compared with what was
// true. Reads the log of example 06.
#include "lumo/sense/force/log_estimates.hpp"
#include "lumo/support/json.hpp"
#include "lumo/support/opencv.hpp"

#include <cstdio>
#include <fstream>

int main(int argc, char** argv) {
  using namespace lumo;
  const Recording log = read_log_folder(argc > 1 ? argv[1] : "lab_log");
  const auto camera = [&] { return FolderCamera(log.path + "/frames", log.frames); };
  std::vector<std::int64_t> stamps;
  for (const FrameRecord& f : log.frames) stamps.push_back(f.stamp_ns);

  // What is known before the first contact: the finger in the picture, its light at rest, its joint's friction, weight
  // and what sticks.
  const UnloadedStretch rest = UnloadedStretch::of(log.session, stamps.front());
  FolderCamera first = camera(), all = camera();
  LogReference reference{view_finger(first, log.session, rest, log.path), {}, {}};
  const LongitudinalBins bins = LongitudinalBins::uniform(-27.5_mm, 27.5_mm, 55);
  GreenProfile readout = reference.view.readout(bins);
  reference.unloaded = unloaded_reference(read_profiles(all, readout), rest, log.path);
  reference.joints = identify_joints(log.joints, log.session, rest.to_ns);
  std::printf("friction %.0f mN·m, sticks %.0f mN·m\n", 1e3 * reference.joints.torque[0].coulomb_Nm,
              1e3 * reference.joints.standstill_Nm[0]);

  // No labels, no training: the localiser knows what noise is and that contacts are bright bumps.
  const MomentArm arm{log.session.joint_to_origin_m};
  const auto estimates =
      estimate_forces(camera, log.joints, stamps, reference, bins,
                      BayesLocalizer(finger_localizer(readout, reference.unloaded)), arm, log.session);

  std::ifstream table(log.path + "/truth.csv");  // opened now that all estimates are made
  const LogTruth truth = LogTruth::from_table(table, "truth.csv");
  const auto place = [](const LogEstimate& e) {
    return e.location.contacts == 1 ? std::optional(e.location.contact[0]) : std::nullopt;
  };
  const LocationScore where = location_score(estimates, truth, 5.0, place);
  const ForceErrors e =
      force_score(estimates, truth, arm, -26.0_mm, 26.0_mm, reference.joints.torque[0].noise_Nm).errors;
  std::printf("location: %d of %d frames at 5 N and more, mean error %.2f mm\n", where.located, where.samples,
              1e3 * where.mae_m);
  std::printf("force, mean error [N]: fused %.2f, optical %.2f, fixed arm %.2f, known location %.2f\n", e.fused.mae_N,
              e.optical.mae_N, e.fixed_arm.mae_N, e.known_location.mae_N);
  return where.located > 0 && e.optical.mae_N < e.fixed_arm.mae_N ? 0 : 1;
}
