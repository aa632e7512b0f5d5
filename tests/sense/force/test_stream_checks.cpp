#include "catch.hpp"

#include "lumo/sense/force/finger_model.hpp"
#include "lumo/sense/force/stream_checks.hpp"
#include "lumo/sense/joints/effort_check.hpp"
#include "sense/synthetic.hpp"

using namespace lumo;
using namespace lumo::sense;

namespace {

using synthetic::ms;

const PlanarFinger two_joints({40e-3}, 50e-3);

/// Frames with and without a contact, as pictures and torques tell them.
struct CheckedScene {
  std::vector<FrameEstimate> estimates;
  std::vector<WrenchSample> wrenches;
};

struct SceneFault {
  double sign = 1.0;  ///< of the last joint's torque
  bool exchanged = false;
  bool mirrored = false;
  double sensor = 1.0;
};

template <class J> CheckedScene scene(const J& finger, int link, const SceneFault& fault, std::uint64_t seed) {
  synthetic::Normal normal(seed);
  CheckedScene s;
  const Eigen::Index n = finger.joints();
  for (int k = 0; k < 300; ++k) {
    const std::int64_t t = k * 33 * ms;
    const int press = k / 50;
    const double y = -20e-3 + 8e-3 * press, force = k % 50 < 20 ? 0.0 : 6.0 + 2.0 * normal.uniform();
    JointVector q(n);
    for (Eigen::Index j = 0; j < n; ++j) q[j] = 0.3 * std::sin(0.01 * k + double(j));
    JointVector torque = force * finger.column(q, {link, y});
    for (Eigen::Index j = 0; j < n; ++j) torque[j] += 0.01 * normal();
    torque[n - 1] *= fault.sign;
    if (fault.exchanged) {
      std::swap(q[0], q[1]);
      std::swap(torque[0], torque[1]);
    }
    FrameEstimate e;
    e.stamp_ns = t;
    e.location.contacts = force > 0.0;
    e.location.probability = 0.99;
    e.location.contact[0].y_m = (fault.mirrored ? -1.0 : 1.0) * y + 1e-3 * normal();
    Eigen::VectorXd joints(2 * n);
    joints << q, torque;
    e.joints = joints;
    s.estimates.push_back(e);
    s.wrenches.push_back({t, Vec3d(0.0, 0.0, -fault.sensor * force + 0.05 * normal()), Vec3d::Zero()});
  }
  return s;
}

TorqueAgreement agreement_of_two(const SceneFault& fault, std::uint64_t seed = 1) {
  const CheckedScene s = scene(two_joints, 1, fault, seed);
  return torque_agreement(std::span<const FrameEstimate>(s.estimates), two_joints, PadRange{1}, 0.01);
}

/// Profiles of a finger that is touched from frame 20 on, every other second, at one place.
std::vector<Profile> pressed_profiles(std::uint64_t seed, double dimming = 0.0) {
  synthetic::Normal normal(seed);
  const Eigen::VectorXd at = LongitudinalBins::uniform(-27.5e-3, 27.5e-3, 55).centres_m();
  std::vector<Profile> list;
  for (int k = 0; k < 300; ++k) {
    Profile p;
    p.stamp_ns = k * 33 * ms;
    const double lamps = 1.0 - dimming * k / 300.0 + 0.01 * normal(), height = k >= 20 && k / 30 % 2 == 1 ? 25.0 : 0.0;
    p.value.resize(55);
    for (Eigen::Index i = 0; i < 55; ++i)
      p.value[i] = lamps * (30.0 + 8.0 * std::sin(0.3 * double(i))) + 0.2 * normal() +
                   height * (std::exp(-0.5 * std::pow((at[i] - 7e-3) / 4e-3, 2)) -
                                0.15 * std::exp(-0.5 * std::pow((at[i] + 15e-3) / 4e-3, 2)));
    list.push_back(p);
  }
  return list;
}

std::optional<TouchedReference> touched_in(const std::vector<Profile>& list, int from, int to) {
  UnloadedReference reference;
  for (int k = from; k < to; ++k) reference.add(list[std::size_t(k)]);
  return touched_reference(list, LongitudinalBins::uniform(-27.5e-3, 27.5e-3, 55).centres_m(), reference);
}

}  // namespace

