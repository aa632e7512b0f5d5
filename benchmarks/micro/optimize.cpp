#include "kernel.hpp"

#include "lumo/model/gaussian_process.hpp"
#include "lumo/model/normal.hpp"
#include "lumo/optimize/candidate_source.hpp"
#include "lumo/optimize/hypervolume.hpp"
#include "lumo/optimize/log_nehvi.hpp"

#include <cmath>

using namespace lumo;
using namespace lumo::micro;

namespace {

constexpr int dimensions = 5;  // as many as θ has

Eigen::MatrixXd places(Eigen::Index count, std::uint64_t seed) {
  const OwenSobol u{seed};
  Eigen::MatrixXd x(dimensions, count);
  for (Eigen::Index i = 0; i < count; ++i)
    for (int d = 0; d < dimensions; ++d) x(d, i) = u(std::uint32_t(i), d);
  return x;
}

/// Two objectives that work against each other, with a little noise.
Eigen::MatrixXd objectives(const Eigen::MatrixXd& x) {
  const OwenSobol u{99};
  Eigen::MatrixXd y(2, x.cols());
  for (Eigen::Index i = 0; i < x.cols(); ++i) {
    const double r = x.col(i).squaredNorm();
    y(0, i) = std::sin(3.0 * x(0, i)) - 0.2 * r + 0.01 * u(std::uint32_t(i), 0);
    y(1, i) = std::cos(3.0 * x(0, i)) - 0.3 * std::abs(x(1, i) - 0.5) + 0.01 * u(std::uint32_t(i), 1);
  }
  return y;
}

TrainingData data(Eigen::Index count, int objective) {
  const Eigen::MatrixXd x = places(count, 17);
  return {x, objectives(x).row(objective).transpose(), Eigen::VectorXd::Zero(dimensions),
      Eigen::VectorXd::Ones(dimensions)};
}

/// Points of a front of `rows` objectives: on the positive part of a sphere.
Eigen::MatrixXd front(int rows, Eigen::Index count) {
  const OwenSobol u{23};
  Eigen::MatrixXd y(rows, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    for (int d = 0; d < rows; ++d) y(d, i) = 0.05 + u(std::uint32_t(i), d);
    y.col(i).normalize();
  }
  return y;
}

}  // namespace

TEST_CASE("optimize: Gaussian process", "[optimize]") {
  for (const Eigen::Index n : {40, 160}) {
    const TrainingData d = data(n, 0);
    const auto prior = HyperparameterPrior::for_dimension(dimensions);
    const Eigen::VectorXd standard =
        (d.y.array() - d.y.mean()) / std::sqrt((d.y.array() - d.y.mean()).square().sum() / double(n - 1));
    const MarginalLikelihood<RbfKernel> rbf(d.x, standard, {}, prior);
    const MarginalLikelihood<Matern52Kernel> matern(d.x, standard, {}, prior);
    const Hyperparameters h{Eigen::VectorXd::Constant(dimensions, 0.7), 1e-3, 0.0};
    REQUIRE(std::isfinite(rbf(h).log_likelihood));
    const std::string input = message("1 process of ", n, " observations, 5 inputs");
    BENCHMARK(named("marginal likelihood and gradient", input, "RbfKernel")) { return rbf(h).posterior_gradient; };
    BENCHMARK(named("marginal likelihood and gradient", input, "Matern52Kernel")) {
      return matern(h).posterior_gradient;
    };
    BENCHMARK(named("fit", input)) { return GaussianProcess<>::fit(d).hyperparameters().noise; };
    const auto gp = GaussianProcess<>::fit(d);
    const Eigen::MatrixXd x = places(256, 31);
    BENCHMARK(named("prediction", message("256 places, ", n, " observations"))) { return gp.predict(x).variance; };
  }
}

TEST_CASE("optimize: hypervolume", "[optimize]") {
  for (const int m : {2, 3}) {
    const Eigen::MatrixXd y = front(m, 40);
    const Eigen::VectorXd zero = Eigen::VectorXd::Zero(m);
    REQUIRE(pareto_front(y).size() == 40);
    REQUIRE(hypervolume(y, zero) > 0.3);
    const std::string input = message("1 front of 40 points, ", m, " objectives");
    BENCHMARK(named("hypervolume", input)) { return hypervolume(y, zero); };
    BENCHMARK(named("boxes of what is not dominated", input)) { return nondominated_boxes(y, zero).lower; };
  }
  const Eigen::MatrixXd many = objectives(places(512, 41));
  BENCHMARK(named("Pareto front", "512 points, 2 objectives")) { return pareto_front(many).size(); };
}

TEST_CASE("optimize: acquisition", "[optimize]") {
  const Eigen::Index n = 40;
  std::vector<GaussianProcess<RbfKernel>> models;
  for (int k : {0, 1}) models.push_back(GaussianProcess<RbfKernel>::fit(data(n, k)));
  const Eigen::MatrixXd x = places(n, 17);
  const Evidence evidence{.x = x,
      .outputs = objectives(x),
      .errors = {},
      .pending = Eigen::MatrixXd(dimensions, 0),
      .lower = Eigen::VectorXd::Zero(dimensions),
      .upper = Eigen::VectorXd::Ones(dimensions),
      .reference = Eigen::VectorXd::Constant(2, -1.0)};
  const Eigen::MatrixXd candidates = places(64, 53);
  const LogNehvi closed;
  const QLogNehvi sampled;
  const auto a = closed.prepare(models, EachOutput{}, evidence, 3);
  const auto b = sampled.prepare(models, EachOutput{}, evidence, 3);
  REQUIRE(a(candidates).array().isFinite().all());
  REQUIRE(b(candidates).array().isFinite().all());
  const std::string evidence_set = "1 set of 40 evaluated designs";
  const std::string asked = "64 candidates, 40 evaluated designs";
  BENCHMARK(named("acquisition prepared", evidence_set, "LogNehvi, 16 draws")) {
    return closed.prepare(models, EachOutput{}, evidence, 3);
  };
  BENCHMARK(named("acquisition prepared", evidence_set, "QLogNehvi, 128 draws")) {
    return sampled.prepare(models, EachOutput{}, evidence, 3);
  };
  BENCHMARK(named("acquisition value", asked, "LogNehvi, 16 draws")) { return a(candidates); };
  BENCHMARK(named("acquisition value", asked, "QLogNehvi, 128 draws")) { return b(candidates); };
}

TEST_CASE("optimize: draws", "[optimize]") {
  BENCHMARK(named("normal base samples", "5120 numbers")) { return base_normals(40, 128, 7); };
  DesignSpace space;  // the finger's lattice, and one of its sums
  space.variables = {{"a", 2.0, 29.0, 0.5, "mm"}, {"b", 1.0, 20.0, 0.5, "mm"}, {"c", 4.0, 15.0, 0.5, "mm"},
      {"d", 2.0, 15.0, 0.5, "mm"}, {"e", 0.0, 7.5, 0.5, "mm"}};
  space.constraints = {{"a + b", {1, 1, 0, 0, 0}, 4.0, 20.0, "mm"}, {"c + 2 e", {0, 0, 1, 0, 2}, 0.0, 19.5, "mm"}};
  const DesignSampler sampler(space);
  REQUIRE(sampler.fresh(256, 1, {}).size() == 256);
  BENCHMARK(named("fresh feasible designs", "256 designs, 5 variables")) { return sampler.fresh(256, 1, {}); };
}
