#include "program/commands.hpp"

#include "lumo/mechanics/neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/mesh/body_mesh.hpp"
#include "lumo/mesh/quality.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/support/cholmod.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"

#include <chrono>

namespace lumo::program {

namespace {

class Stopwatch {
 public:
  double seconds() const { return std::chrono::duration<double>(Clock::now() - start_).count(); }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point start_ = Clock::now();
};

Body body_of(const Options& o) { return finger(FingerDesign::from(o.theta_mm), silicone(o.material)); }

TetMesh mesh_of(const Body& body, Progress& progress, double& seconds) {
  const Stopwatch watch;
  progress.stage("mesh");
  TetMesh mesh = mesh_body(body, TetgenMesher{});
  progress.step();
  seconds = watch.seconds();
  return mesh;
}

StateReport report(const MechanicalState& s) {
  return {s.load_N, s.force_N, 1e3 * s.depth_m, 1e6 * s.contact_area_m2, 1e6 * s.reference_area_m2, s.residual_N};
}

std::vector<double> per_power(const Response& r, const std::vector<double>& watts) {
  std::vector<double> out = watts;
  for (double& v : out) v /= r.ledger.emitted;
  return out;
}

Ledger report(const EnergyLedger& e) {
  double regions = 0.0;
  for (const double c : e.channels) regions += c;
  const double physical = regions + e.to_indenter + e.elsewhere + e.absorbed_in_medium + e.absorbed_at_surfaces + e.lost, p = e.emitted;
  return {1.0, regions / p, e.to_indenter / p, e.elsewhere / p, e.absorbed_in_medium / p, e.absorbed_at_surfaces / p, (e.accounted() - physical) / p, e.lost / p};
}

/// The part of a press that a trace shares.
PressResult pressed(const Options& o, const Body& body, Progress& progress) {
  PressResult result;
  result.mesh = mesh_of(body, progress, result.seconds.mesh);
  result.size = {result.mesh.nodes.size(), result.mesh.tets.size()};
  const Stopwatch watch;
  progress.stage("press");
  const Silicone card = silicone(o.material);
  const Simulator<NeoHookean, SDFContact, QuadraticTet, Cholmod> simulator{NeoHookean{.mu = card.mu_Pa, .lambda = card.lambda_Pa}};
  const Scenario<Sphere> scenario{{o.diameter_mm * 1e-3}, o.angle_deg * pi / 180.0, o.y_mm * 1e-3, o.loads_N};
  result.states = simulator.press(body, result.mesh, scenario);
  progress.step();
  result.seconds.mechanics = watch.seconds();

  result.scenario.diameter_mm = o.diameter_mm, result.scenario.angle_deg = o.angle_deg, result.scenario.y_mm = o.y_mm;
  for (const auto& s : result.states) {
    result.scenario.states.push_back(report(s));
    result.scenario.status = std::string(to_string(s.status));
    if (s.status != Status::converged) break;
  }
  return result;
}

}  // namespace

MeshResult make_mesh(const Options& o, Progress& progress) {
  MeshResult result;
  const Body body = body_of(o);
  result.mesh = mesh_of(body, progress, result.seconds);
  result.size = {result.mesh.nodes.size(), result.mesh.tets.size()};
  result.boundary_faces = result.mesh.faces.size();
  const MeshQuality quality = measure(result.mesh);
  result.volume_mm3 = 1e9 * quality.volume_m3;
  result.exact_volume_mm3 = 1e9 * body.exact_volume_m3;
  result.min_jacobian_ratio = quality.min_jacobian_ratio;
  result.min_dihedral_deg = quality.min_dihedral_deg;
  return result;
}

PressResult make_press(const Options& o, Progress& progress) {
  const Stopwatch watch;
  PressResult result = pressed(o, body_of(o), progress);
  result.seconds.total = watch.seconds();
  return result;
}

TraceResult make_trace(const Options& o, Progress& progress) {
  const Stopwatch watch;
  const Body body = body_of(o);
  PressResult press = pressed(o, body, progress);
  TraceResult result{press.scenario, press.size, press.seconds, {}, {}};
  if (result.scenario.status != "converged") return result;

  const Stopwatch light;
  progress.stage("trace", int(press.states.size()) + 1);
  const Tracer tracer;
  std::vector<Response> responses(press.states.size() + 1);   // the unloaded one first
  TbbExecutor{o.threads}.for_each(responses.size(), [&](std::size_t k) {
    responses[k] = k == 0 ? tracer.trace(body, press.mesh) : tracer.trace(body, press.mesh, press.states[k - 1]);
    progress.step();
  });
  result.unloaded_response = per_power(responses[0], responses[0].power_W);
  double worst = -1.0;
  for (std::size_t k = 0; k < responses.size(); ++k) {
    const Response& r = responses[k];
    if (k > 0) {
      StateReport& state = result.scenario.states[k - 1];
      state.response = per_power(r, r.power_W);
      state.change_error = per_power(r, standard_error(r.replicates - responses[0].replicates));   // the same rays: most of their noise cancels
    }
    if (r.ledger.imbalance() > worst) worst = r.ledger.imbalance(), result.ledger = report(r.ledger);
  }
  result.seconds.optics = light.seconds();
  result.seconds.total = watch.seconds();
  return result;
}

EvaluationResult make_evaluation(const Options& o, Progress&) { throw Error("the command " + std::string(name(o.command)) + " is not part of this build"); }

}  // namespace lumo::program
