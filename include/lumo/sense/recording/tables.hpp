#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/devices/photodiodes.hpp"
#include "lumo/sense/recording/alignment.hpp"
#include "lumo/sense/recording/csv.hpp"
#include "lumo/sense/recording/joint_names.hpp"
#include "lumo/sense/recording/joint_velocity.hpp"
#include "lumo/sense/recording/streams.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <fstream>
#include <initializer_list>
#include <istream>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace lumo::sense {

// A log is a folder (docs/log_format.md). All tables may be absent. Each has a column stamp_ns or time_s, which ascends
// strictly. Columns stand in any order; unknown ones are errors.
//
// - session.json: circumstances of the log (read by support/json.hpp)
// - frames.csv: file (a path below frames/), exposure_s, gain; beside a video.* it has no column file
// - frames/: 8-bit images, colour or grey
// - joint.csv: position_rad_0, velocity_rad_per_s_0, current_A_0 or torque_Nm_0, position_rad_1, …; joints may have
//   names in place of numbers
// - wrench.csv: force_x_N, force_y_N, force_z_N, and torque_x_Nm, torque_y_Nm, torque_z_Nm or none of the three
// - marker.csv: displacement_m
// - photodiode.csv: signal_V_0, signal_V_1, …

/// A row of frames.csv.
struct FrameRecord {
  std::int64_t stamp_ns = 0;
  std::string file;         ///< below frames/; empty in a video's table
  double exposure_s = 0.0;  ///< 0: unknown
  double gain = 0.0;        ///< 0: unknown
};

/// Name of a log's picture by its number: 000042.png.
inline std::string frame_file(std::size_t number, std::string_view ending = ".png") {
  const std::string digits = std::to_string(number);
  return std::string(digits.size() < 6 ? 6 - digits.size() : 0, '0') + digits + std::string(ending);
}

/// Wrench of the object on the finger by a force/torque sensor, in the finger's frame, about its origin.
struct WrenchSample {
  std::int64_t stamp_ns = 0;
  Vec3d force_N{0.0, 0.0, 0.0};
  Vec3d torque_Nm{0.0, 0.0, 0.0};
  double normal_force_N() const { return -force_N.z(); }  ///< positive if the finger is pressed
};

struct MarkerSample {
  std::int64_t stamp_ns = 0;
  double displacement_m = 0.0;
};

/// The time column of a log's table, as integer nanoseconds; strictly ascending, or made so at the end.
class StampColumn {
 public:
  /// `reading`: counts rows whose stamps do not ascend, which `finish` then leaves out; null: such a row is an error.
  explicit StampColumn(const CsvReader& csv, StreamReading* reading = nullptr)
      : column_(csv.find("stamp_ns")), seconds_(column_ < 0), reading_(reading) {
    if (seconds_) column_ = csv.find("time_s");
    if (column_ < 0) throw InputError(message(csv.name(), ":1: column 'stamp_ns' (or 'time_s') is missing"));
    if (!seconds_ && csv.find("time_s") >= 0)
      throw InputError(message(csv.name(), ":1: has both 'stamp_ns' and 'time_s'"));
  }
  std::int64_t read(const CsvReader& csv) {
    std::int64_t stamp = 0;
    if (seconds_) {
      const double s = csv.number(column_);
      if (std::abs(s) > 1e-9 * double(stamp_limit_ns)) csv.fail(column_, "s is beyond the range of stamps");
      stamp = std::llround(s * 1e9);
    } else {
      stamp = csv.integer(column_);
      if (stamp < -stamp_limit_ns || stamp > stamp_limit_ns) csv.fail(column_, "is beyond the range of stamps");
    }
    if (last_ && stamp <= *last_) {
      if (reading_ == nullptr) csv.fail(column_, "does not exceed the stamp before it");
      if (!backward_line_) backward_line_ = csv.line();
    }
    last_ = stamp;
    if (reading_ != nullptr) all_.push_back(stamp);
    return stamp;
  }
  /// The row that was read last lacks a number: it is left out, too. Throws InputError where such a row is an error.
  void leave_out(const CsvReader& csv, int column) {
    if (reading_ == nullptr) csv.fail(column, "is no finite number");
    if (incomplete_++ == 0) {
      try {
        csv.fail(column, "is no finite number");
      } catch (const InputError& e) {
        incomplete_fault_ = e.what();
      }
    }
    all_.pop_back();
  }
  /// To be called with all rows but those left out: leaves out those whose stamps do not ascend, too. Throws InputError
  /// for too many.
  template <class Row> void finish(const CsvReader& csv, std::vector<Row>& rows) {
    if (reading_ == nullptr) return;
    const AscendingRows ascending = ascending_rows(all_);
    *reading_ = ascending.reading;
    reading_->rows += incomplete_;
    reading_->incomplete = incomplete_;
    const std::string at_most =
        message(" of ", reading_->rows, " rows, at most ", 100.0 * StreamReading::most_left_out, " % are left out");
    if (reading_->is_beyond_limit())
      throw InputError(reading_->incomplete > 0
                           ? message(incomplete_fault_, ", as are some of ", reading_->left_out(), at_most)
                           : message(csv.name(), ':', *backward_line_, ": column ", seconds_ ? "time_s" : "stamp_ns",
                                 " does not exceed the stamp before it, and so do ", reading_->left_out(), at_most));
    keep_rows(rows, ascending.kept);
  }

