#pragma once

#include "lumo/core/bytes.hpp"
#include "lumo/core/error.hpp"
#include "lumo/sense/recording/mcap/mcap.hpp"
#include "lumo/sense/recording/mcap/mcap_source.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <fstream>
#include <istream>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

namespace lumo::sense {

/// Where a message lies in a file, and what orders it.
struct McapEntry {
  std::uint64_t log_ns = 0;
  std::uint64_t record = 0;    ///< byte of its chunk in the file, or its own
  std::uint32_t in_chunk = 0;  ///< byte in the chunk's contents
  std::uint16_t channel = 0;
  bool chunked = false;
};

struct McapMessage {
  const McapChannel* channel = nullptr;  ///< the reader's
  std::uint32_t sequence = 0;
  std::uint64_t log_ns = 0, publish_ns = 0;
  std::span<const std::uint8_t> data;
  std::shared_ptr<const std::vector<std::uint8_t>> owner;  ///< of `data`
};

/// Limits on what a reader of MCAP files allocates at once.
struct McapLimits {
  std::uint32_t record_bytes = 256u << 20;  ///< of a record but an attachment, and of a chunk's contents
  std::uint32_t kept_bytes = 64u << 20;     ///< of chunks' contents kept for the next message; one chunk always is
};

/// An MCAP file. The constructor goes through all of it once: it checks records, lengths and checksums, keeps schemas,
/// channels and attachments, and lists messages in the order of their log times. It does not rely on summary and
/// indexes, so files without them read as well. A file without its end mark was cut, for instance by a power failure:
/// it is read up to its first incomplete record, which `fault` reports. Any other damage is an InputError, one line
/// with file, byte and reason. `Codecs`: compressions that can be read beside none. For one thread.
template <ChunkCodec... Codecs> class McapReader {
 public:
  /// Throws InputError.
  McapReader(std::unique_ptr<std::istream> in, std::string name, const McapLimits& limits = {})
      : source_(std::move(in), std::move(name)), limits_(limits) {
    const std::uint64_t size = source_.size_without_padding();
    if (size < mcap_magic.size() || !source_.has_magic(0)) fail(0, "is no MCAP file, which begins with its magic");
    const bool whole = size >= 2 * mcap_magic.size() && source_.has_magic(size - mcap_magic.size());
    try {
      scan(whole ? size - mcap_magic.size() : size);
      if (!whole) fail(size, "the file was cut, it lacks its end");
    } catch (const InputError& e) {
      if (whole) throw;
      fault_ = e.what();
    }
    std::stable_sort(
        messages_.begin(), messages_.end(), [](const McapEntry& a, const McapEntry& b) { return a.log_ns < b.log_ns; });
  }
  /// Throws InputError.
  static McapReader open(const std::string& path, const McapLimits& limits = {}) {
    auto in = std::make_unique<std::ifstream>(path, std::ios::binary);
    if (!*in) throw InputError(path + ": cannot be opened");
    return McapReader(std::move(in), path, limits);
  }

  const std::string& name() const { return source_.name(); }
  const std::string& profile() const { return profile_; }
  const std::string& library() const { return library_; }  ///< that wrote the file
  const std::map<std::uint16_t, McapSchema>& schemas() const { return schemas_; }
  const std::map<std::uint16_t, McapChannel>& channels() const { return channels_; }
  const std::vector<McapAttachment>& attachments() const { return attachments_; }
  const std::vector<McapMetadata>& metadata() const { return metadata_; }
  /// In the order of their log times; those of one time as they stand in the file.
  const std::vector<McapEntry>& messages() const { return messages_; }
  /// Place and reason of a cut file's end; empty for a whole file.
  const std::string& fault() const { return fault_; }

  /// Throws InputError if the file has changed since, and for a packed message that cannot be unpacked.
  McapMessage read(const McapEntry& entry) {
    McapMessage m;
    std::size_t at = 0;
    if (entry.chunked) {
      m.owner = chunk(entry.record);
      at = entry.in_chunk;
    } else {
      m.owner = std::make_shared<const std::vector<std::uint8_t>>(record_at(entry.record));
    }
    const std::string where = entry.chunked ? chunk_place(entry.record) : source_.where();
    McapFields in(std::span<const std::uint8_t>(*m.owner).subspan(std::min(at, m.owner->size())), where,
        entry.chunked ? at : entry.record);
    const auto opcode = McapOpcode(in.number<std::uint8_t>());
    const auto length = in.number<std::uint64_t>();
    const std::uint64_t begin = in.offset();
    McapFields fields(in.bytes(length), where, begin);
    if (opcode != McapOpcode::message) fields.fail("is no message any more: the file has changed");
    fill(m, fields);
    unpack(m);
    return m;
  }
  /// Throws InputError if the file has changed since.
  std::vector<std::uint8_t> read(const McapAttachment& a) { return source_.bytes(a.offset, a.size); }

 private:
  using Bytes = std::vector<std::uint8_t>;
  static constexpr std::uint64_t head_bytes = McapSource::head_bytes;

  std::string chunk_place(std::uint64_t at) const { return message(source_.where(), "chunk at byte ", at, ", "); }
  [[noreturn]] void fail(std::uint64_t at, const std::string& why) const { source_.fail(at, why); }
  Bytes record_at(std::uint64_t at) { return source_.record(at, limits_.record_bytes); }

  void scan(std::uint64_t end) {
    Crc32 data_crc;
    data_crc.add(mcap_magic);
    std::optional<std::uint64_t> data_end;  // where the summary may begin
    bool first = true, closed = false;
    std::uint64_t at = mcap_magic.size();
    while (at < end) {
      if (closed) fail(at, "there is more behind the footer");
      const McapSource::Head h = source_.head(at, end);
      if (first != (h.opcode == McapOpcode::header))
        fail(at, first ? "the first record is no header" : "there is a second header");
      first = false;
      const bool of_data = h.opcode == McapOpcode::message || h.opcode == McapOpcode::chunk ||
                           h.opcode == McapOpcode::message_index || h.opcode == McapOpcode::attachment ||
                           h.opcode == McapOpcode::metadata || h.opcode == McapOpcode::data_end;
      if (of_data && data_end)
        fail(at, message("a record of the data, opcode ", int(h.opcode), ", stands behind their end"));
      if (h.opcode == McapOpcode::attachment) {
        add_attachment(at, h.length);
        source_.add(data_crc, at, head_bytes + h.length);
      } else if (h.opcode > McapOpcode::data_end) {
        if (!data_end) source_.add(data_crc, at, head_bytes + h.length);
      } else {
        const Bytes record = record_at(at);
        McapFields in(std::span<const std::uint8_t>(record).subspan(head_bytes), source_.where(), at + head_bytes);
        if (h.opcode == McapOpcode::data_end) {
          const auto stated = in.number<std::uint32_t>();
          if (stated != 0 && stated != data_crc.value()) fail(at, "the data are damaged: their checksum is another");
          data_end = at + head_bytes + h.length;
        } else if (h.opcode == McapOpcode::footer) {
          if (!data_end) fail(at, "there is a footer before the end of the data");
          check_summary(in, at, *data_end);
          closed = true;
        } else if (h.opcode == McapOpcode::chunk) {
          take_chunk(record, at);
        } else {
          take(h.opcode, in, {0, at, 0, 0, false});
        }
        if (!data_end) data_crc.add(record);
      }
      at += head_bytes + h.length;
    }
    if (!closed) fail(at, "the file ends without a footer");
  }

  /// A record of the data or the summary. `place`: of a message.
  void take(McapOpcode opcode, McapFields& in, McapEntry place) {
    switch (opcode) {
      case McapOpcode::header: in.read(profile_, library_); break;
      case McapOpcode::schema: {
        McapSchema s;
        in.read(s.id, s.name, s.encoding, s.data);
        if (s.id == 0) in.fail("a schema has the number 0");
        if (const auto [it, added] = schemas_.emplace(s.id, s); !added && it->second != s)
          in.fail(message("there is another schema ", s.id));
        break;
      }
      case McapOpcode::channel: {
        McapChannel c;
        in.read(c.id, c.schema, c.topic, c.encoding, c.metadata);
        if (c.schema != 0 && !schemas_.contains(c.schema))
          in.fail(message("channel ", c.id, " is of schema ", c.schema, ", which was not there before it"));
        if (const auto [it, added] = channels_.emplace(c.id, c); !added && it->second != c)
          in.fail(message("there is another channel ", c.id));
        break;
      }
      case McapOpcode::message: {
        McapMessage m;
        fill(m, in);
        place.log_ns = m.log_ns;
        place.channel = m.channel->id;
        messages_.push_back(place);
        break;
      }
      case McapOpcode::metadata: {
        McapMetadata m;
        in.read(m.name, m.values);
        metadata_.push_back(std::move(m));
        break;
      }
      default: break;  // indexes of what has been seen
    }
  }
  void fill(McapMessage& m, McapFields& in) const {
    const auto id = in.number<std::uint16_t>();
    const auto channel = channels_.find(id);
    if (channel == channels_.end()) in.fail(message("a message is of channel ", id, ", which was not there before it"));
    m.channel = &channel->second;
    in.read(m.sequence, m.log_ns, m.publish_ns);
    m.data = in.bytes(in.rest());
  }

  /// rosbag2 can pack each message by itself ("compression_mode: MESSAGE"), which the file does not state. No CDR
  /// message begins as a frame of Zstandard does.
  void unpack(McapMessage& m) const {
    if (m.channel->encoding != "cdr") return;
    const auto attempt = [&](const auto& codec) {
      if constexpr (requires { codec.frame_bytes(m.data); }) {
        const auto size = codec.frame_bytes(m.data);
        if (!size) return;
        if (*size > limits_.record_bytes)
          throw InputError(message(source_.where(), "a packed message says that it holds ", *size,
              " bytes, read are at most ", limits_.record_bytes));
        auto whole = std::make_shared<const Bytes>(codec.decompress(m.data, std::size_t(*size)));
        m.data = *whole;
        m.owner = std::move(whole);
      }
    };
    std::apply([&](const auto&... codec) { (attempt(codec), ...); }, codecs_);
  }

  void take_chunk(std::span<const std::uint8_t> chunk_record, std::uint64_t at) {
    const auto contents = keep(at, unpacked(chunk_record, at));
    const std::string where = chunk_place(at);
    McapFields in(*contents, where, 0);
    while (in.rest() > 0) {
      const std::uint64_t begin = in.offset();
      if (const auto rest = std::span(*contents).subspan(std::size_t(begin));
          std::all_of(rest.begin(), rest.end(), [](std::uint8_t b) { return b == 0; }))
        break;  // padded with zeros, which are no records
      const auto opcode = McapOpcode(in.number<std::uint8_t>());
      const auto length = in.number<std::uint64_t>();
      const std::uint64_t inside = in.offset();
      McapFields record(in.bytes(length), where, inside);
      if (opcode == McapOpcode::schema || opcode == McapOpcode::channel || opcode == McapOpcode::message)
        take(opcode, record, {0, at, std::uint32_t(begin), 0, true});
      else if (opcode <= McapOpcode::data_end) record.fail(message("a chunk holds a record of opcode ", int(opcode)));
    }
  }
  /// Contents of the chunk at a place, from what is kept or from the file.
  std::shared_ptr<const Bytes> chunk(std::uint64_t at) {
    const auto known = std::find_if(kept_.begin(), kept_.end(), [at](const auto& k) { return k.first == at; });
    if (known != kept_.end()) {
      std::rotate(known, known + 1, kept_.end());  // the one used last is dropped last
      return kept_.back().second;
    }
    return keep(at, unpacked(record_at(at), at));
  }
  std::shared_ptr<const Bytes> keep(std::uint64_t at, Bytes contents) {
    kept_.emplace_back(at, std::make_shared<const Bytes>(std::move(contents)));
    std::uint64_t sum = 0;
    for (const auto& k : kept_) sum += k.second->size();
    while (kept_.size() > 1 && sum > limits_.kept_bytes) {
      sum -= kept_.front().second->size();
      kept_.erase(kept_.begin());
    }
    return kept_.back().second;
  }
  Bytes unpacked(std::span<const std::uint8_t> record, std::uint64_t at) const {
    McapFields in(record.subspan(head_bytes), source_.where(), at + head_bytes);
    in.bytes(16);  // times of the first and last message
    const auto size = in.number<std::uint64_t>();
    const auto crc = in.number<std::uint32_t>();
    const std::string compression = in.string();
    const auto packed = in.bytes(in.number<std::uint64_t>());
    if (size > limits_.record_bytes)
      fail(at, message("a chunk says that it holds ", size, " bytes, read are at most ", limits_.record_bytes));
    std::optional<Bytes> contents;
    try {
      const auto attempt = [&](const auto& codec) {
        const bool is_none = codec.name.empty() && compression == "none";  // as some writers name it
        if (!contents && (codec.name == compression || is_none)) contents = codec.decompress(packed, std::size_t(size));
      };
      attempt(Uncompressed{});
      std::apply([&](const auto&... codec) { (attempt(codec), ...); }, codecs_);
    } catch (const InputError& e) {
      fail(at, message("a chunk's contents cannot be unpacked: ", e.what()));
    }
    if (!contents)
      fail(at, message("a chunk is compressed by '", printable(compression), "', which cannot be read here"));
    if (crc != 0 && crc != Crc32::of(*contents)) fail(at, "a chunk is damaged: its contents' checksum is another");
    return std::move(*contents);
  }

  /// The record's checksum is checked piece by piece: it may be larger than the memory.
  void add_attachment(std::uint64_t at, std::uint64_t length) {
    const std::uint64_t begin = at + head_bytes;
    const Bytes front = source_.bytes(begin, std::min<std::uint64_t>(length, 1u << 20));
    McapFields in(front, source_.where(), begin);
    McapAttachment a;
    a.log_ns = in.number<std::uint64_t>();
    in.number<std::uint64_t>();  // when it was made
    in.read(a.name, a.media_type, a.size);
    a.offset = in.offset();
    const std::uint64_t rest = length - (a.offset - begin);
    if (rest < 4 || a.size > rest - 4)
      in.fail(message("an attachment of ", a.size, " bytes goes beyond the end of its record"));
    const Bytes tail = source_.bytes(a.offset + a.size, 4);
    const auto stated = McapFields(tail, source_.where(), a.offset + a.size).number<std::uint32_t>();
    Crc32 crc;
    if (stated != 0) source_.add(crc, begin, a.offset + a.size - begin);
    if (stated != 0 && stated != crc.value()) fail(at, "an attachment is damaged: its checksum is another");
    attachments_.push_back(std::move(a));
  }
  /// The checksum goes from the summary's first byte to the footer's last but itself.
  void check_summary(McapFields& footer, std::uint64_t at, std::uint64_t data_end) {
    const auto start = footer.number<std::uint64_t>();
    footer.number<std::uint64_t>();  // where the summary's offsets begin
    const auto stated = footer.number<std::uint32_t>();
    if (start != 0 && (start < data_end || start > at))
      fail(at, message("the footer says that the summary begins at byte ", start, ", must lie in [", data_end, ", ", at,
                   "]"));
    const std::uint64_t from = start == 0 ? at : start;
    Crc32 crc;
    if (stated != 0) source_.add(crc, from, at + head_bytes + 16 - from);
    if (stated != 0 && stated != crc.value()) fail(at, "the summary is damaged: its checksum is another");
  }

  McapSource source_;
  std::string profile_, library_, fault_;
  McapLimits limits_;
  std::map<std::uint16_t, McapSchema> schemas_;
  std::map<std::uint16_t, McapChannel> channels_;
  std::vector<McapAttachment> attachments_;
  std::vector<McapMetadata> metadata_;
  std::vector<McapEntry> messages_;
  std::vector<std::pair<std::uint64_t, std::shared_ptr<const Bytes>>> kept_;
  [[no_unique_address]] std::tuple<Codecs...> codecs_;
};

}  // namespace lumo::sense
