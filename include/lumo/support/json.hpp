#pragma once

// Adapter to nlohmann-json (MIT, header only): a log's session.json, and with it the whole log, a folder or an MCAP
// file. Schema: docs/log_format.md.

#include "lumo/core/files.hpp"
#include "lumo/sense/recording/mcap/mcap_log.hpp"
#include "lumo/sense/recording/recording.hpp"
#include "lumo/sense/recording/session.hpp"
#include "lumo/sense/recording/tables.hpp"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace lumo {

namespace detail {

/// An object whose keys must all be asked for: what is left over is an error that names the nearest key.
class StrictObject {
 public:
  StrictObject(const nlohmann::json& object, std::string where) : object_(object), where_(std::move(where)) {
    if (!object.is_object()) throw InputError(message(where_, ": must be an object"));
  }
  /// Each key may be absent; then the value stays as it is.
  void get(const char* key, double& value) {
    read(key, [&](const auto& j) { value = number(j, key); });
  }
  void get(const char* key, int& value) {
    read(key, [&](const auto& j) {
      // As a real number: one beyond 64 signed bits must not wrap into range.
      if (!j.is_number_integer() || std::abs(j.template get<double>()) > 1e9)
        fail(key, "must be a whole number within 1e9");
      value = j.template get<int>();
    });
  }
  void get(const char* key, bool& value) {
    read(key, [&](const auto& j) {
      if (!j.is_boolean()) fail(key, "must be true or false");
      value = j.template get<bool>();
    });
  }
  void get(const char* key, std::int64_t& value) {
    read(key, [&](const auto& j) {
      const bool beyond = j.is_number_unsigned() &&
                          j.template get<std::uint64_t>() > std::uint64_t(std::numeric_limits<std::int64_t>::max());
      if (!j.is_number_integer() || beyond) fail(key, "must be a whole number of 64 bits");
      value = j.template get<std::int64_t>();
    });
  }
  void get(const char* key, std::string& value) {
    read(key, [&](const auto& j) {
      if (!j.is_string()) fail(key, "must be a string");
      value = j.template get<std::string>();
    });
  }
  void get(const char* key, std::vector<double>& value) {
    read(key, [&](const auto& j) {
      if (!j.is_array()) fail(key, "must be an array of numbers");
      value.clear();
      for (const auto& v : j) value.push_back(number(v, key));
    });
  }
  void get(const char* key, std::vector<std::string>& value) {
    read(key, [&](const auto& j) {
      if (!j.is_array()) fail(key, "must be an array of strings");
      value.clear();
      for (const auto& v : j) {
        if (!v.is_string()) fail(key, "must be an array of strings");
        value.push_back(v.template get<std::string>());
      }
    });
  }
  /// Applies `take(json, where)` to the value, if it is there.
  template <class Take> void with(const char* key, Take take) {
    read(key, [&](const auto& j) { take(j, where_ + "." + key); });
  }
  /// To be called last.
  void finish() const {
    for (const auto& item : object_.items()) {
      const std::string& key = item.key();
      if (std::find(asked_.begin(), asked_.end(), key) != asked_.end()) continue;
      const auto nearest = std::min_element(asked_.begin(), asked_.end(),
          [&](const auto& a, const auto& b) { return distance(a, key) < distance(b, key); });
      throw InputError(message(where_, ": key '", printable(key), "' is not known",
          nearest == asked_.end() ? "" : ", the nearest is '" + *nearest + "'"));
    }
  }
  [[noreturn]] void fail(const char* key, const char* why) const {
    throw InputError(message(where_, ".", key, ": ", why));
  }

