#include "commands/campaigns.hpp"
#include "console/text.hpp"
#include "store/campaign_store.hpp"

namespace lumo::program {

namespace {

Json summary(const StoredTrial& t) {
  return {{"index", t.id}, {"theta_mm", numbers(t.theta_mm)}, {"J_contact", number(value_at(t.record, "J_contact"))},
      {"J_obs", number(value_at(t.record, "J_obs"))}};
}

std::string line(const StoredTrial& t) {
  return pad(std::to_string(t.id), 5) + "  " + pad(joined(t.theta_mm), -22) +
         pad(cell(value_at(t.record, "J_contact"), 4), 10) + pad(scientific(value_at(t.record, "J_obs")), 12) +
         (t.selected ? "  selected" : "") + "\n";
}

}  // namespace

std::string campaign_status(const std::string& store, bool as_json) {
  const StoredCampaign c = read_campaign(SqliteJournal(store), store);
  double seconds = 0.0;
  for (const StoredTrial& t : c.trials) seconds += std::isfinite(t.seconds()) ? t.seconds() : 0.0;
  const int done = c.count(Trial::State::observed), failed = c.count(Trial::State::failed),
            open = c.count(Trial::State::pending);
  if (as_json) {
    Json j = {{"store", store}, {"material", c.problem.material()}, {"ensemble", c.problem.ensemble()},
        {"mode", c.problem.asked.mechanics.paper ? "paper" : "default"}, {"source", c.problem.asked.search.source},
        {"seed", c.problem.asked.search.seed}, {"evaluated", done}, {"failed", failed}, {"under_way", open},
        {"hypervolume", number(c.hypervolume)}, {"seconds", number(seconds)}, {"digest", c.digest},
        {"problem_digest", c.problem_digest}, {"results_version", c.problem.results},
        {"results_version_of_lumo", results_version}};
    j["selected"] = c.selected ? summary(c.trials[*c.selected]) : Json(nullptr);
    j["front"] = Json::array();
    for (const StoredTrial& t : c.trials)
      if (t.on_front) j["front"].push_back(summary(t));
    return j.dump(2) + "\n";
  }
  std::string text = lumo::message(store, ": ", c.problem.material(), ", ", c.problem.ensemble(),
      c.problem.asked.mechanics.paper ? " ensemble, paper mode, source " : " ensemble, source ",
      c.problem.asked.search.source, ", seed ", c.problem.asked.search.seed, "\n", done, " evaluated, ", failed,
      " failed, ", open, " under way; ", span(seconds), " in evaluations\nhypervolume ", scientific(c.hypervolume),
      "\n");
  if (c.problem.results != results_version)
    text += lumo::message("results are of version ", c.problem.results, ", this lumo computes version ",
        results_version, ": they cannot be compared, nor the campaign continued\n");
  if (done > 0)
    text +=
        "\nfront\n" + pad("index", 5) + "  " + pad("theta [mm]", -22) + pad("J_contact", 10) + pad("J_obs", 12) + "\n";
  for (const StoredTrial& t : c.trials)
    if (t.on_front) text += line(t);
  if (c.selected && !c.trials[*c.selected].on_front) text += "\n" + line(c.trials[*c.selected]);
  for (const StoredTrial& t : c.trials)
    if (t.state == Trial::State::failed) text += "failed " + std::to_string(t.id) + ": " + t.why + "\n";
  return text;
}

namespace {

struct CampaignStatus : StoreCommand {
  Result run(Output&, Progress&) const { return campaign_status(store, json); }
};

}  // namespace

void add_campaign_status(CommandLine& line) { line.add<CampaignStatus>("campaign status", "What a store holds"); }

}  // namespace lumo::program
