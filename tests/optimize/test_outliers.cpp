#include "catch.hpp"

#include "lumo/optimize/optimizer.hpp"

using namespace lumo;

namespace {

double branin_function(const Design& x) {
  const double a = x[0], b = x[1];
  return std::pow(b - 5.1 / (4 * pi * pi) * a * a + 5 / pi * a - 6, 2) + 10 * (1 - 1 / (8 * pi)) * std::cos(a) + 10;
}

Problem branin_problem(std::uint64_t seed, int evaluations) {
  Problem p;
  p.space.variables = {{"a", -5.0, 10.0, 0.0, ""}, {"b", 0.0, 15.0, 0.0, ""}};
  p.objectives = {{"f", false, 310.0}};
  p.evaluations = evaluations;
  p.seed = seed;
  return p;
}

std::vector<double> squares(int n) {
  std::vector<double> y;
  for (int i = 0; i < n; ++i) y.push_back(0.1 * i * i);
  return y;
}

}  // namespace

TEST_CASE("values without a gap have no outliers, whatever their scale", "[outliers]") {
  for (const double scale : {1e-100, 1.0, 1e100}) {
    std::vector<double> y = squares(12), tail, tight(8, 1.0);
    for (double& v : y) v *= scale;
    CHECK(ValueBulk(y, 8).whole());
    for (int i = 0; i < 16; ++i) tail.push_back(scale * std::pow(3.0, i));  // over seven decades
    CHECK(ValueBulk(tail, 16).whole());
    for (double& v : tail) v = -v;
    CHECK(ValueBulk(tail, 16).whole());
    CHECK(ValueBulk(tight, 8).whole());
    // A search that has converged: half of its values within 1e-6 of the best.
    std::vector<double> late = y;
    for (int i = 0; i < 40; ++i) late.push_back(y.back() + scale * 1e-6 * i);
    CHECK(ValueBulk(late, 12).whole());
  }
}

TEST_CASE("an absurd value, or a region of them, is outside the bulk, and the bulk does not move", "[outliers]") {
  for (const double absurd : {-1e12, -1e4, -310.0, 1e12, 2e8}) {
    std::vector<double> y = squares(12);
    y[4] = absurd;
    const ValueBulk bulk(y, 8);
    REQUIRE_FALSE(bulk.whole());
    CHECK(bulk.low() == 0.0);
    CHECK(bulk.high() == Approx(12.1));
    CHECK(bulk.worse(absurd) == (absurd < 0.0));
    CHECK(bulk.better(absurd) == (absurd > 0.0));
    for (std::size_t i = 0; i < y.size(); ++i)
      if (i != 4) CHECK_FALSE((bulk.worse(y[i]) || bulk.better(y[i])));
  }
  std::vector<double> both = squares(12), region = squares(12), most = squares(3);
  both[2] = 1e12;
  both[7] = -1e12;
  CHECK(ValueBulk(both, 8).worse(-1e12));
  CHECK(ValueBulk(both, 8).better(1e12));
  for (const std::size_t i : {1u, 4u, 6u, 9u}) region[i] = -1e9 * double(1 + i);
  for (const std::size_t i : {1u, 4u, 6u, 9u}) CHECK(ValueBulk(region, 8).worse(region[i]));
  for (int i = 0; i < 6; ++i) most.push_back(-1e12 * (1.0 + 0.1 * i));  // penalties are the more
  CHECK(ValueBulk(most, 9).worse(-1e12));
  CHECK_FALSE(ValueBulk(most, 9).better(0.4));
}

TEST_CASE("values that are far better are no outliers once others confirm them", "[outliers]") {
  std::vector<double> y = squares(12);
  y.push_back(1e8);
  CHECK(ValueBulk(y, 8).better(1e8));
  y.push_back(1e8);  // the same again confirms nothing
  CHECK(ValueBulk(y, 8).better(1e8));
  y.insert(y.end(), {1.1e8, 1.2e8});
  CHECK(ValueBulk(y, 8).whole());
}

TEST_CASE("a search with an absurd value asks what it would ask if that had failed", "[outliers]") {
  for (const std::uint64_t seed : {1u, 2u}) {
    std::vector<std::vector<Design>> asked;
    for (const double absurd : {0.0, 1e12, 3e4}) {
      Optimizer<> o(branin_problem(seed, absurd == 0.0 ? 22 : 23));
      while (const auto t = o.ask())
        if (t->id != 4) o.tell(t->id, {branin_function(t->x)});
        else if (absurd == 0.0) o.fail(t->id, false, "blew up");
        else o.tell(t->id, {absurd});
      asked.emplace_back();
      for (const Trial& t : o.trials()) asked.back().push_back(t.x);
      const auto outliers = o.outliers();
      REQUIRE(outliers.size() == (absurd == 0.0 ? 0u : 1u));
      if (outliers.empty()) continue;
      CHECK(outliers[0].id == 4);
      CHECK(outliers[0].value == absurd);
      CHECK_FALSE(outliers[0].better);
      CHECK(outliers[0].low < outliers[0].high);
      CHECK(o.evidence().x.cols() == 22);
    }
    CHECK(asked[1] == asked[0]);
    CHECK(asked[2] == asked[0]);
  }
}

TEST_CASE("an absurd value of one of two objectives keeps its place in front and hypervolume", "[outliers]") {
  Problem p = branin_problem(1, 16);
  p.objectives = {{"f", false, 310.0}, {"g", true, 0.0}};
  Optimizer<> o(p);
  while (const auto t = o.ask()) o.tell(t->id, {branin_function(t->x), t->id == 6 ? 1e9 : t->x[0] + 6.0});
  REQUIRE(o.outliers().size() == 1);
  CHECK(o.outliers()[0].better);
  CHECK(o.outliers()[0].output == 1);
  const auto front = o.front();
  CHECK(std::any_of(front.begin(), front.end(), [](const Outcome& f) { return f.id == 6; }));
  CHECK(o.hypervolume() > 1e9);
}
