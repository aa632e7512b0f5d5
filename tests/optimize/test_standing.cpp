#include "catch.hpp"

#include "lumo/optimize/optimizer.hpp"

#include <cmath>
#include <map>
#include <random>

using namespace lumo;

namespace {

using Quick = Optimizer<RbfKernel, LogNehvi, FreshCandidates>;

/// Two bowls of which the bottoms differ, both minimised. All there is above the reference: 1.17.
std::vector<double> two_bowls(const Design& x) {
  return {std::pow(x[0] - 0.3, 2) + std::pow(x[1] - 0.5, 2), std::pow(x[0] - 0.7, 2) + std::pow(x[1] - 0.5, 2)};
}

Problem bowls(int evaluations) {
  Problem p;
  p.space.variables = {{"a", 0.0, 1.0, 0.0, "", 0.0}, {"b", 0.0, 1.0, 0.0, "", 0.0}};
  p.objectives = {{"left", false, 0.5}, {"right", false, 0.5}};
  p.sobol = 8;
  p.evaluations = evaluations;
  return p;
}

double worth_of(const std::vector<Outcome>& standing, const std::vector<Trial>& trials) {
  Eigen::MatrixXd y(2, Eigen::Index(standing.size()));
  for (std::size_t i = 0; i < standing.size(); ++i) {
    const std::vector<double> t = two_bowls(trials[std::size_t(standing[i].id)].x);
    y.col(Eigen::Index(i)) << -t[0], -t[1];
  }
  return hypervolume(y, Eigen::Vector2d(-0.5, -0.5));
}

Quick searched(Problem p, double noise, bool reported, unsigned seed) {
  p.seed = seed;
  Quick o(std::move(p));
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal;
  while (const auto t = o.ask()) {
    std::vector<double> y = two_bowls(t->x);
    for (double& v : y) v += noise * normal(generator);
    o.tell(t->id, std::move(y), reported ? std::vector<double>{noise, noise} : std::vector<double>{});
  }
  return o;
}

TrainingData line_data(Eigen::Index n) {
  TrainingData data{Eigen::MatrixXd(1, n), Eigen::VectorXd(n), Eigen::VectorXd::Zero(1), Eigen::VectorXd::Ones(1)};
  for (Eigen::Index i = 0; i < n; ++i) {
    data.x(0, i) = double(i) / double(n - 1);
    data.y[i] = 3.0 + std::sin(5.0 * data.x(0, i)) + 0.2 * std::cos(40.0 * data.x(0, i));
  }
  return data;
}

}  // namespace

TEST_CASE("equal standard errors are to a Gaussian process as much noise of its own", "[noise]") {
  TrainingData data = line_data(14);
  const GaussianProcess<> own(data, Hyperparameters{Eigen::VectorXd::Constant(1, 0.3), 0.05, 0.1});
  data.errors = Eigen::VectorXd::Constant(14, std::sqrt(0.04) * own.output_scale());
  const GaussianProcess<> reported(data, Hyperparameters{Eigen::VectorXd::Constant(1, 0.3), 0.01, 0.1});
  const Eigen::MatrixXd x = Eigen::RowVectorXd::LinSpaced(23, 0.0, 1.0);
  CHECK((own.predict(x).mean - reported.predict(x).mean).norm() < 1e-12);
  CHECK((own.predict(x).variance - reported.predict(x).variance).norm() < 1e-12);
  data.errors[3] = -1.0;
  CHECK_THROWS_AS(GaussianProcess<>::fit(data), InvalidArgument);
}

TEST_CASE("an observation that is known badly moves a model less", "[noise]") {
  TrainingData data = line_data(9);
  data.y[4] += 5.0;
  data.errors = Eigen::VectorXd::Constant(9, 0.01);
  const double believed = GaussianProcess<>::fit(data).mean(data.x)[4];
  data.errors[4] = 50.0;
  const double doubted = GaussianProcess<>::fit(data).mean(data.x)[4];
  CHECK(std::abs(doubted - (data.y[4] - 5.0)) < 1.0);
  CHECK(believed - doubted > 1.0);
}

