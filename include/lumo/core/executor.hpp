#pragma once

#include "lumo/core/error.hpp"

#include <algorithm>
#include <atomic>
#include <concepts>
#include <cstddef>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace lumo {

/// Runs `task(i)` for every i in [0, count), in any order and on any thread, and returns when all are done.
/// Law: each i exactly once; an exception thrown by a task is rethrown to the caller after the others have stopped.
/// Tasks write to disjoint places, so that results do not depend on the number of threads.
template <class E>
concept Executor = requires(const E& executor, std::size_t count) {
  executor.for_each(count, [](std::size_t) {});
};

/// Everything on the calling thread, in order.
struct Serial {
  template <std::invocable<std::size_t> Task> void for_each(std::size_t count, Task&& task) const {
    for (std::size_t i = 0; i < count; ++i) task(i);
  }
};

/// Tasks on the calling thread and up to `threads` − 1 new ones, begun in the order of their indices. After an
/// exception no task begins; of several exceptions that of the lowest index is rethrown, as by Serial.
struct Threads {
  int threads = int(std::max(1u, std::thread::hardware_concurrency()));

  /// Throws InvalidArgument unless 1 ≤ threads ≤ 1024, std::system_error when a thread cannot be started.
  template <std::invocable<std::size_t> Task> void for_each(std::size_t count, Task&& task) const {
    if (threads < 1 || threads > 1024)
      throw InvalidArgument(message("number of threads is ", threads, ", must lie in [1, 1024]"));
    std::atomic<std::size_t> next = 0, failed = count;
    std::exception_ptr failure;
    std::mutex mutex;
    const auto work = [&] {
      for (std::size_t i = 0; failed == count && (i = next++) < count;) try {
          task(i);
        } catch (...) {
          const std::lock_guard lock(mutex);
          if (i < failed) {
            failed = i;
            failure = std::current_exception();
          }
        }
    };
    {
      std::vector<std::jthread> others;
      for (std::size_t k = 1; k < std::min(std::size_t(threads), count); ++k) others.emplace_back(work);
      work();
    }  // where the others are waited for
    if (failure) std::rethrow_exception(failure);
  }
};

static_assert(Executor<Serial> && Executor<Threads>);

}  // namespace lumo
