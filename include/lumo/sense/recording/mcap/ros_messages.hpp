#pragma once

#include "lumo/core/error.hpp"
#include "lumo/sense/recording/mcap/cdr.hpp"

#include <array>
#include <concepts>
#include <cstdint>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace lumo::sense {

// Messages of ROS 2 that a log holds, and lumo's own where ROS has none. `type` is the name of the schema,
// `definition` its text (encoding ros2msg): the fields, and behind a line of 80 '=' those of each type that they name.
// Source: the packages std_msgs, sensor_msgs and geometry_msgs of ROS 2.

namespace detail {

inline constexpr std::string_view ros_rule =
    "================================================================================\n";
inline constexpr std::string_view ros_header = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n";
inline constexpr std::string_view ros_time = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";

/// Fields, then the types below them: those given, and always the header.
inline std::string ros_definition(std::string_view fields, std::initializer_list<std::string_view> below = {}) {
  std::string t = "std_msgs/Header header\n" + std::string(fields);
  for (const std::string_view b : below) t += std::string(ros_rule) + std::string(b);
  return t + std::string(ros_rule) + std::string(ros_header) + std::string(ros_rule) + std::string(ros_time);
}

}  // namespace detail

/// std_msgs/Header. On the wire seconds are of 32 bits: from 1901 to 2038.
struct RosHeader {
  std::int64_t stamp_ns = 0;
  std::string frame_id;

  template <class Archive> static void fields(const RosHeader& self, Archive& archive) {
    std::int64_t s = self.stamp_ns / 1'000'000'000, ns = self.stamp_ns % 1'000'000'000;
    if (ns < 0) {
      --s;
      ns += 1'000'000'000;
    }
    if (s != std::int32_t(s))
      throw InvalidArgument(
          message("stamp of a message is ", self.stamp_ns, " ns, must lie within the 2147483648 s of its format"));
    archive(std::int32_t(s), std::uint32_t(ns), self.frame_id);
  }
  template <class Archive> static void fields(RosHeader& self, Archive& archive) {
    std::int32_t s = 0;
    std::uint32_t ns = 0;
    archive(s, ns, self.frame_id);
    if (ns >= 1'000'000'000) throw InputError(message("stamp has ", ns, " ns, must have fewer than 1000000000"));
    self.stamp_ns = std::int64_t(s) * 1'000'000'000 + ns;
  }
};

/// Pixels as they are: rows of `step` bytes.
struct RosImage {
  static constexpr std::string_view type = "sensor_msgs/msg/Image";
  static std::string definition() {
    return detail::ros_definition(
        "uint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n");
  }
  RosHeader header;
  std::uint32_t height = 0, width = 0;
  std::string encoding;  ///< "mono8", "bgr8", "rgb8" or one of those that lumo does not read
  std::uint8_t is_bigendian = 0;
  std::uint32_t step = 0;
  std::span<const std::uint8_t> data;  ///< of the bytes that the message was read from

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) {
    archive(s.header, s.height, s.width, s.encoding, s.is_bigendian, s.step, s.data);
  }
};

/// An image file.
struct RosCompressedImage {
  static constexpr std::string_view type = "sensor_msgs/msg/CompressedImage";
  static std::string definition() { return detail::ros_definition("string format\nuint8[] data\n"); }
  RosHeader header;
  std::string format;                  ///< "png", "jpeg", or with more words
  std::span<const std::uint8_t> data;  ///< of the bytes that the message was read from

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) {
    archive(s.header, s.format, s.data);
  }
};

struct RosRegionOfInterest {
  std::uint32_t x_offset = 0, y_offset = 0, height = 0, width = 0;
  bool do_rectify = false;

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) {
    archive(s.x_offset, s.y_offset, s.height, s.width, s.do_rectify);
  }
};

