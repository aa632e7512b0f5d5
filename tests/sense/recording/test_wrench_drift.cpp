#include "catch.hpp"

#include "lumo/sense/recording/log_truth.hpp"
#include "lumo/sense/recording/recording.hpp"
#include "lumo/sense/recording/wrench_drift.hpp"
#include "sense/synthetic.hpp"

using namespace lumo;
using namespace lumo::sense;

namespace {

/// Four contacts of 5 N, each after a second without load; the sensor's zero moves by `drift_N` over all of it.
Recording drifting_log(double drift_N, std::uint64_t seed, bool approaches = false) {
  synthetic::Normal normal(seed);
  Recording log;
  for (int c = 0; c < 4; ++c) {
    const std::int64_t t = 4'000'000'000LL * c;
    if (approaches) log.session.segments.push_back({t + 1'000'000'000, t + 1'400'000'000, SegmentKind::approach, c});
    else log.session.segments.push_back({t, t + 900'000'000, SegmentKind::unloaded});
    log.session.segments.push_back({t + 1'500'000'000, t + 3'000'000'000, SegmentKind::hold, c, 0.0, 0, -1, 5.0});
  }
  for (int k = 0; k < 1600; ++k) {
    const double in = std::fmod(0.01 * k, 4.0), load = in >= 1.4 && in <= 3.1 ? 5.0 : 0.0;
    log.wrenches.push_back({k * 10 * synthetic::ms,
        Vec3d(0.05 * normal(), 0.0, -load - 0.07 - drift_N * k / 1600.0 + 0.05 * normal()), Vec3d::Zero()});
  }
  return log;
}

}  // namespace

TEST_CASE("a force sensor that drifts is tared before each contact", "[log]") {
  Recording log = drifting_log(1.5, 2);
  const auto most = remove_wrench_drift(log.wrenches, log.session);
  REQUIRE(most);
  CHECK(*most == Approx(0.56).margin(0.05));  // three quarters of it, to both sides
  std::vector<WrenchTare> tares = wrench_tares(log.session, log.wrenches);
  REQUIRE(tares.size() == 4);
  for (const WrenchTare& t : tares) CHECK(t.force_N.z() == Approx(tares[0].force_N.z()).margin(0.04));
  const LogTruth truth = LogTruth::from_log(log.session, log.wrenches);
  for (int c = 0; c < 3; ++c) {
    double sum = 0.0;
    for (int k = 0; k < 100; ++k) sum += *truth.at((4000LL * c + 1600 + 10 * k) * synthetic::ms).force_N / 100.0;
    CHECK(sum == Approx(5.0).margin(0.05));
  }
}

TEST_CASE("what lies before an approach is no tare: it may be the end of another contact", "[log]") {
  Recording log = drifting_log(1.5, 2, true);
  CHECK_FALSE(remove_wrench_drift(log.wrenches, log.session));
}

TEST_CASE("a force sensor without drift keeps its samples, over fifty seeds", "[log]") {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    Recording log = drifting_log(0.0, seed);
    CHECK_FALSE(remove_wrench_drift(log.wrenches, log.session));
    const Recording before = drifting_log(0.0, seed);
    for (std::size_t k = 0; k < log.wrenches.size(); ++k) CHECK(log.wrenches[k].force_N == before.wrenches[k].force_N);
  }
  Recording none;
  CHECK_FALSE(remove_wrench_drift(none.wrenches, none.session));
}
