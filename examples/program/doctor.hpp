#pragma once

#include <string>

namespace lumo::program {

/// What this program was built with, what it runs on, and what is off and how to get it.
std::string doctor(bool json);

/// Tells the BLAS to use one thread per call: scenarios already run side by side, and more threads would only fight.
void single_threaded_blas();

}  // namespace lumo::program
