#pragma once

#include "program/options.hpp"
#include "program/output.hpp"
#include "program/progress.hpp"

#include <string>

namespace lumo::program {

/// decode, metrics, locate and force on a log's folder: what is to be printed; tables and pictures go into `files`.
/// Throws InputError for a log that cannot be read or lacks what the command needs.
std::string sense(const Options& options, Output& files, Progress& progress);

/// Looks through a live camera for two seconds: rate, exposure, gain, light, LEDs. Throws InputError when there is no such camera.
std::string doctor_camera(int number, bool as_json);

}  // namespace lumo::program
