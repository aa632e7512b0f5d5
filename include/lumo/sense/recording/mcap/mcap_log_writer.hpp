#pragma once

#include "lumo/sense/devices/device.hpp"
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

/// A row of one of a log's tables, and when it is logged.
struct LogRow {
  enum class Table { frames, joints, wrenches, markers, photodiodes };
  std::int64_t log_ns;  ///< on the frames' clock
  Table table;
  std::size_t index;
};

/// The rows of all tables in the order of log times. Throws InvalidArgument for stamps that do not ascend or lie
/// before 0.
inline std::vector<LogRow> rows_in_time(const Recording& log) {
  std::vector<LogRow> rows;
  const auto add = [&](LogRow::Table table, const auto& samples, const ClockMap& clock) {
    std::optional<std::int64_t> last;
    for (std::size_t k = 0; k < samples.size(); ++k) {
      stamp_text(samples[k].stamp_ns, last);
      const std::int64_t at = clock(samples[k].stamp_ns);
      if (at < 0)
        throw InvalidArgument(message("stamp ", samples[k].stamp_ns, " ns is ", at,
            " ns on the frames' clock, in an MCAP file it must not lie before 0"));
      rows.push_back({at, table, k});
    }
  };
  add(LogRow::Table::frames, log.frames, {});
  add(LogRow::Table::joints, log.joints, log.session.joint_clock);
  add(LogRow::Table::wrenches, log.wrenches, log.session.wrench_clock);
  add(LogRow::Table::markers, log.markers, log.session.wrench_clock);
  add(LogRow::Table::photodiodes, log.photodiodes, {});
  std::stable_sort(rows.begin(), rows.end(), [](const LogRow& a, const LogRow& b) { return a.log_ns < b.log_ns; });
  return rows;
}

