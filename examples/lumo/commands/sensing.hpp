#pragma once

#include "options/options.hpp"
#include "console/output.hpp"
#include "console/progress.hpp"

#include <string>

namespace lumo::program {

/// The commands that need OpenCV: decode, metrics, locate, force, hand, calibrate and convert on a log, the first five and record before a live camera, lab, which
/// makes a log, and doctor with a camera, looked through for two seconds. Returns what is to be printed; tables and pictures go into `files`.
///
/// OpenCV and the fifty libraries below it take a quarter of a second to load. So they are in a program of their own, lumo-sensing: there this runs the
/// command; in lumo it goes on as that program, which lies beside it, with the same `arguments` as main() got, and does not return.
/// Throws InputError for a log or a camera that cannot be read or lacks what the command needs, Error where the build lacks OpenCV or lumo-sensing is not there.
std::string sense(const Options& options, Output& files, Progress& progress, char** arguments);

}  // namespace lumo::program
