#pragma once

#include "lumo/core/bytes.hpp"
#include "lumo/core/error.hpp"
#include "lumo/sense/recording/mcap/mcap.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <ostream>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace lumo::sense {

/// Writes an MCAP file in chunks, with checksums of chunks, data and summary. The summary repeats schemas and channels
/// and has statistics and the index of chunks, which other programs rely on. `finish` must be called last: a file
/// without it counts as cut.
template <ChunkCodec Codec = Uncompressed> class McapWriter {
 public:
  /// `out` outlives the writer. A chunk ends with the message that brings it to `chunk_bytes`.
  explicit McapWriter(
      std::ostream& out, std::string_view profile = "ros2", Codec codec = {}, std::size_t chunk_bytes = 1u << 20)
      : out_(out), codec_(std::move(codec)), chunk_bytes_(chunk_bytes) {
    put(mcap_magic);
    McapBytes b;
    b.record(McapOpcode::header, [&] { b.fields(profile, "lumo"); });
    put(b.since(0));
  }

  std::uint16_t add_schema(std::string_view name, std::string_view encoding, std::string_view data) {
    schemas_.push_back(
        {next_number(schemas_.size(), "schemas"), std::string(name), std::string(encoding), std::string(data)});
    record(chunk_, schemas_.back());
    return schemas_.back().id;
  }
  /// `schema`: of add_schema, or 0 for none.
  std::uint16_t add_channel(std::uint16_t schema, std::string_view topic, std::string_view encoding,
      std::map<std::string, std::string> metadata = {}) {
    if (schema > schemas_.size())
      throw InvalidArgument(message("channel is of schema ", schema, ", there are ", schemas_.size()));
    channels_.push_back({next_number(channels_.size(), "channels"), schema, std::string(topic), std::string(encoding),
        std::move(metadata)});
    record(chunk_, channels_.back());
    return channels_.back().id;
  }
  void write(std::uint16_t channel, std::uint64_t log_ns, std::span<const std::uint8_t> data) {
    if (channel == 0 || channel > channels_.size())
      throw InvalidArgument(message("message is of channel ", channel, ", there are ", channels_.size()));
    const std::size_t at = chunk_.record(McapOpcode::message, [&] {
      chunk_.number(channel);
      chunk_.number(std::uint32_t(counts_[channel]++));
      chunk_.number(log_ns);
      chunk_.number(log_ns);  // published when it was logged: nothing else is known
      chunk_.bytes(data);
    });
    index_[channel].emplace_back(log_ns, std::uint64_t(at));
    chunk_times_.add(log_ns);
    if (chunk_.size() >= chunk_bytes_) end_chunk();
  }
  void attach(
      std::string_view name, std::string_view media_type, std::uint64_t log_ns, std::span<const std::uint8_t> data) {
    end_chunk();
    McapBytes b;
    b.record(McapOpcode::attachment, [&] {
      const std::size_t at = b.size();
      b.number(log_ns);
      b.number(std::uint64_t(0));  // when it was made is not known
      b.fields(name, media_type, std::uint64_t(data.size()));
      b.bytes(data);
      b.number(Crc32::of(b.since(at)));
    });
    attachments_.push_back({{std::string(name), std::string(media_type), log_ns, offset_, data.size()}, b.size()});
    put(b.since(0));
  }
  /// Throws InputError if writing failed.
  void finish() {
    end_chunk();
    McapBytes b;
    b.record(McapOpcode::data_end, [&] { b.number(crc_.value()); });
    put(b.since(0));

    const std::uint64_t start = offset_;
    McapBytes summary, offsets;
    const auto group = [&](McapOpcode opcode, const auto& items, auto add) {
      const std::size_t at = summary.size();
      for (const auto& item : items) add(item);
      if (items.empty()) return;
      offsets.record(McapOpcode::summary_offset,
          [&] { offsets.fields(std::uint8_t(opcode), start + at, std::uint64_t(summary.size() - at)); });
    };
    group(McapOpcode::schema, schemas_, [&](const McapSchema& s) { record(summary, s); });
    group(McapOpcode::channel, channels_, [&](const McapChannel& c) { record(summary, c); });
    const int once[] = {0};
    group(McapOpcode::statistics, std::span(once), [&](int) { record_statistics(summary); });
    group(McapOpcode::chunk_index, chunks_, [&](const Chunk& c) { record(summary, c); });
    group(McapOpcode::attachment_index, attachments_, [&](const Attached& a) { record(summary, a); });
    const std::uint64_t offsets_start = start + summary.size();
    summary.bytes(offsets.since(0));
    const std::size_t footer =
        summary.record(McapOpcode::footer, [&] { summary.fields(start, offsets_start, std::uint32_t(0)); });
    const auto checked = summary.since(0).first(footer + 9 + 16);
    const std::uint32_t crc = Crc32::of(checked);
    put(checked);
    McapBytes last;
    last.number(crc);
    last.bytes(mcap_magic);
    put(last.since(0));
    out_.flush();
    if (!out_) throw InputError("MCAP file cannot be written");
  }

 private:
  struct Times {
    std::uint64_t first = std::numeric_limits<std::uint64_t>::max(), last = 0;
    void add(std::uint64_t t) {
      first = std::min(first, t);
      last = std::max(last, t);
    }
    std::uint64_t begin() const { return std::min(first, last); }  ///< 0 without messages
  };
  struct Chunk {
    Times times;
    std::uint64_t offset, length, index_length, packed, unpacked;
    std::map<std::uint16_t, std::uint64_t> index_offsets;
  };
  struct Attached {
    McapAttachment attachment;  ///< `offset`: of its record
    std::uint64_t length;
  };

  static std::uint16_t next_number(std::size_t before, const char* what) {
    if (before >= 65535)
      throw InvalidArgument(message("MCAP file has ", before, " ", what, ", must have at most 65535"));
    return std::uint16_t(before + 1);
  }
  void put(std::span<const std::uint8_t> bytes) {
    out_.write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
    crc_.add(bytes);
    offset_ += bytes.size();
  }

  static void record(McapBytes& to, const McapSchema& s) {
    to.record(McapOpcode::schema, [&] { to.fields(s.id, s.name, s.encoding, s.data); });
  }
  static void record(McapBytes& to, const McapChannel& c) {
    to.record(McapOpcode::channel, [&] { to.fields(c.id, c.schema, c.topic, c.encoding, c.metadata); });
  }
  static void record(McapBytes& to, const Chunk& c) {
    to.record(McapOpcode::chunk_index, [&] {
      to.fields(c.times.begin(), c.times.last, c.offset, c.length);
      const std::size_t at = to.begin_length<std::uint32_t>();
      for (const auto& [channel, offset] : c.index_offsets) to.fields(channel, offset);
      to.end_length<std::uint32_t>(at);
      to.fields(c.index_length, Codec::name, c.packed, c.unpacked);
    });
  }
  static void record(McapBytes& to, const Attached& a) {
    to.record(McapOpcode::attachment_index, [&] {
      to.fields(a.attachment.offset, a.length, a.attachment.log_ns, std::uint64_t(0), a.attachment.size,
          a.attachment.name, a.attachment.media_type);
    });
  }
  void record_statistics(McapBytes& to) const {
    Times times;
    for (const Chunk& c : chunks_)
      if (!c.index_offsets.empty()) {
        times.add(c.times.first);
        times.add(c.times.last);
      }
    std::uint64_t messages = 0;
    for (const auto& [channel, count] : counts_) messages += count;
    to.record(McapOpcode::statistics, [&] {
      to.fields(messages, std::uint16_t(schemas_.size()), std::uint32_t(channels_.size()),
          std::uint32_t(attachments_.size()), std::uint32_t(0), std::uint32_t(chunks_.size()), times.begin(),
          times.last);
      const std::size_t at = to.begin_length<std::uint32_t>();
      for (const auto& [channel, count] : counts_) to.fields(channel, count);
      to.end_length<std::uint32_t>(at);
    });
  }

  void end_chunk() {
    if (chunk_.size() == 0) return;
    const auto contents = chunk_.since(0);
    const std::vector<std::uint8_t> packed = codec_.compress(contents);
    Chunk c{chunk_times_, offset_, 0, 0, packed.size(), contents.size(), {}};
    McapBytes b;
    b.record(McapOpcode::chunk, [&] {
      b.fields(c.times.begin(), c.times.last, c.unpacked, Crc32::of(contents), Codec::name, c.packed);
      b.bytes(packed);
    });
    c.length = b.size();
    for (const auto& of_channel : index_) {
      const std::size_t at = b.record(McapOpcode::message_index, [&] {
        b.number(of_channel.first);
        const std::size_t list = b.begin_length<std::uint32_t>();
        for (const auto& [log_ns, place] : of_channel.second) b.fields(log_ns, place);
        b.end_length<std::uint32_t>(list);
      });
      c.index_offsets[of_channel.first] = c.offset + at;
    }
    c.index_length = b.size() - c.length;
    put(b.since(0));
    chunks_.push_back(std::move(c));
    chunk_.clear();
    index_.clear();
    chunk_times_ = {};
  }

  std::ostream& out_;
  Codec codec_;
  std::size_t chunk_bytes_;
  Crc32 crc_;
  std::uint64_t offset_ = 0;
  std::vector<McapSchema> schemas_;
  std::vector<McapChannel> channels_;
  std::map<std::uint16_t, std::uint64_t> counts_;
  McapBytes chunk_;
  Times chunk_times_;
  std::map<std::uint16_t, std::vector<std::pair<std::uint64_t, std::uint64_t>>> index_;
  std::vector<Chunk> chunks_;
  std::vector<Attached> attachments_;
};

}  // namespace lumo::sense
