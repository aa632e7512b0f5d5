// Own policies in a design: a material, a contact law, an emitter and an objective that lumo does not know, in one
// evaluation.
#include "own/contact.hpp"
#include "own/emitter.hpp"
#include "own/material.hpp"
#include "own/objective.hpp"

#include "lumo/optics/tracer.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"

#include <cstdio>

int main() {
  using namespace lumo;
  //! [body]
  FingerOptions coarse = plain_finger();  // for a first look
  coarse.mesh.contact_edge = coarse.mesh.coarsest_edge = 6.0_mm;
  const Silicone card = dragon_skin();
  Body body = finger(plain_baseline(), card, coarse);
  for (Emitter& e : body.emitters) e = own::LensedLed{.center = e.center(), .exponent = 4.0, .power_W = e.power_W()};
  //! [body]

  //! [tools]
  const own::Demiray material{.mu = card.mu_Pa, .b = 1.0, .lambda = card.lambda_Pa};
  const own::SoftSkin contact{.thickness_m = 50e-6};
  const Simulator<own::Demiray, own::SoftSkin, QuadraticTet, QuasiStatic<MixedCholesky>> simulator{material, contact};
  using Light = Tracer<BeerLambert, ExitPower, Embree>;
  const Light light({.rays_per_emitter = 1 << 12, .carrier_rays = 1 << 14, .exit_rays = 1 << 16});
  Pipeline<TetgenMesher, decltype(simulator), Light> pipeline{{}, simulator, light};
  pipeline.focus = {1.2e-3, 0.4, 1.0};
  pipeline.rays.rounds = 0;
  //! [tools]

  //! [evaluate]
  Ensemble contacts = flat_ensemble();
  contacts.diameters_m = {20.0_mm};
  contacts.places_m = {0.0_mm, 11.0_mm};
  contacts.loads_N = {1.0, 2.0};
  const std::tuple objectives{own::EvenSight{.load_N = 2.0}};
  const Scores scores = evaluate(body, contacts.scenarios(), pipeline, TbbExecutor{2}, objectives);
  //! [evaluate]
  for (const ScenarioRecord& s : scores.observations.scenarios)
    std::printf("y = %4.1f mm: %s, %.3f mm deep at 2 N\n", 1e3 * s.y_m, to_string(s.status).data(),
        1e3 * s.states.back().depth_m);
  if (!scores.converged || !scores.objectives[0]) return 1;
  std::printf("even sight: %.3f ± %.3f\n", scores.objectives[0]->value, scores.objectives[0]->error);
  return scores.objectives[0]->value > 0.0 && scores.objectives[0]->value <= 1.0 &&
                 scores.observations.ledger.imbalance() < 1e-9
             ? 0
             : 1;
}
