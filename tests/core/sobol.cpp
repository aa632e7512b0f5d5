#include "catch.hpp"

#include "lumo/core/sobol.hpp"

#include <cmath>
#include <set>
#include <vector>

using namespace lumo;

namespace {

// Every box of the partition into 2^a × 2^b boxes holds the same number of the first 2^m points.
bool stratified(const OwenSobol& s, int d1, int d2, int m, int a, int b) {
  std::vector<int> count(std::size_t(1) << (a + b));
  for (std::uint32_t i = 0; i < (1u << m); ++i) {
    const auto x = std::size_t(std::ldexp(s(i, d1), a)), y = std::size_t(std::ldexp(s(i, d2), b));
    ++count[(x << b) + y];
  }
  for (int n : count)
    if (n != 1 << (m - a - b)) return false;
  return true;
}

}  // namespace

TEST_CASE("Sobol points are stratified in every dimension, scrambled or not", "[sobol]") {
  for (int d = 0; d < Sobol::dimensions; ++d) {
    std::set<std::uint32_t> cells;
    for (std::uint32_t i = 0; i < 1024; ++i) cells.insert(Sobol::bits(i, d) >> 22);
    CHECK(cells.size() == 1024);
    CHECK(stratified(OwenSobol{std::uint64_t(d)}, d, (d + 1) % Sobol::dimensions, 10, 10, 0));
  }
}

TEST_CASE("The first two dimensions stay a (0, m, 2)-net under any scramble", "[sobol]") {
  for (std::uint64_t seed = 0; seed < 8; ++seed)
    for (int a = 0; a <= 8; ++a) CHECK(stratified(OwenSobol{seed}, 0, 1, 8, a, 8 - a));
}

TEST_CASE("Every aligned block of the sequence is a net too", "[sobol]") {
  const OwenSobol s{5};
  std::set<int> cells;
  for (std::uint32_t i = 7 * 64; i < 8 * 64; ++i) cells.insert(int(8.0 * s(i, 0)) * 8 + int(8.0 * s(i, 1)));
  CHECK(cells.size() == 64);
}

TEST_CASE("Scrambles are uniform, differ from seed to seed, and are reproducible", "[sobol]") {
  double mean = 0.0, square = 0.0;
  const int n = 4096;
  for (int seed = 0; seed < n; ++seed) {
    const double x = OwenSobol{std::uint64_t(seed)}(3, 2);
    CHECK((x > 0.0 && x < 1.0));
    mean += x / n;
    square += x * x / n;
  }
  CHECK(mean == Approx(0.5).margin(5.0 * std::sqrt(1.0 / 12.0 / n)));
  CHECK(square == Approx(1.0 / 3.0).margin(5.0 * std::sqrt(4.0 / 45.0 / n)));
  CHECK(OwenSobol{1}(17, 3) == OwenSobol{1}(17, 3));
  CHECK(OwenSobol{1}(17, 3) != OwenSobol{2}(17, 3));
}

TEST_CASE("Scrambled Sobol integrates a smooth function far better than random numbers, without bias", "[sobol]") {
  const auto f = [](double x, double y, double z, double w) { return std::exp(x * y) * std::cos(z) + w * w; };
  const double exact = 1.3179021514544038 * std::sin(1.0) + 1.0 / 3.0;
  double sum = 0.0, square = 0.0;
  const int replicates = 32, n = 1024;
  for (int r = 0; r < replicates; ++r) {
    const OwenSobol s{std::uint64_t(r)};
    double q = 0.0;
    for (std::uint32_t i = 0; i < n; ++i) q += f(s(i, 0), s(i, 1), s(i, 2), s(i, 3)) / n;
    sum += q - exact;
    square += (q - exact) * (q - exact);
  }
  const double rms = std::sqrt(square / replicates);
  CHECK(rms < 0.05 * 0.5 / std::sqrt(double(n)));  // random numbers: about 0.5/√n
  CHECK(std::abs(sum / replicates) < 5.0 * rms / std::sqrt(double(replicates)));
}
