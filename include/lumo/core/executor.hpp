#pragma once

#include <concepts>
#include <cstddef>

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

static_assert(Executor<Serial>);

}  // namespace lumo