 private:
  int column_;
  bool seconds_;
  StreamReading* reading_;
  std::optional<std::int64_t> last_;
  std::optional<long> backward_line_;
  std::vector<std::int64_t> all_;
  std::size_t incomplete_ = 0;
  std::string incomplete_fault_;
};

/// A path below a log's frames/ that a table can hold.
inline bool is_below_frames(std::string_view file) {
  const bool plain = std::none_of(
      file.begin(), file.end(), [](char c) { return c == ',' || c == '"' || static_cast<unsigned char>(c) < ' '; });
  return plain && !file.empty() && file.front() != '/' && file.front() != ' ' && file.back() != ' ' &&
         file.find("..") == std::string_view::npos && file.find('\\') == std::string_view::npos;
}

/// Text of a stamp to be written. Throws InvalidArgument for one that StampColumn would refuse.
inline std::string stamp_text(std::int64_t stamp_ns, std::optional<std::int64_t>& last) {
  if (stamp_ns < -stamp_limit_ns || stamp_ns > stamp_limit_ns || (last && stamp_ns <= *last))
    throw InvalidArgument(message("stamp to write is ", stamp_ns, " ns, must lie within 4.6e18 ns",
        last ? message(" and exceed the one before it, ", *last, " ns") : std::string()));
  last = stamp_ns;
  return std::to_string(stamp_ns);
}

inline bool is_time(std::string_view c) { return c == "stamp_ns" || c == "time_s"; }

/// Column of a name with a joint's (diode's) number behind it.
inline std::string numbered(const char* name, int i) { return std::string(name) + '_' + std::to_string(i); }

/// Column of a quantity with a joint's name behind it.
inline std::string named(const char* name, const std::string& joint) { return std::string(name) + '_' + joint; }

/// Opens a file for reading. Throws InputError.
inline std::ifstream open_text(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw InputError(message(path, ": cannot be opened"));
  return in;
}

/// Each of the readers below throws InputError, with file, line and column. With `reading` rows whose stamps do not
/// ascend are left out and counted there, up to its limit; without it such a row is an error.

/// Reads frames.csv. `video`: there is no column `file`. Files must be relative paths without "..".
inline std::vector<FrameRecord> read_frame_log(
    std::istream& in, const std::string& name, bool video = false, StreamReading* reading = nullptr) {
  CsvReader csv(in, name);
  csv.require_known(
      [&](std::string_view c) { return is_time(c) || c == "exposure_s" || c == "gain" || (!video && c == "file"); });
  StampColumn stamp(csv, reading);
  const int file = video ? -1 : csv.require("file"), exposure = csv.find("exposure_s"), gain = csv.find("gain");
  std::vector<FrameRecord> list;
  while (csv.next()) {
    FrameRecord f{stamp.read(csv), "", 0.0, 0.0};
    if (file >= 0) {
      f.file = csv.text(file);
      if (!is_below_frames(f.file)) csv.fail(file, "is no path below frames/");
    }
    if (exposure >= 0 && (f.exposure_s = csv.number(exposure)) < 0.0) csv.fail(exposure, "s is negative");
    if (gain >= 0 && (f.gain = csv.number(gain)) < 0.0) csv.fail(gain, "is negative");
    list.push_back(std::move(f));
  }
  stamp.finish(csv, list);
  return list;
}

/// The samples of a joint.csv, and what its joints are called.
struct JointTable {
  std::vector<std::string> names;  ///< of the samples' joints, in their order; empty: they are numbered
  std::vector<JointSample> samples;
};

