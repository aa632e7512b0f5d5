#include "program/campaign.hpp"

#include "program/campaign_problem.hpp"
#include "program/commands.hpp"
#include "program/emptied_store.hpp"
#include "program/text.hpp"

#include "lumo/support/sqlite.hpp"

namespace lumo::program {

namespace {

template <class State>
std::string line(const State& state, int id, const TrialResult& v, Pace& pace) {
  const auto& optimizer = state.optimizer();
  const int told = optimizer.observed(), wanted = optimizer.problem().evaluations;
  std::string text = pad(std::to_string(told), 3) + "/" + std::to_string(wanted) + "  #" + pad(std::to_string(id), -3) + " " + pad(joined(optimizer.trials()[std::size_t(id)].x), -20) + "  ";
  if (v.outputs.empty()) text += "failed, " + v.why;
  else text += "J_contact " + cell(v.outputs[0], 4) + "  J_obs " + scientific(v.outputs[1]);
  return text + "  hypervolume " + scientific(optimizer.hypervolume()) + "  " + pace.after(wanted - told, !v.outputs.empty());
}

}  // namespace

std::string campaign_run(const Options& o, Progress& progress) {
  const Evaluator evaluate = campaign_evaluator(o, progress);
  const CampaignProblem problem{o.material, o.ensemble, o.source, std::uint64_t(o.seed), o.mechanics.paper, o.ray_error_percent};
  tell_if_emptied(o.store, progress);
  SqliteJournal log(o.store, problem_text(problem));
  Pace pace;
  const OptimizerStatus end = with_optimizer(problem, o.evaluations, [&](const auto& optimizer) {
    return run_campaign(log, optimizer, evaluate, [&](const auto& state, int id, const TrialResult& v) { progress.note(line(state, id, v, pace)); });
  });
  if (end == OptimizerStatus::exhausted) progress.note("every feasible design that could be found was evaluated");
  return campaign_status(o);
}

}  // namespace lumo::program
