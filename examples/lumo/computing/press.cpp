#include "computing/press.hpp"

#include "computing/tools.hpp"
#include "report/records.hpp"

#include "lumo/mesh/quality.hpp"

#include <new>

namespace lumo::program {

namespace {

template <class P>
TetMesh mesh_of(const Configuration& o, const Body& body, const P& pipeline, Progress& progress, double& seconds) {
  const Stopwatch watch;
  progress.stage("mesh");
  TetMesh mesh = mesh_for_contact(body, mesh_body(body, pipeline.mesher), std::vector{scenario_of(o.touch)},
      pipeline.mesher, pipeline.focus, pipeline.mesh_order);
  progress.step();
  seconds = watch.seconds();
  return mesh;
}

std::vector<double> per_power(const Response& r, const std::vector<double>& watts) {
  std::vector<double> out = watts;
  for (double& v : out) v /= r.ledger.emitted;
  return out;
}

/// A line for each load as it ends, and on a terminal where the press is in between.
PressWatch shown_loads(const Configuration& o, Progress& progress) {
  const char* const work = o.mechanics.holds() ? " sweeps" : " factorisations";
  return [&progress, work](const PressReport& r) {
    const std::string left = r.residual ? ", residual " + scientific(*r.residual, 1) + " of the load" : "";
    const std::string spent = lumo::message(", ", r.iterations, work, left);
    if (r.ended)
      progress.at(lumo::message(short_number(r.wanted_N), " N: depth ", cell(1e3 * r.depth_m, 4), " mm", spent, ", ",
                      to_string(*r.ended)),
          true);
    else progress.at(lumo::message(cell(r.load_N, 3), " of ", short_number(r.wanted_N), " N", spent), false);
  };
}

/// The part of a press that a trace shares. `pipeline` solves each contact where it is, not its mirror image.
template <class P> PressResult pressed(const Configuration& o, const Body& body, P pipeline, Progress& progress) {
  pipeline.mirror_once = false;
  pipeline.simulator = simulation(o.mechanics, o.pad.silicone, shown_loads(o, progress));
  auto done = press(body, std::vector{scenario_of(o.touch)}, pipeline, Serial{}, shown_in(progress));
  PressResult result;
  Observations& seen = result.seen;
  result.mesh = done.places.front()->mesh();
  result.states = std::move(done.solved.front().states);
  seen.scenarios = {std::move(done.solved.front().record)};
  seen.seconds = {done.seconds.mesh, done.seconds.mechanics, undefined, undefined};
  seen.nodes = result.mesh.nodes.size();
  seen.elements = result.mesh.tets.size();
  return result;
}

}  // namespace

MeshResult make_mesh(const Configuration& o, Progress& progress) {
  MeshResult result;
  const Body body = body_of(o);
  result.mesh = mesh_of(o, body, pipeline_for(o), progress, result.seconds);
  result.quality = measure(result.mesh);
  result.exact_volume_m3 = body.exact_volume_m3;
  return result;
}

PressResult make_press(const Configuration& o, Progress& progress) {
  const Stopwatch watch;
  PressResult result = pressed(o, body_of(o), pipeline_for(o), progress);
  result.seen.seconds.total = watch.seconds();
  return result;
}

std::vector<PressOutcome> make_presses(const std::vector<Configuration>& requests, int threads, Progress& progress) {
  std::vector<decltype(pipeline_for(Configuration{}))> pipelines;  // all before threads start
  for (const Configuration& o : requests) pipelines.push_back(pipeline_for(o));
  std::vector<PressOutcome> outcomes(requests.size());
  progress.stage("press", int(requests.size()));
  TbbExecutor{threads}.for_each(requests.size(), [&](std::size_t k) {
    const Configuration& o = requests[k];
    Progress silent(true);
    try {
      outcomes[k].press = pressed(o, body_of(o), pipelines[k], silent);
    } catch (const Error& e) {
      outcomes[k].why = e.what();
    } catch (const std::bad_alloc&) {
      outcomes[k].why = "out of memory";
    }
    progress.step();
  });
  return outcomes;
}

TraceResult make_trace(const Configuration& o, int threads, Progress& progress) {
  require_side_light(o);
  const Stopwatch watch;
  const Body body = body_of(o);
  const auto pipeline = pipeline_for(o);
  TraceResult result;
  PressResult& press = result.press;
  press = pressed(o, body, pipeline, progress);
  Observations& seen = press.seen;
  if (!is_scored(press.states.back().status, true)) return result;

  const Stopwatch light;
  progress.stage("trace", int(press.states.size()) + 1);
  const Symmetry symmetry = symmetry_of(body, press.mesh, scenario_of(o.touch), press.states.back().status);
  std::vector<Response> responses(press.states.size() + 1);  // the unloaded one first
  TbbExecutor{threads}.for_each(responses.size(), [&](std::size_t k) {
    responses[k] = k == 0 ? pipeline.tracer.trace(body, press.mesh)
                          : pipeline.tracer.trace(body, press.mesh, press.states[k - 1], symmetry);
    progress.step();
  });
  seen.unloaded_response = per_power(responses[0], responses[0].power_W);
  seen.unloaded_error = per_power(responses[0], responses[0].error_W);
  double worst = -1.0;
  for (std::size_t k = 0; k < responses.size(); ++k) {
    const Response& r = responses[k];
    if (k > 0) {
      StateRecord& state = seen.scenarios.front().states[k - 1];
      state.response = per_power(r, r.power_W);
      state.change_error = per_power(
          r, standard_error(r.replicates - responses[0].replicates));  // the same rays: most of their noise cancels
    }
    if (!(r.ledger.imbalance() > worst)) continue;
    worst = r.ledger.imbalance();
    seen.ledger = r.ledger;
  }
  seen.seconds.optics = light.seconds();
  seen.seconds.total = watch.seconds();
  return result;
}

}  // namespace lumo::program
