#include "store/campaign_store.hpp"

#include "store/open_store.hpp"

#include "lumo/objective/selection.hpp"
#include "lumo/optimize/hypervolume.hpp"

#include <algorithm>
#include <map>

namespace lumo::program {

namespace {

constexpr int any_number = 100000;  // a store does not say how many evaluations are wanted

/// Rates the trials by what the optimiser believes of them.
template <class O> void rate(StoredCampaign& campaign, const O& optimizer) {
  const Standing standing = optimizer.standing();
  campaign.hypervolume = standing.hypervolume;
  campaign.low = standing.low;
  campaign.high = standing.high;
  campaign.modelled = standing.modelled;
  for (const Outcome& o : standing.front)
    if (o.id < 0) campaign.known_on_front.push_back(-1 - o.id);
    else campaign.trials[std::size_t(o.id)].on_front = true;

  const std::vector<Outcome> believed = optimizer.believed();
  Eigen::MatrixXd y(2, Eigen::Index(believed.size()));
  std::vector<std::pair<double, double>> objectives;
  std::vector<std::size_t> rated;
  for (std::size_t k = 0; k < believed.size(); ++k) {
    const Outcome& o = believed[k];
    y.col(Eigen::Index(k)) << o.objectives[0], o.objectives[1];
    if (o.id < 0) continue;
    StoredTrial& t = campaign.trials[std::size_t(o.id)];
    std::copy_n(o.objectives.begin(), 2, t.value.begin());
    if (!o.deviations.empty()) std::copy_n(o.deviations.begin(), 2, t.deviation.begin());
    t.hypervolume = lumo::hypervolume(y.leftCols(Eigen::Index(k) + 1), Eigen::Vector2d::Zero());
    objectives.emplace_back(o.objectives[0], o.objectives[1]);
    rated.push_back(std::size_t(o.id));
  }
  if (const auto best = balanced_choice(objectives)) {
    campaign.selected = rated[*best];
    campaign.trials[*campaign.selected].selected = true;
  }
}

/// Claims of what is under way, numbered as the trials are.
template <class State> void keep_claims_of_trials(StoredCampaign& campaign, const State& state) {
  std::vector<Claim> kept;
  for (const StoredTrial& t : campaign.trials)
    for (Claim c : campaign.claims)
      if (t.state == Trial::State::pending && c.number == state.asked(t.id)) {
        c.number = t.id;
        kept.push_back(std::move(c));
      }
  campaign.claims = std::move(kept);
}

}  // namespace

const char* name(Trial::State state) {
  return state == Trial::State::observed ? "evaluated" : state == Trial::State::failed ? "failed" : "under way";
}

double StoredTrial::seconds() const {
  return notes.is_object() && notes.contains("seconds") ? value_at(notes["seconds"], "total") : undefined;
}

int StoredCampaign::count(Trial::State state) const {
  return int(std::count_if(trials.begin(), trials.end(), [&](const StoredTrial& t) { return t.state == state; }));
}

std::string StoredCampaign::known_words() const {
  if (problem.known.empty()) return "";
  std::map<int, int> others;
  for (const KnownEvaluation& k : problem.known)
    if (k.results.value_or(problem.results) != problem.results) ++others[*k.results];
  std::string text = lumo::message("knows ", problem.known.size(), " earlier results");
  for (const auto& [results, count] : others)
    text += lumo::message(", ", count, " of version ", results, ", which are in no front");
  return text;
}

StoredCampaign read_campaign(const std::string& store, Check check) {
  StoredCampaign campaign;
  std::vector<std::string> records;
  const std::vector<JournalEntry> entries = with_store(store, [&](const auto& log) {
    if (check == Check::whole) log.verify();
    const std::vector<JournalEntry> all = log.entries();
    for (const JournalEntry& e : all) records.push_back(log.record(e.number));
    campaign.digest = log.digest(all.back().number);
    campaign.problem_digest = log.digest(0);
    campaign.claims = log.claims();
    return all;
  });
  campaign.problem_text = entries.front().content;
  campaign.problem = read_problem(campaign.problem_text, shown_store(store));
  with_optimizer(campaign.problem, any_number, [&](auto optimizer) {
    CampaignState state(std::move(optimizer));
    state.read(entries);
    for (const Trial& t : state.optimizer().trials()) {
      StoredTrial s;
      s.id = t.id;
      std::copy_n(t.x.begin(), 5, s.theta_mm.begin());
      s.state = t.state;
      s.why = t.why;
      if (const auto number = state.answered(t.id)) {
        s.record = json_or_null(records[std::size_t(*number)]);
        s.notes = json_or_null(entries[std::size_t(*number)].notes);
      }
      campaign.trials.push_back(std::move(s));
    }
    campaign.asked = state.optimizer().trials();
    keep_claims_of_trials(campaign, state);
    rate(campaign, state.optimizer());
  });
  return campaign;
}

}  // namespace lumo::program
