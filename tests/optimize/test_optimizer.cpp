#include "catch.hpp"

#include "lumo/optimize/optimizer.hpp"

#include <limits>

using namespace lumo;

namespace {

Problem problem(int evaluations = 24) {
  Problem p;
  p.space.variables = {{"a", 0.0, 10.0, 0.5, "mm"}, {"b", 0.0, 10.0, 0.5, "mm"}, {"c", 0.0, 1.0, 0.0, ""}};
  p.space.constraints = {{"a + b", {1, 1, 0}, 2.0, 15.0, "mm"}};
  p.objectives = {{"gain", true, 0.0}, {"cost", false, 1.5}};
  p.initial = {{5.0, 5.0, 0.5}, {1.0, 1.0, 0.0}};
  p.sobol = 6;
  p.evaluations = evaluations;
  p.seed = 4;
  return p;
}

std::vector<double> measure(const Design& x) {
  const double a = x[0] / 10.0, b = x[1] / 10.0;
  return {1.0 - std::pow(a - 0.3, 2) - b * b - 0.1 * x[2],
      std::pow(a - 0.8, 2) + std::pow(b - 0.3, 2) + 0.1 * std::pow(x[2] - 0.5, 2)};
}

template <class O> std::vector<Design> run(O& o) {
  while (auto t = o.ask()) o.tell(t->id, measure(t->x));
  std::vector<Design> out;
  for (const Trial& t : o.trials()) out.push_back(t.x);
  return out;
}

}  // namespace

TEST_CASE(
    "an optimiser asks starts, then Sobol points, then what it chooses, feasible and never twice", "[optimizer]") {
  Optimizer<> o(problem());
  const auto designs = run(o);
  CHECK(o.status() == OptimizerStatus::finished);
  REQUIRE(designs.size() == 24);
  CHECK(designs[0] == Design{5.0, 5.0, 0.5});
  CHECK(designs[1] == Design{1.0, 1.0, 0.0});
  CHECK(DesignSet(designs.begin(), designs.end()).size() == 24);
  for (const Design& x : designs) CHECK_NOTHROW(o.problem().space.check(x));
  const auto front = o.front();
  for (const Outcome& one : front) {
    CHECK(one.objectives == measure(designs[std::size_t(one.id)]));
    for (const Outcome& other : front)
      CHECK_FALSE((other.objectives[0] > one.objectives[0] && other.objectives[1] < one.objectives[1]));
  }
  CHECK(o.hypervolume() > 0.9 * 1.5 * 0.98);
}

TEST_CASE("runs are bit-identical, differ by seed, and continue from any point as if never stopped", "[optimizer]") {
  Optimizer<> whole(problem()), again(problem());
  const auto designs = run(whole);
  CHECK(run(again) == designs);
  Problem other = problem();
  other.seed = 5;
  Optimizer<> differs(other);
  CHECK(run(differs) != designs);
  for (const std::size_t stop : {0u, 1u, 7u, 8u, 9u, 17u, 24u}) {
    Optimizer<> resumed(problem());
    for (std::size_t i = 0; i < stop; ++i) {
      resumed.restore(int(i), designs[i]);
      resumed.tell(int(i), measure(designs[i]));
    }
    CHECK(run(resumed) == designs);
    CHECK(resumed.hypervolume() == whole.hypervolume());
  }
}

TEST_CASE("answers may come in any order, and what is pending is not asked again", "[optimizer]") {
  Optimizer<> forward(problem()), backward(problem());
  for (auto* o : {&forward, &backward}) {
    std::vector<Trial> batch;
    for (int i = 0; i < 12; ++i) batch.push_back(*o->ask());
    CHECK(o->pending() == 12);
    if (o == &backward) std::reverse(batch.begin(), batch.end());
    for (const Trial& t : batch) o->tell(t.id, measure(t.x));
  }
  // Before any model the batch was the same, and so is what follows from the same answers.
  for (int i = 0; i < 4; ++i) {
    const auto f = forward.ask(), b = backward.ask();
    REQUIRE((f && b));
    CHECK(f->x == b->x);
  }
  DesignSet seen;
  for (const Trial& t : forward.trials()) CHECK(seen.insert(t.x).second);
}

