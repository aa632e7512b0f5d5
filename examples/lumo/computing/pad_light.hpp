#pragma once

#include "configuration/configuration.hpp"
#include "console/progress.hpp"

#include "lumo/lab/pad_responses.hpp"

#include <string>

namespace lumo::program {

/// Light of a pad at all places and loads of the virtual lab. Coarse: a few places, for trying out; contacts in between
/// are then far from right.
PadResponses make_pad_responses(const Pad& pad, bool coarse, int threads, Progress& progress);

/// In one line what is computed and how.
std::string pad_responses_key(const Pad& pad, bool coarse);

}  // namespace lumo::program
