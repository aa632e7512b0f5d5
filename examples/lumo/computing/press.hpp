#pragma once

#include "configuration/configuration.hpp"
#include "console/progress.hpp"
#include "report/report.hpp"

#include <vector>

/// All throw lumo's errors; a solve that ends badly is a status in the result.
namespace lumo::program {

MeshResult make_mesh(const Configuration& request, Progress& progress);
PressResult make_press(const Configuration& request, Progress& progress);
/// Presses side by side on `threads` threads, in the order of their requests.
std::vector<PressOutcome> make_presses(const std::vector<Configuration>& requests, int threads, Progress& progress);
TraceResult make_trace(const Configuration& request, int threads, Progress& progress);

}  // namespace lumo::program
