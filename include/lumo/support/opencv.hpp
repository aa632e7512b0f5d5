#pragma once

// Adapter to OpenCV (Apache-2.0), modules core, imgcodecs and videoio: images from files and videos, live V4L2 cameras.
// V4l2Camera has not met hardware yet: there was no camera where it was written. What is tested of it is that it does
// not open what is no camera.

#include "lumo/core/error.hpp"
#include "lumo/core/files.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/devices/picture_header.hpp"
#include "lumo/sense/recording/tables.hpp"
#include "lumo/support/process/video_process.hpp"

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>

#include <sys/stat.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace lumo {

/// View of an 8-bit matrix of one or three channels; empty for anything else.
inline sense::ImageView view_of(const cv::Mat& m) {
  if (m.empty() || m.depth() != CV_8U || (m.channels() != 1 && m.channels() != 3)) return {};
  return {m.data, m.cols, m.rows, std::ptrdiff_t(m.step[0]),
      m.channels() == 1 ? sense::PixelFormat::grey : sense::PixelFormat::bgr};
}

/// A matrix of the same pixels. Throws InvalidArgument for a view without any.
inline cv::Mat matrix_of(const sense::ImageView& v) {
  if (v.empty()) throw InvalidArgument("image to write is empty");
  return {v.height, v.width, v.format == sense::PixelFormat::grey ? CV_8UC1 : CV_8UC3,
      const_cast<std::uint8_t*>(v.data), std::size_t(v.stride)};
}

/// How to decode: pixels as the camera gave them, not turned.
inline int flags_of(sense::PixelFormat format) {
  return (format == sense::PixelFormat::grey ? cv::IMREAD_GRAYSCALE : cv::IMREAD_COLOR) | cv::IMREAD_IGNORE_ORIENTATION;
}

/// Decoded bytes of a PNG, JPEG, BMP or WebP file of sane size, or an empty matrix.
inline cv::Mat decode_bytes(std::span<const std::uint8_t> file, sense::PixelFormat format) {
  if (file.size() > std::size_t(std::numeric_limits<int>::max()) || !sense::is_decodable(sense::picture_header(file)))
    return {};
  try {
    return cv::imdecode(
        cv::Mat(1, int(file.size()), CV_8UC1, const_cast<std::uint8_t*>(file.data())), flags_of(format));
  } catch (const cv::Exception&) {
    return {};
  }
}

inline cv::Mat decode_file(const std::string& path, sense::PixelFormat format) {
  const auto bytes = read_whole(path);
  return bytes ? decode_bytes({reinterpret_cast<const std::uint8_t*>(bytes->data()), bytes->size()}, format)
               : cv::Mat{};
}

inline void require_file(const std::string& path, const char* what) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) throw InputError(message(path, ": no such ", what));
}

/// Reads a PNG, JPEG, BMP or WebP file as 8 bits, colour or grey. Throws InputError.
inline sense::Image read_image(const std::string& path, sense::PixelFormat format = sense::PixelFormat::bgr) {
  require_file(path, "image");
  const cv::Mat m = decode_file(path, format);
  const sense::ImageView v = view_of(m);
  if (v.empty()) throw InputError(message(path, ": is no PNG, JPEG, BMP or WebP image that can be decoded"));
  sense::Image image = sense::Image::black(v.width, v.height, format);
  for (int y = 0; y < v.height; ++y)
    std::memcpy(image.row(y), v.row(y), std::size_t(v.width) * std::size_t(channels(format)));
  return image;
}

/// Writes an image in the format of the path's ending (.png without loss). Throws InputError.
inline void write_image(const std::string& path, const sense::ImageView& image) {
  const cv::Mat m = matrix_of(image);
  bool good = false;
  try {
    good = cv::imwrite(path, m);
  } catch (const cv::Exception&) {
  }
  if (!good) throw InputError(message(path, ": cannot be written"));
}

