#include "catch.hpp"

#include "lumo/model/gaussian_process.hpp"
#include "lumo/optimize/log_nehvi.hpp"

using namespace lumo;

static_assert(CovarianceKernel<RbfKernel> && CovarianceKernel<Matern52Kernel> && !CovarianceKernel<int>);
static_assert(Acquisition<LogNehvi, std::vector<GaussianProcess<RbfKernel>>, EachOutput>);
static_assert(Acquisition<QLogNehvi, std::vector<GaussianProcess<RbfKernel>>, EachOutput>);
static_assert(Acquisition<QLogNehvi, std::vector<GaussianProcess<RbfKernel>>, MinimumOverTerms>);

namespace {

TrainingData wave(Eigen::Index n, double scale = 1.0) {
  TrainingData data{Eigen::MatrixXd(2, n), Eigen::VectorXd(n), Eigen::Vector2d(0.0, 10.0), Eigen::Vector2d(1.0, 30.0)};
  for (Eigen::Index i = 0; i < n; ++i) {
    const double a = OwenSobol{3}(std::uint32_t(i), 0), b = OwenSobol{3}(std::uint32_t(i), 1);
    data.x.col(i) << a, 10.0 + 20.0 * b;
    data.y[i] = scale * (std::sin(5.0 * a) + b * b);
  }
  return data;
}

template <class Kernel> void check_kernel(Kernel kernel) {
  const auto correlation = [&](double r2) {
    return Eigen::ArrayXXd(kernel.correlation(Eigen::ArrayXXd::Constant(1, 1, r2)))(0, 0);
  };
  CHECK(correlation(0.0) == 1.0);
  Eigen::ArrayXXd all(5, 1);  // at once as one by one
  all << 0.01, 0.5, 1.0, 4.0, 30.0;
  const Eigen::ArrayXXd values = kernel.correlation(all), slopes = kernel.slope(all, values);
  for (int k = 0; k < 5; ++k) {
    const double h = 1e-6 * all(k);
    CHECK(values(k) == Approx(correlation(all(k))).epsilon(1e-14));
    CHECK(slopes(k) == Approx((correlation(all(k) + h) - correlation(all(k) - h)) / (2 * h)).epsilon(1e-6));
    CHECK(slopes(k) < 0.0);
  }
  const TrainingData data = wave(12);
  Eigen::MatrixXd unit = data.x;
  unit.row(1) = (unit.row(1).array() - 10.0) / 20.0;
  const MarginalLikelihood<Kernel> likelihood(unit, data.y, kernel, HyperparameterPrior::for_dimension(2));
  const Hyperparameters at{Eigen::Vector2d(0.4, 0.9), 0.01, 0.0};
  const auto value = likelihood(at);
  for (int j = 0; j < 3; ++j) {  // against central differences in the logarithms
    double sides[2], priors[2];
    for (const int side : {0, 1}) {
      Hyperparameters h = at;
      (j < 2 ? h.length_scale[j] : h.noise) *= std::exp(side ? 1e-5 : -1e-5);
      sides[side] = likelihood(h, false).log_likelihood;
      priors[side] = likelihood(h, false).log_prior;
    }
    CHECK(value.gradient[j] == Approx((sides[1] - sides[0]) / 2e-5).epsilon(1e-6).margin(1e-6));
    CHECK(value.posterior_gradient[j] ==
          Approx((sides[1] - sides[0] + priors[1] - priors[0]) / 2e-5).epsilon(1e-6).margin(1e-6));
  }
}

}  // namespace

TEST_CASE("kernels and the likelihood have the slopes of finite differences", "[gaussian process]") {
  check_kernel(RbfKernel{});
  check_kernel(Matern52Kernel{});
}

TEST_CASE("with almost no noise the process passes through its data, far from it it falls back to its prior",
    "[gaussian process]") {
  const TrainingData data = wave(15);
  const GaussianProcess<> gp(data, {Eigen::Vector2d(0.3, 0.3), 1e-10, 0.0});
  const auto at = gp.predict(data.x);
  CHECK((at.mean - data.y).cwiseAbs().maxCoeff() < 1e-6);
  CHECK(at.variance.maxCoeff() < 1e-8);
  const auto far = gp.predict(Eigen::Vector2d(50.0, 20.0));
  CHECK(far.mean[0] == Approx(gp.output_mean()));
  CHECK(far.variance[0] == Approx(gp.output_scale() * gp.output_scale()));
}

