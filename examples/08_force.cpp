// 08 Force: where and how hard, from pictures and motor current, as they would come live; then compared with what was
// true. Reads the log of example 06.
#include "lumo/sense/estimate.hpp"
#include "lumo/support/json.hpp"
#include "lumo/support/opencv.hpp"

#include <cstdio>
#include <fstream>

int main(int argc, char** argv) {
  using namespace lumo;
  using namespace lumo::sense;
  const Recording log = read_log_folder(argc > 1 ? argv[1] : "lab_log");
  const auto camera = [&] { return FolderCamera(log.path + "/frames", log.frames); };

  // What is known before the first contact: the finger in the picture, its light at rest, its joint's friction, weight
  // and what sticks.
  const FingerModel<> finger = known_finger(log, camera);
  const TorqueModel& joint = finger.joints.torque[0];
  std::printf("friction %.0f mN·m, sticks %.0f mN·m\n", 1e3 * joint.coulomb_Nm, 1e3 * finger.joints.standstill_Nm[0]);

  // No labels, no training: the localiser knows what noise is and that contacts are bright bumps.
  const std::vector<FrameEstimate> estimates = estimate(log, camera, finger);

  std::ifstream table(log.path + "/truth.csv");  // opened now that all estimates are made
  const LogTruth truth = LogTruth::from_table(table, "truth.csv");
  const LocationScore where = location_score(estimates, truth, 5.0);
  const ForceErrors e =
      force_score(estimates, truth, finger.jacobian, {finger.link, -26.0_mm, 26.0_mm}, joint.noise_Nm).errors;
  std::printf("location: %d of %d frames at 5 N and more, mean error %.2f mm\n", where.located, where.samples,
      1e3 * where.mae_m);
  std::printf("force, mean error [N]: fused %.2f, optical %.2f, fixed arm %.2f, known location %.2f\n", e.fused.mae_N,
      e.optical.mae_N, e.fixed_arm.mae_N, e.known_location.mae_N);
  return where.located > 0 && e.optical.mae_N < e.fixed_arm.mae_N ? 0 : 1;
}
