#pragma once

#include "computing/contacts.hpp"

#include "lumo/campaign/finger_campaign.hpp"
#include "lumo/optimize/optimizer.hpp"

#include <cstdint>
#include <string>
#include <utility>

namespace lumo {

// Slow to compile: once for the whole program, in campaign_problem.cpp.
extern template class GaussianProcess<>;
extern template class Optimizer<>;
extern template class Optimizer<RbfKernel, LogNehvi, FreshCandidates>;

}  // namespace lumo

namespace lumo::program {

/// What a store of a campaign was made for.
struct CampaignProblem {
  std::string material = "DS";
  Ensemble ensemble = Ensemble::flat;
  std::string source = "default";  ///< of candidates: "paper" or "default"
  std::uint64_t seed = 1;
  bool paper = false;  ///< the paper's mechanics, whose held states are scored
  double ray_error_percent = 100.0 * RayRefinement{}.tolerance;  ///< wanted standard error of J_obs by rays
  int results = results_version;  ///< of the evaluations; another version's can be read, not continued

  Mechanics mechanics() const { return paper ? paper_mechanics() : Mechanics{}; }
};

/// One line a key, with every number that decides the results; how many evaluations are wanted is not among them.
std::string problem_text(const CampaignProblem& problem);
/// Throws InputError for a text that problem_text() has not written, in this version of the results or, over the same
/// designs, in another.
CampaignProblem read_problem(const std::string& text, const std::string& store);

/// Calls `use` with an optimiser that has seen nothing yet; candidates come from the "paper"'s or the "default" source.
template <class Use> auto with_optimizer(const Problem& problem, const std::string& source, Use&& use) {
  if (source == "paper") return use(Optimizer<RbfKernel, LogNehvi, FreshCandidates>(problem));
  return use(Optimizer<>(problem));
}
template <class Use> auto with_optimizer(const CampaignProblem& p, int evaluations, Use&& use) {
  return with_optimizer(finger_problem(evaluations, p.seed), p.source, std::forward<Use>(use));
}

}  // namespace lumo::program
