// 04 Objectives: θ → mesh → equilibria → responses → J_contact and J_obs, here for two places under two spheres.
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/pipeline/evaluate.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"

#include <cstdio>

int main() {
  using namespace lumo;
  const Silicone card = dragon_skin();
  Ensemble ensemble = flat_ensemble();  // the paper's: 4 diameters × 7 places
  ensemble.diameters_m = {10.0_mm, 30.0_mm};
  ensemble.places_m = {0.0_mm, 11.0_mm};

  using Simulation = Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<MixedCholesky>>;
  using Light = Tracer<BeerLambert, ExitPower, Embree>;
  const Pipeline<TetgenMesher, Simulation, Light> pipeline{
      {}, {NeoHookean{.mu = card.mu_Pa, .lambda = card.lambda_Pa}}, {}};

  const Evaluation e = evaluate({built_baseline(), card}, ensemble, pipeline, TbbExecutor{2});

  std::printf(" d [mm]  y [mm]  q_form  q_stable  q_stiff\n");
  for (const ScenarioRecord& s : e.observations.scenarios)
    std::printf("%7.0f %7.1f %7.3f %9.3f %8.3f\n", 1e3 * s.diameter_m, 1e3 * s.y_m, s.terms.form->value,
        s.terms.stable->value, s.terms.stiff->value);
  if (!e.J_contact || !e.J_obs) return 1;
  std::printf("J_contact = %.4f ± %.4f\nJ_obs = %.2e ± %.1e of the emitted power\n", e.J_contact->value,
      e.J_contact->error, e.J_obs->value, e.J_obs->error);
  return 0;
}
