#pragma once

#include "lumo/core/bytes.hpp"
#include "lumo/core/error.hpp"

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace lumo::sense {

// MCAP, a container of time-stamped messages, the default of ROS 2's bags (mcap.dev/spec, version 0). lumo reads and
// writes it itself: its limits on hostile input are strict, and fuzzed.
//
// All numbers are little endian. The parts of a file are: magic; Header; data (Schema, Channel, Message, Chunk,
// MessageIndex, Attachment, Metadata …); DataEnd; summary (Schema, Channel, Statistics, indexes …); Footer; magic.
// A record is its opcode (1 byte), its length (8 bytes) and its contents, to which later versions may append. Records
// of unknown opcodes are skipped. A chunk holds schemas, channels and messages, compressed.

enum class McapOpcode : std::uint8_t {
  header = 1,
  footer,
  schema,
  channel,
  message,
  chunk,
  message_index,
  chunk_index,
  attachment,
  attachment_index,
  statistics,
  metadata,
  metadata_index,
  summary_offset,
  data_end
};

inline constexpr std::array<std::uint8_t, 8> mcap_magic = {0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n'};

/// The type of a channel's messages.
struct McapSchema {
  std::uint16_t id = 0;  ///< not 0
  std::string name, encoding, data;
  bool operator==(const McapSchema&) const = default;
};

/// A stream of messages of one type.
struct McapChannel {
  std::uint16_t id = 0, schema = 0;  ///< schema 0: none
  std::string topic, encoding;
  std::map<std::string, std::string> metadata;
  bool operator==(const McapChannel&) const = default;
};

/// A file within the file.
struct McapAttachment {
  std::string name, media_type;
  std::uint64_t log_ns = 0, offset = 0, size = 0;  ///< where its data lie in the file
};

struct McapMetadata {
  std::string name;
  std::map<std::string, std::string> values;
};

/// Compression of chunks. A chunk states its `name`, empty for none.
/// Laws: `decompress` restores what was compressed; it gives `size` bytes or throws InputError, and allocates no more
/// than it has found.
template <class C>
concept ChunkCodec = requires(const C& codec, std::span<const std::uint8_t> bytes, std::size_t size) {
  { C::name } -> std::convertible_to<std::string_view>;
  { codec.compress(bytes) } -> std::same_as<std::vector<std::uint8_t>>;
  { codec.decompress(bytes, size) } -> std::same_as<std::vector<std::uint8_t>>;
};

/// Chunks as they are.
struct Uncompressed {
  static constexpr std::string_view name = "";

  std::vector<std::uint8_t> compress(std::span<const std::uint8_t> bytes) const { return {bytes.begin(), bytes.end()}; }
  std::vector<std::uint8_t> decompress(std::span<const std::uint8_t> bytes, std::size_t size) const {
    if (bytes.size() != size) throw InputError(message("has ", bytes.size(), " bytes, says ", size));
    return {bytes.begin(), bytes.end()};
  }
};

static_assert(ChunkCodec<Uncompressed>);

/// Reads a record's fields one by one and checks each length. Throws InputError that begins with `where` and the byte.
class McapFields {
 public:
  /// `offset`: of the first byte, in what `where` names.
  McapFields(std::span<const std::uint8_t> bytes, const std::string& where, std::uint64_t offset)
      : bytes_(bytes), where_(where), offset_(offset) {}

  template <std::unsigned_integral T> T number() { return number_at<T>(bytes(sizeof(T)).data(), ByteOrder::little); }
  std::string string() {
    const auto b = bytes(number<std::uint32_t>());
    return {b.begin(), b.end()};
  }
  std::map<std::string, std::string> map() {
    std::map<std::string, std::string> m;
    const auto b = bytes(number<std::uint32_t>());
    McapFields in(b, where_, offset() - b.size());
    while (in.rest() > 0) {
      std::string key = in.string();
      m[std::move(key)] = in.string();
    }
    return m;
  }
  /// Numbers, texts and maps, one after the other.
  template <class... Fields> void read(Fields&... f) { (field(f), ...); }
  std::span<const std::uint8_t> bytes(std::uint64_t size) {
    if (size > rest()) fail(message("a field of ", size, " bytes goes beyond the end of its record"));
    at_ += std::size_t(size);
    return bytes_.subspan(at_ - std::size_t(size), std::size_t(size));
  }
  std::size_t rest() const { return bytes_.size() - at_; }
  std::uint64_t offset() const { return offset_ + at_; }
  [[noreturn]] void fail(const std::string& why) const {
    throw InputError(message(where_, "byte ", offset(), ": ", why));
  }

 private:
  template <std::unsigned_integral T> void field(T& v) { v = number<T>(); }
  void field(std::string& s) { s = string(); }
  void field(std::map<std::string, std::string>& m) { m = map(); }

  std::span<const std::uint8_t> bytes_;
  const std::string& where_;
  std::uint64_t offset_;
  std::size_t at_ = 0;
};

/// Builds records.
class McapBytes {
 public:
  template <std::unsigned_integral T> void number(T v) {
    for (std::size_t i = 0; i < sizeof(T); ++i) bytes_.push_back(std::uint8_t(v >> 8 * i));
  }
  void string(std::string_view s) {
    number(std::uint32_t(s.size()));
    bytes_.insert(bytes_.end(), s.begin(), s.end());
  }
  void map(const std::map<std::string, std::string>& m) {
    const std::size_t at = begin_length<std::uint32_t>();
    for (const auto& [key, value] : m) fields(key, value);
    end_length<std::uint32_t>(at);
  }
  /// Numbers, texts and maps, one after the other.
  template <class... Fields> void fields(const Fields&... f) { (field(f), ...); }
  void bytes(std::span<const std::uint8_t> b) { bytes_.insert(bytes_.end(), b.begin(), b.end()); }
  /// A record, whose fields `fill()` appends. Returns where it begins.
  template <class Fill> std::size_t record(McapOpcode opcode, Fill fill) {
    const std::size_t begin = bytes_.size();
    bytes_.push_back(std::uint8_t(opcode));
    const std::size_t at = begin_length<std::uint64_t>();
    fill();
    end_length<std::uint64_t>(at);
    return begin;
  }
  template <std::unsigned_integral T> std::size_t begin_length() {
    number(T(0));
    return bytes_.size();
  }
  template <std::unsigned_integral T> void end_length(std::size_t at) {
    const auto n = T(bytes_.size() - at);
    for (std::size_t i = 0; i < sizeof(T); ++i) bytes_[at - sizeof(T) + i] = std::uint8_t(n >> 8 * i);
  }
  std::span<const std::uint8_t> since(std::size_t at) const { return std::span(bytes_).subspan(at); }
  std::size_t size() const { return bytes_.size(); }
  void clear() { bytes_.clear(); }

 private:
  template <std::unsigned_integral T> void field(T v) { number(v); }
  void field(std::string_view s) { string(s); }
  void field(const std::map<std::string, std::string>& m) { map(m); }

  std::vector<std::uint8_t> bytes_;
};

}  // namespace lumo::sense
