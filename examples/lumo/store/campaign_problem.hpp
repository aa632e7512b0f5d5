#pragma once

#include "computing/contacts.hpp"

#include "lumo/campaign/finger_campaign.hpp"
#include "lumo/optimize/optimizer.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace lumo {

// Slow to compile: once for the whole program, in campaign_problem.cpp.
extern template class GaussianProcess<>;
extern template class Optimizer<>;
extern template class Optimizer<RbfKernel, LogNehvi, FreshCandidates>;

}  // namespace lumo

namespace lumo::program {

/// A result that a campaign knows from the start, and of which version it is, where that is known.
struct KnownEvaluation {
  KnownResult result;
  std::optional<int> results = std::nullopt;
};

/// What a store of a campaign was made for: θ, the touch, the lab and how many evaluations are wanted apart.
struct CampaignProblem {
  Configuration asked = {};
  int results = results_version;  ///< of the evaluations; another version's can be read, not continued
  std::vector<KnownEvaluation> known = {};

  const std::string& material() const { return asked.pad.material(); }
  std::string ensemble() const { return name(asked.ensemble); }
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
inline Problem problem_of(const Configuration& o, int evaluations) {
  return finger_problem(evaluations, std::uint64_t(o.search.seed), o.pad.finger.pad, designs_of(o.search.references));
}
/// Known results of another version of the results inform the models only: they cannot be compared.
Problem problem_of(const CampaignProblem& p, int evaluations);
template <class Use> auto with_optimizer(const CampaignProblem& p, int evaluations, Use&& use) {
  return with_optimizer(problem_of(p, evaluations), p.asked.search.source, std::forward<Use>(use));
}

/// Which values a front and its hypervolume are made of, in words; `modelled` as in Standing.
std::string values_words(const std::vector<std::string>& modelled);

}  // namespace lumo::program