 private:
  template <class Read> void read(const char* key, Read read) {
    asked_.push_back(key);
    if (const auto it = object_.find(key); it != object_.end()) read(*it);
  }
  double number(const nlohmann::json& j, const char* key) const {
    if (!j.is_number() || !std::isfinite(j.get<double>())) fail(key, "must be a finite number");
    return j.get<double>();
  }
  /// Levenshtein's.
  static std::size_t distance(std::string_view a, std::string_view b) {
    b = b.substr(0, 64);
    std::vector<std::size_t> row(b.size() + 1);
    for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
    for (std::size_t i = 1; i <= a.size(); ++i) {
      std::size_t corner = row[0]++;
      for (std::size_t j = 1; j <= b.size(); ++j)
        corner = std::exchange(row[j], std::min({row[j] + 1, row[j - 1] + 1, corner + (a[i - 1] != b[j - 1])}));
    }
    return row[b.size()];
  }

  const nlohmann::json& object_;
  std::string where_;
  std::vector<std::string> asked_;
};

/// Reads a length in mm; one that is absent stays, but for rounding.
inline void get_mm(StrictObject& o, const char* key, double& length_m) {
  double length_mm = 1e3 * length_m;
  o.get(key, length_mm);
  length_m = 1e-3 * length_mm;
}

/// Applies `take(item, where)` to each item of an array. Throws InputError for anything else.
template <class Take> void for_each_item(const nlohmann::json& j, const std::string& where, Take take) {
  if (!j.is_array()) throw InputError(message(where, ": must be an array"));
  std::size_t k = 0;
  for (const auto& item : j) take(item, message(where, '[', k++, ']'));
}

inline void read_leds(const nlohmann::json& j, const std::string& where, sense::Session& s) {
  StrictObject o(j, where);
  o.get("count", s.led_count);
  get_mm(o, "pitch_mm", s.led_pitch_m);
  get_mm(o, "first_y_mm", s.led_first_y_m);
  get_mm(o, "depth_mm", s.led_depth_m);
  get_mm(o, "camera_distance_mm", s.camera_distance_m);
  std::vector<double> distal{s.distal.x(), s.distal.y()};
  o.get("distal", distal);
  if (distal.size() != 2) o.fail("distal", "must be two numbers");
  s.distal = {distal[0], distal[1]};
  o.finish();
}

inline void read_clock(const nlohmann::json& j, const std::string& where, sense::ClockMap& map) {
  StrictObject o(j, where);
  o.get("origin_ns", map.origin_ns);
  o.get("offset_s", map.offset_s);
  o.get("drift", map.drift);
  o.get("residual_s", map.residual_s);
  o.finish();
}

/// Columns of two, in m or px.
inline Eigen::Matrix2Xd pairs(const std::vector<double>& v, double unit) {
  Eigen::Matrix2Xd m(2, Eigen::Index(v.size() / 2));
  for (std::size_t k = 0; k < v.size(); ++k) m.data()[k] = unit * v[k];
  return m;
}

inline sense::SessionLink read_link(const nlohmann::json& j, const std::string& where) {
  StrictObject o(j, where);
  sense::SessionLink l;
  std::vector<double> joints, hole_mm, hole_px, y_mm{1e3 * l.link.y_low_m, 1e3 * l.link.y_high_m},
      z_mm{1e3 * l.link.z_low_m, 1e3 * l.link.z_high_m};
  o.get("name", l.link.name);
  o.get("joints", joints);
  o.get("holes_mm", hole_mm);
  o.get("holes_px", hole_px);
  get_mm(o, "hole_radius_mm", l.link.hole_radius_m);
  o.get("z_clockwise", l.link.z_clockwise);
  o.get("pad_y_mm", y_mm);
  o.get("pad_z_mm", z_mm);
  for (const double joint : joints) {
    if (joint != std::floor(joint) || std::abs(joint) > 1e6) o.fail("joints", "must be whole numbers");
    l.link.joints.push_back(int(joint));
  }
  if (hole_mm.size() % 2 != 0) o.fail("holes_mm", "must be pairs y, z");
  if (hole_px.size() % 2 != 0) o.fail("holes_px", "must be pairs x, y");
  if (y_mm.size() != 2) o.fail("pad_y_mm", "must be two numbers");
  if (z_mm.size() != 2) o.fail("pad_z_mm", "must be two numbers");
  l.link.hole_m = pairs(hole_mm, 1e-3);
  l.hole_px = pairs(hole_px, 1.0);
  l.link.y_low_m = 1e-3 * y_mm[0];
  l.link.y_high_m = 1e-3 * y_mm[1];
  l.link.z_low_m = 1e-3 * z_mm[0];
  l.link.z_high_m = 1e-3 * z_mm[1];
  o.finish();
  return l;
}

inline sense::Segment read_segment(const nlohmann::json& j, const std::string& where) {
  StrictObject o(j, where);
  sense::Segment g;
  o.get("from_ns", g.from_ns);
  o.get("to_ns", g.to_ns);
  std::string kind = g.kind_name();
  o.get("kind", kind);
  g.set_kind_name(std::move(kind));
  o.get("place", g.place);
  o.get("y_mm", g.y_mm);
  o.get("repetition", g.repetition);
  o.get("cycle", g.cycle);
  o.get("load_N", g.load_N);
  o.get("angle_deg", g.angle_deg);
  o.get("diameter_mm", g.diameter_mm);
  o.finish();
  return g;
}

/// Throws InputError for what is no JSON, has a key twice, or is nested too deeply: each level takes stack when the
/// value is destroyed.
inline nlohmann::json parse_json(std::string_view text, const std::string& name) {
  constexpr int deepest = 64;
  using Json = nlohmann::json;
  using Event = Json::parse_event_t;
  std::vector<std::set<std::string>> open;
  const auto watch = [&](int depth, Event event, Json& value) {
    if (depth >= deepest && (event == Event::object_start || event == Event::array_start))
      throw InputError(message(name, ": is nested deeper than ", deepest, " levels"));
    if (event == Event::object_start) open.emplace_back();
    if (event == Event::object_end) open.pop_back();
    if (event == Event::key && !open.back().insert(value.get<std::string>()).second)
      throw InputError(message(name, ": has the key '", printable(value.get<std::string>()), "' twice"));
    return true;
  };
  try {
    return Json::parse(text, watch);
  } catch (const Json::exception& e) {
    throw InputError(message(name, ": is no JSON: ", printable(e.what(), 200)));
  }
}

}  // namespace detail

