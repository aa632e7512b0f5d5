#include "commands/study_readings.hpp"

#include "charts/chart.hpp"
#include "computing/pad.hpp"
#include "configuration/settings.hpp"
#include "console/text.hpp"
#include "report/records.hpp"
#include "store/campaign_problem.hpp"
#include "store/study_rows.hpp"

#include "lumo/study/assumptions.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace lumo::program {

namespace {

constexpr double weak_ranking = 0.8;  // Kendall's τ below which conclusions hang on the reading

std::string contact_name(double diameter_mm, double angle_deg) {
  return short_number(diameter_mm) + " mm, " + short_number(angle_deg) + "°, ";
}

AssumptionVariant known_variant(const std::string& key) {
  std::vector<std::string> known;
  for (AssumptionVariant& v : known_assumption_variants()) {
    if (v.key == key) return std::move(v);
    known.push_back(v.key);
  }
  throw UsageError("--only has " + in_quotes(key) + ", the nearest assumption is '" + nearest(key, known) + "'");
}

/// Reading `r` of each design; 0 is lumo's own.
std::vector<AssumptionScore> scores(const std::vector<StudyRow>& rows, std::size_t r) {
  std::vector<AssumptionScore> list;
  for (const StudyRow& row : rows) {
    const Json& j = row.record.at("readings").at(r);
    AssumptionScore s{estimate(j, "J_contact"), estimate(j, "J_obs"), "", ""};
    if (const Json& w = j.at("worst_contact"); w.is_object())
      s.worst_contact =
          contact_name(w.at("diameter_mm"), w.at("angle_deg")) + "y " + short_number(w.at("y_mm")) + " mm";
    if (const Json& w = j.at("worst_observation"); w.is_object())
      s.worst_observation = contact_name(w.at("diameter_mm"), w.at("angle_deg")) + short_number(w.at("load_N")) +
                            " N, y " + short_number(w.at("y_mm")[0]) + " and " + short_number(w.at("y_mm")[1]) + " mm";
    list.push_back(std::move(s));
  }
  return list;
}

struct Effect {
  AssumptionVariant departure;
  AssumptionEffect effect;
};

std::vector<Effect> effects(const std::vector<StudyRow>& rows, const std::vector<AssumptionVariant>& variants) {
  const std::vector<AssumptionScore> usual = scores(rows, 0);
  std::vector<Effect> list;
  for (const AssumptionVariant& d : variants) list.push_back({d, effect_of(usual, scores(rows, list.size() + 1))});
  return list;
}

/// Largest medians first, what has none last.
void sort_by(std::vector<Effect>& list, std::optional<PairedSummary> AssumptionEffect::*which) {
  const auto size = [&](const Effect& e) { return e.effect.*which ? std::abs((e.effect.*which)->median) : -1.0; };
  std::stable_sort(list.begin(), list.end(), [&](const Effect& a, const Effect& b) { return size(a) > size(b); });
}

std::string shown(const std::optional<PairedSummary>& s, double unit, int digits) {
  if (!s) return "-";
  const auto figure = [&](double v) { return (v > 0.0 ? "+" : "") + cell(v * unit, digits); };
  return figure(s->median) +
         (s->median_95 ? " (" + figure(s->median_95->first) + " … " + figure(s->median_95->second) + ")" : "");
}

std::string shown(const std::optional<double>& tau) { return tau ? cell(*tau, 2) : "-"; }

std::string choice(const std::vector<StudyRow>& rows, const std::optional<std::size_t>& k) {
  return k ? joined(rows[*k].theta_mm) : "-";
}

std::string designs(const AssumptionEffect& e) {
  return std::to_string(e.compared) + (e.lost > 0 ? " (" + std::to_string(e.lost) + " lost)" : "");
}

std::string table(const std::vector<StudyRow>& rows, std::vector<Effect> list) {
  sort_by(list, &AssumptionEffect::J_obs);
  const std::vector<int> widths = {-32, 11, 30, 24, 5, 7, 9, 9};
  const auto line = [&](const std::vector<std::string>& cells) {
    std::string text;
    for (std::size_t k = 0; k < cells.size(); ++k)
      text += (k == 0 ? "" : "  ") + (k < widths.size() ? pad(cells[k], widths[k]) : cells[k]);
    return text + "\n";
  };
  std::string text = line({"reading", "designs", "ΔJ_contact, median (95 %)", "ΔJ_obs [%], median (95 %)", "τ J_c",
      "τ J_obs", "worst J_c", "worst J_o", "i* by lumo's reading > by this"});
  const auto moved = [](std::size_t n, std::size_t of) { return std::to_string(n) + "/" + std::to_string(of); };
  for (const auto& [d, e] : list)
    text += line({d.name(), designs(e), shown(e.J_contact, 1.0, 4), shown(e.J_obs, 100.0, 1), shown(e.tau_contact),
        shown(e.tau_obs), moved(e.worst_contact_moved, e.compared), moved(e.worst_observation_moved, e.compared),
        choice(rows, e.usual_choice) + (e.choice == e.usual_choice ? " stays" : " > " + choice(rows, e.choice))});
  std::string weak, unknown;
  for (const auto& [d, e] : list)
    for (const auto& [what, tau] : {std::pair("J_contact", e.tau_contact), {"J_obs", e.tau_obs}}) {
      if (tau && *tau < weak_ranking) weak += "  " + d.name() + ", ranking by " + what + " (τ " + shown(tau) + ")\n";
      if (!tau || e.lost > e.compared)
        unknown += "  " + d.name() + ", ranking by " + what + ": " + designs(e) + " of " + std::to_string(rows.size()) +
                   " designs compared\n";
    }
  text += "\nConclusions depend on assumptions with τ below " + short_number(weak_ranking) +
          (weak.empty() ? ": none.\n" : ":\n" + weak);
  return text + (unknown.empty() ? "" : "Not known:\n" + unknown);
}

std::string effects_csv(const std::vector<StudyRow>& rows, const std::vector<Effect>& list) {
  std::string text =
      "quantity,value,designs,lost,delta_J_contact,delta_J_contact_low,delta_J_contact_high,delta_J_obs_percent,delta_"
      "J_obs_percent_low,delta_J_obs_percent_high,"
      "tau_J_contact,tau_J_obs,worst_contact_moved,worst_observation_moved,usual_choice_mm,choice_mm\n";
  const auto field = [](const std::optional<double>& v) { return "," + csv_field(maybe(v)); };
  const auto summary = [&](const std::optional<PairedSummary>& s, double unit) {
    const auto interval = s ? s->median_95 : std::nullopt;
    return field(s ? std::optional(s->median * unit) : std::nullopt) +
           field(interval ? std::optional(interval->first * unit) : std::nullopt) +
           field(interval ? std::optional(interval->second * unit) : std::nullopt);
  };
  for (const auto& [d, e] : list)
    text += csv_text(d.quantity) + "," + csv_text(d.value) + "," + std::to_string(e.compared) + "," +
            std::to_string(e.lost) + summary(e.J_contact, 1.0) + summary(e.J_obs, 100.0) + field(e.tau_contact) +
            field(e.tau_obs) + "," + std::to_string(e.worst_contact_moved) + "," +
            std::to_string(e.worst_observation_moved) + "," + csv_text(choice(rows, e.usual_choice)) + "," +
            csv_text(choice(rows, e.choice)) + "\n";
  return text;
}

std::string designs_csv(const std::vector<StudyRow>& rows) {
  std::string text = "h_fp_mm,h_ep_mm,w_s_mm,h_s_mm,w_v_mm,reading,J_contact,J_contact_err,J_obs,J_obs_err,why\n";
  for (const StudyRow& row : rows)
    for (const Json& r : row.record.at("readings")) {
      text += joined(row.theta_mm) + "," + csv_text(r.at("reading").get<std::string>());
      for (const char* key : {"J_contact", "J_contact_err", "J_obs", "J_obs_err"}) text += "," + csv_field(r.at(key));
      text += "," + (r.at("why").is_string() ? csv_text(r["why"].get<std::string>()) : "") + "\n";
    }
  return text;
}

/// An objective of the chart: its changes, its rankings, and how they are shown.
struct Shown {
  std::optional<PairedSummary> AssumptionEffect::*which;
  std::optional<double> AssumptionEffect::*tau;
  std::string title, axis;
  double unit;
};

std::string picture(const std::string& about, std::vector<Effect> list, const Shown& shown_objective) {
  const auto& [which, tau, title, axis, unit] = shown_objective;
  sort_by(list, which);
  TornadoChart chart;
  chart.title = title;
  chart.subtitle = "Median over the designs compared and its 95 % interval; " + about;
  chart.x_label = axis;
  chart.note = "Kendall's τ, designs";
  for (const auto& [d, e] : list) {
    if (!(e.*which)) continue;
    const PairedSummary& s = *(e.*which);
    const auto interval = s.median_95.value_or(std::pair(s.median, s.median));
    chart.rows.push_back(
        {d.name(), s.median * unit, interval.first * unit, interval.second * unit, shown(e.*tau) + ", " + designs(e)});
  }
  return draw(chart);
}

/// What stands in `j`, and all designs and assumptions.
std::string whole(Json j, const std::vector<StudyRow>& rows, const std::vector<Effect>& list) {
  j["designs"] = Json::array();
  j["readings"] = Json::array();
  for (const StudyRow& r : rows)
    j["designs"].push_back({{"theta_mm", numbers(r.theta_mm)}, {"readings", r.record.at("readings")}});
  const auto theta = [&](const std::optional<std::size_t>& k) {
    return k ? Json(numbers(rows[*k].theta_mm)) : Json(nullptr);
  };
  const auto summary = [](const std::optional<PairedSummary>& s) { return s ? json(*s) : Json(nullptr); };
  for (const auto& [d, e] : list)
    j["readings"].push_back({{"quantity", d.quantity}, {"value", d.value}, {"compared", e.compared}, {"lost", e.lost},
        {"delta_J_contact", summary(e.J_contact)}, {"relative_delta_J_obs", summary(e.J_obs)},
        {"tau_J_contact", maybe(e.tau_contact)}, {"tau_J_obs", maybe(e.tau_obs)},
        {"worst_contact_moved", e.worst_contact_moved}, {"worst_observation_moved", e.worst_observation_moved},
        {"usual_choice_mm", theta(e.usual_choice)}, {"choice_mm", theta(e.choice)}});
  return j.dump(1) + "\n";
}

std::string row_line(const StudyRow& row) {
  std::size_t scored = 0;
  const Json& results = row.record.at("readings");
  for (const Json& r : results) scored += r.at("why").is_null();
  const auto usual = scores({row}, 0)[0];
  return lumo::message("  J_contact ", cell(usual.J_contact->value, 4), "  J_obs ", scientific(usual.J_obs->value),
      "  ", scored, " of ", results.size(), " assumptions");
}

}  // namespace

