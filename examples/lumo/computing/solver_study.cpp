#include "computing/solver_study.hpp"

#include "lumo/core/stopwatch.hpp"
#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/objective/contact_progression.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"
#include "computing/pad.hpp"
#include "report/press_report.hpp"
#include "computing/simulation.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace lumo::program {

namespace {

struct Meshed {
  Body body;
  TetMesh mesh;
};

Meshed meshed(const PressRequest& o, const Mechanics& m, const TetgenMesher& mesher) {
  const Body body = body_of(o, m);
  return {body, mesh_for_contact(body, mesh_body(body, mesher), std::vector{scenario_of(o)}, mesher, focus_of(m), m.mesh_order())};
}

/// Equilibria under the forces that other states reached, in their order; none where it was not found. Forces are passed in increasing order, whatever that was.
std::vector<std::optional<MechanicalState>> equilibria(const AnyPad& pad, Scenario<Sphere> scenario, const std::vector<MechanicalState>& states) {
  std::vector<double> forces;
  for (const MechanicalState& s : states)
    if (s.force_N > 0.0 && std::isfinite(s.force_N)) forces.push_back(s.force_N);
  std::sort(forces.begin(), forces.end());
  forces.erase(std::unique(forces.begin(), forces.end()), forces.end());
  std::vector<std::optional<MechanicalState>> found(states.size());
  if (forces.empty()) return found;
  scenario.loads_N = forces;
  const std::vector<MechanicalState> still = pad.press(scenario);
  for (std::size_t k = 0; k < states.size(); ++k)
    for (const MechanicalState& s : still)
      if (s.load_N == states[k].force_N && s.status == Status::converged) found[k] = s;
  return found;
}

void compare(SolverState& out, const MechanicalState& state, const MechanicalState& equilibrium, double height_m) {
  double apart = 0.0, size = 0.0;
  for (std::size_t n = 0; n < state.displacement.size(); ++n) {
    apart += (state.displacement[n] - equilibrium.displacement[n]).squaredNorm();
    size += equilibrium.displacement[n].squaredNorm();
  }
  out.equilibrium_depth_mm = 1e3 * equilibrium.depth_m;
  out.distance_over_height = std::sqrt(apart / double(state.displacement.size())) / height_m;
  out.distance_relative = std::sqrt(apart / size);
}

SolverRow row(const PressRequest& o, const std::string& name, const Mechanics& m, const Meshed& on, const std::vector<MechanicalState>& states) {
  SolverRow row{name, m, {on.mesh.nodes.size(), on.mesh.tets.size()}, {}, undefined, {}, undefined};
  row.scenario.diameter_mm = o.diameter_mm, row.scenario.angle_deg = o.angle_deg, row.scenario.y_mm = o.y_mm;
  row.scenario.status = std::string(to_string(states.back().status));
  const ContactTerms terms = contact_terms(on.body, on.mesh, states, 0.5e-3 * o.diameter_mm);
  report_terms(row.scenario, terms);
  row.score = value_of(terms.score());
  for (const MechanicalState& s : states) {
    SolverState k;
    k.state = report_state(s);
    if (s.status == Status::held) k.met_force_N = s.met_force_N;
    row.scenario.states.push_back(k.state);
    row.states.push_back(k);
  }
  return row;
}

}  // namespace

SolverStudy make_solver_study(const PressRequest& o, int threads, Progress& progress) {
  const FingerDesign design = FingerDesign::from(o.theta_mm);
  const Silicone card = silicone(o.material);
  SolverStudy study;
  study.pad_height_mm = design.h_fp + design.h_ep;
  Mechanics quadratic = o.mechanics, linear = o.mechanics;
  quadratic.size_mm = 0.0;
  linear.element = Mechanics::Element::linear;
  if (linear.size_mm == 0.0) linear.size_mm = 1.0;
  Mechanics few = linear, many = linear;
  few.solver = many.solver = Mechanics::Solver::vbd;
  few.sweeps = 10, many.sweeps = 100;

  const TetgenMesher mesher;
  progress.stage("mesh", 2);
  const Meshed even = meshed(o, linear, mesher);
  progress.step();
  const Meshed graded = meshed(o, quadratic, mesher);
  progress.step();

  const Scenario<Sphere> scenario = scenario_of(o);
  struct Press {
    std::string name;
    Mechanics mechanics;
    const Meshed* on;
    std::vector<MechanicalState> states = {};
    std::optional<AnyPad> pad = {};
  };
  std::vector<Press> presses = {{"VBD, 10 sweeps", few, &even}, {"VBD, 100 sweeps", many, &even}, {"quasi-static, linear", linear, &even}, {"quasi-static, quadratic", quadratic, &graded}};
  study.rows.resize(presses.size());
  static constexpr std::array<std::size_t, 4> longest_first = {1, 0, 2, 3};
  // As many steps as a press takes times that of 10 sweeps, roughly, so that the time left can be told.
  const auto steps = [](const Mechanics& m) { return m.solver == Mechanics::Solver::vbd ? m.sweeps / 10 : 1; };
  int all = 0;
  for (const Press& p : presses) all += steps(p.mechanics);
  progress.stage("press", all);
  TbbExecutor{threads}.for_each(presses.size(), [&](std::size_t k) {
    Press& p = presses[longest_first[k]];
    const lumo::detail::Stopwatch watch;
    p.pad = simulation(p.mechanics, card).prepare(p.on->body, p.on->mesh);
    p.states = p.pad->press(scenario);
    study.rows[longest_first[k]] = row(o, p.name, p.mechanics, *p.on, p.states);
    study.rows[longest_first[k]].seconds = watch.seconds();
    for (int s = 0; s < steps(p.mechanics); ++s) progress.step();
  });

  // The forces of those that held are not the loads: their equilibria are found anew. The equilibrium itself has no distance.
  progress.stage("equilibria under the forces that were reached", 2);
  for (std::size_t r = 0; r < 3; ++r) {
    std::vector<std::optional<MechanicalState>> rest;
    if (r < 2) rest = equilibria(*presses[2].pad, scenario, presses[r].states), progress.step();
    else for (const MechanicalState& s : presses[r].states) rest.push_back(s.status == Status::converged ? std::optional(s) : std::nullopt);
    for (std::size_t k = 0; k < rest.size(); ++k)
      if (rest[k] && is_scored(presses[r].states[k].status, true)) compare(study.rows[r].states[k], presses[r].states[k], *rest[k], 1e-3 * study.pad_height_mm);
  }
  return study;
}

}  // namespace lumo::program
