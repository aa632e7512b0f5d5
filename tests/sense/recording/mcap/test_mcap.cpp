#include "catch.hpp"

#include "lumo/sense/recording/mcap/mcap_reader.hpp"
#include "lumo/sense/recording/mcap/mcap_writer.hpp"
#include "lumo/support/lz4.hpp"
#include "lumo/support/zstd.hpp"
#include "sense/synthetic.hpp"

#include <sstream>
#include <string>

using namespace lumo;
using namespace lumo::sense;

namespace {

using AllCodecs = McapReader<Lz4, Zstd>;
using McapFileBytes = std::vector<std::uint8_t>;

std::span<const std::uint8_t> span_of(std::string_view s) {
  return {reinterpret_cast<const std::uint8_t*>(s.data()), s.size()};
}

template <class Reader = AllCodecs> Reader mcap_of(const std::string& bytes, const McapLimits& limits = {}) {
  return Reader(std::make_unique<std::istringstream>(bytes), "a.mcap", limits);
}

template <class Reader = AllCodecs> std::string mcap_refusal(const std::string& bytes, const McapLimits& limits = {}) {
  try {
    mcap_of<Reader>(bytes, limits);
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

/// What is in a file, as one text.
template <class Reader> std::string all_contents(Reader& r) {
  std::string all;
  for (const McapEntry& e : r.messages()) {
    const McapMessage m = r.read(e);
    all += message(m.channel->topic, ' ', r.schemas().at(m.channel->schema).name, ' ', m.sequence, ' ', m.log_ns, ' ',
        std::string(m.data.begin(), m.data.end()), '\n');
  }
  for (const McapAttachment& a : r.attachments()) {
    const McapFileBytes bytes = r.read(a);
    all += message(a.name, ' ', a.media_type, ' ', a.log_ns, ' ', std::string(bytes.begin(), bytes.end()), '\n');
  }
  return all;
}

/// Two channels, times not in order, several chunks.
template <class Codec> std::string mcap_example(std::size_t chunk_bytes = 300, int messages = 40) {
  std::ostringstream out;
  McapWriter<Codec> w(out, "ros2", Codec{}, chunk_bytes);
  w.attach("note.txt", "text/plain", 5, span_of("beside"));
  const auto a = w.add_channel(w.add_schema("A", "ros2msg", "uint8 a\n"), "/a", "cdr", {{"k", "v"}, {"l", ""}});
  const auto b = w.add_channel(w.add_schema("B", "ros2msg", "uint8 b\n"), "/b", "cdr");
  for (int k = 0; k < messages; ++k)
    w.write(k % 3 == 0 ? b : a, std::uint64_t(1000 + 10 * k - 35 * (k % 4)),
        span_of("message " + std::to_string(k) + std::string(std::size_t(k % 20), '.')));
  w.finish();
  return out.str();
}

/// A file by hand: records between a header and the end.
template <class Fill> std::string mcap_by_hand(Fill fill) {
  McapBytes b;
  b.bytes(mcap_magic);
  b.record(McapOpcode::header, [&] { b.fields("p", "l"); });
  fill(b);
  b.record(McapOpcode::data_end, [&] { b.number(std::uint32_t(0)); });
  b.record(McapOpcode::footer, [&] { b.fields(std::uint64_t(0), std::uint64_t(0), std::uint32_t(0)); });
  b.bytes(mcap_magic);
  return {b.since(0).begin(), b.since(0).end()};
}

void put_schema(McapBytes& b, std::uint16_t id = 1) {
  b.record(McapOpcode::schema, [&] { b.fields(id, "S", "ros2msg", "x"); });
}
void put_channel(McapBytes& b, std::uint16_t id = 1, std::uint16_t schema = 1) {
  b.record(McapOpcode::channel, [&] {
    b.fields(id, schema, "/s", "cdr");
    b.map({});
  });
}
void put_message(McapBytes& b, std::uint64_t t, std::uint16_t channel = 1) {
  b.record(McapOpcode::message, [&] {
    b.fields(channel, std::uint32_t(0), t, t);
    b.bytes(span_of("x"));
  });
}
void put_chunk(McapBytes& b, std::string_view compression, std::uint64_t size, std::span<const std::uint8_t> packed,
    std::uint32_t crc = 0) {
  b.record(McapOpcode::chunk, [&] {
    b.fields(std::uint64_t(0), std::uint64_t(0), size, crc, compression, std::uint64_t(packed.size()));
    b.bytes(packed);
  });
}

}  // namespace

TEST_CASE("zeros that pad a chunk or a file are no records, and a chunk may call itself packed by none", "[mcap]") {
  McapBytes inside;
  put_schema(inside);
  put_channel(inside);
  put_message(inside, 7);
  std::vector<std::uint8_t> chunk(inside.since(0).begin(), inside.since(0).end());
  for (const std::size_t zeros : {std::size_t(0), std::size_t(3), std::size_t(9), std::size_t(500)})
    for (const char* const compression : {"", "none"}) {
      std::vector<std::uint8_t> padded = chunk;
      padded.resize(chunk.size() + zeros);
      const std::string bytes = mcap_by_hand([&](McapBytes& b) { put_chunk(b, compression, padded.size(), padded); }) +
                                std::string(70000 * (zeros % 2), '\0');
      AllCodecs r = mcap_of(bytes);
      CHECK(r.fault().empty());
      REQUIRE(r.messages().size() == 1);
      CHECK(r.read(r.messages()[0]).log_ns == 7);
    }
  std::vector<std::uint8_t> gap = chunk;  // a record behind zeros is lost, which is an error
  gap.resize(chunk.size() + 20);
  gap.back() = 1;
  CHECK_FALSE(mcap_refusal(mcap_by_hand([&](McapBytes& b) { put_chunk(b, "", gap.size(), gap); })).empty());
  AllCodecs cut = mcap_of(mcap_example<Zstd>().substr(0, 900) + std::string(4096, '\0'));  // space that was not filled
  CHECK_FALSE(cut.fault().empty());
}

TEMPLATE_TEST_CASE(
    "codecs give back what they took, and refuse what is cut, longer or damaged", "[mcap]", Uncompressed, Lz4, Zstd) {
  const TestType codec;
  synthetic::Normal draw(1);
  for (const std::size_t n : {0, 1, 100, 65536, 65537, 300000}) {
    McapFileBytes bytes(n);
    for (std::size_t k = 0; k < n; ++k) bytes[k] = std::uint8_t(k % 7 == 0 ? 255.0 * draw.uniform() : 3);
    const McapFileBytes packed = codec.compress(bytes);
    CHECK(codec.decompress(packed, n) == bytes);
    CHECK_THROWS_AS(codec.decompress(packed, n + 1), InputError);
    CHECK_THROWS_AS(codec.decompress(packed, std::size_t(1) << 40), InputError);  // and takes no terabyte for it
    if (n > 0) CHECK_THROWS_AS(codec.decompress(packed, n - 1), InputError);
    if (!packed.empty()) CHECK_THROWS_AS(codec.decompress(std::span(packed).first(packed.size() - 1), n), InputError);
    McapFileBytes more = packed;
    more.push_back(0);
    CHECK_THROWS_AS(codec.decompress(more, n), InputError);
  }
}

TEMPLATE_TEST_CASE(
    "a file reads back as it was written, in the order of log times", "[mcap]", Uncompressed, Lz4, Zstd) {
  const std::string bytes = mcap_example<TestType>();
  AllCodecs r = mcap_of(bytes);
  CHECK(r.fault().empty());
  CHECK(r.profile() == "ros2");
  CHECK(r.library() == "lumo");
  CHECK(r.messages().size() == 40);
  CHECK(std::is_sorted(r.messages().begin(), r.messages().end(),
      [](const McapEntry& a, const McapEntry& b) { return a.log_ns < b.log_ns; }));
  CHECK(r.channels().at(1).metadata == std::map<std::string, std::string>{{"k", "v"}, {"l", ""}});
  CHECK(all_contents(r).find("/a A 0 975 message 1.\n") != std::string::npos);
  CHECK(all_contents(r).ends_with("note.txt text/plain 5 beside\n"));
  // The size of chunks, and how few of them are kept, change nothing.
  AllCodecs whole = mcap_of(mcap_example<TestType>(1u << 20));
  CHECK(all_contents(whole) == all_contents(r));
  AllCodecs forgetful = mcap_of(bytes, {.kept_bytes = 0});
  CHECK(all_contents(forgetful) == all_contents(r));
  AllCodecs empty = mcap_of(mcap_example<TestType>(300, 0));
  CHECK(empty.messages().empty());
}

TEMPLATE_TEST_CASE(
    "a flipped bit anywhere is an error, or changes nothing but the end mark", "[mcap]", Uncompressed, Lz4, Zstd) {
  const std::string whole = mcap_example<TestType>(300, 12);
  AllCodecs good = mcap_of(whole);
  const std::string expected = all_contents(good);
  for (std::size_t bit = 0; bit < 8 * whole.size(); bit += bit % 8 == 7 ? 3 : 1) {
    std::string flipped = whole;
    flipped[bit / 8] = char(flipped[bit / 8] ^ char(1 << bit % 8));
    try {
      AllCodecs r = mcap_of(flipped);
      const bool end_mark =
          bit / 8 >= whole.size() - mcap_magic.size() && !r.fault().empty() && all_contents(r) == expected;
      if (!end_mark) FAIL("bit " << bit << " of " << 8 * whole.size() << " is not missed");
    } catch (const InputError& e) {
      if (!std::string_view(e.what()).starts_with("a.mcap: ")) FAIL(e.what());
    }
  }
}

TEMPLATE_TEST_CASE("a cut file is read up to the cut, which is reported", "[mcap]", Uncompressed, Lz4, Zstd) {
  const std::string whole = mcap_example<TestType>();
  std::size_t most = 0;
  for (std::size_t n = 0; n < whole.size(); ++n) {
    if (n < mcap_magic.size()) {
      CHECK_FALSE(mcap_refusal(whole.substr(0, n)).empty());
      continue;
    }
    AllCodecs r = mcap_of(whole.substr(0, n));
    if (r.fault().empty() || r.messages().size() < most) FAIL("cut at " << n << ": " << r.fault());
    most = r.messages().size();
    for (const McapEntry& e : r.messages()) r.read(e);
  }
  CHECK(most == 40);
  // A power failure leaves zeros, or anything, where data should have been.
  for (const std::string& tail : {std::string(5000, '\0'), std::string(5000, 'x')}) {
    AllCodecs r = mcap_of(whole.substr(0, whole.size() / 2) + tail);
    CHECK_FALSE(r.fault().empty());
    CHECK(r.messages().size() > 5);
  }
}

TEST_CASE("files without chunks, checksums, summary, with records and fields of later versions", "[mcap]") {
  AllCodecs r = mcap_of(mcap_by_hand([](McapBytes& b) {
    b.record(McapOpcode(0x60), [&] { b.string("of a later version"); });
    b.record(McapOpcode(0x90), [&] { b.string("somebody's own"); });
    put_schema(b);
    put_schema(b);  // again, the same
    b.record(McapOpcode::channel, [&] {
      b.fields(std::uint16_t(1), std::uint16_t(1), "/s", "cdr");
      b.map({});
      b.string("a later field");
    });
    put_message(b, 7);
    put_message(b, 5);
    b.record(McapOpcode::metadata, [&] {
      b.string("m");
      b.map({{"a", "b"}});
    });
    McapBytes inner;
    inner.record(McapOpcode(0x70), [&] {});
    put_message(inner, 6);
    put_chunk(b, "", inner.size(), inner.since(0));
  }));
  REQUIRE(r.messages().size() == 3);
  CHECK(r.messages()[0].log_ns == 5);
  CHECK(r.messages()[1].chunked);
  CHECK(r.read(r.messages()[1]).data.size() == 1);
  CHECK(r.read(r.messages()[2]).log_ns == 7);
  REQUIRE(r.metadata().size() == 1);
  CHECK(r.metadata()[0].values.at("a") == "b");
}

TEST_CASE("what a file must not say is refused with its byte", "[mcap]") {
  const auto refusal = [](auto fill) { return mcap_refusal(mcap_by_hand(fill)); };
  CHECK(mcap_refusal("") == "a.mcap: byte 0: is no MCAP file, which begins with its magic");
  CHECK(mcap_refusal(std::string(100, 'a')) == "a.mcap: byte 0: is no MCAP file, which begins with its magic");
  CHECK(refusal([](auto& b) { put_message(b, 1); }) ==
        "a.mcap: byte 38: a message is of channel 1, which was not there before it");
  CHECK(refusal([](auto& b) { put_channel(b); }).find("is of schema 1, which was not there before it") !=
        std::string::npos);
  CHECK(refusal([](auto& b) { put_schema(b, 0); }).find("a schema has the number 0") != std::string::npos);
  CHECK(refusal([](auto& b) {
    put_schema(b);
    put_channel(b);
    b.record(McapOpcode::channel, [&] {
      b.fields(std::uint16_t(1), std::uint16_t(1), "/other", "cdr");
      b.map({});
    });
  }).find("there is another channel 1") != std::string::npos);
  CHECK(refusal([](auto& b) { b.record(McapOpcode(0), [&] {}); }).find("opcode 0") != std::string::npos);
  CHECK(refusal([](auto& b) {
    b.record(McapOpcode::header, [&] { b.fields("", ""); });
  }).find("there is a second header") != std::string::npos);
  CHECK(refusal([](auto& b) {
    b.record(McapOpcode::footer, [&] { b.bytes(std::vector<std::uint8_t>(20)); });
  }).find("footer before the end of the data") != std::string::npos);
  CHECK(refusal([](auto& b) {
    b.record(McapOpcode::data_end, [&] { b.number(std::uint32_t(0)); });
  }).find("stands behind their end") != std::string::npos);
  CHECK(refusal([](auto& b) {
    b.record(McapOpcode::data_end, [&] { b.number(std::uint32_t(1)); });
  }).find("the data are damaged") != std::string::npos);
  CHECK(refusal([](auto& b) {
    b.record(McapOpcode::schema, [&] { b.fields(std::uint16_t(1), std::uint32_t(0xFFFFFFFF)); });
  }) == "a.mcap: byte 42: a field of 4294967295 bytes goes beyond the end of its record");
  CHECK(refusal([](auto& b) {
    put_chunk(b, "lzma", 1, span_of("x"));
  }).find("compressed by 'lzma', which cannot be read here") != std::string::npos);
  CHECK(mcap_refusal<McapReader<>>(mcap_example<Zstd>()).find("compressed by 'zstd', which cannot be read here") !=
        std::string::npos);
  CHECK(refusal([](auto& b) {
    put_chunk(b, "lz4", std::uint64_t(1) << 60, span_of("x"));
  }).find("a chunk says that it holds 1152921504606846976 bytes, read are at most 268435456") != std::string::npos);
  CHECK(refusal([](auto& b) { put_chunk(b, "", 3, span_of("ab")); }).find("has 2 bytes, says 3") != std::string::npos);
  CHECK(refusal([](auto& b) {
    put_chunk(b, "zstd", 3, span_of("no frame"));
  }).find("cannot be unpacked: Zstandard: ") != std::string::npos);
  CHECK(refusal([](auto& b) {
    McapBytes inner;
    put_chunk(inner, "", 0, {});
    put_chunk(b, "", inner.size(), inner.since(0));
  }).find("chunk at byte 27, byte 9: a chunk holds a record of opcode 6") != std::string::npos);
  CHECK(refusal([](auto& b) {
    b.record(
        McapOpcode::attachment, [&] { b.fields(std::uint64_t(0), std::uint64_t(0), "a", "b", ~std::uint64_t(0)); });
  }).find("an attachment of 18446744073709551615 bytes goes beyond the end of its record") != std::string::npos);
  const std::string large = mcap_example<Uncompressed>(1u << 20, 40);
  CHECK(mcap_refusal(large, {.record_bytes = 1000}).find("read are at most 1000") != std::string::npos);
}

TEST_CASE("a compressed chunk that grows without end is not followed", "[mcap]") {
  const McapFileBytes zeros(64u << 20);
  for (const bool lz4 : {false, true}) {
    const McapFileBytes packed = lz4 ? Lz4{}.compress(zeros) : Zstd{}.compress(zeros);
    const auto said = [&](std::uint64_t size) {
      return mcap_refusal(mcap_by_hand([&](auto& b) { put_chunk(b, lz4 ? "lz4" : "zstd", size, packed); }));
    };
    CHECK(said(1000).find("cannot be unpacked") != std::string::npos);
    CHECK(said(std::uint64_t(1) << 40).find("read are at most") != std::string::npos);
  }
}

TEST_CASE("random damage is read or refused in one line, never worse", "[mcap]") {
  synthetic::Normal draw(9);
  const std::string good[] = {mcap_example<Uncompressed>(300, 12), mcap_example<Lz4>(300, 12),
      mcap_example<Zstd>(300, 12), mcap_by_hand([](auto& b) {
        put_schema(b);
        put_channel(b);
        put_message(b, 1);
      })};
  int refused = 0;
  for (int k = 0; k < 4000; ++k) {
    std::string bad = good[k % 4];
    for (int n = 1 + int(4.0 * draw.uniform()); n > 0; --n) {
      const auto at = std::size_t(double(bad.size() - 1) * draw.uniform());
      if (draw.uniform() < 0.3) bad.erase(at, std::size_t(9.0 * draw.uniform()));
      else bad[at] = char(int(256.0 * draw.uniform()) - 128);
    }
    if (k % 2 == 0) {
      bad.resize(bad.size() - std::min<std::size_t>(bad.size(), 8));
      bad.append(mcap_magic.begin(), mcap_magic.end());
    }
    try {
      AllCodecs r = mcap_of(bad);
      all_contents(r);
    } catch (const InputError& e) {
      ++refused;
      if (std::string_view(e.what()).find('\n') != std::string_view::npos) FAIL(e.what());
    }
  }
  CHECK(refused > 1000);
}

TEST_CASE("the writer refuses what it has not", "[mcap]") {
  std::ostringstream out;
  McapWriter w(out);
  CHECK_THROWS_AS(w.write(1, 0, {}), InvalidArgument);
  CHECK_THROWS_AS(w.add_channel(1, "/a", "cdr"), InvalidArgument);
  std::ostringstream full;
  McapWriter onto(full);
  full.setstate(std::ios::badbit);
  CHECK_THROWS_AS(onto.finish(), InputError);
}

TEST_CASE("records that are no codec's are no codec", "[mcap]") {
  STATIC_REQUIRE_FALSE(ChunkCodec<int>);
  STATIC_REQUIRE(ChunkCodec<Uncompressed>);
}
