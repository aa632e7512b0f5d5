#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/executor.hpp"

#include <tbb/blocked_range.h>
#include <tbb/global_control.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <tbb/partitioner.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <cstddef>

namespace lumo {

/// Tasks on oneTBB's worker threads, at most `threads` at a time, begun in the order of their indices: a task is a
/// whole solve or a whole bundle of rays, so callers put the longest first and threads end together, where TBB's
/// halving of the range would leave long ones for the end. Never more threads than TBB's own limit, which is what the
/// process may use unless a tbb::global_control says otherwise.
struct TbbExecutor {
  int threads = tbb::info::default_concurrency();

  /// Throws InvalidArgument unless 1 ≤ threads ≤ 1024; rethrows the first exception of a task.
  template <std::invocable<std::size_t> Task> void for_each(std::size_t count, Task&& task) const;
};

template <std::invocable<std::size_t> Task> void TbbExecutor::for_each(std::size_t count, Task&& task) const {
  if (threads < 1 || threads > 1024)
    throw InvalidArgument(message("number of threads is ", threads, ", must lie in [1, 1024]"));
  const std::size_t limit = tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism);
  tbb::task_arena arena(int(std::min(limit, std::size_t(threads))));  // asking for more makes TBB print a warning
  std::atomic<std::size_t> next = 0;
  arena.execute([&] {
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, count, 1),
        [&](const tbb::blocked_range<std::size_t>& range) {
          for (std::size_t n = range.size(); n > 0; --n) task(next++);
        },
        tbb::simple_partitioner{});
  });
}

static_assert(Executor<TbbExecutor>);

}  // namespace lumo
