#include "commands/campaigns.hpp"
#include "console/text.hpp"
#include "store/campaign_store.hpp"
#include "store/open_store.hpp"

#include <set>

namespace lumo::program {

namespace {

Json summary(const StoredTrial& t, const StoredCampaign& c) {
  Json j = {{"index", t.id}, {"theta_mm", numbers(t.theta_mm)}, {"J_contact", number(value_at(t.record, "J_contact"))},
      {"J_obs", number(value_at(t.record, "J_obs"))}};
  if (!c.modelled.empty()) append(j, means_json(t));
  return j;
}

constexpr int width_of_deviation = 11;

/// Values as the front takes them, with their deviations where they are of models.
std::string line(const StoredTrial& t, const StoredCampaign& c) {
  const auto deviation = [&](const std::string& shown) {
    return c.modelled.empty() ? std::string() : pad("± " + shown, width_of_deviation);
  };
  return pad(std::to_string(t.id), 5) + "  " + pad(joined(t.theta_mm), -22) + pad(cell(t.value[0], 4), 10) +
         deviation(cell(t.deviation[0], 4)) + pad(scientific(t.value[1]), 12) +
         deviation(scientific(t.deviation[1], 1)) + (t.selected ? "  selected" : "") + "\n";
}
std::string heading_of_front(const StoredCampaign& c) {
  return "\nfront (" + c.values() + ")\n" + pad("index", 5) + "  " + pad("theta [mm]", -22) + pad("J_contact", 10) +
         pad("", c.modelled.empty() ? 0 : width_of_deviation) + pad("J_obs", 12) + "\n";
}
/// Known results on the front, as lines.
std::string known_lines(const StoredCampaign& c) {
  std::string text;
  for (const int k : c.known_on_front) {
    const KnownResult& r = c.problem.known[std::size_t(k)].result;
    text += pad("known", 5) + "  " + pad(joined(r.x), -22) + pad(cell(r.outputs[0], 4), 10) +
            pad(scientific(r.outputs[1]), 12) + lumo::message("  known ", k, ", as it was given\n");
  }
  return text;
}

/// Those who are at work, and how fast.
struct Workforce {
  int workers = 0, nodes = 0;
  double per_hour = undefined, seconds_left = undefined;

