// Prints the bits of a small press by vertex block descent: once with the compiler's vector types, once with
// LUMO_PLAIN_SIMD, and both must be the same.
#include "lumo/mechanics/contact/contact_handler.hpp"
#include "lumo/mechanics/indenters/indenter.hpp"
#include "lumo/mechanics/materials/stable_neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/mechanics/solvers/vertex_block_descent.hpp"
#include "mechanics/bodies.hpp"

#include <bit>
#include <cstdint>
#include <cstdio>
#include <vector>

int main() {
  using namespace lumo;
  const std::vector<double> even = test::even(4);
  const auto [body, mesh] = test::symmetric_block(Vec3d(5e-3, 5e-3, 5e-3), even, even, even, 1);
  Simulator<StableNeoHookean, VertexContact, LinearTet, VertexBlockDescent> simulator{{1e5, 2e6}, {}};
  simulator.contact.stiffness_N_per_m3 = 1e10;
  simulator.solver.config.hold_s = 0.05;
  for (const MechanicalState& s : simulator.press(body, mesh, Scenario<Sphere>{Sphere{10e-3}, 0.0, 0.0, {0.1, 0.3}}))
    for (const Vec3d& u : s.displacement)
      for (const double v : {u.x(), u.y(), u.z()})
        std::printf("%016llx\n", static_cast<unsigned long long>(std::bit_cast<std::uint64_t>(v)));
}