TEST_CASE("pending designs condition the choice", "[optimizer]") {
  Optimizer<> o(problem(60));
  for (int i = 0; i < 16; ++i) {
    const auto t = o.ask();
    o.tell(t->id, measure(t->x));
  }
  // A pending design takes away what it promises itself.
  const auto& models = o.models();
  const Evidence alone = o.evidence();
  const auto first = o.ask();
  const Evidence conditioned = o.evidence();
  CHECK(conditioned.pending.cols() == 1);
  const Eigen::VectorXd at = Eigen::Map<const Eigen::VectorXd>(first->x.data(), 3);
  for (const bool noisy : {true, false}) {
    const LogNehvi exact{.noisy = noisy};
    CHECK(exact.prepare(models, EachOutput{}, conditioned, 1)(at)[0] <
          exact.prepare(models, EachOutput{}, alone, 1)(at)[0] - 1.0);
    const QLogNehvi sampled{.noisy = noisy};
    CHECK(sampled.prepare(models, EachOutput{}, conditioned, 1)(at)[0] <
          sampled.prepare(models, EachOutput{}, alone, 1)(at)[0] - 1.0);
  }
  const auto second = o.ask();
  CHECK(second->x != first->x);
}

TEST_CASE("closed form and sampling agree on what a design promises", "[optimizer]") {
  Optimizer<> o(problem(60));
  for (int i = 0; i < 10; ++i) {
    const auto t = o.ask();
    o.tell(t->id, measure(t->x));
  }
  const auto pool = DesignSampler(o.problem().space).fresh(64, 9, {});
  const Eigen::MatrixXd x = design_columns(pool, 3);
  for (const bool noisy : {true, false}) {
    const Eigen::VectorXd exact =
        LogNehvi{.draws = 256, .noisy = noisy}.prepare(o.models(), EachOutput{}, o.evidence(), 1)(x);
    const Eigen::VectorXd sampled =
        QLogNehvi{.draws = 4096, .noisy = noisy}.prepare(o.models(), EachOutput{}, o.evidence(), 2)(x);
    int compared = 0;
    for (Eigen::Index i = 0; i < x.cols(); ++i) {
      CHECK(std::isfinite(exact[i]));
      if (exact[i] < exact.maxCoeff() - 3.0) continue;  // where samples are enough
      ++compared;
      CHECK(sampled[i] == Approx(exact[i]).margin(0.25));
    }
    CHECK(compared > 0);
  }
}

TEST_CASE(
    "the acquisition distinguishes designs however far the reference point lies from the outcomes", "[optimizer]") {
  const double far = 1e11;  // of spreads of the order of 0.3
  Problem p = problem(60);
  p.objectives[0].reference = -far;
  p.objectives[1].reference = far;
  Optimizer<> o(p);
  for (int i = 0; i < 10; ++i) {
    const auto t = o.ask();
    o.tell(t->id, measure(t->x));
  }
  const Eigen::MatrixXd x = design_columns(DesignSampler(p.space).fresh(64, 9, {}), 3);
  for (const bool noisy : {true, false}) {
    const Eigen::VectorXd promise = QLogNehvi{.noisy = noisy}.prepare(o.models(), EachOutput{}, o.evidence(), 2)(x);
    CHECK(promise.allFinite());
    CHECK(promise.maxCoeff() > promise.minCoeff());
  }
}

TEST_CASE("failures are never scored, only those of the machine are asked again, and not for ever", "[optimizer]") {
  Optimizer<> o(problem());
  const auto bad = o.ask();
  o.fail(bad->id, false, "no mesh");
  const auto unlucky = o.ask();
  CHECK(unlucky->x != bad->x);
  o.fail(unlucky->id, true, "killed");
  for (int attempt = 0; attempt < 2; ++attempt) {
    const auto retry = o.ask();
    CHECK(retry->x == unlucky->x);
    CHECK(retry->id > unlucky->id);
    o.fail(retry->id, true, "killed");
  }
  run(o);
  CHECK(o.observed() == 24);
  for (const Trial& t : o.trials())
    if (t.id > 4) CHECK((t.x != bad->x && t.x != unlucky->x));
  CHECK(o.trials()[0].why == "no mesh");
}

namespace {

/// Asks until the end or 200 trials, fails where `fails` says so; how many failed.
template <class O, class Fails, class Value> int run_with_failures(O& o, const Fails& fails, const Value& value) {
  int failed = 0;
  for (int asked = 0; asked < 200; ++asked) {
    const auto t = o.ask();
    if (!t) break;
    if (fails(t->x)) ++failed, o.fail(t->id, false, "no value there");
    else o.tell(t->id, {value(t->x)});
  }
  return failed;
}

}  // namespace