/// Reads the text of a session.json. Throws InputError of one line that names file and key.
inline sense::Session session_from_json(std::string_view json, const std::string& name) {
  const nlohmann::json root = detail::parse_json(json, name);
  sense::Session s;
  detail::StrictObject top(root, name);
  std::string format;
  int version = 0;
  top.get("format", format);
  top.get("version", version);
  if (format != "lumo-log") top.fail("format", "must be \"lumo-log\"");
  if (version != 1) top.fail("version", "must be 1");
  top.get("title", s.title);
  top.get("clock", s.clock);
  top.get("material", s.material);
  top.get("finger", s.finger);
  top.get("theta_mm", s.theta_mm);
  top.get("video", s.video);
  top.get("torque_constant_Nm_per_A", s.torque_constant_Nm_per_A);
  detail::get_mm(top, "joint_to_origin_mm", s.joint_to_origin_m);
  top.get("joint_to_joint_mm", s.joint_to_joint_m);
  for (double& l : s.joint_to_joint_m) l *= 1e-3;
  top.get("joint_names", s.joint_names);
  std::vector<std::string> axes = names_of(s.wrench_axes);
  top.get("wrench_axes", axes);
  try {
    s.wrench_axes = sense::sensor_axes(axes);
  } catch (const InvalidArgument& e) {
    top.fail("wrench_axes", e.what());
  }
  top.get("frame_delay_s", s.frame_delay_s);
  top.get("joint_delay_s", s.joint_delay_s);
  using Json = nlohmann::json;
  using Where = const std::string&;
  top.with("leds", [&](const Json& j, Where where) { detail::read_leds(j, where, s); });
  top.with("joint_clock", [&](const Json& j, Where where) { detail::read_clock(j, where, s.joint_clock); });
  top.with("wrench_clock", [&](const Json& j, Where where) { detail::read_clock(j, where, s.wrench_clock); });
  top.with("links", [&](const Json& j, Where where) {
    detail::for_each_item(j, where, [&](const Json& i, Where at) { s.links.push_back(detail::read_link(i, at)); });
  });
  top.with("segments", [&](const Json& j, Where where) {
    detail::for_each_item(
        j, where, [&](const Json& i, Where at) { s.segments.push_back(detail::read_segment(i, at)); });
  });
  top.finish();
  validate(s, name);
  return s;
}

