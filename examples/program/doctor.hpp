#pragma once

#include <string>

namespace lumo::program {

/// What this program was built with, what it runs on, and what is off and how to get it.
std::string doctor(bool json);

}  // namespace lumo::program
