#pragma once

#include "console/progress.hpp"
#include "store/campaign_problem.hpp"

#include <string>
#include <vector>

/// What a campaign knows before its first evaluation, and how a store that is there goes on.
namespace lumo::program {

/// Results from a table (CSV) or from another campaign's store, which may be of another version of the results, but has
/// to be of the same objectives. Throws InputError, StoreError.
std::vector<KnownEvaluation> read_known(const std::string& from, const CampaignProblem& problem);

/// What a user gave beside the configuration.
struct Given {
  std::string known;   ///< table or store; empty: none
  bool noise = false;  ///< was search.noise given?
};

/// The problem to work on: as it was asked for, with the known results; of a store that is there those that it has, and
/// without errors if it has none. Throws InputError for other known results, StoreError.
CampaignProblem continued(CampaignProblem asked, const std::string& store, const Given& given, Progress& progress);

}  // namespace lumo::program
