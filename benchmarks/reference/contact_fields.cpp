// Areas of contact by two fields on the same equilibria: the fitted distance to the edge (lumo::contact_field), and φ =
// p/k − g with pressure and gap of the nodes. Prints a Markdown table.
//   lumo_contact_fields [SIZE]
//       SIZE: edge length at the contact over the default's, 1 if it is left out

#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "lumo/support/tetgen.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <vector>

using namespace lumo;

int main(int argc, char** argv) {
  const Focus focus{.finest = Focus{}.finest * (argc > 1 ? std::atof(argv[1]) : 1.0)};
  const Silicone card = dragon_skin();
  const Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<MixedCholesky>> simulator{
      NeoHookean{.mu = card.mu_Pa, .lambda = card.lambda_Pa}};
  const TetgenMesher mesher;
  std::printf("| θ [mm] | d [mm] | y [mm] | 1 N | 2 N | 5 N | 10 N | 15 N |\n|---|---|---|---|---|---|---|---|\n");
  for (const FingerDesign& design : plain_references()) {
    const Body body = finger(design, card, plain_finger());
    const TetMesh coarse = mesh_body(body, mesher);
    for (const auto& [diameter, y] : {std::pair(30e-3, 0.0), {10e-3, 22e-3}}) {
      const Scenario<Sphere> scenario{.indenter = {.diameter_m = diameter}, .y_m = y};
      const TetMesh mesh = mesh_for_contact(body, coarse, std::vector{scenario}, mesher, focus);
      const Vec3d start = first_touch(body, mesh, scenario).origin;
      const ContactSurface surface(
          mesh, body, [](const Patch& p) { return p.contactable; }, simulator.contact);
      const auto [a, b, c, d, e] = design.values();
      std::printf("| %g,%g,%g,%g,%g | %g | %g |", a, b, c, d, e, 1e3 * diameter, 1e3 * y);
      for (const MechanicalState& s : simulator.prepare(body, mesh).press(scenario)) {
        const Vec3d centre = start + s.depth_m * scenario.direction();
        Positions x = positions_of(mesh);
        std::vector<double> field(mesh.nodes.size(), -1.0);
        for (std::size_t k = 0; k < field.size(); ++k) {
          x.col(Eigen::Index(k)) += s.displacement[k];
          if (std::isfinite(s.contact_field[k]))
            field[k] = s.pressure_Pa[k] / simulator.contact.stiffness_N_per_m3 -
                       scenario.indenter.distance(Vec3d(x.col(Eigen::Index(k)) - centre));
        }
        std::printf(" %+.1f %% |", 100.0 * (contact_area(surface, field, x) / s.contact_area_m2 - 1.0));
      }
      std::printf("\n");
      std::fflush(stdout);
    }
  }
}
