#pragma once

#include "computing/pad_light.hpp"
#include "console/progress.hpp"

#include "lumo/lab/pad_responses.hpp"

#include <optional>
#include <string>

namespace lumo::program {

using namespace sense;

/// A pad's light, and where it is kept.
struct ResponsesRequest : PressedPad {
  int threads = 1;
  std::optional<std::string> cache;  ///< folder; else beside `log`
};

/// Computed, or taken from the cache. Throws lumo's errors from the computation.
PadResponses responses(const ResponsesRequest& request, const std::string& log, Progress& progress);

}  // namespace lumo::program
