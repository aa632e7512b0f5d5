// 05 Campaign: a search over designs that an interruption cannot harm. Run it again and it goes on; here on a coarse
// mesh with two contacts.
#include "lumo/campaign/finger_campaign.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "lumo/support/sqlite.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"

#include <cstdio>

int main(int argc, char** argv) {
  using namespace lumo;
  const char* file = argc > 1 ? argv[1] : "05_campaign.db";
  const Silicone card = dragon_skin();
  Ensemble contacts = flat_ensemble();
  contacts.diameters_m = {20.0_mm};
  contacts.places_m = {0.0_mm, 11.0_mm};
  FingerOptions coarse = plain_finger();  // pressed in a quarter of the time
  coarse.mesh.contact_edge = coarse.mesh.coarsest_edge = 6.0_mm;

  using Simulation = Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<MixedCholesky>>;
  using Light = Tracer<BeerLambert, ExitPower, Embree>;
  Pipeline<TetgenMesher, Simulation, Light> pipeline{
      {}, {NeoHookean{.mu = card.mu_Pa, .lambda = card.lambda_Pa}}, {}};  // before the store: the mesher forks
  pipeline.focus = {1.2e-3, 0.4, 1.0};
  pipeline.rays.rounds = 0;

  SqliteStore log(file,
      "example 05: DS, 20 mm at y = 0 and 11 mm, coarse");  // refuses a file that was made for something else
  const auto evaluate_design = [&](const Design& x) {
    return trial_result(evaluate({FingerDesign::from(x), card, coarse}, contacts, pipeline, TbbExecutor{2}));
  };
  const auto show = [](const auto& state, int id, const TrialResult& v) {
    const Design& x = state.optimizer().trials()[std::size_t(id)].x;
    std::printf("%2d  %4.1f %4.1f %4.1f %4.1f %4.1f", id, x[0], x[1], x[2], x[3], x[4]);
    if (v.outputs.empty()) std::printf("  %s\n", v.why.c_str());
    else
      std::printf("  J_contact %.4f  J_obs %.2e  hypervolume %.2e\n", v.outputs[0], v.outputs[1],
          state.optimizer().hypervolume());
    std::fflush(stdout);
  };
  const Problem problem = finger_problem(6, 1, plain_pad(), plain_references());
  run_campaign(log, Optimizer<>(problem), evaluate_design, show);

  CampaignState state(Optimizer<>{problem});
  state.read(log.entries());
  std::printf(
      "%d designs in %s, hypervolume %.3e\n", state.optimizer().observed(), file, state.optimizer().hypervolume());
  return state.optimizer().observed() == 6 ? 0 : 1;
}