namespace {

/// Currents of a joint that holds and moves, through what a driver does to them.
template <class Driver> EffortCheck efforts_through(Driver driver, std::uint64_t seed = 1) {
  synthetic::Normal normal(seed);
  std::vector<JointSample> list;
  for (int i = 0; i < 4000; ++i) {
    const double current = 1.5 * std::sin(0.01 * i) + 0.05 * normal();
    list.push_back({i * 4 * ms, JointVector::Zero(1), JointVector::Zero(1),
        JointVector::Constant(1, driver(i, current)), Effort::current_A});
  }
  return check_effort(list, 0);
}

}  // namespace

TEST_CASE("efforts of a motor raise no alarm, over fifty seeds and through a driver of few bits", "[checks]") {
  for (std::uint64_t seed = 1; seed <= 50; ++seed)
    for (const double step : {0.0, 0.02}) {
      const EffortCheck check =
          efforts_through([&](int, double a) { return step > 0.0 ? step * std::round(a / step) : a; }, seed);
      INFO("seed " << seed << ", step " << step);
      CHECK_FALSE(check.never_changes);
      CHECK_FALSE(check.milli);
      CHECK_FALSE(check.wraps);
      CHECK(check.at_limit == 0.0);
      CHECK(check.stuck_share == 0.0);
    }
}

TEST_CASE("efforts in mA, of 16 bits without a sign, at a limit or stuck are named", "[checks]") {
  CHECK(efforts_through([](int, double a) { return 1000.0 * a; }).milli);
  CHECK(efforts_through([](int, double a) { return std::fmod(std::round(1000.0 * a) + 65536.0, 65536.0); }).wraps);
  const EffortCheck limited = efforts_through([](int, double a) { return std::clamp(a, -1.2, 1.2); });
  CHECK(std::abs(limited.limit) == 1.2);
  CHECK(limited.at_limit > 0.1);
  CHECK(efforts_through([](int i, double a) { return i > 1000 && i < 2000 ? 0.5 : a; }).stuck_share ==
        Approx(0.25).margin(0.01));
  CHECK(efforts_through([](int, double) { return 0.0; }).never_changes);
  CHECK_THROWS_AS(efforts_through([](int, double) { return 1e300; }), InvalidArgument);
}

TEST_CASE("torques that fit the contacts seen raise no alarm, over fifty seeds", "[checks]") {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    const TorqueAgreement two = agreement_of_two({}, seed);
    INFO("seed " << seed);
    CHECK(two.contacts == 180);
    CHECK(two.reversed.empty());
    CHECK(two.better_order.empty());
    CHECK_FALSE(two.mirrored);
    const CheckedScene s = scene(two_joints, 1, {}, seed);
    CHECK_FALSE(force_falls_in_contacts(s.estimates, Session{}, s.wrenches));
  }
}

TEST_CASE("a motor's sign, the order of joints and a mirrored view are seen in contacts", "[checks]") {
  CHECK(agreement_of_two({.sign = -1.0}).reversed == std::vector<int>{1});
  CHECK(agreement_of_two({.exchanged = true}).better_order == std::vector<int>{1, 0});
  CHECK(agreement_of_two({.mirrored = true}).mirrored);
  const MomentArm one{55e-3};
  const CheckedScene s = scene(one, 0, {.sign = -1.0}, 1);
  CHECK(torque_agreement(std::span<const FrameEstimate>(s.estimates), one, PadRange{}, 0.01).reversed ==
        std::vector<int>{0});
  const CheckedScene few{{s.estimates.begin(), s.estimates.begin() + 30}, {}};
  CHECK(torque_agreement(std::span<const FrameEstimate>(few.estimates), one, PadRange{}, 0.01).reversed.empty());
}

