#include "kernel.hpp"

#include "lumo/sense/recording/mcap/mcap_reader.hpp"
#include "lumo/sense/recording/mcap/mcap_writer.hpp"
#include "lumo/support/lz4.hpp"
#include "lumo/support/zstd.hpp"

#include <cstdint>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

using namespace lumo;
using namespace lumo::sense;
using namespace lumo::micro;

namespace {

constexpr std::size_t messages = 64, size = 64 * 1024;

/// Bytes as a picture has them: a smooth course with noise in the two lowest bits.
std::vector<std::uint8_t> payload(std::size_t number) {
  std::vector<std::uint8_t> bytes(size);
  for (std::size_t i = 0; i < size; ++i)
    bytes[i] = std::uint8_t(((i / 16 + number) & 0xfcu) | (mix64(size * number + i) & 3u));
  return bytes;
}

template <class Codec> std::string file_of(const std::vector<std::vector<std::uint8_t>>& payloads) {
  std::ostringstream out;
  McapWriter<Codec> writer(out);
  const auto channel = writer.add_channel(writer.add_schema("A", "ros2msg", "uint8[] a\n"), "/a", "cdr");
  for (std::size_t k = 0; k < payloads.size(); ++k) writer.write(channel, 1000 * k, payloads[k]);
  writer.finish();
  return out.str();
}

template <class Codec> void time_log(const std::string& name, const std::vector<std::vector<std::uint8_t>>& payloads) {
  const std::string bytes = file_of<Codec>(payloads);
  const auto read = [&] {  // a reader checks every record and checksum before it gives the first message
    McapReader<Lz4, Zstd> reader(std::make_unique<std::istringstream>(bytes), "a.mcap");
    std::size_t sum = 0;
    for (const McapEntry& e : reader.messages()) sum += reader.read(e).data[7];
    return sum;
  };
  std::size_t sum = 0;
  for (const auto& p : payloads) sum += p[7];
  REQUIRE(read() == sum);
  BENCHMARK(named("MCAP file written", "64 messages of 64 KiB", name)) { return file_of<Codec>(payloads).size(); };
  BENCHMARK(named("MCAP file read, all messages", "64 messages of 64 KiB", name)) { return read(); };
}

}  // namespace

TEST_CASE("sense: logs as MCAP", "[sense]") {
  std::vector<std::vector<std::uint8_t>> payloads;
  for (std::size_t k = 0; k < messages; ++k) payloads.push_back(payload(k));
  time_log<Uncompressed>("uncompressed", payloads);
  time_log<Lz4>("LZ4", payloads);
  time_log<Zstd>("Zstandard", payloads);
}
