#include "store/known_results.hpp"

#include "asking/space.hpp"
#include "store/campaign_store.hpp"
#include "store/open_store.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <optional>
#include <string_view>
#include <utility>

namespace lumo::program {

namespace {

bool is_store(const std::string& name) {
  if (is_database(name)) return true;
  constexpr std::string_view begin = "SQLite format 3";
  std::array<char, begin.size()> there{};
  std::ifstream in(name, std::ios::binary);
  return in.read(there.data(), there.size()) && std::string_view(there.data(), there.size()) == begin;
}

/// The standard errors of a trial; those of its record where the journal has none, as in earlier versions.
std::vector<double> errors_of(const Trial& trial, const Json& record) {
  if (!trial.errors.empty()) return trial.errors;
  std::vector<double> kept;
  for (const char* key : {"J_contact_err", "J_obs_err"})
    kept.push_back(Estimate{0.0, value_at(record, key)}.standard_error());
  return std::isfinite(kept[0]) && std::isfinite(kept[1]) ? kept : std::vector<double>{};
}

/// Refuses results of other objectives. What only decides their errors (mesh, light) may differ, and what another
/// version of the results has otherwise.
void require_same_objectives(const std::string& from, const CampaignProblem& other, const CampaignProblem& asked) {
  std::vector<std::string> groups = {"silicone", "finger", "ensemble"};
  if (other.results == asked.results) groups.insert(groups.end(), {"leds", "readout", "mechanics"});
  const auto objectives = [&](const CampaignProblem& p) {
    Json tree = tree_of(p.asked, groups);
    tree["mode"] = p.asked.mechanics.paper ? "paper" : "default";
    return tree;
  };
  const std::string found = difference(objectives(asked), objectives(other));
  if (!found.empty()) throw InputError("--known: store '" + from + "' is of other objectives: " + found + " there");
}

/// The problem of a store that is there; nullopt for one that cannot be gone on with, which whoever opens it says.
std::optional<CampaignProblem> problem_in(const std::string& store) {
  try {
    const std::string text = with_store(store, [](const auto& log) { return log.entries().front().content; });
    return read_problem(text, shown_store(store));
  } catch (const StoreError&) {
  } catch (const InputError&) {
  }
  return std::nullopt;
}

bool same(const std::vector<KnownEvaluation>& a, const std::vector<KnownEvaluation>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const KnownEvaluation& k, const KnownEvaluation& l) {
    return k.results == l.results && k.result.x == l.result.x && k.result.outputs == l.result.outputs &&
           k.result.errors == l.result.errors;
  });
}

}  // namespace

std::vector<KnownEvaluation> read_known(const std::string& from, const CampaignProblem& problem) {
  std::vector<KnownEvaluation> known;
  if (!is_store(from)) {
    for (KnownResult& k : read_known_table(from, problem_of(problem.asked, 1))) {
      for (double& e : k.errors) e = Estimate{0.0, e}.standard_error();  // a table has errors as export prints them
      known.push_back({std::move(k)});
    }
    return known;
  }
  const StoredCampaign other = read_campaign(from);
  require_same_objectives(shown_store(from), other.problem, problem);
  known = other.problem.known;
  for (std::size_t k = 0; k < other.trials.size(); ++k)
    if (const Trial& t = other.asked[k]; t.state == Trial::State::observed)
      known.push_back({{t.x, t.outputs, errors_of(t, other.trials[k].record)}, other.problem.results});
  return known;
}

CampaignProblem continued(CampaignProblem asked, const std::string& store, const Given& given, Progress& progress) {
  if (!given.known.empty()) asked.known = read_known(given.known, asked);
  const std::optional<CampaignProblem> there = problem_in(store);
  if (!there) return asked;
  if (!given.known.empty() && !same(asked.known, there->known))
    throw InputError(lumo::message("store '", shown_store(store), "' was begun with ", there->known.size(),
        " known results, which stay as they are: --known gives ", asked.known.size(), " or others"));
  asked.known = there->known;
  CampaignProblem exact = asked;
  exact.asked.search.noise = Noise::none;
  if (given.noise || asked.asked.search.noise == Noise::none || problem_text(exact) != problem_text(*there))
    return asked;
  progress.note("the store was begun without the objectives' errors: it goes on so (search.noise is none)");
  return exact;
}

}  // namespace lumo::program
