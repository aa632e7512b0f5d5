#include "catch.hpp"
#include "lumo/core/units.hpp"
#include "lumo/mechanics/elements/linear_solver.hpp"
#include "lumo/support/cholmod.hpp"
#include "lumo/support/mixed_cholesky.hpp"

#include <cmath>
#include <random>

using namespace lumo;

namespace {

SparseLower laplacian(int n, double diagonal) {
  std::vector<Eigen::Triplet<double>> t;
  for (int i = 0; i < n; ++i) {
    t.emplace_back(i, i, diagonal);
    if (i + 1 < n) t.emplace_back(i + 1, i, -1.0);
    if (i + 17 < n) t.emplace_back(i + 17, i, -1.0);
  }
  SparseLower m(n, n);
  m.setFromTriplets(t.begin(), t.end());
  return m;
}

}  // namespace

static_assert(!LinearSolver<int>);

TEMPLATE_TEST_CASE("direct solvers obey the laws of a linear solver", "", EigenCholesky, Cholmod, MixedCholesky) {
  const int n = 500;
  const SparseLower a = laplacian(n, 4.1);
  TestType solver;
  solver.analyze(a);
  REQUIRE(solver.factorize(a) == FactorStatus::positive_definite);
  std::mt19937 random(2);
  std::uniform_real_distribution<double> u(-1, 1);
  const Eigen::VectorXd b = Eigen::VectorXd::NullaryExpr(n, [&] { return u(random); });
  const Eigen::VectorXd x = solver.solve(b);
  CHECK((a.selfadjointView<Eigen::Lower>() * x - b).norm() < (RefiningSolver<TestType> ? 1e-10 : 1e-12) * b.norm());

  TestType copy = solver;  // carries the analysis along
  REQUIRE(copy.factorize(a) == FactorStatus::positive_definite);
  const Eigen::VectorXd y = copy.solve(b);
  CHECK((x - y).norm() == 0.0);
  copy = solver;
  REQUIRE(copy.factorize(a) == FactorStatus::positive_definite);

  CHECK(solver.factorize(laplacian(n, 1.0)) == FactorStatus::not_positive_definite);
  CHECK(solver.factorize(laplacian(n, -4.1)) == FactorStatus::not_positive_definite);
  for (double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    SparseLower poisoned = a;
    poisoned.valuePtr()[n / 2] = bad;
    CHECK(solver.factorize(poisoned) == FactorStatus::non_finite);
  }
  CHECK(solver.factorize(a) == FactorStatus::positive_definite);
  CHECK((solver.solve(b) - x).norm() == 0.0);
}

namespace {

/// Second differences on a cube of n³ points, plus `shift` times the identity.
SparseLower cube(int n, double shift) {
  std::vector<Eigen::Triplet<double>> t;
  const auto id = [n](int i, int j, int k) { return i + n * (j + n * k); };
  for (int k = 0; k < n; ++k)
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) {
        t.emplace_back(id(i, j, k), id(i, j, k), 6.0 + shift);
        if (i + 1 < n) t.emplace_back(id(i + 1, j, k), id(i, j, k), -1.0);
        if (j + 1 < n) t.emplace_back(id(i, j + 1, k), id(i, j, k), -1.0);
        if (k + 1 < n) t.emplace_back(id(i, j, k + 1), id(i, j, k), -1.0);
      }
  SparseLower m(n * n * n, n * n * n);
  m.setFromTriplets(t.begin(), t.end());
  return m;
}

double least_eigenvalue(int n) { return 6.0 - 6.0 * std::cos(pi / (n + 1)); }

}  // namespace

TEST_CASE("a factor in single precision, refined, solves as one in double does") {
  const SparseLower a = cube(17, 0.0);
  Cholmod exact;
  MixedCholesky mixed;
  exact.analyze(a);
  mixed.analyze(a);
  REQUIRE(exact.factorize(a) == FactorStatus::positive_definite);
  REQUIRE(mixed.factorize(a) == FactorStatus::positive_definite);
  CHECK(mixed.is_single());
  CHECK(mixed.certify() == FactorStatus::positive_definite);
  CHECK(mixed.is_single());
  std::mt19937 random(3);
  std::uniform_real_distribution<double> u(-1, 1);
  const Eigen::VectorXd b = 1e-30 * Eigen::VectorXd::NullaryExpr(a.cols(), [&] { return u(random); });
  const Eigen::VectorXd x = exact.solve(b);
  CHECK((mixed.solve(b) - x).norm() < 1e-9 * x.norm());
  CHECK((mixed.precondition(b) - x).norm() < 1e-4 * x.norm());
  CHECK(mixed.solve(Eigen::VectorXd::Zero(a.cols())).isZero(0.0));
}

TEST_CASE("positive definiteness is certified by more than a factor in single precision") {
  const int n = 17;
  for (const double side : {1.0, -1.0}) {
    // The least eigenvalue is ± 1e-9 of the largest, which single precision cannot tell from 0.
    const SparseLower a = cube(n, -least_eigenvalue(n) + side * 1.2e-8);
    Cholmod exact;
    exact.analyze(a);
    const FactorStatus truth = exact.factorize(a);
    REQUIRE(truth == (side > 0.0 ? FactorStatus::positive_definite : FactorStatus::not_positive_definite));
    MixedCholesky mixed;
    mixed.analyze(a);
    FactorStatus status = mixed.factorize(a);
    if (status == FactorStatus::positive_definite) status = mixed.certify();
    CHECK(status == truth);
    if (truth != FactorStatus::positive_definite) continue;
    const Eigen::VectorXd b = Eigen::VectorXd::Ones(a.cols());
    CHECK((a.selfadjointView<Eigen::Lower>() * Eigen::VectorXd(mixed.solve(b)) - b).norm() < 1e-5 * b.norm());
  }
  // Clearly indefinite, by one direction out of 4913.
  for (const double shift : {-1.02, -1.5, -3.0}) {
    const SparseLower a = cube(n, shift * least_eigenvalue(n));
    MixedCholesky mixed;
    mixed.analyze(a);
    FactorStatus status = mixed.factorize(a);
    if (status == FactorStatus::positive_definite) status = mixed.certify();
    CHECK(status == FactorStatus::not_positive_definite);
  }
}
