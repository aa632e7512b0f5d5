#include "catch.hpp"
#include "lumo/model/gaussian_process.hpp"
#include "lumo/model/normal.hpp"
#include "lumo/model/surrogate.hpp"
#include "lumo/optimize/acquisition.hpp"
#include "lumo/optimize/hypervolume.hpp"
#include "lumo/optimize/trials.hpp"
#include "poison.hpp"

using namespace lumo;
using test::Numbers;

namespace {

Numbers list(const Eigen::MatrixXd& m) { return Numbers(m.data(), m.data() + m.size()); }

// Documented infinities at the ends of a distribution become ±1e300.
Numbers ended(double v) { return {std::clamp(v, -1e300, 1e300)}; }

Eigen::MatrixXd taken(const Numbers& x, std::size_t from, Eigen::Index rows, Eigen::Index count) {
  return Eigen::Map<const Eigen::MatrixXd>(x.data() + from, rows, count);
}

GaussianProcess<> process() {
  Eigen::MatrixXd x(1, 4);
  x << 0.0, 0.3, 0.7, 1.0;
  Eigen::VectorXd y(4);
  y << 1.0, 2.0, 1.5, 0.5;
  return GaussianProcess<>({x, y, Eigen::VectorXd::Zero(1), Eigen::VectorXd::Ones(1)},
      Hyperparameters{Eigen::VectorXd::Constant(1, 0.4), 1e-3, 0.0});
}

const Numbers front{1.0, 3.0, 2.0, 2.0, 3.0, 1.0, 0.0, 0.0};

std::vector<test::PoisonedCase> cases_of_numbers() {
  return {
      {"normal_density", {0.3}, [](const Numbers& x) { return Numbers{normal_density(x[0])}; }},
      {"normal_probability", {0.3}, [](const Numbers& x) { return Numbers{normal_probability(x[0])}; }},
      {"normal_quantile", {0.3}, [](const Numbers& x) { return ended(normal_quantile(x[0])); }},
      {"expected_excess", {0.3}, [](const Numbers& x) { return ended(expected_excess(x[0])); }},
      {"log_expected_excess", {0.3}, [](const Numbers& x) { return ended(log_expected_excess(x[0])); }},
      {"log_difference", {0.3, 0.1}, [](const Numbers& x) { return ended(log_difference(x[0], x[1])); }},
      {"log_sum_exp", {0.3, 0.1}, [](const Numbers& x) { return ended(log_sum_exp(x.begin(), x.end())); }},
      {"LogNormalPrior", {0.5, 0.1, 1.0},
          [](const Numbers& x) {
            const LogNormalPrior p{x[1], x[2]};
            return Numbers{p.log_density(x[0]), p.log_slope(x[0]), ended(p.mode())[0]};
          }},
  };
}

std::vector<test::PoisonedCase> cases_of_models() {
  return {
      {"GaussianProcess, hyper-parameters", {0.4, 1e-3, 0.1},
          [](const Numbers& x) {
            Eigen::MatrixXd at(1, 2);
            at << 0.0, 1.0;
            const GaussianProcess<> one(
                {at, Eigen::Vector2d(1.0, 2.0), Eigen::VectorXd::Zero(1), Eigen::VectorXd::Ones(1)},
                {Eigen::VectorXd::Constant(1, x[0]), x[1], std::clamp(x[2], -1e300, 1e300)});
            return Numbers{one.jitter()};
          }},
      {"GaussianProcess::fit", {0.0, 0.5, 1.0, 1.0, 2.0, 1.5, 0.0, 1.0},
          [](const Numbers& x) {
            const auto fitted =
                GaussianProcess<>::fit({taken(x, 0, 1, 3), taken(x, 3, 3, 1), taken(x, 6, 1, 1), taken(x, 7, 1, 1)});
            return list(fitted.predict(Eigen::MatrixXd::Constant(1, 1, 0.4)).mean);
          }},
      {"predict", {0.4}, [gp = process()](const Numbers& x) { return list(gp.predict(taken(x, 0, 1, 1)).mean); }},
      {"mean", {0.4}, [gp = process()](const Numbers& x) { return list(gp.mean(taken(x, 0, 1, 1))); }},
      {"covariance", {0.4, 0.6},
          [gp = process()](const Numbers& x) { return list(gp.covariance(taken(x, 0, 1, 1), taken(x, 1, 1, 1))); }},
      {"sample", {0.4, 0.6, 0.1, -0.2},
          [gp = process()](const Numbers& x) {
            const auto s = gp.sample(taken(x, 0, 1, 2), taken(x, 2, 2, 1));
            return s ? list(0.5 * *s) : Numbers{};
          }},
      {"SuccessModel", {0.1, 0.9, 0.4},
          [](const Numbers& x) {
            const SuccessModel<> model(
                taken(x, 0, 1, 1), taken(x, 1, 1, 1), Eigen::VectorXd::Zero(1), Eigen::VectorXd::Ones(1));
            return list(model.log_probability(taken(x, 2, 1, 1)));
          }},
      {"QuasiNewton", {0.5, -1.0, 2.0},
          [](const Numbers& x) {
            const auto bowl = [](const Eigen::VectorXd& at, Eigen::VectorXd& slope) {
              slope = 2.0 * at;
              return at.squaredNorm();
            };
            const auto least = QuasiNewton{}.minimize(bowl, taken(x, 0, 1, 1), taken(x, 1, 1, 1), taken(x, 2, 1, 1));
            return ended(least.value);
          }},
  };
}

std::vector<test::PoisonedCase> cases_of_searches() {
  return {
      {"pareto_front", front,
          [](const Numbers& x) {
            Numbers all;
            for (const Eigen::Index i : pareto_front(taken(x, 0, 2, 3))) all.push_back(double(i));
            return all;
          }},
      {"nondominated_boxes", front,
          [](const Numbers& x) { return list(nondominated_boxes(taken(x, 0, 2, 3), taken(x, 6, 2, 1)).lower); }},
      {"hypervolume", front, [](const Numbers& x) { return ended(hypervolume(taken(x, 0, 2, 3), taken(x, 6, 2, 1))); }},
      {"ExpectedHypervolume", {2.5, 2.5, 0.3, 0.4},
          [](const Numbers& x) {
            const ExpectedHypervolume e(taken(front, 0, 2, 3), taken(front, 6, 2, 1));
            const Eigen::Vector2d mean(x[0], x[1]), deviation(x[2], x[3]);
            return Numbers{ended(e.value(mean, deviation))[0], ended(e.log_value(mean, deviation))[0]};
          }},
      {"base_normals", {3.0, 4.0},
          [](const Numbers& x) {
            const auto count = [](double v) { return Eigen::Index(std::clamp(std::isnan(v) ? -5.0 : v, -1e9, 2e9)); };
            return list(base_normals(count(x[0]), count(x[1]), 1));
          }},
      {"Trials::tell", {0.5, 1.0},
          [](const Numbers& x) {
            Problem problem;
            problem.space.variables = {{"a", 0.0, 1.0, 0.0, ""}};
            problem.objectives = {{"y"}};
            Trials trials(problem, 1, 0);
            trials.open(0, {x[0]});
            trials.tell(0, {x[1]});
            return list(trials.results().outputs);
          }},
      {"Problem::validate", {0.0, 0.5},
          [](const Numbers& x) {
            Problem problem;
            problem.space.variables = {{"a", 0.0, 1.0, 0.0, ""}};
            problem.objectives = {{"y", true, x[0]}};
            problem.initial = {{x[1]}};
            problem.validate();
            return Numbers{};
          }},
  };
}

}  // namespace

TEST_CASE("numbers that are none, fed to models and acquisitions, give a typed error or a finite answer") {
  int calls = 0;
  for (const auto& cases : {cases_of_numbers(), cases_of_models(), cases_of_searches()})
    calls += test::check_poisoned(cases);
  CHECK(calls > 250);
}