namespace detail {

/// Columns of a joint.csv: which joint stands where.
struct JointColumns {
  std::vector<int> position, velocity, effort;  ///< of each joint that is read; velocity −1: there is none
  Effort unit = Effort::torque_Nm;
};

/// What stands behind "position_rad_" in the columns' names, in their order.
inline std::vector<std::string> joints_of(const CsvReader& csv) {
  constexpr std::string_view quantity = "position_rad_";
  std::vector<std::string> names;
  for (const std::string& c : csv.columns())
    if (c.starts_with(quantity)) names.push_back(c.substr(quantity.size()));
  return names;
}

/// Numbers of joints from 0 without gaps, in their order; empty for joints that have names.
inline std::vector<std::string> numbered_joints(const CsvReader& csv) {
  std::vector<std::string> numbers;
  const std::vector<std::string> all = joints_of(csv);
  if (!std::all_of(all.begin(), all.end(), is_joint_number)) return numbers;
  while (numbers.size() < std::size_t(max_joints) && csv.find(numbered("position_rad", int(numbers.size()))) >= 0)
    numbers.push_back(std::to_string(numbers.size()));
  if (numbers.empty()) csv.require("position_rad_0");
  return numbers;
}

inline JointColumns joint_columns(const CsvReader& csv, const std::vector<std::string>& joints, bool all) {
  JointColumns c;
  c.unit = csv.find(named("current_A", joints.front())) >= 0 ? Effort::current_A : Effort::torque_Nm;
  const char* const effort = c.unit == Effort::current_A ? "current_A" : "torque_Nm";
  const bool velocities = csv.find(named("velocity_rad_per_s", joints.front())) >= 0;
  for (const std::string& joint : joints) {
    c.position.push_back(csv.require(named("position_rad", joint)));
    c.velocity.push_back(velocities ? csv.require(named("velocity_rad_per_s", joint)) : -1);
    c.effort.push_back(csv.require(named(effort, joint)));
  }
  const std::vector<std::string> others = all ? std::vector<std::string>() : joints_of(csv);
  csv.require_known([&](std::string_view column) {
    const auto is_of = [&](const std::vector<std::string>& some, std::initializer_list<const char*> quantities) {
      return std::any_of(some.begin(), some.end(), [&](const std::string& joint) {
        return std::any_of(
            quantities.begin(), quantities.end(), [&](const char* q) { return column == named(q, joint); });
      });
    };
    return is_time(column) || is_of(joints, {"position_rad", "velocity_rad_per_s", effort}) ||
           is_of(others, {"position_rad", "velocity_rad_per_s", "current_A", "torque_Nm"});
  });
  return c;
}

}  // namespace detail

/// Reads joint.csv. Joints are numbered from 0 without gaps, or have names; all have a current or all a torque. Of
/// `wanted` joints these are read, in this order, and others need not even have numbers; numbered joints of as many
/// are taken to have these names. Without columns for velocities, or in rows where one is empty or NaN, velocities
/// follow from the positions. A row without a position or an effort is left out as one whose stamp does not ascend.
inline JointTable read_joint_table(std::istream& in, const std::string& name, StreamReading* reading = nullptr,
    const std::vector<std::string>& wanted = {}) {
  CsvReader csv(in, name);
  StampColumn stamp(csv, reading);
  JointTable table;
  const std::vector<std::string> there = detail::joints_of(csv), numbers = detail::numbered_joints(csv);
  const bool has_names = numbers.empty(),
             chosen = !wanted.empty() && (has_names || std::all_of(wanted.begin(), wanted.end(), is_joint_number));
  if (chosen) places_of(wanted, there, name + ":1");
  if (!chosen && !wanted.empty() && wanted.size() != numbers.size())
    throw InputError(message(name, ":1: has ", numbers.size(), " joints by numbers, chosen by name are ", wanted.size(),
        ", ", joint_list(wanted)));
  table.names = !wanted.empty() ? wanted : has_names ? there : std::vector<std::string>();
  const std::vector<std::string>& joints = chosen ? wanted : has_names ? there : numbers;
  if (joints.size() > std::size_t(max_joints))
    throw InputError(message(name, ":1: has ", joints.size(), " joints, must have 1 to ", max_joints));
  const detail::JointColumns column = detail::joint_columns(csv, joints, !chosen);
  const auto n = Eigen::Index(joints.size());
  while (csv.next()) {
    JointSample s{stamp.read(csv), JointVector(n), JointVector(n), JointVector(n), column.unit};
    bool whole = true, with_velocity = column.velocity[0] >= 0;
    for (std::size_t j = 0; j < joints.size() && whole; ++j) {
      for (const int c : {column.position[j], column.effort[j]})
        if (whole && csv.is_blank(c)) {
          stamp.leave_out(csv, c);
          whole = false;
        }
      if (!whole) break;
      s.position_rad[Eigen::Index(j)] = csv.number(column.position[j]);
      s.effort[Eigen::Index(j)] = csv.number(column.effort[j]);
      with_velocity = with_velocity && !csv.is_blank(column.velocity[j]);
      if (with_velocity) s.velocity_rad_per_s[Eigen::Index(j)] = csv.number(column.velocity[j]);
    }
    if (!with_velocity) s.velocity_rad_per_s.resize(0);
    if (whole) table.samples.push_back(std::move(s));
  }
  stamp.finish(csv, table.samples);
  find_velocities(table.samples);
  return table;
}

