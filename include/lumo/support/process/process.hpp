// Linux: who am I, and does that process still live? (proc(5))
#pragma once

#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/types.h>
#include <unistd.h>
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

namespace lumo {

namespace detail {

inline std::string first_line(const std::string& file) {
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  return line;
}

// Start time of a process in clock ticks after boot; empty when there is none, or only its remains.
inline std::string process_start(const std::string& pid) {
  const std::string line = first_line("/proc/" + pid + "/stat");
  const std::size_t name_end = line.rfind(')');  // the name in parentheses may hold anything
  if (name_end == std::string::npos || name_end + 2 >= line.size() || line[name_end + 2] == 'Z') return "";
  std::size_t at = name_end + 1;
  for (int field = 2; field < 21; ++field) at = line.find(' ', at + 1);
  return at == std::string::npos ? "" : line.substr(at + 1, line.find(' ', at + 1) - at - 1);
}

}  // namespace detail

/// Names this process for as long as the machine is not started again: boot, number, start time.
inline std::string process_token() {
  const std::string pid = std::to_string(getpid());
  return detail::first_line("/proc/sys/kernel/random/boot_id") + ' ' + pid + ' ' + detail::process_start(pid);
}

/// Does the process of this token live, on this machine? Those of another machine, or from before it was started again,
/// count as dead.
inline bool process_lives(const std::string& token) {
  const std::size_t a = token.find(' '), b = token.rfind(' ');
  if (a == std::string::npos || a == b) return false;
  const std::string start = detail::process_start(token.substr(a + 1, b - a - 1));
  return token.substr(0, a) == detail::first_line("/proc/sys/kernel/random/boot_id") && !start.empty() &&
         start == token.substr(b + 1);
}

/// A file descriptor that is closed when its owner goes.
class Descriptor {
 public:
  explicit Descriptor(int fd = -1) : fd_(fd) {}
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  int get() const { return fd_; }
  void do_not_block() const { ::fcntl(fd_, F_SETFL, ::fcntl(fd_, F_GETFL) | O_NONBLOCK); }

 private:
  int fd_;
};

using JobBytes = std::vector<char>;

/// A point in time after which waiting is given up.
class Deadline {
 public:
  /// `seconds` from now, at most about 30 years.
  explicit Deadline(double seconds)
      : end_(Clock::now() + std::chrono::duration_cast<Clock::duration>(
                                std::chrono::duration<double>(std::clamp(seconds, 0.0, 1e9)))) {}

  /// Milliseconds left for poll(), rounded up, 0 when over.
  int left_ms() const {
    const double ms = std::chrono::duration<double, std::milli>(end_ - Clock::now()).count();
    return static_cast<int>(std::ceil(std::clamp(ms, 0.0, 1e9)));
  }
  bool over() const { return Clock::now() >= end_; }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point end_;
};

enum class Transfer { done, closed, late };

/// Waits until `fd` is ready for `events`; hang-ups and errors count as ready, since the next call reports them.
inline Transfer wait_ready(int fd, short events, const Deadline& deadline) {
  for (;;) {
    pollfd entry{fd, events, 0};
    const int count = ::poll(&entry, 1, deadline.left_ms());
    if (count > 0) return Transfer::done;
    if (count < 0 && errno != EINTR && errno != EAGAIN) return Transfer::closed;
    if (deadline.over()) return Transfer::late;
  }
}

/// Sends all bytes over a socket. A peer that has gone is a result, not a signal.
inline Transfer send_all(int fd, const void* data, std::size_t size, const Deadline& deadline) {
  const char* from = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t count = ::send(fd, from, size, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (count > 0) {
      from += count;
      size -= static_cast<std::size_t>(count);
    } else if (count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
      if (const Transfer state = wait_ready(fd, POLLOUT, deadline); state != Transfer::done) return state;
    } else if (!(count < 0 && errno == EINTR)) {
      return Transfer::closed;
    }
  }
  return Transfer::done;
}

/// Receives exactly `size` bytes from a socket.
inline Transfer receive_all(int fd, void* data, std::size_t size, const Deadline& deadline) {
  char* to = static_cast<char*>(data);
  while (size > 0) {
    const ssize_t count = ::recv(fd, to, size, MSG_DONTWAIT);
    if (count > 0) {
      to += count;
      size -= static_cast<std::size_t>(count);
    } else if (count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
      if (const Transfer state = wait_ready(fd, POLLIN, deadline); state != Transfer::done) return state;
    } else if (!(count < 0 && errno == EINTR)) {
      return Transfer::closed;
    }
  }
  return Transfer::done;
}

}  // namespace lumo
