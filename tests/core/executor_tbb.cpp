#include "core/executor_laws.hpp"

#include "lumo/support/tbb.hpp"

#include <chrono>
#include <mutex>
#include <set>
#include <thread>
#include <vector>

TEST_CASE("TbbExecutor obeys the laws of an executor") {
  for (const int threads : {1, 2, 8}) {
    INFO("threads " << threads);
    check_executor_laws(lumo::TbbExecutor{threads});
  }
  check_executor_laws(lumo::TbbExecutor{});
}

TEST_CASE("TbbExecutor uses no more threads than it may") {
  std::set<std::thread::id> seen;
  std::mutex mutex;
  lumo::TbbExecutor{1}.for_each(1000, [&](std::size_t) {
    const std::lock_guard lock(mutex);
    seen.insert(std::this_thread::get_id());
  });
  CHECK(seen.size() == 1);
}

TEST_CASE("TbbExecutor begins tasks in their order, so that the first ones are never left for the end") {
  constexpr std::size_t count = 64;
  constexpr int threads = 2;
  std::mutex mutex;
  std::vector<std::size_t> begun;
  lumo::TbbExecutor{threads}.for_each(count, [&](std::size_t i) {
    {
      const std::lock_guard lock(mutex);
      begun.push_back(i);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  });
  REQUIRE(begun.size() == count);
  for (std::size_t k = 0; k < count; ++k)
    CHECK(begun[k] < k + threads);  // only a task that began at the same time may come before
}

TEST_CASE("TbbExecutor refuses absurd numbers of threads") {
  for (const int threads : {0, -1, 1025})
    CHECK_THROWS_AS(lumo::TbbExecutor{threads}.for_each(1, [](std::size_t) {}), lumo::InvalidArgument);
}
