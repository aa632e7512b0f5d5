#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/alignment.hpp"
#include "lumo/sense/torque_model.hpp"

#include <Eigen/Core>

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

namespace lumo {

/// A stretch of a log whose circumstances were known to whoever made it: what decoders learn from and metrics compare. Estimators do not read it.
struct Segment {
  std::int64_t from_ns = 0, to_ns = 0;
  std::string kind = "hold";  ///< "unloaded", "approach", "hold", "cycle", "retract" or anything else
  int place = -1;             ///< number of the tested place, from 0; −1: none
  double y_mm = 0.0;          ///< of that place
  int repetition = -1;        ///< re-contact or run, from 0; −1: none
  int cycle = -1;             ///< within maintained contact
  double load_N = 0.0;
  double angle_deg = 0.0;
  double diameter_mm = 0.0;   ///< of the indenter; 0: not said
  bool operator==(const Segment&) const = default;
};

/// What session.json says.
struct Session {
  std::string title;
  std::string clock = "monotonic";  ///< on which frames are stamped
  std::string material;             ///< of the pad
  std::vector<double> theta_mm;     ///< its design; may be empty
  std::string video;                ///< file name beside session.json; empty: frames/
  int led_count = 5;
  double led_pitch_m = 11.0_mm, led_first_y_m = -22.0_mm;
  Eigen::Vector2d distal{1.0, 0.0};    ///< direction of the tip in the image
  double joint_to_origin_m = 0.05;     ///< from the joint's axis to the finger's origin
  std::vector<double> torque_constant_Nm_per_A{1.0};  ///< of each joint, gear included
  double frame_delay_s = 0.0, joint_delay_s = 0.0;    ///< from the event to the stamp
  ClockMap joint_clock, wrench_clock;  ///< onto the frames' clock
  std::vector<Segment> segments;
};

/// Throws InputError for what makes no sense; `name` stands in the message.
inline void validate(const Session& s, const std::string& name) {
  const auto require = [&](bool good, const std::string& what) {
    if (!good) throw InputError(detail::text(name, ": ", what));
  };
  require(s.led_count >= 3 && s.led_count <= 64, detail::text("led count is ", s.led_count, ", must lie in [3, 64]"));
  require(s.led_pitch_m > 0.0 && s.led_pitch_m < 1.0, detail::text("led pitch is ", 1e3 * s.led_pitch_m, " mm, must lie in (0, 1000) mm"));
  require(std::isfinite(s.distal.norm()) && s.distal.norm() > 0.0, "distal direction must not be zero");
  require(!s.torque_constant_Nm_per_A.empty() && s.torque_constant_Nm_per_A.size() <= std::size_t(max_joints),
          detail::text("has ", s.torque_constant_Nm_per_A.size(), " torque constants, must have 1 to ", max_joints));
  require(s.video.find('/') == std::string::npos && s.video.find('\\') == std::string::npos && s.video != "..", "video must be a file name beside session.json");
  for (std::size_t i = 0; i < s.segments.size(); ++i)
    require(s.segments[i].to_ns >= s.segments[i].from_ns,
            detail::text("segment ", i, " ends at ", s.segments[i].to_ns, " ns, before it begins at ", s.segments[i].from_ns, " ns"));
}

}  // namespace lumo
