#include "catch.hpp"

#include "lumo/core/units.hpp"
#include "lumo/sense/devices/mini_cheetah.hpp"
#include "lumo/sense/force/force_baselines.hpp"
#include "lumo/sense/force/force_solution.hpp"
#include "lumo/sense/joints/planar_finger.hpp"
#include "lumo/sense/joints/serial_chain.hpp"
#include "lumo/sense/joints/torque_model.hpp"
#include "sense/synthetic.hpp"

#include <limits>

using namespace lumo;
using namespace lumo::sense;

namespace {

Eigen::Isometry3d pose(const Vec3d& at, double angle = 0.0, const Vec3d& axis = Vec3d::UnitZ()) {
  Eigen::Isometry3d p = Eigen::Isometry3d::Identity();
  p.translate(at);
  p.rotate(Eigen::AngleAxisd(angle, axis.normalized()));
  return p;
}

/// Two joints, 70 mm apart, pads 45 mm beyond their joints; the second is skewed so that nothing cancels by symmetry.
SerialChain two_links() {
  return SerialChain({{pose({0, 0, 0}), Vec3d::UnitX(), pose({0, 0.045, 0.01})},
      {pose({0.002, 0.07, 0}, 0.3, {0, 1, 1}), Vec3d(1, 0.1, 0), pose({0, 0.045, 0.008}, 0.2, Vec3d::UnitY())}});
}

JointVector angles(double a, double b) {
  JointVector q(2);
  q << a, b;
  return q;
}

}  // namespace

TEST_CASE("contact Jacobians: torque is the virtual work of the normal force, slope its derivative", "[jacobian]") {
  const SerialChain chain = two_links();
  for (const auto& q : {angles(0, 0), angles(0.4, -0.9), angles(-1.2, 2.0)})
    for (const int link : {0, 1})
      for (const double y : {-0.02, 0.0, 0.013}) {
        const ContactPoint c{link, y};
        const JointVector column = chain.column(q, c), slope = chain.slope(q, c);
        const double h = 1e-6;
        for (int j = 0; j < 2; ++j) {
          JointVector up = q, down = q;
          up[j] += h;
          down[j] -= h;
          const Vec3d moved = (chain.position(up, c) - chain.position(down, c)) / (2 * h);
          CHECK(column[j] == Approx(chain.normal(q, c).dot(moved)).margin(1e-9));
        }
        const JointVector change = (chain.column(q, {link, y + h}) - chain.column(q, {link, y - h})) / (2 * h);
        CHECK((slope - change).norm() < 1e-8);
        if (link == 0) CHECK(column[1] == 0.0);
      }
  CHECK_THROWS_AS(chain.column(angles(0, 0), {2, 0.0}), InvalidArgument);
  CHECK_THROWS_AS(SerialChain({}), InvalidArgument);
  Eigen::Isometry3d mirrored = Eigen::Isometry3d::Identity(), stretched = mirrored;
  mirrored.linear()(0, 0) = -1.0;
  stretched.linear()(1, 1) = 1.01;
  CHECK_THROWS_AS(SerialChain({{mirrored, Vec3d::UnitX(), pose({0, 0, 0})}}), InvalidArgument);
  CHECK_THROWS_AS(SerialChain({{pose({0, 0, 0}), Vec3d::UnitX(), stretched}}), InvalidArgument);
}

TEST_CASE("the moment arm is the chain's one-joint model", "[jacobian]") {
  const MomentArm arm{0.045};
  const SerialChain chain({{pose({0.1, 0.2, 0.3}, 0.5), Vec3d::UnitX(), pose({0, 0.045, 0.0})}});
  const JointVector q = JointVector::Constant(1, 0.7);
  for (const double y : {-0.02, 0.01}) {
    CHECK(arm.column(q, {0, y})[0] == Approx(chain.column(q, {0, y})[0]));
    CHECK(arm.slope(q, {0, y})[0] == Approx(chain.slope(q, {0, y})[0]));
    CHECK(arm.column(q, {0, y})[0] == Approx(0.045 + y));
  }
}

