#include "commands/logs.hpp"
#include "console/interrupt.hpp"
#include "console/new_folder.hpp"
#include "report/json.hpp"
#include "sensing/findings.hpp"

#include "lumo/core/files.hpp"
#include "lumo/sense/recording/mcap/mcap_log_writer.hpp"

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <optional>
#include <system_error>
#include <vector>

namespace lumo::program {

using namespace sense;

namespace fs = std::filesystem;

namespace {

/// A file that takes its name only when it is whole.
class NewFile {
 public:
  explicit NewFile(const std::string& path) : path_(path) {
    std::error_code error;
    if (fs::exists(path_, error)) throw InputError("cannot write to '" + path + "': it is there");
    Part::sweep(path_);
    errno = 0;
    part_ = Part::make(path_, Part::Kind::file);
    if (part_) stream.open(part_->path(), std::ios::binary);
    if (!stream.is_open())
      throw InputError("cannot write to '" + path + "': " + std::strerror(errno != 0 ? errno : EIO));
  }

  void keep() {
    const FilesBeingWritten whole;
    stream.close();
    std::error_code error;
    if (!stream) error = std::make_error_code(std::errc::io_error);
    else if (!part_->synchronise() || !part_->take_name(path_)) error = std::error_code(errno, std::generic_category());
    if (error) throw InputError("cannot write to '" + path_ + "': " + error.message());
  }

  std::ofstream stream;

 private:
  std::string path_;
  std::optional<Part> part_;
};

/// Pictures that were carried over, and those that were not.
struct Carried {
  std::size_t pictures = 0, missing = 0, damaged = 0;
  bool truth = false;

  void count(bool there, bool whole) { ++(whole ? pictures : there ? damaged : missing); }
};

/// Writes a log in the other form: an MCAP file where the target ends in .mcap, else a folder. Image files are copied
/// as they are; `raw` makes pixels of them, and what is no image file (a video's frames, pixels of an MCAP file)
/// becomes PNG otherwise. The truth of a virtual lab is copied beside.
struct Convert : LogCommand {
  std::string target, compression = "zstd";  ///< of an MCAP file's chunks
  bool raw = false;                          ///< pixels instead of image files, in an MCAP file

  void declare(CLI::App& app) {
    add_log(app);
    app.add_option("OUT", target,
        "MCAP file to write, if it ends in .mcap, else a folder; must not be there, or be an empty folder");
    add_word(
        app, "--compression", compression, {"zstd", "lz4", "none"}, "Of an MCAP file: zstd (default), lz4 or none");
    add_flag(app, "--raw", raw, "Pixels in an MCAP file (sensor_msgs/Image), not PNG or JPEG (CompressedImage)");
    add_common(app, *this);
  }
  void check() const {
    require_log();
    if (target.empty()) throw UsageError("the folder or file to write is missing" + hint);
    pictures();
  }
  Result run(Output& files, Progress& progress) const;
};

/// A log's pictures one after the other, as files where they are files.
class LogPictures {
 public:
  explicit LogPictures(const OpenLog& log) : log_(log) {
    if (!log.frames.empty()) camera_.emplace(log);
  }

