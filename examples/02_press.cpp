// 02 Press: mesh the finger where a sphere will touch it, and press to exact loads.
#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "lumo/support/tetgen.hpp"

#include <cstdio>

int main() {
  using namespace lumo;
  const Silicone card = dragon_skin();
  const Body body = finger(built_baseline(), card);
  const Scenario<Sphere> scenario{.indenter = {.diameter_m = 10.0_mm}, .angle_rad = 0.0_deg, .y_m = 0.0_mm};

  const TetgenMesher mesher;
  const TetMesh coarse = mesh_body(body, mesher);
  const TetMesh mesh = mesh_for_contact(body, coarse, std::vector{scenario}, mesher);

  // `Simulator<NeoHookean, SDFContact>` alone needs nothing but Eigen; CHOLMOD makes it fast.
  const Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<MixedCholesky>> simulator{
      NeoHookean{.mu = card.mu_Pa, .lambda = card.lambda_Pa}};

  std::printf("%zu nodes, %zu elements\n load [N]  depth [mm]  contact [mm2]  residual [N]  status\n",
      mesh.nodes.size(), mesh.tets.size());
  bool good = true;
  for (const MechanicalState& s : simulator.press(body, mesh, scenario)) {
    std::printf("%9.1f %11.4f %14.2f %13.1e  %s\n", s.load_N, 1e3 * s.depth_m, 1e6 * s.contact_area_m2, s.residual_N,
        to_string(s.status).data());
    good = good && s.status == Status::converged;
  }
  return good ? 0 : 1;
}
