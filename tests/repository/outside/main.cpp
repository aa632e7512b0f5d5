// A small search with a material, a contact law, an emitter and two objectives that lumo does not know. Prints one line
// for each design that is evaluated.
#include "contact.hpp"
#include "emitter.hpp"
#include "material.hpp"
#include "objective.hpp"

#include "lumo/campaign/finger_campaign.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/support/cholmod.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/sqlite.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"

#include <cstdio>
#include <optional>
#include <tuple>

/// How little a pad yields: 1 mm over the depth at the largest load, where it yields most [–].
std::optional<lumo::Estimate> rigidity(const lumo::Observations& all) {
  double deepest = 0.0;
  for (const lumo::ScenarioRecord& s : all.scenarios) deepest = std::max(deepest, s.states.back().depth_m);
  return deepest > 0.0 ? std::optional(lumo::Estimate{1e-3 / deepest, 0.0}) : std::nullopt;
}

int main(int argc, char** argv) {
  using namespace lumo;
  constexpr int evaluations = 4;
  FingerOptions coarse = plain_finger();
  coarse.mesh.contact_edge = coarse.mesh.coarsest_edge = 6.0_mm;
  const Silicone card = dragon_skin();
  const Simulator<own::Demiray, own::SoftSkin, QuadraticTet, QuasiStatic<Cholmod>> simulator{
      {.mu = card.mu_Pa, .b = 1.0, .lambda = card.lambda_Pa}, {.thickness_m = 50e-6}};
  using Light = Tracer<BeerLambert, ExitPower, Embree>;
  Pipeline<TetgenMesher, decltype(simulator), Light> pipeline{
      {}, simulator, Light({.rays_per_emitter = 1 << 14, .carrier_rays = 1 << 14, .exit_rays = 1 << 18})};
  pipeline.focus = {1.2e-3, 0.4, 1.0};
  pipeline.rays.rounds = 0;
  Ensemble contacts = flat_ensemble();
  contacts.diameters_m = {20.0_mm};
  contacts.places_m = {0.0_mm, 11.0_mm};
  contacts.loads_N = {1.0, 2.0};

  Problem problem;
  problem.space = finger_space(plain_pad());
  problem.objectives = {{"even sight", true, 0.0}, {"rigidity", true, 0.0}};
  problem.initial = {{6, 6, 8, 5, 0}};
  problem.sobol = 2;
  problem.evaluations = evaluations;
  SqliteStore log(argc > 1 ? argv[1] : "outside.db", "even sight and rigidity of lensed pads");
  const auto evaluate_design = [&](const Design& x) {
    Body body = finger(FingerDesign::from(x), card, coarse);
    for (Emitter& e : body.emitters) e = own::LensedLed{.center = e.center(), .exponent = 4.0, .power_W = e.power_W()};
    const Scores scores = evaluate(
        body, contacts.scenarios(), pipeline, TbbExecutor{2}, std::tuple{own::EvenSight{.load_N = 2.0}, &rigidity});
    TrialResult v;
    v.why = failed_press(scores.observations.scenarios);
    if (v.why.empty()) v.outputs = {scores.objectives[0]->value, scores.objectives[1]->value};
    return v;
  };
  run_campaign(log, Optimizer<>(problem), evaluate_design, [](const auto& state, int id, const TrialResult& v) {
    std::printf("%d", id);
    for (const double x : state.optimizer().trials()[std::size_t(id)].x) std::printf(" %g", x);
    for (const double y : v.outputs) std::printf(" %.17g", y);
    std::printf("%s\n", v.why.c_str());
  });
  CampaignState state(Optimizer<>{problem});
  state.read(log.entries());
  std::printf("observed %d, hypervolume %.17g\n", state.optimizer().observed(), state.optimizer().hypervolume());
  return state.optimizer().observed() == evaluations ? 0 : 1;
}
