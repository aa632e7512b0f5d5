#include "lumo/support/tbb.hpp"

#include "version.hpp"

#include <atomic>

int main() {
  std::atomic<std::size_t> sum = 0;
  lumo::TbbExecutor{2}.for_each(10, [&](std::size_t i) { sum += i; });
  return sum == 45 && is_wanted_version() ? 0 : 1;
}