void StudyReadings::declare(CLI::App& app) {
  StudyCommand::declare(
      app, {"Seeded designs to compare beside the five references, default 30",
               "All contacts of flat or curved, default: 10 and 30 mm at y = 0 (0°, 30°) and 5.5 mm (0°)",
               "Edges 1.4 times as long, J_obs by rays to 4 % instead of 1.5: half of the time"});
  add_value(app, "--only", "NAME,...",
      "Assumptions about pad and light to compare, by lumo config's names; default: all that change what is usual",
      [this](const std::string& typed) {
        only_.clear();
        for (const std::string_view name : split(typed)) only_.push_back(known_variant(std::string(name)));
      });
}

std::vector<AssumptionVariant> StudyReadings::variants() const {
  return only_.empty() ? assumption_variants(usual_assumptions(asked())) : only_;
}

// The reference designs, then seeded ones.
Problem StudyReadings::problem() const {
  Problem p = study_problem(finger_space(asked().pad.finger.pad), designs, std::uint64_t(seed));
  const Problem search = problem_of(asked(), designs);
  p.objectives = search.objectives;
  p.initial = search.initial;
  p.evaluations += int(p.initial.size());
  return p;
}

std::string StudyReadings::problem_text(const Problem& p) const {
  Json j = {{"study", "readings"}};
  append(j, conditions(asked(), evaluation_groups));
  if (!whole_ensemble()) {
    j["loads_N"] = pressed().front().loads_N;
    j["contacts"] = Json::array();
    for (const auto& s : pressed())
      j["contacts"].push_back({mm(s.indenter.diameter_m), degrees(s.angle_rad), mm(s.y_m)});
  }
  j["coarse"] = tools.coarse;
  j["readings"] = Json::array();
  for (const AssumptionVariant& d : variants()) j["readings"].push_back(d.name());
  j["initial"] = p.initial;
  j["sobol"] = p.sobol;
  j["seed"] = seed;
  return line_by_line(j);
}

