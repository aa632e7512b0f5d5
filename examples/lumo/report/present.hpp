#pragma once

#include "charts/section_drawing.hpp"
#include "configuration/configuration.hpp"
#include "console/output.hpp"
#include "lumo/pipeline/evaluate.hpp"
#include "report/report.hpp"

#include <string>

/// Results as text or JSON for standard output (the return value) and as files (added to `files` when wanted).
namespace lumo::program {

/// The design, and the press, in the words of all captions.
std::string theta_text(const Pad& pad);
std::string scenario_text(const ScenarioRecord& scenario);

std::string present(const Configuration& request, bool as_json, const SectionDrawing& section, Output& files);
std::string present(const Configuration& request, bool as_json, const MeshResult& mesh, Output& files);
std::string present(const Configuration& request, bool as_json, const PressResult& press, Output& files);
std::string present(const Configuration& request, bool as_json, const TraceResult& trace, Output& files);
std::string present(const Configuration& request, bool as_json, const Evaluation& evaluation, Output& files);

}  // namespace lumo::program
