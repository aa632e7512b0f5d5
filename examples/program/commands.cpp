#include "program/commands.hpp"

#include "lumo/campaign/finger_campaign.hpp"
#include "lumo/lab/observe_pad.hpp"
#include "lumo/study/assumptions.hpp"
#include "lumo/mesh/quality.hpp"
#include "lumo/optics/scattering_medium.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"
#include "program/contacts.hpp"
#include "program/doctor.hpp"
#include "program/json.hpp"
#include "program/pad.hpp"
#include "program/records.hpp"
#include "program/simulation.hpp"
#include "program/text.hpp"
#include "program/version.hpp"

#include <algorithm>
#include <map>
#include <memory>
#include <new>
#include <utility>

namespace lumo::program {

namespace {

template <ExitReadout Readout>
using Light = Tracer<ScatteringMedium, Readout, Embree>;   // without scattering, BeerLambert to the last bit

/// The tools that all commands share. Make it before threads start: the mesher forks a helper process.
template <ExitReadout Readout = ExitPower>
auto pipeline_for(const Options& o, Light<Readout> light = Light<Readout>()) {
  const Mechanics& m = o.mechanics;
  Pipeline<TetgenMesher, AnySimulation, Light<Readout>> p{TetgenMesher{}, simulation(m, silicone(o.material)), std::move(light)};
  p.focus = focus_of(m);
  p.mesh_order = m.mesh_order();
  p.accept_held = m.holds();
  p.rays.tolerance = o.ray_error_percent / 100.0;
  p.mirror_once = !m.holds();   // sweeps visit vertices one after the other: what they leave is not its own mirror image
  return p;
}

template <class P>
TetMesh mesh_of(const Options& o, const Body& body, const P& pipeline, Progress& progress, double& seconds) {
  const Stopwatch watch;
  progress.stage("mesh");
  TetMesh mesh = mesh_for_contact(body, mesh_body(body, pipeline.mesher), std::vector{scenario_of(o)}, pipeline.mesher, pipeline.focus, pipeline.mesh_order);
  progress.step();
  seconds = watch.seconds();
  return mesh;
}

ProgressReport shown_in(Progress& progress) {
  return [&progress, stage = std::string()](std::string_view now, int done, int total) mutable {
    if (now != stage) progress.stage(stage = now, total);
    if (done > 0) progress.step();
  };
}

std::vector<double> per_power(const Response& r, const std::vector<double>& watts) {
  std::vector<double> out = watts;
  for (double& v : out) v /= r.ledger.emitted;
  return out;
}

/// The part of a press that a trace shares.
template <class P>
PressResult pressed(const Options& o, const Body& body, const P& pipeline, Progress& progress) {
  PressResult result;
  Observations& seen = result.seen;
  seen.seconds = {undefined, undefined, undefined, undefined};
  result.mesh = mesh_of(o, body, pipeline, progress, seen.seconds.mesh);
  seen.nodes = result.mesh.nodes.size();
  seen.elements = result.mesh.tets.size();
  const Stopwatch watch;
  progress.stage("press");
  const Scenario<Sphere> scenario = scenario_of(o);
  result.states = pipeline.simulator.prepare(body, result.mesh).press(scenario);
  seen.scenarios = {record_of(body, result.mesh, scenario, result.states, pipeline.mechanical_error)};
  seen.seconds.mechanics = watch.seconds();
  if (is_scored(result.scenario().status, true)) progress.step();   // else it is not done
  return result;
}

Json json(const VariantResult& v) {
  Json j = {{"variant", to_string(v.twin)}, {"why", v.why.empty() ? Json(nullptr) : Json(v.why)}};
  put(j, "J_contact", v.J_contact);
  put(j, "D", v.change);
  j["scenarios"] = Json::array();
  for (const ScenarioRecord& s : v.observations.scenarios) j["scenarios"].push_back(program::json(s));
  j["mesh"] = mesh_size(v.observations.nodes, v.observations.elements);
  return j;
}

/// What another run may have otherwise.
Json run_notes(const Options& o) {
  static const Json machine = provenance();
  return {{"lumo", version}, {"threads", o.threads}, {"machine", machine}};
}

/// What a store keeps; whatever goes wrong in `work(record, notes, report)` is in the verdict, with the stage. What lumo does not know as a failure of
/// the design is taken for one of the machine.
template <class Work>
TrialResult recorded(Json record, Json notes, Progress& progress, const Work& work) {
  const Stopwatch watch;
  std::string stage = "start";
  const ProgressReport shown = progress.watched() ? shown_in(progress) : ProgressReport{};
  const auto report = [&](std::string_view now, int done, int total) {
    stage = now;
    if (shown) shown(now, done, total);
  };
  TrialResult verdict;
  const auto fail = [&](bool retry, const char* why) { verdict = {{}, retry, stage + ": " + why, "", ""}; };
  try {
    verdict = work(record, notes, report);
  } catch (const MeshError& e) {
    verdict = trial_result(e);
  } catch (const std::bad_alloc&) {
    fail(true, "out of memory");
  } catch (const InvalidArgument& e) {
    fail(false, e.what());
  } catch (const std::exception& e) {
    fail(true, e.what());
  }
  if (!verdict.why.empty()) record["why"] = verdict.why;
  if (!notes.contains("seconds")) notes["seconds"] = {{"total", watch.seconds()}};
  verdict.record = record.dump();
  verdict.notes = notes.dump();
  return verdict;
}

}  // namespace

MeshResult make_mesh(const Options& o, Progress& progress) {
  MeshResult result;
  const Body body = body_of(o);
  result.mesh = mesh_of(o, body, pipeline_for(o), progress, result.seconds);
  result.quality = measure(result.mesh);
  result.exact_volume_m3 = body.exact_volume_m3;
  return result;
}

PressResult make_press(const Options& o, Progress& progress) {
  const Stopwatch watch;
  PressResult result = pressed(o, body_of(o), pipeline_for(o), progress);
  result.seen.seconds.total = watch.seconds();
  return result;
}

std::vector<PressOutcome> make_presses(const std::vector<Options>& requests, int threads, Progress& progress) {
  std::map<std::pair<std::string, bool>, decltype(pipeline_for(Options{}))> pipelines;   // all before threads start
  for (const Options& o : requests)
    if (const std::pair kind(o.material, o.mechanics.paper); !pipelines.contains(kind)) pipelines.emplace(kind, pipeline_for(o));
  std::vector<PressOutcome> outcomes(requests.size());
  progress.stage("press", int(requests.size()));
  TbbExecutor{threads}.for_each(requests.size(), [&](std::size_t k) {
    const Options& o = requests[k];
    Progress silent(true);
    try {
      outcomes[k].press = pressed(o, body_of(o), pipelines.at({o.material, o.mechanics.paper}), silent);
    } catch (const Error& e) {
      outcomes[k].why = e.what();
    } catch (const std::bad_alloc&) {
      outcomes[k].why = "out of memory";
    }
    progress.step();
  });
  return outcomes;
}

TraceResult make_trace(const Options& o, Progress& progress) {
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
  const Symmetry symmetry = symmetry_of(body, press.mesh, scenario_of(o), press.states.back().status);
  std::vector<Response> responses(press.states.size() + 1);   // the unloaded one first
  TbbExecutor{o.threads}.for_each(responses.size(), [&](std::size_t k) {
    responses[k] = k == 0 ? pipeline.tracer.trace(body, press.mesh) : pipeline.tracer.trace(body, press.mesh, press.states[k - 1], symmetry);
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
      state.change_error = per_power(r, standard_error(r.replicates - responses[0].replicates));   // the same rays: most of their noise cancels
    }
    if (!(r.ledger.imbalance() > worst)) continue;
    worst = r.ledger.imbalance();
    seen.ledger = r.ledger;
  }
  seen.seconds.optics = light.seconds();
  seen.seconds.total = watch.seconds();
  return result;
}

Evaluation make_evaluation(const Options& o, Progress& progress) {
  const auto pipeline = pipeline_for(o);
  return evaluate({FingerDesign::from(o.theta_mm), silicone(o.material), finger_options(o.mechanics)}, contacts(o.ensemble), pipeline, TbbExecutor{o.threads},
                  shown_in(progress));
}

std::vector<double> make_depths(const Options& o, const std::array<double, 5>& theta_mm, const lumo::Ensemble& ensemble, Progress& progress) {
  const auto pipeline = pipeline_for(o);
  Body body = finger(FingerDesign::from(theta_mm), silicone(o.material), finger_options(o.mechanics));
  body.regions = 0;
  std::vector<double> depths;
  for (const ScenarioRecord& s : observe(body, ensemble.scenarios(), pipeline, TbbExecutor{o.threads}, shown_in(progress)).scenarios)
    depths.push_back(is_scored(s.status, o.mechanics.holds()) ? 1e3 * s.states.back().depth_m : undefined);
  return depths;
}

namespace {

/// What the virtual lab computes its light with. Coarse: three places, for trying out; contacts in between are then far from right.
struct PadSettings {
  PadGrid grid;
  SideSight sight;
  FingerOptions finger;
  Focus focus;
  Light<SideSight>::Config rays;

