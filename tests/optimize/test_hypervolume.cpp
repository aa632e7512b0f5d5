#include "catch.hpp"

#include "lumo/core/sobol.hpp"
#include "lumo/optimize/hypervolume.hpp"

#include <limits>

using namespace lumo;

namespace {

Eigen::MatrixXd cloud(Eigen::Index m, Eigen::Index n, std::uint64_t seed) {
  Eigen::MatrixXd y(m, n);
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index j = 0; j < m; ++j) y(j, i) = uniform(combine(combine(seed, std::uint64_t(i)), std::uint64_t(j)));
  return y;
}

Eigen::VectorXd point(std::initializer_list<double> values) {
  Eigen::VectorXd v(static_cast<Eigen::Index>(values.size()));
  std::copy(values.begin(), values.end(), v.data());
  return v;
}

double box_volume(const BoxDecomposition& boxes, const Eigen::VectorXd& ideal) {
  double total = 0.0;
  for (Eigen::Index k = 0; k < boxes.lower.cols(); ++k)
    total += (boxes.upper.col(k).cwiseMin(ideal) - boxes.lower.col(k)).cwiseMax(0.0).prod();
  return total;
}

}  // namespace

TEST_CASE("the front of a set is what nothing dominates", "[pareto]") {
  Eigen::MatrixXd y(2, 6);
  y << 1, 2, 3, 2, 1, 3, 3, 2, 1, 1, 1, 1;
  CHECK(pareto_front(y) == std::vector<Eigen::Index>{2, 5, 1, 0});  // equal points all stay
  for (int m : {1, 2, 3, 5}) {
    const Eigen::MatrixXd z = cloud(m, 60, std::uint64_t(m));
    const auto front = pareto_front(z);
    for (Eigen::Index i = 0; i < 60; ++i) {
      bool dominated = false;
      for (Eigen::Index k = 0; k < 60; ++k) dominated = dominated || dominates(z.col(k), z.col(i));
      CHECK(dominated == (std::find(front.begin(), front.end(), i) == front.end()));
    }
  }
}

TEST_CASE("hypervolume of staircases and boxes", "[hypervolume]") {
  Eigen::MatrixXd y(2, 3);
  y << 1, 2, 3, 3, 2, 1;
  CHECK(hypervolume(y, Eigen::VectorXd::Zero(2)) == 6.0);
  CHECK(hypervolume(y, point({3.0, 3.0})) == 0.0);
  CHECK(hypervolume(Eigen::MatrixXd(2, 0), Eigen::VectorXd::Zero(2)) == 0.0);
  CHECK(hypervolume(point({1.0, 2.0, 3.0}), Eigen::VectorXd::Zero(3)) == 6.0);
  CHECK(hypervolume(point({1.0, 2.0, 3.0}), point({0.0, 0.0, 4.0})) == 0.0);
  Eigen::MatrixXd z(3, 2);
  z << 2, 1, 1, 2, 1, 1;
  CHECK(hypervolume(z, Eigen::VectorXd::Zero(3)) == 3.0);
  CHECK_THROWS_AS(hypervolume(y, Eigen::VectorXd::Zero(3)), InvalidArgument);
}

TEST_CASE("boxes and the dominated part fill the space between reference and ideal", "[hypervolume]") {
  for (int m : {1, 2, 3, 4})
    for (std::uint64_t seed = 0; seed < 5; ++seed) {
      const Eigen::MatrixXd y = cloud(m, 12, seed);
      const Eigen::VectorXd reference = Eigen::VectorXd::Constant(m, 0.1), ideal = Eigen::VectorXd::Ones(m);
      const auto boxes = nondominated_boxes(y, reference);
      CHECK(box_volume(boxes, ideal) + hypervolume(y, reference) == Approx(std::pow(0.9, m)).epsilon(1e-12));
      if (m == 2)
        CHECK(nondominated_boxes(y, Eigen::VectorXd::Zero(m)).lower.cols() == Eigen::Index(pareto_front(y).size()) + 1);
    }
}

