#pragma once

#include "charts/section_drawing.hpp"
#include "configuration/configuration.hpp"

namespace lumo::program {

/// The cross-section with its dimensions.
SectionDrawing make_section(const Pad& pad);

}  // namespace lumo::program
