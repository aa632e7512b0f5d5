// What a silicone's absorption does to the light of a pressed finger, where the paper gives one extinction and does not
// say how much of it is scattering: signs, ratios and J_obs that can be compared with what the authors measured.
//
// usage: lumo_absorption plain|built FOLDER
//
// Each silicone is pressed once at each place, and lit once for each assumption. FOLDER gets a table and pictures;
// built has two films over the LEDs, one that never closes (dry) and one that closes on touch (wet).
#include "charts/chart.hpp"

#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/optics/scattering_medium.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/pipeline/evaluate.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "lumo/support/tetgen.hpp"

#include <array>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace {

using namespace lumo;

constexpr int fine = 55, coarse = 11, parts = 6;  // bins of 1 mm, regions of 5 mm, equal parts as the authors have them
constexpr std::size_t second_load = 1, last_load = 4;
const std::vector<double> places_m = {0.0, 5.5_mm, 11.0_mm};  // on an LED, between two, on the next
constexpr std::size_t on_led = 0, between = 1;

double cpu_s() { return double(std::clock()) / CLOCKS_PER_SEC; }

struct Assumption {
  std::string silicone, absorbed;
  double anisotropy;
  Silicone card;
};

/// Of one silicone: all of the extinction absorbed, as the paper has it, then less.
std::vector<Assumption> assumptions_of(const Silicone& card) {
  std::vector<Assumption> all = {{card.name, "all", 0.0, card}};
  for (const int per_m : {41, 20, 7})
    if (per_m < card.extinction_per_m())
      for (const double g : {0.0, 0.9})
        all.push_back({card.name, std::to_string(per_m), g, scattering_the_rest(card, per_m, g)});
  return all;
}

/// Sums of neighbouring channels: what wider regions would have seen.
Eigen::MatrixXd merged(const Eigen::MatrixXd& change, int groups) {
  Eigen::MatrixXd sums = Eigen::MatrixXd::Zero(change.rows(), groups);
  for (Eigen::Index k = 0; k < change.cols(); ++k) sums.col(k * groups / change.cols()) += change.col(k);
  return sums;
}

/// J_obs of the contacts, in regions as wide as the paper's; its error is that of rays, two standard errors.
Estimate least_distance(const Observations& seen) {
  std::vector<ObservedState> states = observed_states(seen.scenarios);
  for (ObservedState& s : states) s.change = merged(s.change, coarse);
  return optical_separation(states, {.area = 0.0})->distance;
}

/// Change of the power through each bin from the second load to the last.
Eigen::VectorXd change_between_loads(const Observations& seen, std::size_t place) {
  const auto& states = seen.scenarios[place].states;
  return (states[last_load].change - states[second_load].change).colwise().mean().transpose();
}

/// RMS of the bins of each part.
std::array<double, parts> part_rms(const Eigen::VectorXd& bins) {
  std::array<double, parts> squares{}, counts{};
  for (Eigen::Index k = 0; k < bins.size(); ++k) {
    const auto p = std::size_t(k * parts / bins.size());
    squares[p] += bins[k] * bins[k];
    counts[p] += 1.0;
  }
  for (std::size_t p = 0; p < parts; ++p) squares[p] = std::sqrt(squares[p] / counts[p]);
  return squares;
}

/// The strongest part over the mean of those that are two or more away.
double peak_over_far(const std::array<double, parts>& rms) {
  const auto peak = std::max_element(rms.begin(), rms.end()) - rms.begin();
  double far = 0.0;
  int count = 0;
  for (int p = 0; p < parts; ++p)
    if (std::abs(p - int(peak)) >= 2) {
      far += rms[std::size_t(p)];
      ++count;
    }
  return rms[std::size_t(peak)] * count / far;
}

/// Change in the region of the contact, over the mean unloaded region.
double at_contact(const Observations& seen, std::size_t place) {
  const Eigen::MatrixXd regions = merged(change_between_loads(seen, place).transpose(), coarse);
  double rest = 0.0;
  for (const double r : seen.unloaded_response) rest += r / coarse;
  return regions(0, Eigen::Index((places_m[place] + 27.5e-3) / 5e-3)) / rest;
}

using Simulation = Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<MixedCholesky>>;
using Light = Tracer<ScatteringMedium, ExitPower, Embree>;
using Stages = Pipeline<TetgenMesher, Simulation, Light>;

struct Study {
  std::string body;
  std::ofstream table;
  std::filesystem::path folder;
  std::map<std::string, program::LineChart> pictures;  ///< by film and place

  void row(const std::string& film, const Assumption& a, const Observations& seen, double seconds, double clear_s);
  void curve(const std::string& film, const Assumption& a, const Observations& seen, std::size_t place);
};

