#include "catch.hpp"

#include "lumo/sense/decode/measured_loads.hpp"
#include "sense/synthetic.hpp"

using namespace lumo;
using namespace lumo::sense;

namespace {

using synthetic::ms;

/// Three places, three re-contacts, loads of 2, 5 and 10 N; the sensor reads 0.3 N at rest.
Session held_loads() {
  Session s;
  std::int64_t t = 1000 * ms;
  s.segments.push_back({0, t - 1, SegmentKind::unloaded});
  for (int place = 0; place < 3; ++place)
    for (int repetition = 0; repetition < 3; ++repetition)
      for (const double load : {2.0, 5.0, 10.0}) {
        Segment g{t, t + 400 * ms, SegmentKind::hold, place, 10.0 * place, repetition};
        g.load_N = load;
        s.segments.push_back(g);
        t += 500 * ms;
      }
  return s;
}

std::vector<WrenchSample> sensed(const Session& session, double share, std::uint64_t seed = 1) {
  synthetic::Normal normal(seed);
  std::vector<WrenchSample> list;
  for (std::int64_t t = 0; t < session.segments.back().to_ns; t += 10 * ms) {
    double load = 0.0;
    for (const Segment& g : session.segments)
      if (g.kind == SegmentKind::hold && g.holds(t)) load = g.load_N;
    list.push_back({t, Vec3d(0.0, 0.0, -share * load - 0.3 + 0.05 * normal()), Vec3d::Zero()});
  }
  return list;
}

}  // namespace

TEST_CASE("loads that were reached are the nominal ones, over fifty seeds", "[metrics]") {
  const Session session = held_loads();
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    const LoadCheck check = check_loads(session, sensed(session, 1.0, seed));
    CHECK(check.holds == 27);
    CHECK_FALSE(check.reversed);
    CHECK_FALSE(check.differs);
    CHECK(check.follows);
  }
  CHECK(check_loads(session, {}).holds == 0);
  CHECK_FALSE(check_loads(session, {}).follows);
}

TEST_CASE("a force sensor that is stuck or measures something else does not replace the loads", "[metrics]") {
  const Session session = held_loads();
  std::vector<WrenchSample> stuck = sensed(session, 1.0), other = stuck;
  synthetic::Normal normal(3);
  for (std::size_t k = 0; k < stuck.size(); ++k) {
    stuck[k].force_N = Vec3d(0.0, 0.0, -4.0);
    other[k].force_N = Vec3d(0.0, 0.0, -5.0 + normal());
  }
  CHECK_FALSE(check_loads(session, stuck).follows);
  CHECK_FALSE(check_loads(session, other).follows);
}

TEST_CASE("loads that scatter about the nominal ones are the measured ones", "[metrics]") {
  Session session = held_loads();
  std::vector<WrenchSample> wrenches = sensed(session, 1.0);
  synthetic::Normal normal(4);
  for (Segment& g : session.segments)
    if (g.kind == SegmentKind::hold) g.load_N *= 1.0 + 0.2 * normal();  // what the controller was asked for
  const LoadCheck check = check_loads(session, wrenches);
  CHECK(check.follows);
  CHECK(check.share == Approx(1.0).margin(0.15));
}

TEST_CASE("a force sensor of the other sign is distinguished from one that reads too little", "[metrics]") {
  const Session session = held_loads();
  const LoadCheck turned = check_loads(session, sensed(session, -1.0));
  CHECK(turned.reversed);
  CHECK_FALSE(turned.differs);
  const LoadCheck less = check_loads(session, sensed(session, 0.8));
  CHECK_FALSE(less.reversed);
  CHECK(less.differs);
  CHECK(less.share == Approx(0.8).margin(0.01));
}

TEST_CASE("slopes are per newton that pressed", "[metrics]") {
  const Session session = held_loads();
  std::vector<Profile> profiles;
  for (std::int64_t t = 0; t < session.segments.back().to_ns; t += 33 * ms) {
    Profile p;
    p.stamp_ns = t;
    p.value = Eigen::VectorXd::Constant(6, 20.0);
    for (const Segment& g : session.segments)
      if (g.kind == SegmentKind::hold && g.holds(t)) p.value[g.place] += 3.0 * 0.8 * g.load_N;
    profiles.push_back(p);
  }
  std::vector<HoldResponse> holds = hold_responses(profiles, session.segments);
  CHECK(slope_profiles(holds)[1](1, 0) == Approx(2.4));
  take_measured_loads(holds, session, sensed(session, 0.8));
  CHECK(slope_profiles(holds)[1](1, 0) == Approx(3.0).epsilon(0.01));
  take_measured_loads(holds, session, {});
  CHECK(holds.front().load_N == Approx(1.6).margin(0.02));  // without a sensor they stay as they were
}