TEST_CASE("what cannot be identified is a null direction", "[identification]") {
  // Rows depend on x + 2 y and z only.
  Eigen::MatrixXd a(4, 3);
  a << 1, 2, 0, 2, 4, 1, 0, 0, 3, -1, -2, 1;
  const Eigen::VectorXd truth{{1.0, 3.0, -2.0}};
  const Identification r = identify(a, a * truth, Eigen::VectorXd::Ones(3));
  CHECK(r.rank == 2);
  CHECK_FALSE(r.complete());
  CHECK(r.null_space.cols() == 1);
  CHECK((a * r.null_space).norm() < 1e-12);
  CHECK(r.value[0] + 2.0 * r.value[1] == Approx(7.0));
  CHECK(r.value[2] == Approx(-2.0));
  // A direction that is seen, but less well than it was known: 1 ± 100 of a parameter of size 1.
  Eigen::MatrixXd weak(2, 2);
  weak << 1.0, 0.0, 0.0, 0.01;
  CHECK(identify(weak, Eigen::VectorXd::Ones(2), Eigen::VectorXd::Ones(2), 1.0, 1e-6).rank == 2);
  const Identification seen = identify(weak, Eigen::VectorXd::Ones(2), Eigen::VectorXd::Ones(2), 1.0, 1e-6, 2.0);
  CHECK(seen.rank == 1);
  CHECK(seen.value[1] == Approx(0.0).margin(1e-12));
  CHECK(identify(Eigen::MatrixXd::Zero(3, 2), Eigen::VectorXd::Ones(3), Eigen::VectorXd::Ones(2)).rank == 0);
  CHECK_THROWS_AS(identify(a, Eigen::VectorXd::Ones(3), Eigen::VectorXd::Ones(3)), InvalidArgument);
}

TEST_CASE("the covariance of an identification is that of repeated ones", "[identification]") {
  synthetic::Normal normal(7);
  Eigen::MatrixXd a(12, 2);
  for (Eigen::Index i = 0; i < 12; ++i) a.row(i) << 1.0, double(i) * 0.3;
  const Eigen::VectorXd truth{{2.0, -1.0}}, scale{{1.0, 0.1}};
  Eigen::MatrixXd scatter = Eigen::MatrixXd::Zero(2, 2);
  constexpr int trials = 5000;
  for (int t = 0; t < trials; ++t) {
    Eigen::VectorXd b = a * truth;
    for (Eigen::Index i = 0; i < 12; ++i) b[i] += 0.5 * normal();
    const Eigen::VectorXd error = identify(a, b, scale).value - truth;
    scatter += error * error.transpose() / trials;
  }
  const Eigen::MatrixXd expected = identify(a, a * truth, scale, 0.5).covariance;
  CHECK((scatter - expected).norm() < 0.06 * expected.norm());
}

TEST_CASE("forces at known places: two contacts on two joints are separated, on one they are not", "[jacobian]") {
  const SerialChain chain = two_links();
  const JointVector q = angles(0.3, 0.8);
  const std::vector<ContactPoint> points{{0, 0.01}, {1, -0.005}};
  const Eigen::VectorXd force{{4.0, 7.0}};
  const JointVector torque = contact_columns(chain, q, points) * force;
  const Identification both = solve_forces(chain, q, torque, points, 0.01);
  CHECK(both.complete());
  CHECK((both.value - force).norm() < 1e-9);
  const MomentArm arm{0.05};
  const std::vector<ContactPoint> pair{{0, -0.02}, {0, 0.01}};
  const JointVector one = JointVector::Constant(1, 4.0 * 0.03 + 7.0 * 0.06);
  const Identification less = solve_forces(arm, q.head(1), one, pair, 0.01);
  CHECK(less.rank == 1);
  CHECK(std::abs(0.03 * less.null_space(0, 0) + 0.06 * less.null_space(1, 0)) < 1e-12);
  CHECK(solve_forces(arm, q.head(1), one, std::vector<ContactPoint>{{0, -0.05}}, 0.01).rank == 0);  // on the axis
}

TEST_CASE("torque alone: two joints give place and force, one gives their product", "[jacobian]") {
  const SerialChain chain = two_links();
  const JointVector q = angles(0.3, 0.8);
  for (const double y : {-0.021, 0.004, 0.02}) {
    const JointVector torque = 6.0 * chain.column(q, {1, y});
    const auto s = solve_torque_only(chain, q, torque, {1, -27.5_mm, 27.5_mm}, 0.005);
    CHECK(s.rank == 2);
    CHECK(s.y_m == Approx(y).margin(1e-6));
    CHECK(s.force_N == Approx(6.0).epsilon(1e-4));
  }
  // The first link's contact shows in one joint only; so does any of a moment arm.
  CHECK(solve_torque_only(chain, q, 6.0 * chain.column(q, {0, 0.01}), {0, -27.5_mm, 27.5_mm}, 0.005).rank == 1);
  const MomentArm arm{0.05};
  const auto s = solve_torque_only(arm, q.head(1), JointVector::Constant(1, 0.3), {0, -27.5_mm, 27.5_mm}, 0.005);
  CHECK(s.rank == 1);
  CHECK(s.force_N == Approx(6.0));  // at the middle: the fixed-arm baseline
  const double h = 1e-6;
  CHECK((0.05 + s.y_m + h * 0.01 * s.null_direction[0]) * (s.force_N + h * s.null_direction[1]) ==
        Approx(0.3).margin(1e-10));
}

