#include "commands/logs.hpp"
#include "console/text.hpp"
#include "report/json.hpp"
#include "sensing/log.hpp"
#include "sensing/responses.hpp"

#include "lumo/lab/pad_responses.hpp"
#include "lumo/morphology/silicone.hpp"
#include "lumo/sense/force/calibration.hpp"
#include "lumo/sense/recording/log_truth.hpp"

#include <algorithm>
#include <optional>
#include <vector>

namespace lumo::program {

using namespace sense;

namespace {

/// Means over the segments of one kind.
MeanImage mean_picture(const OpenLog& log, SegmentKind kind, PhotonTransfer* transfer = nullptr) {
  MeanImage mean;
  LogCamera camera(log);
  const Segment* used = nullptr;
  for (const Segment& s : log.session.segments)
    if (s.kind == kind && !used) used = &s;
  for (auto f = camera.next(); f && used; f = camera.next())
    if (f->stamp_ns >= used->from_ns && f->stamp_ns <= used->to_ns && !f->image.empty()) {
      mean.add(f->image);
      if (transfer) transfer->add(f->image);
    }
  if (mean.count() == 0)
    throw InputError(log.path + ": has no pictures in a segment of kind \"" + std::string(to_string(kind)) + "\"");
  return mean;
}

/// Depths and forces of the holds of the first contact, and what it was: place and number of holds.
struct PressCurve {
  std::vector<double> depth_m, force_N;
  double y_m = 0.0;
  int holds = 0;
};

PressCurve press_curve(const Recording& log) {
  PressCurve curve;
  require_readable(log, LogStream::wrenches);
  require_readable(log, LogStream::markers);
  const auto& all = log.session.segments;
  const auto first = std::find_if(
      all.begin(), all.end(), [](const Segment& s) { return s.kind == SegmentKind::hold && s.place >= 0; });
  if (first == all.end() || log.wrenches.empty() || log.markers.empty())
    throw InputError(log.path + ": has no press: holds, forces (wrench.csv) and displacements (marker.csv) are needed");
  curve.y_m = 1e-3 * first->y_mm;
  const TimeSeries series = normal_force(log.wrenches, log.session.wrench_clock);
  for (auto s = first;
       s != all.end() && s->kind == SegmentKind::hold && s->place == first->place && s->repetition == first->repetition;
       ++s, ++curve.holds)
    for (const MarkerSample& m : log.markers)
      if (const std::int64_t t = log.session.wrench_clock(m.stamp_ns); 2 * t >= s->from_ns + s->to_ns && t <= s->to_ns)
        if (const auto f = series.at(t, 0.1))
          curve.depth_m.push_back(m.displacement_m), curve.force_N.push_back((*f)[0]);
  return curve;
}

Json interval(const Interval& i) {
  return {{"value", number(i.value)}, {"low", number(i.low)}, {"high", number(i.high)}};
}

/// One specimen against its nominal pad.
struct Specimen {
  double mu_Pa;  ///< nominal
  Interval found_Pa;
  StiffnessFit stiffness;
  Interval gain_DN_per_electron;
  LampLevel lamps;
};

std::string shown(const Specimen& s, bool as_json) {
  const Interval& gain = s.gain_DN_per_electron;
  if (as_json)
    return Json{{"mu_Pa", interval(s.found_Pa)}, {"onset_mm", number(1e3 * s.stiffness.onset_m)},
               {"residual_N", number(s.stiffness.residual_N)}, {"gain_DN_per_electron", interval(gain)},
               {"lamps_DN", number(s.lamps.level_DN)}, {"lamps_electrons", interval(s.lamps.electrons)}}
               .dump(2) +
           "\n";
  const auto range = [](const Interval& i, double scale, int digits) {
    return cell(scale * i.value, digits) + " (95 % from " + cell(scale * i.low, digits) + " to " +
           cell(scale * i.high, digits) + ")";
  };
  return "shear modulus  " + range(s.found_Pa, 1e-3, 1) + " kPa, nominal " + cell(1e-3 * s.mu_Pa, 1) +
         "\ncamera gain    " + range(gain, 1e3, 2) + " mDN per electron\nlamps          " + cell(s.lamps.level_DN, 1) +
         " DN, " + range(s.lamps.electrons, 1.0, 0) + " electrons a pixel\n";
}

/// From a log with a press (wrench.csv, marker.csv, holds), an unloaded and a dark stretch. Throws InputError for a log
/// that lacks one of them.
struct Calibrate : LogCommand {
  ResponsesRequest nominal;
  std::string finger;  ///< of the nominal pad; empty: as the session says

