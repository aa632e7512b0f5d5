#pragma once

#include "charts/chart.hpp"
#include "commands/logs.hpp"
#include "report/json.hpp"
#include "sensing/known_pad.hpp"
#include "sensing/live.hpp"
#include "sensing/log.hpp"

#include "lumo/sense/estimate.hpp"

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace lumo::program {

using namespace sense;

/// A command that estimates something at each picture, of a log or of a live camera.
struct EstimatingCommand : CameraCommand {
  std::string localizer = "bayes";
  std::optional<std::string> pad, calibration;  ///< where the pad's responses are known from
  UnloadedSeconds unloaded;                     ///< empty: as the log says

  virtual ~EstimatingCommand() = default;
  void add_localizer(CLI::App& app);
  /// Throws UsageError.
  void check_localizer() const;
  /// What --pad or --calibration give; none without. Throws InputError.
  std::optional<KnownPad> known_pad(Progress& progress) const;
  void add_unloaded(CLI::App& app);
  /// Options of the live camera, and those that all commands have.
  void declare_live(CLI::App& app, const std::string& camera_help, bool motors);
  /// Torques need a log, and motors beside a live camera. Throws UsageError; `command` is named in it.
  void check_torques(const char* command) const;
  Result run(Output& files, Progress& progress) const;

 private:
  virtual Result on_log(Output& files, Progress& progress) const = 0;
  virtual void live(LiveLines& lines, Progress& progress) const = 0;
};

/// Calls `use` with the maker of the localiser that knows its pad, if it is known, or else of that name, "peak" or
/// "bayes". Pad and session live at least as long as the localiser.
template <class Use>
auto with_maker(const std::string& name, const std::optional<KnownPad>& pad, const Session& session, Use use) {
  if (pad) return use([&](const FingerOptics& finger) { return pad->localizer(finger, session); });
  return name == "peak" ? use(peak_localizer) : use(bayes_localizer);
}

/// A further column of a table, empty for what is not known.
std::string field(const std::optional<double>& v, double scale = 1.0);
double seconds_between(const FrameEstimate& first, const FrameEstimate& e);

/// A frame in which the finger is touched, and what is known of it.
struct TouchedFrame {
  std::int64_t stamp_ns = 0;
  std::optional<double> y_m = {}, force_N = {};
};

/// Frames that follow one another and show the finger touched at about one place.
struct TouchSpell {
  static constexpr double gap_s = 0.3, apart_m = 8e-3;  ///< what ends it: time without a touch, a leap of the place
  static constexpr std::size_t least_frames = 3;        ///< that it is listed

  std::int64_t from_ns = 0, to_ns = 0;
  std::size_t frames = 0;
  std::optional<double> y_m, force_N;  ///< medians
  std::optional<double> most_N;
};

std::vector<TouchSpell> touch_spells(const std::vector<TouchedFrame>& touched);
/// A line for each spell; those of fewer frames are counted.
std::string spells_text(const std::vector<TouchSpell>& spells, bool forces);
Json spells_json(const std::vector<TouchSpell>& spells, bool forces);

/// "vision_only 4, invalid 2".
std::string counts_text(const std::map<std::string, int>& counts);

/// Estimates at each frame against the truth. What is not known for some frames interrupts a line.
struct Timeline {
  std::string title, quantity;
  std::vector<Point> truth = {}, estimate = {};
};
std::string draw(const Timeline& t);

}  // namespace lumo::program
