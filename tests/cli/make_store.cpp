// Makes a campaign's store without simulations: the program's own optimiser, log and record schema over a made-up
// evaluation in closed form.
//
// Of a plain finger, unless -built stands behind flat or curved.
//
// usage: make_store FILE DS|Sol flat|curved EVALUATIONS   a campaign with that many results and, as trial 6, one
// failure; 0: all fail
//        make_store FILE DS|Sol flat|curved h,h,w,h,w     a campaign whose one result is this design
// Behind that, in any order: a number, and the store says that its results are of that version; "errors": they carry
// their errors; "exact": the search knows of no errors, as those of earlier versions.
#include "computing/contacts.hpp"
#include "report/records.hpp"
#include "store/campaign_problem.hpp"

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
bool with_errors = false;  // does the journal have those of the objectives?

double bump(double x, double middle, double width) { return std::exp(-0.5 * std::pow((x - middle) / width, 2)); }

/// Objectives that pull against each other: high soft domes for contact, wide gaps and thin pads for light.
double contact_of(const Design& x) { return 0.7 * bump(x[1], 11.0, 7.0) * bump(x[3], 3.0, 8.0) * bump(x[4], 1.0, 6.0); }
double light_of(const Design& x) {
  return 4e-5 * bump(x[0], 4.0, 5.0) * bump(x[2], 9.0, 5.0) * bump(x[4], 4.0, 3.0) * bump(x[1], 6.0, 6.0);
}

/// Hertz's law for the depth, light that changes around the touched place.
StateRecord made_up(double load_N, double radius_mm, double y_mm, double J_obs, const std::vector<double>& unloaded) {
  StateRecord k;
  k.status = Status::converged;
  k.load_N = k.force_N = load_N;
  const double depth_mm = std::pow(load_N / (0.7 * std::sqrt(radius_mm)), 2.0 / 3.0);
  k.depth_m = 1e-3 * depth_mm;
  k.contact_area_m2 = 1e-6 * pi * radius_mm * depth_mm;
  k.reference_area_m2 = 0.9 * k.contact_area_m2;
  k.residual_N = 1e-9;
  k.penetration_m = undefined;
  for (int b = 0; b < bins; ++b) {
    const double away_mm = 5.0 * (b - 5) - y_mm, change = bump(away_mm, 0.0, 5.0) - 0.4 * bump(away_mm, 12.0, 6.0);
    k.response.push_back(unloaded[std::size_t(b)] + 20.0 * J_obs * depth_mm * change);
  }
  return k;
}

Evaluation made_up(const Design& x, const lumo::Ensemble& ensemble) {
  Evaluation e;
  Observations& seen = e.observations;
  e.J_contact = Estimate{contact_of(x), 0.004};
  e.J_obs = Estimate{light_of(x), 0.1 * light_of(x)};
  for (int b = 0; b < bins; ++b) seen.unloaded_response.push_back(1.4e-3 - 1e-5 * std::abs(b - 5));
  for (const auto& s : ensemble.scenarios()) {
    if (s.indenter.diameter_m == 10e-3 && s.angle_rad == 0.0 && s.y_m == -22e-3)
      e.worst_contact = seen.scenarios.size();
    ScenarioRecord r{s.indenter.diameter_m, s.angle_rad, s.y_m, Status::converged, {}, {}, s.tilt};
    r.terms = {Estimate{0.5, 0.0}, Estimate{0.6, 0.0}, Estimate{0.7, 0.0}};
    for (const double load_N : s.loads_N)
      r.states.push_back(
          made_up(load_N, 1e3 * s.indenter.radius_m(), 1e3 * s.y_m, e.J_obs->value, seen.unloaded_response));
    seen.scenarios.push_back(std::move(r));
  }
  e.observed = {{0, 10e-3, 0.0, -22e-3, 1.0, {}}, {1, 10e-3, 0.0, -11e-3, 1.0, {}}};
  e.worst_observation = Separation{*e.J_obs, 0, 1};
  seen.ledger = {1.0, {0.014}, 0.012, 0.344, 0.62, 0.01};
  seen.nodes = 25000;
  seen.elements = 15000;
  return e;
}

TrialResult verdict(const Design& x, const CampaignProblem& problem, bool fails) {
  TrialResult v;
  Json record = {{"theta_mm", numbers(x)}, {"material", problem.material()}, {"ensemble", problem.ensemble()}};
  // What a page must show as it stands, and not obey.
  if (fails)
    v.why = "press: inverted at 15 N, </script><img src=x onerror=alert(1)> & \"quotes\", {{script}}, no UTF-8: \xff";
  if (fails) record["why"] = "see the entry";
  else {
    const Evaluation e = made_up(x, problem.asked.ensemble);
    v.outputs = {e.J_contact->value, e.J_obs->value};
    if (with_errors) v.errors = {e.J_contact->standard_error(), e.J_obs->standard_error()};
    append(record, json(e));
  }
  v.record = record.dump();
  v.notes = Json{{"lumo", "0.1.0"}, {"threads", 2},
      {"machine", {{"processor", "an abacus"}, {"system", "Linux 0"}, {"compiler", "g++ 12"}, {"TetGen", "1.5.0"},
                      {"Embree", "3.13.5"}, {"CHOLMOD", "3.0.14"}}},
      {"seconds", json(Timing{1.0, 90.0, 60.0, 151.0})}}
                .dump();
  return v;
}

void run(SqliteStore& log, const CampaignProblem& problem, int evaluations) {
  int trial = 0;
  const auto evaluate = [&](const Design& x) {
    const bool fails = evaluations == 0 || trial == 6;
    ++trial;
    return verdict(x, problem, fails);
  };
  try {
    with_optimizer(problem, std::max(1, evaluations),
        [&](const auto& optimizer) { return run_campaign(log, optimizer, evaluate, [](const auto&...) {}); });
  } catch (const CampaignError&) {  // all fail, as asked for
    if (evaluations > 0) throw;
  }
}

void keep(SqliteStore& log, const CampaignProblem& problem, const Design& x) {
  log.append([&](const auto&) { return std::optional(lumo::ask_entry(0, x)); });
  const TrialResult v = verdict(x, problem, false);
  JournalEntry entry = lumo::tell_entry(0, v.outputs, v.errors);
  entry.record = v.record;
  entry.notes = v.notes;
  log.append([&](const auto&) { return std::optional(entry); });
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 5) {
    std::cerr << "usage: make_store FILE DS|Sol flat|curved EVALUATIONS|DESIGN [VERSION|errors|exact]...\n";
    return 2;
  }
  try {
    CampaignProblem problem;
    problem.asked.pad.silicone = silicone(argv[2]);
    if (!std::string(argv[3]).ends_with("-built")) {  // what select and report press takes a fraction of the time
      problem.asked.pad.finger = plain_finger();
      problem.asked.search.references = References::plain;
    }
    if (std::string(argv[3]).starts_with("curved")) problem.asked.ensemble = curved_ensemble();
    std::string version;
    for (int k = 5; k < argc; ++k)
      if (argv[k] == std::string("errors")) with_errors = true;
      else if (argv[k] == std::string("exact")) problem.asked.search.noise = Noise::none;
      else version = argv[k];
    std::string text = problem_text(problem);
    const std::string key = "\"results\": ";
    const std::size_t at = text.find(key) + key.size();
    if (!version.empty()) text.replace(at, text.find(',', at) - at, version);
    SqliteStore log(argv[1], text);
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
