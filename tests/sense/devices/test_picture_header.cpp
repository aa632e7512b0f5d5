#include "catch.hpp"

#include "lumo/sense/devices/picture_header.hpp"
#include "lumo/support/opencv.hpp"

#include <algorithm>
#include <string>
#include <vector>

using namespace lumo;
using namespace lumo::sense;

namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes bytes_of(const std::string& s) { return {s.begin(), s.end()}; }

/// A PNG of 1 × 1 px that says it is larger.
Bytes png_that_claims(std::uint32_t width, std::uint32_t height) {
  Bytes file = encode_image(".png", Image::black(1, 1, PixelFormat::grey).view());
  for (std::size_t k = 0; k < 4; ++k) {
    file[16 + k] = std::uint8_t(width >> (24 - 8 * k));
    file[20 + k] = std::uint8_t(height >> (24 - 8 * k));
  }
  return file;
}

}  // namespace

TEST_CASE("headers of what OpenCV writes say what the picture is") {
  for (const PixelFormat format : {PixelFormat::grey, PixelFormat::bgr})
    for (const auto& [width, height] : {std::pair(1, 1), std::pair(640, 480), std::pair(3, 300)})
      for (const auto& [ending, kind] :
          {std::pair(".png", PictureHeader::Format::png), std::pair(".jpg", PictureHeader::Format::jpeg),
              std::pair(".bmp", PictureHeader::Format::bmp), std::pair(".webp", PictureHeader::Format::webp)}) {
        const auto h = picture_header(encode_image(ending, Image::black(width, height, format).view()));
        INFO(ending << ' ' << width << " x " << height);
        REQUIRE(h);
        CHECK(h->format == kind);
        CHECK((h->width == std::uint32_t(width) && h->height == std::uint32_t(height)));
        CHECK(is_decodable(h));
      }
}

TEST_CASE("a WebP file says its size in three ways") {  // RFC 9649, §2.5 to §2.7
  const auto file = [](const char* chunk, const Bytes& contents) {
    Bytes f = bytes_of(std::string("RIFF\0\0\0\0WEBP", 12) + chunk + std::string(4, '\0'));
    f.insert(f.end(), contents.begin(), contents.end());
    f.resize(std::max<std::size_t>(f.size(), 40));
    return f;
  };
  const auto lossy = picture_header(file("VP8 ", {0x30, 1, 0, 0x9d, 0x01, 0x2a, 0x80, 0x42, 0xe0, 0x41}));
  REQUIRE(lossy);  // 640 x 480, with bits of scaling above the fourteen
  CHECK((lossy->width == 640 && lossy->height == 480));
  const auto extended = picture_header(file("VP8X", {0x10, 0, 0, 0, 0xff, 0x0f, 0x01, 0x2b, 0x01, 0x00}));
  REQUIRE(extended);
  CHECK((extended->width == 0x11000 && extended->height == 300));
  CHECK_FALSE(is_decodable(extended));  // wider than a picture may be
  CHECK_FALSE(picture_header(file("VP8 ", {0x30, 1, 0, 0, 0, 0, 1, 0, 1, 0})));
  CHECK_FALSE(picture_header(file("ALPH", {})));
}

TEST_CASE("what is cut before its size, or is something else, has no header") {
  for (const char* ending : {".png", ".jpg", ".bmp"}) {
    const Bytes file = encode_image(ending, Image::black(5, 4, PixelFormat::bgr).view());
    for (std::size_t n = 0; n < 24; ++n) CHECK_FALSE(picture_header(std::span(file).first(n)));
  }
  for (const std::string& text : {std::string(), std::string("GIF89a0000000000000000000000000000"),
           std::string("P6 4 3 255\n000000000000000000000000000"), std::string("\xff\xd8\xff\xda\0\x8\0\0\0\0\0\0", 12),
           std::string("\xff\xd8\xff\xc0\0\x4\x8\0\x1\0\x1\x3", 12),
           std::string("\xff\xd8\xff\xe0\0\x1\0\0\0\0\0\0", 12)})
    CHECK_FALSE(picture_header(bytes_of(text)));
  // A BMP's rows may run downwards; its least number has no counterpart.
  Bytes bmp = encode_image(".bmp", Image::black(5, 4, PixelFormat::bgr).view());
  bmp[22] = 0xfc;
  bmp[23] = bmp[24] = bmp[25] = 0xff;
  CHECK(picture_header(bmp)->height == 4);
  bmp[22] = bmp[23] = bmp[24] = 0;
  bmp[25] = 0x80;
  CHECK_FALSE(is_decodable(picture_header(bmp)));
}

TEST_CASE("a few bytes cannot ask for gigabytes") {
  ImageDecoder decode;
  CHECK_FALSE(decode(encode_image(".png", Image::black(7, 6, PixelFormat::bgr).view())).empty());
  for (const auto& [width, height] :
      {std::pair(30000u, 30000u), std::pair(40000u, 1u), std::pair(0u, 5u), std::pair(0xffffffffu, 0xffffffffu)}) {
    const Bytes file = png_that_claims(width, height);
    REQUIRE(picture_header(file));
    CHECK_FALSE(is_decodable(picture_header(file)));
    CHECK(decode(file).empty());
  }
  CHECK(is_decodable(picture_header(png_that_claims(10000, 10000))));
}
