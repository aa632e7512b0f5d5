#include "charts/chart.hpp"
#include "commands/studies.hpp"
#include "console/text.hpp"
#include "report/records.hpp"
#include "store/study_rows.hpp"

#include "lumo/campaign/finger_campaign.hpp"

#include <algorithm>
#include <utility>

namespace lumo::program {

namespace {

/// A quantity whose difference a study reports, between designs, or a variant of them, and another variant.
struct Comparison {
  std::string quantity;  ///< key in the record
  std::string variant;
  std::string label;
  int digits;
  std::string paper;    ///< what the paper found
  std::string of = "";  ///< the variant that is compared; empty: the design

  std::string name() const { return of.empty() ? variant : of + "_" + variant; }
};

struct StudyPlan {
  std::string title;
  MatchedStudy study;
  std::vector<Comparison> comparisons;
};

const std::string paper_carrier = "40 of 40 above 0, median 0.121 (§IV-A)";

StudyPlan carrier_plan(const FingerOptions& finger) {
  if (finger.pad.cap_length >
      0.0)  // as the authors' code compares: no voids on both sides, so that the carrier differs
    return {"carrier", {{Twin::no_void, Twin::held_top}, false},
        {{"J_contact", "held_top", "ΔJ_contact of the carrier: no voids against silicone alone, held at its back", 4,
             paper_carrier, "no_void"},
            {"J_contact", "held_top", "ΔJ_contact against silicone alone, held at its back", 4, ""}}};
  return {"carrier", {{Twin::bonded_base, Twin::unsupported_base}, false},
      {{"J_contact", "bonded_base", "ΔJ_contact against a soft pad bonded at its base", 4, ""},
          {"J_contact", "unsupported_base", "ΔJ_contact against a soft finger held at its ends", 4, paper_carrier}}};
}

StudyPlan void_plan(const FingerOptions&) {
  return {"void", {{Twin::no_void}, true},
      {{"J_contact", "no_void", "ΔJ_contact against the same θ without voids", 4,
           "both signs, depending on the morphology (§IV-A)"},
          {"D", "no_void", "ΔD(1 N) against the same θ without voids", 0,
              "both signs, depending on the morphology (§IV-A)"}}};
}

/// Of the design for an empty `variant`.
std::optional<Estimate> value(const StudyRow& row, const std::string& variant, const std::string& quantity) {
  for (const Json& v : row.record.at("variants"))
    if (v.at("variant") == (variant.empty() ? "design" : variant)) return estimate(v, quantity);
  return std::nullopt;
}

std::string why(const StudyRow& row, const std::string& variant) {
  for (const Json& v : row.record.at("variants"))
    if (v.at("variant") == variant && v.at("why").is_string()) return v["why"].get<std::string>();
  return "";
}

std::optional<Estimate> change(const StudyRow& row, const Comparison& c) {
  const auto design = value(row, c.of, c.quantity), variant = value(row, c.variant, c.quantity);
  return design && variant ? std::optional(paired_difference(*design, *variant)) : std::nullopt;
}

std::string shown(const std::optional<Estimate>& e, int digits) {
  if (!e) return "-";
  return digits > 0 ? cell(e->value, digits) + " ± " + cell(e->error, digits)
                    : scientific(e->value) + " ± " + scientific(e->error);
}

std::vector<Estimate> changes(const std::vector<StudyRow>& rows, const Comparison& c) {
  std::vector<Estimate> list;
  for (const StudyRow& r : rows)
    if (const auto d = change(r, c)) list.push_back(*d);
  return list;
}

std::string summary_text(const std::vector<StudyRow>& rows, const Comparison& c) {
  const auto s = summarize(changes(rows, c));
  std::string text = c.label + ": ";
  if (!s) return text + "nothing to compare\n";
  const auto figure = [&](double v) { return c.digits > 0 ? cell(v, c.digits) : scientific(v); };
  text += lumo::message(s->above_zero, " of ", s->count(), " above 0 (", s->positive, " by more than twice the error, ",
      s->negative, " below by more, ", s->undecided, " undecided), median ", figure(s->median));
  if (s->median_95)
    text += " (95 % interval " + figure(s->median_95->first) + " … " + figure(s->median_95->second) + ")";
  if (s->count() < rows.size()) text += lumo::message("; ", rows.size() - s->count(), " variants without a value");
  return text + "\n" + (c.paper.empty() ? "" : "  paper: " + c.paper + "\n");
}

Json summary_json(const std::vector<StudyRow>& rows, const Comparison& c) {
  Json j = {{"quantity", c.quantity}, {"variant", c.variant}, {"of", c.of.empty() ? "design" : c.of},
      {"paper", c.paper.empty() ? Json(nullptr) : Json(c.paper)}};
  const auto s = summarize(changes(rows, c));
  j["count"] = s ? s->count() : 0;
  if (s) append(j, json(*s));
  return j;
}

/// All designs, sorted by their difference.
std::string picture(const std::vector<StudyRow>& rows, const Comparison& c, const std::string& of_what) {
  std::vector<Estimate> sorted = changes(rows, c);
  std::sort(sorted.begin(), sorted.end(), [](const Estimate& a, const Estimate& b) { return a.value < b.value; });
  BarChart chart;
  chart.title = c.label;
  chart.subtitle = lumo::message(sorted.size(), " designs, ", of_what);
  chart.x_label = "designs, sorted";
  chart.y_label = c.quantity == "D" ? "ΔD [W/W]" : "Δ" + c.quantity + " [–]";
  chart.series = {{"", palette[0], {}, {}}};
  for (std::size_t k = 0; k < sorted.size(); ++k) {
    chart.categories.push_back(k % 5 == 4 ? std::to_string(k + 1) : "");
    chart.series[0].values.push_back(sorted[k].value);
    chart.series[0].errors.push_back(sorted[k].error);
  }
  return draw(chart);
}

std::string table(const std::vector<StudyRow>& rows, const StudyPlan& plan) {
  std::string text;
  for (const Variable& v : finger_space().variables) text += v.name + "_mm,";
  for (const std::string q : {"J_contact", "D"})
    if (q == "J_contact" || plan.study.light) text += q + "," + q + "_err,";
  for (const Comparison& c : plan.comparisons)
    text += c.quantity + "_" + c.name() + "," + c.quantity + "_" + c.name() + "_err,";
  text.back() = '\n';
  for (const StudyRow& r : rows) {
    text += joined(r.theta_mm);
    const auto add = [&](const std::optional<Estimate>& e) {
      text += "," + (e ? Json(e->value).dump() : "") + "," + (e ? Json(e->error).dump() : "");
    };
    add(value(r, "", "J_contact"));
    if (plan.study.light) add(value(r, "", "D"));
    for (const Comparison& c : plan.comparisons) add(value(r, c.variant, c.quantity));
    text += "\n";
  }
  return text;
}

/// What stands in `j`, and all designs with a summary.
std::string json_text(Json j, const std::vector<StudyRow>& rows, const StudyPlan& plan) {
  j["designs"] = Json::array();
  j["summary"] = Json::array();
  for (const StudyRow& r : rows) {
    j["designs"].push_back({{"theta_mm", numbers(r.theta_mm)}});
    for (const Comparison& c : plan.comparisons) {
      const auto d = change(r, c);
      j["designs"].back()[c.name() + " delta_" + c.quantity] = d ? Json{d->value, d->error} : Json(nullptr);
    }
    j["designs"].back()["record"] = r.record;
  }
  for (const Comparison& c : plan.comparisons) j["summary"].push_back(summary_json(rows, c));
  return j.dump(1) + "\n";
}

std::string result_text(const std::vector<StudyRow>& rows, const StudyPlan& plan) {
  std::string text = pad("theta [mm]", -20) + pad("J_contact", 18);
  for (const Comparison& c : plan.comparisons) text += "  " + pad("Δ" + c.quantity + ", " + c.name(), 29);
  text += "\n";
  for (const StudyRow& r : rows) {
    text += pad(joined(r.theta_mm), -20) + pad(shown(value(r, "", "J_contact"), 4), 19);
    for (const Comparison& c : plan.comparisons) text += "  " + pad(shown(change(r, c), c.digits), 29);
    for (const Twin t : plan.study.twins)
      if (const std::string variant(to_string(t)), said = why(r, variant); !said.empty())
        text += "  " + variant + ": " + said;
    text += "\n";
  }
  text += "\n";
  for (const Comparison& c : plan.comparisons) text += summary_text(rows, c);
  return text;
}

/// Each design against its variants.
struct StudyVariants : StudyCommand {
  StudyPlan (*plan_for)(const FingerOptions&);
  std::string scenario = "middle";

