#pragma once

#include "options/options.hpp"
#include "console/progress.hpp"

#include <string>

/// `lumo campaign …`: what goes to standard output. All throw StoreError for a store that cannot be used.
namespace lumo::program {

/// Evaluates until the store holds as many results as are wanted. Throws CampaignError when too many evaluations fail.
std::string campaign_run(const Options& options, Progress& progress);
std::string campaign_status(const Options& options);
std::string campaign_verify(const Options& options);
std::string campaign_export(const Options& options);
/// The balanced choice among what was evaluated, how stable it is, and how much its pad stops the finger from sinking in.
std::string campaign_select(const Options& options, Progress& progress);
/// Writes one HTML page about one or more stores and says where it is. Throws InputError when it cannot be written.
std::string campaign_report(const Options& options, Progress& progress);

}  // namespace lumo::program
