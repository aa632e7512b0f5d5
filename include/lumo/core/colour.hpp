#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <string>

namespace lumo {

namespace detail {

/// "#rrggbb" of red, green and blue, each 0 … 255.
inline std::string hex_colour(const std::array<int, 3>& rgb) {
  std::string colour = "#";
  for (const int c : rgb)
    for (const int digit : {c / 16, c % 16}) colour += "0123456789abcdef"[digit];
  return colour;
}

}  // namespace detail

/// "#rrggbb" at `part`, 0 … 1, of the way through evenly spaced stops: red, green and blue, each 0 … 255.
template <std::size_t N>
std::string colour_between(const std::array<std::array<double, 3>, N>& stops, double part) {
  const double t = double(N - 1) * std::clamp(part, 0.0, 1.0);
  const std::size_t low = std::min(N - 2, std::size_t(t));
  std::array<int, 3> rgb{};
  for (std::size_t k = 0; k < 3; ++k)
    rgb[k] = int(std::lround(stops[low][k] + (t - double(low)) * (stops[low + 1][k] - stops[low][k])));
  return detail::hex_colour(rgb);
}

}  // namespace lumo
