#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <ios>
#include <optional>
#include <string>
#include <system_error>

namespace lumo::detail {

/// All bytes of a regular file; nothing where there is none, it cannot be read, or has more than `most` bytes. (A pipe would wait, a folder reads as empty.)
template <class = void>
inline std::optional<std::string> read_whole(const std::filesystem::path& path, std::uintmax_t most = std::uintmax_t{1} << 29) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return std::nullopt;
  const auto size = std::filesystem::file_size(path, error);
  std::ifstream in(path, std::ios::binary);
  if (error || !in || size > most) return std::nullopt;
  std::string bytes(std::size_t(size), '\0');
  in.read(bytes.data(), std::streamsize(bytes.size()));
  if (in.bad()) return std::nullopt;
  bytes.resize(std::size_t(in.gcount()));
  return bytes;
}

}  // namespace lumo::detail