/// Bytes of an image file in the format of an ending (".png" without loss). Throws InputError.
inline std::vector<std::uint8_t> encode_image(const std::string& ending, const sense::ImageView& image) {
  std::vector<std::uint8_t> bytes;
  bool good = false;
  try {
    good = cv::imencode(ending, matrix_of(image), bytes);
  } catch (const cv::Exception&) {
  }
  if (!good) throw InputError(message("image cannot be encoded as '", ending, "'"));
  return bytes;
}

/// Makes 8-bit pixels of a PNG, JPEG, BMP or WebP file's bytes, colour or grey.
class ImageDecoder {
 public:
  explicit ImageDecoder(sense::PixelFormat format = sense::PixelFormat::bgr) : format_(format) {}

  /// A view that holds until the next call; empty for what cannot be decoded.
  sense::ImageView operator()(std::span<const std::uint8_t> file) {
    image_ = decode_bytes(file, format_);
    return view_of(image_);
  }

 private:
  sense::PixelFormat format_;
  cv::Mat image_;
};

static_assert(sense::PictureDecoder<ImageDecoder>);

/// Images of a folder, in the order of a table or of their names. A file that is missing or cannot be decoded is a
/// frame without pixels.
class FolderCamera {
 public:
  /// `folder` holds the files of the records. Throws InputError when it is no folder.
  FolderCamera(
      std::string folder, std::vector<sense::FrameRecord> records, sense::PixelFormat format = sense::PixelFormat::bgr)
      : folder_(std::move(folder)), records_(std::move(records)), format_(format) {
    std::error_code error;
    if (!std::filesystem::is_directory(folder_, error)) throw InputError(message(folder_, ": no such folder"));
  }
  /// All .png, .jpg, .jpeg, .bmp and .webp files of a folder by name, at a rate. Throws InputError when there are none.
  static FolderCamera by_name(
      const std::string& folder, double frames_per_s, sense::PixelFormat format = sense::PixelFormat::bgr) {
    require_positive("frame rate", frames_per_s, "1/s");
    std::vector<std::string> names;
    std::error_code error;
    for (std::filesystem::directory_iterator i(folder, error), end; !error && i != end; i.increment(error)) {
      std::string ending = i->path().extension().string();
      std::transform(
          ending.begin(), ending.end(), ending.begin(), [](unsigned char c) { return char(std::tolower(c)); });
      if (ending == ".png" || ending == ".jpg" || ending == ".jpeg" || ending == ".bmp" || ending == ".webp")
        names.push_back(i->path().filename().string());
    }
    if (names.empty()) throw InputError(message(folder, ": holds no images"));
    std::sort(names.begin(), names.end());
    std::vector<sense::FrameRecord> records;
    for (std::size_t i = 0; i < names.size(); ++i)
      records.push_back({std::llround(1e9 * double(i) / frames_per_s), names[i], 0.0, 0.0});
    return FolderCamera(folder, std::move(records), format);
  }

  std::optional<sense::Frame> next() {
    if (next_ == records_.size()) return std::nullopt;
    const sense::FrameRecord& r = records_[next_];
    image_ = decode_file((std::filesystem::path(folder_) / r.file).string(), format_);
    return sense::Frame{view_of(image_), r.stamp_ns, r.exposure_s, r.gain, std::int64_t(next_++)};
  }
  sense::StreamState state() const {
    return next_ == records_.size() ? sense::StreamState::ended : sense::StreamState::open;
  }

 private:
  std::string folder_;
  std::vector<sense::FrameRecord> records_;
  sense::PixelFormat format_;
  std::size_t next_ = 0;
  cv::Mat image_;
};

static_assert(sense::Camera<FolderCamera>);

namespace detail {

/// Of all OpenCV's backends the two that read files; others take the name for a pipeline or a pattern.
class VideoFile {
 public:
  std::optional<double> open(const std::string& path) {
    if (!capture_.open(path, cv::CAP_FFMPEG) && !capture_.open(path, cv::CAP_OPENCV_MJPEG)) return std::nullopt;
    return capture_.get(cv::CAP_PROP_FPS);
  }
  std::optional<sense::ImageView> next() {
    if (!capture_.read(image_)) return std::nullopt;
    return view_of(image_);
  }

