#include "lumo/support/cholmod.hpp"
#include "computing/simulation_kind.hpp"

namespace lumo::program {

AnySimulation kinds::quasi_static_quadratic(const Mechanics& m, const Silicone& s) { return of_kind<QuadraticTet, Cholmod>(m, s, {}); }

}  // namespace lumo::program