TEST_CASE("where a design fails for good the search learns to stay away", "[optimizer]") {
  Problem line;
  line.space.variables = {{"x", 0.0, 1.0, 0.0, ""}};
  line.objectives = {{"x", true, 0.0}};
  line.evaluations = 20;
  Problem corner;  // the best designs of the lattice lie along the edge of what fails
  corner.space.variables = {{"a", 0.0, 10.0, 0.5, ""}, {"b", 0.0, 10.0, 0.5, ""}};
  corner.objectives = {{"f", true, -10.0}};
  corner.evaluations = 30;
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    line.seed = corner.seed = seed;
    Optimizer<> one(line);
    const int beyond = run_with_failures(
        one, [](const Design& x) { return x[0] > 0.8; }, [](const Design& x) { return x[0]; });
    CHECK(one.status() == OptimizerStatus::finished);
    CHECK(one.hypervolume() > 0.79);
    CHECK(beyond <= 15);

    Optimizer<> two(corner);
    const int cut = run_with_failures(
        two, [](const Design& x) { return x[0] + x[1] > 14.0 && x[0] > 5.0; },
        [](const Design& x) { return x[0] + 0.9 * x[1]; });
    CHECK(two.status() == OptimizerStatus::finished);
    CHECK(two.hypervolume() > 10.0 + 13.9);  // the best is 14 at (5, 10): 5 + 9
    CHECK(cut <= 30);                        // of 75 that a search without a model of success asks
  }
}

TEST_CASE("choices after failures are a function of the trials, too", "[optimizer]") {
  const auto fails = [](const Design& x) { return x[0] + x[1] > 9.0; };
  const auto answer = [&](Optimizer<>& o, const Trial& t) {
    if (fails(t.x)) o.fail(t.id, false, "");
    else o.tell(t.id, measure(t.x));
  };
  Optimizer<> whole(problem(16)), retried(problem(16));
  while (const auto t = whole.ask()) answer(whole, *t);
  const int n = int(whole.trials().size());
  CHECK(n > 16);
  for (const int stop : {9, 12, 15, n - 1}) {
    Optimizer<> resumed(problem(16));
    for (int i = 0; i < stop; ++i) {
      resumed.restore(i, whole.trials()[std::size_t(i)].x);
      answer(resumed, resumed.trials().back());
    }
    while (const auto t = resumed.ask()) answer(resumed, *t);
    REQUIRE(int(resumed.trials().size()) == n);
    for (int i = 0; i < n; ++i) CHECK(resumed.trials()[std::size_t(i)].x == whole.trials()[std::size_t(i)].x);
  }
}

TEST_CASE("what the machine failed at is tried three times and teaches nothing about designs", "[optimizer]") {
  const auto search = [](bool hungry) {
    Optimizer<> o(problem(16));
    Design starved;
    std::vector<Design> answered;
    while (const auto t = o.ask()) {
      if (hungry && starved.empty()) starved = t->x;
      if (t->x == starved) {
        o.fail(t->id, true, "killed");
      } else {
        o.tell(t->id, measure(t->x));
        answered.push_back(t->x);
      }
    }
    CHECK(std::count_if(o.trials().begin(), o.trials().end(), [&](const Trial& t) { return t.x == starved; }) ==
          (hungry ? 3 : 0));
    CHECK(std::find(answered.begin(), answered.end(), starved) == answered.end());
    return answered;
  };
  const auto fed = search(false), hungry = search(true);
  REQUIRE(hungry.size() == 16);
  CHECK(hungry[0] == fed[1]);  // the next start takes the place of the one that was given up
}

TEST_CASE("a model of success is sure of what it saw, unsure between, and bounded", "[optimizer]") {
  Eigen::MatrixXd succeeded(1, 8), failed(1, 4);
  succeeded << 0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.68;
  failed << 0.76, 0.84, 0.92, 1.0;
  const Eigen::VectorXd low = Eigen::VectorXd::Zero(1), high = Eigen::VectorXd::Ones(1);
  const SuccessModel<> model(succeeded, failed, low, high);
  const Eigen::VectorXd p = model.log_probability(succeeded).array().exp(),
                        q = model.log_probability(failed).array().exp();
  CHECK(p.minCoeff() > 0.8);
  CHECK(q.maxCoeff() < 0.2);
  CHECK(std::exp(model.log_probability(Eigen::MatrixXd::Constant(1, 1, 0.72))[0]) == Approx(0.5).margin(0.2));
  const SuccessModel<> hopeless(Eigen::MatrixXd(1, 0), failed, low, high);
  for (const double x : {0.0, 0.5, 0.8, 1.0}) {
    const double value = hopeless.log_probability(Eigen::MatrixXd::Constant(1, 1, x))[0];
    CHECK(value <= 0.0);
    CHECK(value >= std::log(SuccessModel<>::least_probability));
  }
}

TEST_CASE("an exhausted lattice is a clear end", "[optimizer]") {
  Problem p = problem(100);
  p.space.variables = {{"a", 0.0, 1.0, 0.5, ""}, {"b", 0.0, 1.0, 0.5, ""}};
  p.space.constraints = {{"a + b", {1, 1}, -std::numeric_limits<double>::infinity(), 1.0, ""}};
  p.initial = {};
  Optimizer<> o(p);
  int asked = 0;
  std::optional<Trial> held;
  while (auto t = o.ask()) {
    ++asked;
    if (asked == 3) held = t;
    else o.tell(t->id, {t->x[0], t->x[1]});
  }
  CHECK(asked == 6);
  CHECK(o.status() == OptimizerStatus::waiting);
  o.tell(held->id, {held->x[0], held->x[1]});
  CHECK_FALSE(o.ask());
  CHECK(o.status() == OptimizerStatus::exhausted);
  CHECK(o.observed() == 6);
}

