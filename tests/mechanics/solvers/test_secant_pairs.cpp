#include "catch.hpp"
#include "lumo/mechanics/solvers/quasi_static.hpp"

#include <Eigen/Cholesky>

#include <random>

using namespace lumo;

namespace {

Eigen::MatrixXd random_matrix(int rows, int columns, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> u(-1, 1);
  return Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return u(random); });
}

// A tangent, and an older one whose factor is kept.
struct Tangents {
  static constexpr int n = 40;
  Eigen::MatrixXd kept, now;
  Tangents() {
    const Eigen::MatrixXd r = random_matrix(n, n, 1), change = random_matrix(n, 6, 2);
    kept = r * r.transpose() + Eigen::MatrixXd::Identity(n, n);
    now = kept + 2.0 * change * change.transpose();
  }
  Eigen::VectorXd factor(const Eigen::VectorXd& r) const { return kept.llt().solve(r); }
};

}  // namespace

TEST_CASE(
    "secant pairs: the corrected inverse gives each step of a quadratic for its change, and stays symmetric and "
    "positive definite") {
  const Tangents t;
  const auto factor = [&](const Eigen::VectorXd& r) { return t.factor(r); };
  SecantPairs pairs;
  CHECK((pairs.solve(random_matrix(t.n, 1, 3).col(0), factor) - t.factor(random_matrix(t.n, 1, 3))).norm() ==
        0.0);  // nothing known: the factor as it is
  // Conjugate steps, which BFGS keeps all.
  std::vector<Eigen::VectorXd> steps;
  for (int k = 0; k < 5; ++k) {
    Eigen::VectorXd s = random_matrix(t.n, 1, 10 + unsigned(k));
    for (const Eigen::VectorXd& other : steps) s -= other * (other.dot(t.now * s) / other.dot(t.now * other));
    steps.push_back(s);
    pairs.add(s, t.now * s);
  }
  for (const Eigen::VectorXd& s : steps) CHECK((pairs.solve(t.now * s, factor) - s).norm() < 1e-9 * s.norm());
  Eigen::MatrixXd inverse(t.n, t.n);
  for (int j = 0; j < t.n; ++j) inverse.col(j) = pairs.solve(Eigen::VectorXd::Unit(t.n, j), factor);
  CHECK((inverse - inverse.transpose()).norm() < 1e-9 * inverse.norm());
  CHECK(Eigen::LLT<Eigen::MatrixXd>(0.5 * (inverse + inverse.transpose())).info() == Eigen::Success);
}

TEST_CASE("secant pairs: steps with a kept factor end where they crawl without them") {
  const Tangents t;
  const Eigen::VectorXd load = random_matrix(t.n, 1, 4);
  const auto steps_to_rest = [&](bool corrected) {
    SecantPairs pairs;
    Eigen::VectorXd x = Eigen::VectorXd::Zero(t.n), r = -load;
    int steps = 0;
    for (; r.norm() > 1e-10 * load.norm() && steps < 1000; ++steps) {
      const Eigen::VectorXd step =
          -pairs.solve(r, [&](const Eigen::VectorXd& q) { return Eigen::VectorXd(0.2 * t.factor(q)); });
      x += step;
      const Eigen::VectorXd next = t.now * x - load;
      if (corrected) pairs.add(step, next - r);
      r = next;
    }
    return steps;
  };
  CHECK(steps_to_rest(true) < 40);
  CHECK(steps_to_rest(false) > 3 * steps_to_rest(true));
}

TEST_CASE("secant pairs: a step along which the residual does not grow teaches nothing") {
  const Tangents t;
  const Eigen::VectorXd r = random_matrix(t.n, 1, 5), s = random_matrix(t.n, 1, 6);
  const auto factor = [&](const Eigen::VectorXd& q) { return t.factor(q); };
  SecantPairs pairs;
  pairs.add(s, -t.now * s);
  pairs.add(Eigen::VectorXd::Zero(t.n), Eigen::VectorXd::Zero(t.n));
  CHECK((pairs.solve(r, factor) - t.factor(r)).norm() == 0.0);
  pairs.add(s, t.now * s);
  CHECK((pairs.solve(r, factor) - t.factor(r)).norm() > 0.0);
  pairs.clear();
  CHECK((pairs.solve(r, factor) - t.factor(r)).norm() == 0.0);
}
