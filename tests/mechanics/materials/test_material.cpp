#include "lumo/mechanics/materials/mooney_rivlin.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/materials/ogden.hpp"
#include "lumo/mechanics/materials/stable_neo_hookean.hpp"
#include "lumo/mechanics/materials/yeoh.hpp"
#include "mechanics/materials/material_laws.hpp"

#include <cmath>

using namespace lumo;

static_assert(test::TakesDuals<NeoHookean> && test::TakesDuals<StableNeoHookean> && test::TakesDuals<MooneyRivlin> &&
              test::TakesDuals<Yeoh>);
static_assert(!test::TakesDuals<Ogden>);
static_assert(!HyperelasticMaterial<int>);
static_assert(!HyperelasticMaterial<Mat3d>);

TEST_CASE("a Neo-Hookean solid obeys the laws of a hyperelastic material") {
  test::check_material_laws(NeoHookean{.mu = 106.0e3, .lambda = 10.494e6});
  test::check_material_laws(NeoHookean{.mu = 98.5e3, .lambda = 9.75e6});
  test::check_material_laws(NeoHookean{.mu = 1.0e5, .lambda = 0.0});
}

TEST_CASE("every other solid obeys the same laws") {
  test::check_material_laws(StableNeoHookean{});
  test::check_material_laws(StableNeoHookean{.mu = 1.0e5, .lambda = 3.0e5});
  test::check_material_laws(MooneyRivlin{});
  test::check_material_laws(MooneyRivlin{.c10 = 0.0, .c01 = 5.0e4, .bulk = 1.0e6});
  test::check_material_laws(Yeoh{});
  test::check_material_laws(Yeoh{.c1 = 5.0e4, .c2 = 8.0e3, .c3 = 1.0e3, .bulk = 1.0e6});
  test::check_material_laws(Yeoh{.c1 = 5.0e4, .c2 = -3.0e3, .c3 = 1.0e3, .bulk = 1.0e6});
  test::check_material_laws(Ogden{});
  test::check_material_laws(
      Ogden{.terms = {{{6.3e5, 1.3}, {1.2e3, 5.0}, {-1.0e4, -2.0}}}, .bulk = 1.0e7});  // rubber: Ogden 1972
}

TEST_CASE("two solids that are one in other words agree to rounding") {
  const double c10 = 4.0e4, c01 = 1.5e4, bulk = 2.0e6;
  const MooneyRivlin mooney{c10, c01, bulk};
  const Ogden ogden{{{{2 * c10, 2.0}, {-2 * c01, -2.0}, {}}}, bulk};
  const MooneyRivlin first{c10, 0.0, bulk};
  const Yeoh yeoh{c10, 0.0, 0.0, bulk};
  std::mt19937 random(5);
  const auto same = [&](const auto& a, const auto& b, const Mat3d& F, double tolerance) {
    CHECK(energy_density(a, F) == Approx(energy_density(b, F)).epsilon(tolerance));
    CHECK((first_piola(a, F) - first_piola(b, F)).norm() < tolerance * bulk);
    CHECK((elasticity_tangent(a, F) - elasticity_tangent(b, F)).norm() < tolerance * elasticity_tangent(b, F).norm());
  };
  for (int k = 0; k < 20; ++k) {
    const Mat3d F = test::random_deformation(random, 0.4);
    same(mooney, ogden, F, 1e-11);
    same(first, yeoh, F, 1e-14);
  }
  // Equal and nearly equal stretches are no special case.
  for (double apart : {0.0, 1e-16, 1e-12, 1e-8, 1e-4}) {
    const Mat3d F = test::random_rotation(random) * Mat3d(Vec3d(1.2, 1.2 + apart, 0.8).asDiagonal()) *
                    test::random_rotation(random);
    same(mooney, ogden, F, 1e-11);
  }
}

TEST_CASE("uniaxial and equibiaxial tension match the closed forms of incompressible rubber") {
  // Nominal stresses of Treloar 1975 (invariants) and Ogden 1972 (stretches); the error is of the order of shear over
  // bulk modulus.
  const double bulk = 1e10;
  const auto check = [&](const auto& m, auto uniaxial, auto biaxial) {
    for (double stretch : {0.7, 1.3, 2.0, 3.0})
      for (bool two : {false, true}) {
        double low = 0.05, high = 3.0;
        const auto P = [&](double t) {
          return first_piola(m, Mat3d((two ? Vec3d(stretch, stretch, t) : Vec3d(stretch, t, t)).asDiagonal()));
        };
        for (int k = 0; k < 200; ++k) {
          const double t = 0.5 * (low + high);
          (P(t)(2, 2) > 0.0 ? high : low) = t;
        }
        INFO("stretch " << stretch << (two ? " biaxial" : " uniaxial"));
        CHECK(P(low)(0, 0) == Approx(two ? biaxial(stretch) : uniaxial(stretch)).epsilon(2e-3).margin(1.0));
      }
  };
  const StableNeoHookean stable{.mu = 1.0e5, .lambda = bulk};
  check(
      stable, [](double l) { return 1.0e5 * (l - 1 / (l * l)); },
      [](double l) { return 1.0e5 * (l - std::pow(l, -5)); });
  const MooneyRivlin mooney{.c10 = 4.0e4, .c01 = 1.5e4, .bulk = bulk};
  check(
      mooney, [](double l) { return 2 * (l - 1 / (l * l)) * (4.0e4 + 1.5e4 / l); },
      [](double l) { return 2 * (l - std::pow(l, -5)) * (4.0e4 + 1.5e4 * l * l); });
  const Yeoh yeoh{.c1 = 5.0e4, .c2 = 4.0e3, .c3 = 5.0e2, .bulk = bulk};
  const auto slope = [](double I) { return 5.0e4 + 2 * 4.0e3 * (I - 3) + 3 * 5.0e2 * (I - 3) * (I - 3); };
  check(
      yeoh, [&](double l) { return 2 * (l - 1 / (l * l)) * slope(l * l + 2 / l); },
      [&](double l) { return 2 * (l - std::pow(l, -5)) * slope(2 * l * l + std::pow(l, -4)); });
  const Ogden ogden{.terms = {{{6.3e5, 1.3}, {1.2e3, 5.0}, {-1.0e4, -2.0}}}, .bulk = bulk};
  const auto sum = [&](double l, double other) {
    double P = 0.0;
    for (const auto& t : ogden.terms) P += t.mu * (std::pow(l, t.alpha - 1) - std::pow(l, other * t.alpha - 1));
    return P;
  };
  check(
      ogden, [&](double l) { return sum(l, -0.5); }, [&](double l) { return sum(l, -2.0); });
}

