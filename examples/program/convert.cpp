#include "program/convert.hpp"

#include "lumo/core/read_whole.hpp"
#include "lumo/core/write_whole.hpp"
#include "lumo/sense/recording/mcap/mcap_log_writer.hpp"
#include "program/interrupt.hpp"
#include "program/json.hpp"
#include "program/new_folder.hpp"
#include "program/sensing_log.hpp"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

namespace lumo::program {

namespace fs = std::filesystem;

namespace {

/// A file that takes its name only when it is whole.
class NewFile {
 public:
  explicit NewFile(const std::string& path) : path_(path), part_(path + ".part-" + std::to_string(getpid())) {
    std::error_code error;
    if (fs::exists(path_, error)) throw InputError("cannot write to '" + path + "': it is there");
    errno = 0;
    stream.open(part_, std::ios::binary);
    if (!stream) throw InputError("cannot write to '" + path + "': " + std::strerror(errno != 0 ? errno : EIO));
  }
  ~NewFile() {
    std::error_code error;
    if (!part_.empty()) fs::remove(part_, error);
  }
  NewFile(const NewFile&) = delete;
  NewFile& operator=(const NewFile&) = delete;

  void keep() {
    const FilesBeingWritten whole;
    stream.close();
    std::error_code error;
    if (!stream) error = std::make_error_code(std::errc::io_error);
    else fs::rename(part_, path_, error);
    if (error) throw InputError("cannot write to '" + path_ + "': " + error.message());
    part_.clear();
  }

  std::ofstream stream;

 private:
  std::string path_, part_;
};

/// A log's pictures one after the other, as files where they are files.
class Pictures {
 public:
  explicit Pictures(const OpenLog& log) : log_(log) {
    if (!log.frames.empty()) camera_.emplace(log);
  }

  /// Goes to the next picture. Throws InputError where a video has fewer than its table.
  void next() {
    const std::size_t k = count_++;
    file_.clear();
    view_ = {};
    if (log_.file && log_.pictures[k].compressed) {
      const McapMessage m = log_.file->read(log_.pictures[k].at);
      const auto data = from_cdr<RosCompressedImage>(m.data).data;
      file_.assign(data.begin(), data.end());
    } else if (!log_.file && log_.session.video.empty()) {
      const auto bytes = read_whole(fs::path(log_.path) / "frames" / log_.frames[k].file);
      if (bytes) file_.assign(bytes->begin(), bytes->end());
    } else if (const auto f = camera_->next()) {
      view_ = f->image;
    } else {
      throw InputError(lumo::message(log_.path, ": ends after ", k, " of ", log_.frames.size(), " pictures"));
    }
  }
  /// Bytes of a PNG or JPEG, and their ending; else the picture's pixels are all there is.
  const std::vector<std::uint8_t>& file() const { return file_; }
  std::string ending() const { return std::string(lumo::sense::picture_ending(file_)); }
  /// May be empty.
  ImageView pixels() { return file_.empty() ? view_ : decode_(file_); }

 private:
  const OpenLog& log_;
  std::optional<LogCamera> camera_;
  std::vector<std::uint8_t> file_;
  ImageView view_;
  ImageDecoder decode_;
  std::size_t count_ = 0;
};

void copy_truth(const std::string& from, const std::string& to, bool& copied) {
  std::error_code error;
  if (!fs::exists(from, error)) return;
  const auto bytes = read_whole(from);
  if (!bytes) throw InputError(from + ": cannot be read");
  write_whole(to, *bytes);
  copied = true;
}

void write_file(const OpenLog& log, const Options& o, Progress& progress) {
  NewFile out(o.target);
  Recording tables = log;
  tables.session.video.clear();  // its frames go into the file
  Pictures pictures(log);
  int width = 0, height = 0;
  const auto picture = [&](std::size_t) {
    pictures.next();
    McapPictureData p;
    const std::string ending = pictures.ending();
    const bool as_it_is = !o.raw && !ending.empty();
    if (!as_it_is || width == 0) {
      p.pixels = pictures.pixels();
      if (!p.pixels.empty()) width = p.pixels.width, height = p.pixels.height;
    }
    p.width = width, p.height = height;
    if (as_it_is) p.format = ending == ".jpg" ? "jpeg" : "png", p.file = pictures.file();
    else if (!o.raw) p.format = "png", p.file = p.pixels.empty() ? std::vector<std::uint8_t>() : encode_image(".png", p.pixels);
    progress.step();
    return p;
  };
  const auto write = [&](const auto& codec) { write_mcap_log(out.stream, tables, to_json(tables.session), picture, codec); };
  if (o.compression == "none") write(Uncompressed{});
  else if (o.compression == "lz4") write(Lz4{});
  else write(Zstd{});
  out.keep();
}

void write_folder(const OpenLog& log, const Options& o, Progress& progress, bool& truth) {
  NewFolder folder(o.target);
  Recording tables = log;
  tables.path = folder.path().string();
  tables.session.video.clear();
  Pictures pictures(log);
  for (std::size_t k = 0; k < tables.frames.size(); ++k) {
    pictures.next();
    std::string& name = tables.frames[k].file;
    if (name.empty()) {  // of a video
      name = frame_file(k);
    }
    const fs::path to = folder.path() / "frames" / name;
    std::error_code error;
    fs::create_directories(to.parent_path(), error);
    const bool as_it_is = !pictures.file().empty() && (!log.file || !pictures.ending().empty());
    if (as_it_is) write_whole(to.string(), {reinterpret_cast<const char*>(pictures.file().data()), pictures.file().size()});
    else if (const ImageView v = pictures.pixels(); !v.empty()) write_image(to.string(), v);
    progress.step();
  }
  write_log_folder(tables);
  copy_truth(log.truth_file(), (folder.path() / "truth.csv").string(), truth);
  folder.keep();
}

}  // namespace

std::string convert(const Options& o, Progress& progress) {
  progress.stage("reading the log");
  const OpenLog log = open_log(o.log, progress, {o.image_topic, o.joint_topic, o.wrench_topic});
  progress.step();
  bool truth = false;
  progress.stage("pictures", int(log.frames.size()));
  try {
    if (fs::path(o.target).extension() == ".mcap") {
      write_file(log, o, progress);
      copy_truth(log.truth_file(), fs::path(o.target).replace_extension(".truth.csv").string(), truth);
    } else {
      write_folder(log, o, progress, truth);
    }
  } catch (const InvalidArgument& e) {
    throw InputError(o.log + ": " + e.what());
  }
  progress.finish();
  const bool cut = log.file && !log.file->fault().empty();
  if (o.json)
    return Json{{"out", o.target}, {"frames", log.frames.size()}, {"joint_samples", log.joints.size()}, {"wrench_samples", log.wrenches.size()}, {"marker_samples", log.markers.size()},
                {"photodiode_samples", log.photodiodes.size()}, {"truth", truth}, {"fault", cut ? Json(log.file->fault()) : Json(nullptr)}}.dump(2) + "\n";
  return lumo::message(o.target, ": ", log.frames.size(), " pictures, ", log.joints.size(), " joint samples, ", log.wrenches.size(), " wrenches, ", log.markers.size(), " displacements, ",
                            log.photodiodes.size(), " photodiode samples", truth ? ", truth beside them" : "", cut ? "; the log was cut" : "", "\n");
}

}  // namespace lumo::program
