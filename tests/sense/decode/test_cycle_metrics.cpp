#include "catch.hpp"

#include "lumo/sense/decode/cycle_metrics.hpp"
#include "sense/synthetic.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

using namespace lumo;
using namespace lumo::sense;

namespace {

/// Frames at these loads, with the profile that `at(load)` gives.
template <class At> CycleBranch branch(const std::vector<double>& loads, At at) {
  CycleBranch b{Eigen::VectorXd(Eigen::Index(loads.size())), Eigen::MatrixXd()};
  for (std::size_t k = 0; k < loads.size(); ++k) {
    const Eigen::VectorXd p = at(loads[k]);
    b.profile.conservativeResize(p.size(), Eigen::Index(loads.size()));
    b.load_N[Eigen::Index(k)] = loads[k];
    b.profile.col(Eigen::Index(k)) = p;
  }
  return b;
}

/// From low to high, not in order, at other loads for each seed.
std::vector<double> scattered(double low_N, double high_N, std::uint64_t seed) {
  synthetic::Normal normal(seed);
  std::vector<double> loads;
  for (int k = 0; k <= 60; ++k) loads.push_back(low_N + (high_N - low_N) * (k + 0.6 * normal()) / 60.0);
  loads.push_back(low_N);
  loads.push_back(high_N);
  return loads;
}

std::vector<double> even(double low_N, double high_N, double step_N, double shift_N = 0.0) {
  std::vector<double> loads;
  for (double f = low_N + shift_N; f <= high_N + shift_N + 1e-9; f += step_N) loads.push_back(f);
  return loads;
}

/// numpy's argsort and interp, by another hand than the library's.
Eigen::VectorXd interpolated(const CycleBranch& b, double load_N) {
  std::vector<std::pair<double, Eigen::Index>> sorted;
  for (Eigen::Index k = 0; k < b.load_N.size(); ++k) sorted.emplace_back(b.load_N[k], k);
  std::sort(sorted.begin(), sorted.end());
  std::size_t i = 1;
  while (i + 1 < sorted.size() && sorted[i].first < load_N) ++i;
  const auto [x0, c0] = sorted[i - 1];
  const auto [x1, c1] = sorted[i];
  return b.profile.col(c0) + (load_N - x0) / (x1 - x0) * (b.profile.col(c1) - b.profile.col(c0));
}

}  // namespace

TEST_CASE("W_cycle of lines over load is in closed form, and hysteresis is no part of it", "[cycles]") {
  // Light is 2 F, 30 more while unloading. Cycles are off by −2, −1, 0, 1, 4 times 0.3 DN while loading, 0.5 DN while
  // unloading: deviations from the median cycle are 0, 1, 1, 2, 4 times that, their median once. As many cells of each
  // branch, so that the run's median lies half way.
  const std::vector<double> off{-2, -1, 0, 1, 4};
  CycleRun run;
  for (std::size_t c = 0; c < off.size(); ++c) {
    const auto at = [&](double more) {
      return [&, more](double load) { return Eigen::VectorXd::Constant(7, 50.0 + 2.0 * load + more); };
    };
    run.push_back(
        {branch(scattered(2, 15, c + 1), at(0.3 * off[c])), branch(scattered(2, 15, c + 9), at(30.0 + 0.5 * off[c]))});
  }
  const CycleVariation v = cycle_variation({run});
  CHECK(v.W_cycle_DN == Approx(0.4));
  CHECK(v.from_N == 3.0);
  CHECK(v.to_N == Approx(14.0));
  CHECK(v.runs == 1);
  // Median over runs: two that are ten times as far apart outvote it.
  CycleRun wide = run;
  for (std::size_t c = 0; c < off.size(); ++c) {
    wide[c].loading.profile.array() += 2.7 * off[c];
    wide[c].unloading.profile.array() += 4.5 * off[c];
  }
  CHECK(cycle_variation({wide, run, wide}).W_cycle_DN == Approx(4.0));
  CHECK(cycle_variation({run, wide}).W_cycle_DN == Approx(2.2));
}

TEST_CASE("W_cycle is in DN: of cycles that differ in slope it is the deviation at the middle load", "[cycles]") {
  // Slopes of 0.9, 1, 1.2 DN/N: deviations 0.1, 0, 0.2 DN/N, median 0.1, at the median of 3.0, 3.5 … 14.0 N.
  CycleRun run;
  for (const double slope : {0.9, 1.0, 1.2}) {
    const CycleBranch b =
        branch(scattered(2, 15, 3), [&](double f) { return Eigen::VectorXd::Constant(3, slope * f); });
    run.push_back({b, b});
  }
  CHECK(cycle_variation({run}).W_cycle_DN == Approx(0.1 * 8.5));
}