TEST_CASE("torque where pictures see no contact shows joints that were learnt in one", "[checks]") {
  const auto left = [](double learnt_Nm, std::uint64_t seed) {
    CheckedScene s = scene(two_joints, 1, {}, seed);
    for (FrameEstimate& e : s.estimates) e.joints->tail(1).array() -= learnt_Nm;
    return torque_without_contact(std::span<const FrameEstimate>(s.estimates), two_joints, 0.01, 0);
  };
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    CHECK_FALSE(left(0.0, seed));
    CHECK_FALSE(left(0.1, seed));  // may stick
    REQUIRE(left(0.5, seed));
    CHECK(*left(0.5, seed) == Approx(-0.5).margin(0.01));
  }
  const CheckedScene s = scene(two_joints, 1, {}, 1);
  CHECK_FALSE(torque_without_contact(std::span<const FrameEstimate>(s.estimates), two_joints, 0.01, 1'000'000'000'000));
}

TEST_CASE("one joint and a force sensor show a mirrored view, and torques out of all proportion", "[checks]") {
  const MomentArm one{55e-3};
  const auto agreement = [&](const CheckedScene& s) {
    return sensor_agreement(s.estimates, one, Session{}, s.wrenches);
  };
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    const CheckedScene good = scene(one, 0, {}, seed);
    INFO("seed " << seed);
    CHECK_FALSE(agreement(good).mirrored);
    CHECK(agreement(good).scale == 1.0);
    CHECK(agreement(scene(one, 0, {.mirrored = true}, seed)).mirrored);
    for (const double factor : {0.1, 4.0, 1000.0}) {  // a gear left out, counted twice; mN·m
      CheckedScene other = good;
      for (FrameEstimate& e : other.estimates)
        if (e.joints) e.joints->tail(1) *= factor;
      CHECK(agreement(other).scale == Approx(factor).epsilon(0.1));
    }
  }
  CHECK(agreement({scene(one, 0, {}, 1).estimates, {}}).scale == 1.0);
}

TEST_CASE("a force sensor that reports the finger's force falls in contacts", "[checks]") {
  const CheckedScene s = scene(two_joints, 1, {.sensor = -1.0}, 1);
  CHECK(force_falls_in_contacts(s.estimates, Session{}, s.wrenches));
  CHECK_FALSE(force_falls_in_contacts(s.estimates, Session{}, {}));
}

TEST_CASE("a reference that was touched shows as darkness at one place later", "[checks]") {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    INFO("seed " << seed);
    CHECK_FALSE(touched_in(pressed_profiles(seed), 0, 20));
    CHECK_FALSE(touched_in(pressed_profiles(seed, 0.15), 0, 20));  // lamps dim as a whole
    const auto touched = touched_in(pressed_profiles(seed), 35, 55);
    REQUIRE(touched);
    CHECK(touched->y_m == Approx(7e-3).margin(2e-3));
    CHECK(touched->darker_DN == Approx(25.0).epsilon(0.2));
  }
}

TEST_CASE("joints are learnt from what is said to be free, never from holds", "[joints]") {
  Recording log;
  log.path = "log";
  log.session.joint_to_origin_m = 55e-3;
  synthetic::Normal normal(3);
  const auto add = [&](std::int64_t from_ms, std::int64_t to_ms, double load) {
    for (std::int64_t t = from_ms; t < to_ms; t += 4)
      log.joints.push_back({t * ms, JointVector::Constant(1, 0.1), JointVector::Constant(1, 0.001),
          JointVector::Constant(1, 0.03 + 0.055 * load + 0.005 * normal()), Effort::torque_Nm});
  };
  add(0, 4000, 10.0);
  add(4000, 5000, 0.0);
  add(5000, 6000, 5.0);
  Segment hold{0, 3900 * ms, SegmentKind::hold};
  log.session.segments = {
      hold, {4000 * ms, 4999 * ms, SegmentKind::unloaded}, {6000 * ms, 7000 * ms, SegmentKind::unloaded}};
  const UnloadedStretch rest = UnloadedStretch::of(log.session, 0);
  CHECK(samples_without_contact(log, rest).first.size() == 250);
  CHECK(unloaded_joints(log, rest).torque[0].unloaded(0.1, 0.0) == Approx(0.03).margin(2e-3));

  log.session.segments.clear();
  const UnloadedStretch chosen{{4000 * ms, 4999 * ms}, true};
  CHECK(samples_without_contact(log, chosen).first.size() == 250);
  const UnloadedStretch first = UnloadedStretch::of(log.session, 0);
  CHECK(samples_without_contact(log, first).first.size() == 126);
}

