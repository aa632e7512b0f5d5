#include "lumo/mechanics/vertex_block_descent.hpp"
#include "lumo/support/tbb.hpp"
#include "program/simulation_kind.hpp"

namespace lumo::program {

AnySimulation kinds::descent_linear(const Mechanics& m, const Silicone& s, int threads) {
  return of_kind<LinearTet, BlockDescent<TbbExecutor>>(m, s, {{.sweeps = m.sweeps, .density_kg_per_m3 = s.density_kg_per_m3}, {threads}});
}

}  // namespace lumo::program
