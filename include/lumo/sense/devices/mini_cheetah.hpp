#pragma once

#include "lumo/core/error.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>

namespace lumo::sense {

/// A number as an unsigned integer of some bits over a symmetric range: 0 is −limit, all ones is +limit.
struct FixedRange {
  double low, high;
  int bits;

  double step() const { return (high - low) / double((1u << bits) - 1u); }
  std::uint32_t pack(double v) const { return std::uint32_t(std::lround((std::clamp(v, low, high) - low) / step())); }
  double unpack(std::uint32_t n) const { return low + step() * double(n); }
};

/// The CAN protocol of the MIT mini-cheetah actuators and of the drivers that follow it. Source: B. Katz's public
/// firmware and its documentation. Widths and byte order are common; ranges differ by make and firmware and must be set
/// to the motor's.
///
/// Command, 8 bytes, most significant first: position 16 bits, velocity 12, kp 12, kd 12, feed-forward torque 12.
/// Reply, 6 bytes: number of the motor 8 bits, position 16, velocity 12, torque or current 12. Later firmware appends
/// temperature and error, which are not read.
struct MiniCheetahProtocol {
  double position_rad = 12.5;
  double velocity_rad_per_s = 65.0;
  double kp_max = 500.0;  ///< N·m/rad
  double kd_max = 5.0;    ///< N·m·s/rad
  double torque_Nm = 18.0;
  double effort = 18.0;  ///< range of the reply's last field: N·m, or A (40 in Katz's first firmware)

  struct Command {
    double position_rad = 0.0, velocity_rad_per_s = 0.0, kp = 0.0, kd = 0.0, torque_Nm = 0.0;
  };
  struct Reply {
    int motor = 0;
    double position_rad = 0.0, velocity_rad_per_s = 0.0, effort = 0.0;
    bool saturated = false;  ///< a field stands at the end of its range
  };
  using Bytes = std::array<std::uint8_t, 8>;

  static constexpr Bytes enter{0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xfc};  ///< motor on
  static constexpr Bytes leave{0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xfd};  ///< motor off
  static constexpr Bytes zero{0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xfe};   ///< here is position 0

  /// Values beyond a range are clamped to it. Throws InvalidArgument for numbers that are not finite.
  Bytes pack(const Command& c) const {
    for (const double v : {c.position_rad, c.velocity_rad_per_s, c.kp, c.kd, c.torque_Nm})
      if (!std::isfinite(v)) throw InvalidArgument("motor command: numbers must be finite");
    const std::uint32_t p = range(position_rad, 16).pack(c.position_rad),
                        v = range(velocity_rad_per_s, 12).pack(c.velocity_rad_per_s);
    const std::uint32_t kp = FixedRange{0.0, kp_max, 12}.pack(c.kp), kd = FixedRange{0.0, kd_max, 12}.pack(c.kd),
                        t = range(torque_Nm, 12).pack(c.torque_Nm);
    return {std::uint8_t(p >> 8), std::uint8_t(p & 0xff), std::uint8_t(v >> 4), std::uint8_t((v & 0xf) << 4 | kp >> 8),
        std::uint8_t(kp & 0xff), std::uint8_t(kd >> 4), std::uint8_t((kd & 0xf) << 4 | t >> 8), std::uint8_t(t & 0xff)};
  }
  /// nullopt for fewer than six bytes.
  std::optional<Reply> unpack(std::span<const std::uint8_t> b) const {
    if (b.size() < 6) return std::nullopt;
    const std::uint32_t p = std::uint32_t(b[1]) << 8 | b[2], v = std::uint32_t(b[3]) << 4 | b[4] >> 4,
                        t = std::uint32_t(b[4] & 0xf) << 8 | b[5];
    const bool full = p == 0 || p == 0xffff || v == 0 || v == 0xfff || t == 0 || t == 0xfff;
    return Reply{int(b[0]), range(position_rad, 16).unpack(p), range(velocity_rad_per_s, 12).unpack(v),
        range(effort, 12).unpack(t), full};
  }

  static FixedRange range(double limit, int bits) { return {-limit, limit, bits}; }
};

/// Throws InvalidArgument for a range that is not positive.
inline void validate(const MiniCheetahProtocol& p) {
  require_positive("motor's position range", p.position_rad, "rad");
  require_positive("motor's velocity range", p.velocity_rad_per_s, "rad/s");
  require_positive("motor's kp range", p.kp_max, "N·m/rad");
  require_positive("motor's kd range", p.kd_max, "N·m·s/rad");
  require_positive("motor's torque range", p.torque_Nm, "N·m");
  require_positive("motor's effort range", p.effort, "");
}

}  // namespace lumo::sense