/// Its samples alone.
inline std::vector<JointSample> read_joint_log(
    std::istream& in, const std::string& name, StreamReading* reading = nullptr) {
  return read_joint_table(in, name, reading).samples;
}

/// Reads wrench.csv; torques may be absent altogether.
inline std::vector<WrenchSample> read_wrench_log(
    std::istream& in, const std::string& name, StreamReading* reading = nullptr) {
  static constexpr const char* forces[] = {"force_x_N", "force_y_N", "force_z_N"};
  static constexpr const char* torques[] = {"torque_x_Nm", "torque_y_Nm", "torque_z_Nm"};
  CsvReader csv(in, name);
  StampColumn stamp(csv, reading);
  bool with_torque = false;
  for (const char* t : torques) with_torque = with_torque || csv.find(t) >= 0;
  int column[6] = {};
  for (int k = 0; k < 3; ++k) {
    column[k] = csv.require(forces[k]);
    column[3 + k] = with_torque ? csv.require(torques[k]) : -1;
  }
  csv.require_known([&](std::string_view c) {
    bool known = is_time(c);
    for (int k = 0; k < 3; ++k) known = known || c == forces[k] || c == torques[k];
    return known;
  });
  std::vector<WrenchSample> list;
  while (csv.next()) {
    WrenchSample w;
    w.stamp_ns = stamp.read(csv);
    for (int k = 0; k < 3; ++k) {
      w.force_N[k] = csv.number(column[k]);
      if (with_torque) w.torque_Nm[k] = csv.number(column[3 + k]);
    }
    list.push_back(w);
  }
  stamp.finish(csv, list);
  return list;
}

/// Reads marker.csv.
inline std::vector<MarkerSample> read_marker_log(
    std::istream& in, const std::string& name, StreamReading* reading = nullptr) {
  CsvReader csv(in, name);
  StampColumn stamp(csv, reading);
  const int place = csv.require("displacement_m");
  csv.require_known([](std::string_view c) { return is_time(c) || c == "displacement_m"; });
  std::vector<MarkerSample> list;
  while (csv.next()) {
    const std::int64_t at = stamp.read(csv);
    list.push_back({at, csv.number(place)});
  }
  stamp.finish(csv, list);
  return list;
}

/// Reads photodiode.csv: stamp_ns (or time_s), signal_V_0, signal_V_1, … without gaps in the numbers. Throws
/// InputError.
inline std::vector<PhotodiodeSample> read_photodiode_log(
    std::istream& in, const std::string& name, StreamReading* reading = nullptr) {
  CsvReader csv(in, name);
  StampColumn stamp(csv, reading);
  std::vector<int> column;
  while (csv.find(numbered("signal_V", int(column.size()))) >= 0)
    column.push_back(csv.find(numbered("signal_V", int(column.size()))));
  if (column.empty()) csv.require("signal_V_0");
  csv.require_known([&](std::string_view c) {
    bool known = is_time(c);
    for (std::size_t i = 0; i < column.size(); ++i) known = known || c == numbered("signal_V", int(i));
    return known;
  });
  std::vector<PhotodiodeSample> list;
  while (csv.next()) {
    PhotodiodeSample s{stamp.read(csv), Eigen::VectorXd(Eigen::Index(column.size()))};
    for (std::size_t i = 0; i < column.size(); ++i) s.signal_V[Eigen::Index(i)] = csv.number(column[i]);
    list.push_back(std::move(s));
  }
  stamp.finish(csv, list);
  return list;
}

inline std::string frame_header(bool video) {
  return video ? "stamp_ns,exposure_s,gain\n" : "stamp_ns,file,exposure_s,gain\n";
}

