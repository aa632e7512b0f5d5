#include "kernel.hpp"

#include "lumo/core/bytes.hpp"
#include "lumo/core/executor.hpp"
#include "lumo/support/tbb.hpp"

#include <cstdint>

using namespace lumo;
using namespace lumo::micro;

TEST_CASE("core: checksum", "[core]") {
  std::vector<std::uint8_t> bytes(1 << 16);
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = std::uint8_t(combine(1, i));
  BENCHMARK(named("crc32", message(bytes.size(), " bytes"))) { return Crc32::of(bytes); };
}

TEST_CASE("core: Sobol's sequence", "[core]") {
  const OwenSobol scrambled{9};
  BENCHMARK(named("numbers of a sequence", "4096 numbers in 4 dimensions", "Sobol")) {
    std::uint32_t sum = 0;
    for (std::uint32_t i = 0; i < 1024; ++i)
      for (int d = 0; d < 4; ++d) sum ^= Sobol::bits(i, d);
    return sum;
  };
  BENCHMARK(named("numbers of a sequence", "4096 numbers in 4 dimensions", "Sobol, Owen's scrambling")) {
    double sum = 0.0;
    for (std::uint32_t i = 0; i < 1024; ++i)
      for (int d = 0; d < 4; ++d) sum += scrambled(i, d);
    return sum;
  };
}

// What handing out tasks costs: tasks that do next to nothing.
TEST_CASE("core: executors", "[core]") {
  std::vector<double> out(1000);
  const auto task = [&](std::size_t i) { out[i] += 1.0; };
  const TbbExecutor one{1}, two{2};
  two.for_each(out.size(), task);
  REQUIRE(out[999] == 1.0);
  const auto run = [&](const auto& executor) {
    executor.for_each(out.size(), task);
    return out.data();
  };
  BENCHMARK(named("empty tasks", "1000 tasks", "Serial")) { return run(Serial{}); };
  BENCHMARK(named("empty tasks", "1000 tasks", "TbbExecutor, 1 thread")) { return run(one); };
  BENCHMARK(named("empty tasks", "1000 tasks", "TbbExecutor, 2 threads")) { return run(two); };
}
