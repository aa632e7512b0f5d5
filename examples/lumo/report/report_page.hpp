#pragma once

#include "report/json.hpp"

#include <string>

namespace lumo::program {

/// One HTML file with style, scripts, chart library and data in it, so that it opens from disk without a network.
/// Nothing in `data` can break out of its place: the page shows strings as text.
std::string report_page(const std::string& title, const Json& data, const std::string& chart_library);

}  // namespace lumo::program
