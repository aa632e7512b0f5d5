#include "store/campaign_problem.hpp"

#include "report/json.hpp"

#include <cmath>

namespace lumo {

template class GaussianProcess<>;
template class Optimizer<>;
template class Optimizer<RbfKernel, LogNehvi, FreshCandidates>;

}  // namespace lumo

namespace lumo::program {

namespace {

Json with_limits(const LinearConstraint& c) {
  Json j = {{"coefficients", c.coefficients}, {"unit", c.unit}};
  if (std::isfinite(c.lower)) j["lower"] = c.lower;
  if (std::isfinite(c.upper)) j["upper"] = c.upper;
  return j;
}

Json problem_json(const CampaignProblem& p) {
  const Problem problem = problem_of(p.asked, 1);
  Json j = {{"campaign", 1}};
  append(j, conditions(p.asked, evaluation_groups));
  for (const Variable& v : problem.space.variables)
    j["variable " + v.name] = {{"lower", v.lower}, {"upper", v.upper}, {"step", v.step}, {"unit", v.unit}};
  for (const LinearConstraint& c : problem.space.constraints) j["constraint " + c.name] = with_limits(c);
  for (const Objective& o : problem.objectives)
    j["objective " + o.name] = {{"goal", o.maximize ? "maximize" : "minimize"}, {"reference", o.reference}};
  j["initial"] = problem.initial;
  j["sobol"] = problem.sobol;
  j["source"] = p.asked.search.source;
  if (p.asked.search.pending != 1) j["pending"] = p.asked.search.pending;  // stores from before it have none
  if (p.asked.search.noise != Noise::none)                                 // nor this: they know of no errors
    j["noise"] = p.asked.search.noise == Noise::present ? "present" : "estimated";
  j["seed"] = p.asked.search.seed;
  for (std::size_t k = 0; k < p.known.size(); ++k) {
    const auto& [result, results] = p.known[k];
    Json& one = j[lumo::message("known ", k)] = {{"theta_mm", result.x}, {"values", result.outputs}};
    if (!result.errors.empty()) one["errors"] = result.errors;
    if (results) one["results"] = *results;
  }
  return j;
}

std::vector<KnownEvaluation> known_in(const Json& problem) {
  std::vector<KnownEvaluation> known;
  for (std::size_t k = 0; problem.contains(lumo::message("known ", k)); ++k) {
    const Json& one = problem[lumo::message("known ", k)];
    known.push_back({{one.at("theta_mm").get<Design>(), one.at("values").get<std::vector<double>>(),
        one.value("errors", std::vector<double>())}});
    if (one.contains("results")) known.back().results = one["results"].get<int>();
  }
  return known;
}

/// Does a problem of other results search the same designs for the same objectives? What else decides its numbers may
/// differ.
bool same_search(const Json& a, const Json& b) {
  const auto search = [](const Json& problem) {
    nlohmann::json part;  // in any order
    for (const auto& [key, value] : problem.items())
      if (key.starts_with("variable ") || key.starts_with("constraint ") || key.starts_with("objective ") ||
          key == "campaign" || key == "initial" || key == "sobol")
        part[key] = value;
    return part;
  };
  return search(a) == search(b);
}

Configuration configuration_in(const Json& problem) {
  Json tree = Json::object();
  for (const std::string& group : evaluation_groups) tree[group] = problem.at(group);
  return configuration_of(tree);
}

/// Of stores up to results 10, which knew one finger.
Configuration before_configurations(const Json& problem) {
  Configuration c;
  c.pad.finger = plain_finger();
  c.pad.silicone = silicone(problem.at("material").get<std::string>());
  c.ensemble = problem.at("ensemble").get<std::string>() == "curved" ? curved_ensemble() : flat_ensemble();
  if (problem.contains("mechanics")) c.mechanics = paper_mechanics();
  if (problem.contains("ray_error_percent")) c.light.ray_error_percent = problem["ray_error_percent"].get<double>();
  return c;
}

References references_in(const Json& problem) {
  Json built = Json::array();
  for (const FingerDesign& d : built_references()) built.push_back(d.values());
  return problem.at("initial") == built ? References::built : References::plain;
}

}  // namespace

Problem problem_of(const CampaignProblem& p, int evaluations) {
  Problem problem = problem_of(p.asked, evaluations);
  problem.noise = p.asked.search.noise;
  for (const KnownEvaluation& k : p.known) {
    problem.known.push_back(k.result);
    problem.known.back().stands = k.results.value_or(p.results) == p.results;
  }
  return problem;
}

std::string values_words(const std::vector<std::string>& modelled) {
  if (modelled.empty()) return "as reported";
  return "means of the models, as there is noise: " +
         listing(modelled, [](const std::string& name) { return one_line(name); });
}

std::string problem_text(const CampaignProblem& p) { return line_by_line(problem_json(p)); }

CampaignProblem read_problem(const std::string& text, const std::string& store) {
  const Json j = Json::parse(text, nullptr, false);
  try {
    CampaignProblem p;
    p.results = j.at("results").get<int>();
    p.asked = j.at("ensemble").is_string() ? before_configurations(j) : configuration_in(j);
    p.asked.search.source = j.at("source").get<std::string>();
    p.asked.search.seed = j.at("seed").get<int>();
    p.asked.search.pending = j.value("pending", 1);
    const std::string noise = j.value("noise", "none");
    p.asked.search.noise = noise == "none" ? Noise::none : noise == "present" ? Noise::present : Noise::estimated;
    p.known = known_in(j);
    p.asked.search.references = references_in(j);
    if (p.results == results_version ? text == problem_text(p) : same_search(j, problem_json(p))) return p;
  } catch (const nlohmann::json::exception&) {
  } catch (const Misfit&) {
  } catch (const Error&) {  // an unknown silicone or key
  }
  throw InputError("store '" + store + "' belongs to another problem, or to another version of lumo");
}

}  // namespace lumo::program
