#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/recording/alignment.hpp"
#include "lumo/sense/recording/joint_names.hpp"
#include "lumo/sense/recording/sensor_axes.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace lumo::sense {

/// What is done in a stretch of a recording.
enum class SegmentKind {
  unloaded,  ///< nothing touches the finger
  dark,      ///< the same with the LEDs off
  free,      ///< a joint moves without contact
  approach,
  hold,
  cycle,
  retract,
  other  ///< a recording's own kind, see Segment::other_kind
};

inline constexpr std::array<std::string_view, 7> segment_kind_names{
    "unloaded", "dark", "free", "approach", "hold", "cycle", "retract"};

/// The kind as files name it; empty for `other`.
constexpr std::string_view to_string(SegmentKind kind) {
  return kind == SegmentKind::other ? std::string_view() : segment_kind_names[std::size_t(kind)];
}

/// The kind of this name; `other` for a name that is not listed.
constexpr SegmentKind segment_kind_from_string(std::string_view name) {
  std::size_t k = 0;
  while (k < segment_kind_names.size() && segment_kind_names[k] != name) ++k;
  return SegmentKind(k);
}

static_assert(std::size_t(SegmentKind::other) == segment_kind_names.size());

/// A stretch of a log whose circumstances its maker knew. Decoders learn from segments and metrics compare them;
/// estimators do not read them.
struct Segment {
  std::int64_t from_ns = 0, to_ns = 0;
  SegmentKind kind = SegmentKind::hold;
  int place = -1;       ///< number of the tested place, from 0; −1: none
  double y_mm = 0.0;    ///< of that place
  int repetition = -1;  ///< re-contact or run, from 0; −1: none
  int cycle = -1;       ///< within maintained contact
  double load_N = 0.0;
  double angle_deg = 0.0;
  double diameter_mm = 0.0;  ///< of the indenter; 0: unknown
  std::string other_kind{};  ///< name of a kind of the recording's own; empty for the others
  bool operator==(const Segment&) const = default;

  bool is_without_contact() const {
    return kind == SegmentKind::unloaded || kind == SegmentKind::dark || kind == SegmentKind::free;
  }
  bool holds(std::int64_t stamp_ns) const { return stamp_ns >= from_ns && stamp_ns <= to_ns; }
  /// Name of the kind as it stands in files.
  std::string kind_name() const { return kind == SegmentKind::other ? other_kind : std::string(to_string(kind)); }
  void set_kind_name(std::string name) {
    kind = segment_kind_from_string(name);
    other_kind = kind == SegmentKind::other ? std::move(name) : std::string();
  }
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

/// Throws InvalidArgument without joints or two holes, or for lengths out of range.
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
        throw InvalidArgument(message(
            "link '", printable(l.name), "': mounting holes are ", 1e3 * apart, " mm apart, must be 1 to 10000 mm"));
  require_in_range("radius of a mounting hole", 1e3 * l.hole_radius_m, 0.1, 100.0, "mm");
  require_in_range("length of a link's pad", 1e3 * (l.y_high_m - l.y_low_m), 1.0, 10000.0, "mm");
  require_in_range("height of a link's pad", 1e3 * (l.z_high_m - l.z_low_m), 0.5, 10000.0, "mm");
}

/// A link of a hand, and about where its holes are in the first picture: somebody pointed at them.
struct SessionLink {
  HandLink link;
  Eigen::Matrix2Xd hole_px;  ///< as many as link.hole_m has
};

/// Contents of session.json.
struct Session {
  std::string title;
  std::string clock = "monotonic";  ///< on which frames are stamped
  std::string material;             ///< of the pad
  std::string finger;               ///< which body the pad has, "built", "plain" or "own"; empty: not stated
  std::vector<double> theta_mm;     ///< its design; may be empty
  std::string video;                ///< file name beside session.json; empty: frames/
  int led_count = 5;
  double led_pitch_m = 11.0_mm, led_first_y_m = -22.0_mm;
  double led_depth_m = 0.0;  ///< of the LEDs behind the side that the camera sees, in silicone
  /// From that side to the camera's lens; 0: unknown, the LEDs' parallax stays as it is.
  double camera_distance_m = 0.0;
  Eigen::Vector2d distal{1.0, 0.0};  ///< direction of the tip in the image
  double joint_to_origin_m = 0.05;   ///< from the axis of the last joint to the finger's origin
  /// From each joint's axis to the next one's, along the finger; empty: one joint.
  std::vector<double> joint_to_joint_m;
  std::vector<double> torque_constant_Nm_per_A{1.0};  ///< of each joint, gear included
  /// The finger's joints from the base to the tip, by the names that joint.csv or a bag has; empty: all, as they stand.
  std::vector<std::string> joint_names;
  double frame_delay_s = 0.0, joint_delay_s = 0.0;  ///< from the event to the stamp
  ClockMap joint_clock, wrench_clock;               ///< onto the frames' clock
  SensorAxes wrench_axes;          ///< how the wrenches are to be turned; those of a Recording that was read are turned
  std::vector<SessionLink> links;  ///< of a hand; empty for one finger
  std::vector<Segment> segments;
};

