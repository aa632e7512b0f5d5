#pragma once

#include "lumo/core/bytes.hpp"
#include "lumo/sense/devices/device.hpp"

#include <algorithm>
#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

namespace lumo::sense {

/// Format and size of an image file, which stand before its pixels.
struct PictureHeader {
  enum class Format { png, jpeg, bmp, webp };
  Format format;
  std::uint32_t width, height;  ///< [px]
  int bits;                     ///< of one channel; of a whole pixel in a BMP file
};

/// The header of a PNG, JPEG, BMP or WebP file (PNG: W3C 2003 §11.2.2; JPEG: ITU-T T.81 §B.2.2; BMP: BITMAPINFOHEADER
/// and later; WebP: RFC 9649 §2); nullopt without one, since the memory that a decoder would take is then unknown.
std::optional<PictureHeader> picture_header(std::span<const std::uint8_t> file);

/// Whether a picture is worth decoding: a few bytes must not ask for gigabytes.
inline bool is_decodable(const std::optional<PictureHeader>& h) { return h && is_image_size(h->width, h->height); }

namespace detail {

template <std::unsigned_integral T> T number_in(std::span<const std::uint8_t> bytes, std::size_t at, ByteOrder order) {
  return number_at<T>(bytes.data() + at, order);
}

inline std::optional<PictureHeader> png_header(std::span<const std::uint8_t> f) {
  constexpr std::array<std::uint8_t, 16> head{
      0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n', 0, 0, 0, 13, 'I', 'H', 'D', 'R'};
  if (f.size() < 26 || !std::equal(head.begin(), head.end(), f.begin())) return std::nullopt;
  return PictureHeader{PictureHeader::Format::png, number_in<std::uint32_t>(f, 16, ByteOrder::big),
      number_in<std::uint32_t>(f, 20, ByteOrder::big), f[24]};
}

/// From marker to marker up to the frame's.
inline std::optional<PictureHeader> jpeg_header(std::span<const std::uint8_t> f) {
  if (f.size() < 4 || f[0] != 0xff || f[1] != 0xd8) return std::nullopt;
  for (std::size_t at = 2; at + 4 <= f.size();) {
    if (f[at] != 0xff) return std::nullopt;
    const std::uint8_t marker = f[at + 1];
    if (marker == 0xff) {  // fill bytes may stand before a marker
      ++at;
      continue;
    }
    const bool alone = marker == 0x01 || (marker >= 0xd0 && marker <= 0xd8);
    if (alone) {
      at += 2;
      continue;
    }
    if (marker == 0xd9 || marker == 0xda) return std::nullopt;  // end, or pixels, before a frame
    const std::size_t length = number_in<std::uint16_t>(f, at + 2, ByteOrder::big);
    const bool frame = marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (length < 2 || (frame && length < 8)) return std::nullopt;
    if (frame) {
      if (at + 9 > f.size()) return std::nullopt;
      return PictureHeader{PictureHeader::Format::jpeg, number_in<std::uint16_t>(f, at + 7, ByteOrder::big),
          number_in<std::uint16_t>(f, at + 5, ByteOrder::big), f[at + 4]};
    }
    at += 2 + length;
  }
  return std::nullopt;
}

inline std::optional<PictureHeader> bmp_header(std::span<const std::uint8_t> f) {
  if (f.size() < 30 || f[0] != 'B' || f[1] != 'M' || number_in<std::uint32_t>(f, 14, ByteOrder::little) < 40)
    return std::nullopt;
  // Rows may run from top to bottom, as a negative height states.
  const std::uint32_t height = number_in<std::uint32_t>(f, 22, ByteOrder::little);
  return PictureHeader{PictureHeader::Format::bmp, number_in<std::uint32_t>(f, 18, ByteOrder::little),
      height >> 31 ? ~height + 1 : height, int(number_in<std::uint16_t>(f, 28, ByteOrder::little))};
}

/// A container whose first chunk is the picture with loss, the one without, or the canvas of several chunks.
inline std::optional<PictureHeader> webp_header(std::span<const std::uint8_t> f) {
  const auto is = [&](std::size_t at, std::string_view word) {
    return std::equal(word.begin(), word.end(), f.begin() + std::ptrdiff_t(at));
  };
  if (f.size() < 25 || !is(0, "RIFF") || !is(8, "WEBP")) return std::nullopt;
  const auto number = [&](std::size_t at, int from_bit, int bits) {
    return number_in<std::uint32_t>(f, at, ByteOrder::little) >> from_bit & ((1u << bits) - 1);
  };
  const auto header = [](std::uint32_t width, std::uint32_t height) {
    return PictureHeader{PictureHeader::Format::webp, width, height, 8};
  };
  constexpr int side_bits = 14, canvas_bits = 24;
  if (is(12, "VP8L") && f[20] == 0x2f)
    return header(number(21, 0, side_bits) + 1, number(21, side_bits, side_bits) + 1);
  if (f.size() < 30) return std::nullopt;
  if (is(12, "VP8 ") && f[23] == 0x9d && f[24] == 0x01 && f[25] == 0x2a)
    return header(number(26, 0, side_bits), number(26, 16, side_bits));
  if (is(12, "VP8X")) return header(number(24, 0, canvas_bits) + 1, number(26, 8, canvas_bits) + 1);
  return std::nullopt;
}

}  // namespace detail

inline std::optional<PictureHeader> picture_header(std::span<const std::uint8_t> file) {
  if (const auto png = detail::png_header(file)) return png;
  if (const auto jpeg = detail::jpeg_header(file)) return jpeg;
  if (const auto webp = detail::webp_header(file)) return webp;
  return detail::bmp_header(file);
}

}  // namespace lumo::sense
