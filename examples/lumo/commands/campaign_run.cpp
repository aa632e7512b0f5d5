#include "commands/campaigns.hpp"
#include "computing/evaluation.hpp"
#include "console/text.hpp"
#include "store/campaign_problem.hpp"
#include "store/emptied_store.hpp"

#include "lumo/support/sqlite.hpp"

namespace lumo::program {

namespace {

template <class State> std::string line(const State& state, int id, const TrialResult& v, Pace& pace) {
  const auto& optimizer = state.optimizer();
  const int done = optimizer.observed(), wanted = optimizer.problem().evaluations;
  std::string text = pad(std::to_string(done), 3) + "/" + std::to_string(wanted) + "  #" + pad(std::to_string(id), -3) +
                     " " + pad(joined(optimizer.trials()[std::size_t(id)].x), -20) + "  ";
  if (v.outputs.empty()) text += "failed, " + v.why;
  else text += "J_contact " + cell(v.outputs[0], 4) + "  J_obs " + scientific(v.outputs[1]);
  return text + "  hypervolume " + scientific(optimizer.hypervolume()) + "  " +
         pace.after(wanted - done, !v.outputs.empty());
}

struct CampaignRun : StoreCommand {
  EvaluationRequest request;
  int evaluations = 160, seed = 1, threads = all_threads();
  std::string source = "default";  ///< of candidates

  void declare(CLI::App& app) {
    StoreCommand::declare(app);
    add_material(app, request.material);
    add_ensemble(app, request.ensemble);
    add_mode(app, request.mechanics);
    add_ray_error(app, request.ray_error_percent);
    add_whole(app, "--evaluations", evaluations, 1, 100000, "Successful evaluations to reach, default 160");
    add_seed(app, seed, "Of the optimiser, default 1");
    add_word(app, "--source", source, {"default", "paper"},
        "Where candidates come from: default (with neighbours of the front) or paper (256 fresh ones)");
    add_threads(app, threads);
  }
  Result run(Output&, Progress& progress) const {
    const Evaluator evaluate = campaign_evaluator(request, threads, progress);
    const CampaignProblem problem{request.material, request.ensemble, source, std::uint64_t(seed),
        request.mechanics.paper, request.ray_error_percent};
    tell_if_emptied(store, progress);
    SqliteJournal log(store, problem_text(problem));
    Pace pace;
    const OptimizerStatus end = with_optimizer(problem, evaluations, [&](const auto& optimizer) {
      return run_campaign(log, optimizer, evaluate,
          [&](const auto& state, int id, const TrialResult& v) { progress.note(line(state, id, v, pace)); });
    });
    if (end == OptimizerStatus::exhausted) progress.note("every feasible design that could be found was evaluated");
    return campaign_status(store, json);
  }
};

}  // namespace

void add_campaign_run(CommandLine& line) {
  line.add<CampaignRun>("campaign run", "Evaluate until the store holds enough; continues if the file exists");
}

}  // namespace lumo::program
