#pragma once

#include "lumo/core/error.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/recording/mcap/ros_messages.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace lumo::sense {

/// How the bytes of an Image's pixels are arranged.
struct RosEncoding {
  enum class Layout { grey, colours, yuv, bayer };
  std::string_view name;
  Layout layout;
  int bytes;  ///< of a pixel
  std::array<int, 3> place{
      0, 0, 0};                ///< where blue, green, red stand in a pixel; of yuv: luminance, U, V in two pixels
  std::string_view pattern{};  ///< of bayer: the colours of two rows of two pixels
};

/// The encodings that are read, all of 8 bits (sensor_msgs/image_encodings.hpp). 8UC3 does not say which colour comes
/// first: green, which counts, is in the middle anyhow.
inline constexpr std::array<RosEncoding, 17> ros_encodings{{
    {"mono8", RosEncoding::Layout::grey, 1},
    {"8UC1", RosEncoding::Layout::grey, 1},
    {"bgr8", RosEncoding::Layout::colours, 3, {0, 1, 2}},
    {"rgb8", RosEncoding::Layout::colours, 3, {2, 1, 0}},
    {"8UC3", RosEncoding::Layout::colours, 3, {0, 1, 2}},
    {"bgra8", RosEncoding::Layout::colours, 4, {0, 1, 2}},
    {"rgba8", RosEncoding::Layout::colours, 4, {2, 1, 0}},
    {"8UC4", RosEncoding::Layout::colours, 4, {0, 1, 2}},
    {"yuv422", RosEncoding::Layout::yuv, 2, {1, 0, 2}},
    {"uyvy", RosEncoding::Layout::yuv, 2, {1, 0, 2}},
    {"yuv422_yuy2", RosEncoding::Layout::yuv, 2, {0, 1, 3}},
    {"yuyv", RosEncoding::Layout::yuv, 2, {0, 1, 3}},
    {"yuy2", RosEncoding::Layout::yuv, 2, {0, 1, 3}},
    {"bayer_rggb8", RosEncoding::Layout::bayer, 1, {}, "rggb"},
    {"bayer_bggr8", RosEncoding::Layout::bayer, 1, {}, "bggr"},
    {"bayer_gbrg8", RosEncoding::Layout::bayer, 1, {}, "gbrg"},
    {"bayer_grbg8", RosEncoding::Layout::bayer, 1, {}, "grbg"},
}};

/// The encoding of that name; null if it is not read.
constexpr const RosEncoding* ros_encoding(std::string_view name) {
  const auto* const found =
      std::find_if(ros_encodings.begin(), ros_encodings.end(), [&](const RosEncoding& e) { return e.name == name; });
  return found == ros_encodings.end() ? nullptr : found;
}

/// Checks an Image's encoding and that its pixels are all there; no pixels at all are a frame that was lost. Throws
/// InputError.
inline const RosEncoding& require_readable(const RosImage& m) {
  const RosEncoding* const e = ros_encoding(m.encoding);
  if (e == nullptr)
    throw InputError(message("pictures are of encoding '", printable(m.encoding),
        "', read are mono8, bgr8, rgb8, bgra8, rgba8, yuv422 (uyvy), yuv422_yuy2 (yuyv), 8UC1, 8UC3 and bayer_*8"));
  if (m.width == 0 && m.height == 0) return *e;
  if (m.width < 1 || m.height < 1 || m.width > max_image_side || m.height > max_image_side)
    throw InputError(
        message("a picture has ", m.width, " x ", m.height, " px, must have 1 to ", max_image_side, " each way"));
  if (e->layout == RosEncoding::Layout::yuv && m.width % 2 != 0)
    throw InputError(message("a picture of encoding '", e->name, "' is ", m.width, " px wide, must be even"));
  const std::uint64_t row = std::uint64_t(m.width) * std::uint64_t(e->bytes),
                      needed = std::uint64_t(m.step) * (m.height - 1) + row;
  if (m.step < row) throw InputError(message("a picture's rows have ", m.step, " bytes, must have ", row));
  if (m.data.size() < needed) throw InputError(message("a picture has ", m.data.size(), " bytes, must have ", needed));
  return *e;
}