TEST_CASE("noise of single frames comes through W_cycle as order statistics say", "[cycles]") {
  // Five equal cycles with noise σ. About their median x̃ the mean square is (Σ (x − x̄)² + 5 (x̄ − x̃)²)/5, expected
  // (4 + 5 (0.28683 − 1/5))/5 σ²: the variance of the median of five normals is 0.28683 (Sarhan & Greenberg 1956), its
  // covariance with the mean 1/5. Frames at the loads themselves keep σ, half way between them σ/√2.
  const double sigma = 0.8, factor = std::sqrt((4.0 + 5.0 * (0.28683 - 0.2)) / 5.0);
  for (const bool between : {false, true}) {
    synthetic::Normal normal(5);
    std::vector<CycleRun> runs(3);
    for (CycleRun& run : runs)
      for (int c = 0; c < 5; ++c) {
        const auto noisy = [&](double load) {
          Eigen::VectorXd p(800);
          for (double& v : p) v = 3.0 * load + sigma * normal();
          return p;
        };
        const std::vector<double> loads = even(2.0, 15.0, 0.5, between ? 0.25 : 0.0);
        CycleBranch up = branch(loads, noisy);
        run.push_back({std::move(up), branch(loads, noisy)});
      }
    CHECK(cycle_variation(runs).W_cycle_DN == Approx(factor * sigma / (between ? std::sqrt(2.0) : 1.0)).epsilon(0.01));
  }
}

TEST_CASE("W_cycle of any frames is that of another computation", "[cycles]") {
  synthetic::Normal normal(21);
  std::vector<CycleRun> runs(4);
  for (CycleRun& run : runs)
    for (int c = 0; c < 5; ++c) {
      const auto curve = [&](double load) {
        Eigen::VectorXd p(9);
        for (double& v : p) v = 20.0 * std::sqrt(load) + normal();
        return p;
      };
      CycleBranch up = branch(scattered(1.9, 15.1, std::uint64_t(31 * c) + std::uint64_t(&run - runs.data())), curve);
      run.push_back({std::move(up), branch(scattered(1.9, 15.1, std::uint64_t(47 * c) + 9), curve)});
    }
  std::vector<double> of_runs;
  for (const CycleRun& run : runs) {
    std::vector<double> cells;
    for (int half_N = 6; half_N <= 28; ++half_N)
      for (const bool up : {true, false}) {
        Eigen::MatrixXd profile(9, 5);
        for (int c = 0; c < 5; ++c) {
          const LoadCycle& cycle = run[std::size_t(c)];
          profile.col(c) = interpolated(up ? cycle.loading : cycle.unloading, 0.5 * half_N);
        }
        std::vector<double> off(5);
        for (Eigen::Index b = 0; b < 9; ++b) {
          std::vector<double> row{profile(b, 0), profile(b, 1), profile(b, 2), profile(b, 3), profile(b, 4)};
          std::sort(row.begin(), row.end());
          for (int c = 0; c < 5; ++c) off[std::size_t(c)] += std::pow(profile(b, c) - row[2], 2) / 9.0;
        }
        std::sort(off.begin(), off.end());
        cells.push_back(std::sqrt(off[2]));
      }
    std::sort(cells.begin(), cells.end());
    of_runs.push_back(0.5 * (cells[22] + cells[23]));
  }
  std::sort(of_runs.begin(), of_runs.end());
  CHECK(cycle_variation(runs).W_cycle_DN == Approx(0.5 * (of_runs[1] + of_runs[2])).epsilon(1e-12));
}

TEST_CASE("cycles are compared at the longest stretch of loads that half of them cover", "[cycles]") {
  const auto cycle = [](double low, double high) {
    const CycleBranch b = branch(even(low, high, 0.25), [](double f) { return Eigen::VectorXd::Constant(2, f); });
    return LoadCycle{b, b};
  };
  const LoadCycle whole = cycle(2, 15), low = cycle(2, 10.2), high = cycle(9, 15);
  CHECK(cycle_variation({{whole, whole, low, low}}).to_N == Approx(14.0));  // half is enough
  const CycleVariation cut = cycle_variation({{whole, low, low, low}});
  CHECK(cut.from_N == 3.0);
  CHECK(cut.to_N == Approx(10.0));
  CHECK(cycle_variation({{whole, high, high}}).from_N == Approx(9.0));
  CHECK(cycle_variation({{low, low}, {whole}}).runs == 1);  // one cycle is its own median
  LoadCycle half = whole;
  half.unloading = low.unloading;
  CHECK(cycle_variation({{half, half, half}}).to_N == Approx(10.0));  // both branches
  CHECK_THROWS_AS(cycle_variation({{cycle(1, 2.5), cycle(14.5, 15)}}), InvalidArgument);
  CHECK_THROWS_AS(cycle_variation({{whole}}), InvalidArgument);
  CHECK_THROWS_AS(cycle_variation({}), InvalidArgument);
  CHECK_THROWS_AS(cycle_variation({{LoadCycle{}, LoadCycle{}}}), InvalidArgument);
  LoadCycle other = whole;
  other.loading.profile.conservativeResize(1, Eigen::NoChange);
  CHECK_THROWS_AS(cycle_variation({{whole, other}}), InvalidArgument);
  other = whole;
  other.loading.profile(0, 0) = std::nan("");
  CHECK_THROWS_AS(cycle_variation({{whole, other}}), InvalidArgument);
  CHECK_THROWS_AS(cycle_variation({{whole, whole}}, {.from_N = 9.0, .to_N = 3.0}), InvalidArgument);
}

