#pragma once

#include "lumo/core/bytes.hpp"
#include "lumo/core/error.hpp"

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

namespace lumo::sense {

// Common Data Representation, as ROS 2 serialises messages (OMG DDS-XTypes 1.3, 7.4.1: plain CDR of version 1). lumo
// reads and writes it itself: its limits on hostile input are strict, and fuzzed.
//
// Four bytes state the byte order. The fields follow one by one, each number at a multiple of its size, counted from
// behind those four bytes. A text is its length with the closing zero (32 bits), then its bytes; a sequence is its
// length, then its items.
//
// A message is a struct with `static void fields(self, archive)`, which hands its members to the archive in order:
// CdrReader fills them, CdrWriter takes them.

template <class T>
concept CdrNumber = std::is_arithmetic_v<T> && sizeof(T) <= 8;

/// The unsigned integer as large as a number.
template <class T> using BitsOf = std::conditional_t<sizeof(T) == 8, std::uint64_t,
    std::conditional_t<sizeof(T) == 4, std::uint32_t, std::conditional_t<sizeof(T) == 2, std::uint16_t, std::uint8_t>>>;

/// A message, or a part of one.
template <class T, class Archive>
concept CdrStruct = requires(T& t, Archive& a) {
  T::fields(t, a);
};

/// Reads the fields of one message. Throws InputError with the byte. Allocates no more than the message could hold.
class CdrReader {
 public:
  explicit CdrReader(std::span<const std::uint8_t> message) {
    if (message.size() < 4)
      throw InputError(lumo::message("CDR message has ", message.size(), " bytes, must have at least 4"));
    if (message[0] != 0 || message[1] > 1)
      throw InputError(lumo::message("CDR message is of representation ", message[0] * 256 + message[1],
          ", read are 0 (big endian) and 1 (little endian)"));
    order_ = ByteOrder(message[1]);
    bytes_ = message.subspan(4);
  }

  template <class... Fields> void operator()(Fields&... fields) { (read(fields), ...); }
  /// To be called last. Some writers fill up to a multiple of four bytes.
  void finish() const {
    if (bytes_.size() - at_ > 3)
      fail(lumo::message("the message goes on for ", bytes_.size() - at_, " bytes behind its last field"));
  }

 private:
  [[noreturn]] void fail(const std::string& why) const {
    throw InputError(lumo::message("CDR byte ", at_ + 4, ": ", why));
  }

  std::span<const std::uint8_t> take(std::size_t size, std::size_t alignment) {
    const std::size_t padding = (alignment - at_ % alignment) % alignment, rest = bytes_.size() - at_;
    if (padding > rest || size > rest - padding)
      fail(lumo::message("a field of ", size, " bytes goes beyond the end of the message"));
    at_ += padding + size;
    return bytes_.subspan(at_ - size, size);
  }
  template <class Bits> Bits bits() { return number_at<Bits>(take(sizeof(Bits), sizeof(Bits)).data(), order_); }
  /// Length of a sequence whose items have at least `least` bytes each.
  std::size_t length(std::size_t least) {
    const std::size_t n = bits<std::uint32_t>();
    if (n > (bytes_.size() - at_) / least)
      fail(lumo::message("a sequence of ", n, " items goes beyond the end of the message"));
    return n;
  }

  void read(std::span<const std::uint8_t>& v) { v = take(length(1), 1); }
  void read(bool& v) { v = bits<std::uint8_t>() != 0; }
  void read(std::string& v) {
    const auto b = take(length(1), 1);
    if (!b.empty() && b.back() != 0) fail("a text does not end in a zero");
    v.assign(b.begin(), b.end());
    if (!v.empty()) v.pop_back();
  }
  template <CdrNumber T> void read(T& v) { v = std::bit_cast<T>(bits<BitsOf<T>>()); }
  template <class T, std::size_t size> void read(std::array<T, size>& v) {
    for (T& item : v) read(item);
  }
  template <class T> void read(std::vector<T>& v) {
    v.resize(length(std::is_arithmetic_v<T> ? sizeof(T) : 4));
    for (T& item : v) read(item);
  }
  template <class T>
  requires CdrStruct<T, CdrReader>
  void read(T& v) { T::fields(v, *this); }

  std::span<const std::uint8_t> bytes_;
  ByteOrder order_;
  std::size_t at_ = 0;
};

/// Writes the fields of one message.
class CdrWriter {
 public:
  explicit CdrWriter(ByteOrder order = ByteOrder::little) : bytes_{0, std::uint8_t(order), 0, 0}, order_(order) {}

  template <class... Fields> void operator()(const Fields&... fields) { (write(fields), ...); }
  const std::vector<std::uint8_t>& bytes() const { return bytes_; }

 private:
  template <class Bits> void bits(Bits v) {
    while (bytes_.size() % sizeof(Bits) != 4 % sizeof(Bits)) bytes_.push_back(0);  // counted from behind the first four
    for (std::size_t i = 0; i < sizeof(Bits); ++i)
      bytes_.push_back(std::uint8_t(v >> 8 * (order_ == ByteOrder::little ? i : sizeof(Bits) - 1 - i)));
  }
  void length(std::size_t n) {
    if (n > 0xFFFFFFFFu)
      throw InvalidArgument(lumo::message("CDR sequence has ", n, " items, must have at most 4294967295"));
    bits(std::uint32_t(n));
  }

  void write(std::span<const std::uint8_t> v) {
    length(v.size());
    bytes_.insert(bytes_.end(), v.begin(), v.end());
  }
  void write(bool v) { bits(std::uint8_t(v)); }
  void write(const std::string& v) {
    length(v.size() + 1);
    bytes_.insert(bytes_.end(), v.begin(), v.end());
    bytes_.push_back(0);
  }
  template <CdrNumber T> void write(T v) { bits(std::bit_cast<BitsOf<T>>(v)); }
  template <class T, std::size_t size> void write(const std::array<T, size>& v) {
    for (const T& item : v) write(item);
  }
  template <class T> void write(const std::vector<T>& v) {
    length(v.size());
    for (const T& item : v) write(item);
  }
  template <class T>
  requires CdrStruct<const T, CdrWriter>
  void write(const T& v) { T::fields(v, *this); }

  std::vector<std::uint8_t> bytes_;
  ByteOrder order_;
};

/// The message in these bytes. Throws InputError.
template <class Message>
requires CdrStruct<Message, CdrReader> Message from_cdr(std::span<const std::uint8_t> bytes) {
  Message m;
  CdrReader in(bytes);
  in(m);
  in.finish();
  return m;
}

template <class Message>
requires CdrStruct<const Message, CdrWriter> std::vector<std::uint8_t> to_cdr(
    const Message& m, ByteOrder order = ByteOrder::little) {
  CdrWriter out(order);
  out(m);
  return out.bytes();
}

}  // namespace lumo::sense
