#pragma once

#include <time.h>

#include <cmath>
#include <cstdint>

// By the system's calls: <chrono> and <thread>, with their calendars and stop tokens, would add a twenty-fifth to what
// it costs to include lumo.

namespace lumo {

/// The clock on which Video4Linux2 and SocketCAN's adapter stamp (CLOCK_MONOTONIC).
inline std::int64_t steady_ns() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return std::int64_t(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
}

/// Lets others run; a signal ends it early.
inline void pause_for(double seconds) {
  const double whole = std::floor(seconds);
  const timespec span{time_t(whole), long(1e9 * (seconds - whole))};
  ::nanosleep(&span, nullptr);
}

/// Seconds by the clock since it was made.
class Stopwatch {
 public:
  double seconds() const { return 1e-9 * double(steady_ns() - start_); }

 private:
  std::int64_t start_ = steady_ns();
};

}  // namespace lumo
