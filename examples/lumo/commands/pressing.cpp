#include "commands/pressing.hpp"

#include "console/text.hpp"
#include "lumo/campaign/finger_campaign.hpp"

#include <string_view>

namespace lumo::program {

namespace {

std::string_view meaning(Status status) {
  switch (status) {
    case Status::not_positive_definite: return "the pad gives way, or buckles";
    case Status::inverted: return "an element is crushed";
    case Status::max_iterations: return "the residual stays too large";
    default: return "the solver found no way on";
  }
}

/// What may help.
std::string_view advice(Status status, const Configuration& asked) {
  const bool slides = asked.pad.finger.pad.stem == Stem::free &&
                      asked.mechanics.carrier_friction.value_or(asked.mechanics.friction) == 0.0;
  if (status != Status::not_positive_definite || !slides) return "";
  return "; friction on the stem may hold it: --assume carrier_friction_0.5";
}

std::string place_of(const ScenarioRecord& s) {
  return lumo::message("sphere of ", mm(s.diameter_m), " mm at ", degrees(s.angle_rad), " deg, y = ", mm(s.y_m), " mm");
}

/// What a press says that was stopped by the clock, after which load.
std::string out_of_time(const Configuration& asked, const ScenarioRecord& s) {
  std::string reached = "no load was reached";
  for (const StateRecord& state : s.states)
    if (is_scored(state.status, true)) reached = lumo::message(state.load_N, " N was reached");
  return lumo::message("the time limit of ", asked.mechanics.time_limit_s.value_or(undefined), " s ended the press (",
      to_string(s.status), "): ", reached, ", not ", s.states.back().load_N, " N, ", place_of(s));
}

}  // namespace

std::string failure_of(const Configuration& asked, const std::vector<ScenarioRecord>& scenarios) {
  for (const ScenarioRecord& s : scenarios) {
    if (is_scored(s.status, true)) continue;       // who asked for a solver that holds gets what it holds
    if (s.status == Status::unresolved) continue;  // equilibria, of which only areas are not known
    if (s.status == Status::time_limit) return out_of_time(asked, s);
    const double load_N = s.states.empty() ? 0.0 : s.states.back().load_N;
    return lumo::message("no equilibrium at ", load_N, " N (", to_string(s.status), ": ", meaning(s.status), "), ",
        place_of(s), advice(s.status, asked));
  }
  return "";
}

std::string unscored(const Configuration& asked, const std::vector<ScenarioRecord>& scenarios) {
  if (std::string why = failure_of(asked, scenarios); !why.empty()) return why;
  for (const ScenarioRecord& s : scenarios)
    if (s.status == Status::unresolved) return unresolved_contact(s);
  return "";
}

}  // namespace lumo::program
