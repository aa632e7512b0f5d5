#pragma once

#include "options/options.hpp"
#include "console/progress.hpp"

#include <string>

namespace lumo::program {

/// Writes a log in the other form: an MCAP file where the target ends in .mcap, else a folder. Image files are copied as they are; `raw` makes pixels of them,
/// and what is no image file (a video's frames, pixels of an MCAP file) becomes PNG otherwise. The truth of a virtual lab is copied beside. Returns what is to
/// be printed. Throws InputError.
std::string convert(const Options& options, Progress& progress);

}  // namespace lumo::program
