#pragma once

#include "lumo/pipeline/evaluate.hpp"
#include "program/options.hpp"
#include "program/output.hpp"
#include "program/report.hpp"
#include "program/section_drawing.hpp"

#include <string>

/// Results as text or JSON for standard output (the return value) and as files (added to `files` when wanted).
namespace lumo::program {

/// The design, and the press, in the words of all captions.
std::string theta_text(const Options& options);
std::string scenario_text(const ScenarioRecord& scenario);

std::string present(const Options& options, const SectionDrawing& section, Output& files);
std::string present(const Options& options, const MeshResult& mesh, Output& files);
std::string present(const Options& options, const PressResult& press, Output& files);
std::string present(const Options& options, const TraceResult& trace, Output& files);
std::string present(const Options& options, const Evaluation& evaluation, Output& files);

}  // namespace lumo::program
