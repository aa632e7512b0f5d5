#include "store/study_rows.hpp"

#include "console/text.hpp"
#include "lumo/campaign/campaign.hpp"
#include "store/campaign_problem.hpp"
#include "store/emptied_store.hpp"
#include "store/open_store.hpp"

#include <algorithm>

namespace lumo::program {

namespace {

template <Journal Log> std::vector<StudyRow> rows_of(Log log, const Problem& problem, const Evaluator& evaluate,
    const std::function<std::string(const StudyRow&)>& outcome, Progress& progress) {
  Pace pace;
  run_campaign(log, Optimizer<>(problem), evaluate, [&](const auto& state, int id, const TrialResult& v) {
    const auto& optimizer = state.optimizer();
    const Design& x = optimizer.trials()[std::size_t(id)].x;
    const std::string end = v.outputs.empty() ? "  failed, " + v.why : outcome({x, Json::parse(v.record)});
    progress.note(pad(std::to_string(optimizer.observed()), 3) + "/" + std::to_string(problem.evaluations) + "  " +
                  pad(joined(x), -20) + end + "  " +
                  pace.after(problem.evaluations - optimizer.observed(), !v.outputs.empty()));
  });
  CampaignState state{Optimizer<>(problem)};
  state.read(log.entries());
  std::vector<StudyRow> rows;
  for (const Trial& t : state.optimizer().trials())
    if (t.state == Trial::State::observed) rows.push_back({t.x, Json::parse(log.record(*state.answered(t.id)))});
  rows.resize(std::min(rows.size(), std::size_t(problem.evaluations)));  // a store may hold more than are asked for
  return rows;
}

}  // namespace

Json json(const PairedSummary& s) {
  return {{"above_zero", s.above_zero}, {"positive", s.positive}, {"negative", s.negative}, {"undecided", s.undecided},
      {"median", s.median}, {"median_95", s.median_95 ? Json{s.median_95->first, s.median_95->second} : Json(nullptr)}};
}

std::vector<StudyRow> study_rows(const std::string& store, const std::string& problem_text, const Problem& problem,
    const Evaluator& evaluate, const std::function<std::string(const StudyRow&)>& outcome, Progress& progress) {
  if (is_database(store)) throw UsageError("studies are kept in files: --store must be a file");
  tell_if_emptied(store, progress);
  if (!store.empty()) return rows_of(SqliteStore(store, problem_text), problem, evaluate, outcome, progress);
  progress.note("not kept: with --store FILE it goes on after an interruption");
  return rows_of(MemoryJournal(problem_text), problem, evaluate, outcome, progress);
}

}  // namespace lumo::program
