#pragma once

#include "options/options.hpp"
#include "console/progress.hpp"

#include <string>

namespace lumo::program {

/// Computes the pad's responses, or takes them from the cache, and writes the log of a virtual rig into a new folder. Returns what is to be printed.
/// Throws InputError when the folder is there and not empty or cannot be written; lumo's other errors from the computation.
std::string lab(const Options& options, Progress& progress);

/// One specimen against its nominal pad, from a log with a press (wrench.csv, marker.csv, holds), an unloaded and a dark stretch. Returns what is to be printed.
/// Throws InputError for a log that lacks one of them.
std::string calibrate(const Options& options, Progress& progress);

}  // namespace lumo::program
