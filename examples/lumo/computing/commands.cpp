#include "computing/commands.hpp"

#include "lumo/campaign/finger_campaign.hpp"
#include "lumo/campaign/observe_pad.hpp"
#include "lumo/campaign/readings.hpp"
#include "lumo/mesh/quality.hpp"
#include "lumo/optics/scattering_medium.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"
#include "computing/contacts.hpp"
#include "commands/doctor.hpp"
#include "report/json.hpp"
#include "computing/pad.hpp"
#include "report/press_report.hpp"
#include "computing/simulation.hpp"
#include "console/text.hpp"
#include "console/version.hpp"

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
  const lumo::detail::Stopwatch watch;
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

Seconds report(const Timing& t) { return {t.mesh, t.mechanics, t.optics, t.total}; }

Ledger report(const EnergyLedger& e) {
  double regions = 0.0;
  for (const double c : e.channels) regions += c;
  const double physical = regions + e.to_indenter + e.elsewhere + e.absorbed_in_medium + e.absorbed_at_surfaces + e.lost, p = e.emitted;
  return {1.0, regions / p, e.to_indenter / p, e.elsewhere / p, e.absorbed_in_medium / p, e.absorbed_at_surfaces / p, (e.accounted() - physical) / p, e.lost / p};
}

/// The part of a press that a trace shares.
template <class P>
PressResult pressed(const Options& o, const Body& body, const P& pipeline, Progress& progress) {
  PressResult result;
  result.mesh = mesh_of(o, body, pipeline, progress, result.seconds.mesh);
  result.size = {result.mesh.nodes.size(), result.mesh.tets.size()};
  const lumo::detail::Stopwatch watch;
  progress.stage("press");
  const Scenario<Sphere> scenario = scenario_of(o);
  result.states = pipeline.simulator.prepare(body, result.mesh).press(scenario);
  report_terms(result.scenario, contact_terms(body, result.mesh, result.states, scenario.indenter.radius_m(), pipeline.mechanical_error));
  result.seconds.mechanics = watch.seconds();
  if (std::all_of(result.states.begin(), result.states.end(), [](const auto& s) { return is_scored(s.status, true); })) progress.step();   // else it is not done

  result.scenario.diameter_mm = o.diameter_mm, result.scenario.angle_deg = o.angle_deg, result.scenario.y_mm = o.y_mm;
  for (const auto& s : result.states) {
    result.scenario.states.push_back(report_state(s));
    result.scenario.status = std::string(to_string(s.status));
    if (!is_scored(s.status, true)) break;
  }
  return result;
}

/// As people give them: 30, where 30 · π/180 · 180/π is an ulp below.
double degrees(double rad) { return as_typed(rad * 180.0 / pi); }

ScenarioReport report(const ScenarioRecord& s) {
  ScenarioReport report;
  report.diameter_mm = 1e3 * s.diameter_m, report.angle_deg = degrees(s.angle_rad), report.y_mm = 1e3 * s.y_m;
  report.status = std::string(to_string(s.status));
  report_terms(report, s.terms);
  for (const StateRecord& k : s.states) {
    StateReport state = report_state(k);
    state.response = k.response;
    if (k.change.size() > 0) state.change_error = standard_error(k.change);
    report.states.push_back(std::move(state));
  }
  return report;
}

EvaluationResult report(const Evaluation& e) {
  const Observations& seen = e.observations;
  EvaluationResult result;
  const auto record = [](const std::optional<Estimate>& j, double& value, double& error) {
    if (j) value = j->value, error = j->error;
  };
  record(e.J_contact, result.J_contact, result.J_contact_err);
  record(e.J_obs, result.J_obs, result.J_obs_err);
  for (const ScenarioRecord& s : seen.scenarios) result.scenarios.push_back(report(s));
  if (e.worst_contact) {
    const ScenarioReport& s = result.scenarios[*e.worst_contact];
    result.worst_contact = WorstContact{s.diameter_mm, s.angle_deg, s.y_mm, result.J_contact};
  }
  if (e.worst_observation) {
    const ObservedState &a = e.observed[e.worst_observation->first], &b = e.observed[e.worst_observation->second];
    result.worst_observation = WorstObservation{1e3 * a.diameter_m, degrees(a.angle_rad), a.load_N, 1e3 * a.y_m, 1e3 * b.y_m, result.J_obs};
  }
  result.unloaded_response = seen.unloaded_response;
  result.unloaded_error = seen.unloaded_error;
  result.ledger = report(seen.ledger);
  result.size = {seen.nodes, seen.elements};
  result.seconds = report(seen.seconds);
  return result;
}

