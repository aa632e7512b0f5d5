#pragma once

#include "charts/chart.hpp"
#include "commands/logs.hpp"
#include "sensing/live.hpp"
#include "sensing/log.hpp"

#include "lumo/sense/estimate.hpp"

#include <optional>
#include <string>
#include <vector>

namespace lumo::program {

using namespace sense;

/// A command that estimates something at each picture, of a log or of a live camera.
struct EstimatingCommand : CameraCommand {
  std::string localizer = "bayes";
  UnloadedSeconds unloaded;  ///< empty: as the log says

  virtual ~EstimatingCommand() = default;
  void add_localizer(CLI::App& app);
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

/// Calls `use` with the maker of the localiser of that name, "peak" or "bayes".
template <class Use> auto with_maker(const std::string& name, Use use) {
  return name == "peak" ? use(peak_localizer) : use(bayes_localizer);
}

/// A further column of a table, empty for what is not known.
std::string field(const std::optional<double>& v, double scale = 1.0);
double seconds_between(const FrameEstimate& first, const FrameEstimate& e);

/// Estimates at each frame against the truth. What is not known for some frames interrupts a line.
struct Timeline {
  std::string title, quantity;
  std::vector<Point> truth = {}, estimate = {};
};
std::string draw(const Timeline& t);

}  // namespace lumo::program
