#include "catch.hpp"

#include "lumo/sense/joints/joint_monitor.hpp"
#include "lumo/support/socketcan.hpp"

using namespace lumo;
using namespace lumo::sense;

namespace {

std::int64_t fixed_time() { return 123; }

/// The other end of the bus: answers commands as a motor would, with position and velocity as commanded and the torque
/// as effort.
struct FakeMotor {
  int fd;
  MiniCheetahProtocol protocol;
  int enters = 0;

  void answer_all() {
    for (can_frame f{}; ::recv(fd, &f, sizeof f, MSG_DONTWAIT) == ssize_t(sizeof f);) {
      if (std::equal(f.data, f.data + 8, MiniCheetahProtocol::enter.begin())) {
        ++enters;
        continue;
      }
      can_frame r{};
      r.can_id = 0;
      r.can_dlc = 6;
      r.data[0] = std::uint8_t(f.can_id);
      r.data[1] = f.data[0];
      r.data[2] = f.data[1];
      r.data[3] = f.data[2];
      r.data[4] = std::uint8_t((f.data[3] & 0xf0) | (f.data[6] & 0x0f));
      r.data[5] = f.data[7];
      send(r);
    }
  }
  void send(const can_frame& f) const { REQUIRE(::send(fd, &f, sizeof f, 0) == ssize_t(sizeof f)); }
};

struct Bus {
  Descriptor host, motor;
  Bus() {
    int fd[2];
    REQUIRE(::socketpair(AF_UNIX, SOCK_SEQPACKET, 0, fd) == 0);
    host = Descriptor(fd[0]);
    motor = Descriptor(fd[1]);
  }
};

}  // namespace

TEST_CASE(
    "motors over a socket pair: commands go out, samples come back in the joints' order and direction", "[device]") {
  Bus bus;
  FakeMotor fake{bus.motor.get(), {}};
  MiniCheetahMotors::Config c;
  c.motors = {7, 3};
  c.sign = {1.0, -1.0};
  c.offset_rad = {0.0, 0.25};
  c.now = fixed_time;
  MiniCheetahMotors motors(std::move(bus.host), c);
  CHECK_FALSE(motors.next());
  motors.enter();
  const std::array<MiniCheetahProtocol::Command, 2> command{{{0.5, 1.0, 10.0, 1.0, 0.2}, {-1.5, 2.0, 10.0, 1.0, -0.7}}};
  motors.command(command);
  const auto send = [&](canid_t id, std::uint8_t length, std::uint8_t motor) {
    can_frame noise{};
    noise.can_id = id;
    noise.can_dlc = length;
    noise.data[0] = motor;
    fake.send(noise);
  };
  send(5, 8, 0);   // another node
  send(0, 3, 0);   // cut short
  send(0, 6, 99);  // a motor that is none of ours
  fake.answer_all();
  const auto s = motors.next();
  REQUIRE(s);
  CHECK(fake.enters == 2);
  CHECK(s->stamp_ns == 123);
  CHECK(s->unit == Effort::torque_Nm);
  CHECK((s->position_rad - Eigen::Vector2d(0.5, -1.5)).cwiseAbs().maxCoeff() < 2e-4);
  CHECK(s->velocity_rad_per_s[1] == Approx(2.0).margin(0.02));
  CHECK((s->effort - Eigen::Vector2d(0.2, -0.7)).cwiseAbs().maxCoeff() < 0.005);
  CHECK_FALSE(s->saturated);
  CHECK_FALSE(motors.next());
  for (const int motor : {1, 2}) {  // torques at the end of the range may be any that are larger
    can_frame full{};
    full.can_dlc = 6;
    full.data[0] = std::uint8_t(c.motors[std::size_t(motor - 1)]);
    full.data[1] = full.data[3] = 0x80;
    full.data[4] = motor == 1 ? 0x0f : 0x08;
    full.data[5] = 0xff;
    fake.send(full);
  }
  const auto clipped = motors.next();
  REQUIRE(clipped);
  CHECK(clipped->saturated);
  JointMonitor::Config watch;
  watch.joints = 2;
  const auto verdict = JointMonitor(watch).check(*clipped, clipped->stamp_ns);
  CHECK((verdict.faults.has(Fault::torque_saturated) && !verdict.usable));
  CHECK(motors.state() == StreamState::open);
  CHECK_THROWS_AS(motors.command(std::span(command).first(1)), InvalidArgument);

  bus.motor = Descriptor();  // unplugged
  CHECK_FALSE(motors.next());
  CHECK(motors.state() == StreamState::failed);
  motors.command(command);
  CHECK(motors.lost_commands() == 2);
}

TEST_CASE("half an answer is no sample, and a full bus does not block", "[device]") {
  Bus bus;
  FakeMotor fake{bus.motor.get(), {}};
  MiniCheetahMotors::Config c;
  c.motors = {1, 2};
  MiniCheetahMotors motors(std::move(bus.host), c);
  can_frame one{};
  one.can_dlc = 6;
  one.data[0] = 1;
  one.data[1] = 0x80;
  fake.send(one);
  CHECK_FALSE(motors.next());
  one.data[0] = 2;
  fake.send(one);
  CHECK(motors.next());
  const std::vector<MiniCheetahProtocol::Command> command(2);
  for (int k = 0; k < 5000; ++k) motors.command(command);  // nobody reads
  CHECK(motors.lost_commands() > 0);
  CHECK(motors.state() == StreamState::open);
}

TEST_CASE("no bus, bad motors: typed errors", "[device]") {
  CHECK_THROWS_AS(MiniCheetahMotors::open("no_such_bus", {}), InputError);
  CHECK_THROWS_AS(MiniCheetahMotors::open("", {}), InputError);
  CHECK_THROWS_AS(MiniCheetahMotors::open(std::string(100, 'x'), {}), InputError);
  MiniCheetahMotors::Config c;
  c.motors = {1, 1};
  CHECK_THROWS_AS(MiniCheetahMotors(Descriptor(), c), InvalidArgument);
  c.motors = {1, 2, 3};
  c.sign = {1.0, -1.0};
  CHECK_THROWS_AS(MiniCheetahMotors(Descriptor(), c), InvalidArgument);
}