  explicit StudyVariants(StudyPlan (*p)(const FingerOptions&)) : plan_for(p) {}

  void declare(CLI::App& app) {
    StudyCommand::declare(
        app, {"Feasible designs to compare, default 40", "All contacts of an ensemble, in place of a scenario"});
    add_value(app, "--scenario", "NAME",
        "middle (default: 10 and 30 mm at y = 0) or authors (20 mm at y = -5.5 mm, 1 to 10 N, as their code has it)",
        [this](const std::string& typed) {
          scenario = one_of("--scenario", typed, {"middle", "authors"});
        });
    add_mode(app, effective);
  }
  /// Of the designs that are compared.
  DesignSpace space(const StudyPlan& plan) const {
    DesignSpace s = finger_space(asked().pad.finger.pad);
    if (plan.study.twins.front() == Twin::no_void)  // without a gap there is nothing to compare
      s.variables.back().lower = s.variables.back().step;
    return s;
  }
  std::string contacts_name() const { return whole_ensemble() ? name(asked().ensemble) : scenario; }
  std::string problem_text(const StudyPlan& plan, const Problem& problem, const Configuration& computed) const {
    Json j = {{"study", plan.title}};
    append(j, conditions(computed, evaluation_groups));
    j["sobol"] = problem.sobol;
    j["seed"] = seed;
    return line_by_line(j);
  }

