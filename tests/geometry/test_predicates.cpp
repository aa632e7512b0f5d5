#include "lumo/geometry/predicates.hpp"

#include "catch.hpp"

#include <cmath>
#include <cstdint>
#include <random>

using lumo::orient2d;
using lumo::orient3d;
using lumo::Point2;
using lumo::Vec3d;

namespace {

__extension__ using Wide = __int128;

int sign(Wide value) { return value > 0 ? 1 : value < 0 ? -1 : 0; }

/// Exact orientation of points with integer coordinates below 2^38.
int integer_orient3d(const Vec3d (&p)[4]) {
  Wide m[3][3];
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) m[i][k] = static_cast<Wide>(p[i + 1][k]) - static_cast<Wide>(p[0][k]);
  Wide det = 0;
  for (int i = 0; i < 3; ++i)
    det += m[2][i] * (m[0][(i + 1) % 3] * m[1][(i + 2) % 3] - m[0][(i + 2) % 3] * m[1][(i + 1) % 3]);
  return sign(det);
}

}  // namespace

TEST_CASE("orient3d has the sign of the volume", "[mesh][predicates]") {
  const Vec3d o(0, 0, 0), x(1, 0, 0), y(0, 1, 0), z(0, 0, 1);
  CHECK(orient3d(o, x, y, z) == 1);
  CHECK(orient3d(o, y, x, z) == -1);
  CHECK(orient3d(o, x, y, Vec3d(0.3, 0.4, 0.0)) == 0);
  CHECK(orient2d(Point2{0, 0}, Point2{1, 0}, Point2{0, 1}) == 1);
  CHECK(orient2d(Point2{0, 0}, Point2{0, 1}, Point2{1, 0}) == -1);
  CHECK(orient2d(Point2{0, 0}, Point2{1, 1}, Point2{3, 3}) == 0);
}

TEST_CASE("orient3d is exact on integers, on planes and one step off them", "[mesh][predicates]") {
  std::mt19937_64 random(7);
  std::uniform_int_distribution<std::int64_t> large(-(std::int64_t{1} << 37), std::int64_t{1} << 37);
  std::uniform_int_distribution<std::int64_t> small(-4, 4);
  int zeros = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    Vec3d p[4];
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < 3; ++k) p[i][k] = static_cast<double>(large(random) / 16);
    // A whole-number combination of the others lies in their plane; then perhaps one unit aside.
    const auto s = static_cast<double>(small(random)), t = static_cast<double>(small(random));
    p[3] = p[0] + s * (p[1] - p[0]) + t * (p[2] - p[0]);
    if (trial % 2 == 1) p[3][trial % 3] += trial % 4 == 1 ? 1.0 : -1.0;
    const int expected = integer_orient3d(p);
    zeros += expected == 0;
    if (orient3d(p[0], p[1], p[2], p[3]) != expected) FAIL("wrong sign in trial " << trial);
  }
  CHECK(zeros >= 9000);
}

TEST_CASE("orient3d is antisymmetric and agrees with scaled and nearly flat points", "[mesh][predicates]") {
  std::mt19937_64 random(11);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  for (int trial = 0; trial < 20000; ++trial) {
    const Vec3d a(unit(random), unit(random), unit(random)), b(unit(random), unit(random), unit(random)),
        c(unit(random), unit(random), unit(random));
    Vec3d d = a + unit(random) * (b - a) + unit(random) * (c - a);  // in the plane but for rounding
    if (trial % 3 == 0) d += 1e-16 * Vec3d(unit(random), unit(random), unit(random));
    const int value = orient3d(a, b, c, d);
    const double scale = std::ldexp(1.0, trial % 61 - 30);
    const bool right = orient3d(b, c, a, d) == value && orient3d(b, a, c, d) == -value &&
                       orient3d(a, d, b, c) == value && orient3d(scale * a, scale * b, scale * c, scale * d) == value;
    if (!right) FAIL("signs disagree in trial " << trial);
  }
}

TEST_CASE("orient2d is exact on a grid of neighbouring doubles", "[mesh][predicates]") {
  // Kettner et al. 2008: the rounded determinant is wrong all over this square; the exact one is a straight line of
  // zeros.
  const Point2 q{12.0, 12.0}, r{24.0, 24.0};
  int wrong = 0;
  for (int i = 0; i < 128; ++i)
    for (int j = 0; j < 128; ++j) {
      const double step = std::ldexp(1.0, -53);
      const Point2 p{0.5 + i * step, 0.5 + j * step};
      const int expected = p[1] > p[0] ? 1 : p[1] < p[0] ? -1 : 0;  // side of the line y = x
      wrong += orient2d(q, r, p) != expected;
    }
  CHECK(wrong == 0);
}
