#pragma once

#include "options/options.hpp"
#include "console/output.hpp"

#include <string>

namespace lumo::program {

/// Everything to print and cast the options' pad: its files are added to `files`, and what there is to know about them is returned, as text or JSON.
/// Throws lumo's errors.
std::string fabricate(const Options& options, Output& files);

}  // namespace lumo::program
