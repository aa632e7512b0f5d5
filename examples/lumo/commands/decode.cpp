#include "charts/sensing_overlay.hpp"
#include "commands/logs.hpp"
#include "console/text.hpp"
#include "sensing/findings.hpp"

#include "lumo/sense/decode/bayes_decoder.hpp"
#include "lumo/sense/decode/decoder.hpp"
#include "lumo/sense/decode/gaussian_process_decoder.hpp"
#include "lumo/sense/decode/linear_decoder.hpp"
#include "lumo/sense/decode/nearest_template.hpp"
#include "lumo/sense/decode/segment_responses.hpp"

#include <utility>
#include <vector>

namespace lumo::program {

using namespace sense;

namespace {

struct Decode : PlannedCommand {
  std::string decoder = "nearest";

  void declare(CLI::App& app) {
    add_log(app);
    add_word(app, "--decoder", decoder, {"nearest", "linear", "gp", "bayes"},
        "nearest (template, default), linear, gp (Gaussian process) or bayes (a filter over all loads from 2 N)");
    declare_planned(app);
  }
  std::pair<DecodingTask, DecodingReport> decoded(const SensedLog& s) const;
  Result run(Output& files, Progress& progress) const;
};

std::pair<DecodingTask, DecodingReport> Decode::decoded(const SensedLog& s) const {
  const auto holds = hold_responses(s.profiles, s.log.session.segments);
  const std::vector<double> loads = decoder == "bayes"
                                        ? common_loads(holds, 2.0)
                                        : std::vector{2.0, 5.0};  // the filter goes through the whole loading
  DecodingTask t = decoding_task(holds, loads);
  const auto validated = [&](const auto& with) { return cross_validate(with, t.data, t.fold); };
  DecodingReport r = decoder == "bayes"    ? validated(BayesDecoder{int(loads.size()) - 1})
                     : decoder == "linear" ? validated(LinearDecoder{})
                     : decoder == "gp"     ? validated(GaussianProcessDecoder{})
                                           : validated(NearestTemplate{});
  return {std::move(t), std::move(r)};
}

Result Decode::run(Output& files, Progress& progress) const {
  const std::string path = recorded(progress);
  progress.stage("reading the log");
  const SensedLog s = read_sensed_log(path, LongitudinalBins::parts(), progress, topics);
  const auto [task, report] = about(path, [&] { return decoded(s); });
  Json confusion = Json::array(), predictions = Json::array();
  std::string table = "repetition,y_mm,decoded_y_mm,probability\n";
  for (Eigen::Index i = 0; i < report.confusion.rows(); ++i) {
    Json row = Json::array();
    for (Eigen::Index j = 0; j < report.confusion.cols(); ++j) row.push_back(report.confusion(i, j));
    confusion.push_back(row);
  }
  for (const auto& p : report.predictions) {
    const double y = 1e3 * task.data.place_m[p.place], decoded = 1e3 * task.data.place_m[p.decoded];
    predictions.push_back(
        {{"repetition", p.fold}, {"y_mm", y}, {"decoded_y_mm", decoded}, {"probability", number(p.probability)}});
    table += std::to_string(p.fold) + ',' + csv_number(y) + ',' + csv_number(decoded) + ',' +
             csv_number(p.probability) + '\n';
  }
  files.add("predictions.csv", table);
  files.add("confusion.svg", draw_confusion(report.confusion, task.data.place_m));
  tell_findings(s.log, s.pictures, progress);
  if (json)
    return text_of(Json{{"accuracy", number(report.accuracy.value)}, {"confusion", confusion},
                       {"predictions", predictions}, {"log", findings_json(s.log, s.pictures, progress.notes())}},
               2) +
           "\n";
  std::string text = lumo::message("accuracy ", short_number(report.accuracy.value, 3), " of ",
      report.predictions.size(), " (95 % from ", short_number(report.accuracy.low, 3), " to ",
      short_number(report.accuracy.high, 3), "), decoder: ", decoder, "\ntrue \\ decoded [mm]");
  for (const double y : task.data.place_m) text += cell(1e3 * y, 1, 7);
  for (Eigen::Index i = 0; i < report.confusion.rows(); ++i) {
    text += "\n" + cell(1e3 * task.data.place_m[i], 1, 19);
    for (Eigen::Index j = 0; j < report.confusion.cols(); ++j) text += pad(std::to_string(report.confusion(i, j)), 7);
  }
  return text + "\n" + findings_text(s.log, s.pictures);
}

}  // namespace

void add_decode(CommandLine& line) {
  line.add<Decode>("decode", "Place from the response of six parts, one repetition left out");
}

}  // namespace lumo::program
