#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/part.hpp"

#include <fcntl.h>
#include <unistd.h>
#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
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

/// All bytes of a file, a pipe or a device that ends. Throws InputError of one line that names file and reason, also
/// for more than `most` bytes.
inline std::string read_text(const std::string& path, std::size_t most = std::size_t{1} << 26) {
  const auto refuse = [&](const std::string& why) { throw InputError(message(path, ": cannot be read: ", why)); };
  const auto reason = [] { return std::error_code(errno != 0 ? errno : EIO, std::generic_category()).message(); };
  errno = 0;
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"), std::fclose);
  if (!file) refuse(reason());
  std::string text(std::size_t{1} << 16, '\0');
  for (std::size_t size = 0;;) {
    if (size == text.size()) text.resize(std::min(2 * size, most + 1));
    const std::size_t n = std::fread(text.data() + size, 1, text.size() - size, file.get());
    size += n;
    if (size > most) refuse(message("it has more than ", most, " bytes"));
    if (n > 0) continue;
    if (std::ferror(file.get()) != 0) refuse(reason());
    text.resize(size);
    return text;
  }
}

/// Brings a file or folder to the disk; errno says why not.
inline bool synchronise(const std::string& path) {
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) return false;
  const bool done = ::fsync(file) == 0;
  const int why = errno;
  ::close(file);
  errno = why;
  return done;
}

/// What a power failure leaves of a file that was written.
enum class Durability {
  disk,   ///< the whole of it, once the call has returned
  memory  ///< what the system had written by then: for the many pictures of a recording
};

/// The whole file or none, after a power failure, too: written beside its place as a Part, brought to the disk, then
/// renamed; an older one is replaced. Throws InputError of one line, and leaves what was there.
inline void write_whole(const std::string& path, std::string_view bytes, Durability durability = Durability::disk) {
  const bool durable = durability == Durability::disk;
  if (durable) Part::sweep(path);
  errno = 0;
  std::optional<Part> part = Part::make(path, Part::Kind::file);
  if (part && part->write(bytes) && (!durable || part->synchronise()) && part->take_name(path)) {
    if (durable) synchronise(std::filesystem::absolute(path).parent_path().string());  // the name must last as well
    return;
  }
  throw InputError(message(
      path, ": cannot be written: ", std::error_code(errno != 0 ? errno : EIO, std::generic_category()).message()));
}

}  // namespace lumo
