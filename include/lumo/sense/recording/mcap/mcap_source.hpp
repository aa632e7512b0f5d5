#pragma once

#include "lumo/core/bytes.hpp"
#include "lumo/core/error.hpp"
#include "lumo/sense/recording/mcap/mcap.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <istream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace lumo::sense {

/// The bytes of an MCAP file. Allocates no more than the file has. Throws InputError with file and byte.
class McapSource {
 public:
  static constexpr std::uint64_t head_bytes = 9;  ///< of a record, before its contents

  McapSource(std::unique_ptr<std::istream> in, std::string name)
      : in_(std::move(in)), name_(std::move(name)), where_(name_ + ": ") {
    in_->seekg(0, std::ios::end);
    size_ = std::uint64_t(std::max<std::streamoff>(0, std::streamoff(in_->tellg())));
    if (!in_->good()) throw InputError(where_ + "cannot be read");
  }

  const std::string& name() const { return name_; }
  const std::string& where() const { return where_; }  ///< what messages begin with
  std::uint64_t size() const { return size_; }
  [[noreturn]] void fail(std::uint64_t at, const std::string& why) const {
    throw InputError(message(where_, "byte ", at, ": ", why));
  }

  /// Without zeros behind the end mark, as they are left where space was allocated beforehand; a file without end mark
  /// keeps them.
  std::uint64_t size_without_padding() {
    constexpr std::uint64_t piece = 1u << 16;
    for (std::uint64_t end = size_; end > 0;) {
      const std::uint64_t from = end - std::min(end, piece);
      const std::vector<std::uint8_t> b = bytes(from, end - from);
      const auto last = std::find_if(b.rbegin(), b.rend(), [](std::uint8_t v) { return v != 0; });
      if (last == b.rend()) {
        end = from;
        continue;
      }
      end -= std::uint64_t(last - b.rbegin());
      return end >= mcap_magic.size() && has_magic(end - mcap_magic.size()) ? end : size_;
    }
    return size_;
  }

  /// Bytes that lie within the file.
  std::vector<std::uint8_t> bytes(std::uint64_t at, std::uint64_t size) {
    std::vector<std::uint8_t> b(static_cast<std::size_t>(size));
    in_->clear();
    in_->seekg(std::streamoff(at));
    in_->read(reinterpret_cast<char*>(b.data()), std::streamsize(size));
    if (!*in_) fail(at, "cannot be read");
    return b;
  }
  bool has_magic(std::uint64_t at) {
    const std::vector<std::uint8_t> b = bytes(at, mcap_magic.size());
    return std::equal(b.begin(), b.end(), mcap_magic.begin());
  }
  /// Continues a checksum with a stretch of the file, which may be larger than the memory.
  void add(Crc32& crc, std::uint64_t at, std::uint64_t size) {
    while (size > 0) {
      const std::uint64_t piece = std::min<std::uint64_t>(size, 1u << 20);
      crc.add(bytes(at, piece));
      at += piece;
      size -= piece;
    }
  }

  struct Head {
    McapOpcode opcode;
    std::uint64_t length;
  };
  /// A record's head. It lies before `end` with all of its contents.
  Head head(std::uint64_t at, std::uint64_t end) {
    if (end - at < head_bytes) fail(at, message("the file ends ", end - at, " bytes into a record"));
    const std::vector<std::uint8_t> b = bytes(at, head_bytes);
    McapFields in(b, where_, at);
    const Head h{McapOpcode(in.number<std::uint8_t>()), in.number<std::uint64_t>()};
    if (h.opcode == McapOpcode(0)) fail(at, "a record has the opcode 0, which there is not");
    if (h.length > end - at - head_bytes)
      fail(at, message("a record of ", h.length, " bytes goes beyond the end of the file, ", end - at - head_bytes,
                   " bytes on"));
    return h;
  }
  /// A whole record with its head.
  std::vector<std::uint8_t> record(std::uint64_t at, std::uint64_t most) {
    const Head h = head(at, size_);
    if (h.length > most) fail(at, message("a record has ", h.length, " bytes, read are at most ", most));
    return bytes(at, head_bytes + h.length);
  }

 private:
  std::unique_ptr<std::istream> in_;
  std::string name_, where_;
  std::uint64_t size_ = 0;
};

}  // namespace lumo::sense
