#include "computing/evaluation.hpp"
#include "computing/contacts.hpp"
#include "computing/provenance.hpp"
#include "computing/tools.hpp"
#include "computing/viewpoint.hpp"
#include "console/version.hpp"
#include "lumo/campaign/finger_campaign.hpp"
#include "lumo/study/assumptions.hpp"
#include "report/records.hpp"

#include <memory>
#include <new>
#include <type_traits>

namespace lumo::program {

Evaluation make_evaluation(const Configuration& o, int threads, Progress& progress) {
  const auto run = [&](const auto& pipeline) {
    return evaluate({o.pad.design(), o.pad.silicone, finger_options(o)}, o.ensemble, pipeline, TbbExecutor{threads},
        shown_in(progress));
  };
  const auto seen_by = [&](const auto& readout) {
    using Readout = std::decay_t<decltype(readout)>;
    return run(pipeline_for<Readout>(o, Light<Readout>(ray_numbers<Readout>(o), readout)));
  };
  using By = Observation::By;
  if (o.observation.by == By::camera) return seen_by(side_view(o.camera).cone(side_geometry(body_of(o))));
  if (o.observation.by == By::photodiodes) return seen_by(photodiode_row(o).before(side_geometry(body_of(o))));
  return run(pipeline_for(o));
}

std::vector<double> make_depths(const Configuration& o, int threads, Progress& progress) {
  const auto pipeline = pipeline_for(o);
  Body body = body_of(o);
  body.regions = 0;
  std::vector<double> depths;
  const auto observed = observe(body, o.ensemble.scenarios(), pipeline, TbbExecutor{threads}, shown_in(progress));
  for (const ScenarioRecord& s : observed.scenarios)
    depths.push_back(is_scored(s.status, o.mechanics.holds()) ? 1e3 * s.states.back().depth_m : undefined);
  return depths;
}

namespace {

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
Json run_notes(int threads) {
  static const Json machine = provenance();
  return {{"lumo", version}, {"threads", threads}, {"machine", machine}};
}

/// What a store keeps; whatever goes wrong in `work(record, notes, report)` is in the verdict, with the stage. What
/// lumo does not know as a failure of the design is taken for one of the machine.
template <class Work> TrialResult recorded(Json record, Json notes, Progress& progress, const Work& work) {
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

/// Each reading's objectives, lumo's own first; the verdict is about that, unless the machine failed with another.
template <class Results>
TrialResult put_assumptions(Json& record, const std::vector<AssumptionVariant>& rows, const Results& results) {
  TrialResult verdict = trial_result(results.front().evaluation);
  for (std::size_t k = 0; k < results.size(); ++k) {
    const auto& [why, evaluation] = results[k];
    record["readings"].push_back(
        {{"reading", k == 0 ? "lumo's own" : rows[k - 1].name()}, {"why", why.empty() ? Json(nullptr) : Json(why)}});
    append(record["readings"].back(), objectives(evaluation));
    if (k > 0 && is_machine_limit(evaluation.observations.scenarios))
      verdict = {{}, true, rows[k - 1].quantity + " " + rows[k - 1].value + ", " + why, "", ""};
  }
  return verdict;
}

/// For functions, which are copied.
template <class P> auto shared(P pipeline) { return std::make_shared<P>(std::move(pipeline)); }

}  // namespace

Evaluator campaign_evaluator(const Configuration& o, int threads, Progress& progress) {
  require_side_light(o);
  const auto pipeline = shared(pipeline_for(o));
  return [o, threads, &progress, pipeline](const Design& x) {
    const auto work = [&](Json& record, Json& notes, const ProgressReport& report_stage) {
      const Evaluation e = evaluate({FingerDesign::from(x), o.pad.silicone, finger_options(o)}, o.ensemble, *pipeline,
          TbbExecutor{threads}, report_stage);
      append(record, json(e));
      notes["seconds"] = json(e.observations.seconds);
      return trial_result(e, o.mechanics.holds());
    };
    return recorded({{"theta_mm", numbers(x)}, {"material", o.pad.material()}, {"ensemble", name(o.ensemble)}},
        run_notes(threads), progress, work);
  };
}

Evaluator study_evaluator(const StudyTools& o, const MatchedStudy& study, Progress& progress) {
  require_side_light(o.asked);
  const auto pipeline = shared(pipeline_for(o.asked));
  return [o, study, &progress, pipeline](const Design& x) {
    const auto work = [&](Json& record, Json& notes, const ProgressReport& report_stage) {
      const auto variants = compare_variants({FingerDesign::from(x), o.asked.pad.silicone, finger_options(o.asked)},
          o.asked.ensemble, study, *pipeline, TbbExecutor{o.threads}, report_stage);
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
    return recorded(
        {{"theta_mm", numbers(x)}, {"material", o.asked.pad.material()}}, run_notes(o.threads), progress, work);
  };
}

Evaluator assumptions_evaluator(const StudyTools& o, const std::vector<Scenario<Sphere>>& contacts,
    const std::vector<AssumptionVariant>& variants, Progress& progress) {
  require_side_light(o.asked);
  const double edges = o.coarse ? 1.4 : 1.0;
  auto usual_tools = pipeline_for(o.asked);
  if (o.coarse) {
    usual_tools.tracer = Light<ExitPower>({.rays_per_emitter = 1 << 14, .carrier_rays = 1 << 13, .exit_rays = 1 << 16});
    usual_tools.rays.tolerance = 0.04;
    usual_tools.focus = usual_tools.focus.scaled(edges);
  }
  const auto pipeline = shared(std::move(usual_tools));
  return [o, contacts, variants, edges, &progress, pipeline](const Design& x) {
    const auto work = [&](Json& record, Json&, const ProgressReport& report_stage) {
      const auto tools_for = [&](const FingerAssumptions& reading) {
        auto tools = *pipeline;
        Mechanics mechanics = o.asked.mechanics;
        mechanics.friction = reading.friction;
        tools.simulator = simulation(mechanics, reading.silicone);
        return tools;
      };
      FingerAssumptions usual = usual_assumptions(o.asked);
      usual.finger.mesh = usual.finger.mesh.coarser(edges);
      const auto results = evaluate_assumptions(
          FingerDesign::from(x), {usual, variants, contacts}, tools_for, TbbExecutor{o.threads}, report_stage);
      return put_assumptions(record, variants, results);
    };
    return recorded(
        {{"theta_mm", numbers(x)}, {"material", o.asked.pad.material()}}, run_notes(o.threads), progress, work);
  };
}

}  // namespace lumo::program
