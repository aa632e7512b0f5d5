#pragma once

#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/devices/picture_header.hpp"
#include "lumo/sense/recording/joint_names.hpp"
#include "lumo/sense/recording/joint_velocity.hpp"
#include "lumo/sense/recording/mcap/mcap_reader.hpp"
#include "lumo/sense/recording/mcap/ros_messages.hpp"
#include "lumo/sense/recording/mcap/ros_pixels.hpp"
#include "lumo/sense/recording/recording.hpp"
#include "lumo/sense/recording/sensor_axes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <map>
#include <memory>
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
// ros2msg), session.json as an attachment. A bag of ROS 2 may have several files, which follow one another.
//
// - Image or CompressedImage: pictures; a frame's stamp is the header's
// - FrameExposure: exposure and gain of the picture of the same stamp
// - CameraInfo: size and calibration
// - JointState: joints; its effort is a torque, or empty if JointCurrents of the same stamp hold currents
// - WrenchStamped, MarkerDisplacement, PhotodiodeSignals

/// Which topics to read; empty: the only one of its kind.
struct McapTopics {
  std::string image{}, joints{}, wrench{};
  /// The finger's joints in the order of the chain, by the names that messages have. Others are not read, several
  /// publishers may share the topic, and of several topics those are read that have these joints. Empty: all messages
  /// name the finger's joints, in this order.
  std::vector<std::string> joint_names{};
  std::optional<SensorAxes> wrench_axes{};  ///< how the force sensor is mounted; empty: as the session says
};

/// A stream that is stamped on another clock than the pictures, and how log times join both.
struct JoinedClock {
  LogStream stream = LogStream::joints;
  ClockMap clock;
  std::string note;  ///< for people
};

/// Where a frame's picture lies.
struct McapPicture {
  McapEntry at;
  bool compressed = false;
  std::size_t file = 0;  ///< number of its file in a bag
};

/// Contents of an MCAP file. A file of other programs has no session: then the default one holds, and its LEDs and
/// delays must be given otherwise.
struct McapLog {
  Recording log;                        ///< with the default session; frames are named by their number
  std::string session_json;             ///< text of the attachment session.json; may be empty
  std::vector<McapPicture> pictures;    ///< of the frames
  std::optional<RosCameraInfo> camera;  ///< the first one, if one topic has them
  std::string contents;                 ///< all topics that have messages, with their types, for people
  std::vector<JoinedClock> clocks;      ///< for a session that says nothing of them; none in a log of lumo's
};

/// The files of a bag, in their order.
template <ChunkCodec... Codecs> using McapFiles = std::vector<std::shared_ptr<McapReader<Codecs...>>>;

/// Ending of the names of image files of this kind: ".png", ".jpg" or ".webp"; empty for any other.
inline std::string_view picture_ending(std::span<const std::uint8_t> file) {
  const auto begins = [&](std::initializer_list<std::uint8_t> magic) {
    return file.size() > magic.size() && std::equal(magic.begin(), magic.end(), file.begin());
  };
  if (begins({0x89, 'P', 'N', 'G'})) return ".png";
  if (begins({0xFF, 0xD8, 0xFF})) return ".jpg";
  const auto header = picture_header(file);
  return header && header->format == PictureHeader::Format::webp ? ".webp" : "";
}

/// Why a CompressedImage is none of those that are read: a video's packet, a depth picture. Empty: it is one, or it is
/// damaged. Its format says so, and its first bytes.
inline std::string packed_fault(const RosCompressedImage& m) {
  const auto says = [&](std::string_view word) { return m.format.find(word) != std::string::npos; };
  const bool depth = says("compressedDepth") || m.format.starts_with("16UC1") || m.format.starts_with("32FC1");
  if (!depth && (m.data.empty() || picture_header(m.data))) return "";
  const bool known = m.format.empty() || says("png") || says("jpeg") || says("jpg") || says("bmp") || says("webp");
  return known && !depth ? ""
                         : message("pictures are of format '", printable(m.format),
                               "', read are PNG, JPEG, BMP and WebP of 8 bits");
}

