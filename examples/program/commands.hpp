#pragma once

#include "program/options.hpp"
#include "program/progress.hpp"
#include "program/report.hpp"
#include "program/section_drawing.hpp"

#include "lumo/campaign/campaign.hpp"
#include "lumo/pipeline/evaluate.hpp"
#include "lumo/study/matched_study.hpp"
#include "lumo/lab/pad_responses.hpp"

#include <functional>
#include <vector>

/// What each command computes. This is where the program meets the library's stages; nothing here reads options or writes files.
/// All throw lumo's errors; a solve that ends badly is a status in the result.
namespace lumo::program {

/// Throws InfeasibleDesign; cheap, called before everything else.
void check_design(const Options& options);

SectionDrawing make_section(const Options& options);
MeshResult make_mesh(const Options& options, Progress& progress);
PressResult make_press(const Options& options, Progress& progress);
/// Presses side by side on `threads` threads, in the order of their requests.
std::vector<PressOutcome> make_presses(const std::vector<Options>& requests, int threads, Progress& progress);
TraceResult make_trace(const Options& options, Progress& progress);
Evaluation make_evaluation(const Options& options, Progress& progress);

/// Depth [mm] at the last load of each scenario, without light; undefined where no equilibrium was found.
std::vector<double> make_depths(const Options& options, const std::array<double, 5>& theta_mm, const lumo::Ensemble& ensemble, Progress& progress);

/// Light of the options' pad at all places and loads of the virtual lab, and in one line what was computed and how.
PadResponses make_pad_responses(const Options& options, Progress& progress);
std::string pad_responses_key(const Options& options);

/// Evaluates designs for a campaign over the options' material and ensemble; what goes wrong is in the verdict. Make it before a store is
/// opened, for the mesher forks.
using Evaluator = std::function<TrialResult(const Design& theta_mm)>;
Evaluator campaign_evaluator(const Options& options, Progress& progress);

/// The same for a study: the value is the design's J_contact, and the record tells that of its variants, too.
Evaluator study_evaluator(const Options& options, const MatchedStudy& study, const lumo::Ensemble& ensemble, Progress& progress);

/// The same: values are the design's objectives, and the record tells those under all readings, lumo's own first.
Evaluator readings_evaluator(const Options& options, const std::vector<Scenario<Sphere>>& contacts, Progress& progress);

}  // namespace lumo::program
