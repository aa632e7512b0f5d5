#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/stopwatch.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>
#include <cerrno>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

namespace lumo {

/// A file or folder that is written beside its place, as `<place>.part-…`, until it is whole. Its writer holds a lock
/// on it (flock(2)), which the kernel frees when the writer dies, in whichever container: the next one to write the
/// same removes what the dead have left.
class Part {
 public:
  enum class Kind { file, folder };

  /// A new one that no other writer has; nullopt if it cannot be made: errno says why.
  static std::optional<Part> make(const std::filesystem::path& place, Kind kind) {
    for (int tries = 0; tries < 100; ++tries) {  // one that sweep() took for a dead writer's is made again
      const std::string name = message(place.string(), ".part-", steady_ns(), '-', ::getpid());
      const int file = kind == Kind::file            ? ::open(name.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666)
                       : ::mkdir(name.c_str(), 0777) ? -1
                                                     : ::open(name.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
      if (file < 0 && errno == EEXIST) continue;
      if (file < 0) return std::nullopt;
      // Where a file system has no locks nothing is swept; where sweep() has this one's, it is about to be removed.
      const bool is_swept = ::flock(file, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
      struct stat mine = {}, there = {};
      if (!is_swept && ::fstat(file, &mine) == 0 && ::stat(name.c_str(), &there) == 0 && mine.st_ino == there.st_ino)
        return Part(name, file);
      ::close(file);
    }
    errno = EEXIST;
    return std::nullopt;
  }
  /// Removes what dead writers have left at this place.
  static void sweep(const std::filesystem::path& place) {
    namespace fs = std::filesystem;
    const std::string begin = place.filename().string() + ".part-";
    std::error_code error;
    const fs::path folder = place.has_parent_path() ? place.parent_path() : fs::path(".");
    for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
      const std::string name = at->path().filename().string();
      if (!name.starts_with(begin) || name.find_first_not_of("0123456789abcdefx-", begin.size()) != std::string::npos)
        continue;
      const int left = ::open(at->path().c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
      if (left < 0) continue;
      std::error_code none;
      if (::flock(left, LOCK_EX | LOCK_NB) == 0) fs::remove_all(at->path(), none);
      ::close(left);
    }
  }

  Part(Part&& other) noexcept : path_(std::move(other.path_)), file_(std::exchange(other.file_, -1)) {}
  Part& operator=(Part&& other) noexcept {
    std::swap(path_, other.path_);
    std::swap(file_, other.file_);
    return *this;
  }
  /// Removes it, unless it has its name.
  ~Part() {
    std::error_code none;
    if (file_ >= 0 && !path_.empty()) std::filesystem::remove_all(path_, none);
    if (file_ >= 0) ::close(file_);
  }

  const std::filesystem::path& path() const { return path_; }
  /// Writes at the end of a file; errno says why not.
  bool write(std::string_view bytes) const {
    while (!bytes.empty()) {
      const ::ssize_t n = ::write(file_, bytes.data(), bytes.size());
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) return false;
      bytes.remove_prefix(std::size_t(n));
    }
    return true;
  }
  /// Brings it to the disk, but not what is in a folder; errno says why not.
  bool synchronise() const { return ::fsync(file_) == 0; }
  /// Gives it its name; what had it is replaced. errno says why not.
  bool take_name(const std::filesystem::path& name) {
    if (::rename(path_.c_str(), name.c_str()) != 0) return false;
    path_.clear();
    return true;
  }

 private:
  Part(std::string path, int file) : path_(std::move(path)), file_(file) {}

  std::filesystem::path path_;
  int file_ = -1;
};

}  // namespace lumo
