#include "catch.hpp"
#include "lumo/campaign/finger_campaign.hpp"
#include "lumo/mechanics/materials/stable_neo_hookean.hpp"
#include "lumo/mechanics/solvers/vertex_block_descent.hpp"
#include "pipeline/coarse_pipeline.hpp"

using namespace lumo;

namespace {

/// Few sweeps on few linear elements: far from equilibrium, as held states may be.
auto held_pipeline() {
  using Sim = Simulator<StableNeoHookean, SDFContact, LinearTet, VertexBlockDescent>;
  const CoarsePipeline coarse = coarse_pipeline();
  Pipeline<TetgenMesher, Sim, CoarseLight> p{coarse.mesher, Sim{}, coarse.tracer, coarse.focus};
  p.simulator.contact.friction = 0.5;
  p.simulator.solver.config.hold_s = 0.05;
  p.rays.rounds = 0;
  p.mesh_order = 1;
  return p;
}

Ensemble two_places() {
  Ensemble e;
  e.diameters_m = {20e-3};
  e.places_m = {0.0, 11e-3};
  e.loads_N = {1.0, 2.0, 5.0, 10.0};
  return e;
}

}  // namespace

TEST_CASE("held states are observed but not scored, unless the problem accepts them") {
  auto p = held_pipeline();
  CHECK_FALSE(p.accept_held);
  const Evaluation refused = evaluate({plain_baseline(), dragon_skin(), coarse_finger()}, two_places(), p, Serial{});
  p.accept_held = true;
  const Evaluation accepted = evaluate({plain_baseline(), dragon_skin(), coarse_finger()}, two_places(), p, Serial{});

  CHECK_FALSE(refused.J_contact);
  CHECK_FALSE(refused.J_obs);
  CHECK_THAT(trial_result(refused).why, Catch::Contains("press: held at 10 N"));
  CHECK(trial_result(refused).outputs.empty());
  REQUIRE(accepted.J_contact);
  REQUIRE(accepted.J_obs);
  const TrialResult v = trial_result(accepted, true);
  CHECK(v.why.empty());
  CHECK(v.outputs == std::vector{accepted.J_contact->value, accepted.J_obs->value});

  double least = 1.0;
  for (std::size_t k = 0; k < 2; ++k) {
    const ScenarioRecord &a = refused.observations.scenarios[k], &b = accepted.observations.scenarios[k];
    CHECK(a.status == Status::held);
    REQUIRE(b.states.size() == 4);
    for (std::size_t s = 0; s < 4; ++s)
      CHECK(a.states[s].force_N == b.states[s].force_N);  // accepting changes no state
    // From the forces that were reached, which are not the loads.
    const auto kappa = [&](std::size_t from) {
      return (b.states[from + 1].force_N - b.states[from].force_N) /
             (b.states[from + 1].depth_m - b.states[from].depth_m);
    };
    CHECK(b.states[1].force_N != b.states[1].load_N);
    REQUIRE(b.terms.stiff);
    CHECK(b.terms.stiff->value == Approx(std::clamp(1.0 - kappa(0) / kappa(2), 0.0, 1.0)));
    least = std::min(least, b.terms.score()->value);
  }
  CHECK(accepted.J_contact->value == least);
}

TEST_CASE("a solve that ended otherwise is not scored where held states are") {
  auto p = held_pipeline();
  p.accept_held = true;
  p.simulator.solver.config.max_advance_m = 1e-4;
  const Evaluation e = evaluate({plain_baseline(), dragon_skin(), coarse_finger()}, two_places(), p, Serial{});
  CHECK_FALSE(e.J_contact);
  CHECK_THAT(trial_result(e, true).why, Catch::Contains("press: max_iterations"));
  p.simulator.solver.config = {.time_limit_s = 0.0};
  const TrialResult late =
      trial_result(evaluate({plain_baseline(), dragon_skin(), coarse_finger()}, two_places(), p, Serial{}), true);
  CHECK(late.retry);  // on a faster machine it may end
  CHECK_THAT(late.why, Catch::StartsWith("press: time_limit at 1 N"));
  CHECK(is_scored(Status::converged));
  CHECK_FALSE(is_scored(Status::held));
  CHECK_FALSE(is_scored(Status::time_limit, true));
}