/// A camera's size, and its calibration where k[0] is not 0.
struct RosCameraInfo {
  static constexpr std::string_view type = "sensor_msgs/msg/CameraInfo";
  static std::string definition() {
    return detail::ros_definition(
        "uint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] "
        "p\nuint32 binning_x\nuint32 binning_y\n"
        "sensor_msgs/RegionOfInterest roi\n",
        {"MSG: sensor_msgs/RegionOfInterest\nuint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool "
         "do_rectify\n"});
  }
  RosHeader header;
  std::uint32_t height = 0, width = 0;
  std::string distortion_model;
  std::vector<double> d;
  std::array<double, 9> k{}, r{};
  std::array<double, 12> p{};
  std::uint32_t binning_x = 0, binning_y = 0;
  RosRegionOfInterest roi;

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) {
    archive(s.header, s.height, s.width, s.distortion_model, s.d, s.k, s.r, s.p, s.binning_x, s.binning_y, s.roi);
  }
};

/// Of joints: rad, rad/s, N·m; a list is as long as that of the names, or empty.
struct RosJointState {
  static constexpr std::string_view type = "sensor_msgs/msg/JointState";
  static std::string definition() {
    return detail::ros_definition("string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n");
  }
  RosHeader header;
  std::vector<std::string> name;
  std::vector<double> position, velocity, effort;

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) {
    archive(s.header, s.name, s.position, s.velocity, s.effort);
  }
};

/// Force [N] and torque [N·m].
struct RosWrenchStamped {
  static constexpr std::string_view type = "geometry_msgs/msg/WrenchStamped";
  static std::string definition() {
    return detail::ros_definition("geometry_msgs/Wrench wrench\n",
        {"MSG: geometry_msgs/Wrench\ngeometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n",
            "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"});
  }
  RosHeader header;
  std::array<double, 3> force{}, torque{};

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) {
    archive(s.header, s.force, s.torque);
  }
};

/// How the picture of the same stamp was taken.
struct FrameExposure {
  static constexpr std::string_view type = "lumo_msgs/msg/FrameExposure";
  static std::string definition() { return detail::ros_definition("float64 exposure_s\nfloat64 gain\n"); }
  RosHeader header;
  double exposure_s = 0.0, gain = 0.0;  ///< 0: not known

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) {
    archive(s.header, s.exposure_s, s.gain);
  }
};

/// Motors' currents [A] of the JointState of the same stamp. Its effort is then empty, because it would be a torque.
struct JointCurrents {
  static constexpr std::string_view type = "lumo_msgs/msg/JointCurrents";
  static std::string definition() { return detail::ros_definition("float64[] current_a\n"); }
  RosHeader header;
  std::vector<double> current_A;

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) { archive(s.header, s.current_A); }
};

struct MarkerDisplacement {
  static constexpr std::string_view type = "lumo_msgs/msg/MarkerDisplacement";
  static std::string definition() { return detail::ros_definition("float64 displacement_m\n"); }
  RosHeader header;
  double displacement_m = 0.0;

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) {
    archive(s.header, s.displacement_m);
  }
};

struct PhotodiodeSignals {
  static constexpr std::string_view type = "lumo_msgs/msg/PhotodiodeSignals";
  static std::string definition() { return detail::ros_definition("float64[] signal_v\n"); }
  RosHeader header;
  std::vector<double> signal_V;

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) { archive(s.header, s.signal_V); }
};

/// A message with its name and its schema.
template <class M>
concept RosMessage = CdrStruct<M, CdrReader> && CdrStruct<const M, CdrWriter> && requires(M& m) {
  { M::type } -> std::convertible_to<std::string_view>;
  { M::definition() } -> std::same_as<std::string>;
  { m.header } -> std::same_as<RosHeader&>;
};

static_assert(RosMessage<RosImage> && RosMessage<RosCompressedImage> && RosMessage<RosCameraInfo> &&
              RosMessage<RosJointState> && RosMessage<RosWrenchStamped>);
static_assert(RosMessage<FrameExposure> && RosMessage<JointCurrents> && RosMessage<MarkerDisplacement> &&
              RosMessage<PhotodiodeSignals>);

}  // namespace lumo::sense
