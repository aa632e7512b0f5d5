#include "catch.hpp"

#include "lumo/optimize/candidate_source.hpp"

#include <limits>

using namespace lumo;

namespace {

const double infinite = std::numeric_limits<double>::infinity();

DesignSpace lattice() {
  DesignSpace s;
  s.variables = {{"a", 2.0, 29.0, 0.5, "mm"}, {"b", 1.0, 20.0, 0.5, "mm"}, {"c", 0.0, 7.5, 0.5, "mm"}};
  s.constraints = {{"a + b", {1, 1, 0}, 4.0, 20.0, "mm"}, {"b - 2 c", {0, 1, -2}, -infinite, 6.0, "mm"}};
  return s;
}

void check_fresh(const DesignSpace& space, std::size_t count, std::uint64_t key = 1) {
  const DesignSampler sampler(space);
  const auto designs = sampler.fresh(count, key, {});
  CHECK(designs.size() == count);
  CHECK(DesignSet(designs.begin(), designs.end()).size() == designs.size());
  for (const Design& x : designs) {
    CHECK_NOTHROW(space.check(x));
    CHECK(sampler.canonical(x) == x);
  }
  CHECK(sampler.fresh(count, key, {}) == designs);
  CHECK(sampler.fresh(count, key + 1, {}) != designs);
}

}  // namespace

TEST_CASE("fresh designs are feasible, different and a function of their key", "[candidates]") {
  check_fresh(lattice(), 256);
  DesignSpace box;
  for (int i = 0; i < 40; ++i) box.variables.push_back({"x" + std::to_string(i), -1.0, 2.0, i % 2 ? 0.1 : 0.0, ""});
  check_fresh(box, 100);
}

TEST_CASE("fresh designs follow limits that random points hardly meet", "[candidates]") {
  DesignSpace thin;  // Σ x within 10⁻⁶ of 1 in six continuous variables
  thin.constraints = {{"sum", std::vector<double>(6, 1.0), 1.0, 1.000001, ""}};
  for (int i = 0; i < 6; ++i) thin.variables.push_back({"x" + std::to_string(i), 0.0, 1.0, 0.0, ""});
  check_fresh(thin, 20);
  DesignSpace equal;  // Σ x = 5 on a lattice of 0.1
  equal.constraints = {{"sum", std::vector<double>(5, 1.0), 5.0, 5.0, ""}};
  for (int i = 0; i < 5; ++i) equal.variables.push_back({"x" + std::to_string(i), 0.0, 3.0, 0.1, ""});
  check_fresh(equal, 100);
  for (const int many : {6, 9, 16}) {  // where each variable's share of one step is too little to move it
    equal.variables.clear();
    for (int i = 0; i < many; ++i) equal.variables.push_back({"x" + std::to_string(i), 0.0, 3.0, 0.1, ""});
    equal.constraints = {{"sum", std::vector<double>(std::size_t(many), 1.0), double(many), double(many), ""}};
    check_fresh(equal, 100);
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(many);
    const auto designs = DesignSampler(equal).fresh(100, 5, {});
    for (const Design& x : designs) mean += Eigen::Map<const Eigen::VectorXd>(x.data(), many) / double(designs.size());
    CHECK((mean.array() - 1.0).abs().maxCoeff() < 0.4);  // all share in the repair: five deviations of a mean of 100
    for (int i = 0; i < many; i += 2) equal.constraints[0].coefficients[std::size_t(i)] = 2.0;
    equal.constraints.push_back({"half", std::vector<double>(std::size_t(many), 0.0), -infinite, 2.0, ""});
    equal.constraints[1].coefficients[0] = equal.constraints[1].coefficients[1] = 1.0;
    check_fresh(equal, 100);
  }
}

