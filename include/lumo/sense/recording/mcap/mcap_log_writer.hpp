#pragma once

#include "lumo/sense/devices/frame.hpp"
#include "lumo/sense/recording/mcap/mcap_writer.hpp"
#include "lumo/sense/recording/mcap/ros_messages.hpp"
#include "lumo/sense/recording/recording.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <ostream>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace lumo::sense {

/// A picture to be written: the bytes of an image file, or pixels.
struct McapPictureData {
  std::string format;              ///< of the file: "png" or "jpeg"; empty: pixels
  std::vector<std::uint8_t> file;  ///< may be empty: a frame without pixels
  ImageView pixels;                ///< may be empty: the same
  int width = 0, height = 0;       ///< [px]; 0: not known
};

namespace detail {

/// Writes messages, each type to a topic of its own.
template <ChunkCodec Codec> class RosMessageWriter {
 public:
  RosMessageWriter(std::ostream& out, Codec codec) : file(out, "ros2", std::move(codec)) {}

  template <RosMessage M> void write(const char* topic, std::int64_t log_ns, const M& message) {
    auto channel = channels_.find(topic);
    if (channel == channels_.end())
      channel =
          channels_.emplace(topic, file.add_channel(file.add_schema(M::type, "ros2msg", M::definition()), topic, "cdr"))
              .first;
    file.write(channel->second, std::uint64_t(log_ns), to_cdr(message));
  }

  McapWriter<Codec> file;

 private:
  std::map<std::string_view, std::uint16_t> channels_;
};

inline std::vector<double> list_of(const JointVector& v) { return {v.data(), v.data() + v.size()}; }

inline std::array<double, 3> list_of(const Vec3d& v) { return {v.x(), v.y(), v.z()}; }

}  // namespace detail