  Result run(Output& files, Progress& progress) const {
    StudyTools used = tools;
    used.asked = asked();
    const StudyPlan plan = plan_for(asked().pad.finger);
    if (!whole_ensemble()) used.asked.ensemble = scenario == "authors" ? authors_study_contact() : middle_contacts();
    const Evaluator evaluate =
        study_evaluator(used, plan.study, progress);  // before a store is opened, for the mesher forks
    const auto line = [&](const StudyRow& row) {
      std::string text;
      for (const Comparison& c : plan.comparisons)
        text += "  " + c.name() + " Δ" + c.quantity + " " + shown(change(row, c), c.digits);
      return text;
    };
    const Problem problem = study_problem(space(plan), designs, std::uint64_t(seed));
    const std::vector<StudyRow> rows =
        study_rows(store, problem_text(plan, problem, used.asked), problem, evaluate, line, progress);
    const std::string file = "study_" + plan.title;
    files.add(file + ".csv", table(rows, plan));
    if (files.wanted())
      for (const Comparison& c : plan.comparisons)
        files.add(file + "_" + c.name() + "_" + c.quantity + ".svg",
            picture(rows, c, lumo::message(asked().pad.material(), ", ", contacts_name(), " contacts")));
    if (!json) return result_text(rows, plan);
    return json_text({{"study", plan.title}, {"material", asked().pad.material()}, {"contacts", contacts_name()},
                         {"seed", seed}, {"configuration", tree_of(used.asked)}},
        rows, plan);
  }
};

}  // namespace

void add_study_variants(CommandLine& line) {
  static_assert(most_designs == largest_study);
  line.add("study carrier", "Each design against pads without a carrier in them", StudyVariants(carrier_plan));
  line.add("study void", "Each design against itself without lateral voids", StudyVariants(void_plan));
}

}  // namespace lumo::program
