#pragma once

#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/recording/mcap/mcap_reader.hpp"
#include "lumo/sense/recording/mcap/ros_messages.hpp"
#include "lumo/sense/recording/recording.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace lumo::sense {

// A log as an MCAP file (docs/log_format.md): one topic for each table, messages of ROS 2 (CDR, schema encoding
// ros2msg), session.json as an attachment.
//
// - Image or CompressedImage: pictures; a frame's stamp is the header's
// - FrameExposure: exposure and gain of the picture of the same stamp
// - CameraInfo: size and calibration
// - JointState: joints; its effort is a torque, or empty if JointCurrents of the same stamp hold currents
// - WrenchStamped, MarkerDisplacement, PhotodiodeSignals

/// Which topics to read; empty: the only one of its kind.
struct McapTopics {
  std::string image{}, joints{}, wrench{};
};

/// Where a frame's picture lies.
struct McapPicture {
  McapEntry at;
  bool compressed = false;
};

/// Contents of an MCAP file. A file of other programs has no session: then the default one holds, and its LEDs and
/// delays must be given otherwise.
struct McapLog {
  Recording log;                        ///< with the default session; frames are named by their number
  std::string session_json;             ///< text of the attachment session.json; may be empty
  std::vector<McapPicture> pictures;    ///< of the frames
  std::optional<RosCameraInfo> camera;  ///< the first one, if one topic has them
};

/// View of a message's pixels, in its own order of colours; empty without pixels. Throws InputError for another
/// encoding or sizes that do not match.
inline ImageView view_of(const RosImage& m) {
  if (m.encoding != "mono8" && m.encoding != "bgr8" && m.encoding != "rgb8")
    throw InputError(message("pictures are of encoding '", printable(m.encoding), "', read are mono8, bgr8 and rgb8"));
  if (m.width == 0 && m.height == 0) return {};
  const PixelFormat format = m.encoding == "mono8" ? PixelFormat::grey : PixelFormat::bgr;
  if (m.width < 1 || m.height < 1 || m.width > max_image_side || m.height > max_image_side)
    throw InputError(
        message("a picture has ", m.width, " x ", m.height, " px, must have 1 to ", max_image_side, " each way"));
  const std::uint64_t row = std::uint64_t(m.width) * std::uint64_t(channels(format)),
                      needed = std::uint64_t(m.step) * (m.height - 1) + row;
  if (m.step < row) throw InputError(message("a picture's rows have ", m.step, " bytes, must have ", row));
  if (m.data.size() < needed) throw InputError(message("a picture has ", m.data.size(), " bytes, must have ", needed));
  return {m.data.data(), int(m.width), int(m.height), std::ptrdiff_t(m.step), format};
}

/// ".png" or ".jpg"; empty for any other format.
inline std::string_view picture_ending(std::span<const std::uint8_t> file) {
  const auto begins = [&](std::initializer_list<std::uint8_t> magic) {
    return file.size() > magic.size() && std::equal(magic.begin(), magic.end(), file.begin());
  };
  return begins({0x89, 'P', 'N', 'G'}) ? ".png" : begins({0xFF, 0xD8, 0xFF}) ? ".jpg" : "";
}

/// Collects a log's tables from messages.
class McapTables {
 public:
  explicit McapTables(bool has_session) : has_session_(has_session) {}

  /// A message of the type with the name `type`.
  template <RosMessage... Messages>
  void add_any(std::string_view type, std::span<const std::uint8_t> data, const McapEntry& at, std::string_view topic) {
    const auto attempt = [&]<RosMessage M>(std::type_identity<M>) {
      if (type == M::type) add(from_cdr<M>(data), at, topic);
    };
    (attempt(std::type_identity<Messages>{}), ...);
  }

