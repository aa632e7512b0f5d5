#pragma once

#include "options/options.hpp"
#include "console/output.hpp"
#include "report/report.hpp"
#include "drawing/section_drawing.hpp"

#include <string>

/// Results as text or JSON for standard output (the return value) and as files (added to `files` when wanted).
namespace lumo::program {

/// The design, and the press, in the words of all captions.
std::string theta_text(const Options& options);
std::string scenario_text(const ScenarioReport& scenario);

std::string present(const Options& options, const SectionDrawing& section, Output& files);
std::string present(const Options& options, const MeshResult& mesh, Output& files);
std::string present(const Options& options, const PressResult& press, Output& files);
std::string present(const Options& options, const TraceResult& trace, Output& files);
std::string present(const Options& options, const EvaluationResult& evaluation, Output& files);

}  // namespace lumo::program