TEST_CASE("no more is asked than is wanted", "[optimizer]") {
  Optimizer<> o(problem(3));
  for (int i = 0; i < 3; ++i) CHECK(o.ask());
  CHECK_FALSE(o.ask());
  CHECK(o.status() == OptimizerStatus::waiting);
  o.fail(1, false, "");
  CHECK(o.status() == OptimizerStatus::running);
  CHECK(o.ask());
}

TEST_CASE("answers that make no sense are refused and change nothing", "[optimizer]") {
  Optimizer<> o(problem());
  const auto t = o.ask();
  const double nan = std::nan("");
  CHECK_THROWS_AS(o.tell(t->id, {1.0}), InvalidArgument);
  CHECK_THROWS_AS(o.tell(t->id, {1.0, 2.0, 3.0}), InvalidArgument);
  CHECK_THROWS_AS(o.tell(t->id, {1.0, nan}), InvalidArgument);
  CHECK_THROWS_AS(o.tell(t->id, {std::numeric_limits<double>::infinity(), 1.0}), InvalidArgument);
  CHECK_THROWS_AS(o.tell(t->id + 1, {1.0, 1.0}), InvalidArgument);
  CHECK_THROWS_AS(o.fail(-1, false, ""), InvalidArgument);
  CHECK(o.pending() == 1);
  o.tell(t->id, {1.0, 1.0});
  CHECK_THROWS_AS(o.tell(t->id, {1.0, 1.0}), InvalidArgument);
  CHECK_THROWS_AS(o.fail(t->id, true, ""), InvalidArgument);
  CHECK_THROWS_AS(o.restore(7, {1.0, 2.0, 0.0}), InvalidArgument);
  CHECK_THROWS_AS(o.restore(1, t->x), InvalidArgument);
  CHECK_THROWS_AS(o.restore(1, {9.0, 9.0, 0.0}), InfeasibleDesign);
  Problem p = problem();
  p.initial.push_back({0.25, 5.0, 0.5});
  CHECK_THROWS_AS(Optimizer<>(p), InfeasibleDesign);
}

TEST_CASE("extreme scales, constants and repeats do not break a run", "[optimizer]") {
  for (const double scale : {1e-12, 1e12, 0.0}) {
    Problem p = problem(16);
    p.objectives[1].reference *= scale;
    Optimizer<> o(p);
    std::vector<Design> designs;
    while (auto t = o.ask()) {
      auto y = measure(t->x);
      for (double& v : y) v *= scale;
      o.tell(t->id, y);
    }
    CHECK(o.observed() == 16);
    CHECK(std::isfinite(o.hypervolume()));
  }
}

TEST_CASE(
    "one or three objectives, Matern and sampled acquisition, composite surrogates: policies combine", "[optimizer]") {
  Problem p = problem(14);
  p.objectives = {{"one", true, -5.0}};
  Optimizer<Matern52Kernel> single(p);
  while (auto t = single.ask()) single.tell(t->id, {measure(t->x)[0]});
  CHECK(single.front().size() == 1);
  CHECK(single.hypervolume() > 5.5);

  p.objectives = {{"f", true, -5.0}, {"g", false, 5.0}, {"h", true, -5.0}};
  Optimizer<RbfKernel, LogNehvi, FreshCandidates> three(p, {.acquisition = {.draws = 4}, .source = {.count = 32}});
  while (auto t = three.ask()) three.tell(t->id, {measure(t->x)[0], measure(t->x)[1], t->x[2]});
  CHECK(three.observed() == 14);

  p.objectives = {{"f", true, -5.0}, {"g", false, 5.0}};
  using Composite = Optimizer<RbfKernel, QLogNehvi, FreshCandidates, MinimumOverTerms>;
  Composite composite(p, {.acquisition = {.draws = 16}, .source = {.count = 32}, .reduction = {{2, 1}}});
  while (auto t = composite.ask()) composite.tell(t->id, {measure(t->x)[0], 0.9 - t->x[2], measure(t->x)[1]});
  CHECK(composite.observed() == 14);
  for (const Outcome& o : composite.front()) {
    const auto& out = composite.trials()[std::size_t(o.id)].outputs;
    CHECK(o.objectives == std::vector<double>{std::min(out[0], out[1]), out[2]});
  }
  CHECK_THROWS_AS(Composite(p, {.reduction = {{2}}}), InvalidArgument);
}
