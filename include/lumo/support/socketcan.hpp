#pragma once

// Adapter to Linux' SocketCAN: motors that speak the MIT mini-cheetah protocol. It has not met a CAN bus yet: there was
// none where it was written. Tested over a socket pair with a motor made in software.

#include "lumo/core/error.hpp"
#include "lumo/core/stopwatch.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/devices/mini_cheetah.hpp"
#include "lumo/support/process/process.hpp"

#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace lumo {

/// Motors on one CAN bus as an actuator. They answer commands only: `command` is to be called at the rate at which
/// samples are wanted; the answers are collected by `next`, which gives a sample when all motors have answered since
/// the last one. Samples are stamped when they are read, on CLOCK_MONOTONIC.
class MiniCheetahMotors {
 public:
  struct Config {
    std::vector<int> motors{1};                     ///< CAN identifiers, in the order of the joints
    sense::MiniCheetahProtocol protocol;            ///< of all
    sense::Effort unit = sense::Effort::torque_Nm;  ///< of the answer's last field
    int host = 0;                                   ///< identifier of the answers
    std::vector<double> sign{1.0};                  ///< of each joint's direction (one for all, or one each)
    std::vector<double> offset_rad{0.0};            ///< the motor's position where the joint is at 0
    std::int64_t (*now)() = steady_ns;
  };

