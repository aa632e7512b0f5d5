#include "catch.hpp"

#include "lumo/sense/force/contact_filter.hpp"
#include "lumo/sense/joints/planar_finger.hpp"
#include "lumo/sense/joints/serial_chain.hpp"
#include "sense/synthetic.hpp"

using namespace lumo;
using namespace lumo::sense;

namespace {

constexpr double arm = 0.05;
JointVector one(double v) { return JointVector::Constant(1, v); }
const JointVector zero = JointVector::Zero(1);

ContactFilter<MomentArm>::Config config() {
  ContactFilter<MomentArm>::Config c;
  c.creep_m_per_sqrt_s = 1e-3;
  c.torque_Nm_per_sqrt_s = 0.2;
  return c;
}

}  // namespace

TEST_CASE("with a known place the filter is the closed form of a random walk seen through noise", "[filter]") {
  // Place known exactly, no offsets to speak of: the torque's variance is Riccati's fixed point, the force's that over
  // the arm squared.
  auto c = config();
  c.location_bias_m = 0.0;
  c.creep_m_per_sqrt_s = 1e-9;
  c.torque_bias_Nm = 0.0;
  c.force_prior_N = 1e6;
  ContactFilter<MomentArm> f(MomentArm{arm}, c);
  const double sigma = 0.01, dt = 1e-3;
  f.add_location(0, 0.01, 1e-14);
  for (int k = 1; k < 3000; ++k) f.add_torque(k * 1'000'000LL, one(0.06 * 5.0), one(sigma * sigma));
  const double q = c.torque_Nm_per_sqrt_s * c.torque_Nm_per_sqrt_s * dt, r = sigma * sigma;
  const double after = 0.5 * (std::sqrt(q * q + 4.0 * q * r) - q);
  const auto b = f.at(2999 * 1'000'000LL, zero);
  CHECK(b.covariance(1, 1) == Approx(after / (0.06 * 0.06)).epsilon(1e-4));
  CHECK(b.force_N == Approx(5.0).epsilon(1e-6));
  CHECK(f.at(3099 * 1'000'000LL, zero).covariance(1, 1) == Approx((after + 100.0 * q) / (0.06 * 0.06)).epsilon(1e-4));
}

TEST_CASE("late measurements give what timely ones give", "[filter]") {
  synthetic::Normal normal(3);
  ContactFilter<MomentArm> timely(MomentArm{arm}, config()), late(MomentArm{arm}, config());
  struct Frame {
    std::int64_t stamp;
    double y;
  };
  std::vector<Frame> pending;
  for (int k = 0; k < 400; ++k) {
    const std::int64_t t = k * 1'000'000LL;
    const double torque = 0.3 + 0.01 * normal();
    if (k % 33 == 0) {
      const Frame frame{t, 0.01 + 0.001 * normal()};
      timely.add_location(frame.stamp, frame.y, 1e-6);
      pending.push_back(frame);
    }
    timely.add_torque(t, one(torque), one(1e-4));
    late.add_torque(t, one(torque), one(1e-4));
    if (!pending.empty() && t - pending.front().stamp >= 45'000'000) {
      late.add_location(pending.front().stamp, pending.front().y, 1e-6);
      pending.erase(pending.begin());
    }
  }
  for (const Frame& f : pending) late.add_location(f.stamp, f.y, 1e-6);
  const auto a = timely.at(400'000'000, zero), b = late.at(400'000'000, zero);
  CHECK(a.y_m == Approx(b.y_m).epsilon(1e-12));
  CHECK(a.force_N == Approx(b.force_N).epsilon(1e-12));
  CHECK(a.covariance(1, 1) == Approx(b.covariance(1, 1)).epsilon(1e-12));
  CHECK_FALSE(late.add_location(-1, 0.0, 1e-6));
}

TEST_CASE("a measurement older than the history is refused, within it it is taken", "[filter]") {
  auto c = config();
  c.history = 8;
  ContactFilter<MomentArm> f(MomentArm{arm}, c);
  for (int k = 10; k < 40; ++k) CHECK(f.add_torque(k * 1'000'000LL, one(0.3), one(1e-4)));
  CHECK_FALSE(f.add_location(20'000'000, 0.0, 1e-6));
  CHECK(f.add_location(35'500'000, 0.01, 1e-6));
  CHECK(f.at(40'000'000, zero).y_m == Approx(0.01).margin(2e-3));
}

