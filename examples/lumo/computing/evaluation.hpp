#pragma once

#include "configuration/configuration.hpp"
#include "console/progress.hpp"
#include "lumo/campaign/campaign.hpp"
#include "lumo/pipeline/ensemble.hpp"
#include "lumo/pipeline/evaluate.hpp"
#include "lumo/study/assumptions.hpp"
#include "lumo/study/matched_study.hpp"

#include <functional>
#include <string>
#include <vector>

namespace lumo::program {

Evaluation make_evaluation(const Configuration& request, int threads, Progress& progress);

/// Depth [mm] at the last load of each scenario of the ensemble, without light; undefined where no equilibrium was
/// found.
std::vector<double> make_depths(const Configuration& request, int threads, Progress& progress);

/// Evaluates a design for a store; what goes wrong is in the verdict. Make it before the store is opened, for the
/// mesher forks.
using Evaluator = std::function<TrialResult(const Design& theta_mm)>;

/// Both objectives, with the request's material, contacts and mechanics.
Evaluator campaign_evaluator(const Configuration& request, int threads, Progress& progress);

/// What a study computes each design with.
struct StudyTools {
  Configuration asked = {};
  int threads = 1;
  bool coarse = false;  ///< coarser meshes, fewer rays
};

/// The value is the design's J_contact, and the record has that of its variants, too.
Evaluator study_evaluator(const StudyTools& tools, const MatchedStudy& study, Progress& progress);

/// Values are the design's objectives, and the record has those under all variants, after the usual ones.
Evaluator assumptions_evaluator(const StudyTools& tools, const std::vector<Scenario<Sphere>>& contacts,
    const std::vector<AssumptionVariant>& variants, Progress& progress);

}  // namespace lumo::program