  /// On an interface such as "can0", which must be up. Throws InputError.
  static MiniCheetahMotors open(const std::string& interface, const Config& config) {
    Descriptor socket(::socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC, CAN_RAW));
    if (socket.get() < 0) throw InputError(message(interface, ": no CAN sockets here: ", std::strerror(errno)));
    ifreq request{};
    if (interface.empty() || interface.size() >= sizeof request.ifr_name)
      throw InputError(message("CAN interface '", interface.substr(0, 40), "': no such interface"));
    std::copy(interface.begin(), interface.end(), request.ifr_name);
    if (::ioctl(socket.get(), SIOCGIFINDEX, &request) < 0)
      throw InputError(message(interface, ": no such CAN interface: ", std::strerror(errno)));
    sockaddr_can address{};
    address.can_family = AF_CAN;
    address.can_ifindex = request.ifr_ifindex;
    if (::bind(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) < 0)
      throw InputError(message(interface, ": cannot be bound: ", std::strerror(errno)));
    return MiniCheetahMotors(std::move(socket), config);
  }

  /// On a socket that carries one CAN frame in each packet. Throws InvalidArgument for a configuration that contradicts
  /// itself.
  MiniCheetahMotors(Descriptor socket, Config config) : socket_(std::move(socket)), config_(std::move(config)) {
    const std::size_t n = config_.motors.size();
    require_in_range("number of motors", double(n), 1.0, sense::max_joints, "");
    if (config_.sign.size() == 1) config_.sign.resize(n, config_.sign[0]);
    if (config_.offset_rad.size() == 1) config_.offset_rad.resize(n, config_.offset_rad[0]);
    if (config_.sign.size() != n || config_.offset_rad.size() != n)
      throw InvalidArgument(message("motors: ", n, " identifiers, ", config_.sign.size(), " signs and ",
          config_.offset_rad.size(), " offsets, must be as many"));
    for (std::size_t i = 0; i < n; ++i) {
      require_in_range("motor's CAN identifier", config_.motors[i], 0.0, 255.0, "");
      if (std::count(config_.motors.begin(), config_.motors.end(), config_.motors[i]) > 1)
        throw InvalidArgument(message("motor ", config_.motors[i], " is there twice"));
      if (std::abs(config_.sign[i]) != 1.0)
        throw InvalidArgument(
            message("sign of motor ", config_.motors[i], " is ", config_.sign[i], ", must be 1 or -1"));
    }
    validate(config_.protocol);
    socket_.do_not_block();
    answer_.resize(n);
  }

  void enter() { all(sense::MiniCheetahProtocol::enter); }
  /// Motors off; they coast.
  void leave() { all(sense::MiniCheetahProtocol::leave); }
  /// Sends one command to each joint, in the joints' own directions. Nothing waits: a full queue of the bus counts as a
  /// lost command.
  void command(std::span<const sense::MiniCheetahProtocol::Command> commands) {
    if (commands.size() != config_.motors.size())
      throw InvalidArgument(message("motors: ", commands.size(), " commands for ", config_.motors.size(), " joints"));
    for (std::size_t i = 0; i < commands.size(); ++i) {
      sense::MiniCheetahProtocol::Command c = commands[i];
      c.position_rad = config_.sign[i] * c.position_rad + config_.offset_rad[i];
      c.velocity_rad_per_s *= config_.sign[i];
      c.torque_Nm *= config_.sign[i];
      send(config_.motors[i], config_.protocol.pack(c));
    }
  }

  std::optional<sense::JointSample> next() {
    while (state_ == sense::StreamState::open) {
      can_frame frame{};
      const ssize_t size = ::recv(socket_.get(), &frame, sizeof frame, MSG_DONTWAIT);
      if (size < 0 && errno == EINTR) continue;
      if (size < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return std::nullopt;
      if (size <= 0) {
        state_ = sense::StreamState::failed;
        break;
      }
      if (std::size_t(size) != sizeof frame || (frame.can_id & (CAN_EFF_FLAG | CAN_RTR_FLAG | CAN_ERR_FLAG)) ||
          int(frame.can_id & CAN_SFF_MASK) != config_.host)
        continue;
      const auto reply =
          config_.protocol.unpack(std::span<const std::uint8_t>(frame.data, std::min<std::size_t>(frame.can_dlc, 8)));
      if (!reply) continue;
      const auto motor = std::find(config_.motors.begin(), config_.motors.end(), reply->motor);
      if (motor == config_.motors.end()) continue;
      answer_[std::size_t(motor - config_.motors.begin())] = *reply;
      if (std::all_of(answer_.begin(), answer_.end(), [](const auto& a) { return a.has_value(); })) return sample();
    }
    return std::nullopt;
  }
  sense::StreamState state() const { return state_; }
  long lost_commands() const { return lost_; }

 private:
  sense::JointSample sample() {
    const auto n = Eigen::Index(answer_.size());
    sense::JointSample s{
        config_.now(), sense::JointVector(n), sense::JointVector(n), sense::JointVector(n), config_.unit};
    for (Eigen::Index i = 0; i < n; ++i) {
      auto& a = answer_[std::size_t(i)];
      const double sign = config_.sign[std::size_t(i)];
      s.position_rad[i] = sign * (a->position_rad - config_.offset_rad[std::size_t(i)]);
      s.velocity_rad_per_s[i] = sign * a->velocity_rad_per_s;
      s.effort[i] = sign * a->effort;
      s.saturated = s.saturated || a->saturated;
      a.reset();
    }
    return s;
  }
  void all(const sense::MiniCheetahProtocol::Bytes& data) {
    for (const int m : config_.motors) send(m, data);
  }
  void send(int motor, const sense::MiniCheetahProtocol::Bytes& data) {
    can_frame frame{};
    frame.can_id = canid_t(motor);
    frame.can_dlc = 8;
    std::copy(data.begin(), data.end(), frame.data);
    const ssize_t sent = ::send(socket_.get(), &frame, sizeof frame, MSG_DONTWAIT | MSG_NOSIGNAL);
    if (sent == ssize_t(sizeof frame)) return;
    ++lost_;
    if (sent >= 0) return;  // a part of a frame: errno says nothing
    if (errno != EAGAIN && errno != EWOULDBLOCK && errno != ENOBUFS && errno != EINTR)
      state_ = sense::StreamState::failed;
  }

  Descriptor socket_;
  Config config_;
  std::vector<std::optional<sense::MiniCheetahProtocol::Reply>> answer_;
  sense::StreamState state_ = sense::StreamState::open;
  long lost_ = 0;
};

static_assert(sense::Actuator<MiniCheetahMotors>);

}  // namespace lumo
