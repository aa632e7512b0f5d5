// Makes a campaign's store without simulations: the program's own optimiser, log and record schema over a made-up evaluation in closed form.
//
// usage: make_store FILE DS|Sol flat|curved EVALUATIONS   a campaign with that many results and, as trial 6, one failure; 0: all fail
//        make_store FILE DS|Sol flat|curved h,h,w,h,w     a campaign whose one result is this design
// With a number behind, the store says that its results are of that version.
#include "store/campaign_problem.hpp"
#include "computing/contacts.hpp"
#include "report/json.hpp"

#include "lumo/support/sqlite.hpp"

#include <cmath>
#include <cstdlib>
#include <iostream>
#include <sstream>
#include <string>

namespace {

using namespace lumo;
using namespace lumo::program;

constexpr int bins = 11;

double bump(double x, double middle, double width) { return std::exp(-0.5 * std::pow((x - middle) / width, 2)); }

/// Objectives that pull against each other: high soft domes for contact, wide gaps and thin pads for light.
double contact_of(const Design& x) { return 0.7 * bump(x[1], 11.0, 7.0) * bump(x[3], 3.0, 8.0) * bump(x[4], 1.0, 6.0); }
double light_of(const Design& x) { return 4e-5 * bump(x[0], 4.0, 5.0) * bump(x[2], 9.0, 5.0) * bump(x[4], 4.0, 3.0) * bump(x[1], 6.0, 6.0); }

/// Hertz's law for the depth, light that changes around the touched place.
EvaluationResult made_up(const Design& x, const lumo::Ensemble& ensemble) {
  EvaluationResult e;
  e.J_contact = contact_of(x), e.J_contact_err = 0.004;
  e.J_obs = light_of(x), e.J_obs_err = 0.1 * e.J_obs;
  for (int b = 0; b < bins; ++b) e.unloaded_response.push_back(1.4e-3 - 1e-5 * std::abs(b - 5));
  for (const auto& s : ensemble.scenarios()) {
    ScenarioReport r;
    const double radius_mm = 1e3 * s.indenter.radius_m();
    r.diameter_mm = 2.0 * radius_mm, r.angle_deg = std::round(s.angle_rad * 180.0 / pi), r.y_mm = 1e3 * s.y_m;
    r.q_form = 0.5, r.q_stable = 0.6, r.q_stiff = 0.7;
    for (const double load_N : s.loads_N) {
      StateReport k;
      k.load_N = k.force_N = load_N;
      k.depth_mm = std::pow(load_N / (0.7 * std::sqrt(radius_mm)), 2.0 / 3.0);
      k.contact_area_mm2 = pi * radius_mm * k.depth_mm, k.reference_area_mm2 = 0.9 * k.contact_area_mm2, k.residual_N = 1e-9;
      for (int b = 0; b < bins; ++b) {
        const double away_mm = 5.0 * (b - 5) - r.y_mm;
        k.response.push_back(e.unloaded_response[std::size_t(b)] + 20.0 * e.J_obs * k.depth_mm * (bump(away_mm, 0.0, 5.0) - 0.4 * bump(away_mm, 12.0, 6.0)));
      }
      r.states.push_back(std::move(k));
    }
    e.scenarios.push_back(std::move(r));
  }
  e.worst_contact = WorstContact{10.0, 0.0, -22.0, e.J_contact};
  e.worst_observation = WorstObservation{10.0, 0.0, 1.0, -22.0, -11.0, e.J_obs};
  e.ledger = {1.0, 0.014, 0.012, 0.344, 0.62, 0.01, 0.0, 0.0};
  e.size = {25000, 15000};
  return e;
}

Verdict verdict(const Design& x, const CampaignProblem& problem, bool fails) {
  Verdict v;
  Json record = {{"theta_mm", numbers(x)}, {"material", problem.material}, {"ensemble", name(problem.ensemble)}};
  // What a page must show as it stands, and not obey.
  if (fails) v.why = "press: inverted at 15 N, </script><img src=x onerror=alert(1)> & \"quotes\", {{script}}, no UTF-8: \xff";
  if (fails) record["why"] = "see the entry";
  else {
    const EvaluationResult e = made_up(x, contacts(problem.ensemble));
    v.outputs = {e.J_contact, e.J_obs};
    append(record, json(e));
  }
  v.record = record.dump();
  v.notes = Json{{"lumo", "0.1.0"}, {"threads", 2}, {"machine", {{"processor", "an abacus"}, {"system", "Linux 0"}, {"compiler", "g++ 12"}, {"TetGen", "1.5.0"}, {"Embree", "3.13.5"}, {"CHOLMOD", "3.0.14"}}}, {"seconds", json(Seconds{1.0, 90.0, 60.0, 151.0})}}.dump();
  return v;
}

void run(SqliteLog& log, const CampaignProblem& problem, int evaluations) {
  int trial = 0;
  const auto evaluate = [&](const Design& x) {
    const bool fails = evaluations == 0 || trial == 6;
    ++trial;
    return verdict(x, problem, fails);
  };
  try {
    with_optimizer(problem, std::max(1, evaluations), [&](const auto& optimizer) { return run_campaign(log, optimizer, evaluate, [](const auto&...) {}); });
  } catch (const CampaignError&) {   // all fail, as asked for
    if (evaluations > 0) throw;
  }
}

void keep(SqliteLog& log, const CampaignProblem& problem, const Design& x) {
  log.append([&](const auto&) { return std::optional(lumo::detail::ask_entry(0, x)); });
  const Verdict v = verdict(x, problem, false);
  LogEntry entry = lumo::detail::tell_entry(0, v.outputs);
  entry.record = v.record, entry.notes = v.notes;
  log.append([&](const auto&) { return std::optional(entry); });
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 5 && argc != 6) {
    std::cerr << "usage: make_store FILE DS|Sol flat|curved EVALUATIONS|DESIGN [VERSION]\n";
    return 2;
  }
  try {
    const CampaignProblem problem{argv[2], std::string(argv[3]) == "curved" ? lumo::program::Ensemble::curved : lumo::program::Ensemble::flat};
    std::string text = problem_text(problem);
    const std::string version = "\"results\": ";
    const std::size_t at = text.find(version) + version.size();
    if (argc == 6) text.replace(at, text.find(',', at) - at, argv[5]);
    SqliteLog log(argv[1], text);
    const std::string wanted = argv[4];
    if (wanted.find(',') == std::string::npos) {
      run(log, problem, std::atoi(argv[4]));
      return 0;
    }
    Design x;
    std::istringstream fields(wanted);
    for (std::string field; std::getline(fields, field, ',');) x.push_back(std::atof(field.c_str()));
    keep(log, problem, x);
  } catch (const std::exception& e) {
    std::cerr << e.what() << "\n";
    return 1;
  }
}
