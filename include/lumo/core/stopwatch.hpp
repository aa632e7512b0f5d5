#pragma once

#include <chrono>
#include <cstdint>
#include <thread>

namespace lumo {

/// A steady clock [ns]; under Linux the one on which Video4Linux2 and SocketCAN's adapter stamp (CLOCK_MONOTONIC).
inline std::int64_t steady_ns() {
  return std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Lets other threads run for about so long.
inline void pause_for(double seconds) { std::this_thread::sleep_for(std::chrono::duration<double>(seconds)); }

/// Seconds since it was made.
class Stopwatch {
 public:
  double seconds() const { return 1e-9 * double(steady_ns() - start_); }

 private:
  std::int64_t start_ = steady_ns();
};

}  // namespace lumo