TEST_CASE("gradients of the likelihood with standard errors are those of differences", "[noise]") {
  const TrainingData data = line_data(11);
  Eigen::VectorXd known(11);
  for (Eigen::Index i = 0; i < 11; ++i) known[i] = 0.01 * double(i);
  const Eigen::VectorXd y = (data.y.array() - data.y.mean()).matrix();
  const MarginalLikelihood<RbfKernel> likelihood(data.x, y, {}, HyperparameterPrior::for_dimension(1), known);
  const auto at = [&](double a, double b) {
    return likelihood({Eigen::VectorXd::Constant(1, std::exp(a)), std::exp(b), 0.0}, true);
  };
  constexpr double h = 1e-5;
  const auto here = at(-1.0, -3.0);
  CHECK(here.gradient[0] ==
        Approx((at(-1.0 + h, -3.0).log_likelihood - at(-1.0 - h, -3.0).log_likelihood) / (2.0 * h)).epsilon(1e-5));
  CHECK(here.gradient[1] ==
        Approx((at(-1.0, -3.0 + h).log_likelihood - at(-1.0, -3.0 - h).log_likelihood) / (2.0 * h)).epsilon(1e-5));
}

TEST_CASE("without noise a front is of reported values, with it of means, in units of the objectives", "[noise]") {
  const Quick exact = searched(bowls(26), 0.0, false, 3);
  const Standing clear = exact.standing();
  CHECK(clear.modelled.empty());
  CHECK(clear.low == clear.high);
  for (const Outcome& o : clear.front) {
    CHECK(o.objectives == exact.trials()[std::size_t(o.id)].outputs);
    CHECK(o.deviations.empty());
  }
  CHECK(worth_of(clear.front, exact.trials()) == Approx(clear.hypervolume).epsilon(1e-12));

  const bool reported = GENERATE(false, true);
  const double noise = 0.1;
  int holds = 0;
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const Quick o = searched(bowls(36), noise, reported, seed);
    const Standing s = o.standing();
    REQUIRE(s.modelled == std::vector<std::string>{"left", "right"});
    const double worth = worth_of(s.front, o.trials());
    holds += s.low <= worth && worth <= s.high;
    for (const Outcome& one : s.front) {
      const std::vector<double> truth = two_bowls(o.trials()[std::size_t(one.id)].x);
      for (std::size_t j = 0; j < 2; ++j) {
        CHECK(std::abs(one.objectives[j] - truth[j]) < 4.0 * one.deviations[j] + 0.02);
        CHECK(one.deviations[j] < noise);  // many observations know more than one
      }
    }
  }
  CHECK(holds >= (reported ? 4 : 2));  // noise that has to be estimated, too, is taken for too little at times
}

TEST_CASE("whether there is noise may be said", "[noise]") {
  Problem p = bowls(16);
  p.noise = Noise::none;
  CHECK(searched(p, 0.1, true, 1).standing().modelled.empty());
  p.noise = Noise::present;
  CHECK(searched(p, 0.0, false, 1).standing().modelled.size() == 2);
  p.noise = Noise::none;
  p.repeats = 2;
  CHECK_THROWS_WITH(Quick(p), Catch::Contains("no noise"));
}

TEST_CASE("designs are evaluated again where that is worth more, and no more often than allowed", "[noise]") {
  Problem p = bowls(40);
  p.repeats = 3;
  const Quick o = searched(p, 0.15, true, 2);
  std::map<Design, int> times;
  for (const Trial& t : o.trials()) ++times[t.x];
  int most = 0;
  for (const auto& [x, n] : times) most = std::max(most, n);
  CHECK(most > 1);
  CHECK(most <= 3);
  DesignSet shown;
  for (const Outcome& one : o.front()) CHECK(shown.insert(o.trials()[std::size_t(one.id)].x).second);
  // Without noise there is nothing to learn from a second time.
  const Quick exact = searched(p, 0.0, false, 2);
  DesignSet all;
  for (const Trial& t : exact.trials()) CHECK(all.insert(t.x).second);
}

TEST_CASE("a design that is known exactly is not worth another evaluation, one in doubt is", "[noise]") {
  TrainingData data = line_data(8);
  data.errors = Eigen::VectorXd::Constant(8, 1e-6);
  const Hyperparameters h{Eigen::VectorXd::Constant(1, 0.1), 1e-6, 0.0};
  Evidence e;
  e.errors = data.errors.transpose();
  e.reference = Eigen::VectorXd::Constant(1, 0.0);
  const std::vector<bool> may(8, true);
  const std::vector<GaussianProcess<>> sure = {GaussianProcess<>(data, h)};
  const auto none = best_repeat(sure, e, data.x, may);
  REQUIRE(none);
  CHECK(none->worth < 1e-4);
  data.errors.setConstant(0.5);
  e.errors = data.errors.transpose();
  const std::vector<GaussianProcess<>> doubtful = {GaussianProcess<>(data, h)};
  CHECK(best_repeat(doubtful, e, data.x, may)->worth > 0.01);
  CHECK_FALSE(best_repeat(doubtful, e, data.x, std::vector<bool>(8, false)));
}

