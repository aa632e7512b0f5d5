#pragma once

#include "lumo/campaign/finger_campaign.hpp"

#include <algorithm>
#include <optional>
#include <string>
#include <vector>

namespace lumo {

/// A design, or a matched variant of it, under the contacts of a study.
struct VariantResult {
  Twin twin = Twin::none;
  std::string why;  ///< empty: all scenarios converged
  std::optional<Estimate> J_contact;
  std::optional<std::size_t> worst_contact;
  /// D: norm of the response change at the study's load, median over scenarios, per emitted power.
  std::optional<Estimate> change;
  Observations observations;
};

/// Comparisons of a matched study. Source: paper §IV-A.
struct MatchedStudy {
  std::vector<Twin> twins;     ///< each design is compared with these
  bool light = false;          ///< trace light, too
  double change_load_N = 1.0;  ///< at which D is taken
};

/// Contacts at the middle of the finger, along the pad normal, with the smallest and the largest sphere of the paper.
inline Ensemble middle_contacts() {
  Ensemble e;
  e.diameters_m = {10e-3, 30e-3};
  e.places_m = {0.0};
  return e;
}

/// The one contact of the authors' carrier and void study. Source: the first author's public code
/// (dokkev/fingertip-design-framework), validation/contact-physics/multi_design_void_ablation.py.
inline Ensemble authors_study_contact() {
  Ensemble e = authors_flat_ensemble();
  e.diameters_m = {20e-3};
  e.places_m = {-5.5e-3};
  return e;
}

/// Points that a study draws its designs from.
inline constexpr int study_points = 1024;
/// Designs up to which a study is spread evenly: a campaign stops before half of its evaluations have failed, and twice
/// as many points are drawn.
inline constexpr int largest_study = 500;

/// The designs of a study: feasible lattice points spread over `space` (Owen-scrambled Sobol points), as a problem
/// without a search. The points do not depend on `designs`, so a study can go on with more. Throws InvalidArgument for
/// fewer than 1 or more than largest_study.
inline Problem study_problem(const DesignSpace& space, int designs, std::uint64_t seed) {
  if (designs < 1 || designs > largest_study)
    throw InvalidArgument(
        message("number of designs of a study is ", designs, ", must lie in [1, ", largest_study, "]"));
  Problem p;
  p.space = space;
  p.objectives = {{"J_contact", true, 0.0}};
  p.sobol = study_points;
  p.evaluations = designs;
  p.seed = seed;
  p.noise = Noise::none;  // no model learns from them
  return p;
}

/// Median over scenarios of the norm of the response change at one load; nullopt if a scenario has none.
inline std::optional<Estimate> median_change(
    const std::vector<ScenarioRecord>& scenarios, double load_N, const OpticalError& error) {
  std::vector<Estimate> norms;
  for (const ScenarioRecord& s : scenarios) {
    const std::vector<ObservedState> lit = observed_states(s, 0);
    const auto state = std::find_if(lit.begin(), lit.end(), [&](const ObservedState& k) { return k.load_N == load_N; });
    if (state == lit.end()) return std::nullopt;
    const Estimate d =
        response_distance(state->change, Eigen::MatrixXd::Zero(state->change.rows(), state->change.cols()));
    norms.push_back({d.value, std::hypot(2.0 * d.error, error.of(*state))});
  }
  if (norms.empty()) return std::nullopt;
  std::sort(norms.begin(), norms.end(), [](const Estimate& a, const Estimate& b) { return a.value < b.value; });
  const Estimate &low = norms[(norms.size() - 1) / 2], &high = norms[norms.size() / 2];
  return Estimate{
      0.5 * (low.value + high.value), 0.5 * (low.error + high.error)};  // errors of the mesh are alike in all scenarios
}

namespace detail {

template <class P, Executor E> VariantResult evaluate_variant(const Finger& wanted, const Ensemble& ensemble,
    const MatchedStudy& study, const P& pipeline, const E& executor, const ProgressReport& progress) {
  Body body = finger(wanted.design, wanted.silicone, wanted.options);
  if (!study.light) body.regions = 0;
  VariantResult result;
  result.twin = wanted.options.twin;
  try {
    result.observations = observe(body, ensemble.scenarios(), pipeline, executor, progress);
  } catch (const MeshError& e) {
    if (is_machine_limit(e)) throw;
    result.why = message("mesh: ", e.what());
    return result;
  }
  const auto& scenarios = result.observations.scenarios;
  result.why = failed_press(scenarios, pipeline.accept_held);
  if (!result.why.empty()) return result;
  if (const auto worst = contact_progression(scenarios)) {
    result.J_contact = worst->first;
    result.worst_contact = worst->second;
  }
  if (body.regions > 0) result.change = median_change(scenarios, study.change_load_N, pipeline.optical_error);
  return result;
}

}  // namespace detail

/// The design itself, then its variants, in the order of `study.twins`. A failure in one leaves the others whole.
/// Throws InfeasibleDesign, and MeshError if the machine's limits ended a mesh: another try may have them all.
template <class P, Executor E> std::vector<VariantResult> compare_variants(Finger design, const Ensemble& ensemble,
    const MatchedStudy& study, const P& pipeline, const E& executor, const ProgressReport& progress = {}) {
  std::vector<Twin> twins = {Twin::none};
  twins.insert(twins.end(), study.twins.begin(), study.twins.end());
  std::vector<VariantResult> results;
  for (const Twin twin : twins) {
    design.options.twin = twin;
    results.push_back(detail::evaluate_variant(design, ensemble, study, pipeline, executor, progress));
  }
  return results;
}

}  // namespace lumo