inline sense::Session read_session(const std::string& path) {
  if (!file_size(path)) throw InputError(message(path, ": cannot be opened"));  // a pipe would wait
  return session_from_json(read_text(path), path);
}

namespace detail {

/// The number of mm that reads back as this number of m, if there is one: always for a length that was read.
inline double millimetres(double m) {
  const double mm = 1e3 * m;
  for (const double near : {mm, std::nextafter(mm, 2.0 * mm), std::nextafter(mm, 0.0)})
    if (1e-3 * near == m) return near;
  return mm;
}

inline nlohmann::ordered_json to_json(const sense::SessionLink& l) {
  const auto flat = [](const Eigen::Matrix2Xd& m, bool in_mm) {
    std::vector<double> v;
    for (Eigen::Index k = 0; k < m.size(); ++k) v.push_back(in_mm ? millimetres(m.data()[k]) : m.data()[k]);
    return v;
  };
  const auto mm = [](double low, double high) { return std::vector<double>{millimetres(low), millimetres(high)}; };
  return {{"name", l.link.name}, {"joints", l.link.joints}, {"holes_mm", flat(l.link.hole_m, true)},
      {"hole_radius_mm", millimetres(l.link.hole_radius_m)}, {"holes_px", flat(l.hole_px, false)},
      {"z_clockwise", l.link.z_clockwise}, {"pad_y_mm", mm(l.link.y_low_m, l.link.y_high_m)},
      {"pad_z_mm", mm(l.link.z_low_m, l.link.z_high_m)}};
}

}  // namespace detail

/// The text of a session.json that reads back as the same session. Throws InputError for one that would be refused.
inline std::string to_json(const sense::Session& s) {
  validate(s, "session to write");
  using Json = nlohmann::ordered_json;
  const auto clock = [](const sense::ClockMap& m) {
    return Json{{"origin_ns", m.origin_ns}, {"offset_s", m.offset_s}, {"drift", m.drift}, {"residual_s", m.residual_s}};
  };
  Json j{{"format", "lumo-log"}, {"version", 1}, {"title", s.title}, {"clock", s.clock}, {"material", s.material},
      {"finger", s.finger}, {"theta_mm", s.theta_mm}, {"video", s.video}};
  j["leds"] = {{"count", s.led_count}, {"pitch_mm", detail::millimetres(s.led_pitch_m)},
      {"first_y_mm", detail::millimetres(s.led_first_y_m)}, {"depth_mm", detail::millimetres(s.led_depth_m)},
      {"camera_distance_mm", detail::millimetres(s.camera_distance_m)}, {"distal", {s.distal.x(), s.distal.y()}}};
  j["joint_to_origin_mm"] = detail::millimetres(s.joint_to_origin_m);
  j["joint_to_joint_mm"] = Json::array();
  for (const double l : s.joint_to_joint_m) j["joint_to_joint_mm"].push_back(detail::millimetres(l));
  j["torque_constant_Nm_per_A"] = s.torque_constant_Nm_per_A;
  if (!s.joint_names.empty()) j["joint_names"] = s.joint_names;
  if (s.wrench_axes != sense::SensorAxes{}) j["wrench_axes"] = names_of(s.wrench_axes);
  j["frame_delay_s"] = s.frame_delay_s;
  j["joint_delay_s"] = s.joint_delay_s;
  j["joint_clock"] = clock(s.joint_clock);
  j["wrench_clock"] = clock(s.wrench_clock);
  for (const sense::SessionLink& l : s.links) j["links"].push_back(detail::to_json(l));
  j["segments"] = Json::array();
  for (const sense::Segment& g : s.segments)
    j["segments"].push_back({{"from_ns", g.from_ns}, {"to_ns", g.to_ns}, {"kind", g.kind_name()}, {"place", g.place},
        {"y_mm", g.y_mm}, {"repetition", g.repetition}, {"cycle", g.cycle}, {"load_N", g.load_N},
        {"angle_deg", g.angle_deg}, {"diameter_mm", g.diameter_mm}});
  try {
    return j.dump(2) + "\n";
  } catch (const nlohmann::json::exception&) {
    throw InputError("session to write: a text is not UTF-8");
  }
}

