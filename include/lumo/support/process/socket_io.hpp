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
#include <vector>

namespace lumo {

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