TEST_CASE("known results inform the models and the front, and are never proposed", "[known]") {
  Problem p;
  p.space.variables = {{"a", 0.0, 10.0, 0.5, "mm", 0.0}, {"b", 0.0, 1.0, 0.25, "", 0.0}};
  p.objectives = {{"cost", false, 200.0}};
  p.sobol = 2;
  p.evaluations = 8;
  const auto cost = [](const Design& x) { return std::vector<double>{std::pow(x[0] - 3.0, 2) + x[1]}; };
  const std::vector<Design> earlier = {{5.23, 0.2}, {5.0, 1.002}, {3.0, 0.0}, {3.0, 0.0}, {8.0, 0.5}, {-4.0, 0.5}};
  for (const Design& x : earlier) p.known.push_back({x, cost(x), {}});
  p.known.push_back({{30.0, 0.5}, {-50.0}, {}});  // better than all, but outside
  Quick o(p);
  CHECK(o.standing().front.size() == 2);  // the same design twice
  CHECK(o.standing().front[0].id == -3);
  CHECK(o.standing().hypervolume == Approx(200.0));
  while (const auto t = o.ask()) {
    CHECK(t->x != earlier[2]);
    CHECK(t->x != earlier[4]);
    CHECK_NOTHROW(p.space.check(t->x));
    o.tell(t->id, cost(t->x));
  }
  CHECK(o.observed() == 8);
  CHECK(o.models().front().size() == 15);
  CHECK(o.standing().hypervolume == Approx(200.0));
  p.known.back().outputs = {1.0, 2.0};
  CHECK_THROWS_WITH(Quick(p), Catch::Contains("known result") && Catch::Contains("2 values"));
  p.known.back().outputs = {std::nan("")};
  CHECK_THROWS_AS(Quick(p), InvalidArgument);
}

TEST_CASE("known results that cannot be compared inform the models, and stand in no front", "[known]") {
  Problem p = bowls(12);
  for (const double a : {0.3, 0.5, 0.7, 0.1, 0.9}) p.known.push_back({{a, 0.5}, two_bowls({a, 0.5}), {}, false});
  p.known.push_back({{0.2, 0.2}, two_bowls({0.2, 0.2}), {}});
  Quick o(p);
  CHECK(o.models().front().size() == 6);
  REQUIRE(o.front().size() == 1);
  CHECK(o.front().front().id == -6);
  while (const auto t = o.ask()) o.tell(t->id, two_bowls(t->x));
  for (const Outcome& one : o.front()) CHECK((one.id >= 0 || one.id == -6));
  // What they know is found again: nothing has to be better than they.
  Problem blank = bowls(12);
  Quick unknowing(blank);
  while (const auto t = unknowing.ask()) unknowing.tell(t->id, two_bowls(t->x));
  CHECK(o.hypervolume() > 0.98 * unknowing.hypervolume());
  CHECK(o.hypervolume() < 1.2);
}

TEST_CASE("what is believed of every design is what the front is made of", "[noise]") {
  const Quick exact = searched(bowls(20), 0.0, false, 3), noisy = searched(bowls(20), 0.1, true, 3);
  for (const Quick* o : {&exact, &noisy}) {
    const std::vector<Outcome> all = o->believed();
    REQUIRE(all.size() == 20);
    for (const Outcome& one : o->front()) {
      const Outcome& same = all[std::size_t(one.id)];
      CHECK(same.id == one.id);
      CHECK(same.objectives == one.objectives);
      REQUIRE(same.deviations.size() == one.deviations.size());
      for (std::size_t j = 0; j < one.deviations.size(); ++j)  // in closed form, and of 256 draws
        CHECK(same.deviations[j] == Approx(one.deviations[j]).epsilon(0.15));
    }
  }
  for (const Outcome& one : exact.believed()) CHECK(one.objectives == exact.trials()[std::size_t(one.id)].outputs);
}

