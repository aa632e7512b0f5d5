#pragma once

#include "configuration/configuration.hpp"
#include "report/json.hpp"
#include "report/report.hpp"

namespace lumo::program {

/// What the page shows of a press along z at y = 0: the pad's whole surface at each load and the edges of contact.
/// Lengths of the surface are whole µm, which keeps the page small. States after a failure are left out; `note` then
/// says so.
Json press_model(const Configuration& request, const PressOutcome& outcome);

}  // namespace lumo::program