namespace {

/// One run of cycles 2 → 15 → 2 N, of 2 s each, after an unloaded second; light is 4 F + 100, and `off[k]` more in
/// cycle k − 2. Frames every 0.1 s carry stamps 30 ms late; the sensor's clock is 5 s ahead, and it shows 0.4 N too
/// much.
struct Logged {
  Session session;
  std::vector<Profile> profiles;
  std::vector<WrenchSample> wrenches;

  explicit Logged(const std::vector<double>& off, double low_N = 2.0) {
    constexpr std::int64_t s = 1000 * synthetic::ms;
    session.frame_delay_s = 0.03;
    session.wrench_clock = {0, -5.0, 0.0, 0.0};
    const auto load = [&](std::int64_t t) {
      const double phase = std::fmod(1e-9 * double(t - s), 2.0);
      return t < s ? 0.0 : low_N + (15.0 - low_N) * (phase < 1.0 ? phase : 2.0 - phase);
    };
    session.segments.push_back({0, s - 1, SegmentKind::unloaded});
    for (std::size_t k = 0; k < off.size(); ++k) {
      Segment cycle{s + 2 * s * std::int64_t(k), 3 * s + 2 * s * std::int64_t(k), SegmentKind::cycle, 0};
      cycle.repetition = 0;
      cycle.cycle = int(k) - 2;
      session.segments.push_back(cycle);
    }
    const std::int64_t end = s + 2 * s * std::int64_t(off.size());
    for (std::int64_t t = 0; t <= end; t += 10 * synthetic::ms)
      wrenches.push_back({t + 5 * s, Vec3d(0.0, 0.0, -load(t) - 0.4), Vec3d::Zero()});
    for (std::int64_t t = 10 * synthetic::ms; t < end; t += 100 * synthetic::ms) {
      const auto k = std::size_t(std::max<std::int64_t>(0, t - s) / (2 * s));
      const std::int64_t late = 30 * synthetic::ms;
      profiles.push_back({t + late, Eigen::VectorXd::Constant(4, 100.0 + 4.0 * load(t) + off[k]), 0.0});
    }
  }
  LoggedCycles cycles() const { return cycle_runs(profiles, session, wrenches); }
};

}  // namespace

TEST_CASE("cycles of a log: conditioning left out, loads as the sensor measured them at the picture", "[cycles]") {
  const Logged log({-90, 70, -2, -1, 0, 1, 4});
  const LoggedCycles cycles = log.cycles();
  CHECK(cycles.lost == 0);
  REQUIRE(cycles.runs.size() == 1);
  REQUIRE(cycles.runs[0].size() == 5);
  for (std::size_t c = 0; c < 5; ++c) {
    const LoadCycle& cycle = cycles.runs[0][c];
    CHECK(cycle.loading.load_N.maxCoeff() > 14.0);
    CHECK(cycle.unloading.load_N.minCoeff() == Approx(2.0 + 13.0 * 0.09));  // the last picture, 90 ms before the end
    const double off = std::vector<double>{-2, -1, 0, 1, 4}[c];
    for (Eigen::Index k = 0; k < cycle.unloading.load_N.size(); ++k)
      CHECK(cycle.unloading.profile(0, k) == Approx(100.0 + 4.0 * cycle.unloading.load_N[k] + off).margin(1e-6));
  }
  const CycleVariation v = cycle_variation(cycles.runs);
  CHECK(v.W_cycle_DN == Approx(1.0));
  CHECK(v.from_N == Approx(3.5));
}

TEST_CASE(
    "a run whose contact is lost does not count, cycles without forces or of two segments are refused", "[cycles]") {
  const Logged lost({0, 0, 0, 1, 2}, 0.5);
  CHECK(lost.cycles().runs.empty());
  CHECK(lost.cycles().lost == 1);
  Logged log({0, 0, 0, 1, 2});
  log.session.segments.push_back(log.session.segments.back());
  CHECK_THROWS_AS(log.cycles(), InvalidArgument);
  log.session.segments.back().repetition = 1;  // another run
  CHECK(log.cycles().runs.size() == 2);
  log.wrenches.clear();
  CHECK_THROWS_AS(log.cycles(), InvalidArgument);
  log.session.segments.resize(1);
  CHECK(log.cycles().runs.empty());
}
