#pragma once

#include "options/options.hpp"
#include "console/output.hpp"
#include "console/progress.hpp"

#include <string>

namespace lumo::program {

/// Contacts on all links of a hand, from a log whose session describes them: a table, a chart of places over time, and a picture of each contact at its strongest. Returns
/// what is to be printed. Throws InputError for a log without links, joints or pictures of the unloaded hand.
std::string hand(const Options& options, Output& files, Progress& progress);

}  // namespace lumo::program
