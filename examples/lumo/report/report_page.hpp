#pragma once

#include "report/json.hpp"

#include <string>

namespace lumo::program {

/// One HTML file with style, scripts, chart library and data in it, so that it opens from disk without a network.
/// Nothing in `data` can break out of its place: the page shows strings as text.
std::string report_page(const std::string& title, const Json& data, const std::string& chart_library);

/// plotly.js as one script, which pages carry in them. The build finds it; LUMO_PLOTLY names another.
/// Throws InputError, with what to install, when there is none.
std::string chart_library();

/// As its first lines state it; empty when there is no such file.
std::string chart_library_version();

}  // namespace lumo::program
