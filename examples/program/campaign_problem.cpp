#include "program/campaign_problem.hpp"

#include "program/contacts.hpp"
#include "program/json.hpp"

#include <cmath>

namespace lumo::program {

namespace {

/// Raised whenever an evaluation of the same design gives other numbers than before.
constexpr int results = 1;

Json scaled(const std::vector<double>& values, double unit) {
  Json a = Json::array();
  for (const double v : values) a.push_back(std::round(v / unit * 1e6) / 1e6);
  return a;
}

Json with_limits(const LinearConstraint& c) {
  Json j = {{"coefficients", c.coefficients}, {"unit", c.unit}};
  if (std::isfinite(c.lower)) j["lower"] = c.lower;
  if (std::isfinite(c.upper)) j["upper"] = c.upper;
  return j;
}

}  // namespace

std::string problem_text(const CampaignProblem& p) {
  const lumo::Ensemble ensemble = contacts(p.ensemble);
  const Silicone card = silicone(p.material);
  const Problem problem = finger_problem(1, p.seed);
  Json j = {{"campaign", 1},
            {"results", results},
            {"material", p.material},
            {"shear_modulus_Pa", card.mu_Pa},
            {"first_lame_parameter_Pa", card.lambda_Pa},
            {"ensemble", name(p.ensemble)},
            {"diameters_mm", scaled(ensemble.diameters_m, 1e-3)},
            {"angles_deg", scaled(ensemble.angles_rad, pi / 180.0)},
            {"places_mm", scaled(ensemble.places_m, 1e-3)},
            {"loads_N", ensemble.loads_N}};
  for (const Variable& v : problem.space.variables) j["variable " + v.name] = {{"lower", v.lower}, {"upper", v.upper}, {"step", v.step}, {"unit", v.unit}};
  for (const LinearConstraint& c : problem.space.constraints) j["constraint " + c.name] = with_limits(c);
  for (const Objective& o : problem.objectives) j["objective " + o.name] = {{"goal", o.maximize ? "maximize" : "minimize"}, {"reference", o.reference}};
  j["initial"] = problem.initial;
  j["sobol"] = problem.sobol;
  j["source"] = p.source;
  j["seed"] = p.seed;
  std::string text;
  for (const auto& [key, value] : j.items()) text += (text.empty() ? "{" : ",\n ") + Json(key).dump() + ": " + value.dump();
  return text + "}";
}

CampaignProblem read_problem(const std::string& text, const std::string& store) {
  const Json j = Json::parse(text, nullptr, false);
  try {
    CampaignProblem p;
    p.material = j.at("material").get<std::string>();
    p.ensemble = j.at("ensemble").get<std::string>() == "curved" ? Ensemble::curved : Ensemble::flat;
    p.source = j.at("source").get<std::string>();
    p.seed = j.at("seed").get<std::uint64_t>();
    if (text == problem_text(p)) return p;
  } catch (const nlohmann::json::exception&) {
  } catch (const InvalidArgument&) {   // an unknown silicone
  }
  throw InputError("store '" + store + "' belongs to another problem, or to another version of lumo");
}

}  // namespace lumo::program