TEST_CASE("leave-one-out in closed form is what leaving one out gives", "[gaussian process]") {
  const TrainingData data = wave(10);
  const Hyperparameters h{Eigen::Vector2d(0.4, 0.8), 0.02, 0.1};
  const GaussianProcess<> gp(data, h);
  const auto closed = gp.leave_one_out();
  for (Eigen::Index i = 0; i < 10; ++i) {
    // The standardisation must stay that of all data: regress on standardised outputs by hand.
    Eigen::MatrixXd k(9, 9);
    Eigen::VectorXd cross(9), y(9);
    const auto correlation = [&](Eigen::Index a, Eigen::Index b) {
      const Eigen::Vector2d r =
          (gp.normalized(data.x).col(a) - gp.normalized(data.x).col(b)).cwiseQuotient(h.length_scale);
      return std::exp(-0.5 * r.squaredNorm());
    };
    for (Eigen::Index a = 0; a < 9; ++a) {
      const Eigen::Index p = a + (a >= i);
      for (Eigen::Index b = 0; b < 9; ++b) k(a, b) = correlation(p, b + (b >= i)) + (a == b ? h.noise : 0.0);
      cross[a] = correlation(p, i);
      y[a] = (data.y[p] - gp.output_mean()) / gp.output_scale() - h.mean;
    }
    const Eigen::VectorXd weight = k.ldlt().solve(cross);
    CHECK(closed.mean[i] == Approx(gp.output_mean() + gp.output_scale() * (h.mean + weight.dot(y))).epsilon(1e-9));
    CHECK(closed.variance[i] ==
          Approx(gp.output_scale() * gp.output_scale() * (1.0 + h.noise - weight.dot(cross))).epsilon(1e-9));
  }
}

TEST_CASE("joint samples have the posterior's mean and covariance", "[gaussian process]") {
  const GaussianProcess<> gp(wave(8), {Eigen::Vector2d(0.4, 0.8), 0.05, 0.0});
  Eigen::MatrixXd x(2, 3);
  x << 0.1, 0.15, 0.8, 12.0, 14.0, 25.0;
  const Eigen::Index draws = 4096;
  const auto samples = gp.sample(x, base_normals(3, draws, 1));
  REQUIRE(samples);
  const auto p = gp.predict(x);
  const Eigen::MatrixXd centred = samples->colwise() - p.mean;
  CHECK(centred.rowwise().mean().cwiseAbs().maxCoeff() < 1e-3);
  const Eigen::MatrixXd exact = gp.covariance(x, x);
  CHECK((centred * centred.transpose() / double(draws) - exact).cwiseAbs().maxCoeff() < 0.01 * exact.maxCoeff());
}

TEST_CASE("fitting finds the better of two optima, and is deterministic", "[gaussian process]") {
  // A slow wave under noise: from the prior's modes the search ends where all is signal on a short length.
  TrainingData data{Eigen::MatrixXd(1, 12), Eigen::VectorXd(12), Eigen::VectorXd::Zero(1), Eigen::VectorXd::Ones(1)};
  for (Eigen::Index i = 0; i < 12; ++i) {
    data.x(0, i) = OwenSobol{4}(std::uint32_t(i), 0);
    data.y[i] = std::sin(5.0 * data.x(0, i)) + OwenSobol{99}(std::uint32_t(i), 5) - 0.5;
  }
  const auto one = GaussianProcess<>::fit(data, {.prior = {}, .starts = 1}), many = GaussianProcess<>::fit(data),
             again = GaussianProcess<>::fit(data);
  CHECK(one.converged());
  CHECK(many.objective() > one.objective() + 0.1);
  double best = -1e300;  // on a grid over both hyper-parameters
  for (double length = 0.03; length < 3.0; length *= 1.03)
    for (double noise = 1e-4; noise < 2.0; noise *= 1.1)
      best = std::max(best, GaussianProcess<>(data, {Eigen::VectorXd::Constant(1, length), noise, 0.0}).objective());
  CHECK(many.objective() == Approx(best).margin(2e-3));
  CHECK(many.hyperparameters().length_scale == again.hyperparameters().length_scale);
  CHECK(many.hyperparameters().noise == again.hyperparameters().noise);
}

TEST_CASE("with many observations the search through a subset ends where the full search does", "[gaussian process]") {
  const TrainingData data = wave(120);
  const auto quick = GaussianProcess<>::fit(data), full = GaussianProcess<>::fit(data, {.prior = {}, .subset = 1000});
  CHECK(quick.objective() >= full.objective() - 1e-5);
}

TEST_CASE("scale and shift of the outputs do not change the fit", "[gaussian process]") {
  const auto base = GaussianProcess<>::fit(wave(14));
  const Eigen::MatrixXd x = Eigen::Vector2d(0.37, 21.0);
  for (const double scale : {1e-300, 1e-12, 1e12, 1e150}) {
    const auto scaled = GaussianProcess<>::fit(wave(14, scale));
    CHECK(scaled.predict(x).mean[0] / scale == Approx(base.predict(x).mean[0]).epsilon(1e-6));
    CHECK(scaled.hyperparameters().noise == Approx(base.hyperparameters().noise).epsilon(1e-6));
  }
}

