#include "commands/campaigns.hpp"
#include "computing/contacts.hpp"
#include "computing/evaluation.hpp"
#include "console/text.hpp"
#include "lumo/study/choice_stability.hpp"
#include "lumo/support/tbb.hpp"
#include "store/campaign_store.hpp"
#include "store/open_store.hpp"

#include <algorithm>
#include <map>

namespace lumo::program {

namespace {

/// Progressive-constraint gain at −30, 0, +30° [%] as the paper measured it on fabricated pads (Table II), d = 10 mm.
struct PublishedGain {
  const char *material, *ensemble;
  std::array<double, 3> percent;
};
constexpr std::array<PublishedGain, 4> table_2 = {{{"Sol", "flat", {0.3, 19.8, 3.0}},
    {"Sol", "curved", {19.3, 21.0, 20.1}}, {"DS", "flat", {-40.6, 11.5, -38.1}}, {"DS", "curved", {13.9, 19.9, 14.3}}}};
constexpr std::array<double, 3> gain_angles_deg = {-30.0, 0.0, 30.0};
constexpr int enough_for_a_model = 8;

/// How often each design was chosen, the most frequent first.
struct Stability {
  int searches = 0, same = 0;
  std::vector<std::pair<Design, int>> choices;
};

Stability stability_of(const StoredCampaign& c, int seeds, int threads, Progress& progress) {
  progress.stage("searches on a model of the results", seeds);
  const int evaluations = c.count(Trial::State::observed);
  const auto chosen = with_optimizer(c.problem, evaluations, [&]<class O>(const O& optimizer) {
    return choices_over_seeds(
        optimizer.problem(), c.asked, {seeds, evaluations}, [](const Problem& problem) { return O(problem); },
        TbbExecutor{threads}, [&] { progress.step(); });
  });
  Stability s;
  std::map<Design, int> count;
  const auto& theta = c.trials[*c.selected].theta_mm;
  for (const auto& x : chosen) {
    if (!x) continue;
    ++s.searches;
    ++count[*x];
    s.same += std::equal(theta.begin(), theta.end(), x->begin());
  }
  s.choices.assign(count.begin(), count.end());
  std::stable_sort(
      s.choices.begin(), s.choices.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
  return s;
}

std::array<double, 3> gain_of(const StoredCampaign& c, int threads, Progress& progress) {
  Ensemble contacts = flat_ensemble();
  contacts.diameters_m = {10e-3};
  contacts.places_m = {0.0};
  contacts.angles_rad.clear();
  for (const double a : gain_angles_deg) contacts.angles_rad.push_back(a * pi / 180.0);
  const auto depths = [&](const std::array<double, 5>& theta_mm) {
    Configuration o = c.problem.asked;
    o.pad.theta_mm = theta_mm;
    o.ensemble = contacts;
    return make_depths(o, threads, progress);
  };
  const std::array<double, 5>& theta = c.trials[*c.selected].theta_mm;
  const std::array<double, 5> reference = baseline_of(c.problem.asked.search.references).values();
  const std::vector<double> chosen = depths(theta), baseline = theta == reference ? chosen : depths(reference);
  std::array<double, 3> gain{};
  for (std::size_t k = 0; k < gain.size(); ++k) gain[k] = progressive_constraint_gain(chosen[k], baseline[k]);
  return gain;
}

std::string percent(double v) { return std::isfinite(v) ? (v > 0 ? "+" : "") + cell(v, 1) : "-"; }

/// What there is to know about the design that a store's results favour.
struct Selection {
  const StoredCampaign& campaign;
  int evaluated;
  std::optional<Stability> stability;
  std::array<double, 3> gain;
  double best_contact = 0.0, best_observation = 0.0;

  const StoredTrial& trial() const { return campaign.trials[*campaign.selected]; }
};

Json selection_json(const Selection& r, const std::string& store) {
  const StoredCampaign& c = r.campaign;
  const StoredTrial& t = r.trial();
  Json j = {{"store", store}, {"material", c.problem.material()}, {"ensemble", c.problem.ensemble()},
      {"evaluated", r.evaluated}, {"index", t.id}, {"theta_mm", numbers(t.theta_mm)}};
  for (const char* key : {"J_contact", "J_contact_err", "J_obs", "J_obs_err"}) j[key] = number(value_at(t.record, key));
  if (!c.modelled.empty()) append(j, means_json(t));
  j["values"] = c.values();
  j["share_of_best"] = {t.value[0] / r.best_contact, t.value[1] / r.best_observation};
  j["hypervolume"] = number(c.hypervolume);
  j["interval_90"] = interval_json(c);
  j["stability"] = nullptr;
  if (r.stability) {
    j["stability"] = {{"searches", r.stability->searches}, {"same", r.stability->same}, {"choices", Json::array()}};
    for (const auto& [x, n] : r.stability->choices)
      j["stability"]["choices"].push_back({{"theta_mm", numbers(x)}, {"count", n}});
  }
  j["gain_angles_deg"] = gain_angles_deg;
  j["gain_percent"] = numbers(r.gain);
  j["table_2"] = Json::array();
  for (const PublishedGain& p : table_2)
    j["table_2"].push_back({{"material", p.material}, {"ensemble", p.ensemble}, {"gain_percent", p.percent}});
  return j;
}

/// How often searches on a model of the results choose it.
std::string stability_text(const Selection& r) {
  if (!r.stability)
    return lumo::message("stability: needs ", enough_for_a_model, " evaluations for a model, has ", r.evaluated, "\n");
  std::string text = lumo::message("stability: ", r.stability->same, " of ", r.stability->searches, " searches of ",
      r.evaluated, " evaluations on a Gaussian-process model of the results choose it\n");
  for (std::size_t k = 0; k < std::min<std::size_t>(8, r.stability->choices.size()); ++k)
    text +=
        pad(std::to_string(r.stability->choices[k].second), 5) + " x  " + joined(r.stability->choices[k].first) + "\n";
  if (r.stability->choices.size() > 8)
    text += lumo::message("  and ", r.stability->choices.size() - 8, " other designs\n");
  return text;
}

std::string selection_text(const Selection& r) {
  const StoredCampaign& c = r.campaign;
  const StoredTrial& t = r.trial();
  const auto with_deviation = [&](const std::string& value, const std::string& deviation) {
    return c.modelled.empty() ? value : value + " ± " + deviation;
  };
  std::string text = lumo::message("selected: #", t.id, ", theta = ", joined(t.theta_mm),
      " mm (h_fp, h_ep, w_s, h_s, w_v); ", c.problem.material(), ", ", c.problem.ensemble(), ", of ", r.evaluated,
      " evaluations\nJ_contact ", with_deviation(cell(t.value[0], 4), cell(t.deviation[0], 4)), " (",
      cell(100 * t.value[0] / r.best_contact, 1), " % of the best), J_obs ",
      with_deviation(scientific(t.value[1]), scientific(t.deviation[1], 1)), " (",
      cell(100 * t.value[1] / r.best_observation, 1), " % of the best)\nvalues ", c.values(), "; ", hypervolume_text(c),
      "\n\n");
  text += stability_text(r);
  text += "\nprogressive-constraint gain over the baseline [%], sphere of 10 mm, 15 N\n" + pad("approach angle", -26) +
          pad("-30 deg", 10) + pad("0 deg", 10) + pad("+30 deg", 10) + "\n";
  const auto row = [&](const std::string& label, const std::array<double, 3>& v) {
    text += pad(label, -26) + pad(percent(v[0]), 10) + pad(percent(v[1]), 10) + pad(percent(v[2]), 10) + "\n";
  };
  row("this design, computed", r.gain);
  for (const PublishedGain& p : table_2) {
    const bool like = p.material == c.problem.material() && p.ensemble == c.problem.ensemble();
    row(std::string("paper, ") + p.material + " " +
            (p.ensemble == std::string_view("flat") ? "Flat-Opt" : "Curved-Opt") + (like ? " *" : ""),
        p.percent);
  }
  return text + "* same material and ensemble; measured on a fabricated pad whose theta the paper does not give\n";
}

/// The balanced choice among what was evaluated, how stable it is, and how much its pad stops the finger from sinking
/// in.
struct CampaignSelect : StoreCommand {
  int seeds = 20, threads = all_threads();

  void declare(CLI::App& app) {
    StoreCommand::declare(app);
    add_whole(app, "--seeds", seeds, 1, 1000, "Optimisers that are run on a model of the results, default 20");
    add_threads(app, threads);
  }
  Result run(Output&, Progress& progress) const {
    const StoredCampaign c = read_campaign(store);
    if (!c.selected)
      throw InputError("store '" + shown_store(store) +
                       "' holds no evaluation with both objectives above 0: there is nothing to select from");
    Selection r{c, c.count(Trial::State::observed), {}, {}};
    if (r.evaluated >= enough_for_a_model) r.stability = stability_of(c, seeds, threads, progress);
    r.gain = gain_of(c, threads, progress);
    progress.finish();
    for (const StoredTrial& k : c.trials) {
      if (k.state != Trial::State::observed) continue;
      r.best_contact = std::max(r.best_contact, k.value[0]);
      r.best_observation = std::max(r.best_observation, k.value[1]);
    }
    return json ? selection_json(r, shown_store(store)).dump(2) + "\n" : selection_text(r);
  }
};

}  // namespace

void add_campaign_select(CommandLine& line) {
  line.add<CampaignSelect>(
      "campaign select", "The balanced choice, how stable it is, and its progressive-constraint gain");
}

}  // namespace lumo::program
