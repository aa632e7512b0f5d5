#pragma once

#include "sensing/log.hpp"

#include "lumo/sense/force/log_estimates.hpp"
#include "lumo/sense/localize/peak_localizer.hpp"

#include <string>

namespace lumo::program {

using namespace sense;

inline BayesLocalizer bayes_localizer(const GreenProfile& readout, const UnloadedReference& unloaded) {
  return BayesLocalizer(finger_localizer(readout, unloaded));
}
inline PeakLocalizer peak_localizer(const GreenProfile& readout, const UnloadedReference& unloaded) {
  return PeakLocalizer({readout.positions_m(), unloaded.noise()});
}

/// Calls `use` with a maker of the localiser of that name, "peak" or "bayes".
template <class Use>
auto with_maker(const std::string& name, Use use) {
  return name == "peak" ? use(peak_localizer) : use(bayes_localizer);
}

/// Calls `use` with the localiser for a log.
template <class Use>
auto with_localizer(const std::string& name, const SensedLog& s, const UnloadedReference& unloaded, Use use) {
  return with_maker(name, [&](auto make) { return use(make(s.view.readout(s.bins), unloaded)); });
}

}  // namespace lumo::program
