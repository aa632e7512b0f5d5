#include "computing/solver_study.hpp"

#include "computing/pad.hpp"
#include "computing/simulation.hpp"
#include "lumo/core/stopwatch.hpp"
#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/pipeline/observations.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"

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

Meshed meshed(Configuration o, const Mechanics& m, const TetgenMesher& mesher) {
  o.mechanics = m;
  const Body body = body_of(o);
  return {body, mesh_for_contact(body, mesh_body(body, mesher), std::vector{scenario_of(o.touch)}, mesher, focus_of(o),
                    m.mesh_order())};
}

/// Equilibria under the forces that other states reached, in their order; none where it was not found. Forces are
/// passed in increasing order, whatever that was.
std::vector<std::optional<MechanicalState>> equilibria(
    const AnyPad& pad, Scenario<Sphere> scenario, const std::vector<MechanicalState>& states) {
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

SolverRow row(const Configuration& o, const std::string& name, const Mechanics& m, const Meshed& on,
    const std::vector<MechanicalState>& states) {
  SolverRow row{
      name, m, on.mesh.nodes.size(), on.mesh.tets.size(), record_of(on.body, on.mesh, scenario_of(o.touch), states)};
  for (const MechanicalState& s : states) row.states.push_back({s.status == Status::held ? s.met_force_N : undefined});
  return row;
}

/// One of the study's presses.
struct Press {
  std::string name;
  Mechanics mechanics;
  const Meshed* on;
  std::vector<MechanicalState> states = {};
  std::optional<AnyPad> pad = {};

  /// As many steps as it takes times that of 10 sweeps, roughly, so that the time left can be shown.
  int steps() const { return mechanics.solver == Mechanics::Solver::vbd ? mechanics.sweeps / 10 : 1; }
};

Mechanics descent(Mechanics m, int sweeps) {
  m.solver = Mechanics::Solver::vbd;
  m.sweeps = sweeps;
  return m;
}

/// How far the held states, and those of the same mesh in equilibrium under the loads, are from equilibrium. The forces
/// of those that held are not the loads: their equilibria are found anew. The equilibrium itself has no distance.
void compare(std::vector<SolverRow>& rows, const std::vector<Press>& presses, const Scenario<Sphere>& scenario,
    double height_m, Progress& progress) {
  constexpr std::size_t held = 2, still = 2;  // how many, and which, of the presses on the even mesh
  progress.stage("equilibria under the forces that were reached", int(held));
  for (std::size_t r = 0; r <= still; ++r) {
    const std::vector<MechanicalState>& states = presses[r].states;
    std::vector<std::optional<MechanicalState>> rest;
    if (r < held) {
      rest = equilibria(*presses[still].pad, scenario, states);
      progress.step();
    } else {
      for (const MechanicalState& s : states)
        rest.push_back(s.status == Status::converged ? std::optional(s) : std::nullopt);
    }
    for (std::size_t k = 0; k < rest.size(); ++k)
      if (rest[k] && is_scored(states[k].status, true)) compare(rows[r].states[k], states[k], *rest[k], height_m);
  }
}

}  // namespace

SolverStudy make_solver_study(const Configuration& o, int threads, Progress& progress) {
  const FingerDesign design = o.pad.design();
  const Silicone& card = o.pad.silicone;
  SolverStudy study;
  study.pad_height_mm = design.h_fp + design.h_ep;
  Mechanics quadratic = o.mechanics, linear = o.mechanics;
  quadratic.size_mm = 0.0;
  linear.element = Mechanics::Element::linear;
  if (linear.size_mm == 0.0) linear.size_mm = 1.0;

  const TetgenMesher mesher;
  progress.stage("mesh", 2);
  const Meshed even = meshed(o, linear, mesher);
  progress.step();
  const Meshed graded = meshed(o, quadratic, mesher);
  progress.step();

  const Scenario<Sphere> scenario = scenario_of(o.touch);
  std::vector<Press> presses = {{"VBD, 10 sweeps", descent(linear, 10), &even},
      {"VBD, 100 sweeps", descent(linear, 100), &even}, {"quasi-static, linear", linear, &even},
      {"quasi-static, quadratic", quadratic, &graded}};
  study.rows.resize(presses.size());
  static constexpr std::array<std::size_t, 4> longest_first = {1, 0, 2, 3};
  int all = 0;
  for (const Press& p : presses) all += p.steps();
  progress.stage("press", all);
  TbbExecutor{threads}.for_each(presses.size(), [&](std::size_t k) {
    Press& p = presses[longest_first[k]];
    SolverRow& r = study.rows[longest_first[k]];
    const Stopwatch watch;
    p.pad = simulation(p.mechanics, card).prepare(p.on->body, p.on->mesh);
    p.states = p.pad->press(scenario);
    r = row(o, p.name, p.mechanics, *p.on, p.states);
    r.seconds = watch.seconds();
    for (int s = 0; s < p.steps(); ++s) progress.step();
  });
  compare(study.rows, presses, scenario, 1e-3 * study.pad_height_mm, progress);
  return study;
}

}  // namespace lumo::program