TEST_CASE("solids with volume and shape apart have the bulk modulus that they name") {
  CHECK(MooneyRivlin{}.volumetric(1.0).stiffness == Approx(MooneyRivlin{}.bulk));
  // Hydrostatic compression: pressure = −dU/dJ of the closed form, and the distortion adds nothing.
  const Yeoh yeoh{.c1 = 5.0e4, .c2 = 1.0e4, .c3 = 0.0, .bulk = 2.0e6};
  for (double t : {0.8, 0.95, 1.1}) {
    const double J = t * t * t, cauchy = first_piola(yeoh, Mat3d(t * Mat3d::Identity()))(0, 0) / (t * t);
    CHECK(cauchy == Approx(0.5 * yeoh.bulk * (J - 1 / J)).epsilon(1e-10));
  }
}

TEST_CASE("a Neo-Hookean solid has the Lame constants of linear elasticity at small strain") {
  const NeoHookean m{.mu = 2.0e5, .lambda = 7.0e5};
  const Mat9d A = elasticity_tangent(m, Mat3d(Mat3d::Identity()));
  const auto c = [&](int i, int j, int k, int l) { return A(i + 3 * j, k + 3 * l); };
  CHECK(c(0, 0, 0, 0) == Approx(7.0e5 + 2 * 2.0e5));
  CHECK(c(0, 0, 1, 1) == Approx(7.0e5));
  CHECK(c(0, 1, 0, 1) == Approx(2.0e5));
  CHECK(c(0, 1, 1, 0) == Approx(2.0e5));
}

TEST_CASE("a Neo-Hookean solid resists inversion without limit") {
  const NeoHookean m;
  Mat3d F = Mat3d::Identity();
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
        const Mat3d P = first_piola(m, Mat3d(Vec3d(stretch, t, t).asDiagonal()));
        (P(1, 1) > 0.0 ? high : low) = t;
      }
      const double P = first_piola(m, Mat3d(Vec3d(stretch, low, low).asDiagonal()))(0, 0);
      CHECK(P == Approx(m.mu * (stretch - 1.0 / (stretch * stretch))).epsilon(1.5 / ratio));
    }
  }
}

TEST_CASE("material parameters out of range are refused in one line") {
  CHECK_THROWS_WITH(validate(NeoHookean{.mu = -1.0}), Catch::Contains("shear modulus") && Catch::Contains("-1 Pa"));
  CHECK_THROWS_AS(validate(NeoHookean{.mu = std::nan("")}), InvalidArgument);
  CHECK_THROWS_AS(validate(NeoHookean{.lambda = -1.0}), InvalidArgument);
  CHECK_THROWS_WITH(
      validate(StableNeoHookean{.lambda = -1.0}), Catch::Contains("Lame parameter lambda") && Catch::Contains("-1 Pa"));
  CHECK_THROWS_WITH(validate(MooneyRivlin{.c10 = 0.0, .c01 = 0.0}), Catch::Contains("shear modulus"));
  CHECK_THROWS_WITH(validate(Yeoh{.c2 = -1.0}),
      Catch::Contains("Yeoh c2"));  // without a third term it softens until nothing is left
  CHECK_NOTHROW(
      validate(Yeoh{.c1 = 3e4, .c2 = -2.9e3, .c3 = 100.0}));  // least slope at s = 2.9e3/300: c1 − c2²/(3 c3) = 2 kPa
  CHECK_THROWS_AS(validate(Yeoh{.c1 = 3e4, .c2 = -3.0e3, .c3 = 100.0}), InvalidArgument);
  CHECK_THROWS_AS(validate(Yeoh{.c2 = std::nan("")}), InvalidArgument);
  CHECK_THROWS_WITH(validate(Ogden{.terms = {{{1e5, -2.0}, {}, {}}}}), Catch::Contains("mu alpha"));
  CHECK_THROWS_AS(validate(Ogden{.bulk = std::nan("")}), InvalidArgument);
}