TEST_CASE("expected improvement in closed form is what sampling gives", "[expected hypervolume]") {
  for (int m : {1, 2, 3}) {
    const Eigen::MatrixXd y = cloud(m, 8, 3);
    const Eigen::VectorXd reference = Eigen::VectorXd::Zero(m), mean = Eigen::VectorXd::Constant(m, 0.7),
                          deviation = Eigen::VectorXd::LinSpaced(m, 0.2, 0.3);
    const ExpectedHypervolume exact(y, reference);
    double sum = 0.0;
    const int n = 4096;
    for (int i = 0; i < n; ++i) {
      Eigen::MatrixXd more(m, 9);
      more.leftCols(8) = y;
      for (int j = 0; j < m; ++j)
        more(j, 8) = mean[j] + deviation[j] * normal_quantile(OwenSobol{7}(std::uint32_t(i), j));
      sum += hypervolume(more, reference) - hypervolume(y, reference);
    }
    CHECK(exact.value(mean, deviation) == Approx(sum / n).epsilon(0.01));
    CHECK(exact.log_value(mean, deviation) == Approx(std::log(exact.value(mean, deviation))).epsilon(1e-12));
  }
}

TEST_CASE("expected improvement holds in deep tails", "[expected hypervolume]") {
  Eigen::MatrixXd y(2, 3);
  y << 1, 2, 3, 3, 2, 1;
  const ExpectedHypervolume exact(y, Eigen::VectorXd::Zero(2));
  const auto log_value = [&](double mean, double deviation) {
    return exact.log_value(Eigen::VectorXd::Constant(2, mean), Eigen::VectorXd::Constant(2, deviation));
  };
  CHECK(std::exp(log_value(-2.0, 0.5)) == Approx(5.9e-27).epsilon(0.01));
  CHECK(log_value(1.0, 0.3) == Approx(-11.73).margin(0.01));
  double before = -std::numeric_limits<double>::infinity();
  for (double mean = -1e4; mean < 5.0;
       mean += mean < -60.0 ? 100.0 : 0.25) {  // finite and increasing through every change of formula
    const double value = log_value(mean, 0.5);
    CHECK(std::isfinite(value));
    CHECK(value > before);
    before = value;
  }
  CHECK(log_value(10.0, 1e-9) == Approx(std::log(100.0 - 6.0)).epsilon(1e-9));
}

TEST_CASE("near-duplicates on the front cost no accuracy", "[expected hypervolume]") {
  Eigen::MatrixXd y(2, 3), thin(2, 5);
  y << 1, 2, 3, 3, 2, 1;
  thin << 1, 2, 3, 2 + 1e-13, 3 + 1e-14, 3, 2, 1, 2 - 1e-13, 1 - 1e-13;
  for (const double mean : {-3.0, 0.0, 1.5, 4.0}) {
    const Eigen::VectorXd at = point({mean, mean + 0.3}), deviation = point({0.4, 0.6});
    CHECK(ExpectedHypervolume(thin, Eigen::VectorXd::Zero(2)).log_value(at, deviation) ==
          Approx(ExpectedHypervolume(y, Eigen::VectorXd::Zero(2)).log_value(at, deviation)).epsilon(1e-9));
  }
}

TEST_CASE("normal functions hold in their tails", "[normal]") {
  for (const double p : {1e-300, 1e-20, 1e-5, 0.3, 0.5, 0.7, 0.99999})
    CHECK(normal_probability(normal_quantile(p)) == Approx(p).epsilon(1e-12));
  CHECK(normal_quantile(0.25) == -normal_quantile(0.75));
  for (double a = -30.0; a < 5.0; a += 0.125)
    CHECK(log_expected_excess(a) == Approx(std::log(expected_excess(a))).epsilon(1e-12));
  CHECK(expected_excess(-8.0) == Approx(expected_excess(std::nextafter(-8.0, 0.0))).epsilon(1e-12));
  // Asymptotically φ(a)/a² (1 − 3/a² + 15/a⁴).
  CHECK(log_expected_excess(-1000.0) ==
        Approx(-500000.0 - 0.5 * std::log(2 * pi) - 2 * std::log(1000.0) + std::log1p(-3e-6)).epsilon(1e-14));
}