  explicit PadSettings(bool coarse) {
    // A half as fine about the contact as elsewhere: depths are within 0.2 % of the default mesh's (y = 5 mm, 1 to 20 N), in less than half of the time.
    focus = {0.4e-3, 0.2, 0.8};
    grid.tilt_place_m = {0.0, 22.0_mm};
    rays.rays_per_emitter = 1 << 17, rays.carrier_rays = 1 << 17, rays.exit_rays = 1 << 19;
    if (!coarse) return;
    grid.places = 3, grid.spacing_m = 13.0_mm, grid.load_N = {2.0, 5.0, 20.0}, grid.tilt_place_m = {13.0_mm};
    finger.mesh.contact_edge = finger.mesh.coarsest_edge = 6.0_mm;
    focus = {1.2e-3, 0.4, 1.0};
    rays.rays_per_emitter = 1 << 12, rays.carrier_rays = 1 << 14, rays.exit_rays = 1 << 16;
  }
};

}  // namespace

std::string pad_responses_key(const Options& o) {
  const PadSettings s(o.coarse);
  return lumo::text("lab 1, lumo ", version, ", theta ", joined(o.theta_mm), " mm, ", o.material, ", sphere ", 1e3 * s.grid.diameter_m, " mm, ", s.grid.places, " places every ",
                            1e3 * s.grid.spacing_m, " mm, loads ", joined(s.grid.load_N), " N, finest edge ", 1e3 * s.focus.finest, " mm, surface edge ", 1e3 * s.finger.mesh.contact_edge,
                            " mm, rays ", s.rays.rays_per_emitter, " ", s.rays.carrier_rays, " ", s.rays.exit_rays, ", bins ", s.sight.bins);
}

PadResponses make_pad_responses(const Options& o, Progress& progress) {
  const PadSettings s(o.coarse);
  auto pipeline = pipeline_for(o, Light<SideSight>(s.rays, s.sight));
  pipeline.focus = s.focus;
  pipeline.rays.rounds = 0;
  const Body body = finger(FingerDesign::from(o.theta_mm), silicone(o.material), s.finger);
  PadResponses r = observe_pad(body, s.sight, s.grid, pipeline, TbbExecutor{o.threads}, shown_in(progress));
  r.theta_mm.assign(o.theta_mm.begin(), o.theta_mm.end());
  r.material = o.material;
  return r;
}

Evaluator campaign_evaluator(const Options& o, Progress& progress) {
  return [o, &progress, pipeline = std::make_shared<decltype(pipeline_for(o))>(pipeline_for(o))](const Design& x) {
    const auto work = [&](Json& record, Json& notes, const ProgressReport& report_stage) {
      const Evaluation e =
          evaluate({FingerDesign::from(x), silicone(o.material), finger_options(o.mechanics)}, contacts(o.ensemble), *pipeline, TbbExecutor{o.threads}, report_stage);
      append(record, json(e));
      notes["seconds"] = json(e.observations.seconds);
      return trial_result(e, o.mechanics.holds());
    };
    return recorded({{"theta_mm", numbers(x)}, {"material", o.material}, {"ensemble", name(o.ensemble)}}, run_notes(o), progress, work);
  };
}

Evaluator study_evaluator(const Options& o, const MatchedStudy& study, const lumo::Ensemble& ensemble, Progress& progress) {
  return [o, study, ensemble, &progress, pipeline = std::make_shared<decltype(pipeline_for(o))>(pipeline_for(o))](const Design& x) {
    const auto work = [&](Json& record, Json& notes, const ProgressReport& report_stage) {
      const auto variants = compare_variants({FingerDesign::from(x), silicone(o.material)}, ensemble, study, *pipeline, TbbExecutor{o.threads}, report_stage);
      TrialResult verdict;
      notes["seconds"] = Json::object();
      for (const VariantResult& v : variants) {
        record["variants"].push_back(json(v));
        notes["seconds"][std::string(to_string(v.twin))] = json(v.observations.seconds);
        verdict.retry = verdict.retry || is_machine_limit(v.observations.scenarios);
      }
      verdict.why = variants.front().why;
      if (variants.front().J_contact) verdict.outputs = {variants.front().J_contact->value};
      else if (verdict.why.empty()) verdict.why = "objective: the loads do not define the terms of J_contact";
      return verdict;
    };
    return recorded({{"theta_mm", numbers(x)}, {"material", o.material}}, run_notes(o), progress, work);
  };
}

Evaluator readings_evaluator(const Options& o, const std::vector<Scenario<Sphere>>& contacts, Progress& progress) {
  const double edges = o.coarse ? 1.4 : 1.0;
  auto usual_tools = pipeline_for(o);
  if (o.coarse) {
    usual_tools.tracer = Light<ExitPower>({.rays_per_emitter = 1 << 14, .carrier_rays = 1 << 13, .exit_rays = 1 << 16});
    usual_tools.rays.tolerance = 0.04;
    usual_tools.focus = usual_tools.focus.scaled(edges);
  }
  return [o, contacts, edges, &progress, pipeline = std::make_shared<decltype(usual_tools)>(std::move(usual_tools))](const Design& x) {
    const auto work = [&](Json& record, Json&, const ProgressReport& report_stage) {
      const auto tools_for = [&](const FingerAssumptions& reading) {
        auto tools = *pipeline;
        Mechanics mechanics;
        mechanics.friction = reading.friction;
        tools.simulator = simulation(mechanics, reading.silicone);
        return tools;
      };
      const std::vector<AssumptionVariant> rows = assumption_variants();
      FingerAssumptions usual{silicone(o.material), {}};
      usual.finger.mesh = usual.finger.mesh.scaled(edges);
      const auto results = evaluate_assumptions(FingerDesign::from(x), {usual, rows, contacts}, tools_for, TbbExecutor{o.threads}, report_stage);
      for (std::size_t k = 0; k < results.size(); ++k) {
        const std::string& why = results[k].why;
        record["readings"].push_back({{"reading", k == 0 ? "lumo's own" : rows[k - 1].name()}, {"why", why.empty() ? Json(nullptr) : Json(why)}});
        append(record["readings"].back(), objectives(results[k].evaluation));
      }
      TrialResult verdict = trial_result(results.front().evaluation);
      for (std::size_t k = 1; k < results.size(); ++k)
        if (is_machine_limit(results[k].evaluation.observations.scenarios)) verdict = {{}, true, rows[k - 1].quantity + " " + rows[k - 1].value + ", " + results[k].why, "", ""};
      return verdict;
    };
    return recorded({{"theta_mm", numbers(x)}, {"material", o.material}}, run_notes(o), progress, work);
  };
}

}  // namespace lumo::program
