#include "core/executor_laws.hpp"

#include <mutex>
#include <set>
#include <string_view>
#include <thread>

TEST_CASE("Serial obeys the laws of an executor") { check_executor_laws(lumo::Serial{}); }

TEST_CASE("Threads obeys the laws of an executor") {
  for (const int threads : {1, 2, 8}) {
    INFO("threads " << threads);
    check_executor_laws(lumo::Threads{threads});
  }
  check_executor_laws(lumo::Threads{});
}

TEST_CASE("Threads uses as many threads as it may, and rethrows the exception of the lowest index") {
  for (const int threads : {1, 4}) {
    std::set<std::thread::id> seen;
    std::mutex mutex;
    lumo::Threads{threads}.for_each(1000, [&](std::size_t) {
      const std::lock_guard lock(mutex);
      seen.insert(std::this_thread::get_id());
    });
    CHECK(int(seen.size()) <= threads);
    for (int round = 0; round < 50; ++round) {
      std::size_t caught = 0;
      try {
        lumo::Threads{threads}.for_each(100, [](std::size_t i) {
          if (i >= 7) throw i;
        });
      } catch (const std::size_t i) {
        caught = i;
      }
      CHECK(caught == 7);
    }
  }
}

TEST_CASE("Threads refuses absurd numbers of threads") {
  for (const int threads : {0, -1, 1025})
    CHECK_THROWS_AS(lumo::Threads{threads}.for_each(1, [](std::size_t) {}), lumo::InvalidArgument);
}

TEST_CASE("Serial keeps the order") {
  std::vector<std::size_t> order;
  lumo::Serial{}.for_each(4, [&](std::size_t i) { order.push_back(i); });
  CHECK(order == std::vector<std::size_t>{0, 1, 2, 3});
}

static_assert(!lumo::Executor<int> && !lumo::Executor<std::string_view>);
