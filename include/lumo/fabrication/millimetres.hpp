#pragma once

#include <charconv>
#include <string>

namespace lumo {

/// A length in mm with at most six digits after the point: nanometres. The same in every locale.
inline std::string in_mm(double length_m) {
  char digits[400];
  std::string s(digits, std::to_chars(digits, digits + sizeof digits, 1e3 * length_m, std::chars_format::fixed, 6).ptr);
  s.erase(s.find_last_not_of('0') + 1);
  if (s.back() == '.') s.pop_back();
  return s == "-0" ? "0" : s;
}

}  // namespace lumo
