#pragma once

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>

namespace lumo {

enum class ByteOrder : std::uint8_t { big = 0, little = 1 };

/// The number whose first byte is at `bytes`.
template <std::unsigned_integral T, class Byte> constexpr T number_at(const Byte* bytes, ByteOrder order) {
  T v = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i)
    v = T(v | T(static_cast<std::uint8_t>(bytes[i])) << 8 * (order == ByteOrder::little ? i : sizeof(T) - 1 - i));
  return v;
}

namespace detail {

/// Table k: what a byte does to the state k bytes later.
constexpr std::array<std::array<std::uint32_t, 256>, 8> make_crc32_tables() {
  std::array<std::array<std::uint32_t, 256>, 8> t{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t s = i;
    for (int bit = 0; bit < 8; ++bit) s = s >> 1 ^ ((s & 1) != 0 ? 0xEDB88320u : 0u);
    t[0][i] = s;
  }
  for (std::size_t k = 1; k < 8; ++k)
    for (std::size_t i = 0; i < 256; ++i) t[k][i] = t[k - 1][i] >> 8 ^ t[0][t[k - 1][i] & 255];
  return t;
}

inline constexpr auto crc32_tables = make_crc32_tables();

}  // namespace detail

/// Cyclic redundancy check of 32 bits, fed piece by piece: of zip, PNG and MCAP. Reflected polynomial 0xEDB88320, all
/// ones before and after (ISO 3309). Eight bytes at a time by as many tables (Kounavis and Berry 2005). Own code, for
/// these thirty lines would else be the only need of zlib.
class Crc32 {
 public:
  void add(std::span<const std::uint8_t> bytes) {
    const auto& t = detail::crc32_tables;
    std::uint32_t s = state_;
    std::size_t i = 0;
    for (; i + 8 <= bytes.size(); i += 8) {
      const std::uint8_t* b = bytes.data() + i;
      s ^= std::uint32_t(b[0]) | std::uint32_t(b[1]) << 8 | std::uint32_t(b[2]) << 16 | std::uint32_t(b[3]) << 24;
      s = t[7][s & 255] ^ t[6][s >> 8 & 255] ^ t[5][s >> 16 & 255] ^ t[4][s >> 24] ^ t[3][b[4]] ^ t[2][b[5]] ^
          t[1][b[6]] ^ t[0][b[7]];
    }
    for (; i < bytes.size(); ++i) s = s >> 8 ^ t[0][(s ^ bytes[i]) & 255];
    state_ = s;
  }
  std::uint32_t value() const { return ~state_; }
  static std::uint32_t of(std::span<const std::uint8_t> bytes) {
    Crc32 crc;
    crc.add(bytes);
    return crc.value();
  }

 private:
  std::uint32_t state_ = 0xFFFFFFFFu;
};

}  // namespace lumo
