#pragma once

#include "report/report.hpp"

#include "lumo/mechanics/status.hpp"
#include "lumo/objective/contact_progression.hpp"

#include <optional>

/// What the library found, as it is reported.
namespace lumo::program {

inline double value_of(const std::optional<Estimate>& e) { return e ? e->value : undefined; }

inline void report_terms(ScenarioReport& report, const ContactTerms& terms) {
  report.q_form = value_of(terms.form);
  report.q_stable = value_of(terms.stable);
  report.q_stiff = value_of(terms.stiff);
}

/// Of a MechanicalState or a StateRecord. Of a solve that failed only the load is known.
template <class State>
StateReport report_state(const State& s) {
  if (!is_scored(s.status, true)) return {s.load_N};
  return {s.load_N, s.force_N, 1e3 * s.depth_m, 1e6 * s.contact_area_m2, 1e6 * s.reference_area_m2, s.residual_N, 1e3 * s.penetration_m};
}

}  // namespace lumo::program
