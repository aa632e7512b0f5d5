#pragma once

#include "lumo/version.hpp"

#include <string>

/// Is the version of the headers the one that the build system says it found?
inline bool is_wanted_version() {
  return std::to_string(lumo::version_major) + '.' + std::to_string(lumo::version_minor) + '.' +
             std::to_string(lumo::version_patch) ==
         WANTED_VERSION;
}
