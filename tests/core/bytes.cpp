#include "catch.hpp"

#include "lumo/core/byte_order.hpp"
#include "lumo/core/read_whole.hpp"
#include "lumo/drawing/colour.hpp"
#include "temporary_folder.hpp"

#include <sys/stat.h>

#include <cstdint>
#include <string>

using namespace lumo;

TEST_CASE("a file is read whole, and nothing is read of what is none, or is too large", "[core]") {
  const TemporaryFolder folder;
  const std::string bytes("\0a\r\n\xff", 5);
  CHECK(read_whole(folder.write("file", bytes)) == bytes);
  CHECK(read_whole(folder.write("empty", "")) == "");
  CHECK(read_whole(folder / "file", 5) == bytes);
  CHECK_FALSE(read_whole(folder / "file", 4));
  CHECK_FALSE(read_whole(folder / "nothing"));
  CHECK_FALSE(read_whole(folder.path));
  REQUIRE(::mkfifo((folder / "pipe").c_str(), 0600) == 0);
  CHECK_FALSE(read_whole(folder / "pipe"));  // and does not wait for a writer
}

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

TEST_CASE("colours are written with two digits each", "[core]") {
  CHECK(hex_colour({0, 15, 255}) == "#000fff");
  CHECK(hex_colour({16, 160, 171}) == "#10a0ab");
}