TEST_CASE("the torque-only covariance is that of repeated solutions", "[jacobian]") {
  const SerialChain chain = two_links();
  const JointVector q = angles(0.3, 0.8);
  const JointVector torque = 10.0 * chain.column(q, {1, 0.004});
  const auto exact = solve_torque_only(chain, q, torque, {1, -27.5_mm, 27.5_mm}, 0.004);
  synthetic::Normal normal(3);
  Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
  constexpr int trials = 3000;
  for (int t = 0; t < trials; ++t) {
    JointVector noisy = torque;
    for (Eigen::Index j = 0; j < 2; ++j) noisy[j] += 0.004 * normal();
    const auto s = solve_torque_only(chain, q, noisy, {1, -27.5_mm, 27.5_mm}, 0.004);
    const Eigen::Vector2d error(s.y_m - exact.y_m, s.force_N - exact.force_N);
    scatter += error * error.transpose() / trials;
  }
  CHECK(scatter(0, 0) == Approx(exact.covariance(0, 0)).epsilon(0.1));
  CHECK(scatter(1, 1) == Approx(exact.covariance(1, 1)).epsilon(0.1));
  CHECK(scatter(0, 1) == Approx(exact.covariance(0, 1)).epsilon(0.12));
}

TEST_CASE("an unloaded run gives friction, bias and weight back, a poor one states what it leaves open", "[torque]") {
  TorqueModel truth;
  truth.torque_constant_Nm_per_A = 0.9;
  truth.coulomb_Nm = 0.03;
  truth.stribeck_Nm = 0.015;
  truth.viscous_Nm_s_per_rad = 0.004;
  truth.bias_Nm = -0.012;
  truth.gravity_sin_Nm = 0.05;
  truth.gravity_cos_Nm = -0.02;
  truth.stribeck_velocity_rad_per_s = 0.25;
  truth.noise_Nm = 0.004;
  synthetic::Normal normal(12);
  const auto run = [&](auto motion, int samples) {
    std::vector<JointSample> list;
    for (int i = 0; i < samples; ++i) {
      const auto [q, v] = motion(1e-3 * i);
      const double torque = truth.unloaded(q, v) + truth.noise_Nm * normal();
      list.push_back({i * 1'000'000LL, JointVector::Constant(1, q), JointVector::Constant(1, v),
          JointVector::Constant(1, torque / 0.9), Effort::current_A});
    }
    return list;
  };
  TorqueModel start;
  start.torque_constant_Nm_per_A = 0.9;
  const auto sweep = run(
      [](double t) {
        return std::pair(
            1.2 * std::sin(0.9 * t) + 0.5 * std::sin(2.3 * t), 1.08 * std::cos(0.9 * t) + 1.15 * std::cos(2.3 * t));
      },
      12000);
  const auto full = identify_unloaded(sweep, 0, start);
  CHECK(full.linear.complete());
  CHECK(full.model.coulomb_Nm == Approx(truth.coulomb_Nm).epsilon(0.03));
  CHECK(full.model.stribeck_Nm == Approx(truth.stribeck_Nm).epsilon(0.08));
  CHECK(full.model.viscous_Nm_s_per_rad == Approx(truth.viscous_Nm_s_per_rad).epsilon(0.08));
  CHECK(full.model.bias_Nm == Approx(truth.bias_Nm).margin(1e-3));
  CHECK(full.model.gravity_sin_Nm == Approx(truth.gravity_sin_Nm).epsilon(0.02));
  CHECK(full.model.stribeck_velocity_rad_per_s == Approx(0.25).epsilon(0.1));
  CHECK(full.model.noise_Nm == Approx(truth.noise_Nm).epsilon(0.05));

  // One speed, one way, a small range: Coulomb, viscous and bias cannot be separated, nor sine and cosine of the
  // weight.
  const auto poor = identify_unloaded(run([](double t) { return std::pair(0.02 * t, 0.02 * 20.0); }, 3000), 0, start);
  CHECK_FALSE(poor.linear.complete());
  CHECK(poor.linear.rank <= 2);
  CHECK(poor.model.unloaded(0.03, 0.4) == Approx(truth.unloaded(0.03, 0.4)).margin(1e-3));  // where it ran, it predicts
  CHECK_THROWS_AS(identify_unloaded({}, 0), InvalidArgument);
  CHECK_THROWS_AS(identify_unloaded(sweep, 1), InvalidArgument);
  CHECK(truth.friction(0.0) == 0.0);
  CHECK(truth.friction(-0.4) == Approx(-truth.friction(0.4)));
  CHECK(truth.stiction_sigma(0.0) == Approx(0.045 / std::sqrt(3.0)));
  CHECK(truth.stiction_sigma(1.0) < 1e-6);
}

