#include "store/campaign_store.hpp"

#include "store/open_store.hpp"

#include "lumo/objective/selection.hpp"
#include "lumo/optimize/hypervolume.hpp"

#include <algorithm>

namespace lumo::program {

namespace {

constexpr int any_number = 100000;  // a store does not say how many evaluations are wanted

void rate(StoredCampaign& campaign, const std::vector<std::pair<std::size_t, std::pair<double, double>>>& rated) {
  Eigen::MatrixXd y(2, Eigen::Index(rated.size()));
  std::vector<std::pair<double, double>> objectives;
  for (std::size_t k = 0; k < rated.size(); ++k) {
    y.col(Eigen::Index(k)) << rated[k].second.first, rated[k].second.second;
    objectives.push_back(rated[k].second);
    campaign.hypervolume = lumo::hypervolume(y.leftCols(Eigen::Index(k) + 1), Eigen::Vector2d::Zero());
    campaign.trials[rated[k].first].hypervolume = campaign.hypervolume;
  }
  if (!rated.empty())
    for (const Eigen::Index k : pareto_front(y)) campaign.trials[rated[std::size_t(k)].first].on_front = true;
  if (const auto best = balanced_choice(objectives)) {
    campaign.selected = rated[*best].first;
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
    std::vector<std::pair<std::size_t, std::pair<double, double>>> rated;
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
      if (t.state == Trial::State::observed) rated.push_back({campaign.trials.size(), {t.outputs[0], t.outputs[1]}});
      campaign.trials.push_back(std::move(s));
    }
    campaign.asked = state.optimizer().trials();
    keep_claims_of_trials(campaign, state);
    rate(campaign, rated);
  });
  return campaign;
}

}  // namespace lumo::program
