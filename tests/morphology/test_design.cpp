#include "catch.hpp"
#include "lumo/morphology/design.hpp"
#include "lumo/morphology/section.hpp"

#include <array>
#include <cmath>
#include <limits>
#include <random>

using namespace lumo;

namespace {

constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();
constexpr double inf = std::numeric_limits<double>::infinity();

/// Thickness by brute force: dense samples of both lines.
bool thick_enough(const FingerDesign& d, double tolerance) {
  const double w = 14.75, inner = 0.5 * d.w_s + d.w_v;
  double vertical = inf, horizontal = inf;
  for (int k = 0; k <= 2000; ++k) {
    const double x = inner * k / 2000, z = d.h_s * k / 2000;
    vertical = std::min(vertical, d.h_fp + d.h_ep * std::sqrt(std::max(0.0, 1 - x * x / (w * w))) - d.h_s);
    const double above = std::max(0.0, z - d.h_fp) / d.h_ep;
    horizontal = std::min(horizontal, above > 1 ? -inf : w * std::sqrt(1 - above * above) - inner);
  }
  return vertical >= 5.0 - tolerance && horizontal >= 5.0 - tolerance;
}

}  // namespace

TEST_CASE("the paper's bounds, sums and thickness are decided exactly on the lattice") {
  const DesignSpace space = finger_space(plain_pad());
  for (const FingerDesign& d : plain_references()) CHECK(space.contains(d.values()));
  CHECK(space.contains(FingerDesign{10, 8, 4.5, 4, 7.5}.values()));  // a wall of exactly 5 mm
  CHECK_FALSE(space.contains(FingerDesign{10, 8, 5, 4, 7.5}.values()));
  CHECK(space.contains(FingerDesign{12, 8, 8, 5, 2}.values()));  // h_fp + h_ep = 20 exactly
  CHECK_FALSE(space.contains(FingerDesign{12, 8.5, 8, 5, 2}.values()));

  std::mt19937 random(7);
  const auto& v = space.variables;
  int feasible = 0;
  for (int k = 0; k < 5000; ++k) {
    std::array<double, 5> x;
    for (std::size_t i = 0; i < 5; ++i)
      x[i] = 0.5 * double(std::uniform_int_distribution<int>(int(2 * v[i].lower), int(2 * v[i].upper))(random));
    const FingerDesign d = FingerDesign::from(x);
    const bool sums = d.h_fp + d.h_ep <= 20 && d.w_s + 2 * d.w_v <= 19.5;
    const bool decided = space.contains(x);
    if (decided) ++feasible;
    if (!sums) {
      CHECK_FALSE(decided);
      continue;
    }
    // Away from the limit the sampled answer is the same; at it, exactness decides.
    if (thick_enough(d, 1e-6)) CHECK((decided || !thick_enough(d, -1e-6)));
    else CHECK_FALSE(decided);
  }
  CHECK(feasible > 100);
}

TEST_CASE("an infeasible design says which constraint is broken, the value and the limit") {
  const auto refusal = [](const FingerDesign& d) {
    try {
      finger_space(plain_pad()).check(d.values());
    } catch (const InfeasibleDesign& e) {
      return e;
    }
    FAIL("was accepted");
    throw;
  };
  const InfeasibleDesign sum = refusal({12, 9, 8, 5, 2});
  CHECK(sum.constraint() == "h_fp + h_ep");
  CHECK(sum.value() == 21.0);
  CHECK(sum.limit() == 20.0);
  CHECK(sum.excess() == 1.0);
  CHECK(std::string(sum.what()).find('\n') == std::string::npos);
  CHECK(refusal({1.5, 8, 8, 5, 2}).constraint() == "h_fp lower bound");
  CHECK(refusal({6.2, 8, 8, 5, 2}).constraint() == "h_fp lattice");
  CHECK(refusal({6, 8, 8, 5, 8}).constraint() == "w_v upper bound");
  CHECK(refusal({6, 8, 15, 5, 5}).constraint() == "w_s + 2 w_v");
  const InfeasibleDesign thin = refusal({4, 2, 8, 5, 0});
  CHECK(thin.constraint() == "t_min vertical");
  CHECK(thin.limit() == 5.0);
  CHECK(thin.value() == Approx(vertical_thickness({4, 2, 8, 5, 0}, plain_pad())));
  CHECK(refusal({2, 18, 15, 15, 2}).constraint() == "t_min vertical");
  CHECK(refusal({2, 16, 8, 12.5, 0}).constraint() == "t_min vertical");
  CHECK(refusal({not_a_number, 8, 8, 5, 2}).constraint() == "h_fp finite");
  CHECK(refusal({6, 8, inf, 5, 2}).constraint() == "w_s finite");
  CHECK_THROWS_AS(finger_space(plain_pad()).check(std::vector<double>{1, 2, 3}), InvalidArgument);
}

