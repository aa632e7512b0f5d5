#pragma once

#include <sys/stat.h>

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <ios>
#include <optional>
#include <string>

namespace lumo {

/// Bytes of a regular file; nothing where there is none. By the system's call: `<filesystem>` would add a twentieth to
/// what it costs to include lumo.
inline std::optional<std::uintmax_t> file_size(const std::string& path) {
  struct stat found;
  if (::stat(path.c_str(), &found) != 0 || (found.st_mode & S_IFMT) != S_IFREG) return std::nullopt;
  return std::uintmax_t(found.st_size);
}

/// All bytes of a regular file; nothing where there is none, it cannot be read, or has more than `most` bytes. (A pipe
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

}  // namespace lumo
