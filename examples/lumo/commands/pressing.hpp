#pragma once

#include "commands/commands.hpp"
#include "report/report.hpp"

#include <string>
#include <vector>

namespace lumo::program {

/// What a press that found no equilibrium says; empty for one that did.
std::string failure_of(const Configuration& asked, const std::vector<ScenarioRecord>& scenarios);
/// The same, or what an evaluation says that has no score because its mesh does not resolve a contact.
std::string unscored(const Configuration& asked, const std::vector<ScenarioRecord>& scenarios);

/// A command that presses one sphere on one pad.
struct PressCommand : DesignCommand {
  void declare(CLI::App& app) {
    declare_common(app);
    add_touch(app, effective);
    app.footer(
        "traction.csv in DIR has what the sphere does to the deformed surface, point by point: area times "
        "traction sums to the force. press.pvd lists the states of the last run. A press_N.vtu of an earlier run "
        "with more loads stays where it is: nothing is removed.");
    add_mechanics(app, effective);
    add_time_limit(app, effective);
  }
};

}  // namespace lumo::program
