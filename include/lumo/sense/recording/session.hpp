#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/devices/joint_sample.hpp"
#include "lumo/sense/recording/alignment.hpp"

#include <Eigen/Core>

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

namespace lumo::sense {

/// A stretch of a log whose circumstances were known to whoever made it: what decoders learn from and metrics compare.
/// Estimators do not read it.
struct Segment {
  std::int64_t from_ns = 0, to_ns = 0;
  std::string kind = "hold";  ///< "unloaded", "approach", "hold", "cycle", "retract" or anything else
  int place = -1;             ///< number of the tested place, from 0; −1: none
  double y_mm = 0.0;          ///< of that place
  int repetition = -1;        ///< re-contact or run, from 0; −1: none
  int cycle = -1;             ///< within maintained contact
  double load_N = 0.0;
  double angle_deg = 0.0;
  double diameter_mm = 0.0;  ///< of the indenter; 0: not said
  bool operator==(const Segment&) const = default;
};

/// One link of a hand, in its own plane as a camera sees its side: y along the link towards the tip, z out of the pad.
struct HandLink {
  std::string name;
  std::vector<int> joints;  ///< that move it, by their numbers in the joint samples
  Eigen::Matrix2Xd hole_m;  ///< centres (y, z) of its mounting holes, at least two
  double hole_radius_m = 1.5_mm;
  bool z_clockwise = false;                       ///< in the image z lies clockwise of y (image rows run down)
  double y_low_m = -27.5_mm, y_high_m = 27.5_mm;  ///< the pad's side that is read
  double z_low_m = 1.0_mm, z_high_m = 8.0_mm;
};

/// Throws InvalidArgument for a link that makes no sense.
inline void validate(const HandLink& l) {
  if (l.joints.empty())
    throw InvalidArgument(message("link '", printable(l.name), "': no joint moves it, at least one must"));
  if (l.hole_m.cols() < 2 || !l.hole_m.allFinite())
    throw InvalidArgument(message("link '", printable(l.name), "': has ", l.hole_m.cols(),
                                  " mounting holes, must have at least 2, at finite places"));
  for (Eigen::Index k = 1; k < l.hole_m.cols(); ++k)
    for (Eigen::Index j = 0; j < k; ++j)
      if (const double apart = std::hypot(l.hole_m(0, k) - l.hole_m(0, j), l.hole_m(1, k) - l.hole_m(1, j));
          !(apart >= 1.0_mm && apart <= 10.0))
        throw InvalidArgument(message("link '", printable(l.name), "': mounting holes are ", 1e3 * apart,
                                      " mm apart, must be 1 to 10000 mm"));
  require_in_range("radius of a mounting hole", 1e3 * l.hole_radius_m, 0.1, 100.0, "mm");
  require_in_range("length of a link's pad", 1e3 * (l.y_high_m - l.y_low_m), 1.0, 10000.0, "mm");
  require_in_range("height of a link's pad", 1e3 * (l.z_high_m - l.z_low_m), 0.5, 10000.0, "mm");
}

/// A link of a hand, and where its holes are in the first picture, about, as somebody pointed at them.
struct SessionLink {
  HandLink link;
  Eigen::Matrix2Xd hole_px;  ///< as many as link.hole_m has
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
  double led_depth_m = 0.0;  ///< of the LEDs behind the side that the camera sees, in silicone
  double camera_distance_m =
      0.0;  ///< from that side to the camera's lens; 0: not known, which leaves the parallax of the LEDs as it is
  Eigen::Vector2d distal{1.0, 0.0};  ///< direction of the tip in the image
  double joint_to_origin_m = 0.05;   ///< from the axis of the last joint to the finger's origin
  std::vector<double>
      joint_to_joint_m;  ///< from each joint's axis to the next one's, along the finger; empty: one joint
  std::vector<double> torque_constant_Nm_per_A{1.0};  ///< of each joint, gear included
  double frame_delay_s = 0.0, joint_delay_s = 0.0;    ///< from the event to the stamp
  ClockMap joint_clock, wrench_clock;                 ///< onto the frames' clock
  std::vector<SessionLink> links;                     ///< of a hand; empty for one finger
  std::vector<Segment> segments;
};

/// How much closer together the LEDs appear than the same length on the side before them: perspective on their apparent
/// depth, which is the true one over the refractive index of silicone (1.41).
inline double led_parallax(const Session& s) {
  return s.camera_distance_m > 0.0 ? s.camera_distance_m / (s.camera_distance_m + s.led_depth_m / 1.41) : 1.0;
}

/// Throws InputError for what makes no sense; `name` stands in the message.
inline void validate(const Session& s, const std::string& name) {
  const auto require = [&](bool good, const std::string& what) {
    if (!good) throw InputError(message(name, ": ", what));
  };
  require(s.led_count >= 3 && s.led_count <= 64, message("led count is ", s.led_count, ", must lie in [3, 64]"));
  require(s.led_pitch_m > 0.0 && s.led_pitch_m < 1.0,
          message("led pitch is ", 1e3 * s.led_pitch_m, " mm, must lie in (0, 1000) mm"));
  require(s.led_depth_m >= 0.0 && s.led_depth_m <= 1.0,
          message("depth of the LEDs is ", 1e3 * s.led_depth_m, " mm, must lie in [0, 1000] mm"));
  require(s.camera_distance_m == 0.0 || (s.camera_distance_m >= 0.01 && s.camera_distance_m <= 100.0),
          message("distance of the camera is ", 1e3 * s.camera_distance_m,
                  " mm, must lie in [10, 100000] mm, or be 0 (not known)"));
  require(led_parallax(s) >= 0.5,
          message("LEDs lie ", 1e3 * s.led_depth_m, " mm deep before a camera at ", 1e3 * s.camera_distance_m,
                  " mm, must lie at most 1.41 times as deep as it is far"));
  require(std::isfinite(s.distal.norm()) && s.distal.norm() > 0.0, "distal direction must not be zero");
  require(!s.torque_constant_Nm_per_A.empty() && s.torque_constant_Nm_per_A.size() <= std::size_t(max_joints),
          message("has ", s.torque_constant_Nm_per_A.size(), " torque constants, must have 1 to ", max_joints));
  require(s.video.find('/') == std::string::npos && s.video.find('\\') == std::string::npos && s.video != "..",
          "video must be a file name beside session.json");
  require(std::isfinite(s.led_first_y_m) && std::abs(s.led_first_y_m) <= 10.0,
          message("first LED's y is ", 1e3 * s.led_first_y_m, " mm, must lie within 10000 mm"));
  require(std::abs(s.joint_to_origin_m) <= 10.0,
          message("way from joint to origin is ", 1e3 * s.joint_to_origin_m, " mm, must lie within 10000 mm"));
  require(s.joint_to_joint_m.size() < std::size_t(max_joints),
          message("has ", s.joint_to_joint_m.size(), " ways from joint to joint, must have at most ", max_joints - 1));
  for (const double l : s.joint_to_joint_m)
    require(l > 0.0 && l <= 10.0, message("way from joint to joint is ", 1e3 * l, " mm, must lie in (0, 10000] mm"));
  for (const double k : s.torque_constant_Nm_per_A)
    require(std::abs(k) >= 1e-6 && std::abs(k) <= 1e3,
            message("torque constant is ", k, " N·m/A, must lie in [1e-6, 1000] N·m/A, on either side of 0"));
  for (const double theta : s.theta_mm) require(std::isfinite(theta), "design must be finite");
  for (const double delay : {s.frame_delay_s, s.joint_delay_s})
    require(std::abs(delay) <= 10.0, message("delay is ", delay, " s, must lie within 10 s"));
  const auto stamp = [&](std::int64_t ns) {
    require(ns >= -stamp_limit_ns && ns <= stamp_limit_ns, message("stamp ", ns, " ns is beyond the range of stamps"));
  };
  for (const ClockMap& map : {s.joint_clock, s.wrench_clock}) {
    stamp(map.origin_ns);
    require(std::abs(map.offset_s) <= 4e9, message("offset of a clock is ", map.offset_s, " s, must lie within 4e9 s"));
    require(std::abs(map.drift) <= 0.1, message("drift of a clock is ", map.drift, ", must lie within 0.1"));
    require(map.residual_s >= 0.0 && std::isfinite(map.residual_s),
            message("residual of a clock is ", map.residual_s, " s, must not be negative"));
  }
  require(s.links.size() <= 16, message("has ", s.links.size(), " links, must have at most 16"));
  for (std::size_t i = 0; i < s.links.size(); ++i) {
    const auto& l = s.links[i];
    try {
      validate(l.link);
    } catch (const InvalidArgument& e) {
      require(false, message("link ", i, ": ", e.what()));
    }
    for (const int j : l.link.joints)
      require(j >= 0 && j < max_joints,
              message("link ", i, ": joint ", j, " moves it, must lie in [0, ", max_joints - 1, "]"));
    require(l.hole_px.cols() == l.link.hole_m.cols(),
            message("link ", i, ": has ", l.link.hole_m.cols(), " holes and ", l.hole_px.cols(),
                    " places of them in the picture, must have as many"));
    require(l.hole_px.allFinite() && l.hole_px.cwiseAbs().maxCoeff() <= 1e5,
            message("link ", i, ": places of holes must lie within 1e5 px"));
    const double px_per_mm =
        1e-3 * (l.hole_px.col(0) - l.hole_px.col(1)).norm() / (l.link.hole_m.col(0) - l.link.hole_m.col(1)).norm();
    require(px_per_mm >= 0.05 && px_per_mm <= 100.0, message("link ", i, ": its first two holes are seen at ",
                                                             px_per_mm, " px/mm, must lie in [0.05, 100] px/mm"));
  }
  for (std::size_t i = 0; i < s.segments.size(); ++i) {
    const Segment& g = s.segments[i];
    stamp(g.from_ns), stamp(g.to_ns);
    require(g.to_ns >= g.from_ns,
            message("segment ", i, " ends at ", g.to_ns, " ns, before it begins at ", g.from_ns, " ns"));
    for (const double v : {g.y_mm, g.load_N, g.angle_deg, g.diameter_mm})
      require(std::isfinite(v), message("numbers of segment ", i, " must be finite"));
  }
}

}  // namespace lumo::sense
