#include "charts/sensing_overlay.hpp"
#include "commands/estimating.hpp"
#include "console/text.hpp"
#include "sensing/findings.hpp"

#include "lumo/sense/live/live.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace lumo::program {

using namespace sense;

namespace {

constexpr double default_from_N = 5.0;

struct Located;

struct Locate : EstimatingCommand {
  std::optional<double> from_N;  ///< true force from which a location counts

  void declare(CLI::App& app) {
    add_log(app);
    add_localizer(app);
    add_unloaded(app);
    add_value(app, "--from", "N", "Least true force of the frames that count [N], default 5",
        [this](const std::string& typed) {
          from_N = number_in(
              "--from", typed, {std::numeric_limits<double>::lowest(), std::numeric_limits<double>::max()}, "N");
        });
    declare_live(app,
        "Number of a live camera instead of a log's pictures; the first second must show the unloaded finger. LOG, if "
        "given, describes the finger",
        false);
  }
  void check() const {
    check_localizer();
    if (asks_pad_only()) return;
    check_camera();
    if (camera.number && unloaded)
      throw UsageError("--unloaded is of a log; a live camera's first second shows the unloaded finger");
    if (camera.number && from_N)
      throw UsageError("--from chooses frames by their true force, which a live camera does not measure");
    pictures();
  }
  /// Whether contacts on the pad can be located is said without a log.
  bool asks_pad_only() const { return pad && log.empty() && !camera.number; }
  Result on_log(Output& files, Progress& progress) const override;
  void live(LiveLines& lines, Progress& progress) const override;
  std::string shown(const SensedLog& s, const std::optional<KnownPad>& known, const Located& where,
      const LocationScore& score, const std::vector<std::string>& notes) const;
};

/// In how many frames the finger was touched, and where.
struct Located {
  std::size_t frames = 0, estimates = 0, touched = 0, two = 0, unknown = 0;
  std::vector<TouchSpell> spells = {};
};

Located located_in(const SensedLog& s, const std::vector<FrameEstimate>& estimates) {
  Located found{s.log.frames.size(), estimates.size()};
  std::vector<TouchedFrame> touched;
  for (const FrameEstimate& e : estimates) {
    found.unknown += e.location.unknown;
    if (e.location.contacts == 0) continue;
    found.two += e.location.contacts > 1;
    const auto y = e.contact();
    touched.push_back({e.stamp_ns, y ? std::optional(y->y_m) : std::nullopt});
  }
  found.touched = touched.size();
  found.spells = touch_spells(touched);
  return found;
}

Json located_json(const Located& l) {
  return {{"rows", l.frames}, {"estimated", l.estimates}, {"touched", l.touched}, {"two_contacts", l.two},
      {"unknown_response", l.unknown}, {"free", l.estimates - l.touched - l.unknown},
      {"without_estimate", l.frames - std::min(l.frames, l.estimates)}};
}

std::string located_text(const Located& l) {
  const std::size_t without = l.frames - std::min(l.frames, l.estimates);
  return lumo::message(l.frames, " frames: touched in ", l.touched,
             l.two > 0 ? lumo::message(" (", l.two, " of them at two places)") : std::string(), ", free in ",
             l.estimates - l.touched - l.unknown,
             l.unknown > 0 ? lumo::message(", of a response that is not this pad's in ", l.unknown) : std::string(),
             without > 0 ? lumo::message(", without an estimate ", without) : std::string(), "\n") +
         spells_text(l.spells, false);
}

Result Locate::on_log(Output& files, Progress& progress) const {
  const std::optional<KnownPad> known = known_pad(progress);
  if (asks_pad_only()) return json ? sensibility_json(*known).dump(2) + "\n" : sensibility_text(*known);
  progress.stage("reading the log");
  const SensedLog s = read_sensed_log(log, SensedLog{}.bins, progress, topics, unloaded);
  const FingerOptics optics = optics_of(s, log, progress);
  if (known) tell_other_pad(*known, s.log.session, log, progress);
  const auto estimates = with_maker(
      localizer, known, s.log.session, [&](auto make) { return lumo::sense::locate(s.profiles, optics, make); });
  const LogTruth truth = truth_of(s.log);
  const LocationScore score = location_score(estimates, truth, from_N.value_or(default_from_N));
  std::string table =
      "stamp_ns,contacts,y_mm,y_sigma_mm,probability,true_y_mm,true_force_N" + std::string(known ? ",unknown\n" : "\n");
  Timeline chart{"Location", "y [mm]"};
  const FrameEstimate* strongest = nullptr;
  int not_judged = 0;
  for (const FrameEstimate& e : estimates) {
    const auto t = truth.at(e.stamp_ns);
    const auto y = e.contact();
    const bool judged = e.force.state != EstimatorState::invalid;
    not_judged += !judged;
    table += std::to_string(e.stamp_ns) + ',' + std::to_string(e.location.contacts) +
             field(y ? std::optional(y->y_m) : std::nullopt, 1e3) +
             field(y ? std::optional(std::sqrt(y->variance_m2)) : std::nullopt, 1e3) +
             field(judged ? std::optional(e.location.probability) : std::nullopt) + field(t.y_m, 1e3) +
             field(t.force_N) + (known ? e.location.unknown ? ",1\n" : ",0\n" : "\n");
    const double seconds = seconds_between(estimates.front(), e);
    if (t.y_m && t.force_N.value_or(0.0) > 0.5) chart.truth.push_back({seconds, 1e3 * *t.y_m});
    if (y) chart.estimate.push_back({seconds, 1e3 * y->y_m});
    if (y && (!strongest || y->amplitude > strongest->contact()->amplitude)) strongest = &e;
  }
  if (not_judged > 0)
    progress.note(lumo::message(
        log, ": ", not_judged, " of ", estimates.size(), " pictures are black or dark about one LED, and not located"));
  files.add("locations.csv", table);
  if (!chart.estimate.empty()) files.add("locations.svg", draw(chart));
  if (files.wanted() && strongest) files.add("overlay.png", overlay_png(s, strongest->stamp_ns, *strongest->contact()));
  tell_findings(s.log, s.pictures, progress);
  return shown(s, known, located_in(s, estimates), score, progress.notes());
}

std::string Locate::shown(const SensedLog& s, const std::optional<KnownPad>& pad_known, const Located& where,
    const LocationScore& score, const std::vector<std::string>& notes) const {
  const bool known = score.samples > 0, found = score.located > 0;
  if (json) {
    Json j = {{"samples", score.samples}, {"mae_mm", found ? number(1e3 * score.mae_m) : Json(nullptr)},
        {"coverage_90", found ? number(score.coverage_90) : Json(nullptr)}, {"located", score.located},
        {"frames", located_json(where)}, {"contacts", spells_json(where.spells, false)},
        {"log", findings_json(s.log, s.pictures, notes)}};
    if (pad_known) j["pad"] = sensibility_json(*pad_known);
    return text_of(j, 2) + "\n";
  }
  const std::string from = short_number(from_N.value_or(default_from_N));
  const std::string text = (pad_known ? sensibility_text(*pad_known) : std::string()) + located_text(where) +
                           findings_text(s.log, s.pictures);
  if (!known)
    return text + "no errors: the log has no truth.csv, and no holds at known places at which wrench.csv reads " +
           from + " N and more\n";
  return text + lumo::message(score.samples, " frames at ", from, " N and more, ", score.located,
                    " located\nmean error   ", cell(found ? 1e3 * score.mae_m : undefined, 2), " mm of the ",
                    score.located, " located\n90 % interval holds the truth in ",
                    cell(found ? 100.0 * score.coverage_90 : undefined, 1), " % of them\n");
}

void Locate::live(LiveLines& lines, Progress& progress) const {
  Session session;
  if (!log.empty()) session = open_log(log, progress, topics).session;
  const std::optional<KnownPad> known = known_pad(progress);
  const auto source = pictures().live(settings_of(camera));
  progress.tell("leave the finger alone for a second");
  const auto line = [&](std::int64_t stamp_ns, const std::optional<LocationEstimate>& e, Faults faults) {
    const double seconds = lines.seconds(stamp_ns);
    const auto y = e && e->contacts == 1 ? std::optional(1e3 * e->contact[0].y_m) : std::nullopt,
               sigma = y ? std::optional(1e3 * std::sqrt(e->contact[0].variance_m2)) : std::nullopt;
    if (json)
      return lines(stamp_ns, e.has_value(),
          Json{{"stamp_ns", stamp_ns}, {"contacts", e ? Json(e->contacts) : Json(nullptr)}, {"y_mm", maybe(y)},
              {"y_sigma_mm", maybe(sigma)}, {"probability", e ? number(e->probability) : Json(nullptr)},
              {"unknown_response", e && e->unknown}, {"faults", to_string(faults)}}
              .dump());
    return lines(stamp_ns, e.has_value(),
        cell(seconds, 3) + " s  " +
            (!e                    ? "picture not used: " + to_string(faults)
                : y                ? "y " + cell(*y, 1) + " ± " + cell(*sigma, 1) + " mm"
                : e->unknown       ? "a response that is not this pad's"
                : e->contacts == 0 ? "no contact"
                                   : "two contacts"));
  };
  with_maker(localizer, known, session,
      [&](auto make) { locate_live(*source, finger_model(session), make, line, {.name = camera.device()}); });
}

}  // namespace

void add_locate(CommandLine& line) { line.add<Locate>("locate", "Where the finger was touched, frame by frame"); }

}  // namespace lumo::program
