#include "computing/simulation.hpp"

#include "lumo/mechanics/contact/contact_handler.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/materials/stable_neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/mechanics/solvers/vertex_block_descent.hpp"
#include "lumo/support/mixed_cholesky.hpp"

#include <utility>

namespace lumo::program {

namespace {

/// Any Simulator under the name that all share.
template <class Simulation> AnySimulation any(Simulation simulation) {
  return {[simulation = std::move(simulation)](const Body& body, const TetMesh& mesh) {
    const auto pad = std::make_shared<const decltype(simulation.prepare(body, mesh))>(simulation.prepare(body, mesh));
    return AnyPad{[pad]() -> const TetMesh& { return pad->mesh(); },
        [pad](const Scenario<Sphere>& scenario) { return pad->press(scenario); }};
  }};
}

/// All laws and contacts with one element and one solver.
template <class Element, class Solver>
AnySimulation of_kind(const Mechanics& m, const Silicone& s, const Solver& solver) {
  const auto with = [&](auto material, auto contact) {
    return any(Simulator<decltype(material), decltype(contact), Element, Solver>{material, contact, {}, solver});
  };
  const auto touching = [&](auto material) {
    const double margin = 1e-3 * m.record_margin_mm;
    if (m.points == Mechanics::Points::vertex)
      return with(material, VertexContact{m.contact_stiffness_N_per_m3, m.friction, 0.0, margin, m.carrier_friction});
    return with(material, SDFContact{m.contact_stiffness_N_per_m3, m.friction, margin, m.carrier_friction});
  };
  if (m.law == Mechanics::Law::newton) return touching(StableNeoHookean{s.mu_Pa, s.lambda_Pa});
  return touching(NeoHookean{.mu = s.mu_Pa, .lambda = s.lambda_Pa});
}

}  // namespace

AnySimulation simulation(const Mechanics& m, const Silicone& s, const PressWatch& watch) {
  const bool linear = m.element == Mechanics::Element::linear;
  if (m.solver == Mechanics::Solver::quasi_static) {
    QuasiStatic<MixedCholesky> newton;
    newton.config.watch = watch;
    newton.config.time_limit_s = m.time_limit_s.value_or(newton.config.time_limit_s);
    return linear ? of_kind<LinearTet>(m, s, newton) : of_kind<QuadraticTet>(m, s, newton);
  }
  VertexBlockDescent descent{{.sweeps = m.sweeps, .density_kg_per_m3 = s.density_kg_per_m3, .hold_s = m.hold_s}, {}};
  descent.config.watch = watch;
  descent.config.time_limit_s = m.time_limit_s.value_or(descent.config.time_limit_s);
  return linear ? of_kind<LinearTet>(m, s, descent) : of_kind<QuadraticTet>(m, s, descent);
}

}  // namespace lumo::program
