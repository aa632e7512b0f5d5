#include "program/campaign.hpp"

#include "program/campaign_problem.hpp"
#include "program/commands.hpp"
#include "program/text.hpp"

#include "lumo/support/sqlite.hpp"

#include <chrono>

namespace lumo::program {

namespace {

/// One line for each evaluation, with the time that the rest will take.
class Ticker {
 public:
  explicit Ticker(Progress& progress) : progress_(progress) {}

  template <class State>
  void operator()(const State& state, int id, const Verdict& v) {
    const auto now = Clock::now();
    const double seconds = std::chrono::duration<double>(now - last_).count();
    last_ = now;
    spent_ += seconds, ++ended_;
    const auto& optimizer = state.optimizer();
    std::string line = pad(std::to_string(optimizer.told()), 3) + "/" + std::to_string(optimizer.problem().evaluations) + "  #" + pad(std::to_string(id), -3) + " " + pad(joined(optimizer.trials()[std::size_t(id)].x), -20) + "  ";
    if (v.outputs.empty()) line += "failed, " + v.why;
    else line += "J_contact " + cell(v.outputs[0], 4) + "  J_obs " + scientific(v.outputs[1]);
    line += "  hypervolume " + scientific(optimizer.hypervolume()) + "  " + span(seconds);
    if (const int left = optimizer.problem().evaluations - optimizer.told(); left > 0) line += ", " + span(spent_ / ended_ * left) + " left";
    progress_.note(line);
  }

 private:
  using Clock = std::chrono::steady_clock;
  Progress& progress_;
  Clock::time_point last_ = Clock::now();
  double spent_ = 0.0;
  int ended_ = 0;
};

}  // namespace

std::string campaign_run(const Options& o, Progress& progress) {
  const Evaluator evaluate = campaign_evaluator(o, progress);
  const CampaignProblem problem{o.material, o.ensemble, o.source, std::uint64_t(o.seed)};
  SqliteLog log(o.store, problem_text(problem));
  Ticker tick(progress);
  const OptimizerStatus end = with_optimizer(problem, o.evaluations, [&](const auto& optimizer) {
    return run_campaign(log, optimizer, evaluate, [&](const auto& state, int id, const Verdict& v) { tick(state, id, v); });
  });
  if (end == OptimizerStatus::exhausted) progress.note("every feasible design that could be found was evaluated");
  return campaign_status(o);
}

}  // namespace lumo::program
