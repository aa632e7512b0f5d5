#pragma once

#include "options/options.hpp"
#include "console/output.hpp"
#include "console/progress.hpp"

#include <string>

namespace lumo::program {

/// locate, force and hand before a live camera: one line on standard output for each picture, until --seconds are over, the camera goes, or nobody reads. Throws InputError.
std::string sense_live(const Options& options, Progress& progress);

/// Records camera and motors as a log in `folder`, by the plan that the session of `options.log` is, if there is one. Returns what is to be printed. Throws InputError.
std::string record(const Options& options, const std::string& folder, Progress& progress);

/// Rate, exposure and LEDs of a live camera.
std::string watch(const Options& options);

}  // namespace lumo::program