TEST_CASE("a lattice is counted to its last free design", "[candidates]") {
  DesignSpace small;
  small.variables = {{"a", 0.0, 1.0, 0.1, ""}, {"b", 0.0, 1.0, 0.1, ""}};
  small.constraints = {{"a + b", {1, 1}, -infinite, 0.3, ""}};  // 0.1 + 0.2 must count as 0.3
  const DesignSampler sampler(small);
  CHECK(sampler.feasible_count() == 10u);
  DesignSet taken;
  for (std::size_t left = 10; left-- > 0;) {
    const auto one = sampler.fresh(1, left, taken);
    REQUIRE(one.size() == 1);
    CHECK(taken.insert(one.front()).second);
    CHECK(sampler.fresh(100, 5, taken).size() == left);
  }
  CHECK(taken.contains(Design{0.3, 0.0}));  // written as a person would
  small.rules = {{[](std::span<const double> x) { return x[0] + x[1] <= 0.05; },
      [](std::span<const double> x) {
        return InfeasibleDesign("rule", x[0] + x[1], 0.05, "", "infeasible design: too large");
      }}};
  CHECK(DesignSampler(small).feasible_count() == 1u);
}

TEST_CASE("every node of a lattice is reached, and none beyond its bounds", "[candidates]") {
  DesignSpace s;
  s.variables = {{"a", 0.25, 2.9, 0.5, "", 0.25}};
  const auto all = DesignSampler(s).fresh(10, 0, {});
  CHECK(DesignSet(all.begin(), all.end()) == DesignSet{{0.25}, {0.75}, {1.25}, {1.75}, {2.25}, {2.75}});
}

TEST_CASE("moves are feasible neighbours and shrink to single steps", "[candidates]") {
  const DesignSampler sampler(lattice());
  const Design x = {6.0, 6.0, 3.0};
  for (const double reach : {0.5, 0.1, 0.01, 1e-6})
    for (const Design& y : sampler.moves(x, reach, 8, 3)) {
      CHECK(y != x);
      CHECK(sampler.space().contains(y));
    }
  DesignSet nearest;
  for (const Design& y : sampler.moves(x, 1e-6, 0, 0)) nearest.insert(y);
  CHECK(nearest.contains(Design{6.5, 6.0, 3.0}));
  CHECK(nearest.contains(Design{6.5, 5.5, 3.0}));
  CHECK(sampler.finest(1e-6));
  CHECK_FALSE(sampler.finest(0.5));
}

TEST_CASE("spaces that make no sense are refused", "[candidates]") {
  const auto refused = [](DesignSpace s) { CHECK_THROWS_AS(DesignSampler(s), InvalidArgument); };
  refused({});
  DesignSpace s = lattice();
  s.variables[1].name = "a";
  refused(s);
  s = lattice();
  s.variables[0].upper = 1.0;
  refused(s);
  s = lattice();
  s.variables[0].upper = infinite;
  refused(s);
  s = lattice();
  s.variables[0] = {"a", 0.1, 0.4, 0.5, ""};  // no node
  refused(s);
  s = lattice();
  s.constraints[0].coefficients.pop_back();
  refused(s);
}

TEST_CASE("local search finds the best design of a lattice where fresh candidates do not", "[candidates]") {
  const DesignSampler sampler(lattice());
  const auto score = [](const Eigen::MatrixXd& x) {
    Eigen::VectorXd v(x.cols());
    for (Eigen::Index i = 0; i < x.cols(); ++i)
      v[i] = -std::pow(x(0, i) - 11.5, 2) - std::pow(x(1, i) - 8.5, 2) - 10.0 * std::pow(x(2, i) - 1.5, 2) -
             0.5 * (x(0, i) - 11.5) * (x(1, i) - 8.5);
    return v;
  };
  double best = -infinite;
  Design where;
  for (const Design& x : sampler.fresh(100000, 0, {}))
    if (const double v = score(Eigen::Map<const Eigen::VectorXd>(x.data(), 3))[0]; v > best) {
      best = v;
      where = x;
    }
  const DesignSet none;
  const std::vector<Design> front;
  CHECK(LocalSearchCandidates{}.best({sampler, none, front, 1}, score) == where);
  const DesignSet taken = {where};
  const auto second = LocalSearchCandidates{}.best({sampler, taken, front, 1}, score);
  REQUIRE(second);
  CHECK(*second != where);
  CHECK(FreshCandidates{}.best({sampler, none, front, 1}, score).has_value());
}