 private:
  cv::VideoCapture capture_;
  cv::Mat image_;
};

}  // namespace detail

/// Frames of a video file, decoded in a process of its own with limits of time and memory. Stamps, exposure and gain
/// come from the log's table, one row for each frame; without one, stamps follow from the file's frame rate.
class VideoCamera {
 public:
  /// Throws InputError when the file is missing, cannot be decoded, or states no frame rate and there is no table.
  explicit VideoCamera(const std::string& path, std::vector<sense::FrameRecord> records = {})
      : records_(std::move(records)), timed_(!records_.empty()) {
    require_file(path, "video");
    video_ = std::make_unique<VideoProcess>(detail::VideoFile{}, path, VideoProcess::Limits{});
    if (!video_->is_open()) throw InputError(message(path, ": is no video that can be decoded"));
    if (!timed_ && !(std::isfinite(video_->rate()) && video_->rate() > 0.0))
      throw InputError(message(path, ": states no frame rate, needs a frames.csv"));
  }

  std::optional<sense::Frame> next() {
    using Got = VideoProcess::Got;
    if (state_ != sense::StreamState::open) return std::nullopt;
    const Got got = video_->next(image_);
    const bool rows_over = timed_ && std::size_t(next_) == records_.size();
    // Frames without rows have no time; rows without frames: the video is cut.
    if (got == Got::failed || (got == Got::frame && rows_over) || (got == Got::end && timed_ && !rows_over))
      return stop(sense::StreamState::failed);
    if (got == Got::end) return stop(sense::StreamState::ended);
    sense::Frame f{image_.view(), 0, 0.0, 0.0, next_};
    if (timed_) {
      const sense::FrameRecord& r = records_[std::size_t(next_)];
      f.stamp_ns = r.stamp_ns;
      f.exposure_s = r.exposure_s;
      f.gain = r.gain;
    } else {
      f.stamp_ns = std::llround(1e9 * double(next_) / video_->rate());
    }
    ++next_;
    return f;
  }
  sense::StreamState state() const { return state_; }

 private:
  std::optional<sense::Frame> stop(sense::StreamState state) {
    state_ = state;
    return std::nullopt;
  }

  std::unique_ptr<VideoProcess> video_;
  std::vector<sense::FrameRecord> records_;
  bool timed_;
  std::int64_t next_ = 0;
  sense::StreamState state_ = sense::StreamState::open;
  sense::Image image_;
};

static_assert(sense::Camera<VideoCamera>);

/// A live camera under Linux (Video4Linux2), exposure and gain locked.
/// Exposure goes to the driver in units of 100 µs (V4L2_CID_EXPOSURE_ABSOLUTE); some cameras snap to steps of their
/// own, so that what is in force is read back, and that is what frames carry. Gain is the driver's own number
/// (V4L2_CID_GAIN; 0 … 128, default 64, on a RealSense D435). A new exposure may take up to six frames to hold
/// (librealsense #11228): those are thrown away at the start. Stamps are the driver's, on CLOCK_MONOTONIC: of the
/// exposure's start or of the frame's end, as it likes; what that is off from the exposure's middle belongs to the
/// session's frame delay.
class V4l2Camera {
 public:
  struct Config {
    std::string device = "/dev/video0";
    int width = 640, height = 480;
    double frames_per_s = 30.0;
    double exposure_s = 0.001;
    double gain = 64.0;
    int settle_frames = 6;
    /// How long `next` may wait for a frame; OpenCV waits in whole milliseconds, and at least one
    double wait_s = 0.001;
  };