void Study::row(
    const std::string& film, const Assumption& a, const Observations& seen, double seconds, double clear_s) {
  const Estimate J = least_distance(seen);
  double rest = 0.0;
  for (const double r : seen.unloaded_response) rest += r;
  const auto rms = part_rms(change_between_loads(seen, between));
  table << message(body, film.empty() ? "" : "-", film, ",", a.silicone, ",", a.absorbed, ",", a.anisotropy, ",", rest,
      ",", J.value, ",", 0.5 * J.error, ",", at_contact(seen, on_led), ",", at_contact(seen, between), ",",
      peak_over_far(rms), ",", *std::max_element(rms.begin(), rms.end()), ",", seconds, ",", seconds / clear_s);
  for (const double r : rms) table << ',' << r;
  table << std::endl;
}

void Study::curve(const std::string& film, const Assumption& a, const Observations& seen, std::size_t place) {
  // Of what is scattered, forwards alone: isotropic scattering leaves too much noise for a curve.
  if (a.absorbed != "all" && (a.silicone == "Sol" || a.anisotropy == 0.0)) return;
  const std::string name = body + (film.empty() ? "" : "_" + film) + (place == on_led ? "_on_led" : "_between");
  program::LineChart& chart = pictures[name];
  chart.title = "From 2 to 15 N, 10 mm sphere " + std::string(place == on_led ? "on an LED" : "between two LEDs");
  chart.subtitle =
      body + (film.empty() ? "" : ", " + film + " film") + ", 5,9,7.6,6,2; absorbed per m, the rest scattered";
  chart.x_label = "y [mm]";
  chart.y_label = "change of power through 1 mm [1e-6 W/W]";
  const std::string g = a.absorbed == "all" ? "" : message(", g = ", a.anisotropy);
  const auto& [blue, red, green, pink, orange, sky, black] = program::palette;
  const std::array<const char*, 4> colours = {black, blue, green, red};
  const std::array<std::string, 4> amounts = {"all", "41", "20", "7"};
  const auto k = std::size_t(std::find(amounts.begin(), amounts.end(), a.absorbed) - amounts.begin());
  program::Curve c;
  c.label = a.silicone + " " + (k == 0 ? message(std::lround(a.card.extinction_per_m()), " (all)") : a.absorbed) + g;
  c.colour = a.silicone == "Sol" ? pink : colours[k];
  const Eigen::VectorXd change = change_between_loads(seen, place);
  for (Eigen::Index i = 0; i < change.size(); ++i) c.points.push_back({double(i) - 27.0, 1e6 * change[i]});
  chart.curves.push_back(std::move(c));
}

std::vector<std::pair<std::string, FingerOptions>> films_of(const std::string& body) {
  if (body == "plain") {
    FingerOptions plain = plain_finger();
    plain.readout.one_side = true;
    return {{"", plain}};
  }
  FingerOptions wet = built_finger();
  wet.recess.film_closes = 0.0;
  return {{"dry", built_finger()}, {"wet", wet}};
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3 || (argv[1] != std::string("plain") && argv[1] != std::string("built"))) {
    std::fprintf(stderr, "usage: lumo_absorption plain|built FOLDER\n");
    return 2;
  }
  Study study{argv[1], {}, argv[2], {}};
  std::filesystem::create_directories(study.folder);
  study.table.open(study.folder / (study.body + ".csv"));
  study.table << "body,silicone,absorbed_per_m,g,rest,J_obs,J_obs_err,on_led,between,peak_over_far,peak,cpu_s,"
                 "cpu_over_clear,part_1,part_2,part_3,part_4,part_5,part_6\n";
  std::vector<Scenario<Sphere>> contacts;
  for (const double y : places_m) contacts.push_back({Sphere{10.0_mm}, 0.0, y, {1.0, 2.0, 5.0, 10.0, 15.0}});
  for (const Silicone& card : {dragon_skin(), solaris()}) {
    Stages pipeline{{}, {NeoHookean{.mu = card.mu_Pa, .lambda = card.lambda_Pa}}, {}};
    pipeline.rays.rounds = 0;
    const auto body_of = [&](FingerOptions options, const Silicone& lit) {
      options.readout.bins = fine;
      return finger(built_baseline(), lit, options);
    };
    const auto films = films_of(study.body);
    const auto pressed = press(body_of(films.front().second, card), contacts, pipeline, Serial{});
    for (const auto& [film, options] : films) {
      double clear_s = 0.0;
      for (const Assumption& a : assumptions_of(card)) {
        const double start = cpu_s();
        const Observations seen = observe(body_of(options, a.card), pressed, pipeline, Serial{});
        const double seconds = cpu_s() - start;
        if (clear_s == 0.0) clear_s = seconds;
        study.row(film, a, seen, seconds, clear_s);
        for (const std::size_t place : {on_led, between}) study.curve(film, a, seen, place);
      }
    }
  }
  for (const auto& [name, chart] : study.pictures) std::ofstream(study.folder / (name + ".svg")) << draw(chart);
  return 0;
}
