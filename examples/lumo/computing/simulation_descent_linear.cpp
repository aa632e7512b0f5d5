#include "lumo/mechanics/vertex_block_descent.hpp"
#include "computing/simulation_kind.hpp"

namespace lumo::program {

AnySimulation kinds::descent_linear(const Mechanics& m, const Silicone& s) {
  return of_kind<LinearTet, VertexBlockDescent>(m, s, {{.sweeps = m.sweeps, .density_kg_per_m3 = s.density_kg_per_m3}, {}});
}

}  // namespace lumo::program
