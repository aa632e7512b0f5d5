#pragma once

#include "program/options.hpp"
#include "program/output.hpp"
#include "program/progress.hpp"

#include <string>

namespace lumo::program {

/// `lumo study carrier` and `lumo study void`: what goes to standard output; its picture and table go to `files` when wanted. Throws StoreError.
std::string study(const Options& options, Output& files, Progress& progress);

}  // namespace lumo::program
