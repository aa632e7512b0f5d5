#pragma once

#include "computing/request.hpp"
#include "console/progress.hpp"

#include "lumo/pipeline/ensemble.hpp"
#include "lumo/pipeline/evaluate.hpp"

#include <vector>

namespace lumo::program {

Evaluation make_evaluation(const EvaluationRequest& request, int threads, Progress& progress);

/// Depth [mm] at the last load of each scenario, without light; undefined where no equilibrium was found.
std::vector<double> make_depths(
    const Pad& pad, const Mechanics& mechanics, const lumo::Ensemble& ensemble, int threads, Progress& progress);

}  // namespace lumo::program
