// What lumo's halves of the comparisons share.
#pragma once

#include "lumo/core/error.hpp"

#include <cstddef>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <ios>

/// Of this process, all its threads.
inline double processor_seconds() { return double(std::clock()) / CLOCKS_PER_SEC; }

/// Raw numbers, as they stand in memory.
template <class T> void write(const std::filesystem::path& path, const T* values, std::size_t count) {
  std::ofstream out(path, std::ios::binary);
  out.write(reinterpret_cast<const char*>(values), std::streamsize(count * sizeof(T)));
  if (!out) throw lumo::InputError(lumo::message("cannot write ", path.string()));
}
