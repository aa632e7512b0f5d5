#include "sensing/log.hpp"

#include "lumo/core/files.hpp"
#include "lumo/sense/recording/mcap/bag_metadata.hpp"
#include "sensing/checks.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <optional>
#include <sstream>
#include <string_view>

namespace lumo::program {

namespace fs = std::filesystem;

namespace {

/// The first bytes of a file; fewer where it ends.
std::string beginning(const fs::path& path) {
  std::string bytes(16, '\0');
  std::ifstream in(path, std::ios::binary);
  in.read(bytes.data(), std::streamsize(bytes.size()));
  bytes.resize(std::size_t(std::max<std::streamsize>(0, in.gcount())));
  return bytes;
}

/// Throws InputError for files of other kinds, which it names.
void refuse_others(const std::string& path, std::string_view begins) {
  if (begins.starts_with("#ROSBAG"))
    throw InputError(path +
                     ": is a bag of ROS 1; 'rosbags-convert --src X.bag --dst X' (pip install rosbags) makes "
                     "one of ROS 2, which is read");
  if (begins.starts_with("SQLite format 3"))
    throw InputError(path +
                     ": is a bag of ROS 2 in SQLite; 'ros2 bag convert' makes one of MCAP (storage_id: mcap), "
                     "which is read");
  const std::size_t first = begins.find_first_not_of(" \t\r\n");
  if (first != std::string_view::npos && (begins[first] == '{' || begins[first] == '['))
    throw InputError(path + ": is JSON, read are MCAP files and folders (docs/log_format.md)");
}

/// One file of a bag, which may be packed as a whole.
std::shared_ptr<LogFile> open_file(const std::string& path) {
  constexpr std::string_view zstd_magic = "\x28\xB5\x2F\xFD";
  constexpr std::uint64_t most_bytes = 4ull << 30;
  const std::string begins = beginning(path);
  refuse_others(path, begins);
  if (!begins.starts_with(zstd_magic)) return std::make_shared<LogFile>(LogFile::open(path));
  const auto packed = read_whole(path);
  if (!packed) throw InputError(path + ": cannot be read");
  const std::span<const std::uint8_t> bytes(reinterpret_cast<const std::uint8_t*>(packed->data()), packed->size());
  const auto size = Zstd::frame_bytes(bytes);
  if (!size || *size > most_bytes)
    throw InputError(path +
                     ": is packed by Zstandard and does not say how much it holds, or more than 4 GiB; 'zstd -d' "
                     "unpacks it");
  try {
    const std::vector<std::uint8_t> whole = Zstd{}.decompress(bytes, std::size_t(*size));
    return std::make_shared<LogFile>(
        std::make_unique<std::istringstream>(std::string(whole.begin(), whole.end())), path);
  } catch (const InputError& e) {
    throw InputError(path + ": " + e.what());
  }
}

bool is_bag_file(const std::string& name) { return name.ends_with(".mcap") || name.ends_with(".mcap.zstd"); }

/// Files of a bag's folder in their order; none if it is a folder of tables. Throws InputError.
std::vector<std::string> bag_files(const std::string& folder, Progress& progress) {
  std::error_code error;
  const fs::path metadata = fs::path(folder) / "metadata.yaml";
  std::vector<std::string> files;
  if (const auto text = fs::exists(metadata, error) ? read_whole(metadata) : std::nullopt) {
    for (const std::string& named : bag_metadata(*text, metadata.string()).files) {
      const fs::path name(named), at = fs::path(folder);
      std::string found;
      for (const fs::path& candidate : {at / name, at / name.filename(), at / (named + ".zstd"), at / name.stem()})
        if (found.empty() && fs::is_regular_file(candidate, error)) found = candidate.string();
      if (found.empty()) throw InputError(metadata.string() + ": file '" + printable(named) + "' is missing");
      files.push_back(found);
    }
    return files;
  }
  if (fs::exists(fs::path(folder) / "session.json", error)) return files;
  for (fs::directory_iterator i(folder, error), end; !error && i != end; i.increment(error))
    if (is_bag_file(i->path().filename().string())) files.push_back(i->path().string());
  sort_by_number(files);
  if (!files.empty())
    progress.note(folder + ": has no metadata.yaml; its files are read in the order of their numbers");
  return files;
}

OpenLog open_bag(const std::string& path, const std::vector<std::string>& names, const McapTopics& topics) {
  LogFiles files;
  for (const std::string& name : names) files.push_back(open_file(name));
  std::error_code error;
  std::optional<Session> beside;  // somebody described the bag there
  if (const std::string session = path + "/session.json"; names.front() != path && fs::exists(session, error))
    beside = read_session(session);
  McapLog read = read_log_files(files, topics, beside);
  read.log.path = path;
  return {std::move(read.log), std::move(files), std::move(read.pictures), std::move(read.contents)};
}

}  // namespace

std::string OpenLog::truth_file() const {
  if (!is_bag() || files.front()->name() != path) return path + "/truth.csv";
  return fs::path(path).replace_extension(".truth.csv").string();
}

std::string OpenLog::cut() const {
  for (const auto& file : files)
    if (!file->fault().empty()) return file->fault();
  return "";
}

std::unique_ptr<AnyCamera> LogCamera::open(const OpenLog& log) {
  using FileCamera = McapCamera<Decoder, Lz4, Zstd>;
  require_readable(log, LogStream::frames);
  if (!log.session.video.empty()) return pictures().video(log.path + '/' + log.session.video, log.frames);
  if (log.frames.empty())
    throw InputError(!log.is_bag()          ? log.path + ": has no frames.csv, or it is empty"
                     : log.contents.empty() ? log.path + ": has no messages"
                                            : log.path +
                                                  ": has no pictures (sensor_msgs/msg/Image or CompressedImage, "
                                                  "cdr), but " +
                                                  log.contents);
  if (log.is_bag()) return std::make_unique<Held<FileCamera>>(FileCamera(log.files, log.pictures, log.frames));
  return pictures().folder(log.path + "/frames", log.frames);
}

bool LogCamera::is_missing(std::size_t frame) const {
  std::error_code error;
  if (!log_->is_bag()) return !fs::exists(fs::path(log_->path) / "frames" / log_->frames[frame].file, error);
  const McapPicture& p = log_->pictures[frame];
  const McapMessage m = log_->files[p.file]->read(p.at);
  return p.compressed ? from_cdr<RosCompressedImage>(m.data).data.empty() : from_cdr<RosImage>(m.data).width == 0;
}

std::optional<Frame> LogCamera::next() {
  auto frame = source_->next();
  if (frame)
    ++(!frame->image.empty() ? count_.read : is_missing(std::size_t(frame->index)) ? count_.missing : count_.damaged);
  else count_.missing = count_.rows - count_.read - count_.damaged;
  return frame;
}

UnloadedStretch unloaded_stretch(const OpenLog& log) {
  return UnloadedStretch::of(log.session, log.frames.empty() ? 0 : log.frames.front().stamp_ns);
}

OpenLog open_log(const std::string& path, Progress& progress, const McapTopics& topics) {
  std::error_code error;
  const bool is_file = fs::is_regular_file(path, error);
  const std::vector<std::string> names = is_file ? std::vector{path} : bag_files(path, progress);
  OpenLog log = names.empty() ? OpenLog{read_log_streams(path, topics), {}, {}, {}} : open_bag(path, names, topics);
  if (const std::string cut = log.cut(); !cut.empty()) progress.note(cut + "; read up to there");
  for (const std::string& note : log.notes) progress.note(path + ": " + note);
  return log;
}

FingerOptics optics_of(const SensedLog& s, const std::string& path, Progress& progress) {
  FingerOptics optics;
  optics.bins = s.bins;
  optics.view = s.view;
  const CheckedReference checked = checked_reference(s.profiles, s.stretch, path, s.view.repeats(s.bins));
  tell_reference(s, checked, progress);
  optics.unloaded = checked.reference;
  return optics;
}

SensedLog read_sensed_log(const std::string& path, const LongitudinalBins& bins, Progress& progress,
    const McapTopics& topics, const UnloadedSeconds& unloaded) {
  SensedLog s;
  s.bins = bins;
  s.log = open_log(path, progress, topics);
  require_nanoseconds(s.log);
  s.joints = on_frames_clock(s.log);
  s.stretch = unloaded_stretch(s.log);
  if (unloaded) {
    const std::int64_t first = s.log.frames.empty() ? 0 : s.log.frames.front().stamp_ns;
    s.stretch = {{first + std::llround(1e9 * (*unloaded)[0]), first + std::llround(1e9 * (*unloaded)[1])}, true};
  }
  about(path, [&] {
    LogCamera first(s.log);
    s.view = view_finger(first, s.log.session, s.stretch, path);
    GreenProfile readout = s.view.readout(bins);
    LogCamera all(s.log);
    s.profiles = read_profiles(all, readout);
    s.flicker = take_out_flicker(s.view, s.profiles, s.stretch);
    s.pictures = all.count();
    s.pictures.other_size = s.pictures.read - std::min(s.pictures.read, s.profiles.size());
  });
  if (s.profiles.empty()) throw InputError(path + ": no picture can be read");
  tell_wrenches(s.log, progress);
  return s;
}

OpenLog open_hand_log(const std::string& path, Progress& progress, const McapTopics& topics) {
  OpenLog log = open_log(path, progress, topics);
  if (log.session.links.empty())
    throw InputError(
        log.session_place() + ": links is missing, which describes the links of a hand (docs/log_format.md)");
  require_readable(log, LogStream::joints);
  if (log.joints.empty())
    throw InputError(path + ": has no joint samples (joint.csv), which distinguish the unloaded pictures");
  return log;
}

/// The truth where a lab left one, else what segments and the force sensor say. Opened when all estimates are made.
LogTruth truth_of(const OpenLog& log) {
  if (auto truth = left_truth<LogTruth>(log)) return std::move(*truth);
  return about(log.path, [&] { return LogTruth::from_log(log.session, log.wrenches); });
}

}  // namespace lumo::program
