#include "commands/pressing.hpp"

#include <string_view>

namespace lumo::program {

namespace {

std::string_view meaning(std::string_view status) {
  if (status == "not_positive_definite") return "the pad gives way, or buckles";
  if (status == "inverted") return "an element is crushed";
  if (status == "max_iterations") return "the residual stays too large";
  if (status == "time_limit") return "out of time";
  return "the solver found no way on";
}

}  // namespace

std::string failure_of(const std::vector<ScenarioReport>& scenarios) {
  for (const ScenarioReport& s : scenarios) {
    if (s.status == "converged" || s.status == "held") continue;   // who asked for a solver that holds gets what it holds
    const double load_N = s.states.empty() ? 0.0 : s.states.back().load_N;
    return lumo::detail::text("no equilibrium at ", load_N, " N (", s.status, ": ", meaning(s.status), "), sphere of ", s.diameter_mm,
                              " mm at ", s.angle_deg, " deg, y = ", s.y_mm, " mm");
  }
  return "";
}

}  // namespace lumo::program
