#include "commands/campaigns.hpp"
#include "computing/evaluation.hpp"
#include "console/text.hpp"
#include "store/campaign_problem.hpp"
#include "store/emptied_store.hpp"
#include "store/known_results.hpp"
#include "store/open_store.hpp"

#include "lumo/campaign/campaign.hpp"

namespace lumo::program {

namespace {

template <class State> std::string line(const State& state, int id, const TrialResult& v, Pace& pace) {
  const auto& optimizer = state.optimizer();
  const int done = optimizer.observed(), wanted = optimizer.problem().evaluations;
  std::string text = pad(std::to_string(done), 3) + "/" + std::to_string(wanted) + "  #" + pad(std::to_string(id), -3) +
                     " " + pad(joined(optimizer.trials()[std::size_t(id)].x), -20) + "  ";
  if (v.outputs.empty()) text += "failed, " + v.why;
  else text += "J_contact " + cell(v.outputs[0], 4) + "  J_obs " + scientific(v.outputs[1]);
  return text + "  " + hypervolume_text(optimizer.standing()) + "  " + pace.after(wanted - done, !v.outputs.empty());
}

struct CampaignRun : Configured {
  std::string store, known;
  int threads = all_threads();

  CampaignRun() {
    // One design must not stop a search. By far more than a press takes, so that no ordinary machine meets it.
    Configuration defaults;
    defaults.mechanics.time_limit_s = 3600.0;
    effective = Effective(defaults);
  }
  void declare(CLI::App& app) {
    add_store(app, store);
    add_common(app, *this);
    declare_configuration(app);
    add_material(app, effective);
    add_ensemble(app, effective);
    add_mode(app, effective);
    add_ray_error(app, effective);
    add_time_limit(app, effective, "3600");
    add_setting(app, effective, "--evaluations", "search.evaluations", "Successful evaluations to reach, default 160");
    add_setting(app, effective, "--seed", "search.seed", "Of the optimiser, default 1");
    add_setting(app, effective, "--source", "search.source",
        "Where candidates come from: default (with neighbours of the front) or paper (256 fresh ones)");
    add_setting(app, effective, "--pending", "search.pending",
        "Designs under way at once, whatever the number of workers, default 1; part of the problem");
    add_text(app, "--known", known, "FILE|STORE",
        "Earlier results, which the models know from the start: a table (CSV) or another campaign's store");
    add_threads(app, threads);
  }
  Result run(Output&, Progress& progress) const {
    const Evaluator evaluate = campaign_evaluator(asked(), threads, progress);
    tell_if_emptied(store, progress);
    const CampaignProblem problem =
        continued(CampaignProblem{asked()}, store, {known, effective.gives("search.noise")}, progress);
    CampaignConfig config;
    config.pending = asked().search.pending;
    Pace pace;
    const OptimizerStatus end = with_store(store, problem_text(problem), [&](auto& log) {
      if (const int taken = int(log.claims().size()); taken >= *config.pending)
        progress.note(lumo::message("other workers have the ", taken,
            " designs that --pending lets be under way: this one waits until a design is free"));
      return with_optimizer(problem, asked().search.evaluations, [&](const auto& optimizer) {
        return run_campaign(
            log, optimizer, evaluate,
            [&](const auto& state, int id, const TrialResult& v) { progress.note(line(state, id, v, pace)); }, config);
      });
    });
    if (end == OptimizerStatus::exhausted) progress.note("every feasible design that could be found was evaluated");
    return campaign_status(store, json, asked().search.evaluations);
  }
};

}  // namespace

void add_campaign_run(CommandLine& line) {
  line.add<CampaignRun>(
      "campaign run", "Evaluate until the store holds enough; continues one that is there, beside other workers");
}

}  // namespace lumo::program
