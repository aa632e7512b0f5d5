#pragma once

#include "program/options.hpp"
#include "program/progress.hpp"

#include <string>

/// `lumo campaign …`: what goes to standard output. All throw StoreError for a store that cannot be used.
namespace lumo::program {

/// Evaluates until the store holds as many results as are wanted. Throws CampaignError when too many evaluations fail.
std::string campaign_run(const Options& options, Progress& progress);
std::string campaign_status(const Options& options);
std::string campaign_verify(const Options& options);
std::string campaign_export(const Options& options);

}  // namespace lumo::program