namespace detail {

/// Session and tables that do not match are a fault of the joints, which only some need.
inline void validate_joints(sense::Recording& log) {
  std::string& fault = log.reading[std::size_t(sense::LogStream::joints)].fault;
  try {
    validate(log);
  } catch (const InputError& e) {
    if (fault.empty()) fault = e.what();
    log.joints.clear();
  }
}

}  // namespace detail

namespace detail {

/// What was chosen stands over what the session says, and is in the session from then on.
inline void choose(sense::Session& session, const sense::McapTopics& chosen) {
  if (!chosen.joint_names.empty()) session.joint_names = chosen.joint_names;
  if (chosen.wrench_axes) session.wrench_axes = *chosen.wrench_axes;
}

/// The order of named joints is that of the chain: whoever reads results must see it, unless somebody stated it.
inline void note_joint_order(sense::Recording& log) {
  if (log.joint_names.size() > 1 && !log.joints.empty() && log.session.joint_names.empty())
    log.notes.push_back("joints from the base to the tip are taken to be " + sense::joint_list(log.joint_names));
}

/// Turns the wrenches into the finger's frame; from then on they are there.
inline void turn_wrenches(sense::Recording& log) {
  const sense::SensorAxes axes = std::exchange(log.session.wrench_axes, sense::SensorAxes{});
  if (axes == sense::SensorAxes{} || log.wrenches.empty()) return;
  for (sense::WrenchSample& w : log.wrenches) {
    w.force_N = axes.turned(w.force_N);
    w.torque_Nm = axes.turned(w.torque_Nm);
  }
  log.notes.push_back(
      "wrenches are turned: the finger's x, y, z are the sensor's " + sense::joint_list(names_of(axes)));
}

}  // namespace detail

/// Reads session.json and the tables of a log's folder. Rows whose stamps do not ascend, or that lack a number, are
/// left out and counted; a table that cannot be read is empty, see Recording::reading. `chosen`: joints and axes that
/// stand over the session's. Throws InputError for the session.
inline sense::Recording read_log_streams(const std::string& path, const sense::McapTopics& chosen = {}) {
  using sense::LogStream;
  using sense::StreamReading;
  sense::Recording log;
  log.path = path;
  log.session = read_session(path + "/session.json");
  detail::choose(log.session, chosen);
  const auto table = [&](LogStream stream, const char* name, auto& rows, auto read) {
    const std::string file = path + '/' + name;
    std::error_code error;
    if (!std::filesystem::exists(file, error)) return;
    StreamReading& reading = log.reading[std::size_t(stream)];
    try {
      std::ifstream in = sense::open_text(file);
      rows = read(in, file, &reading);
    } catch (const InputError& e) {
      reading.fault = e.what();
    }
  };
  const bool video = !log.session.video.empty();
  table(LogStream::frames, "frames.csv", log.frames, [&](std::istream& in, const std::string& file, StreamReading* r) {
    return sense::read_frame_log(in, file, video, video ? nullptr : r);  // a video has a frame for each row
  });
  table(LogStream::joints, "joint.csv", log.joints, [&](std::istream& in, const std::string& file, StreamReading* r) {
    sense::JointTable read = sense::read_joint_table(in, file, r, log.session.joint_names);
    log.joint_names = std::move(read.names);
    return std::move(read.samples);
  });
  table(LogStream::wrenches, "wrench.csv", log.wrenches, sense::read_wrench_log);
  table(LogStream::markers, "marker.csv", log.markers, sense::read_marker_log);
  table(LogStream::photodiodes, "photodiode.csv", log.photodiodes, sense::read_photodiode_log);
  detail::validate_joints(log);
  detail::note_joint_order(log);
  detail::turn_wrenches(log);
  return log;
}