/// Refractive index of silicone in the visible; assumed.
inline constexpr double silicone_index = 1.41;

/// Ratio of the LEDs' apparent pitch to the same length on the side before them: perspective on their apparent depth,
/// the true one over silicone's refractive index.
inline double led_parallax(const Session& s) {
  return s.camera_distance_m > 0.0 ? s.camera_distance_m / (s.camera_distance_m + s.led_depth_m / silicone_index) : 1.0;
}

namespace detail {

/// Checks of a session; each throws InputError with the session's name before the reason.
class SessionCheck {
 public:
  explicit SessionCheck(const std::string& name) : name_(name) {}

  void view(const Session& s) const {
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
  }

  void finger(const Session& s) const {
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
    require(s.joint_names.size() <= std::size_t(max_joints) &&
                (s.joint_names.empty() || are_column_names(s.joint_names) ||
                    std::all_of(s.joint_names.begin(), s.joint_names.end(), is_joint_number)),
        message("joint names are ", joint_list(s.joint_names), ", must be at most ", max_joints,
            ", each once, without commas, semicolons and quotes"));
    for (const double k : s.torque_constant_Nm_per_A)
      require(std::abs(k) >= 1e-6 && std::abs(k) <= 1e3,
          message("torque constant is ", k, " N·m/A, must lie in [1e-6, 1000] N·m/A, on either side of 0"));
    for (const double theta : s.theta_mm) require(std::isfinite(theta), "design must be finite");
  }

  void clocks(const Session& s) const {
    for (const double delay : {s.frame_delay_s, s.joint_delay_s})
      require(std::abs(delay) <= 10.0, message("delay is ", delay, " s, must lie within 10 s"));
    for (const ClockMap& map : {s.joint_clock, s.wrench_clock}) {
      stamp(map.origin_ns);
      require(
          std::abs(map.offset_s) <= 4e9, message("offset of a clock is ", map.offset_s, " s, must lie within 4e9 s"));
      require(std::abs(map.drift) <= 0.1, message("drift of a clock is ", map.drift, ", must lie within 0.1"));
      require(map.residual_s >= 0.0 && std::isfinite(map.residual_s),
          message("residual of a clock is ", map.residual_s, " s, must not be negative"));
    }
  }

  void link(const SessionLink& l, std::size_t i) const {
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
    require(px_per_mm >= 0.05 && px_per_mm <= 100.0,
        message("link ", i, ": its first two holes are seen at ", px_per_mm, " px/mm, must lie in [0.05, 100] px/mm"));
  }

  void segment(const Segment& g, std::size_t i) const {
    stamp(g.from_ns);
    stamp(g.to_ns);
    require(g.to_ns >= g.from_ns,
        message("segment ", i, " ends at ", g.to_ns, " ns, before it begins at ", g.from_ns, " ns"));
    for (const double v : {g.y_mm, g.load_N, g.angle_deg, g.diameter_mm})
      require(std::isfinite(v), message("numbers of segment ", i, " must be finite"));
  }

  void require(bool good, const std::string& what) const {
    if (!good) throw InputError(message(name_, ": ", what));
  }

 private:
  void stamp(std::int64_t ns) const {
    require(ns >= -stamp_limit_ns && ns <= stamp_limit_ns, message("stamp ", ns, " ns is beyond the range of stamps"));
  }

  const std::string& name_;
};

}  // namespace detail

/// Throws InputError for a value out of its range; `name` stands in the message.
inline void validate(const Session& s, const std::string& name) {
  const detail::SessionCheck check(name);
  check.view(s);
  check.finger(s);
  check.clocks(s);
  check.require(s.links.size() <= 16, message("has ", s.links.size(), " links, must have at most 16"));
  for (std::size_t i = 0; i < s.links.size(); ++i) check.link(s.links[i], i);
  for (std::size_t i = 0; i < s.segments.size(); ++i) check.segment(s.segments[i], i);
}

}  // namespace lumo::sense
