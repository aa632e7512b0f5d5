#include "catch.hpp"
#include "lumo/core/sobol.hpp"
#include "lumo/core/units.hpp"
#include "lumo/objective/optical_separation.hpp"

#include <cmath>

using namespace lumo;

namespace {

double normal_number(std::uint64_t key) {
  return std::sqrt(-2.0 * std::log(uniform(combine(key, 0)))) * std::cos(2.0 * pi * uniform(combine(key, 1)));
}

/// Eight replicates of eleven regions: `signal` in the first, noise of standard error `noise` of the mean in each.
Eigen::MatrixXd noisy(double signal, double noise, std::uint64_t key) {
  Eigen::MatrixXd m(8, 11);
  for (Eigen::Index i = 0; i < 8; ++i)
    for (Eigen::Index j = 0; j < 11; ++j)
      m(i, j) =
          (j == 0 ? signal : 0.0) + noise * std::sqrt(8.0) * normal_number(combine(key, std::uint64_t(11 * i + j)));
  return m;
}

}  // namespace

TEST_CASE("The squared distance of responses is not raised by noise, and its error is honest", "[optical_separation]") {
  const Eigen::MatrixXd zero = Eigen::MatrixXd::Zero(8, 11);
  for (double noise : {0.05, 0.2}) {
    double square = 0.0, scatter = 0.0, stated = 0.0, naive = 0.0;
    const int runs = 2000;
    for (int k = 0; k < runs; ++k) {
      const Eigen::MatrixXd d = noisy(1.0, noise, std::uint64_t(k + 1));
      const Estimate e = response_distance(d, zero);
      square += e.value * e.value / runs;
      naive += d.colwise().mean().squaredNorm() / runs;
      scatter += std::pow(e.value - 1.0, 2) / runs;
      stated += e.error * e.error / runs;
    }
    CHECK(square == Approx(1.0).margin(4.0 * 2.0 * noise / std::sqrt(double(runs))));
    CHECK(naive == Approx(1.0 + 11.0 * noise * noise).margin(8.0 * noise / std::sqrt(double(runs))));
    CHECK(stated / scatter > 0.7);
    CHECK(stated / scatter < 1.5);
  }
  CHECK(response_distance(zero, zero).value == 0.0);
  const Estimate nothing = response_distance(noisy(0.0, 1.0, 5), zero);
  CHECK(nothing.error > 0.3);
}

TEST_CASE("Only states that can decide the least distance are to be retraced", "[optical_separation]") {
  std::vector<ObservedState> states;
  const auto add = [&](double y, double load, double signal, double noise) {
    states.push_back({states.size(), 10e-3, 0.0, y, load, noisy(signal, noise, 100 + states.size())});
  };
  add(0.0, 1.0, 0.0, 0.01), add(5e-3, 1.0, 1.0, 0.01), add(9e-3, 1.0, 9.0, 0.01);
  add(0.0, 2.0, 0.0, 0.01), add(5e-3, 2.0, 5.0, 0.01);
  CHECK(undecided_states(states, 0.10).empty());
  const auto numbers = [&](double tolerance) {
    std::vector<std::size_t> all;
    for (const Undecided& u : undecided_states(states, tolerance)) {
      CHECK(u.excess > 1.0);
      CHECK(u.excess <= 1.0 / tolerance);
      all.push_back(u.state);
    }
    return all;
  };
  CHECK(numbers(0.001) == std::vector<std::size_t>{0, 1});
  const double far = undecided_states(states, 0.001).front().excess;
  CHECK(undecided_states(states, 0.002).front().excess == Approx(0.5 * far));
  add(0.0, 5.0, 0.0, 1.0), add(5e-3, 5.0, 3.0, 1.0);
  const std::vector<std::size_t> wanted = numbers(0.001);
  CHECK(wanted.front() == 0);
  CHECK(std::find(wanted.begin(), wanted.end(), std::size_t(2)) == wanted.end());
  CHECK(undecided_states({}, 0.02).empty());
  const auto least = optical_separation(states);
  REQUIRE(least);
  CHECK(least->first == 0);
  CHECK(least->second == 1);
}

TEST_CASE(
    "a response's rise over load is its size where it is linear, and is more where it turns", "[optical_separation]") {
  const std::vector<double> loads_N = {1.0, 2.0, 5.0, 10.0};
  std::vector<Eigen::RowVectorXd> linear, turning;
  for (const double F : loads_N) {
    linear.push_back(Eigen::RowVector2d(F, -2.0 * F));
    turning.push_back(Eigen::RowVector2d(F * (5.0 - F), 0.0));
  }
  const std::vector<double> rises = load_rises(loads_N, linear);
  REQUIRE(rises.size() == 4);
  for (std::size_t k = 0; k < 4; ++k) CHECK(rises[k] == Approx(linear[k].norm()));
  CHECK(load_rises(loads_N, turning)[2] == Approx(5.0 * 6.0 / 3.0));  // from 6 to 0
  CHECK(load_rises({}, {}).empty());
  CHECK_THROWS_AS(load_rises({2.0, 2.0}, {linear[0], linear[1]}), InvalidArgument);
  CHECK_THROWS_AS(load_rises({0.0}, {linear[0]}), InvalidArgument);
  CHECK_THROWS_AS(load_rises({1.0, 2.0}, {linear[0], Eigen::RowVector3d::Zero()}), InvalidArgument);
}

TEST_CASE("a change near its zero is known no better than the light that cancels says", "[optical_separation]") {
  // Two places, their changes 1 apart. At the first light gained and light lost nearly cancel.
  std::vector<ObservedState> states = {
      {0, 10e-3, 0.0, 0.0, 1.0, noisy(0.0, 1e-3, 1)}, {1, 10e-3, 0.0, 5e-3, 1.0, noisy(1.0, 1e-3, 2)}};
  for (ObservedState& s : states) s.area_error = 0.02;
  states[1].load_rise = 1.0;
  const double steady = optical_separation(states)->distance.error;
  CHECK(steady == Approx(2.0 * 0.02 * 2.0).epsilon(0.03));
  states[0].load_rise = 20.0;
  CHECK(optical_separation(states)->distance.error == Approx(std::hypot(2.0 * 0.02 * 20.0, steady)).epsilon(0.01));
  CHECK(optical_separation(states, {0.0})->distance.error < 5e-3);
  // Rays that the mesh would not repay are not sent.
  CHECK_FALSE(undecided_states(states, 1e-4, {0.0}).empty());
  CHECK(undecided_states(states, 1e-4).empty());
  states[0].area_error = states[1].area_error = 1e-4;
  CHECK_FALSE(undecided_states(states, 1e-4).empty());
}
