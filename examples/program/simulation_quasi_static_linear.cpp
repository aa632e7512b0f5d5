#include "lumo/support/cholmod.hpp"
#include "program/simulation_kind.hpp"

namespace lumo::program {

AnySimulation kinds::quasi_static_linear(const Mechanics& m, const Silicone& s) { return of_kind<LinearTet, QuasiStatic<Cholmod>>(m, s, {}); }

}  // namespace lumo::program
