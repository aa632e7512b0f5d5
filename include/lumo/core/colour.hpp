#pragma once

#include <array>
#include <string>

namespace lumo {

/// "#rrggbb" of red, green and blue, each 0 … 255.
inline std::string hex_colour(const std::array<int, 3>& rgb) {
  std::string colour = "#";
  for (const int c : rgb)
    for (const int digit : {c / 16, c % 16}) colour += "0123456789abcdef"[digit];
  return colour;
}

}  // namespace lumo
