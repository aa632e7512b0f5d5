#pragma once

#include "charts/chart.hpp"
#include "commands/logs.hpp"

#include "lumo/sense/estimate.hpp"

#include <optional>
#include <string>
#include <vector>

namespace lumo::program {

using namespace sense;

/// A command that estimates something at each picture.
struct EstimatingCommand : CameraCommand {
  std::string localizer = "bayes";

  void add_localizer(CLI::App& app) {
    add_word(app, "--localizer", localizer, {"bayes", "peak"}, "bayes (default) or peak (the paper's)");
  }
};

inline constexpr const char* seconds_help = "How long to look through the camera [s], default: until interrupted";

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
