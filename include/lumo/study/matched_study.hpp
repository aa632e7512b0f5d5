#pragma once

#include "lumo/campaign/finger_campaign.hpp"

#include <algorithm>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace lumo {

/// A design, or a matched variant of it, under the contacts of a study.
struct VariantResult {
  Twin twin = Twin::none;
  std::string why;  ///< empty: all scenarios converged
  std::optional<Estimate> J_contact;
  std::optional<std::size_t> worst_contact;
  std::optional<Estimate>
      change;  ///< D: norm of the response change at the study's load, median over scenarios, per emitted power
  Observations observations;
};

/// What a matched study compares. Source: paper §IV-A.
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

/// Designs up to which all of a study are spread evenly: a campaign stops before half of its evaluations have failed,
/// and twice as many are drawn.
inline constexpr int largest_study = 500;

/// The designs of a study: feasible lattice points spread over `space` (Owen-scrambled Sobol points), as a problem
/// without a search. What is drawn does not hang on `designs`, so that a study can go on with more. Throws
/// InvalidArgument for fewer than 1 or more than largest_study.
inline Problem study_problem(const DesignSpace& space, int designs, std::uint64_t seed) {
  if (designs < 1 || designs > largest_study)
    throw InvalidArgument(
        message("number of designs of a study is ", designs, ", must lie in [1, ", largest_study, "]"));
  Problem p;
  p.space = space;
  p.objectives = {{"J_contact", true, 0.0}};
  p.sobol = 1024;
  p.evaluations = designs;
  p.seed = seed;
  return p;
}

/// The design itself, then its variants, in the order of `study.twins`. What fails in one leaves the others whole.
/// Throws InfeasibleDesign, and MeshError where a mesh failed for the machine's limits: another try may have them all.
template <class P, Executor E>
std::vector<VariantResult> compare_variants(const FingerDesign& design, const Silicone& silicone,
                                            const Ensemble& ensemble, const MatchedStudy& study, const P& pipeline,
                                            const FingerOptions& options, const E& executor,
                                            const ProgressReport& progress = {});

/// Median over scenarios of the norm of the response change at one load; empty when a scenario has none.
inline std::optional<Estimate> median_change(const std::vector<ScenarioRecord>& scenarios, double load_N,
                                             const OpticalError& error) {
  std::vector<Estimate> norms;
  for (const ScenarioRecord& s : scenarios) {
    const auto state = std::find_if(s.states.begin(), s.states.end(),
                                    [&](const StateRecord& k) { return k.load_N == load_N && k.change.size() > 0; });
    if (state == s.states.end()) return std::nullopt;
    const Estimate d =
        response_distance(state->change, Eigen::MatrixXd::Zero(state->change.rows(), state->change.cols()));
    norms.push_back({d.value, std::hypot(2.0 * d.error, error.mesh * d.value)});
  }
  if (norms.empty()) return std::nullopt;
  std::sort(norms.begin(), norms.end(), [](const Estimate& a, const Estimate& b) { return a.value < b.value; });
  const Estimate &low = norms[(norms.size() - 1) / 2], &high = norms[norms.size() / 2];
  return Estimate{0.5 * (low.value + high.value),
                  0.5 * (low.error + high.error)};  // errors of the mesh are alike in all scenarios
}

namespace detail {

template <class P, Executor E>
VariantResult evaluate_variant(const FingerDesign& design, Twin twin, const Silicone& silicone,
                               const Ensemble& ensemble, const MatchedStudy& study, const P& pipeline,
                               FingerOptions options, const E& executor, const ProgressReport& progress) {
  options.twin = twin;
  Body body = finger(design, silicone, options);
  if (!study.light) body.regions = 0;
  VariantResult result;
  result.twin = twin;
  try {
    result.observations = observe(body, ensemble.scenarios(), pipeline, executor, progress);
  } catch (const MeshError& e) {
    if (of_the_machine(e)) throw;
    result.why = message("mesh: ", e.what());
    return result;
  }
  const auto& scenarios = result.observations.scenarios;
  result.why = failed_press(scenarios);
  if (!result.why.empty()) return result;
  if (const auto worst = contact_progression(scenarios)) {
    result.J_contact = worst->first;
    result.worst_contact = worst->second;
  }
  if (body.regions > 0) result.change = median_change(scenarios, study.change_load_N, pipeline.optical_error);
  return result;
}

}  // namespace detail

template <class P, Executor E>
std::vector<VariantResult> compare_variants(const FingerDesign& design, const Silicone& silicone,
                                            const Ensemble& ensemble, const MatchedStudy& study, const P& pipeline,
                                            const FingerOptions& options, const E& executor,
                                            const ProgressReport& progress) {
  std::vector<VariantResult> results = {
      detail::evaluate_variant(design, Twin::none, silicone, ensemble, study, pipeline, options, executor, progress)};
  for (const Twin twin : study.twins)
    results.push_back(
        detail::evaluate_variant(design, twin, silicone, ensemble, study, pipeline, options, executor, progress));
  return results;
}

}  // namespace lumo