TEST_CASE("duplicates, constant outputs, single observations and fixed inputs survive", "[gaussian process]") {
  TrainingData twice = wave(6);
  twice.x.rightCols(3) = twice.x.leftCols(3);
  CHECK(GaussianProcess<>::fit(twice).predict(twice.x).mean.allFinite());
  twice.y.tail(3) = twice.y.head(3);
  const auto exact = GaussianProcess<>::fit(twice);
  CHECK(exact.predict(twice.x).variance.allFinite());
  CHECK(exact.sample(twice.x, base_normals(6, 4, 0)).has_value());

  for (const double level : {0.0, 3.0, 1e12, -1e-12}) {
    TrainingData flat = wave(6);
    flat.y.setConstant(level);
    const auto gp = GaussianProcess<>::fit(flat);
    CHECK(gp.predict(flat.x).mean.isApproxToConstant(level, 1e-9));
    CHECK(gp.predict(flat.x).variance.allFinite());
  }
  TrainingData one = wave(1);
  CHECK(GaussianProcess<>::fit(one).predict(one.x).mean[0] == Approx(one.y[0]));
  TrainingData fixed = wave(5);
  fixed.x.row(0).setConstant(0.5);
  fixed.lower[0] = fixed.upper[0] = 0.5;
  CHECK(GaussianProcess<>::fit(fixed).predict(fixed.x).mean.allFinite());
}

TEST_CASE("jitter is as small as it can be and bounded", "[gaussian process]") {
  Eigen::MatrixXd singular = Eigen::MatrixXd::Ones(4, 4);
  const auto factor = jittered_factor(singular);
  REQUIRE(factor);
  CHECK(factor->jitter > 0.0);
  CHECK(factor->jitter <= 1e-10);
  CHECK((factor->lower * factor->lower.transpose() - singular).cwiseAbs().maxCoeff() <= 2.0 * factor->jitter);
  CHECK(jittered_factor(Eigen::MatrixXd::Identity(3, 3))->jitter == 0.0);
  singular(0, 1) = singular(1, 0) = 2.0;  // indefinite: no jitter helps
  CHECK_FALSE(jittered_factor(singular));
}

TEST_CASE("broken data are refused", "[gaussian process]") {
  TrainingData data = wave(5);
  data.y[2] = std::nan("");
  CHECK_THROWS_AS(GaussianProcess<>::fit(data), InvalidArgument);
  data = wave(5);
  data.y.conservativeResize(4);
  CHECK_THROWS_AS(GaussianProcess<>::fit(data), InvalidArgument);
  CHECK_THROWS_AS(GaussianProcess<>::fit(TrainingData{
                      Eigen::MatrixXd(2, 0), Eigen::VectorXd(0), Eigen::Vector2d::Zero(), Eigen::Vector2d::Ones()}),
      InvalidArgument);
  CHECK_THROWS_AS(GaussianProcess<>(wave(5), {Eigen::VectorXd::Ones(3), 0.1, 0.0}), InvalidArgument);
}

TEST_CASE("the bounded minimiser solves a curved valley, stops at bounds and reports", "[quasi-newton]") {
  const auto rosenbrock = [](const Eigen::VectorXd& x, Eigen::VectorXd& g) {
    const double a = x[1] - x[0] * x[0], b = 1.0 - x[0];
    g.resize(2);
    g << -400.0 * x[0] * a - 2.0 * b, 200.0 * a;
    return 100.0 * a * a + b * b;
  };
  const Eigen::VectorXd low = Eigen::Vector2d::Constant(-5.0), high = Eigen::Vector2d::Constant(5.0);
  const auto free = QuasiNewton{}.minimize(rosenbrock, Eigen::Vector2d(-1.2, 1.0), low, high);
  CHECK(free.converged);
  CHECK((free.x - Eigen::Vector2d::Ones()).norm() < 1e-3);
  const auto bound = QuasiNewton{}.minimize(rosenbrock, Eigen::Vector2d(-1.2, 1.0), low, Eigen::Vector2d(0.5, 5.0));
  CHECK(bound.x[0] == 0.5);
  CHECK(bound.x[1] == Approx(0.25).epsilon(1e-3));
  CHECK_THROWS_AS(
      QuasiNewton{}.minimize([](const Eigen::VectorXd&, Eigen::VectorXd&) { return std::nan(""); }, low, low, high),
      InvalidArgument);
}
