#include "catch.hpp"

#include "lumo/sense/recording/mcap/ros_messages.hpp"

#include <limits>
#include <string>

using namespace lumo;
using namespace lumo::sense;

namespace {

using CdrBytes = std::vector<std::uint8_t>;

/// One of each kind of field, at places that need filling up.
struct EveryField {
  std::uint8_t a = 0;
  std::uint16_t b = 0;
  bool c = false;
  std::uint32_t d = 0;
  std::string e;
  double f = 0.0;
  std::vector<double> g;
  std::vector<std::string> h;
  std::array<std::int32_t, 2> i{};

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) {
    archive(s.a, s.b, s.c, s.d, s.e, s.f, s.g, s.h, s.i);
  }
  bool operator==(const EveryField&) const = default;
};

const EveryField every_field{0x11, 0x2233, true, 0x44556677, "ab", 1.0, {2.0}, {"", "x"}, {-1, 2}};

template <class M> std::string cdr_refusal(const CdrBytes& bytes) {
  try {
    from_cdr<M>(bytes);
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

}  // namespace

TEST_CASE("fields stand at multiples of their size, counted from behind the byte order", "[cdr]") {
  const CdrBytes little = to_cdr(every_field, ByteOrder::little);
  const CdrBytes expected = {0, 1, 0, 0,                // little endian
      0x11, 0,                                          // filled up to 2
      0x33, 0x22, 1, 0, 0, 0,                           // filled up to 4
      0x77, 0x66, 0x55, 0x44, 3, 0, 0, 0, 'a', 'b', 0,  // length with the zero
      0, 0, 0, 0, 0,                                    // filled up to 8
      0, 0, 0, 0, 0, 0, 0xF0, 0x3F,                     // 1.0
      1, 0, 0, 0, 0, 0, 0, 0,                           // one item, filled up to 8
      0, 0, 0, 0, 0, 0, 0, 0x40,                        // 2.0
      2, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 'x', 0, 0, 0, 0xFF, 0xFF, 0xFF, 0xFF, 2, 0, 0, 0};
  CHECK(little == expected);
  const CdrBytes big = to_cdr(every_field, ByteOrder::big);
  REQUIRE(big.size() == little.size());
  CHECK(big[1] == 0);
  CHECK(CdrBytes(big.begin() + 6, big.begin() + 8) == CdrBytes{0x22, 0x33});
  CHECK(CdrBytes(big.begin() + 28, big.begin() + 36) == CdrBytes{0x3F, 0xF0, 0, 0, 0, 0, 0, 0});
  for (const ByteOrder order : {ByteOrder::little, ByteOrder::big})
    CHECK(from_cdr<EveryField>(to_cdr(every_field, order)) == every_field);
}

TEST_CASE("a message that is cut, goes on, or lies about its lengths is refused with the byte", "[cdr]") {
  for (const ByteOrder order : {ByteOrder::little, ByteOrder::big}) {
    const CdrBytes whole = to_cdr(every_field, order);
    for (std::size_t n = 0; n < whole.size(); ++n)
      CHECK_FALSE(cdr_refusal<EveryField>(CdrBytes(whole.begin(), whole.begin() + std::ptrdiff_t(n))).empty());
    for (int extra = 1; extra <= 5; ++extra) {
      CdrBytes more = whole;
      more.resize(whole.size() + std::size_t(extra));
      CHECK(cdr_refusal<EveryField>(more).empty() == (extra <= 3));  // some writers fill up
    }
    for (std::size_t bit = 0; bit < 8 * whole.size(); ++bit) {
      CdrBytes flipped = whole;
      flipped[bit / 8] = std::uint8_t(flipped[bit / 8] ^ 1u << bit % 8);
      try {
        from_cdr<EveryField>(flipped);
      } catch (const InputError&) {
      }
    }
  }
  CdrBytes huge = to_cdr(RosJointState{});
  for (std::size_t k = 20; k < 24; ++k) huge[k] = 0xFF;  // how many names there are
  CHECK(cdr_refusal<RosJointState>(huge).find("a sequence of 4294967295 items goes beyond the end of the message") !=
        std::string::npos);
  CHECK(cdr_refusal<EveryField>({0, 7, 0, 0}) ==
        "CDR message is of representation 7, read are 0 (big endian) and 1 (little endian)");
  CHECK(cdr_refusal<EveryField>({0, 1}) == "CDR message has 2 bytes, must have at least 4");
}

TEST_CASE("stamps before 1970 and up to 2038 read back, later ones are refused", "[cdr]") {
  for (const std::int64_t ns :
      {std::int64_t(0), std::int64_t(-1), std::int64_t(-1'000'000'000), std::int64_t(1'700'000'000'123'456'789),
          std::int64_t(2'147'483'647'999'999'999), std::int64_t(-2'147'483'648'000'000'000)})
    CHECK(from_cdr<RosHeader>(to_cdr(RosHeader{ns, "a"})).stamp_ns == ns);
  CHECK_THROWS_AS(to_cdr(RosHeader{2'147'483'648'000'000'000, ""}), InvalidArgument);
  CdrBytes bad = to_cdr(RosHeader{5, ""});
  bad[11] = 0x40;
  CHECK(cdr_refusal<RosHeader>(bad) == "stamp has 1073741829 ns, must have fewer than 1000000000");
}

TEST_CASE("messages read back in both byte orders", "[cdr]") {
  RosCameraInfo info;
  info.header = {5, "camera"};
  info.height = 480;
  info.width = 640;
  info.distortion_model = "plumb_bob";
  info.d = {0.1, -0.2, 0.0, 0.0, 0.3};
  for (std::size_t k = 0; k < 12; ++k) info.p[k] = double(k) + 0.5;
  info.k[8] = 1.0;
  info.r[4] = 1.0;
  info.binning_x = 2;
  info.roi = {1, 2, 3, 4, true};
  const CdrBytes pixels = {1, 2, 3, 4, 5, 6};
  for (const ByteOrder order : {ByteOrder::little, ByteOrder::big}) {
    const auto i = from_cdr<RosCameraInfo>(to_cdr(info, order));
    CHECK(i.d == info.d);
    CHECK(i.p == info.p);
    CHECK(i.roi.width == 4);
    CHECK(i.roi.do_rectify);
    const CdrBytes message = to_cdr(RosImage{{7, "c"}, 1, 2, "bgr8", 0, 6, pixels}, order);
    const auto m = from_cdr<RosImage>(message);
    CHECK(m.encoding == "bgr8");
    CHECK(CdrBytes(m.data.begin(), m.data.end()) == pixels);
    CHECK(m.data.data() >= message.data());  // no copy
    const auto w = from_cdr<RosWrenchStamped>(
        to_cdr(RosWrenchStamped{{1, "f"}, {1, 2, 3}, {4, 5, std::numeric_limits<double>::infinity()}}, order));
    CHECK(w.force[2] == 3.0);
    CHECK(std::isinf(w.torque[2]));
  }
}

TEST_CASE("a schema has each of its types behind a line", "[cdr]") {
  CHECK(RosCompressedImage::definition() ==
        "std_msgs/Header header\nstring format\nuint8[] data\n" + std::string(80, '=') +
            "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n" + std::string(80, '=') +
            "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n");
}
