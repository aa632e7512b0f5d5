#pragma once

#include "computing/request.hpp"
#include "drawing/section_drawing.hpp"

namespace lumo::program {

/// The cross-section with its dimensions.
SectionDrawing make_section(const Pad& pad);

}  // namespace lumo::program
