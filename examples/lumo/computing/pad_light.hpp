#pragma once

#include "configuration/configuration.hpp"
#include "console/progress.hpp"

#include "lumo/lab/pad_responses.hpp"

#include <string>

namespace lumo::program {

/// A pad and the sphere that presses it. Coarse: a few places, for trying out; contacts in between are then far from
/// right.
struct PressedPad {
  Pad pad;
  bool coarse = false;
  double diameter_mm = 10.0;
};

/// Its light at all places and loads of the virtual lab.
PadResponses make_pad_responses(const PressedPad& pressed, int threads, Progress& progress);

/// In one line what is computed and how.
std::string pad_responses_key(const PressedPad& pressed);

}  // namespace lumo::program
