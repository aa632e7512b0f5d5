#pragma once

#include "lumo/core/error.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace lumo::sense {

/// Bytes of a pixel: one of grey, or blue, green, red.
enum class PixelFormat { grey, bgr };

constexpr int channels(PixelFormat f) { return f == PixelFormat::grey ? 1 : 3; }

/// A view of 8-bit pixels that something else owns. Rows run from the top, columns from the left.
struct ImageView {
  const std::uint8_t* data = nullptr;
  int width = 0;
  int height = 0;
  std::ptrdiff_t stride = 0;  ///< bytes from a row to the next
  PixelFormat format = PixelFormat::bgr;

  const std::uint8_t* row(int y) const { return data + y * stride; }
  /// Green value, or the grey one. Unchecked.
  std::uint8_t green(int x, int y) const { return format == PixelFormat::grey ? row(y)[x] : row(y)[3 * x + 1]; }
  bool empty() const { return !data || width <= 0 || height <= 0; }
};

inline constexpr int max_image_side = 32768;                 ///< [px]
inline constexpr std::int64_t max_image_area = 100'000'000;  ///< [px]

/// Whether an image from outside may be this large [px].
constexpr bool is_image_size(std::int64_t width, std::int64_t height) {
  return width >= 1 && height >= 1 && width <= max_image_side && height <= max_image_side &&
         width * height <= max_image_area;
}

/// An image that owns its pixels; rows without padding.
struct Image {
  int width = 0;
  int height = 0;
  PixelFormat format = PixelFormat::bgr;
  std::vector<std::uint8_t> pixels;

  /// Black. Throws InvalidArgument for sizes outside 1 … max_image_side.
  static Image black(int width, int height, PixelFormat format = PixelFormat::bgr) {
    require_in_range("image width", width, 1, max_image_side, "px");
    require_in_range("image height", height, 1, max_image_side, "px");
    return {width, height, format,
        std::vector<std::uint8_t>(std::size_t(width) * std::size_t(height) * std::size_t(channels(format)))};
  }
  /// Copies the pixels. Throws InvalidArgument for an empty view.
  static Image copy(const ImageView& v) {
    Image image = black(v.width, v.height, v.format);
    for (int y = 0; y < v.height; ++y)
      std::copy_n(v.row(y), std::size_t(v.width) * std::size_t(channels(v.format)), image.row(y));
    return image;
  }
  ImageView view() const { return {pixels.data(), width, height, std::ptrdiff_t(width) * channels(format), format}; }
  std::uint8_t* row(int y) { return pixels.data() + std::ptrdiff_t(y) * width * channels(format); }
};

/// One picture of a camera and how it was taken.
struct Frame {
  ImageView image;
  /// The source's stamp on the session's clock: the middle of the exposure plus the session's frame delay.
  std::int64_t stamp_ns = 0;
  double exposure_s = 0.0;  ///< 0: unknown
  double gain = 0.0;        ///< linear factor, or else the driver's own number; 0: unknown
  std::int64_t index = 0;   ///< counted by the source
};

}  // namespace lumo::sense
