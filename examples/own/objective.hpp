#pragma once

#include "lumo/pipeline/evaluate.hpp"

#include <cmath>
#include <optional>

namespace own {

//! [objective]
/// How evenly contacts are seen: the smallest change of the response at one load over the largest, over all
/// scenarios [–], in [0, 1].
struct EvenSight {
  double load_N = 2.0;

  std::optional<lumo::Estimate> operator()(const lumo::Observations& all) const {
    std::optional<lumo::Estimate> least, most;
    for (const lumo::ScenarioRecord& scenario : all.scenarios)
      for (const lumo::StateRecord& state : scenario.states) {
        if (state.load_N != load_N || state.change.size() == 0) continue;
        const lumo::Estimate size = lumo::response_distance(state.change, 0.0 * state.change);
        if (!least || size.value < least->value) least = size;
        if (!most || size.value > most->value) most = size;
      }
    if (!least || !(most->value > 0.0)) return std::nullopt;  // not one of the scenarios' loads, or nothing is seen
    const double ratio = least->value / most->value;
    const double deviation = std::hypot(least->error, ratio * most->error) / most->value;
    return lumo::Estimate{ratio, 2.0 * deviation};
  }
};

static_assert(lumo::ObservedObjective<EvenSight>);
//! [objective]

}  // namespace own
