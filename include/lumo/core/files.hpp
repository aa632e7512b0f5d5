#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/stopwatch.hpp"

#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>

namespace lumo {

/// Bytes of a regular file; nullopt for anything else.
inline std::optional<std::uintmax_t> file_size(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return std::nullopt;
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  return error ? std::nullopt : std::optional(size);
}

/// All bytes of a regular file; nullopt if there is none, it cannot be read, or it has more than `most` bytes. (A pipe
/// would wait, a folder reads as empty.)
inline std::optional<std::string> read_whole(const std::string& path, std::uintmax_t most = std::uintmax_t{1} << 29) {
  const auto size = file_size(path);
  if (!size || *size > most) return std::nullopt;
  std::ifstream in(path, std::ios::binary);
  if (!in) return std::nullopt;
  std::string bytes(std::size_t(*size), '\0');
  in.read(bytes.data(), std::streamsize(bytes.size()));
  if (in.bad()) return std::nullopt;
  bytes.resize(std::size_t(in.gcount()));
  return bytes;
}

/// The whole file or none: written beside its place under a name that no other writer takes, then renamed; an older one
/// is replaced. Throws InputError of one line, and leaves what was there.
inline void write_whole(const std::string& path, std::string_view bytes) {
  // Two programs, or threads, may write the same file at once: the time and a place on the stack make names unique.
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
