// 03 Light: trace the LEDs' light through the pressed finger; what changes at its sides shows where it is touched.
#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "lumo/support/tetgen.hpp"

#include <cstdio>

int main() {
  using namespace lumo;
  const Silicone card = solaris();
  const Body body = finger(built_baseline(), card);
  const Scenario<Sphere> scenario{.indenter = {.diameter_m = 20.0_mm}, .y_m = 11.0_mm, .loads_N = {5.0}};
  const TetgenMesher mesher;
  const TetMesh mesh = mesh_for_contact(body, mesh_body(body, mesher), std::vector{scenario}, mesher);
  const Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<MixedCholesky>> simulator{
      NeoHookean{.mu = card.mu_Pa, .lambda = card.lambda_Pa}};
  const MechanicalState pressed = simulator.press(body, mesh, scenario).front();

  // `Tracer<BeerLambert>` has its own ray tree; Embree makes it faster.
  const Tracer<BeerLambert, ExitPower, Embree> tracer;
  const Response rest = tracer.trace(body, mesh);
  const Response loaded = tracer.trace(body, mesh, pressed, {.x = true, .y = false});

  std::printf("region   y [mm]   at rest   change at 5 N   (parts of the emitted power)\n");
  for (int b = 0; b < body.regions; ++b) {
    const auto k = std::size_t(b);
    std::printf(
        "%6d %8.1f %9.5f %+15.6f\n", b + 1, -25.0 + 5.0 * b, rest.power_W[k], loaded.power_W[k] - rest.power_W[k]);
  }
  std::printf("energy: imbalance %.1e, lost %.1e of what was emitted\n", loaded.ledger.imbalance(), loaded.ledger.lost);
  return pressed.status == Status::converged && loaded.ledger.imbalance() < 1e-9 ? 0 : 1;
}
