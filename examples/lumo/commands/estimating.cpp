#include "commands/estimating.hpp"

#include "report/json.hpp"

#include "lumo/sense/recording/csv.hpp"

#include <utility>

namespace lumo::program {

using namespace sense;

void EstimatingCommand::add_localizer(CLI::App& app) {
  add_word(app, "--localizer", localizer, {"bayes", "peak"}, "bayes (default) or peak (the paper's)");
}

void EstimatingCommand::add_unloaded(CLI::App& app) {
  add_value(app, "--unloaded", "FROM,TO",
      "When nothing touched the finger [s after the log's first picture]; default: the log's first segment of kind "
      "unloaded, or else its first half second",
      [this](const std::string& typed) {
        const auto fields = split(typed);
        const Limits limits{0.0, 1e6};
        if (fields.size() != 2)
          throw UsageError("--unloaded is " + in_quotes(typed) + ", must be two times in s such as 3.5,4.5");
        unloaded = {number_in("--unloaded", fields[0], limits, "s"), number_in("--unloaded", fields[1], limits, "s")};
        if (!((*unloaded)[0] < (*unloaded)[1]))
          throw UsageError("--unloaded is " + in_quotes(typed) + ", must end after it begins");
      });
}

void EstimatingCommand::declare_live(CLI::App& app, const std::string& camera_help, bool motors) {
  add_camera(app, camera, camera_help);
  add_seconds(app, camera, "How long to look through the camera [s], default: until interrupted");
  add_picture_options(app, camera);
  if (motors) add_motor_options(app, camera);
  add_out(app, *this);
  add_common(app, *this);
}

void EstimatingCommand::check_torques(const char* command) const {
  check_camera();
  if (camera.number && camera.can.empty())
    throw UsageError(std::string("--can is missing: lumo ") + command +
                     " needs the motors' samples beside a live camera's pictures");
  require_log();
  pictures();
}

Result EstimatingCommand::run(Output& files, Progress& progress) const {
  if (!camera.number) return on_log(files, progress);
  return before_camera(camera, progress, [&](LiveLines& lines) { live(lines, progress); });
}

std::string field(const std::optional<double>& v, double scale) {
  return ',' + (v ? csv_number(scale * *v) : std::string());
}

double seconds_between(const FrameEstimate& first, const FrameEstimate& e) {
  return 1e-9 * double(e.stamp_ns - first.stamp_ns);
}

namespace {

void add_curve(
    LineChart& chart, std::string label, std::string_view colour, double width, const std::vector<Point>& points) {
  constexpr double gap_s = 0.15;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (i == 0 || points[i][0] - points[i - 1][0] > gap_s)
      chart.curves.push_back({std::exchange(label, ""), std::string(colour), {}, width, true});
    chart.curves.back().points.push_back(points[i]);
    chart.curves.back().markers = chart.curves.back().points.size() == 1;  // which no line shows
  }
}

}  // namespace

std::string draw(const Timeline& t) {
  LineChart chart = {t.title, "estimate at each frame against the truth", "time [s]", t.quantity, {}};
  add_curve(chart, "truth", palette[6], 2.4, t.truth);
  add_curve(chart, "estimate", palette[1], 1.4, t.estimate);
  return draw(chart);
}

}  // namespace lumo::program
