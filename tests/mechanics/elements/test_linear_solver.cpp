#include "catch.hpp"
#include "lumo/mechanics/elements/linear_solver.hpp"
#include "lumo/support/cholmod.hpp"

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

TEMPLATE_TEST_CASE("direct solvers obey the laws of a linear solver", "", EigenCholesky, Cholmod) {
  const int n = 500;
  const SparseLower a = laplacian(n, 4.1);
  TestType solver;
  solver.analyze(a);
  REQUIRE(solver.factorize(a) == FactorStatus::positive_definite);
  std::mt19937 random(2);
  std::uniform_real_distribution<double> u(-1, 1);
  const Eigen::VectorXd b = Eigen::VectorXd::NullaryExpr(n, [&] { return u(random); });
  const Eigen::VectorXd x = solver.solve(b);
  CHECK((a.selfadjointView<Eigen::Lower>() * x - b).norm() < 1e-12 * b.norm());

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
