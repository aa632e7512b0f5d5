#pragma once

#include "options/options.hpp"
#include "console/output.hpp"
#include "console/progress.hpp"

#include <string>

namespace lumo::program {

/// `lumo study carrier` and `lumo study void`: what goes to standard output; its picture and table go to `files` when wanted. Throws StoreError.
std::string study(const Options& options, Output& files, Progress& progress);

/// `lumo study readings`: how far results move with each reading of what the paper leaves open. Throws StoreError.
std::string study_readings(const Options& options, Output& files, Progress& progress);

}  // namespace lumo::program
