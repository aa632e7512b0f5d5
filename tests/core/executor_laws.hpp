#pragma once

#include "catch.hpp"

#include "lumo/core/executor.hpp"

#include <atomic>
#include <stdexcept>
#include <string>
#include <vector>

/// The laws of an Executor; a new one gets all of them for one line.
template <lumo::Executor E> void check_executor_laws(const E& executor) {
  for (const std::size_t count : {std::size_t(0), std::size_t(1), std::size_t(7), std::size_t(10000)}) {
    std::vector<std::atomic<int>> visits(count);
    executor.for_each(count, [&](std::size_t i) { ++visits.at(i); });
    int wrong = 0;
    for (const auto& v : visits) wrong += v != 1;
    INFO("count " << count);
    CHECK(wrong == 0);
  }

  // The exception arrives, and no task runs after for_each has returned.
  std::atomic<int> running = 0, started = 0;
  struct Running {
    std::atomic<int>& n;
    explicit Running(std::atomic<int>& counter) : n(counter) { ++n; }
    ~Running() { --n; }
  };
  std::string caught;
  try {
    executor.for_each(1000, [&](std::size_t i) {
      const Running mark(running);
      ++started;
      if (i == 321) throw std::runtime_error("task 321");
    });
  } catch (const std::runtime_error& e) {
    caught = e.what();
  }
  CHECK(caught == "task 321");
  CHECK(running == 0);
  const int after = started;
  CHECK(after >= 1);

  // It can be used again, and inside itself.
  std::atomic<int> sum = 0;
  executor.for_each(8, [&](std::size_t) { executor.for_each(8, [&](std::size_t) { ++sum; }); });
  CHECK(sum == 64);
  CHECK(started == after);
}