TEST_CASE("the motor protocol packs what its bytes say", "[motor]") {
  const MiniCheetahProtocol p;
  // By hand: 0 in a symmetric range is half of all ones, rounded: 0x8000 of 16 bits, 0x800 of 12; kp 500 is 0xfff, kd 0
  // is 0.
  CHECK(p.pack({0.0, 0.0, 500.0, 0.0, 0.0}) ==
        MiniCheetahProtocol::Bytes{0x80, 0x00, 0x80, 0x0f, 0xff, 0x00, 0x08, 0x00});
  CHECK(p.pack({-99.0, 99.0, -1.0, 5.0, 18.0}) ==
        MiniCheetahProtocol::Bytes{0x00, 0x00, 0xff, 0xf0, 0x00, 0xff, 0xff, 0xff});
  CHECK_THROWS_AS(p.pack({std::numeric_limits<double>::quiet_NaN(), 0, 0, 0, 0}), InvalidArgument);
  const std::array<std::uint8_t, 6> reply{3, 0xff, 0xff, 0x00, 0x08, 0x00};
  const auto r = p.unpack(reply);
  REQUIRE(r);
  CHECK(r->motor == 3);
  CHECK(r->position_rad == Approx(12.5));
  CHECK(r->velocity_rad_per_s == Approx(-65.0));
  CHECK(r->effort == Approx(18.0 / 4095.0));  // 0x800 of 0xfff: half a step above zero
  CHECK(r->saturated);
  CHECK_FALSE(p.unpack(std::span(reply).first(5)));
  synthetic::Normal normal(1);
  for (int k = 0; k < 200; ++k) {  // position, velocity, torque as a motor would answer
    const double x = 12.0 * (2.0 * normal.uniform() - 1.0);
    const auto b = p.pack({x, 5.0 * x, 0.0, 0.0, x});
    const std::array<std::uint8_t, 6> answer{1, b[0], b[1], b[2], std::uint8_t((b[3] & 0xf0) | (b[6] & 0x0f)), b[7]};
    const auto back = p.unpack(answer);
    CHECK(std::abs(back->position_rad - x) <= 0.5001 * 25.0 / 65535.0);
    CHECK(std::abs(back->velocity_rad_per_s - 5.0 * x) <= 0.5001 * 130.0 / 4095.0);
    CHECK(std::abs(back->effort - x) <= 0.5001 * 36.0 / 4095.0);
  }
}

