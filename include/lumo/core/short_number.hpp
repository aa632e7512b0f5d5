#pragma once

#include <array>
#include <charconv>
#include <string>
#include <system_error>

namespace lumo {

/// A number with at most `digits` decimals and no trailing zeros; the same in every locale. "?" where that takes more
/// than 400 characters.
inline std::string short_number(double v, int digits = 2) {
  std::array<char, 400> buffer;
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), v, std::chars_format::fixed, digits);
  if (end.ec != std::errc{}) return "?";
  std::string s(buffer.data(), end.ptr);
  if (s.find('.') != std::string::npos) {
    while (s.back() == '0') s.pop_back();
    if (s.back() == '.') s.pop_back();
  }
  return s == "-0" ? "0" : s;
}

}  // namespace lumo
