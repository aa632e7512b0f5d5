// 06 Lab: logs of a virtual rig and of a virtual hand in two folders; their light comes from pressed and traced states,
// here five places on a coarse mesh.
#include "lumo/lab/hand_lab.hpp"
#include "lumo/lab/observe_pad.hpp"
#include "lumo/lab/virtual_rig.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/json.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "lumo/support/opencv.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"

#include <cstdio>
#include <filesystem>
#include <fstream>

int main(int argc, char** argv) {
  using namespace lumo;
  using namespace lumo::sense;
  const std::string folder = argc > 1 ? argv[1] : "lab_log";
  const Silicone card = solaris();
  FingerOptions coarse = plain_finger();
  coarse.mesh.contact_edge = coarse.mesh.coarsest_edge = 6.0_mm;
  const Body pad = finger(plain_baseline(), card, coarse);

  // What a camera beside the pad sees of it, in bins of 1 mm, under a sphere of 10 mm at 0, 13 and 26 mm; the places at
  // y < 0 are mirror images.
  const SideSight sight;
  const PadGrid grid{
      .load_N = {2.0, 5.0, 10.0, 15.0}, .place_m = even_places(0.0, 26.0_mm, 13.0_mm), .tilt_place_m = {13.0_mm}};
  using Light = Tracer<BeerLambert, SideSight, Embree>;
  using Simulation = Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<MixedCholesky>>;
  Pipeline<TetgenMesher, Simulation, Light> pipeline{{}, {NeoHookean{.mu = card.mu_Pa, .lambda = card.lambda_Pa}},
      Light({.rays_per_emitter = 1 << 14, .exit_rays = 1 << 17}, sight)};
  pipeline.focus = {1.2e-3, 0.4, 1.0};
  pipeline.rays.rounds = 0;
  const PadLight light(observe_pad(pad, sight, grid, pipeline, TbbExecutor{2}));

  // A free run of the joint, then each place three times, up to 15 N; ten pictures a second.
  LabPlan plan{"example 06", 4.5, {}};
  for (int repetition = 0; repetition < 3; ++repetition)
    for (int place = 0; place < 5; ++place)
      plan.contacts.push_back(
          {place, 13.0_mm * (place - 2), repetition, {{2.0, 0.2, 0.5}, {5.0, 0.2, 0.5}, {15.0, 0.3, 0.5}}});
  Rig rig;
  rig.camera.frames_per_s = 10.0;
  const VirtualRig lab(light, plan, 1, 1.0, rig, side_geometry(pad));

  // A hand of two fingers carries the same pad on each of its four links; fifteen pictures a second. It is touched
  // where light was computed, 13 mm apart.
  rig.camera.frames_per_s = 15.0;
  const HandLab hand(light, hand_plan(1, 4, light.places_m()), 1, 1.0, {.rig = rig, .side = side_geometry(pad)});

  const auto leave = [](const auto& recorded, Recording log) {
    std::filesystem::create_directories(log.path + "/frames");
    log.session = recorded.session();
    log.frames = recorded.frames();
    log.joints = recorded.joints();
    for (std::size_t k = 0; k < log.frames.size(); ++k)
      write_image(log.path + "/frames/" + log.frames[k].file, recorded.image(k).view());
    write_log_folder(log);
    std::ofstream(log.path + "/truth.csv") << truth_text(recorded.truth());  // no estimator opens it
    std::printf("%s: %zu pictures, %zu joint samples\n", log.path.c_str(), log.frames.size(), log.joints.size());
  };
  leave(lab, {folder, {}, {}, {}, lab.wrenches(), lab.markers(), {}});
  leave(hand, {folder + "_hand", {}, {}, {}, {}, {}, {}});
  return 0;
}