  Calibrate() { nominal.threads = all_threads(); }

  void declare(CLI::App& app) {
    add_log(app);
    add_value(app, "--finger", "NAME", "Nominal finger, built or plain; default: as the session says",
        [this](const std::string& typed) {
          finger = one_of("--finger", typed, {"built", "plain"});
        });
    add_text(app, "--cache", nominal.cache, "DIR", "Folder that keeps computed responses, default: beside LOG");
    add_flag(app, "--coarse", nominal.coarse, "Nominal pad on a coarse mesh");
    add_threads(app, nominal.threads);
    add_common(app, *this);
  }
  void check() const {
    require_log();
    pictures();
  }
  Result run(Output&, Progress& progress) {
    const OpenLog opened = open_log(log, progress, topics);
    const Session& session = opened.session;
    const std::optional<Silicone> card = find_silicone(session.material);
    if (session.theta_mm.size() != 5 || !card)
      throw InputError(opened.session_place() + ": theta_mm and material (DS or Sol) must describe the nominal pad");
    std::copy(session.theta_mm.begin(), session.theta_mm.end(), nominal.pad.theta_mm.begin());
    nominal.pad.silicone = *card;
    nominal.pad.finger = nominal_finger(opened);
    try {
      require_feasible(nominal.pad.design(), nominal.pad.finger.pad);
      const Specimen specimen = measured(opened, progress);
      progress.finish();
      return shown(specimen, json);
    } catch (const InvalidArgument& e) {
      throw InputError(log + ": " + e.what());
    } catch (const InfeasibleDesign& e) {
      throw InputError(opened.session_place() + ": " + e.what());
    }
  }
  FingerOptions nominal_finger(const OpenLog& opened) const {
    const std::string& stated = finger.empty() ? opened.session.finger : finger;
    if (stated == "built") return built_finger();
    if (stated == "plain") return plain_finger();
    throw InputError(opened.session_place() + ": finger is " + in_quotes(stated) +
                     ", must be built or plain to tell the nominal pad; --finger says it, too");
  }
  Specimen measured(const OpenLog& opened, Progress& progress) const {
    PhotonTransfer transfer;
    const Image lit = mean_picture(opened, SegmentKind::unloaded, &transfer).image(),
                dark = mean_picture(opened, SegmentKind::dark).image();
    const PressCurve press = press_curve(opened);
    const PadLight light(responses(nominal, log, progress));
    Specimen s;
    s.stiffness = fit_stiffness(
        press.depth_m, press.force_N, [&](double d) { return light.load_N(press.y_m, d); }, press.holds);
    s.gain_DN_per_electron = transfer.result().gain_DN_per_electron;
    s.lamps = lamp_level(lit.view(), dark.view(), s.gain_DN_per_electron);
    s.mu_Pa = nominal.pad.silicone.mu_Pa;
    const Interval& factor = s.stiffness.factor;
    s.found_Pa = {s.mu_Pa * factor.value, s.mu_Pa * factor.low, s.mu_Pa * factor.high};
    return s;
  }
};

}  // namespace

void add_calibrate(CommandLine& line) {
  line.add<Calibrate>("calibrate", "One specimen's stiffness, lamps and camera gain from one press and a dark view");
}

}  // namespace lumo::program
