#pragma once

#include "lumo/drawing/short_number.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <string>
#include <vector>

namespace lumo {

/// A length in mm with at most six digits after the point: nanometres. The same in every locale.
inline std::string in_mm(double length_m) { return short_number(1e3 * length_m, 6); }

/// A flat drawing for cutting and checking; lengths in m, x to the right, y upwards.
struct Drawing {
  using Point = std::array<double, 2>;
  struct Layer {
    std::string name;    ///< capitals and _ only
    int dxf_color;       ///< AutoCAD's colour index, 1 to 255
    std::string stroke;  ///< the same, as CSS writes it
  };
  struct Line {
    int layer;
    std::vector<Point> points;
    bool closed = true;
  };
  struct Label {
    int layer;
    Point at;           ///< left end of its baseline
    double height;      ///< of capitals
    std::string words;  ///< ASCII
  };

  std::string title;
  std::vector<Layer> layers;
  std::vector<Line> lines;
  std::vector<Label> labels;

  /// Lower left and upper right corner of all lines.
  std::array<Point, 2> box() const {
    constexpr double far = std::numeric_limits<double>::infinity();
    Point low{far, far}, high{-far, -far};
    for (const Line& line : lines)
      for (const Point& p : line.points) {
        low = {std::min(low[0], p[0]), std::min(low[1], p[1])};
        high = {std::max(high[0], p[0]), std::max(high[1], p[1])};
      }
    return {low, high};
  }
};

}  // namespace lumo
