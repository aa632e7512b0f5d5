#pragma once

#include "lumo/sense/log_estimates.hpp"
#include "lumo/sense/peak_localizer.hpp"

namespace lumo::program {

inline BayesLocalizer bayes_localizer(const GreenProfile& readout, const UnloadedReference& unloaded) { return BayesLocalizer(finger_localizer(readout, unloaded)); }
inline PeakLocalizer peak_localizer(const GreenProfile& readout, const UnloadedReference& unloaded) { return PeakLocalizer({readout.positions_m(), unloaded.noise()}); }

}  // namespace lumo::program
