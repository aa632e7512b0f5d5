#pragma once

#include "console/progress.hpp"
#include "console/text.hpp"

#include <filesystem>
#include <string>
#include <system_error>

namespace lumo::program {

/// A store of 0 bytes is what a kill at the very start leaves, or what became of a full one: who had one is to know.
inline void tell_if_emptied(const std::string& store, Progress& progress) {
  std::error_code none;
  if (std::filesystem::file_size(store, none) == 0 && !none)
    progress.note("'" + one_line(store) + "' is empty (0 bytes): nothing to go on from, it begins anew");
}

}  // namespace lumo::program