inline std::string frame_row(const FrameRecord& f, bool video, std::optional<std::int64_t>& last) {
  if (!video && !is_below_frames(f.file))
    throw InvalidArgument("frame log: a file is no path below frames/, or holds a comma, quote or line's end");
  if (f.exposure_s < 0.0 || f.gain < 0.0)
    throw InvalidArgument(
        message("frame log: exposure is ", f.exposure_s, " s, gain ", f.gain, ", must not be negative"));
  return stamp_text(f.stamp_ns, last) + ',' + (video ? "" : f.file + ',') + csv_number(f.exposure_s) + ',' +
         csv_number(f.gain) + '\n';
}

inline std::string joint_header(const std::vector<std::string>& joints, Effort unit) {
  std::string t = "stamp_ns";
  for (const std::string& joint : joints)
    for (const char* column :
        {"position_rad", "velocity_rad_per_s", unit == Effort::current_A ? "current_A" : "torque_Nm"})
      t += ',' + named(column, joint);
  return t + '\n';
}

inline std::string joint_header(int joints, Effort unit) {
  std::vector<std::string> numbers;
  for (int j = 0; j < joints; ++j) numbers.push_back(std::to_string(j));
  return joint_header(numbers, unit);
}

inline std::string joint_row(const JointSample& s, std::optional<std::int64_t>& last) {
  std::string t = stamp_text(s.stamp_ns, last);
  for (Eigen::Index j = 0; j < s.effort.size(); ++j)
    t +=
        ',' + csv_number(s.position_rad[j]) + ',' + csv_number(s.velocity_rad_per_s[j]) + ',' + csv_number(s.effort[j]);
  return t + '\n';
}

/// The tables as text, with numbers that read back as they were. They throw InvalidArgument for values that the readers
/// refuse.
inline std::string frame_log_text(const std::vector<FrameRecord>& frames, bool video = false) {
  std::string t = frame_header(video);
  std::optional<std::int64_t> last;
  for (const FrameRecord& f : frames) t += frame_row(f, video, last);
  return t;
}

/// `names`: of the joints; empty: they are numbered.
inline std::string joint_log_text(const std::vector<JointSample>& samples, const std::vector<std::string>& names = {}) {
  if (samples.empty()) return joint_header(1, Effort::current_A);
  const auto joints = samples.front().effort.size();
  const Effort unit = samples.front().unit;
  if (!names.empty() && (names.size() != std::size_t(joints) || !are_column_names(names)))
    throw InvalidArgument(
        message("joint log: ", joints, " joints cannot have columns of the names ", joint_list(names)));
  std::string t = names.empty() ? joint_header(int(joints), unit) : joint_header(names, unit);
  std::optional<std::int64_t> last;
  for (const JointSample& s : samples) {
    if (s.effort.size() != joints || s.position_rad.size() != joints || s.velocity_rad_per_s.size() != joints ||
        s.unit != unit)
      throw InvalidArgument("joint log: samples must have the same number of joints and the same kind of effort");
    t += joint_row(s, last);
  }
  return t;
}

inline std::string wrench_log_text(const std::vector<WrenchSample>& samples) {
  std::string t = "stamp_ns,force_x_N,force_y_N,force_z_N,torque_x_Nm,torque_y_Nm,torque_z_Nm\n";
  std::optional<std::int64_t> last;
  for (const WrenchSample& w : samples) {
    t += stamp_text(w.stamp_ns, last);
    for (const Vec3d& v : {w.force_N, w.torque_Nm})
      for (int k = 0; k < 3; ++k) t += ',' + csv_number(v[k]);
    t += '\n';
  }
  return t;
}

inline std::string marker_log_text(const std::vector<MarkerSample>& samples) {
  std::string t = "stamp_ns,displacement_m\n";
  std::optional<std::int64_t> last;
  for (const MarkerSample& m : samples) t += stamp_text(m.stamp_ns, last) + ',' + csv_number(m.displacement_m) + '\n';
  return t;
}

inline std::string photodiode_log_text(const std::vector<PhotodiodeSample>& samples) {
  std::string t = "stamp_ns";
  const auto n = samples.empty() ? Eigen::Index(1) : samples.front().signal_V.size();
  for (Eigen::Index i = 0; i < n; ++i) t += ',' + numbered("signal_V", int(i));
  t += '\n';
  std::optional<std::int64_t> last;
  for (const PhotodiodeSample& s : samples) {
    if (s.signal_V.size() != n) throw InvalidArgument("photodiode log: samples must have the same number of diodes");
    t += stamp_text(s.stamp_ns, last);
    for (Eigen::Index i = 0; i < n; ++i) t += ',' + csv_number(s.signal_V[i]);
    t += '\n';
  }
  return t;
}

}  // namespace lumo::sense
