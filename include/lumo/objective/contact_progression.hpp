#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/mechanics/contact/contact_set.hpp"
#include "lumo/mechanics/contact/state.hpp"
#include "lumo/morphology/body.hpp"

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

namespace lumo {

/// A number with its numerical error (half width of an interval that should hold a much finer computation's value).
struct Estimate {
  double value = 0.0;
  double error = 0.0;
};

/// The three terms of progressive-constraint contact of one scenario (paper Eq. 3–5). A term is empty if the loads do
/// not define it.
struct ContactTerms {
  std::optional<Estimate> form;    ///< q_form: patch radius at 2 N over indenter radius
  std::optional<Estimate> stable;  ///< q_stable: overlap of the contact sets at 2 N and 10 N, on the reference surface
  std::optional<Estimate> stiff;   ///< q_stiff: 1 − κ(1→2 N)/κ(5→10 N)
  /// (q_form q_stable q_stiff)^(1/3); nullopt if a term is empty, out of [0, 1] or not finite.
  std::optional<Estimate> score() const;
};

/// Errors of areas, overlap and stiffness at the default mesh, from the refinement study
/// (benchmarks/refinement/results.md).
struct MechanicalError {
  double area = 0.03;        ///< relative, of A
  double overlap = 0.015;    ///< absolute, of an intersection over union
  double stiffness = 0.008;  ///< relative, of a secant stiffness
};

/// The paper's loads that enter the terms [N].
struct ContactLoads {
  double first = 1.0, second = 2.0, third = 5.0, fourth = 10.0;
};

/// The worst scenario's contact progression (paper Eq. 5) and the index of the scenario that sets it; nullopt without
/// scenarios, or if one of them has no score.
template <class Record>
requires requires(const Record& s) {
  { s.terms } -> std::convertible_to<ContactTerms>;
}
std::optional<std::pair<Estimate, std::size_t>> contact_progression(const std::vector<Record>& scenarios) {
  std::optional<std::pair<Estimate, std::size_t>> worst;
  for (std::size_t k = 0; k < scenarios.size(); ++k) {
    const auto score = scenarios[k].terms.score();
    if (!score) return std::nullopt;
    if (!worst || score->value < worst->first.value) worst = std::pair(*score, k);
  }
  return worst;
}

/// How much less than the baseline a pad gives way at the same load, in percent: 100 (1 − δ/δ_baseline). Source: paper
/// Table II. Throws InvalidArgument for a depth that is negative or not finite, and for a baseline that is not
/// positive.
inline double progressive_constraint_gain(double depth, double baseline_depth) {
  require_in_range("depth", depth, 0.0, 1e3, "");
  require_in_range("baseline's depth", baseline_depth, 1e-12, 1e3, "");
  return 100.0 * (1.0 - depth / baseline_depth);
}

namespace detail {

/// A term in [0, 1]. The error of a term that is cut off is the part of it that reaches back over the edge.
inline Estimate clipped(const Estimate& e) {
  const double value = std::clamp(e.value, 0.0, 1.0);
  return {value, std::max(0.0, e.error - std::abs(e.value - value))};
}

/// Are the numbers finite that terms are made of?
inline bool is_sound(const MechanicalState& s) {
  return std::isfinite(s.force_N) && std::isfinite(s.depth_m) && std::isfinite(s.contact_area_m2) &&
         s.contact_area_m2 >= 0.0 &&
         std::none_of(s.contact_field.begin(), s.contact_field.end(), [](double gap) { return std::isnan(gap); });
}

}  // namespace detail

inline std::optional<Estimate> ContactTerms::score() const {
  if (!form || !stable || !stiff) return std::nullopt;
  for (const Estimate& e : {*form, *stable, *stiff})
    if (!(e.value >= 0.0 && e.value <= 1.0 && e.error >= 0.0 && std::isfinite(e.error))) return std::nullopt;
  const double value = std::cbrt(form->value * stable->value * stiff->value);
  const auto with = [&](double f, double s, double k) {
    return std::abs(std::cbrt(std::max(0.0, f) * std::max(0.0, s) * std::max(0.0, k)) - value);
  };
  // Errors of the three terms are taken as independent; finite changes, because the cube root has no slope at zero.
  const double a = std::max(with(form->value + form->error, stable->value, stiff->value),
      with(form->value - form->error, stable->value, stiff->value));
  const double b = std::max(with(form->value, stable->value + stable->error, stiff->value),
      with(form->value, stable->value - stable->error, stiff->value));
  const double c = std::max(with(form->value, stable->value, stiff->value + stiff->error),
      with(form->value, stable->value, stiff->value - stiff->error));
  return Estimate{value, std::sqrt(a * a + b * b + c * c)};
}

/// Terms of one scenario from its states on `mesh`, for a round indenter of `radius_m`. Only converged (or held) states
/// count, with finite numbers. Throws InvalidArgument for a radius, error or load out of range.
inline ContactTerms contact_terms(const Body& body, const TetMesh& mesh, const std::vector<MechanicalState>& states,
    double radius_m, const MechanicalError& error = {}, const ContactLoads& loads = {}) {
  require_positive("radius of the indenter", radius_m, "m");
  for (const double e : {error.area, error.overlap, error.stiffness})
    require_in_range("error of the contact's terms", e, 0.0, 1e3, "");
  const auto at = [&](double load) -> const MechanicalState* {
    require_positive("load of the contact's terms", load, "N");
    for (const MechanicalState& s : states)
      if (std::abs(s.load_N - load) <= 1e-9 * load && is_scored(s.status, true) && detail::is_sound(s)) return &s;
    return nullptr;
  };
  const MechanicalState *one = at(loads.first), *two = at(loads.second), *three = at(loads.third),
                        *four = at(loads.fourth);
  ContactTerms q;
  if (two) {
    const double form = std::sqrt(two->contact_area_m2 / (pi * radius_m * radius_m));
    q.form = detail::clipped({form, 0.5 * error.area * form});
  }
  if (two && four) {
    const ContactSurface surface(mesh, body, [](const Patch& p) { return p.contactable; });
    const Positions undeformed = positions_of(mesh);
    const SetOverlap overlap = two->recorded.empty() || four->recorded.empty()
                                   ? contact_overlap(surface, two->contact_field, four->contact_field, undeformed)
                                   : recorded_overlap(surface, two->recorded, four->recorded, undeformed);
    q.stable = Estimate{overlap.ratio(), error.overlap};
  }
  if (one && two && three && four) {
    const double early = (two->force_N - one->force_N) / (two->depth_m - one->depth_m);
    const double late = (four->force_N - three->force_N) / (four->depth_m - three->depth_m);
    const double ratio = early / late;
    // A held indenter's force may pass the next load before it moves on: no advance, no stiffness.
    const bool advanced = two->depth_m > one->depth_m && four->depth_m > three->depth_m;
    if (advanced && late > 0.0)
      q.stiff = detail::clipped({1.0 - ratio, std::sqrt(2.0) * error.stiffness * std::abs(ratio)});
  }
  return q;
}

}  // namespace lumo
