#include "charts/chart.hpp"
#include "commands/logs.hpp"
#include "console/text.hpp"
#include "sensing/checks.hpp"
#include "sensing/findings.hpp"

#include "lumo/sense/decode/constraint_gain.hpp"
#include "lumo/sense/decode/cycle_metrics.hpp"
#include "lumo/sense/decode/segment_responses.hpp"
#include "lumo/sense/recording/log_truth.hpp"

#include <algorithm>
#include <vector>

namespace lumo::program {

using namespace sense;

namespace {

/// How far the marker goes from the first touch to 15 N, in the log's first contact that gets there.
std::optional<double> displacement(const Recording& log) {
  std::vector<double> force, marker;
  const TimeSeries series = normal_force(log.wrenches);
  for (const MarkerSample& m : log.markers)
    if (const auto f = series.at(m.stamp_ns, 0.1)) force.push_back((*f)[0]), marker.push_back(m.displacement_m);
  if (int(force.size()) <= OnsetDetector{}.baseline) return std::nullopt;
  return displacement_from_onset(force, marker, 14.9);
}

/// A table and a chart of the slopes of all places.
void add_slopes(const LongitudinalBins& bins, const std::vector<Eigen::MatrixXd>& slopes, Output& files) {
  LineChart chart{"Intensity–force slopes", "median over re-contacts at each place", "y [mm]", "slope [DN/N]", {}};
  std::string table = "place,repetition,y_mm,slope_DN_per_N\n";
  const Eigen::VectorXd at = bins.centres_m();
  for (std::size_t i = 0; i < slopes.size(); ++i) {
    const Eigen::VectorXd middle = pointwise_median(slopes[i]);
    Curve curve{"place " + std::to_string(i + 1), palette[i % palette.size()], {}, 1.8, false};
    for (Eigen::Index b = 0; b < at.size(); ++b) {
      curve.points.push_back({1e3 * at[b], middle[b]});
      for (Eigen::Index r = 0; r < slopes[i].cols(); ++r)
        table += lumo::message(i, ',', r, ',', csv_number(1e3 * at[b]), ',', csv_number(slopes[i](b, r)), '\n');
    }
    chart.curves.push_back(std::move(curve));
  }
  files.add("slopes.csv", table);
  files.add("slopes.svg", draw(chart));
}

struct Measured {
  std::optional<RecontactQuality> quality;
  std::optional<CycleVariation> cycles;
  int cycles_lost = 0;  ///< runs left out because the contact was lost in them
  std::optional<double> gain;

  template <class Get> std::optional<double> of(Get get) const {
    return quality ? std::optional<double>(get(*quality)) : std::nullopt;
  }
};

std::string shown(const Measured& m, const SensedLog& log, const std::vector<std::string>& notes, bool as_json) {
  const auto D = m.of([](const auto&q) { return q.metrics.D_neighbor; }),
             W = m.of([](const auto&q) { return q.metrics.W_recontact; }),
             Q = m.of([](const auto&q) { return *q.metrics.Q; });
  const auto low = m.of([](const auto&q) { return q.Q_low; }), high = m.of([](const auto&q) { return q.Q_high; });
  const auto from = m.of([](const auto&q) { return q.bootstrap_low; }),
             to = m.of([](const auto&q) { return q.bootstrap_high; });
  const auto& cycles = m.cycles;
  const auto W_cycle = cycles ? std::optional(cycles->W_cycle_DN) : std::nullopt;
  if (as_json) {
    const Json compared = {{"runs", cycles ? cycles->runs : 0}, {"runs_lost", m.cycles_lost},
        {"from_N", cycles ? Json(cycles->from_N) : Json(nullptr)},
        {"to_N", cycles ? Json(cycles->to_N) : Json(nullptr)}};
    return text_of(Json{{"D_neighbor", maybe(D)}, {"W_recontact", maybe(W)}, {"Q", maybe(Q)}, {"Q_low", maybe(low)},
                       {"Q_high", maybe(high)}, {"Q_bootstrap_low", maybe(from)}, {"Q_bootstrap_high", maybe(to)},
                       {"W_cycle_DN", maybe(W_cycle)}, {"cycles", compared}, {"gain_percent", maybe(m.gain)},
                       {"log", findings_json(log.log, log.pictures, notes)}},
               2) +
           "\n";
  }
  const auto show = [](const std::optional<double>& v, int digits) { return cell(v.value_or(undefined), digits); };
  return "D_neighbor   " + show(D, 4) + " DN/N\nW_recontact  " + show(W, 4) + " DN/N\n" + "Q            " + show(Q, 2) +
         " (" + show(low, 2) + " to " + show(high, 2) + " with one re-contact left out; 95 % bootstrap interval " +
         show(from, 2) + " to " + show(to, 2) + ")\nW_cycle      " + show(W_cycle, 4) + " DN" +
         (cycles ? " (" + std::to_string(cycles->runs) + " runs, " + cell(cycles->from_N, 1) + " to " +
                       cell(cycles->to_N, 1) + " N)"
                 : std::string()) +
         (m.cycles_lost > 0 ? ", contact lost in " + std::to_string(m.cycles_lost) + " more" : std::string()) +
         "\ngain         " + show(m.gain, 1) + " %\n" + findings_text(log.log, log.pictures);
}

struct Metrics : PlannedCommand {
  std::string baseline;  ///< log to compare with

  void declare(CLI::App& app) {
    add_log(app);
    add_text(app, "--baseline", baseline, "LOG", "Log of the pad to compare with, for the gain");
    declare_planned(app);
  }
  Result run(Output& files, Progress& progress) const {
    const std::string path = recorded(progress);
    progress.stage("reading the log");
    const SensedLog s = read_sensed_log(path, SensedLog{}.bins, progress, topics);
    Measured m;
    const auto holds = measured_holds(s, progress);
    const auto slopes = about(path, [&] { return slope_profiles(holds); });
    const auto repeated = [&](const auto& place) { return place.cols() >= 3 && place.cols() == slopes.front().cols(); };
    if (slopes.size() >= 2 && std::all_of(slopes.begin(), slopes.end(), repeated))
      m.quality = about(path, [&] { return recontact_quality(slopes); });
    const LoggedCycles cycles = about(path, [&] { return cycle_runs(s.profiles, s.log.session, s.log.wrenches); });
    m.cycles_lost = cycles.lost;
    if (!cycles.runs.empty()) m.cycles = about(path, [&] { return cycle_variation(cycles.runs); });
    if (!baseline.empty()) {
      const auto here = displacement(s.log), base = displacement(open_log(baseline, progress));
      if (here && base) m.gain = progressive_constraint_gain_percent(*here, *base);
    }
    if (!slopes.empty()) add_slopes(s.bins, slopes, files);
    tell_findings(s.log, s.pictures, progress);
    return shown(m, s, progress.notes(), json);
  }
};

}  // namespace

void add_metrics(CommandLine& line) {
  line.add<Metrics>("metrics", "How far apart places are, and how well contacts repeat");
}

}  // namespace lumo::program
