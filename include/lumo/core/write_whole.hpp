#pragma once

#include "lumo/core/error.hpp"

#include <cerrno>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <system_error>

namespace lumo::detail {

/// The whole file or none: written beside its place under a name that no other writer takes, then renamed; an older one is replaced. Throws InputError of one
/// line, and leaves what was there.
template <class = void>
inline void write_whole(const std::string& path, std::string_view bytes) {
  // Two programs, or threads, may write the same file at once; the time and a place on the stack tell them apart.
  const std::string part = text(path, ".part-", std::chrono::steady_clock::now().time_since_epoch().count(), '-', static_cast<const void*>(&bytes));
  errno = 0;
  std::ofstream out(part, std::ios::binary);
  out.write(bytes.data(), std::streamsize(bytes.size()));
  out.close();
  std::error_code error;
  if (!out) error = {errno != 0 ? errno : EIO, std::generic_category()};
  else std::filesystem::rename(part, path, error);
  if (out && !error) return;
  const std::string why = error.message();
  std::filesystem::remove(part, error);
  throw InputError(text(path, ": cannot be written: ", why));
}

}  // namespace lumo::detail
