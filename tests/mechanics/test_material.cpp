#include "lumo/mechanics/neo_hookean.hpp"
#include "material_laws.hpp"

#include <cmath>

using namespace lumo;

static_assert(!HyperelasticMaterial<int>);
static_assert(!HyperelasticMaterial<Mat3>);

TEST_CASE("a Neo-Hookean solid obeys the laws of a hyperelastic material") {
  test::check_material_laws(NeoHookean{.mu = 106.0e3, .lambda = 10.494e6});
  test::check_material_laws(NeoHookean{.mu = 98.5e3, .lambda = 9.75e6});
  test::check_material_laws(NeoHookean{.mu = 1.0e5, .lambda = 0.0});
}

TEST_CASE("a Neo-Hookean solid has the Lame constants of linear elasticity at small strain") {
  const NeoHookean m{.mu = 2.0e5, .lambda = 7.0e5};
  const Mat9 A = elasticity_tangent(m, Mat3::Identity());
  const auto c = [&](int i, int j, int k, int l) { return A(i + 3 * j, k + 3 * l); };
  CHECK(c(0, 0, 0, 0) == Approx(7.0e5 + 2 * 2.0e5));
  CHECK(c(0, 0, 1, 1) == Approx(7.0e5));
  CHECK(c(0, 1, 0, 1) == Approx(2.0e5));
  CHECK(c(0, 1, 1, 0) == Approx(2.0e5));
}

TEST_CASE("a Neo-Hookean solid resists inversion without limit") {
  const NeoHookean m;
  Mat3 F = Mat3::Identity();
  F(0, 0) = -0.1;
  CHECK(std::isinf(energy_density(m, F)));
  F(0, 0) = 0.0;
  CHECK(std::isinf(energy_density(m, F)));
  F(0, 0) = 1e-6;
  CHECK(energy_density(m, F) > 10.0 * m.mu);
}

TEST_CASE("uniaxial tension of a Neo-Hookean bar matches its closed form") {
  // Incompressible limit: P = mu (stretch - 1/stretch^2). The transverse stretch follows from zero lateral stress.
  for (double ratio : {99.0, 1e4}) {
    const NeoHookean m{.mu = 1e5, .lambda = ratio * 1e5};
    for (double stretch : {0.7, 1.3, 2.0}) {
      double low = 0.3, high = 3.0;
      for (int k = 0; k < 200; ++k) {
        const double t = 0.5 * (low + high);
        const Mat3 P = first_piola(m, Mat3(Vec3(stretch, t, t).asDiagonal()));
        (P(1, 1) > 0.0 ? high : low) = t;
      }
      const double P = first_piola(m, Mat3(Vec3(stretch, low, low).asDiagonal()))(0, 0);
      CHECK(P == Approx(m.mu * (stretch - 1.0 / (stretch * stretch))).epsilon(1.5 / ratio));
    }
  }
}

TEST_CASE("material parameters out of range are refused in one line") {
  CHECK_THROWS_WITH(validate(NeoHookean{.mu = -1.0}), Catch::Contains("shear modulus") && Catch::Contains("-1 Pa"));
  CHECK_THROWS_AS(validate(NeoHookean{.mu = std::nan("")}), InvalidArgument);
  CHECK_THROWS_AS(validate(NeoHookean{.lambda = -1.0}), InvalidArgument);
}