std::string StudyReadings::about() const {
  const std::string contacts =
      whole_ensemble() ? contacts_name() + " contacts" : "10 and 30 mm at y = 0 (0°, 30°) and 5.5 mm (0°)";
  return asked().pad.material() + ", " + contacts + (tools.coarse ? "; coarser meshes, fewer rays" : "");
}

Result StudyReadings::run(Output& files, Progress& progress) const {
  const Evaluator evaluate = assumptions_evaluator({asked(), tools.threads, tools.coarse}, pressed(), variants(),
      progress);  // before a store is opened, for the mesher forks
  const Problem search = problem();
  const std::vector<StudyRow> rows = study_rows(store, problem_text(search), search, evaluate, row_line, progress);
  const std::vector<Effect> list = effects(rows, variants());
  if (files.wanted()) {
    files.add("study_readings.csv", effects_csv(rows, list));
    files.add("study_readings_designs.csv", designs_csv(rows));
    files.add(
        "study_readings_J_contact.svg", picture(about(), list,
                                            {&AssumptionEffect::J_contact, &AssumptionEffect::tau_contact,
                                                "What other assumptions change in J_contact", "ΔJ_contact [–]", 1.0}));
    files.add(
        "study_readings_J_obs.svg", picture(about(), list,
                                        {&AssumptionEffect::J_obs, &AssumptionEffect::tau_obs,
                                            "What other assumptions change in J_obs", "ΔJ_obs [% of J_obs]", 100.0}));
  }
  if (!json) return table(rows, list);
  return whole({{"study", "readings"}, {"material", asked().pad.material()}, {"contacts", contacts_name()},
                   {"coarse", tools.coarse}, {"seed", seed}, {"configuration", tree_of(asked())}},
      rows, list);
}

void add_study_readings(CommandLine& line) {
  line.add<StudyReadings>("study readings",
      "How far results move with each reading of what the paper leaves open (some 10 min a design on two cores)");
}

}  // namespace lumo::program