TEST_CASE("a design is on the lattice in every bit, or not on it") {
  for (double node = 0.0; node <= 29.0; node += 0.5) {
    const double above = std::nextafter(node, inf), below = std::nextafter(node, -inf);
    CHECK(FingerDesign::from(std::array{node, node, node, node, node}) == FingerDesign{node, node, node, node, node});
    if (node == 0.0) continue;  // what is next to zero is no rounding of it
    CHECK(FingerDesign::from(std::array{above, below, std::nextafter(above, inf), node, below}) ==
          FingerDesign{node, node, node, node, node});
  }
  CHECK_FALSE(std::signbit(FingerDesign::from(std::array{6.0, 6.0, 8.0, 5.0, -0.0}).w_v));
  const FingerDesign off = FingerDesign::from(std::array{6.25, 6.0 + 1e-9, 8.1, 5e-324, inf});  // taken as they are
  CHECK(off == FingerDesign{6.25, 6.0 + 1e-9, 8.1, 5e-324, inf});
  CHECK(std::isnan(FingerDesign::from(std::array{not_a_number, 6.0, 8.0, 5.0, 0.0}).h_fp));
}

TEST_CASE("a side wall that is too thin above the flat sides is refused") {
  bool found = false;
  for (double fp = 2; fp <= 10 && !found; fp += 0.5)
    for (double hs = fp + 0.5; hs <= 15 && !found; hs += 0.5) {
      const FingerDesign d{fp, 20 - fp, 15, hs, 2};
      if (vertical_thickness(d, plain_pad()) < 5.0 || horizontal_thickness(d, plain_pad()) >= 5.0) continue;
      found = true;
      CHECK_THROWS_WITH(finger_space(plain_pad()).check(d.values()),
          Catch::Contains("t_min (horizontal)") && Catch::Contains("5 mm"));
    }
  CHECK(found);
}

TEST_CASE("a design space has any dimension") {
  DesignSpace space;
  space.variables = {{"a", 0, 1, 0, ""}, {"b", -1, 1, 0.25, ""}};
  space.constraints = {{"a - b", {1, -1}, -0.5, 0.5, ""}};
  CHECK(space.contains(std::vector{0.3, 0.25}));
  CHECK_FALSE(space.contains(std::vector{0.3, 0.3}));
  CHECK_FALSE(space.contains(std::vector{0.9, 0.0}));
  CHECK_FALSE(space.contains(std::vector{0.0, 0.75}));
}

TEST_CASE("the section's polygon has the section's area and closes in the right sense") {
  for (Twin twin : {Twin::none, Twin::no_void, Twin::bonded_base, Twin::unsupported_base})
    for (const FingerDesign& d : plain_references()) {
      const HalfSection s = half_section(d, twin, {0.2e-3, 0.05}, plain_pad());
      double area = 0.0;
      for (std::size_t k = 0; k < s.x.size(); ++k) {
        const std::size_t n = (k + 1) % s.x.size();
        area += 0.5 * (s.x[k] * s.z[n] - s.x[n] * s.z[k]);
      }
      CHECK(area == Approx(s.exact_area_m2()).epsilon(1e-3));
      const double by_hand = 14.75 * d.h_fp + pi / 4 * 14.75 * d.h_ep -
                             ((twin == Twin::bonded_base || twin == Twin::unsupported_base ? 0.0 : 0.5 * d.w_s) +
                                 (twin == Twin::no_void ? 0.0 : d.w_v)) *
                                 d.h_s;
      CHECK(s.exact_area_m2() == Approx(by_hand * 1e-6).epsilon(1e-12));
    }
}
