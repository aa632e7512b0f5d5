// 06 Lab: the log of a virtual rig in a folder; its light comes from pressed and traced states, here five places on a coarse mesh.
#include "lumo/campaign/observe_pad.hpp"
#include "lumo/lab/virtual_rig.hpp"
#include "lumo/mechanics/neo_hookean.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/support/cholmod.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/json.hpp"
#include "lumo/support/opencv.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"

#include <cstdio>
#include <filesystem>
#include <fstream>

int main(int argc, char** argv) {
  using namespace lumo;
  const std::string folder = argc > 1 ? argv[1] : "lab_log";
  const Silicone card = solaris();
  FingerOptions coarse;
  coarse.mesh.contact_edge = coarse.mesh.coarsest_edge = 6.0_mm;
  const Body pad = finger(baseline_design(), card, coarse);

  // What a camera beside the pad sees of it, in bins of 1 mm, under a sphere of 10 mm at 0, 13 and 26 mm; the places at y < 0 are mirror images.
  const SideSight sight;
  const PadGrid grid{.load_N = {2.0, 5.0, 10.0, 15.0}, .spacing_m = 13.0_mm, .places = 3, .tilt_place_m = {13.0_mm}};
  using Light = Tracer<BeerLambert, SideSight, Embree>;
  using Simulation = Simulator<NeoHookean, SDFContact, QuadraticTet, Cholmod>;
  Pipeline<TetgenMesher, Simulation, Light> pipeline{{}, {NeoHookean{.mu = card.mu_Pa, .lambda = card.lambda_Pa}}, Light({.rays_per_emitter = 1 << 14, .exit_rays = 1 << 17}, sight)};
  pipeline.focus = {1.2e-3, 0.4, 1.0};
  pipeline.rays.rounds = 0;
  const PadLight light(observe_pad(pad, sight, grid, pipeline, TbbExecutor{2}));

  // A free run of the joint, then each place three times, up to 15 N; ten pictures a second.
  LabPlan plan{"example 06", 4.5, {}};
  for (int repetition = 0; repetition < 3; ++repetition)
    for (int place = 0; place < 5; ++place)
      plan.contacts.push_back({place, 13.0_mm * (place - 2), repetition, {{2.0, 0.2, 0.5}, {5.0, 0.2, 0.5}, {15.0, 0.3, 0.5}}});
  Rig rig;
  rig.camera.frames_per_s = 10.0;
  const VirtualRig lab(light, plan, 1, 1.0, rig, side_geometry(pad));

  std::filesystem::create_directories(folder + "/frames");
  for (std::size_t k = 0; k < lab.frames().size(); ++k) write_image(folder + "/frames/" + lab.frames()[k].file, lab.image(k).view());
  write_log_folder({folder, lab.session(), lab.frames(), lab.joints(), lab.wrenches(), lab.markers(), {}});
  std::ofstream(folder + "/truth.csv") << truth_text(lab.truth());  // no estimator opens it
  std::printf("%s: %zu pictures, %zu joint samples, %zu contacts\n", folder.c_str(), lab.frames().size(), lab.joints().size(), lab.plan().contacts.size());
  return 0;
}
