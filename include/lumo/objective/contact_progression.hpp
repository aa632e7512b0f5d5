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

/// A number with its numerical error: half width of an interval that should hold a much finer computation's value in
/// 95 of 100 cases.
struct Estimate {
  double value = 0.0;
  double error = 0.0;

  double standard_error() const { return 0.5 * error; }
};

/// A contact too small for its mesh: its area is not known.
struct Unresolved {
  double load_N = 0.0;
  double radius_m = 0.0;  ///< of the contact
  double edge_m = 0.0;    ///< between the mesh's nodes along its edge
};

/// The three terms of progressive-constraint contact of one scenario (paper Eq. 3–5). A term is empty if the loads do
/// not define it, or if a contact that it needs is unresolved.
struct ContactTerms {
  std::optional<Estimate> form;    ///< q_form: patch radius at 2 N over indenter radius
  std::optional<Estimate> stable;  ///< q_stable: overlap of the contact sets at 2 N and 10 N, on the reference surface
  std::optional<Estimate> stiff;   ///< q_stiff: 1 − κ(1→2 N)/κ(5→10 N)
  /// (q_form q_stable q_stiff)^(1/3); nullopt if a term is empty, out of [0, 1] or not finite.
  std::optional<Estimate> score() const;
};

/// How far areas, overlaps and stiffness are from those of a fine mesh, by what their own mesh says: the distance of
/// its nodes along the edge of contact, pressure that acts outside of the contact set, and EnergyError. The numbers
/// cover nine of ten differences on meshes of 0.7 to 5.6 times the default's edges
/// (benchmarks/refinement/results.md).
struct MechanicalError {
  double area = 0.42;         ///< of an area, where the nodes are as far apart as the contact's radius is long
  double area_power = 1.6;    ///< of that ratio
  double outside = 0.75;      ///< of an area, times the outside part of the force to the power 2/3
  double coarsest = 1.0;      ///< of that ratio: beyond it there is no area to speak of
  double most_outside = 0.5;  ///< of the force; the same
  double stiffness = 0.9;     ///< of a secant stiffness, times the energy's error

  bool resolves(const ContactSpot& spot) const {
    return spot.area_m2 > 0.0 && spot.edge_m <= coarsest * spot.radius_m() &&
           spot.force_outside_N <= most_outside * spot.force_N;
  }
  /// Relative, of one contact.
  double of_area(const ContactSpot& spot) const {
    if (!(spot.area_m2 > 0.0)) return 1.0;
    return std::min(1.0, area * std::pow(spot.edge_m / spot.radius_m(), area_power) +
                             outside * std::pow(spot.force_outside_N / spot.force_N, 2.0 / 3.0));
  }
  /// Relative, of a state's whole contact area.
  double of_area(const MechanicalState& state) const;
  /// The contact that is resolved worst, if one that bears a hundredth of the load is not. States that are only held
  /// are not judged.
  std::optional<Unresolved> unresolved_in(const MechanicalState& state) const;
  /// Edge length that a contact wants where its own does not resolve it; else its own.
  double wanted_edge(const ContactSpot& spot) const;
  double of_stiffness(const MechanicalState& state) const { return stiffness * state.energy_error; }
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
         s.contact_area_m2 >= 0.0 && s.energy_error >= 0.0 && std::isfinite(s.energy_error) &&
         std::all_of(s.spots.begin(), s.spots.end(),
             [](const ContactSpot& spot) {
               return spot.force_N > 0.0 && spot.force_outside_N >= 0.0 && spot.area_m2 >= 0.0 && spot.rim_m >= 0.0 &&
                      std::isfinite(spot.force_N + spot.force_outside_N + spot.area_m2 + spot.rim_m + spot.edge_m);
             }) &&
         std::none_of(s.contact_field.begin(), s.contact_field.end(), [](double gap) { return std::isnan(gap); });
}

}  // namespace detail

inline double MechanicalError::of_area(const MechanicalState& state) const {
  double all = 0.0, wrong = 0.0;
  for (const ContactSpot& s : state.spots) {
    all += s.force_N;
    wrong += s.force_N * of_area(s);
  }
  return all > 0.0 ? wrong / all : 0.0;
}

inline double MechanicalError::wanted_edge(const ContactSpot& spot) const {
  constexpr double of_radius = 0.25, of_edge = 0.15;  // the latter where the contact has no radius that means something
  if (resolves(spot)) return spot.edge_m;
  const double trusted = spot.radius_m() > of_radius * spot.edge_m ? of_radius * spot.radius_m() : 0.0;
  return std::max(trusted, of_edge * spot.edge_m);
}

inline std::optional<Unresolved> MechanicalError::unresolved_in(const MechanicalState& state) const {
  constexpr double least_part = 0.01;  // of the load
  std::optional<Unresolved> worst;
  if (state.status == Status::held) return worst;
  double largest = 0.0;
  for (const ContactSpot& s : state.spots)
    if (s.force_N >= least_part * state.load_N && !resolves(s) && of_area(s) > largest) {
      largest = of_area(s);
      worst = Unresolved{state.load_N, s.radius_m(), s.edge_m};
    }
  return worst;
}

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
  for (const double e :
      {error.area, error.area_power, error.outside, error.coarsest, error.most_outside, error.stiffness})
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
  const auto known = [&](const MechanicalState* s) { return s != nullptr && !error.unresolved_in(*s); };
  if (known(two)) {
    const double form = std::sqrt(two->contact_area_m2 / (pi * radius_m * radius_m));
    q.form = detail::clipped({form, 0.5 * error.of_area(*two) * form});
  }
  if (known(two) && known(four)) {
    const ContactSurface surface(mesh, body, [](const Patch& p) { return p.contactable; });
    const Positions undeformed = positions_of(mesh);
    const SetOverlap overlap = two->recorded.empty() || four->recorded.empty()
                                   ? contact_overlap(surface, two->contact_field, four->contact_field, undeformed)
                                   : recorded_overlap(surface, two->recorded, four->recorded, undeformed);
    // One set lies in the other, or nearly so.
    q.stable =
        detail::clipped({overlap.ratio(), overlap.ratio() * std::hypot(error.of_area(*two), error.of_area(*four))});
  }
  if (one && two && three && four) {
    const double early = (two->force_N - one->force_N) / (two->depth_m - one->depth_m);
    const double late = (four->force_N - three->force_N) / (four->depth_m - three->depth_m);
    const double ratio = early / late;
    // A held indenter's force may pass the next load before it moves on: no advance, no stiffness.
    const bool advanced = two->depth_m > one->depth_m && four->depth_m > three->depth_m;
    if (advanced && late > 0.0)
      q.stiff = detail::clipped(
          {1.0 - ratio, std::abs(ratio) * std::hypot(error.of_stiffness(*two), error.of_stiffness(*four))});
  }
  return q;
}

}  // namespace lumo
