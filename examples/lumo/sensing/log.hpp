#pragma once

#include "console/progress.hpp"
#include "lumo/sense/estimate.hpp"
#include "lumo/sense/recording/mcap/mcap_camera.hpp"
#include "lumo/support/json.hpp"
#include "lumo/support/lz4.hpp"
#include "lumo/support/zstd.hpp"
#include "sensing/pictures.hpp"

#include <array>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <vector>

namespace lumo::program {

using namespace sense;

using LogFile = McapReader<Lz4, Zstd>;
using LogFiles = McapFiles<Lz4, Zstd>;

/// A log, and what is needed to get at its pictures.
struct OpenLog : Recording {
  LogFiles files;                     ///< of a bag; none: `path` is a folder of tables
  std::vector<McapPicture> pictures;  ///< of the frames in `files`
  std::string contents;               ///< of a bag, its topics

  bool is_bag() const { return !files.empty(); }
  /// Who reads an error looks there.
  std::string session_place() const { return is_bag() ? path + ": session.json" : path + "/session.json"; }
  /// Of the virtual lab: truth.csv in the folder, or NAME.truth.csv beside NAME.mcap.
  std::string truth_file() const;
  /// Place and reason of the end of a file that was cut; empty for whole files.
  std::string cut() const;
};

/// Reads a log's folder, an MCAP file, or a ROS 2 bag's folder of them; where one was cut, a note reports it and the
/// file ends there. A stream that cannot be read is empty, see Recording::reading. Throws InputError.
OpenLog open_log(const std::string& path, Progress& progress, const McapTopics& topics = {});

/// A log of a hand: its session describes links, and it has joint samples. Throws InputError.
OpenLog open_hand_log(const std::string& path, Progress& progress, const McapTopics& topics);

/// When nothing touches the log's finger for the first time.
UnloadedStretch unloaded_stretch(const OpenLog& log);

/// What became of a log's pictures. Those of a video that ended too soon are missing.
struct PictureCount {
  std::size_t rows = 0, read = 0, missing = 0, damaged = 0;
  std::size_t other_size = 0;  ///< of those read: not of the size or format of the unloaded ones

  std::size_t lost() const { return missing + damaged + other_size; }
};

/// A log's pictures, from a folder, a video or MCAP files.
class LogCamera {
 public:
  /// `log` lives at least as long. Throws InputError without pictures.
  explicit LogCamera(const OpenLog& log) : log_(&log), source_(open(log)) { count_.rows = log.frames.size(); }
  std::optional<Frame> next();
  StreamState state() const { return source_->state(); }
  /// Of what `next` has given; when it gives no more, of all.
  const PictureCount& count() const { return count_; }

 private:
  static std::unique_ptr<AnyCamera> open(const OpenLog& log);
  bool is_missing(std::size_t frame) const;

  const OpenLog* log_;
  std::unique_ptr<AnyCamera> source_;
  PictureCount count_;
};

static_assert(Camera<LogCamera>);

/// A log as the sensing commands need it: read once.
struct SensedLog {
  OpenLog log;
  std::vector<JointSample> joints;  ///< on the frames' clock
  UnloadedStretch stretch;
  FingerView view;
  std::vector<Profile> profiles;  ///< of `bins`
  Flicker flicker;                ///< that was divided out of them
  PictureCount pictures;
  LongitudinalBins bins = LongitudinalBins::uniform(-27.5_mm, 27.5_mm, 55);
};

/// What a lab left beside a log of what was really so; nullopt if there is none. For whoever compares, when all
/// estimates are made. Throws InputError.
template <class Table> std::optional<Table> left_truth(const OpenLog& log) {
  const std::string file = log.truth_file();
  std::error_code error;
  if (!std::filesystem::exists(file, error)) return std::nullopt;
  std::ifstream in(file, std::ios::binary);
  return Table::from_table(in, file);
}

/// A command's words on InvalidArgument are about the log, not about the command line.
template <class Work> auto about(const std::string& path, Work work) {
  try {
    return work();
  } catch (const InvalidArgument& e) {
    throw InputError(path + ": " + e.what());
  }
}

/// The truth where a lab left one, else what segments and the force sensor say. For whoever compares, when all
/// estimates are made.
LogTruth truth_of(const OpenLog& log);

/// What its unloaded pictures show; notes state what speaks against them. Throws InputError; `path` is named in it.
FingerOptics optics_of(const SensedLog& s, const std::string& path, Progress& progress);

/// When the finger was unloaded [s after the first picture].
using UnloadedSeconds = std::optional<std::array<double, 2>>;

/// `unloaded`: as somebody states; empty: as the session does. Throws InputError.
SensedLog read_sensed_log(const std::string& path, const LongitudinalBins& bins, Progress& progress,
    const McapTopics& topics, const UnloadedSeconds& unloaded = {});

}  // namespace lumo::program
