#include "catch.hpp"

#include "lumo/core/bytes.hpp"

#include <string_view>
#include <vector>

using namespace lumo;

namespace {

std::span<const std::uint8_t> bytes_of(std::string_view s) {
  return {reinterpret_cast<const std::uint8_t*>(s.data()), s.size()};
}

/// Bit by bit: the division itself.
std::uint32_t divided(std::span<const std::uint8_t> bytes) {
  std::uint32_t s = 0xFFFFFFFFu;
  for (const std::uint8_t b : bytes)
    for (int bit = 0; bit < 8; ++bit) s = ((s ^ (b >> bit)) & 1) != 0 ? s >> 1 ^ 0xEDB88320u : s >> 1;
  return ~s;
}

}  // namespace

TEST_CASE("numbers have their first byte at either end", "[core]") {
  const unsigned char bytes[] = {0x01, 0x80, 0xff, 0x04, 0x05, 0x06, 0x07, 0xf8};
  CHECK(number_at<std::uint8_t>(bytes, ByteOrder::big) == 1);
  CHECK(number_at<std::uint16_t>(bytes, ByteOrder::little) == 0x8001);
  CHECK(number_at<std::uint16_t>(bytes, ByteOrder::big) == 0x0180);
  CHECK(number_at<std::uint32_t>(bytes, ByteOrder::big) == 0x0180ff04u);
  CHECK(number_at<std::uint64_t>(bytes, ByteOrder::little) == 0xf807060504ff8001u);
  const char signed_bytes[] = {'\xff', '\x01'};  // a char may be negative
  CHECK(number_at<std::uint16_t>(signed_bytes, ByteOrder::little) == 0x01ff);
}

TEST_CASE("the checksum is the published one, and the division's remainder for any length and cut", "[crc32]") {
  CHECK(Crc32::of(bytes_of("123456789")) == 0xCBF43926u);  // the check value of the catalogues
  CHECK(Crc32::of(bytes_of("")) == 0u);
  CHECK(Crc32::of(bytes_of("The quick brown fox jumps over the lazy dog")) == 0x414FA339u);
  std::vector<std::uint8_t> bytes;
  for (unsigned k = 0; k < 60; ++k) {
    const std::uint32_t whole = divided(bytes);
    CHECK(Crc32::of(bytes) == whole);
    for (std::size_t cut = 0; cut <= bytes.size(); cut += 7) {
      Crc32 crc;
      crc.add(std::span(bytes).first(cut));
      crc.add(std::span(bytes).subspan(cut));
      CHECK(crc.value() == whole);
    }
    bytes.push_back(std::uint8_t(97 * k * k + 31));
  }
}
