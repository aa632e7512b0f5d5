#pragma once

#include "lumo/drawing/svg.hpp"
#include "lumo/fabrication/drawing.hpp"

#include <algorithm>
#include <ostream>

namespace lumo {

/// The drawing as an SVG file at scale 1:1: its user unit is a mm, and so is its size on paper. Each layer is a group.
/// Throws InputError when the stream fails.
inline void write_svg(std::ostream& out, const Drawing& drawing) {
  constexpr double margin = 5.0e-3, line_mm = 0.15;
  constexpr int nanometres = 6;          // decimals of a mm
  constexpr double capitals = 0.73;      // height of DejaVu's capitals over its size
  constexpr double letter_width = 0.85;  // over their height: most letters are narrower
  auto [low, high] = drawing.box();
  for (const Drawing::Label& label : drawing.labels) {
    const double right = label.at[0] + letter_width * label.height * double(label.words.size());
    low = {std::min(low[0], label.at[0]), std::min(low[1], label.at[1])};
    high = {std::max(high[0], right), std::max(high[1], label.at[1] + label.height)};
  }
  const double left = low[0] - margin, top = high[1] + margin;
  Svg svg({1e3 * (high[0] + margin - left), 1e3 * (top - low[1] + margin), "mm", drawing.title, nanometres});
  const auto at = [&](const Drawing::Point& p) { return Svg::Point{1e3 * (p[0] - left), 1e3 * (top - p[1])}; };
  for (std::size_t k = 0; k < drawing.layers.size(); ++k) {
    const Drawing::Layer& layer = drawing.layers[k];
    svg.begin_group(layer.name, {.stroke = layer.stroke, .width = line_mm});
    for (const Drawing::Line& line : drawing.lines) {
      if (std::size_t(line.layer) != k) continue;
      Svg::Points points;
      for (const Drawing::Point& p : line.points) points.push_back(at(p));
      svg.outline(points, line.closed);
    }
    for (const Drawing::Label& label : drawing.labels)
      if (std::size_t(label.layer) == k)
        svg.text(at(label.at), label.words,
            {.size = 1e3 * (label.height / capitals), .anchor = Svg::left_out, .fill = layer.stroke, .stroke = "none"});
    svg.end_group();
  }
  svg.write(out);
}

}  // namespace lumo
