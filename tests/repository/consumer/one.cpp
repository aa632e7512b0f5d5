#include "every_header.hpp"

double volume();

int main() {
  double total = 0.0;
  executor().for_each(2, [&](std::size_t) { total += volume(); });
  return total > 0.0 ? 0 : 1;
}