TEST_CASE("intervals of the filter hold what they promise when the world is as assumed", "[filter]") {
  auto c = config();
  int inside_y = 0, inside_force = 0, all = 0;
  constexpr int runs = 400;
  for (int run = 0; run < runs; ++run) {
    synthetic::Normal normal(100 + std::uint64_t(run));
    ContactFilter<MomentArm> f(MomentArm{arm}, c);
    double y = -0.02 + 0.04 * normal.uniform(), torque = 0.3 + 0.1 * normal(),
           place_bias = c.location_bias_m * normal(), torque_bias = c.torque_bias_Nm * normal();
    const double dt = 1e-3, kp = std::exp(-dt / c.location_bias_s), kt = std::exp(-dt / c.torque_bias_s);
    for (int k = 0; k < 600; ++k) {
      const std::int64_t t = k * 1'000'000LL;
      y += c.creep_m_per_sqrt_s * std::sqrt(dt) * normal();
      torque += c.torque_Nm_per_sqrt_s * std::sqrt(dt) * normal();
      place_bias = kp * place_bias + std::sqrt(1 - kp * kp) * c.location_bias_m * normal();
      torque_bias = kt * torque_bias + std::sqrt(1 - kt * kt) * c.torque_bias_Nm * normal();
      if (k % 33 == 0) f.add_location(t, y + place_bias + 5e-4 * normal(), 25e-8);
      f.add_torque(t, one(torque + torque_bias + 0.01 * normal()), one(1e-4));
    }
    const auto b = f.at(599 * 1'000'000LL, zero);
    inside_y += std::abs(b.y_m - y) < 1.6449 * std::sqrt(b.covariance(0, 0));
    inside_force += std::abs(b.force_N - torque / (arm + y)) < 1.6449 * std::sqrt(b.covariance(1, 1));
    ++all;
  }
  CHECK(double(inside_y) / all > 0.85);  // 90 % of 400: standard error 1.5 %
  CHECK(double(inside_y) / all < 0.95);
  CHECK(double(inside_force) / all > 0.85);
  CHECK(double(inside_force) / all < 0.95);
}

TEST_CASE("the torque's offset is learnt while nothing touches", "[filter]") {
  ContactFilter<MomentArm> f(MomentArm{arm}, config());
  for (int k = 0; k < 1000; ++k) {
    f.add_torque(k * 1'000'000LL, one(0.03), one(1e-4));
    if (k % 33 == 0) f.add_no_contact(k * 1'000'000LL);
  }
  const auto b = f.at(1'000'000'000, zero);
  CHECK(f.torque_offset(0) == Approx(0.03).margin(0.005));
  CHECK(std::abs(b.force_N) < 0.2);
  for (int k = 1000; k < 1400; ++k) {
    f.add_torque(k * 1'000'000LL, one(0.03 + 0.06 * 4.0), one(1e-4));
    if (k % 33 == 0) f.add_location(k * 1'000'000LL, 0.01, 1e-7);
  }
  CHECK(f.at(1'400'000'000, zero).force_N == Approx(4.0).margin(0.15));
}

TEST_CASE("two joints keep the place when the eye is closed, one does not", "[filter]") {
  Eigen::Isometry3d pad = Eigen::Isometry3d::Identity(), second = pad;
  pad.translate(Eigen::Vector3d(0, 0.045, 0));
  second.translate(Eigen::Vector3d(0, 0.07, 0));
  const SerialChain chain(
      {{Eigen::Isometry3d::Identity(), Eigen::Vector3d::UnitX(), pad}, {second, Eigen::Vector3d::UnitX(), pad}});
  ContactFilter<SerialChain>::Config c;
  c.link = 1;
  c.torque_bias_Nm = 0.002;
  c.torque_Nm_per_sqrt_s = 0.05;
  ContactFilter<SerialChain> two(chain, c);
  ContactFilter<MomentArm> single(MomentArm{arm});
  const JointVector q = JointVector::Zero(2), torque = 8.0 * chain.column(q, {1, -0.012});
  for (int k = 0; k < 1500; ++k) {
    two.add_torque(k * 1'000'000LL, torque, JointVector::Constant(2, 1e-6));
    single.add_torque(k * 1'000'000LL, one(8.0 * (arm - 0.012)), one(1e-6));
  }
  const auto b = two.at(1'500'000'000, q);
  const auto s = single.at(1'500'000'000, zero);
  CHECK(b.y_m == Approx(-0.012).margin(1.5e-3));
  CHECK(b.force_N == Approx(8.0).margin(0.3));
  CHECK(std::sqrt(b.covariance(0, 0)) < 3e-3);
  CHECK(std::sqrt(s.covariance(0, 0)) == Approx(55e-3 / std::sqrt(12.0)).epsilon(1e-3));  // nothing but the prior
}

TEST_CASE("another contact far away is taken up at once", "[filter]") {
  ContactFilter<MomentArm> f(MomentArm{arm}, config());
  for (int k = 0; k < 10; ++k) f.add_location(k * 33'000'000LL, 0.02, 1e-7);
  f.add_location(10 * 33'000'000LL, -0.02, 1e-7);
  CHECK(f.at(10 * 33'000'000LL, zero).y_m == Approx(-0.02).margin(1e-3));
}

TEST_CASE("numbers that belong to no finger do not enter the filter", "[filter]") {
  ContactFilter<MomentArm> f(MomentArm{arm}, config());
  for (const double bad : {std::nan(""), HUGE_VAL, 1e120}) {
    CHECK_THROWS_AS(f.add_torque(1, one(bad), one(1e-4)), InvalidArgument);
    CHECK_THROWS_AS(f.add_torque(1, one(0.1), one(bad)), InvalidArgument);
    CHECK_THROWS_AS(f.add_location(1, bad, 1e-6), InvalidArgument);
    CHECK_THROWS_AS(f.add_location(1, 0.0, bad), InvalidArgument);
  }
  CHECK_THROWS_AS(f.add_torque(1, one(0.1), one(0.0)), InvalidArgument);
}
