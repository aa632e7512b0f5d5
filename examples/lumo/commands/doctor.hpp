#pragma once

#include "report/json.hpp"

#include <string>

namespace lumo::program {

/// What this program was built with, what it runs on, and what is off and how to get it.
std::string doctor(bool json);

/// What the numbers of a store may hang on besides its problem: processor, system, compiler, versions of the libraries that compute them.
Json provenance();

}  // namespace lumo::program
