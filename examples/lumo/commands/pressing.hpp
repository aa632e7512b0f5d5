#pragma once

#include "commands/commands.hpp"
#include "console/text.hpp"
#include "report/report.hpp"

#include <string>
#include <string_view>
#include <vector>

namespace lumo::program {

inline std::string_view meaning(Status status) {
  switch (status) {
    case Status::not_positive_definite: return "the pad gives way, or buckles";
    case Status::inverted: return "an element is crushed";
    case Status::max_iterations: return "the residual stays too large";
    case Status::time_limit: return "out of time";
    default: return "the solver found no way on";
  }
}

/// What a press that found no equilibrium says; empty for one that did.
inline std::string failure_of(const std::vector<ScenarioRecord>& scenarios) {
  for (const ScenarioRecord& s : scenarios) {
    if (is_scored(s.status, true)) continue;  // who asked for a solver that holds gets what it holds
    const double load_N = s.states.empty() ? 0.0 : s.states.back().load_N;
    return lumo::message("no equilibrium at ", load_N, " N (", to_string(s.status), ": ", meaning(s.status),
        "), sphere of ", mm(s.diameter_m), " mm at ", degrees(s.angle_rad), " deg, y = ", mm(s.y_m), " mm");
  }
  return "";
}

/// A command that presses one sphere on one pad.
struct PressCommand : DesignCommand {
  PressRequest request;

  void declare(CLI::App& app) {
    declare_common(app, request);
    add_touch(app, request);
    app.footer(
        "press.pvd in DIR lists the states of the last run. A press_N.vtu of an earlier run with more loads stays "
        "where it is: nothing "
        "is removed.");
    add_mechanics(app, request.mechanics);
  }
  void check() const { check_design(request); }
};

}  // namespace lumo::program