TEST_CASE("baselines on the same samples: errors by hand for one joint, torque alone only for two", "[jacobian]") {
  const MomentArm arm{0.05};
  std::vector<ForceSample> samples;
  for (const double y : {-0.02, 0.02}) {  // 6 N each; the torque model errs by 0.006 N·m, the localiser by 2 mm
    ForceSample s;
    s.position_rad = JointVector::Zero(1);
    s.contact_torque_Nm = JointVector::Constant(1, 6.0 * (0.05 + y) + 0.006);
    s.estimated_y_m = y + 2e-3;
    s.true_y_m = y;
    s.true_force_N = 6.0;
    s.fused_N = 5.5;
    samples.push_back(s);
  }
  const ForceErrors e = force_errors(arm, std::span<const ForceSample>(samples), {0, -0.025, 0.025}, 0.01);
  CHECK(e.known_location.mae_N == Approx(0.5 * (0.006 / 0.03 + 0.006 / 0.07)));
  CHECK(e.optical.mae_N == Approx(0.5 * (std::abs(0.186 / 0.032 - 6.0) + std::abs(0.426 / 0.072 - 6.0))));
  CHECK(e.fixed_arm.mae_N == Approx(0.5 * (std::abs(0.186 / 0.05 - 6.0) + std::abs(0.426 / 0.05 - 6.0))));
  CHECK(e.fused.mae_N == Approx(0.5));
  CHECK(e.torque_only.samples == 0);
  CHECK(*e.recovery() == Approx((e.fixed_arm.mae_N - e.optical.mae_N) / (e.fixed_arm.mae_N - e.known_location.mae_N)));
  // A localiser that is silent on a hard sample gains nothing by it: the others are asked about the same samples.
  ForceSample hard = samples.front();
  hard.estimated_y_m.reset();
  hard.contact_torque_Nm[0] += 0.1;
  samples.push_back(hard);
  const ForceErrors silent = force_errors(arm, std::span<const ForceSample>(samples), {0, -0.025, 0.025}, 0.01);
  CHECK(silent.known_location.samples == 3);
  CHECK(silent.common.optical.samples == 2);
  CHECK(*silent.recovery() == Approx(*e.recovery()));

  const SerialChain chain = two_links();
  ForceSample s;
  s.position_rad = angles(0.3, 0.8);
  s.contact_torque_Nm = 6.0 * chain.column(s.position_rad, {1, 0.012});
  s.true_y_m = 0.012;
  s.true_force_N = 6.0;
  const ForceErrors two = force_errors(chain, std::span<const ForceSample>(&s, 1), {1, -0.025, 0.025}, 0.01);
  CHECK(two.torque_only.samples == 1);
  CHECK(two.torque_only.mae_N < 1e-3);
  CHECK(two.optical.samples == 0);
  CHECK_FALSE(two.recovery());
}

TEST_CASE("contact torques are motor minus model, on the frames' clock", "[torque]") {
  TorqueModel m;
  m.torque_constant_Nm_per_A = 0.5;
  m.bias_Nm = 0.1;
  std::vector<JointSample> samples;
  for (int i = 0; i < 5; ++i)
    samples.push_back({i * 1'000'000LL, JointVector::Constant(1, 0.1 * i), JointVector::Zero(1),
        JointVector::Constant(1, 1.0 + i), Effort::current_A});
  const ContactTorques torques(samples, {m}, ClockMap{0, 1.0, 0.0, 0.0}, 0.5e-3);
  const auto v = torques.at(1'000'000'000 + 1'000'000);  // 1.5 ms of the joints' clock
  REQUIRE(v);
  CHECK((*v)[0] == Approx(0.15));
  CHECK((*v)[1] == Approx(0.5 * 2.5 - 0.1));
  CHECK_FALSE(torques.at(0));
  CHECK_THROWS_AS(ContactTorques({}, {m}), InvalidArgument);
}

TEST_CASE("a planar finger is the serial chain of the same joints, and the moment arm with one", "[jacobian]") {
  synthetic::Normal normal(77);
  for (int joints = 1; joints <= 4; ++joints) {
    std::vector<double> ways;
    for (int k = 1; k < joints; ++k) ways.push_back(0.03 + 0.01 * k);
    const PlanarFinger finger(ways, 0.05);
    std::vector<SerialChain::Link> links(static_cast<std::size_t>(joints));
    for (int k = 1; k < joints; ++k)
      links[std::size_t(k)].joint.translation() = Vec3d(0.0, ways[std::size_t(k - 1)], 0.0);
    links.back().finger.translation() = Vec3d(0.0, 0.05, 0.0);
    const SerialChain chain(links);
    for (int trial = 0; trial < 20; ++trial) {
      JointVector q(joints);
      for (int k = 0; k < joints; ++k) q[k] = 0.5 * normal();
      const ContactPoint at{joints - 1, 0.02 * normal()};
      CHECK((finger.column(q, at) - chain.column(q, at)).norm() < 1e-12);
      CHECK((finger.slope(q, at) - chain.slope(q, at)).norm() < 1e-12);
      if (joints == 1) CHECK(finger.column(q, at)[0] == MomentArm{0.05}.column(q, at)[0]);
    }
  }
  CHECK_THROWS_AS(PlanarFinger({-0.1}, 0.05), InvalidArgument);
  CHECK_THROWS_AS(PlanarFinger({0.1}, 0.05).column(JointVector::Zero(1), {1, 0.0}), InvalidArgument);
  CHECK_THROWS_AS(PlanarFinger({0.1}, 0.05).column(JointVector::Zero(2), {0, 0.0}), InvalidArgument);
}