  /// Goes to the next picture. Throws InputError where a video has fewer than its table.
  void next() {
    const std::size_t k = count_++;
    file_.clear();
    view_ = {};
    if (log_.is_bag() && log_.pictures[k].compressed) {
      const McapMessage m = log_.files[log_.pictures[k].file]->read(log_.pictures[k].at);
      const auto data = from_cdr<RosCompressedImage>(m.data).data;
      file_.assign(data.begin(), data.end());
    } else if (!log_.is_bag() && log_.session.video.empty()) {
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
  std::string ending() const { return std::string(sense::picture_ending(file_)); }
  /// May be empty.
  ImageView pixels() { return file_.empty() ? view_ : decode_(file_); }

 private:
  const OpenLog& log_;
  std::optional<LogCamera> camera_;
  std::vector<std::uint8_t> file_;
  ImageView view_;
  Decoder decode_;
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

/// Throws InputError if the log has pictures, and none of them could be carried over.
void require_any(const OpenLog& log, const Carried& carried) {
  if (!log.frames.empty() && carried.pictures == 0)
    throw InputError(lumo::message(log.path, ": none of its ", log.frames.size(), " pictures can be read (",
        carried.missing, " missing, ", carried.damaged, " damaged)"));
}

void write_file(const OpenLog& log, const Convert& o, Progress& progress, Carried& carried) {
  NewFile out(o.target);
  Recording tables = log;
  tables.session.video.clear();  // its frames go into the file
  LogPictures taken(log);
  int width = 0, height = 0;
  const auto picture = [&](std::size_t) {
    taken.next();
    McapPictureData p;
    const std::string ending = taken.ending();
    const bool as_it_is = !o.raw && !ending.empty();
    if (!as_it_is || width == 0) {
      p.pixels = taken.pixels();
      if (!p.pixels.empty()) {
        width = p.pixels.width;
        height = p.pixels.height;
      }
    }
    p.width = width;
    p.height = height;
    carried.count(!taken.file().empty(), as_it_is || !p.pixels.empty());
    if (as_it_is) {
      p.format = ending == ".jpg" ? "jpeg" : ending.substr(1);
      p.file = taken.file();
    } else if (!o.raw) {
      p.format = "png";
      p.file = p.pixels.empty() ? std::vector<std::uint8_t>() : pictures().encode(".png", p.pixels);
    }
    progress.step();
    return p;
  };
  const auto write = [&](const auto& codec) {
    write_mcap_log(out.stream, tables, to_json(tables.session), picture, codec);
  };
  if (o.compression == "none") write(Uncompressed{});
  else if (o.compression == "lz4") write(Lz4{});
  else write(Zstd{});
  require_any(log, carried);
  out.keep();
}

void write_folder(const OpenLog& log, const Convert& o, Progress& progress, Carried& carried) {
  NewFolder folder(o.target);
  Recording tables = log;
  tables.path = folder.path().string();
  tables.session.video.clear();
  LogPictures taken(log);
  for (std::size_t k = 0; k < tables.frames.size(); ++k) {
    taken.next();
    std::string& name = tables.frames[k].file;
    if (name.empty()) name = frame_file(k);  // of a video
    const fs::path to = folder.path() / "frames" / name;
    std::error_code error;
    fs::create_directories(to.parent_path(), error);
    const bool as_it_is = !taken.file().empty() && (!log.is_bag() || !taken.ending().empty());
    bool whole = as_it_is && !taken.ending().empty();
    if (as_it_is) write_bytes(to.string(), taken.file());
    if (!whole)
      if (const ImageView v = taken.pixels(); !v.empty()) {
        whole = true;
        if (!as_it_is) write_bytes(to.string(), pictures().encode(to.extension().string(), v));
      }
    carried.count(!taken.file().empty(), whole);
    progress.step();
  }
  require_any(log, carried);
  write_log_folder(tables);
  copy_truth(log.truth_file(), (folder.path() / "truth.csv").string(), carried.truth);
  folder.keep();
}

Result Convert::run(Output&, Progress& progress) const {
  progress.stage("reading the log");
  const OpenLog from = open_log(log, progress, topics);
  require_readable(from);
  progress.step();
  Carried carried;
  progress.stage("pictures", int(from.frames.size()));
  try {
    if (fs::path(target).extension() == ".mcap") {
      write_file(from, *this, progress, carried);
      copy_truth(from.truth_file(), fs::path(target).replace_extension(".truth.csv").string(), carried.truth);
    } else {
      write_folder(from, *this, progress, carried);
    }
  } catch (const InvalidArgument& e) {
    throw InputError(log + ": " + e.what());
  }
  progress.finish();
  const PictureCount count{from.frames.size(), carried.pictures, carried.missing, carried.damaged, 0};
  tell_findings(from, count, progress);
  const std::string cut = from.cut();
  std::size_t left_out = 0;
  for (const StreamReading& r : from.reading) left_out += r.left_out();
  if (json)
    return text_of(Json{{"out", target}, {"frames", from.frames.size()}, {"joint_samples", from.joints.size()},
                       {"wrench_samples", from.wrenches.size()}, {"marker_samples", from.markers.size()},
                       {"photodiode_samples", from.photodiodes.size()}, {"truth", carried.truth},
                       {"fault", cut.empty() ? Json(nullptr) : Json(cut)}, {"pictures", carried.pictures},
                       {"pictures_missing", carried.missing}, {"pictures_damaged", carried.damaged},
                       {"rows_left_out", left_out}, {"joint_names", lines_json(from.joint_names)},
                       {"notes", lines_json(progress.notes())}},
               2) +
           "\n";
  const bool all = carried.pictures == from.frames.size();
  return lumo::message(target, ": ", carried.pictures, " pictures",
      all ? std::string()
          : lumo::message(
                " of ", from.frames.size(), " (", carried.missing, " missing, ", carried.damaged, " damaged)"),
      ", ", from.joints.size(), " joint samples, ", from.wrenches.size(), " wrenches, ", from.markers.size(),
      " displacements, ", from.photodiodes.size(), " photodiode samples",
      left_out > 0 ? lumo::message(", ", left_out, " rows left out") : std::string(),
      carried.truth ? ", truth beside them" : "", cut.empty() ? "" : "; the log was cut", "\n");
}

}  // namespace

void add_convert(CommandLine& line) {
  line.add<Convert>("convert", "A log's folder as an MCAP file, as ROS 2 has them, or the other way round");
}

}  // namespace lumo::program
