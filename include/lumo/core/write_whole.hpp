#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/stopwatch.hpp"

#include <cerrno>
#include <cstdio>
#include <fstream>
#include <string>
#include <string_view>
#include <system_error>

namespace lumo {

/// The whole file or none: written beside its place under a name that no other writer takes, then renamed; an older one
/// is replaced. Throws InputError of one line, and leaves what was there.
inline void write_whole(const std::string& path, std::string_view bytes) {
  // Two programs, or threads, may write the same file at once; the time and a place on the stack tell them apart.
  const std::string part = message(path, ".part-", steady_ns(), '-', static_cast<const void*>(&bytes));
  errno = 0;
  std::ofstream out(part, std::ios::binary);
  out.write(bytes.data(), std::streamsize(bytes.size()));
  out.close();
  if (out && std::rename(part.c_str(), path.c_str()) == 0) return;
  const std::string why = std::error_code(errno != 0 ? errno : EIO, std::generic_category()).message();
  std::remove(part.c_str());
  throw InputError(message(path, ": cannot be written: ", why));
}

}  // namespace lumo