/// Stamps of one topic's messages, which only all of them tell: programs that do not set a header's stamp leave it 0,
/// and a simulator's clock begins at 0.
class TopicStamps {
 public:
  void add(std::int64_t header_ns, std::uint64_t log_ns) {
    header_.push_back(header_ns);
    log_.push_back(std::int64_t(std::min(log_ns, std::uint64_t(stamp_limit_ns))));
    set_ = set_ || header_ns != 0;
  }
  /// The headers' stamps, or where none is set the log's times. A log of lumo's has its stamps.
  const std::vector<std::int64_t>& ns(bool has_session) const { return set_ || has_session ? header_ : log_; }
  const std::vector<std::int64_t>& log_ns() const { return log_; }
  /// Median of log times less stamps; nullopt without any.
  std::optional<std::int64_t> log_less_stamp_ns(bool has_session) const {
    std::vector<std::int64_t> late;
    for (std::size_t i = 0; i < log_.size(); ++i) late.push_back(log_[i] - ns(has_session)[i]);
    if (late.empty()) return std::nullopt;
    const auto middle = late.begin() + std::ptrdiff_t(late.size() / 2);
    std::nth_element(late.begin(), middle, late.end());
    return *middle;
  }

 private:
  std::vector<std::int64_t> header_, log_;
  bool set_ = false;
};

/// Collects a log's tables from messages. What is wrong with one stream is kept as its fault, and leaves it empty.
class McapTables {
 public:
  /// `joint_names`: as McapTopics has them.
  explicit McapTables(bool has_session, std::vector<std::string> joint_names = {})
      : has_session_(has_session), chosen_(!joint_names.empty()), names_(std::move(joint_names)) {
    known_.resize(names_.size());
  }

  /// A message of the type with the name `type`.
  template <RosMessage... Messages>
  void add_any(std::string_view type, std::span<const std::uint8_t> data, const McapPicture& at) {
    const auto attempt = [&]<RosMessage M>(std::type_identity<M>) {
      if (type == M::type) add(from_cdr<M>(data), at);
    };
    (attempt(std::type_identity<Messages>{}), ...);
  }

