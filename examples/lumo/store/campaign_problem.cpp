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
  const Problem problem = finger_problem(1, p.seed);
  Json j = {{"campaign", 1}};
  append(j, conditions(p.material, name(p.ensemble), contacts(p.ensemble)));
  if (p.paper) j["mechanics"] = json(p.mechanics());
  for (const Variable& v : problem.space.variables)
    j["variable " + v.name] = {{"lower", v.lower}, {"upper", v.upper}, {"step", v.step}, {"unit", v.unit}};
  for (const LinearConstraint& c : problem.space.constraints) j["constraint " + c.name] = with_limits(c);
  for (const Objective& o : problem.objectives)
    j["objective " + o.name] = {{"goal", o.maximize ? "maximize" : "minimize"}, {"reference", o.reference}};
  j["ray_error_percent"] = p.ray_error_percent;
  j["initial"] = problem.initial;
  j["sobol"] = problem.sobol;
  j["source"] = p.source;
  j["seed"] = p.seed;
  return j;
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

}  // namespace

std::string problem_text(const CampaignProblem& p) { return line_by_line(problem_json(p)); }

CampaignProblem read_problem(const std::string& text, const std::string& store) {
  const Json j = Json::parse(text, nullptr, false);
  try {
    CampaignProblem p;
    p.material = j.at("material").get<std::string>();
    p.ensemble = j.at("ensemble").get<std::string>() == "curved" ? Ensemble::curved : Ensemble::flat;
    p.paper = j.contains("mechanics");
    p.results = j.at("results").get<int>();
    if (j.contains("ray_error_percent") || p.results == results_version)
      p.ray_error_percent = j.at("ray_error_percent").get<double>();
    p.source = j.at("source").get<std::string>();
    p.seed = j.at("seed").get<std::uint64_t>();
    if (p.results == results_version ? text == problem_text(p) : same_search(j, problem_json(p))) return p;
  } catch (const nlohmann::json::exception&) {
  } catch (const InvalidArgument&) {  // an unknown silicone
  }
  throw InputError("store '" + store + "' belongs to another problem, or to another version of lumo");
}

}  // namespace lumo::program