  void add(const RosImage& m, const McapEntry& at, std::string_view topic) {
    view_of(m);
    add_frame(m.header, at, topic, {at, false}, ".png");
  }
  void add(const RosCompressedImage& m, const McapEntry& at, std::string_view topic) {
    const std::string_view ending = picture_ending(m.data);
    add_frame(m.header, at, topic, {at, true}, ending.empty() ? ".png" : ending);
  }
  void add(const RosCameraInfo& m, const McapEntry&, std::string_view) {
    if (!found.camera) found.camera = m;
  }
  void add(const FrameExposure& m, const McapEntry& at, std::string_view) {
    if (!(m.exposure_s >= 0.0 && m.gain >= 0.0))
      throw InputError(message("exposure is ", m.exposure_s, " s, gain ", m.gain, ", must not be negative"));
    exposures_[stamp(m.header, at)] = {finite(m.exposure_s), finite(m.gain)};
  }
  void add(const RosJointState& m, const McapEntry& at, std::string_view topic) {
    const std::size_t n = m.name.size();
    if (n < 1 || n > std::size_t(max_joints))
      throw InputError(message("has ", n, " joints, must have 1 to ", max_joints));
    if (m.position.size() != n || m.velocity.size() != n || (m.effort.size() != n && !m.effort.empty()))
      throw InputError(message("has ", n, " joints, ", m.position.size(), " positions, ", m.velocity.size(),
          " velocities and ", m.effort.size(), " efforts, must have as many"));
    if (names_.empty()) names_ = m.name;
    if (m.name != names_) throw InputError("names other joints than the messages before it");
    found.log.joints.push_back({ascending(m.header, at, topic), joint_vector(m.position), joint_vector(m.velocity),
        joint_vector(m.effort), Effort::torque_Nm});
  }
  void add(const JointCurrents& m, const McapEntry& at, std::string_view) {
    if (m.current_A.size() > std::size_t(max_joints))
      throw InputError(message("has ", m.current_A.size(), " currents, must have at most ", max_joints));
    currents_[stamp(m.header, at)] = joint_vector(m.current_A);
  }
  void add(const RosWrenchStamped& m, const McapEntry& at, std::string_view topic) {
    WrenchSample w{ascending(m.header, at, topic)};
    for (std::size_t k = 0; k < 3; ++k) {
      w.force_N[Eigen::Index(k)] = finite(m.force[k]);
      w.torque_Nm[Eigen::Index(k)] = finite(m.torque[k]);
    }
    found.log.wrenches.push_back(w);
  }
  void add(const MarkerDisplacement& m, const McapEntry& at, std::string_view topic) {
    found.log.markers.push_back({ascending(m.header, at, topic), finite(m.displacement_m)});
  }
  void add(const PhotodiodeSignals& m, const McapEntry& at, std::string_view topic) {
    PhotodiodeSample s{ascending(m.header, at, topic), Eigen::VectorXd(Eigen::Index(m.signal_V.size()))};
    for (std::size_t k = 0; k < m.signal_V.size(); ++k) s.signal_V[Eigen::Index(k)] = finite(m.signal_V[k]);
    const auto& list = found.log.photodiodes;
    if (s.signal_V.size() == 0 || (!list.empty() && list.front().signal_V.size() != s.signal_V.size()))
      throw InputError("all messages must have as many diodes, at least 1");
    found.log.photodiodes.push_back(std::move(s));
  }

  /// To be called last: joins messages of one stamp.
  void join() {
    for (FrameRecord& f : found.log.frames)
      if (const auto e = exposures_.find(f.stamp_ns); e != exposures_.end()) {
        f.exposure_s = e->second.first;
        f.gain = e->second.second;
      }
    for (JointSample& s : found.log.joints) {
      if (s.effort.size() == s.position_rad.size()) continue;
      const auto c = currents_.find(s.stamp_ns);
      if (c == currents_.end() || c->second.size() != s.position_rad.size())
        throw InputError(message("joints at ", s.stamp_ns, " ns have neither efforts nor currents"));
      s.effort = c->second;
      s.unit = Effort::current_A;
    }
    for (const JointSample& s : found.log.joints)
      if (s.unit != found.log.joints.front().unit)
        throw InputError(message("joints at ", s.stamp_ns, " ns have another kind of effort than the first ones"));
  }

  McapLog found;

 private:
  static double finite(double v) {
    if (!std::isfinite(v)) throw InputError("numbers must be finite");
    return v;
  }
  static JointVector joint_vector(const std::vector<double>& v) {
    JointVector j(static_cast<Eigen::Index>(v.size()));
    for (std::size_t k = 0; k < v.size(); ++k) j[Eigen::Index(k)] = finite(v[k]);
    return j;
  }
  /// Programs that do not set a header's stamp leave it 0; then the log's time replaces it. A log of lumo's has its
  /// stamps, 0 included.
  std::int64_t stamp(const RosHeader& h, const McapEntry& at) const {
    if (h.stamp_ns != 0 || has_session_) return h.stamp_ns;
    if (at.log_ns > std::uint64_t(stamp_limit_ns))
      throw InputError(message("log time ", at.log_ns, " ns is beyond the range of stamps"));
    return std::int64_t(at.log_ns);
  }
  std::int64_t ascending(const RosHeader& h, const McapEntry& at, std::string_view topic) {
    const std::int64_t t = stamp(h, at);
    const auto [last, first] = last_.try_emplace(std::string(topic), t);
    if (!first && t <= last->second)
      throw InputError(message("stamp ", t, " ns does not exceed the one before it, ", last->second, " ns"));
    return last->second = t;
  }
  void add_frame(const RosHeader& h, const McapEntry& at, std::string_view topic, const McapPicture& picture,
      std::string_view ending) {
    found.log.frames.push_back({ascending(h, at, topic), frame_file(found.pictures.size(), ending), 0.0, 0.0});
    found.pictures.push_back(picture);
  }

  bool has_session_;
  std::vector<std::string> names_;
  std::map<std::string, std::int64_t> last_;
  std::map<std::int64_t, std::pair<double, double>> exposures_;
  std::map<std::int64_t, JointVector> currents_;
};

