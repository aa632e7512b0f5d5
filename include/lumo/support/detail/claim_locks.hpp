#pragma once

// Linux: locks on numbers that the kernel frees with their owner (fcntl(2), locks of open file descriptions).

#include "lumo/core/stopwatch.hpp"
#include "lumo/support/process/process.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <cerrno>
#include <cstdint>
#include <set>
#include <string>
#include <utility>

namespace lumo::detail {

/// Numbers that workers have, as locks on the bytes of a file beside a store. A lock ends with its worker and those
/// whom it forked, in whichever container they are. The file is there while somebody has a number. Where a file system
/// has no such locks everybody gets every number.
class ClaimLocks {
 public:
  explicit ClaimLocks(std::string path) : path_(std::move(path)) {}
  ClaimLocks(ClaimLocks&&) noexcept = default;
  ClaimLocks& operator=(ClaimLocks&&) = delete;
  ~ClaimLocks() {
    if (file_.get() >= 0 && ::getpid() == owner_ && set(file_, F_WRLCK, 0, 0) && in_place()) ::unlink(path_.c_str());
  }

  /// Takes a number; false if another one has it.
  bool take(std::int64_t number) {
    for (int tries = 0; tries < 1000; ++tries) {
      if (file_.get() < 0) {
        file_ = Descriptor(::open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666));
        for (const std::int64_t mine : taken_) set(file_, F_WRLCK, mine, 1);
      }
      if (file_.get() < 0) return true;
      if (set(file_, F_WRLCK, number, 1)) {
        if (in_place()) {
          taken_.insert(number);
          return true;
        }
        file_ = Descriptor();  // whoever had the last number has removed it
        continue;
      }
      if (errno != EAGAIN && errno != EACCES) return true;
      struct flock other = range(F_WRLCK, number, 1);
      const bool known = ::fcntl(file_.get(), F_OFD_GETLK, &other) == 0 && other.l_type != F_UNLCK;
      if (known && other.l_len == 1) return false;
      pause_for(1e-3);  // somebody is about to remove the file, or just gave the number back
    }
    return false;
  }
  void give_back(std::int64_t number) {
    if (taken_.erase(number) != 0) set(file_, F_UNLCK, number, 1);
  }
  bool has(std::int64_t number) const { return taken_.contains(number); }
  /// Has anybody this number, this one included?
  bool taken(std::int64_t number) const {
    const Descriptor look(::open(path_.c_str(), O_RDONLY | O_CLOEXEC));
    struct flock other = range(F_WRLCK, number, 1);
    return look.get() >= 0 && ::fcntl(look.get(), F_OFD_GETLK, &other) == 0 && other.l_type != F_UNLCK;
  }

 private:
  static struct flock range(int kind, std::int64_t from, std::int64_t length) {
    struct flock l = {};
    l.l_type = short(kind);
    l.l_whence = SEEK_SET;
    l.l_start = from;
    l.l_len = length;  // 0: without end
    return l;
  }
  static bool set(const Descriptor& file, int kind, std::int64_t from, std::int64_t length) {
    struct flock l = range(kind, from, length);
    return ::fcntl(file.get(), F_OFD_SETLK, &l) == 0;
  }
  bool in_place() const {
    struct stat mine = {}, there = {};
    return ::fstat(file_.get(), &mine) == 0 && ::stat(path_.c_str(), &there) == 0 && mine.st_dev == there.st_dev &&
           mine.st_ino == there.st_ino;
  }

  std::string path_;
  pid_t owner_ = ::getpid();
  Descriptor file_;
  std::set<std::int64_t> taken_;
};

}  // namespace lumo::detail
