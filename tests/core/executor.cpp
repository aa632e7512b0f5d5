#include "core/executor_laws.hpp"

#include <string_view>

TEST_CASE("Serial obeys the laws of an executor") { check_executor_laws(lumo::Serial{}); }

TEST_CASE("Serial keeps the order") {
  std::vector<std::size_t> order;
  lumo::Serial{}.for_each(4, [&](std::size_t i) { order.push_back(i); });
  CHECK(order == std::vector<std::size_t>{0, 1, 2, 3});
}

static_assert(!lumo::Executor<int> && !lumo::Executor<std::string_view>);