namespace {

/// Mean and deviation of a coordinate over the fresh designs of several keys.
std::pair<double, double> spread(const std::vector<Design>& designs, std::size_t i) {
  double mean = 0.0, square = 0.0;
  for (const Design& x : designs) mean += x[i] / double(designs.size());
  for (const Design& x : designs) square += std::pow(x[i] - mean, 2) / double(designs.size() - 1);
  return {mean, std::sqrt(square)};
}

}  // namespace

TEST_CASE("fresh designs of a simplex and of ordered integers are uniform, and keep off the faces", "[candidates]") {
  DesignSpace simplex;
  for (int i = 0; i < 10; ++i) simplex.variables.push_back({"x" + std::to_string(i), 0.0, 1.0, 0.0, ""});
  simplex.constraints = {{"sum", std::vector<double>(10, 1.0), -infinite, 1.0, ""}};
  DesignSpace ordered;
  for (int i = 0; i < 7; ++i) ordered.variables.push_back({"x" + std::to_string(i), 200.0, 8000.0, 1.0, ""});
  for (std::size_t i = 0; i < 6; ++i) {
    std::vector<double> c(7, 0.0);
    c[i] = 1.0;
    c[i + 1] = -1.0;
    ordered.constraints.push_back({"c" + std::to_string(i), c, -infinite, 0.0, ""});
  }
  const DesignSampler first(simplex), second(ordered);
  for (const std::uint64_t key : {1u, 2u, 3u}) {
    const auto a = first.fresh(64, key, {});
    REQUIRE(a.size() == 64);
    for (std::size_t i = 0; i < 10; ++i) {  // a coordinate of a uniform point has mean 1/11, deviation 0.083
      const auto [mean, deviation] = spread(a, i);
      CHECK(mean == Approx(1.0 / 11.0).margin(0.045));
      CHECK(deviation == Approx(0.083).margin(0.045));
    }
    double least = 1.0;
    for (const Design& x : a) least = std::min(least, 1.0 - simplex.constraints[0].sum(x));
    CHECK(least > 1e-6);

    const auto b = second.fresh(64, key, {});
    REQUIRE(b.size() == 64);
    int equal = 0;
    for (const Design& x : b)
      for (std::size_t i = 0; i < 6; ++i) equal += x[i] == x[i + 1];
    CHECK(equal <= 4);
    for (std::size_t i = 0; i < 7; ++i)
      CHECK(spread(b, i).first == Approx(200.0 + 7800.0 * double(i + 1) / 8.0).margin(500.0));
  }
}

TEST_CASE("no pair of 40 variables leaves a quarter of its square empty", "[candidates]") {
  DesignSpace box;
  for (int i = 0; i < 40; ++i) box.variables.push_back({"x" + std::to_string(i), 0.0, 1.0, 0.0, ""});
  const auto designs = DesignSampler(box).fresh(256, 1, {});
  for (std::size_t i = 0; i < 40; ++i)
    for (std::size_t k = 0; k < i; ++k) {
      int corner = 0;  // 64 expected
      for (const Design& x : designs) corner += x[i] > 0.5 && x[k] > 0.5;
      if (std::abs(corner - 64) > 32) CHECK(corner == 64);
    }
}

TEST_CASE("lattice nodes are written as a person would where bounds are not multiples", "[candidates]") {
  DesignSpace s;
  s.variables = {{"a", -1.3, 1.3, 0.1, "", -1.3}};
  std::set<std::string> written;
  for (const Design& x : DesignSampler(s).fresh(27, 1, {})) written.insert(exact(x[0]));
  CHECK(written.size() == 27);
  for (const std::string& w : written) CHECK(w.size() <= 4);
  CHECK(written.contains("-0.1"));
}