  /// Throws InputError when there is no such camera, it is in use, or will not take the size or have its exposure
  /// locked.
  explicit V4l2Camera(const Config& config) : config_(config) {
    require_in_range("width of the camera's pictures", config.width, 1, sense::max_image_side, "px");
    require_in_range("height of the camera's pictures", config.height, 1, sense::max_image_side, "px");
    require_in_range("exposure of the camera", config.exposure_s, 1e-4, 100.0, "s");
    require_in_range("gain of the camera", config.gain, 0.0, 1e9, "");
    require_in_range("wait for a frame", config.wait_s, 0.0, 10.0, "s");
    require_in_range("frames until a new exposure holds", config.settle_frames, 0, 1e6, "");
    require_positive("frame rate of the camera", config.frames_per_s, "1/s");
    struct stat status {};
    if (::stat(config.device.c_str(), &status) != 0 || !S_ISCHR(status.st_mode))
      throw InputError(message(config.device, ": no such camera"));
    std::vector<cv::VideoCapture> capture(1);
    try {
      capture[0].open(config.device, cv::CAP_V4L2);
    } catch (const cv::Exception&) {
    }
    if (!capture[0].isOpened())
      throw InputError(
          message(config.device, ": cannot be opened as a camera (no rights, in use, or of another kind)"));
    cv::VideoCapture& c = capture[0];
    c.set(cv::CAP_PROP_FRAME_WIDTH, config.width);
    c.set(cv::CAP_PROP_FRAME_HEIGHT, config.height);
    c.set(cv::CAP_PROP_FPS, config.frames_per_s);
    c.set(cv::CAP_PROP_AUTO_WB, 0);
    const bool manual = c.set(cv::CAP_PROP_AUTO_EXPOSURE, 1);  // V4L2_EXPOSURE_MANUAL
    const bool exposed = c.set(cv::CAP_PROP_EXPOSURE, std::round(config.exposure_s / 1e-4));
    const bool gained = c.set(cv::CAP_PROP_GAIN, config.gain);
    if (int(c.get(cv::CAP_PROP_FRAME_WIDTH)) != config.width || int(c.get(cv::CAP_PROP_FRAME_HEIGHT)) != config.height)
      throw InputError(message(config.device, ": gives ", c.get(cv::CAP_PROP_FRAME_WIDTH), " x ",
          c.get(cv::CAP_PROP_FRAME_HEIGHT), " px, asked for is ", config.width, " x ", config.height));
    if (!manual || !exposed || !gained)
      throw InputError(message(config.device, ": does not let its exposure and gain be locked"));
    exposure_s_ = 1e-4 * c.get(cv::CAP_PROP_EXPOSURE);
    gain_ = c.get(cv::CAP_PROP_GAIN);
    capture_ = std::move(capture);
  }

  std::optional<sense::Frame> next() {
    if (state_ != sense::StreamState::open) return std::nullopt;
    try {
      std::vector<int> ready;
      // A timeout of 0 would wait for ever.
      if (!cv::VideoCapture::waitAny(
              capture_, ready, std::max<std::int64_t>(1'000'000, std::llround(1e9 * config_.wait_s))) ||
          ready.empty())
        return std::nullopt;
      if (!capture_[0].grab()) return fail();
      if (grabbed_++ < config_.settle_frames) return std::nullopt;
      if (!capture_[0].retrieve(image_)) return std::nullopt;
    } catch (const cv::Exception&) {
      return fail();
    }
    return sense::Frame{
        view_of(image_), std::llround(1e6 * capture_[0].get(cv::CAP_PROP_POS_MSEC)), exposure_s_, gain_, grabbed_ - 1};
  }
  sense::StreamState state() const { return state_; }
  double exposure_s() const { return exposure_s_; }  ///< in force
  double gain() const { return gain_; }

 private:
  std::optional<sense::Frame> fail() {
    state_ = sense::StreamState::failed;
    return std::nullopt;
  }

  Config config_;
  std::vector<cv::VideoCapture> capture_;  ///< one; waitAny takes a vector
  cv::Mat image_;
  double exposure_s_ = 0.0, gain_ = 0.0;
  std::int64_t grabbed_ = 0;
  sense::StreamState state_ = sense::StreamState::open;
};

static_assert(sense::Camera<V4l2Camera>);

}  // namespace lumo