  Workforce(const StoredCampaign& c, double seconds, int evaluations) {
    std::set<std::string> all, machines;
    for (const Claim& claim : c.claims) {
      all.insert(claim.node + ' ' + claim.process);
      machines.insert(claim.node);
    }
    workers = int(all.size());
    nodes = int(machines.size());
    const int done = c.count(Trial::State::observed);
    if (workers == 0 || done == 0 || !(seconds > 0.0)) return;
    per_hour = 3600.0 * workers * done / seconds;
    seconds_left = 3600.0 * std::max(0, evaluations - done) / per_hour;
  }
};

/// Kinds of processors that results come from: bits are equal on equal ones only.
std::set<std::string> processors_of(const StoredCampaign& c) {
  std::set<std::string> kinds;
  const Json::json_pointer place("/machine/processor");
  for (const StoredTrial& t : c.trials)
    if (t.notes.is_object() && t.notes.contains(place) && t.notes[place].is_string())
      kinds.insert(t.notes[place].get<std::string>());
  return kinds;
}

Json claims_json(const StoredCampaign& c) {
  Json list = Json::array();
  for (const Claim& claim : c.claims)
    list.push_back({{"index", claim.number}, {"node", claim.node}, {"process", claim.process},
        {"age_s", claim.age_s ? number(*claim.age_s) : Json(nullptr)}});
  return list;
}

std::string workforce_text(const StoredCampaign& c, const Workforce& force, int evaluations) {
  if (force.workers == 0) return "";
  std::string text =
      lumo::message("workers: ", force.workers, " on ", force.nodes, force.nodes == 1 ? " node" : " nodes");
  if (std::isfinite(force.per_hour))
    text += "; about " + cell(force.per_hour, 1) + " evaluations/h, " + span(force.seconds_left) + " to " +
            std::to_string(evaluations);
  text += "\n";
  for (const Claim& claim : c.claims)
    text += lumo::message("  #", claim.number, "  ", one_line(claim.node), "  process ", one_line(claim.process),
        claim.age_s ? "  for " + span(*claim.age_s) : "", "\n");
  return text;
}

}  // namespace

std::string campaign_status(const std::string& store, bool as_json, int evaluations) {
  const StoredCampaign c = read_campaign(store);
  const std::string shown = shown_store(store);
  double seconds = 0.0;
  for (const StoredTrial& t : c.trials) seconds += std::isfinite(t.seconds()) ? t.seconds() : 0.0;
  const Workforce force(c, seconds, evaluations);
  const int done = c.count(Trial::State::observed), failed = c.count(Trial::State::failed),
            open = c.count(Trial::State::pending);
  if (as_json) {
    Json j = {{"store", shown}, {"material", c.problem.material()}, {"ensemble", c.problem.ensemble()},
        {"mode", c.problem.asked.mechanics.paper ? "paper" : "default"}, {"source", c.problem.asked.search.source},
        {"seed", c.problem.asked.search.seed}, {"evaluated", done}, {"failed", failed}, {"under_way", open},
        {"hypervolume", number(c.hypervolume)}, {"interval_90", interval_json(c)}, {"values", c.values()},
        {"noise", tree_of(c.problem.asked, {"search"})["search"]["noise"]}, {"known", c.problem.known.size()},
        {"known_on_front", c.known_on_front}, {"seconds", number(seconds)}, {"digest", c.digest},
        {"problem_digest", c.problem_digest}, {"results_version", c.problem.results},
        {"results_version_of_lumo", results_version}, {"pending", c.problem.asked.search.pending},
        {"workers", force.workers}, {"nodes", force.nodes}, {"evaluations_per_hour", number(force.per_hour)},
        {"seconds_left", number(force.seconds_left)}, {"claims", claims_json(c)}, {"processors", processors_of(c)}};
    j["selected"] = c.selected ? summary(c.trials[*c.selected], c) : Json(nullptr);
    j["front"] = Json::array();
    for (const StoredTrial& t : c.trials)
      if (t.on_front) j["front"].push_back(summary(t, c));
    return j.dump(2) + "\n";
  }
  std::string text = lumo::message(shown, ": ", c.problem.material(), ", ", c.problem.ensemble(),
      c.problem.asked.mechanics.paper ? " ensemble, paper mode, source " : " ensemble, source ",
      c.problem.asked.search.source, ", seed ", c.problem.asked.search.seed, "\n", done, " evaluated, ", failed,
      " failed, ", open, " under way; ", span(seconds), " in evaluations\n", hypervolume_text(c), ", values ",
      c.values(), "\n");
  if (!c.problem.known.empty()) text += c.known_words() + "\n";
  text += workforce_text(c, force, evaluations);
  if (const auto kinds = processors_of(c); kinds.size() > 1) {
    text += "results come from unlike processors, on which the last bits may differ:";
    for (const std::string& kind : kinds) text += " " + in_quotes(kind);
    text += "\n";
  }
  if (c.problem.results != results_version)
    text += lumo::message("results are of version ", c.problem.results, ", this lumo computes version ",
        results_version, ": they cannot be compared, nor the campaign continued\n");
  if (done > 0) text += heading_of_front(c) + known_lines(c);
  for (const StoredTrial& t : c.trials)
    if (t.on_front) text += line(t, c);
  if (c.selected && !c.trials[*c.selected].on_front) text += "\n" + line(c.trials[*c.selected], c);
  for (const StoredTrial& t : c.trials)
    if (t.state == Trial::State::failed) text += "failed " + std::to_string(t.id) + ": " + t.why + "\n";
  return text;
}

namespace {

struct CampaignStatus : StoreCommand {
  int evaluations = Search{}.evaluations;

  void declare(CLI::App& app) {
    StoreCommand::declare(app);
    add_whole(app, "--evaluations", evaluations, 1, 100000, "To which the time left is given, default 160");
  }
  Result run(Output&, Progress&) const { return campaign_status(store, json, evaluations); }
};

}  // namespace

void add_campaign_status(CommandLine& line) {
  line.add<CampaignStatus>("campaign status", "What a store holds, and who is at work on it");
}

}  // namespace lumo::program