TEST_CASE("an initial design may lie off the lattice and outside the bounds, if that was said", "[known]") {
  Problem p;
  p.space.variables = {{"a", 0.0, 10.0, 0.5, "mm", 0.0}, {"b", 0.0, 1.0, 0.0, "", 0.0}};
  p.space.constraints = {{"a + b", {1.0, 1.0}, 0.0, 9.0, ""}};
  p.objectives = {{"cost", false, 200.0}};
  p.initial = {{5.23, 0.2}, {5.0, 1.002}};
  p.sobol = 2;
  p.evaluations = 6;
  CHECK_THROWS_AS(Quick(p), InfeasibleDesign);
  p.initial_anywhere = true;
  Quick o(p);
  while (const auto t = o.ask()) {
    CHECK((t->id < 2 || p.space.contains(t->x)));
    o.tell(t->id, {t->id == 1 ? 0.0 : 1.0 + t->x[0]});
  }
  CHECK(o.trials()[0].x == p.initial[0]);
  CHECK(o.trials()[1].x == p.initial[1]);
  for (const Outcome& one : o.front()) CHECK(one.id != 1);  // the best of all, but outside
  p.initial = {{9.5, 0.2}};
  CHECK_THROWS_AS(Quick(p), InfeasibleDesign);
}

TEST_CASE("volumes by directions agree with exact ones, and so do expected improvements", "[hypervolume]") {
  std::mt19937 generator(3);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  for (Eigen::Index m = 1; m <= 5; ++m) {
    Eigen::MatrixXd y(m, 20);
    for (Eigen::Index i = 0; i < 20; ++i) {
      for (Eigen::Index j = 0; j < m; ++j) y(j, i) = std::abs(normal(generator));
      y.col(i) *= (1.0 + 0.3 * uniform(generator)) / y.col(i).norm();
    }
    const Eigen::VectorXd reference = Eigen::VectorXd::Zero(m);
    const double exact = hypervolume(y, reference);
    const HypervolumeEstimate estimate = estimated_hypervolume(y, reference);
    CHECK(std::abs(estimate.value - exact) <= 4.0 * estimate.error + 1e-12);
    CHECK(estimate.error < 0.01 * exact);
    const ExpectedHypervolume boxes(y, reference);
    const DirectedHypervolume directed(y, reference, hypervolume_directions(m, 4096, 5));
    for (int t = 0; t < 4; ++t) {
      Eigen::VectorXd mean(m), deviation(m);
      for (Eigen::Index j = 0; j < m; ++j) {
        mean[j] = 0.6 * (t - 1) + uniform(generator);
        deviation[j] = 0.05 + 0.3 * uniform(generator);
      }
      const double wanted = boxes.log_value(mean, deviation);
      // Far off, nearly all of it lies in one direction, which is hardly met.
      CHECK(std::abs(directed.log_value(mean, deviation) - wanted) < 0.02 + 0.06 * std::max(0.0, -wanted));
    }
  }
}

TEST_CASE("many objectives: designs are asked, the volume has an error, far ones are ranked", "[hypervolume]") {
  Problem p;
  for (int k = 0; k < 4; ++k) p.space.variables.push_back({message("x", k), 0.0, 1.0, 0.0, "", 0.0});
  for (int j = 0; j < 5; ++j) p.objectives.push_back({message("f", j), false, 1.5});
  p.sobol = 10;
  p.evaluations = 14;
  Quick o(p);
  while (const auto t = o.ask()) {
    std::vector<double> y;
    for (int j = 0; j < 5; ++j)
      y.push_back(std::pow(t->x[std::size_t(j % 4)] - 0.2 * j, 2) + t->x[std::size_t((j + 1) % 4)]);
    o.tell(t->id, y);
  }
  CHECK(o.observed() == 14);
  const Standing s = o.standing();
  CHECK(s.low < s.hypervolume);
  CHECK(s.high > s.hypervolume);
  const DirectedHypervolume one(
      Eigen::VectorXd::Constant(4, 1.0), Eigen::VectorXd::Zero(4), hypervolume_directions(4, 64, 1));
  const Eigen::VectorXd narrow = Eigen::VectorXd::Constant(4, 1e-3);
  CHECK(one.log_value(Eigen::VectorXd::Constant(4, -2.0), narrow) <
        one.log_value(Eigen::VectorXd::Constant(4, -1.0), narrow));
  CHECK(std::isfinite(one.log_value(Eigen::VectorXd::Constant(4, -1e6), narrow)));
}