/// Pixels of an Image as grey, or as blue, green, red.
class RosPixels {
 public:
  /// A view that holds until the next call, and as long as the message's bytes; empty for an Image without pixels.
  /// Throws InputError for another encoding or sizes that do not match.
  ImageView operator()(const RosImage& m) {
    const RosEncoding& e = require_readable(m);
    if (m.width == 0 && m.height == 0) return {};
    const bool as_it_is = e.layout == RosEncoding::Layout::grey || (e.bytes == 3 && e.place[0] == 0);
    const PixelFormat format = e.layout == RosEncoding::Layout::grey ? PixelFormat::grey : PixelFormat::bgr;
    const ImageView raw{m.data.data(), int(m.width), int(m.height), std::ptrdiff_t(m.step), format};
    if (as_it_is) return raw;
    if (image_.width != raw.width || image_.height != raw.height) image_ = Image::black(raw.width, raw.height);
    for (int y = 0; y < raw.height; ++y) {
      std::uint8_t* const to = image_.row(y);
      if (e.layout == RosEncoding::Layout::colours) colours(e, raw.row(y), to);
      else if (e.layout == RosEncoding::Layout::yuv) yuv(e, raw.row(y), to);
      else bayer(e, raw, y, to);
    }
    return image_.view();
  }

 private:
  void colours(const RosEncoding& e, const std::uint8_t* from, std::uint8_t* to) const {
    for (int x = 0; x < image_.width; ++x)
      for (std::size_t c = 0; c < 3; ++c) to[3 * x + int(c)] = from[e.bytes * x + e.place[c]];
  }

  /// ITU-R BT.601 over the full range, as JFIF has it: nothing is cut off, so that values stay linear in the light. A
  /// camera that leaves out the ends of the range gives values smaller by 1.16.
  void yuv(const RosEncoding& e, const std::uint8_t* from, std::uint8_t* to) const {
    const auto byte = [](double v) { return std::uint8_t(std::clamp(v + 0.5, 0.0, 255.0)); };
    for (int x = 0; x < image_.width; ++x) {
      const std::uint8_t* const pair = from + 4 * (x / 2);
      const double luminance = pair[e.place[0] + 2 * (x % 2)], u = double(pair[e.place[1]]) - 128.0,
                   v = double(pair[e.place[2]]) - 128.0;
      to[3 * x] = byte(luminance + 1.772 * u);
      to[3 * x + 1] = byte(luminance - 0.344136 * u - 0.714136 * v);
      to[3 * x + 2] = byte(luminance + 1.402 * v);
    }
  }

  /// Each colour is the mean of its own pixels among the neighbours, or the pixel itself.
  void bayer(const RosEncoding& e, const ImageView& raw, int y, std::uint8_t* to) const {
    const auto colour_at = [&](int column, int row) {
      const char c = e.pattern[std::size_t(2 * (row % 2) + column % 2)];
      return c == 'b' ? 0 : c == 'g' ? 1 : 2;
    };
    for (int x = 0; x < raw.width; ++x) {
      std::array<int, 3> sum{}, count{};
      for (int row = std::max(0, y - 1); row <= std::min(raw.height - 1, y + 1); ++row)
        for (int column = std::max(0, x - 1); column <= std::min(raw.width - 1, x + 1); ++column) {
          const auto c = std::size_t(colour_at(column, row));
          sum[c] += raw.row(row)[column];
          ++count[c];
        }
      const int own = colour_at(x, y);
      for (std::size_t c = 0; c < 3; ++c)
        to[3 * x + int(c)] = int(c) == own   ? raw.row(y)[x]
                             : count[c] == 0 ? std::uint8_t(0)
                                             : std::uint8_t((sum[c] + count[c] / 2) / count[c]);
    }
  }

  Image image_;
};

}  // namespace lumo::sense
