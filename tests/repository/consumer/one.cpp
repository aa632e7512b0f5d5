#include "every_header.hpp"
#include "lumo/support/tbb.hpp"

double volume();

int main() {
  double total = 0.0;
  lumo::TbbExecutor{1}.for_each(2, [&](std::size_t) { total += volume(); });
  return total > 0.0 ? 0 : 1;
}
