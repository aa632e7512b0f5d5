#include "commands/estimating.hpp"

#include "console/text.hpp"

#include "lumo/core/statistics.hpp"
#include "lumo/sense/recording/csv.hpp"
#include "lumo/sense/recording/streams.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace lumo::program {

using namespace sense;

void EstimatingCommand::add_localizer(CLI::App& app) {
  add_word(app, "--localizer", localizer, {"bayes", "peak"}, "bayes (default) or peak (the paper's)");
  add_text(app, "--pad", pad, "FILE",
      "Computed responses of this pad, which lumo lab … --cache DIR keeps in DIR, for the localiser that knows its "
      "pad");
  add_text(app, "--calibration", calibration, "LOG",
      "Recorded log of this pad with holds at known places, for the localiser that knows its pad");
}

void EstimatingCommand::check_localizer() const {
  if (pad && calibration) throw UsageError("--pad and --calibration both say how the pad responds; give one of them");
  if ((pad || calibration) && localizer != "bayes")
    throw UsageError(std::string(pad ? "--pad" : "--calibration") +
                     " is for the localiser that knows its pad, not for " + "--localizer " + localizer);
}

std::optional<KnownPad> EstimatingCommand::known_pad(Progress& progress) const {
  if (pad) return computed_pad(*pad);
  if (calibration) return recorded_pad(*calibration, progress, topics);
  return std::nullopt;
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

std::vector<TouchSpell> touch_spells(const std::vector<TouchedFrame>& touched) {
  std::vector<TouchSpell> spells;
  std::vector<double> y_m, force_N;
  const auto close = [&] {
    if (!spells.empty() && !y_m.empty()) spells.back().y_m = median(y_m);
    if (!spells.empty() && !force_N.empty()) {
      spells.back().force_N = median(force_N);
      spells.back().most_N = *std::max_element(force_N.begin(), force_N.end());
    }
    y_m.clear();
    force_N.clear();
  };
  for (const TouchedFrame& f : touched) {
    const bool later = spells.empty() || 1e-9 * double(f.stamp_ns - spells.back().to_ns) > TouchSpell::gap_s;
    const bool elsewhere = f.y_m && !y_m.empty() && std::abs(*f.y_m - y_m.back()) > TouchSpell::apart_m;
    if (later || elsewhere) {
      close();
      spells.push_back({f.stamp_ns, f.stamp_ns, 0, {}, {}, {}});
    }
    spells.back().to_ns = f.stamp_ns;
    ++spells.back().frames;
    if (f.y_m) y_m.push_back(*f.y_m);
    if (f.force_N) force_N.push_back(*f.force_N);
  }
  close();
  return spells;
}

std::string spells_text(const std::vector<TouchSpell>& spells, bool forces) {
  constexpr std::size_t most = 40;
  std::string text;
  std::size_t shown = 0, short_ones = 0;
  for (const TouchSpell& s : spells) {
    if (s.frames < TouchSpell::least_frames) {
      ++short_ones;
      continue;
    }
    if (++shown > most) continue;
    const double y_mm = s.y_m ? 1e3 * *s.y_m : undefined;
    text += "  " + to_string(Stretch{s.from_ns, s.to_ns}) + lumo::message(", ", s.frames, " frames: y ") +
            cell(y_mm, 1) + " mm";
    if (forces)
      text += ", " + cell(s.force_N.value_or(undefined), 2) + " N (median), at most " +
              cell(s.most_N.value_or(undefined), 2) + " N";
    text += "\n";
  }
  if (shown > most) text += lumo::message("  and ", shown - most, " more contacts\n");
  if (short_ones > 0)
    text += lumo::message("  and ", short_ones, " touches of fewer than ", TouchSpell::least_frames, " frames\n");
  return text;
}

Json spells_json(const std::vector<TouchSpell>& spells, bool forces) {
  Json list = Json::array();
  for (const TouchSpell& s : spells) {
    Json j = {{"from_ns", s.from_ns}, {"to_ns", s.to_ns}, {"frames", s.frames},
        {"y_mm", s.y_m ? number(1e3 * *s.y_m) : Json(nullptr)}};
    if (forces) {
      j["force_N"] = maybe(s.force_N);
      j["most_N"] = maybe(s.most_N);
    }
    list.push_back(std::move(j));
  }
  return list;
}

std::string counts_text(const std::map<std::string, int>& counts) {
  return listing(counts, [](const auto& count) { return lumo::message(count.first, ' ', count.second); });
}

std::string draw(const Timeline& t) {
  LineChart chart = {t.title, "estimate at each frame against the truth", "time [s]", t.quantity, {}};
  add_curve(chart, "truth", palette[6], 2.4, t.truth);
  add_curve(chart, "estimate", palette[1], 1.4, t.estimate);
  return draw(chart);
}

}  // namespace lumo::program