/// The same, but all tables must be readable. Throws InputError.
inline sense::Recording read_log_folder(const std::string& path) {
  sense::Recording log = read_log_streams(path);
  require_readable(log);
  return log;
}

/// Reads a bag's tables, places of pictures, and session: `beside`, which somebody wrote, or else that of the files, or
/// the default one. A stream that cannot be read is empty, see Recording::reading. Throws InputError for what concerns
/// all of it.
template <sense::ChunkCodec... Codecs> sense::McapLog read_log_files(const sense::McapFiles<Codecs...>& files,
    sense::McapTopics topics = {}, const std::optional<sense::Session>& beside = {}) {
  const std::string attached = sense::attached_session(files);
  sense::Session session;
  if (beside) session = *beside;
  else if (!attached.empty()) session = session_from_json(attached, files.front()->name() + ": session.json");
  detail::choose(session, topics);
  topics.joint_names = session.joint_names;
  sense::McapLog m = read_mcap_log(files, topics);
  session.video.clear();  // the pictures are in the files
  m.log.session = std::move(session);
  detail::validate_joints(m.log);
  detail::note_joint_order(m.log);
  for (const sense::JoinedClock& joined : m.clocks) {
    sense::Session& read = m.log.session;
    sense::ClockMap& clock = joined.stream == sense::LogStream::joints ? read.joint_clock : read.wrench_clock;
    if (clock != sense::ClockMap{}) continue;
    clock = joined.clock;
    m.log.notes.push_back(joined.note);
  }
  detail::turn_wrenches(m.log);
  return m;
}

/// The same of a single MCAP file, all of whose streams must be readable. Throws InputError.
template <sense::ChunkCodec... Codecs>
sense::McapLog read_log_file(sense::McapReader<Codecs...>& file, const sense::McapTopics& topics = {}) {
  using Reader = sense::McapReader<Codecs...>;
  sense::McapLog m =
      read_log_files(sense::McapFiles<Codecs...>{std::shared_ptr<Reader>(std::shared_ptr<void>(), &file)}, topics);
  require_readable(m.log);
  return m;
}

/// Writes session.json and the tables that are not empty into an existing folder, and removes earlier tables of the
/// others; each file whole or not at all. Throws InputError, and InvalidArgument before anything is written for what
/// could not be read again.
inline void write_log_folder(const sense::Recording& log) {
  const std::pair<const char*, std::string> files[] = {{"session.json", to_json(log.session)},
      {"frames.csv", log.frames.empty() ? "" : frame_log_text(log.frames, !log.session.video.empty())},
      {"joint.csv", log.joints.empty() ? "" : joint_log_text(log.joints, log.joint_names)},
      {"wrench.csv", log.wrenches.empty() ? "" : wrench_log_text(log.wrenches)},
      {"marker.csv", log.markers.empty() ? "" : marker_log_text(log.markers)},
      {"photodiode.csv", log.photodiodes.empty() ? "" : photodiode_log_text(log.photodiodes)}};
  for (const auto& [name, text] : files) {
    std::error_code error;
    if (!text.empty()) write_whole(log.path + '/' + name, text);
    else if (!std::filesystem::remove(log.path + '/' + name, error) && error)
      throw InputError(message(log.path, '/', name, ": cannot be removed"));
  }
}

}  // namespace lumo
