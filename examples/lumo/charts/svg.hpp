#pragma once

#include "lumo/drawing/colour.hpp"
#include "lumo/drawing/svg.hpp"

#include <array>
#include <string>

namespace lumo::program {

using Point = Svg::Point;
using Points = Svg::Points;
using Paint = Svg::Paint;

/// Colours that people with any colour vision distinguish (Okabe & Ito 2008), darkest contrasts first.
inline constexpr std::array<const char*, 7> palette = {
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000"};

/// Shade k of n from light to dark: ordered things (loads) differ in lightness, which survives greyscale print.
inline std::string shade(int k, int n) {
  constexpr std::array<std::array<double, 3>, 2> ends{{{0xa9, 0xcf, 0xea}, {0x08, 0x2c, 0x5c}}};
  return colour_between(ends, n > 1 ? double(k) / (n - 1) : 1.0);
}

}  // namespace lumo::program
