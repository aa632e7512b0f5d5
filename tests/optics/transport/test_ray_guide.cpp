#include "catch.hpp"
#include "lumo/core/sobol.hpp"
#include "lumo/optics/transport/ray_guide.hpp"

#include <cmath>

using namespace lumo;

namespace {

// What a density makes of evenly spread numbers: mean of f with each number's worth, and the share in a cell.
struct Found {
  double mean = 0.0, share = 0.0, smallest = 1e9;
};
template <class F> Found found(const DirectionDensity& density, std::size_t cell, F&& f) {
  const OwenSobol numbers{11};
  constexpr std::uint32_t n = 1 << 16;
  Found all;
  for (std::uint32_t i = 0; i < n; ++i) {
    const auto [u, v, d] = density(numbers(i, 0), numbers(i, 1));
    CHECK((u >= 0.0 && u <= 1.0 && v >= 0.0 && v <= 1.0));
    all.mean += f(u, v) / d / n;
    all.share += (DirectionDensity::cell(u, v) == cell ? 1.0 : 0.0) / n;
    all.smallest = std::min(all.smallest, d);
  }
  return all;
}

double smooth(double u, double v) { return u * u + std::sin(5.0 * v) * std::sqrt(1.0 - u); }
// ∫ of it over the unit square.
const double integral = 1.0 / 3.0 + (1.0 - std::cos(5.0)) / 5.0 * 2.0 / 3.0;

}  // namespace

TEST_CASE("Rays sent to where light changes are worth less: what they bring in all stays", "[guide]") {
  std::vector<double> squares(DirectionDensity::cells, 0.0);
  CHECK(found(DirectionDensity(squares), 0, smooth).mean == Approx(integral).epsilon(1e-4));
  CHECK(found(DirectionDensity(squares), 0, smooth).smallest == 1.0);
  const std::size_t grazing = DirectionDensity::cell(0.9999, 0.4);
  squares[grazing] = 3.0;
  const Found one = found(DirectionDensity(squares), grazing, smooth);
  CHECK(one.mean == Approx(integral).epsilon(1e-3));
  CHECK(one.share == Approx(0.7).margin(0.01));  // the rest goes everywhere
  CHECK(one.smallest == Approx(0.3).epsilon(0.02));
  for (std::size_t k = 0; k < squares.size(); ++k) squares[k] = double(k % 7);
  CHECK(found(DirectionDensity(squares), 0, smooth).mean == Approx(integral).epsilon(1e-3));
}

TEST_CASE("Rays go as the root of what was found, by area", "[guide]") {
  std::vector<double> squares(DirectionDensity::cells, 0.0);
  const std::size_t a = DirectionDensity::cell(0.5, 0.1), b = DirectionDensity::cell(0.5, 0.9);
  REQUIRE(a != b);
  squares[a] = 9.0;
  squares[b] = 1.0;
  const DirectionDensity density(squares);
  const double in_a = found(density, a, smooth).share, in_b = found(density, b, smooth).share;
  CHECK(in_a / in_b == Approx(3.0).epsilon(0.05));
}