  void add(const RosImage& m, const McapPicture& at) {
    require_readable(m);
    add_frame(m.header, {at.at, false, at.file}, ".png");
  }
  void add(const RosCompressedImage& m, const McapPicture& at) {
    if (const std::string fault = packed_fault(m); !fault.empty()) throw InputError(fault);
    const std::string_view ending = picture_ending(m.data);
    add_frame(m.header, {at.at, true, at.file}, ending.empty() ? ".png" : ending);
  }
  void add(const RosCameraInfo& m, const McapPicture&) {
    if (!found.camera) found.camera = m;
  }
  void add(const FrameExposure& m, const McapPicture& at) {
    if (!(m.exposure_s >= 0.0 && m.gain >= 0.0))
      throw InputError(message("exposure is ", m.exposure_s, " s, gain ", m.gain, ", must not be negative"));
    exposure_stamps_.add(m.header.stamp_ns, at.at.log_ns);
    exposures_.emplace_back(finite(m.exposure_s), finite(m.gain));
  }
  void add(const RosJointState& m, const McapPicture& at) {
    const std::size_t n = m.name.size();
    if (chosen_ && !names_any(m)) return;
    if (!chosen_ && (n < 1 || n > std::size_t(max_joints)))
      throw InputError(message("has ", n, " joints, must have 1 to ", max_joints));
    const auto fits = [n](const std::vector<double>& list) { return list.size() == n || list.empty(); };
    if (!fits(m.position) || (!chosen_ && m.position.empty()) || !fits(m.velocity) || !fits(m.effort))
      throw InputError(message("has ", n, " joints, ", m.position.size(), " positions, ", m.velocity.size(),
          " velocities and ", m.effort.size(), " efforts, must have as many"));
    if (names_.empty()) {
      names_ = m.name;
      known_.resize(n);
    }
    if (!chosen_ && !std::is_permutation(m.name.begin(), m.name.end(), names_.begin(), names_.end()))
      throw InputError(message("joints must be chosen by their names: this is of ", joint_list(m.name),
          ", the first of ", joint_list(names_), "; it names other joints than the messages before it"));
    if (!by_name(m)) return;
    const auto joints = Eigen::Index(names_.size());
    JointSample s{0, JointVector(joints), JointVector(joints), JointVector(joints), Effort::torque_Nm};
    for (Eigen::Index j = 0; j < joints; ++j) {
      const JointValues& v = known_[std::size_t(j)];
      s.position_rad[j] = v.position;
      s.velocity_rad_per_s[j] = v.velocity;
      s.effort[j] = v.effort;
    }
    if (!s.velocity_rad_per_s.allFinite()) s.velocity_rad_per_s.resize(0);
    if (!s.effort.allFinite()) {
      s.effort.resize(0);
      order_currents(m.name);
    }
    take(LogStream::joints, m.header, at.at);
    found.log.joints.push_back(std::move(s));
  }
  void add(const JointCurrents& m, const McapPicture& at) {
    if (m.current_A.size() > std::size_t(max_joints))
      throw InputError(message("has ", m.current_A.size(), " currents, must have at most ", max_joints));
    currents_.push_back(joint_vector(m.current_A));
    current_stamps_.add(m.header.stamp_ns, at.at.log_ns);
  }
  void add(const RosWrenchStamped& m, const McapPicture& at) {
    WrenchSample w;
    for (std::size_t k = 0; k < 3; ++k) {
      w.force_N[Eigen::Index(k)] = finite(m.force[k]);
      w.torque_Nm[Eigen::Index(k)] = finite(m.torque[k]);
    }
    take(LogStream::wrenches, m.header, at.at);
    found.log.wrenches.push_back(w);
  }
  void add(const MarkerDisplacement& m, const McapPicture& at) {
    found.log.markers.push_back({0, finite(m.displacement_m)});
    take(LogStream::markers, m.header, at.at);
  }
  void add(const PhotodiodeSignals& m, const McapPicture& at) {
    PhotodiodeSample s{0, Eigen::VectorXd(Eigen::Index(m.signal_V.size()))};
    for (std::size_t k = 0; k < m.signal_V.size(); ++k) s.signal_V[Eigen::Index(k)] = finite(m.signal_V[k]);
    const auto& list = found.log.photodiodes;
    if (s.signal_V.size() == 0 || (!list.empty() && list.front().signal_V.size() != s.signal_V.size()))
      throw InputError("all messages must have as many diodes, at least 1");
    take(LogStream::photodiodes, m.header, at.at);
    found.log.photodiodes.push_back(std::move(s));
  }

  /// `where` and the error become the stream's fault, if it has none yet.
  void fail(LogStream stream, const std::string& where, const std::string& error) {
    std::string& fault = found.log.reading[std::size_t(stream)].fault;
    if (fault.empty()) fault = where + error;
  }
  bool has_failed(LogStream stream) const { return !found.log.reading[std::size_t(stream)].fault.empty(); }