TEST_CASE("what sticks is measured at later rests where the first ones are too few, and else assumed", "[joints]") {
  constexpr double sticks = 0.06;
  double squares = 0.0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Recording log;
    log.path = "log";
    log.session.joint_to_origin_m = 55e-3;
    synthetic::Normal normal(seed);
    for (int rest = 0; rest < 12; ++rest) {
      const double stuck = sticks * normal();
      log.session.segments.push_back({rest * 3000 * ms, (rest * 3000 + 999) * ms, SegmentKind::unloaded});
      for (std::int64_t t = rest * 3000; t < rest * 3000 + 1000; t += 4)
        log.joints.push_back({t * ms, JointVector::Constant(1, 0.1), JointVector::Constant(1, 0.001),
            JointVector::Constant(1, 0.03 + stuck + 0.005 * normal()), Effort::torque_Nm});
    }
    const UnloadedStretch rest = UnloadedStretch::of(log.session, 0);
    const UntouchedSamples untouched = samples_without_contact(log, rest);
    CHECK(untouched.first.size() == 250);
    CHECK(untouched.later.size() == 11 * 250);
    const double found = unloaded_joints(log, rest).standstill_Nm[0];
    squares += found * found / 20.0;

    log.session.segments.resize(3);  // two later rests are too few for a scatter
    CHECK(unloaded_joints(log, rest).standstill_Nm[0] == JointIdentification{}.assumed_standstill_Nm);
  }
  // The next contact sticks otherwise, and so did the rest that the model is from.
  CHECK(std::sqrt(squares) == Approx(std::sqrt(2.0) * sticks).epsilon(0.25));
}

TEST_CASE(
    "without segments joints are learnt up to the first contact seen, and what is far off is left out", "[joints]") {
  Recording log;
  log.path = "log";
  log.session.joint_to_origin_m = 55e-3;
  synthetic::Normal normal(4);
  for (std::int64_t t = 0; t < 12000; t += 4) {
    const double v = t < 10000 ? 0.3 * std::cos(1e-3 * double(t)) : 0.0;
    const double touch = (t > 3000 && t < 4500) ? 0.5 : t > 10100 ? 0.55 : 0.0;  // a hand, then what the pictures see
    log.joints.push_back(
        {t * ms, JointVector::Constant(1, 0.3 * std::sin(1e-3 * double(t))), JointVector::Constant(1, v),
            JointVector::Constant(1, 0.04 * std::tanh(v / 0.02) + 0.03 + touch + 0.01 * normal()), Effort::torque_Nm});
  }
  std::vector<Profile> profiles;
  UnloadedReference unloaded;
  for (int k = 0; k < 360; ++k) {
    Profile p;
    p.stamp_ns = k * 33 * ms;
    p.value = Eigen::VectorXd::Constant(55, 40.0);
    for (Eigen::Index i = 0; i < 55; ++i) p.value[i] += 0.2 * normal();
    if (p.stamp_ns > 10100 * ms) p.value.segment(20, 9).array() += 25.0;
    profiles.push_back(p);
    if (k < 15) unloaded.add(p);
  }
  const UnloadedStretch rest = UnloadedStretch::of(log.session, 0);
  const UnloadedStretch learnt = joint_stretch(log.session, rest, profiles, unloaded);
  CHECK(learnt.from_ns == 0);
  CHECK(1e-9 * double(learnt.to_ns) == Approx(9.85).margin(0.05));
  const JointReference joints = unloaded_joints(log, learnt);
  CHECK(joints.left_out == Approx(0.15).margin(0.03));
  CHECK(joints.torque[0].unloaded(0.1, 0.25) == Approx(0.07).margin(4e-3));
  CHECK(joints.torque[0].unloaded(0.1, -0.25) == Approx(-0.01).margin(4e-3));

  log.session.segments = {{0, 9000 * ms, SegmentKind::free}};  // as somebody states
  CHECK(joint_stretch(log.session, rest, profiles, unloaded).to_ns == rest.to_ns);
  CHECK(unloaded_joints(log, rest).left_out == 0.0);
  log.session.segments = {{5000 * ms, 6000 * ms, SegmentKind::hold}};
  CHECK(joint_stretch(log.session, rest, profiles, unloaded).to_ns == 5000 * ms);
}
