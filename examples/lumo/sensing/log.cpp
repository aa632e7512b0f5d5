#include "sensing/log.hpp"

#include "sensing/checks.hpp"

#include <cmath>

namespace lumo::program {

std::unique_ptr<AnyCamera> LogCamera::open(const OpenLog& log) {
  using FileCamera = McapCamera<Decoder, Lz4, Zstd>;
  if (!log.session.video.empty()) return pictures().video(log.path + '/' + log.session.video, log.frames);
  if (log.frames.empty())
    throw InputError(log.path + (log.file ? ": has no pictures" : ": has no frames.csv, or it is empty"));
  if (log.file) return std::make_unique<Held<FileCamera>>(FileCamera(log.file, log.pictures, log.frames));
  return pictures().folder(log.path + "/frames", log.frames);
}

UnloadedStretch unloaded_stretch(const OpenLog& log) {
  return UnloadedStretch::of(log.session, log.frames.empty() ? 0 : log.frames.front().stamp_ns);
}

OpenLog open_log(const std::string& path, Progress& progress, const McapTopics& topics) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return {read_log_folder(path), nullptr, {}};
  const auto file = std::make_shared<LogFile>(LogFile::open(path));
  McapLog read = read_log_file(*file, topics);
  if (!file->fault().empty()) progress.note(file->fault() + "; read up to there");
  return {std::move(read.log), file, std::move(read.pictures)};
}

FingerOptics optics_of(const SensedLog& s, const std::string& path, Progress& progress) {
  FingerOptics optics;
  optics.bins = s.bins;
  optics.view = s.view;
  const CheckedReference checked = checked_reference(s.profiles, s.stretch, path, s.view.unchanged);
  tell_reference(s, checked, progress);
  optics.unloaded = checked.reference;
  return optics;
}

SensedLog read_sensed_log(
    const std::string& path, const LongitudinalBins& bins, Progress& progress, const UnloadedSeconds& unloaded) {
  SensedLog s;
  s.bins = bins;
  s.log = open_log(path, progress);
  s.joints = on_frames_clock(s.log);
  s.stretch = unloaded_stretch(s.log);
  if (unloaded) {
    const std::int64_t first = s.log.frames.empty() ? 0 : s.log.frames.front().stamp_ns;
    s.stretch = {first + std::llround(1e9 * (*unloaded)[0]), first + std::llround(1e9 * (*unloaded)[1]), true};
  }
  about(path, [&] {
    LogCamera first(s.log);
    s.view = view_finger(first, s.log.session, s.stretch, path);
    GreenProfile readout = s.view.readout(bins);
    LogCamera all(s.log);
    s.profiles = read_profiles(all, readout);
  });
  if (s.profiles.empty()) throw InputError(path + ": no picture can be read");
  return s;
}

OpenLog open_hand_log(const std::string& path, Progress& progress) {
  OpenLog log = open_log(path, progress);
  if (log.session.links.empty())
    throw InputError(
        log.session_place() + ": links is missing, which describes the links of a hand (docs/log_format.md)");
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
