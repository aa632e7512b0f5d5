#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>

namespace lumo {

enum class ByteOrder : std::uint8_t { big = 0, little = 1 };

/// The number whose first byte is at `bytes`.
template <std::unsigned_integral T, class Byte> constexpr T number_at(const Byte* bytes, ByteOrder order) {
  T v = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i)
    v = T(v | T(static_cast<std::uint8_t>(bytes[i])) << 8 * (order == ByteOrder::little ? i : sizeof(T) - 1 - i));
  return v;
}

}  // namespace lumo
