#pragma once

#include "computing/request.hpp"
#include "console/progress.hpp"
#include "report/report.hpp"

#include <vector>

/// All throw lumo's errors; a solve that ends badly is a status in the result.
namespace lumo::program {

MeshResult make_mesh(const PressRequest& request, Progress& progress);
PressResult make_press(const PressRequest& request, Progress& progress);
/// Presses side by side on `threads` threads, in the order of their requests.
std::vector<PressOutcome> make_presses(const std::vector<PressRequest>& requests, int threads, Progress& progress);
TraceResult make_trace(const PressRequest& request, int threads, Progress& progress);

}  // namespace lumo::program
