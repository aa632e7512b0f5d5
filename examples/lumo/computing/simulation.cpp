#include "computing/simulation.hpp"

namespace lumo::program {

AnySimulation simulation(const Mechanics& m, const Silicone& s) {
  const bool linear = m.element == Mechanics::Element::linear;
  if (m.solver == Mechanics::Solver::vbd) return linear ? kinds::descent_linear(m, s) : kinds::descent_quadratic(m, s);
  return linear ? kinds::quasi_static_linear(m, s) : kinds::quasi_static_quadratic(m, s);
}

}  // namespace lumo::program
