#include "report/report_model.hpp"

#include "computing/section.hpp"

#include "lumo/model/gaussian_process.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <initializer_list>
#include <set>

namespace lumo::program {

namespace {

constexpr int fewest_for_check = 5;
constexpr double normal_95 = 1.96;  // standard deviations about the mean that hold 95 % of a normal distribution

/// The designs that a campaign begins with: references, then others.
struct Starts {
  std::vector<Design> designs;
  std::size_t references = 0;
};

Starts starts(const CampaignProblem& problem) {
  return with_optimizer(problem, 1000, [](auto optimizer) {
    const std::vector<Design>& initial = optimizer.problem().initial;
    const std::vector<KnownResult>& known = optimizer.problem().known;
    Starts s;
    s.references = std::size_t(std::count_if(initial.begin(), initial.end(), [&](const Design& x) {
      return std::none_of(known.begin(), known.end(), [&](const KnownResult& k) { return k.x == x; });
    }));
    const std::size_t count = s.references + std::size_t(optimizer.problem().sobol);
    while (s.designs.size() < count)
      if (const auto trial = optimizer.ask()) s.designs.push_back(trial->x);
      else break;
    return s;
  });
}

/// Of a record what stands under these keys, where that is a number.
Json only_numbers(const Json& record, std::initializer_list<const char*> keys) {
  Json j = Json::object();
  for (const char* key : keys) j[key] = number(value_at(record, key));
  return j;
}

Json trial_model(const StoredTrial& t, const Starts& first) {
  const auto here = [&](const Design& x) { return std::equal(x.begin(), x.end(), t.theta_mm.begin()); };
  const auto start =
      std::size_t(std::find_if(first.designs.begin(), first.designs.end(), here) - first.designs.begin());
  Json j = {{"index", t.id}, {"theta_mm", numbers(t.theta_mm)},
      {"origin", start < first.references       ? "reference"
                 : start < first.designs.size() ? "sobol"
                                                : "search"},
      {"state", name(t.state)}, {"why", t.why}};
  append(j, only_numbers(t.record, {"J_contact", "J_contact_err", "J_obs", "J_obs_err"}));
  append(j, {{"hypervolume", number(t.hypervolume)}, {"on_front", t.on_front}, {"selected", t.selected},
                {"value", numbers(t.value)}, {"deviation", numbers(t.deviation)}});
  return j;
}

/// Each evaluation as a Gaussian process of the others predicts it.
Json model_check(const StoredCampaign& campaign, const char* objective) {
  const std::vector<Variable> variables = finger_space().variables;
  std::vector<const StoredTrial*> evaluated;
  for (const StoredTrial& t : campaign.trials)
    if (t.state == Trial::State::observed && std::isfinite(value_at(t.record, objective))) evaluated.push_back(&t);
  const auto n = Eigen::Index(evaluated.size()), dimensions = Eigen::Index(variables.size());
  if (n < fewest_for_check) return nullptr;
  TrainingData data{
      Eigen::MatrixXd(dimensions, n), Eigen::VectorXd(n), Eigen::VectorXd(dimensions), Eigen::VectorXd(dimensions)};
  for (Eigen::Index i = 0; i < dimensions; ++i) {
    data.lower[i] = variables[std::size_t(i)].lower;
    data.upper[i] = variables[std::size_t(i)].upper;
    for (Eigen::Index k = 0; k < n; ++k) data.x(i, k) = evaluated[std::size_t(k)]->theta_mm[std::size_t(i)];
  }
  for (Eigen::Index k = 0; k < n; ++k) data.y[k] = value_at(evaluated[std::size_t(k)]->record, objective);
  if (campaign.problem.asked.search.noise != Noise::none) {
    const std::size_t output = objective == std::string_view("J_contact") ? 0 : 1;
    data.errors.setZero(n);
    for (Eigen::Index k = 0; k < n; ++k)
      if (const Trial& t = campaign.asked[std::size_t(evaluated[std::size_t(k)]->id)]; !t.errors.empty())
        data.errors[k] = t.errors[output];
    if ((data.errors.array() == 0.0).all()) data.errors.resize(0);
  }
  const auto left_out = GaussianProcess<>::fit(data).leave_one_out();
  const Eigen::ArrayXd deviation = left_out.variance.array().sqrt(), z = (data.y - left_out.mean).array() / deviation;
  Json j = {{"objective", objective}, {"coverage", (z.abs() <= normal_95).cast<double>().mean()},
      {"standardised_rms", number(std::sqrt(z.square().mean()))}, {"points", Json::array()}};
  for (Eigen::Index k = 0; k < n; ++k)
    j["points"].push_back({{"index", evaluated[std::size_t(k)]->id}, {"computed", number(data.y[k])},
        {"predicted", number(left_out.mean[k])}, {"deviation", number(deviation[k])}});
  return j;
}

/// Null unless all of it is numbers.
Json all_numbers(const Json& list) {
  const bool good =
      list.is_array() && std::all_of(list.begin(), list.end(), [](const Json& v) { return v.is_number(); });
  return good ? list : Json(nullptr);
}

const Json& member(const Json& record, const char* key) {
  static const Json nothing;
  return record.is_object() && record.contains(key) ? record[key] : nothing;
}

/// Force, depth and light of all contacts of a design that was evaluated.
Json scenario_models(const Json& record) {
  Json list = Json::array();
  for (const Json& s : member(record, "scenarios")) {
    Json scenario = only_numbers(s, {"diameter_mm", "angle_deg", "y_mm"});
    scenario["states"] = Json::array();
    for (const Json& k : member(s, "states")) {
      Json state = only_numbers(k, {"load_N", "force_N", "depth_mm", "contact_area_mm2", "reference_area_mm2"});
      state["response"] = all_numbers(member(k, "response"));
      scenario["states"].push_back(std::move(state));
    }
    list.push_back(std::move(scenario));
  }
  return list;
}

Json section_model(const SectionDrawing& section) {
  static constexpr std::array parts = {"silicone", "carrier", "air", "LED"};  // by Fill
  Json areas = Json::array();
  for (const auto& a : section.areas) areas.push_back({{"part", parts[std::size_t(a.fill)]}, {"loop_mm", a.loop}});
  return {{"svg", draw(section)}, {"areas", areas}};
}

Json machine_model(const StoredCampaign& campaign) {
  std::set<std::string> versions, machines;
  std::set<int> threads;
  double seconds = 0.0;
  int timed = 0;
  for (const StoredTrial& t : campaign.trials) {
    if (const Json& v = member(t.notes, "lumo"); v.is_string()) versions.insert(v.get<std::string>());
    std::string machine;
    for (const auto& [key, value] :
        member(t.notes, "machine").items())  // libraries by name, the rest speaks for itself
      if (value.is_string())
        machine += (machine.empty() ? "" : ", ") + (std::isupper(static_cast<unsigned char>(key[0])) ? key + " " : "") +
                   value.get<std::string>();
    if (!machine.empty()) machines.insert(machine);
    if (const double n = value_at(t.notes, "threads"); n >= 1.0 && n <= 1e6) threads.insert(int(n));
    if (!std::isfinite(t.seconds())) continue;
    seconds += t.seconds();
    ++timed;
  }
  return {{"lumo", versions}, {"threads", threads}, {"machines", machines}, {"seconds", seconds}, {"timed", timed}};
}

}  // namespace

std::string campaign_name(const CampaignProblem& problem) {
  return problem.material() + ", " + problem.ensemble() + (problem.asked.mechanics.paper ? ", paper mode" : "");
}

Json campaign_model(const StoredCampaign& c, const std::string& store) {
  Json j = {{"store", store}, {"name", campaign_name(c.problem)}, {"material", c.problem.material()},
      {"ensemble", c.problem.ensemble()}, {"source", c.problem.asked.search.source},
      {"mechanics", json(c.problem.asked.mechanics)}, {"configuration", tree_of(c.problem.asked, evaluation_groups)},
      {"seed", c.problem.asked.search.seed}, {"digest", c.digest}, {"problem", c.problem_text},
      {"problem_digest", c.problem_digest}, {"results_version", c.problem.results},
      {"hypervolume", number(c.hypervolume)}, {"interval_90", interval_json(c)}, {"values", c.values()},
      {"modelled", c.modelled}, {"known", c.known_words()}, {"machine", machine_model(c)}, {"trials", Json::array()},
      {"model_check", {model_check(c, "J_contact"), model_check(c, "J_obs")}}, {"design", nullptr}};
  const Starts first = starts(c.problem);
  for (const StoredTrial& t : c.trials) j["trials"].push_back(trial_model(t, first));
  if (!c.selected) return j;

  const StoredTrial& best = c.trials[*c.selected];
  Pad design = c.problem.asked.pad;
  design.theta_mm = best.theta_mm;
  j["design"] = {{"theta_mm", numbers(best.theta_mm)}, {"section", section_model(make_section(design))},
      {"unloaded_response", all_numbers(member(best.record, "unloaded_response"))},
      {"scenarios", scenario_models(best.record)}, {"presses", Json::array()}};
  return j;
}

}  // namespace lumo::program