/// Writes the rows of a log, each as its messages. Throws InvalidArgument for what could not be read again.
template <ChunkCodec Codec> class LogMessages {
 public:
  LogMessages(RosMessageWriter<Codec>& to, const Recording& log) : to_(to), log_(log) {}

  template <class Picture> void frame(const LogRow& row, Picture& picture) {
    const FrameRecord& f = log_.frames[row.index];
    const RosHeader header{f.stamp_ns, "camera"};
    require(std::isfinite(f.exposure_s) && std::isfinite(f.gain) && f.exposure_s >= 0.0 && f.gain >= 0.0,
        "frame log: exposure and gain must be finite and not negative");
    const McapPictureData p = picture(row.index);
    const bool is_file = !p.format.empty();
    require(files_.value_or(is_file) == is_file, "pictures of a log must be all files or all pixels");
    files_ = is_file;
    if (is_file) to_.write("/camera/image/compressed", row.log_ns, RosCompressedImage{header, p.format, p.file});
    else pixels(row.log_ns, header, p.pixels);
    RosCameraInfo info;
    info.header = header;
    info.height = std::uint32_t(p.height);
    info.width = std::uint32_t(p.width);
    to_.write("/camera/camera_info", row.log_ns, info);
    if (f.exposure_s != 0.0 || f.gain != 0.0)
      to_.write("/camera/exposure", row.log_ns, FrameExposure{header, f.exposure_s, f.gain});
  }

  void joint(const LogRow& row) {
    const JointSample& s = log_.joints[row.index];
    const Eigen::Index n = s.position_rad.size();
    require(n > 0 && s.velocity_rad_per_s.size() == n && s.effort.size() == n &&
                log_.joints.front().effort.size() == n && s.unit == log_.joints.front().unit &&
                (log_.joint_names.empty() || log_.joint_names.size() == std::size_t(n)),
        "joint log: samples must have the same number of joints, one for each name, and the same kind of effort");
    require(s.position_rad.allFinite() && s.velocity_rad_per_s.allFinite() && s.effort.allFinite(),
        "a joint sample's numbers must be finite");
    const bool torque = s.unit == Effort::torque_Nm;
    RosJointState m{{s.stamp_ns, ""}, {}, list_of(s.position_rad), list_of(s.velocity_rad_per_s),
        torque ? list_of(s.effort) : std::vector<double>()};
    for (int j = 0; j < int(n); ++j)
      m.name.push_back(log_.joint_names.empty() ? numbered("joint", j) : log_.joint_names[std::size_t(j)]);
    to_.write("/joint_states", row.log_ns, m);
    if (!torque) to_.write("/joint_currents", row.log_ns, JointCurrents{{s.stamp_ns, ""}, list_of(s.effort)});
  }

  void wrench(const LogRow& row) {
    const WrenchSample& w = log_.wrenches[row.index];
    require(w.force_N.allFinite() && w.torque_Nm.allFinite(), "a wrench's numbers must be finite");
    to_.write(
        "/wrench", row.log_ns, RosWrenchStamped{{w.stamp_ns, "finger"}, list_of(w.force_N), list_of(w.torque_Nm)});
  }

  void marker(const LogRow& row) {
    const MarkerSample& m = log_.markers[row.index];
    require(std::isfinite(m.displacement_m), "a marker's displacement must be finite");
    to_.write("/marker", row.log_ns, MarkerDisplacement{{m.stamp_ns, "finger"}, m.displacement_m});
  }

  void photodiode(const LogRow& row) {
    const PhotodiodeSample& s = log_.photodiodes[row.index];
    require(s.signal_V.size() > 0 && s.signal_V.size() == log_.photodiodes.front().signal_V.size() &&
                s.signal_V.allFinite(),
        "photodiode log: samples must have the same number of diodes, and finite signals");
    to_.write("/photodiodes", row.log_ns,
        PhotodiodeSignals{{s.stamp_ns, ""}, {s.signal_V.data(), s.signal_V.data() + s.signal_V.size()}});
  }

 private:
  static void require(bool good, const char* what) {
    if (!good) throw InvalidArgument(what);
  }

  void pixels(std::int64_t log_ns, const RosHeader& header, const ImageView& v) {
    RosImage m{header, 0, 0, v.format == PixelFormat::grey ? "mono8" : "bgr8", 0, 0, {}};
    std::vector<std::uint8_t> bytes;
    if (!v.empty()) {
      m.height = std::uint32_t(v.height);
      m.width = std::uint32_t(v.width);
      m.step = m.width * std::uint32_t(channels(v.format));
      for (int y = 0; y < v.height; ++y) bytes.insert(bytes.end(), v.row(y), v.row(y) + m.step);
    }
    m.data = bytes;
    to_.write("/camera/image", log_ns, m);
  }

  RosMessageWriter<Codec>& to_;
  const Recording& log_;
  std::optional<bool> files_;  ///< whether pictures are files; empty before the first one
};

}  // namespace detail

/// Writes a log as an MCAP file that reads back as the same log, but for the names of pictures. `picture(k)` gives the
/// picture of frame k, in order; all of them are files, or all are pixels. Log times are on the frames' clock, headers'
/// stamps are the samples' own. The session comes first, so that a cut file has it. Throws InvalidArgument for what
/// could not be read again: stamps that do not ascend, that lie before 0 or beyond 2038, numbers that are not finite;
/// InputError if `out` fails.
template <ChunkCodec Codec = Uncompressed, class Picture> void write_mcap_log(
    std::ostream& out, const Recording& log, std::string_view session_json, Picture picture, Codec codec = {}) {
  using Table = detail::LogRow::Table;
  const std::vector<detail::LogRow> rows = detail::rows_in_time(log);
  detail::RosMessageWriter<Codec> to(out, std::move(codec));
  to.file.attach("session.json", "application/json", rows.empty() ? 0 : std::uint64_t(rows.front().log_ns),
      {reinterpret_cast<const std::uint8_t*>(session_json.data()), session_json.size()});
  detail::LogMessages<Codec> messages(to, log);
  for (const detail::LogRow& row : rows) {
    if (row.table == Table::frames) messages.frame(row, picture);
    if (row.table == Table::joints) messages.joint(row);
    if (row.table == Table::wrenches) messages.wrench(row);
    if (row.table == Table::markers) messages.marker(row);
    if (row.table == Table::photodiodes) messages.photodiode(row);
  }
  to.file.finish();
}

}  // namespace lumo::sense