Json json(const VariantResult& v) {
  Json j = {{"variant", to_string(v.twin)}, {"why", v.why.empty() ? Json(nullptr) : Json(v.why)}};
  const auto add = [&](const char* key, const std::optional<Estimate>& e) {
    j[key] = e ? number(e->value) : Json(nullptr);
    j[std::string(key) + "_err"] = e ? number(e->error) : Json(nullptr);
  };
  add("J_contact", v.J_contact);
  add("D", v.change);
  j["scenarios"] = Json::array();
  for (const ScenarioRecord& s : v.observations.scenarios) j["scenarios"].push_back(json(report(s)));
  j["mesh"] = json(MeshReport{v.observations.nodes, v.observations.elements});
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
Verdict recorded(Json record, Json notes, Progress& progress, const Work& work) {
  const lumo::detail::Stopwatch watch;
  std::string stage = "start";
  const ProgressReport shown = progress.watched() ? shown_in(progress) : ProgressReport{};
  const auto report = [&](std::string_view now, int done, int total) {
    stage = now;
    if (shown) shown(now, done, total);
  };
  Verdict verdict;
  const auto fail = [&](bool retry, const char* why) { verdict = {{}, retry, stage + ": " + why, "", ""}; };
  try {
    verdict = work(record, notes, report);
  } catch (const MeshError& e) {
    verdict = verdict_of(e);
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
  const lumo::detail::Stopwatch watch;
  PressResult result = pressed(o, body_of(o), pipeline_for(o), progress);
  result.seconds.total = watch.seconds();
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
  const lumo::detail::Stopwatch watch;
  const Body body = body_of(o);
  const auto pipeline = pipeline_for(o);
  TraceResult result;
  result.press = pressed(o, body, pipeline, progress);
  result.scenario = result.press.scenario;
  const PressResult& press = result.press;
  if (!is_scored(press.states.back().status, true)) return result;

  const lumo::detail::Stopwatch light;
  progress.stage("trace", int(press.states.size()) + 1);
  const Symmetry symmetry = symmetry_of(body, press.mesh, scenario_of(o), press.states.back().status);
  std::vector<Response> responses(press.states.size() + 1);   // the unloaded one first
  TbbExecutor{o.threads}.for_each(responses.size(), [&](std::size_t k) {
    responses[k] = k == 0 ? pipeline.tracer.trace(body, press.mesh) : pipeline.tracer.trace(body, press.mesh, press.states[k - 1], symmetry);
    progress.step();
  });
  result.unloaded_response = per_power(responses[0], responses[0].power_W);
  result.unloaded_error = per_power(responses[0], responses[0].error_W);
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
  result.press.seconds.optics = light.seconds();
  result.press.seconds.total = watch.seconds();
  return result;
}

EvaluationResult make_evaluation(const Options& o, Progress& progress) {
  const auto pipeline = pipeline_for(o);
  return report(evaluate(FingerDesign::from(o.theta_mm), silicone(o.material), contacts(o.ensemble), pipeline, finger_options(o.mechanics), TbbExecutor{o.threads},
                         shown_in(progress)));
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
  return lumo::detail::text("lab 1, lumo ", version, ", theta ", joined(o.theta_mm), " mm, ", o.material, ", sphere ", 1e3 * s.grid.diameter_m, " mm, ", s.grid.places, " places every ",
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
          evaluate(FingerDesign::from(x), silicone(o.material), contacts(o.ensemble), *pipeline, finger_options(o.mechanics), TbbExecutor{o.threads}, report_stage);
      const EvaluationResult result = report(e);
      append(record, json(result));
      notes["seconds"] = json(result.seconds);
      return verdict_of(e, o.mechanics.holds());
    };
    return recorded({{"theta_mm", numbers(x)}, {"material", o.material}, {"ensemble", name(o.ensemble)}}, run_notes(o), progress, work);
  };
}

Evaluator study_evaluator(const Options& o, const MatchedStudy& study, const lumo::Ensemble& ensemble, Progress& progress) {
  return [o, study, ensemble, &progress, pipeline = std::make_shared<decltype(pipeline_for(o))>(pipeline_for(o))](const Design& x) {
    const auto work = [&](Json& record, Json& notes, const ProgressReport& report_stage) {
      const auto variants = compare_variants(FingerDesign::from(x), silicone(o.material), ensemble, study, *pipeline, {}, TbbExecutor{o.threads}, report_stage);
      Verdict verdict;
      notes["seconds"] = Json::object();
      for (const VariantResult& v : variants) {
        record["variants"].push_back(json(v));
        notes["seconds"][std::string(to_string(v.twin))] = json(report(v.observations.seconds));
        verdict.retry = verdict.retry || of_the_machine(v.observations.scenarios);
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
      const auto tools_for = [&](const FingerReading& reading) {
        auto tools = *pipeline;
        Mechanics mechanics;
        mechanics.friction = reading.friction;
        tools.simulator = simulation(mechanics, reading.silicone);
        return tools;
      };
      const std::vector<Departure> rows = departures();
      FingerReading usual{silicone(o.material), {}};
      usual.finger.mesh = usual.finger.mesh.scaled(edges);
      const auto results = evaluate_readings(FingerDesign::from(x), usual, rows, contacts, tools_for, TbbExecutor{o.threads}, report_stage);
      for (std::size_t k = 0; k < results.size(); ++k) {
        const EvaluationResult r = report(results[k].evaluation);
        const std::string& why = results[k].why;
        record["readings"].push_back({{"reading", k == 0 ? "lumo's own" : rows[k - 1].name()},
                                      {"why", why.empty() ? Json(nullptr) : Json(why)},
                                      {"J_contact", number(r.J_contact)},
                                      {"J_contact_err", number(r.J_contact_err)},
                                      {"J_obs", number(r.J_obs)},
                                      {"J_obs_err", number(r.J_obs_err)},
                                      {"worst_contact", r.worst_contact ? json(*r.worst_contact) : Json(nullptr)},
                                      {"worst_observation", r.worst_observation ? json(*r.worst_observation) : Json(nullptr)}});
      }
      Verdict verdict = verdict_of(results.front().evaluation);
      for (std::size_t k = 1; k < results.size(); ++k)
        if (of_the_machine(results[k].evaluation.observations.scenarios)) verdict = {{}, true, rows[k - 1].quantity + " " + rows[k - 1].value + ", " + results[k].why, "", ""};
      return verdict;
    };
    return recorded({{"theta_mm", numbers(x)}, {"material", o.material}}, run_notes(o), progress, work);
  };
}

}  // namespace lumo::program