  /// To be called last: gives all rows their stamps, leaves out those whose stamps do not ascend, and joins messages of
  /// one stamp. `topic` of a stream stands in faults of the file `name`.
  void finish(const std::string& name, const std::array<std::string, log_streams>& topic) {
    name_ = &name;
    topic_ = &topic;
    finish(LogStream::frames, found.log.frames);
    finish(LogStream::joints, found.log.joints);
    finish(LogStream::wrenches, found.log.wrenches);
    finish(LogStream::markers, found.log.markers);
    finish(LogStream::photodiodes, found.log.photodiodes);
    if (has_failed(LogStream::frames)) found.pictures.clear();
    join_exposures();
    name_joints();
    try {
      join_efforts();
      find_velocities(found.log.joints);
    } catch (const InputError& error) {
      fail(LogStream::joints, name + ": ", error.what());
      found.log.joints.clear();
    }
    if (!has_session_) join_clocks();
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
  void take(LogStream stream, const RosHeader& h, const McapEntry& at) {
    stamps_[std::size_t(stream)].add(h.stamp_ns, at.log_ns);
  }
  void add_frame(const RosHeader& h, const McapPicture& picture, std::string_view ending) {
    take(LogStream::frames, h, picture.at);
    found.log.frames.push_back({0, frame_file(found.pictures.size(), ending), 0.0, 0.0});
    found.pictures.push_back(picture);
  }

  template <class Row> void finish(LogStream stream, std::vector<Row>& rows) {
    StreamReading& reading = found.log.reading[std::size_t(stream)];
    const TopicStamps& topic = stamps_[std::size_t(stream)];
    const std::vector<std::int64_t>& stamp = topic.ns(has_session_);
    for (std::size_t i = 0; i < rows.size(); ++i) rows[i].stamp_ns = stamp[i];
    AscendingRows ascending = ascending_rows(stamp);
    ascending.reading.fault = reading.fault;
    ascending.reading.incomplete = reading.incomplete;
    ascending.reading.rows += reading.incomplete;
    reading = ascending.reading;
    if (reading.fault.empty() && reading.incomplete > 0 && reading.is_beyond_limit())
      fail(stream, message(*name_, ": topic ", printable((*topic_)[std::size_t(stream)]), ": "),
          message("numbers must be finite: a position or an effort is not in ", reading.incomplete, " of ",
              reading.rows, " messages, at most ", 100.0 * StreamReading::most_left_out, " % are left out"));
    if (reading.fault.empty() && reading.is_beyond_limit()) {
      const std::size_t row = first_backward(stamp);
      fail(stream,
          message(*name_, ": topic ", printable((*topic_)[std::size_t(stream)]), ", log time ", topic.log_ns()[row],
              " ns: "),
          stamps_fault(stamp, reading, row));
    }
    if (!reading.fault.empty()) {
      rows.clear();
      return;
    }
    keep_rows(rows, ascending.kept);
    if constexpr (std::is_same_v<Row, FrameRecord>) keep_rows(found.pictures, ascending.kept);
  }
  /// lumo's own names are numbers.
  void name_joints() {
    if (chosen_ && found.log.joints.empty() && !has_failed(LogStream::joints))
      fail(LogStream::joints, *name_ + ": ", "no messages name all of the joints " + joint_list(names_));
    bool numbers = has_session_;
    for (std::size_t j = 0; j < names_.size(); ++j) numbers = numbers && names_[j] == numbered("joint", int(j));
    if (numbers || found.log.joints.empty()) return;
    if (are_column_names(names_)) found.log.joint_names = names_;
    else
      found.log.notes.push_back("joints are numbered: a table cannot have columns of the names " + joint_list(names_));
  }
  void join_exposures() {
    std::map<std::int64_t, std::pair<double, double>> at;
    for (std::size_t i = 0; i < exposures_.size(); ++i) at[exposure_stamps_.ns(has_session_)[i]] = exposures_[i];
    for (FrameRecord& f : found.log.frames)
      if (const auto e = at.find(f.stamp_ns); e != at.end()) {
        f.exposure_s = e->second.first;
        f.gain = e->second.second;
      }
  }
  void join_efforts() {
    std::map<std::int64_t, JointVector> at;
    for (std::size_t i = 0; i < currents_.size(); ++i) at[current_stamps_.ns(has_session_)[i]] = currents_[i];
    const auto lacks_effort = [](const JointSample& s) { return s.effort.size() != s.position_rad.size(); };
    std::vector<JointSample>& list = found.log.joints;
    if (currents_.empty() && !std::all_of(list.begin(), list.end(), lacks_effort)) {  // positions came before efforts
      StreamReading& reading = found.log.reading[std::size_t(LogStream::joints)];
      reading.incomplete += std::erase_if(list, lacks_effort);
      if (reading.is_beyond_limit())
        throw InputError(message("joints have no effort in ", reading.incomplete, " of ", reading.rows,
            " messages, at most ", 100.0 * StreamReading::most_left_out, " % are left out"));
    }
    for (JointSample& s : list) {
      if (!lacks_effort(s)) continue;
      const auto c = at.find(s.stamp_ns);
      if (c == at.end() || std::size_t(c->second.size()) != named_with_currents_.size())
        throw InputError(message("joints at ", s.stamp_ns, " ns have neither efforts nor currents"));
      s.effort.resize(s.position_rad.size());
      for (Eigen::Index j = 0; j < s.effort.size(); ++j) s.effort[j] = c->second[currents_order_[std::size_t(j)]];
      s.unit = Effort::current_A;
    }
    for (const JointSample& s : found.log.joints)
      if (s.unit != found.log.joints.front().unit)
        throw InputError(message("joints at ", s.stamp_ns, " ns have another kind of effort than the first ones"));
  }

  /// A stream that shares no time with the pictures is stamped on another clock. The log times of all are of one, so
  /// that the difference of how late they are logged is the offset, but for what both take to get there.
  void join_clocks() {
    const auto frames = Stretch::of(found.log.frames);
    const auto late = stamps_[std::size_t(LogStream::frames)].log_less_stamp_ns(has_session_);
    const auto join = [&](LogStream stream, const auto& rows, const char* what) {
      const auto own = Stretch::of(rows);
      const auto own_late = stamps_[std::size_t(stream)].log_less_stamp_ns(has_session_);
      if (!frames || !own || own->meets(*frames) || !late || !own_late) return;
      const std::int64_t offset = *own_late - *late;
      if (!Stretch{own->from_ns + offset, own->to_ns + offset}.meets(*frames)) return;
      const ClockMap clock{0, 1e-9 * double(offset), 0.0, 0.0};
      found.clocks.push_back({stream, clock,
          message(what, " are stamped on another clock than the pictures (", to_string(*own), ", pictures ",
              to_string(*frames), "): moved by ", clock.offset_s,
              " s, as the file's log times have it; what the streams differ in on their way to the recorder is not "
              "known")});
    };
    join(LogStream::joints, found.log.joints, "joint states");
    join(LogStream::wrenches, found.log.wrenches, "wrenches");
  }

  /// The part of a joint state that is about one joint. What is missing or not finite is NaN.
  struct JointValues {
    double position = std::numeric_limits<double>::quiet_NaN(), velocity = position, effort = position;
  };
  bool names_any(const RosJointState& m) const {
    return std::any_of(m.name.begin(), m.name.end(),
        [&](const std::string& n) { return std::find(names_.begin(), names_.end(), n) != names_.end(); });
  }
  /// The joints by their names; what the message does not have of one is as it was last. False if the message has no
  /// position of the first joint, or some joint has not been seen yet. One with numbers that are needed and not finite
  /// is counted, and changes nothing.
  bool by_name(const RosJointState& m) {
    bool first = false;
    std::vector<JointValues> now = known_;
    for (std::size_t j = 0; j < names_.size(); ++j) {
      const auto at = std::find(m.name.begin(), m.name.end(), names_[j]);
      if (at == m.name.end()) continue;
      const auto i = std::size_t(at - m.name.begin());
      JointValues& v = now[j];
      if (!m.position.empty()) v.position = m.position[i];
      if (!m.velocity.empty()) v.velocity = m.velocity[i];  // one that is no number follows from the positions
      if (!m.effort.empty()) v.effort = m.effort[i];
      if ((!m.position.empty() && !std::isfinite(v.position)) || (!m.effort.empty() && !std::isfinite(v.effort))) {
        ++found.log.reading[std::size_t(LogStream::joints)].incomplete;
        return false;
      }
      first = first || (j == 0 && !m.position.empty());
    }
    known_ = std::move(now);
    return first && std::all_of(known_.begin(), known_.end(), [](const auto& k) { return std::isfinite(k.position); });
  }
  /// Currents stand in the order of the names of the joint state that they belong to. Throws InputError for another
  /// order than before.
  void order_currents(const std::vector<std::string>& names) {
    if (names == named_with_currents_) return;
    if (!named_with_currents_.empty() || names.size() > std::size_t(max_joints))
      throw InputError("joints whose currents come in messages of their own must always be named in one order");
    std::vector<int> order;
    for (const std::string& n : names_)
      if (const auto at = std::find(names.begin(), names.end(), n); at != names.end())
        order.push_back(int(at - names.begin()));
    if (order.size() != names_.size()) return;
    named_with_currents_ = names;
    currents_order_ = std::move(order);
  }

  bool has_session_, chosen_;
  std::vector<std::string> names_;
  std::vector<JointValues> known_;
  std::vector<std::string> named_with_currents_;  ///< by the messages whose efforts are currents, in their order
  std::vector<int> currents_order_;               ///< place of each joint in it
  std::array<TopicStamps, log_streams> stamps_;
  TopicStamps exposure_stamps_, current_stamps_;
  std::vector<std::pair<double, double>> exposures_;
  std::vector<JointVector> currents_;
  const std::string* name_ = nullptr;
  const std::array<std::string, log_streams>* topic_ = nullptr;
};

/// The topic of one kind: the wanted one, or the only one; empty: there is none. Throws InputError.
inline std::string choose_topic(
    const std::set<std::string>& topics, const std::string& wanted, const char* what, const std::string& name) {
  const std::string all = listing(topics, [](const std::string& t) { return printable(t); });
  if (!wanted.empty()) {
    if (!topics.contains(wanted))
      throw InputError(message(
          name, ": has no ", what, " on topic '", printable(wanted), "'", all.empty() ? "" : ", but on " + all));
    return wanted;
  }
  if (topics.size() > 1)
    throw InputError(message(name, ": has ", what, " on several topics, one must be chosen: ", all));
  return topics.empty() ? std::string() : *topics.begin();
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

/// A topic of a bag and the type of its messages.
using TopicType = std::pair<std::string, std::string_view>;

/// Finds the topics whose messages make a log.
template <ChunkCodec... Codecs> class TopicChoice {
 public:
  TopicChoice(const McapFiles<Codecs...>& files, const McapTopics& wanted, McapTables& tables)
      : files_(files), name_(files.front()->name()), tables_(tables) {
    for (std::size_t f = 0; f < files.size(); ++f)
      for (const McapEntry& e : files[f]->messages())
        first_.try_emplace(
            {files[f]->channels().at(e.channel).topic, schema_of(*files[f], e.channel)}, McapPicture{e, false, f});
    choose_pictures(wanted.image);
    choose(LogStream::frames, "exposures", "", {FrameExposure::type});
    choose_joints(wanted);
    choose(LogStream::joints, "currents", "", {JointCurrents::type});
    choose(LogStream::wrenches, "wrenches", wanted.wrench, {RosWrenchStamped::type});
    choose(LogStream::markers, "displacements", "", {MarkerDisplacement::type});
    choose(LogStream::photodiodes, "photodiodes", "", {PhotodiodeSignals::type});
    if (const auto cameras = topics_of({RosCameraInfo::type}); cameras.size() == 1)
      use_[{*cameras.begin(), RosCameraInfo::type}] = std::nullopt;
  }

  /// The stream that is faulty if a message is, none if nothing needs it; null: the message's channel is not read.
  const std::optional<LogStream>* use(const McapReader<Codecs...>& file, std::uint16_t channel) const {
    const auto u = use_.find({file.channels().at(channel).topic, schema_of(file, channel)});
    return u == use_.end() ? nullptr : &u->second;
  }
  /// Of each stream; empty without one.
  const std::array<std::string, log_streams>& topic() const { return topic_; }
  /// "/camera (foxglove.CompressedImage, json), …".
  std::string contents() const {
    constexpr std::size_t most = 12;
    std::string text;
    std::size_t count = 0;
    for (const auto& [topic, at] : first_)
      if (++count <= most)
        text += (text.empty() ? "" : ", ") + printable(topic.first) + " (" + printable(std::string(topic.second)) +
                ", " + printable(files_[at.file]->channels().at(at.at.channel).encoding) + ")";
    return text + (count > most ? message(" and ", count - most, " more") : std::string());
  }

 private:
  std::set<std::string> topics_of(std::initializer_list<std::string_view> types) const {
    std::set<std::string> topics;
    for (const auto& [topic, at] : first_)
      if (std::find(types.begin(), types.end(), topic.second) != types.end()) topics.insert(topic.first);
    return topics;
  }
  void choose(
      LogStream stream, const char* what, const std::string& wanted, std::initializer_list<std::string_view> types) {
    choose_of(topics_of(types), stream, what, wanted, types);
  }
  void choose_of(const std::set<std::string>& topics, LogStream stream, const char* what, const std::string& wanted,
      std::initializer_list<std::string_view> types) {
    try {
      const std::string chosen = choose_topic(topics, wanted, what, name_);
      if (chosen.empty()) return;
      std::string& topic = topic_[std::size_t(stream)];
      if (topic.empty()) topic = chosen;
      for (const std::string_view type : types) use_[{chosen, type}] = stream;
    } catch (const InputError& error) {
      tables_.fail(stream, "", error.what());
    }
  }

  /// Of several topics with joint states those count that have joints of the wanted names, each on one topic.
  void choose_joints(const McapTopics& wanted) {
    const std::set<std::string> topics = topics_of({RosJointState::type});
    if (topics.size() < 2 || !wanted.joints.empty())
      return choose(LogStream::joints, "joint states", wanted.joints, {RosJointState::type});
    const std::map<std::string, std::set<std::string>> names = joint_names_of(topics);
    std::set<std::string> with, twice;
    for (const std::string& joint : wanted.joint_names) {
      std::set<std::string> having;
      for (const std::string& t : topics)
        if (const auto n = names.find(t); n != names.end() && n->second.contains(joint)) having.insert(t);
      if (having.size() > 1) twice.insert(having.begin(), having.end());
      with.insert(having.begin(), having.end());
    }
    if (!with.empty() && twice.empty()) {
      topic_[std::size_t(LogStream::joints)] = listing(with, [](const std::string& t) { return t; });
      for (const std::string& t : with) use_[{t, RosJointState::type}] = LogStream::joints;
      return;
    }
    tables_.fail(LogStream::joints, name_ + ": ",
        "has joint states on several topics, one must be chosen, or joints by their names: " +
            listing(twice.empty() ? topics : twice, [&](const std::string& t) {
              const auto n = names.find(t);
              return printable(t) + " (" +
                     (n == names.end() ? std::string()
                                       : listing(n->second, [](const std::string& j) { return printable(j); })) +
                     ")";
            }));
  }
  /// Names in the first messages of each topic.
  std::map<std::string, std::set<std::string>> joint_names_of(const std::set<std::string>& topics) const {
    constexpr int first = 100;  // publishers that take turns
    constexpr std::size_t most_names = 64;
    std::map<std::string, std::set<std::string>> names;
    std::map<std::string, int> seen;
    for (const auto& file : files_)
      for (const McapEntry& e : file->messages()) {
        const McapChannel& channel = file->channels().at(e.channel);
        if (channel.encoding != "cdr" || schema_of(*file, e.channel) != RosJointState::type ||
            !topics.contains(channel.topic) || ++seen[channel.topic] > first)
          continue;
        try {
          for (const std::string& n : from_cdr<RosJointState>(file->read(e).data).name)
            if (names[channel.topic].size() < most_names) names[channel.topic].insert(n);
        } catch (const InputError&) {  // whoever reads the topic says so
        }
      }
    return names;
  }

  /// Of several topics with pictures those count that can be read: no depth, no video. image_transport sends the same
  /// pictures packed below the name of their topic.
  void choose_pictures(const std::string& wanted) {
    const std::initializer_list<std::string_view> types = {RosImage::type, RosCompressedImage::type};
    std::set<std::string> topics = topics_of(types);
    if (wanted.empty() && topics.size() > 1) {
      std::set<std::string> readable;
      std::string others;
      for (const std::string& t : topics) {
        const std::size_t slash = t.rfind('/');
        const std::string above = slash == std::string::npos ? std::string() : t.substr(0, slash);
        const bool twin = topics.contains(above) && unreadable(above).empty();
        const std::string why = twin ? "the same pictures packed" : unreadable(t);
        if (why.empty()) readable.insert(t);
        else others += (others.empty() ? "" : "; ") + printable(t) + ": " + why;
      }
      if (readable.size() == 1) {
        tables_.found.log.notes.push_back(
            message("pictures of topic ", printable(*readable.begin()), " are read, others are not: ", others));
        topics = readable;
      }
    }
    choose_of(topics, LogStream::frames, "pictures", wanted, types);
  }
  /// Why the first message of a topic cannot be read as a picture; empty: it can.
  std::string unreadable(const std::string& topic) const {
    try {
      if (const auto at = first_.find({topic, RosImage::type}); at != first_.end())
        require_readable(from_cdr<RosImage>(files_[at->second.file]->read(at->second.at).data));
      if (const auto at = first_.find({topic, RosCompressedImage::type}); at != first_.end())
        return packed_fault(from_cdr<RosCompressedImage>(files_[at->second.file]->read(at->second.at).data));
      return "";
    } catch (const InputError& error) {
      return error.what();
    }
  }

  const McapFiles<Codecs...>& files_;
  std::string name_;
  McapTables& tables_;
  std::map<TopicType, McapPicture> first_;  ///< message of each topic
  std::map<TopicType, std::optional<LogStream>> use_;
  std::array<std::string, log_streams> topic_;
};

}  // namespace detail

/// Text of the attachment session.json of a bag's files; empty without one. Throws InputError for one that is too
/// large.
template <ChunkCodec... Codecs> std::string attached_session(const McapFiles<Codecs...>& files) {
  std::string json;
  for (const auto& file : files)
    if (json.empty()) json = detail::attached_session(*file);
  return json;
}

/// Reads the tables of a log, and where its pictures lie; a cut file's up to the cut. `files` are those of one bag, in
/// their order, at least one. A stream that cannot be read is empty, and Recording::reading has the reason: one line
/// with file, topic, time. Throws InputError where the session is too large.
template <ChunkCodec... Codecs>
McapLog read_mcap_log(const McapFiles<Codecs...>& files, const McapTopics& wanted = {}) {
  if (files.empty()) throw InvalidArgument("bag without files");
  if (wanted.joint_names.size() > std::size_t(max_joints))
    throw InvalidArgument(
        message(wanted.joint_names.size(), " joints are chosen by name, must be at most ", max_joints));
  std::string session_json = attached_session(files);
  McapTables tables(!session_json.empty(), wanted.joint_names);
  const detail::TopicChoice<Codecs...> choice(files, wanted, tables);
  for (std::size_t f = 0; f < files.size(); ++f)
    for (const McapEntry& e : files[f]->messages()) {
      const std::optional<LogStream>* const use = choice.use(*files[f], e.channel);
      if (use == nullptr || (*use && tables.has_failed(**use))) continue;
      const McapChannel& channel = files[f]->channels().at(e.channel);
      try {
        if (channel.encoding != "cdr")
          throw InputError(message("messages are of encoding '", printable(channel.encoding), "', read is cdr"));
        const McapMessage m = files[f]->read(e);
        tables.add_any<RosImage, RosCompressedImage, RosCameraInfo, FrameExposure, RosJointState, JointCurrents,
            RosWrenchStamped, MarkerDisplacement, PhotodiodeSignals>(
            detail::schema_of(*files[f], e.channel), m.data, {e, false, f});
      } catch (const InputError& error) {
        if (*use)
          tables.fail(**use,
              message(files[f]->name(), ": topic ", printable(channel.topic), ", log time ", e.log_ns, " ns: "),
              error.what());
      }
    }
  tables.finish(files.front()->name(), choice.topic());
  tables.found.log.path = files.front()->name();
  tables.found.session_json = std::move(session_json);
  tables.found.contents = choice.contents();
  return std::move(tables.found);
}

/// The same of a single file.
template <ChunkCodec... Codecs> McapLog read_mcap_log(McapReader<Codecs...>& file, const McapTopics& wanted = {}) {
  return read_mcap_log(
      McapFiles<Codecs...>{std::shared_ptr<McapReader<Codecs...>>(std::shared_ptr<void>(), &file)}, wanted);
}

}  // namespace lumo::sense