/// Writes a log as an MCAP file that reads back as the same log, but for the names of pictures. `picture(k)` gives the
/// picture of frame k, in order; all of them are files, or all are pixels. Log times are on the frames' clock, headers'
/// stamps are the samples' own. The session comes first, so that a cut file has it. Throws InvalidArgument for what
/// could not be read again: stamps that do not ascend, that lie before 0 or beyond 2038, numbers that are not finite;
/// InputError where `out` fails.
template <ChunkCodec Codec = Uncompressed, class Picture>
void write_mcap_log(std::ostream& out, const Recording& log, std::string_view session_json, Picture picture,
                    Codec codec = {}) {
  enum class Kind { frame, joint, wrench, marker, photodiode };
  struct Event {
    std::int64_t log_ns;
    Kind kind;
    std::size_t index;
  };
  std::vector<Event> events;
  const auto add = [&](Kind kind, const auto& table, const ClockMap& clock) {
    std::optional<std::int64_t> last;
    for (std::size_t k = 0; k < table.size(); ++k) {
      stamp_text(table[k].stamp_ns, last);
      const std::int64_t at = clock(table[k].stamp_ns);
      if (at < 0)
        throw InvalidArgument(message("stamp ", table[k].stamp_ns, " ns is ", at,
                                      " ns on the frames' clock, in an MCAP file it must not lie before 0"));
      events.push_back({at, kind, k});
    }
  };
  add(Kind::frame, log.frames, {});
  add(Kind::joint, log.joints, log.session.joint_clock);
  add(Kind::wrench, log.wrenches, log.session.wrench_clock);
  add(Kind::marker, log.markers, log.session.wrench_clock);
  add(Kind::photodiode, log.photodiodes, {});
  std::stable_sort(events.begin(), events.end(), [](const Event& a, const Event& b) { return a.log_ns < b.log_ns; });

  const auto require = [](bool good, const char* what) {
    if (!good) throw InvalidArgument(what);
  };
  detail::RosMessageWriter<Codec> to(out, std::move(codec));
  to.file.attach("session.json", "application/json", events.empty() ? 0 : std::uint64_t(events.front().log_ns),
                 {reinterpret_cast<const std::uint8_t*>(session_json.data()), session_json.size()});
  std::optional<bool> files;
  for (const Event& e : events) switch (e.kind) {
      case Kind::frame: {
        const FrameRecord& f = log.frames[e.index];
        const RosHeader header{f.stamp_ns, "camera"};
        require(std::isfinite(f.exposure_s) && std::isfinite(f.gain) && f.exposure_s >= 0.0 && f.gain >= 0.0,
                "frame log: exposure and gain must be finite and not negative");
        const McapPictureData p = picture(e.index);
        require(files.value_or(!p.format.empty()) == !p.format.empty(),
                "pictures of a log must be all files or all pixels");
        files = !p.format.empty();
        if (*files) {
          to.write("/camera/image/compressed", e.log_ns, RosCompressedImage{header, p.format, p.file});
        } else {
          const ImageView& v = p.pixels;
          RosImage m{header, 0, 0, v.format == PixelFormat::grey ? "mono8" : "bgr8", 0, 0, {}};
          std::vector<std::uint8_t> bytes;
          if (!v.empty()) {
            m.height = std::uint32_t(v.height);
            m.width = std::uint32_t(v.width);
            m.step = m.width * std::uint32_t(channels(v.format));
            for (int y = 0; y < v.height; ++y) bytes.insert(bytes.end(), v.row(y), v.row(y) + m.step);
          }
          m.data = bytes;
          to.write("/camera/image", e.log_ns, m);
        }
        RosCameraInfo info;
        info.header = header;
        info.height = std::uint32_t(p.height);
        info.width = std::uint32_t(p.width);
        to.write("/camera/camera_info", e.log_ns, info);
        if (f.exposure_s != 0.0 || f.gain != 0.0)
          to.write("/camera/exposure", e.log_ns, FrameExposure{header, f.exposure_s, f.gain});
        break;
      }
      case Kind::joint: {
        const JointSample& s = log.joints[e.index];
        const Eigen::Index n = s.position_rad.size();
        require(n > 0 && s.velocity_rad_per_s.size() == n && s.effort.size() == n &&
                    log.joints.front().effort.size() == n && s.unit == log.joints.front().unit,
                "joint log: samples must have the same number of joints and the same kind of effort");
        require(s.position_rad.allFinite() && s.velocity_rad_per_s.allFinite() && s.effort.allFinite(),
                "a joint sample's numbers must be finite");
        const bool torque = s.unit == Effort::torque_Nm;
        RosJointState m{{s.stamp_ns, ""},
                        {},
                        detail::list_of(s.position_rad),
                        detail::list_of(s.velocity_rad_per_s),
                        torque ? detail::list_of(s.effort) : std::vector<double>()};
        for (int j = 0; j < int(n); ++j) m.name.push_back(numbered("joint", j));
        to.write("/joint_states", e.log_ns, m);
        if (!torque) to.write("/joint_currents", e.log_ns, JointCurrents{{s.stamp_ns, ""}, detail::list_of(s.effort)});
        break;
      }
      case Kind::wrench: {
        const WrenchSample& w = log.wrenches[e.index];
        require(w.force_N.allFinite() && w.torque_Nm.allFinite(), "a wrench's numbers must be finite");
        to.write("/wrench", e.log_ns,
                 RosWrenchStamped{{w.stamp_ns, "finger"}, detail::list_of(w.force_N), detail::list_of(w.torque_Nm)});
        break;
      }
      case Kind::marker: {
        const MarkerSample& m = log.markers[e.index];
        require(std::isfinite(m.displacement_m), "a marker's displacement must be finite");
        to.write("/marker", e.log_ns, MarkerDisplacement{{m.stamp_ns, "finger"}, m.displacement_m});
        break;
      }
      case Kind::photodiode: {
        const PhotodiodeSample& s = log.photodiodes[e.index];
        require(s.signal_V.size() > 0 && s.signal_V.size() == log.photodiodes.front().signal_V.size() &&
                    s.signal_V.allFinite(),
                "photodiode log: samples must have the same number of diodes, and finite signals");
        to.write("/photodiodes", e.log_ns,
                 PhotodiodeSignals{{s.stamp_ns, ""}, {s.signal_V.data(), s.signal_V.data() + s.signal_V.size()}});
        break;
      }
    }
  to.file.finish();
}

}  // namespace lumo::sense
