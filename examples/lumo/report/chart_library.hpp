#pragma once

#include <string>

namespace lumo::program {

/// plotly.js as one script, which pages carry in them. The build finds it; LUMO_PLOTLY names another.
/// Throws InputError, with what to install, when there is none.
std::string chart_library();

/// As its first lines state it; empty when there is no such file.
std::string chart_library_version();

}  // namespace lumo::program