/// The channels of one kind, all of one topic: the wanted one, or the only one. Throws InputError.
inline std::set<std::uint16_t> choose_topic(const std::map<std::string, std::set<std::uint16_t>>& topics,
    const std::string& wanted, const char* what, const std::string& name) {
  std::string all;
  for (const auto& t : topics) all += (all.empty() ? "" : ", ") + printable(t.first);
  if (!wanted.empty()) {
    const auto t = topics.find(wanted);
    if (t == topics.end())
      throw InputError(message(
          name, ": has no ", what, " on topic '", printable(wanted), "'", all.empty() ? "" : ", but on " + all));
    return t->second;
  }
  if (topics.size() > 1)
    throw InputError(message(name, ": has ", what, " on several topics, one must be chosen: ", all));
  return topics.empty() ? std::set<std::uint16_t>{} : topics.begin()->second;
}

namespace detail {

/// Text of the attachment session.json; empty without one.
template <ChunkCodec... Codecs> std::string attached_session(McapReader<Codecs...>& file) {
  constexpr std::uint32_t most_bytes = 64u << 20;
  std::string json;
  for (const McapAttachment& a : file.attachments())
    if (a.name == "session.json") {
      if (a.size > most_bytes)
        throw InputError(message(file.name(), ": session.json has ", a.size, " bytes, must have at most ", most_bytes));
      const std::vector<std::uint8_t> bytes = file.read(a);
      json.assign(bytes.begin(), bytes.end());
    }
  return json;
}

/// Name of the schema of a channel; empty without one.
template <ChunkCodec... Codecs> std::string_view schema_of(const McapReader<Codecs...>& file, std::uint16_t channel) {
  const auto s = file.schemas().find(file.channels().at(channel).schema);
  return s == file.schemas().end() ? std::string_view() : std::string_view(s->second.name);
}

/// The channels whose messages make a log. Throws InputError if a topic is missing or must be chosen.
template <ChunkCodec... Codecs>
std::set<std::uint16_t> log_channels(const McapReader<Codecs...>& file, const McapTopics& wanted) {
  std::set<std::uint16_t> used, channels;
  for (const McapEntry& e : file.messages()) used.insert(e.channel);
  const auto choose = [&](const char* what, const std::string& topic, std::initializer_list<std::string_view> types) {
    std::map<std::string, std::set<std::uint16_t>> topics;
    for (const std::uint16_t c : used)
      if (std::find(types.begin(), types.end(), schema_of(file, c)) != types.end())
        topics[file.channels().at(c).topic].insert(c);
    channels.merge(choose_topic(topics, topic, what, file.name()));
  };
  choose("pictures", wanted.image, {RosImage::type, RosCompressedImage::type});
  choose("joint states", wanted.joints, {RosJointState::type});
  choose("wrenches", wanted.wrench, {RosWrenchStamped::type});
  choose("exposures", "", {FrameExposure::type});
  choose("currents", "", {JointCurrents::type});
  choose("displacements", "", {MarkerDisplacement::type});
  choose("photodiodes", "", {PhotodiodeSignals::type});
  std::set<std::string_view> cameras;
  for (const std::uint16_t c : used)
    if (schema_of(file, c) == RosCameraInfo::type) cameras.insert(file.channels().at(c).topic);
  for (const std::uint16_t c : used)
    if (schema_of(file, c) == RosCameraInfo::type && cameras.size() == 1) channels.insert(c);
  return channels;
}

}  // namespace detail

/// Reads the tables of a log, and where its pictures lie; a cut file's up to the cut. Throws InputError of one line
/// with file, topic, time and reason.
template <ChunkCodec... Codecs> McapLog read_mcap_log(McapReader<Codecs...>& file, const McapTopics& wanted = {}) {
  std::string session_json = detail::attached_session(file);
  const std::set<std::uint16_t> channels = detail::log_channels(file, wanted);
  McapTables tables(!session_json.empty());
  for (const McapEntry& e : file.messages()) {
    if (!channels.contains(e.channel)) continue;
    const McapChannel& channel = file.channels().at(e.channel);
    try {
      if (channel.encoding != "cdr")
        throw InputError(message("messages are of encoding '", printable(channel.encoding), "', read is cdr"));
      const McapMessage m = file.read(e);
      tables.add_any<RosImage, RosCompressedImage, RosCameraInfo, FrameExposure, RosJointState, JointCurrents,
          RosWrenchStamped, MarkerDisplacement, PhotodiodeSignals>(
          detail::schema_of(file, e.channel), m.data, e, channel.topic);
    } catch (const InputError& error) {
      throw InputError(
          message(file.name(), ": topic ", printable(channel.topic), ", log time ", e.log_ns, " ns: ", error.what()));
    }
  }
  try {
    tables.join();
  } catch (const InputError& error) {
    throw InputError(file.name() + ": " + error.what());
  }
  tables.found.log.path = file.name();
  tables.found.session_json = std::move(session_json);
  return std::move(tables.found);
}

}  // namespace lumo::sense
