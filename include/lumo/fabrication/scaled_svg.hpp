#pragma once

#include "lumo/core/error.hpp"
#include "lumo/fabrication/drawing.hpp"
#include "lumo/fabrication/millimetres.hpp"

#include <algorithm>
#include <ostream>
#include <string>

namespace lumo {

/// The drawing as an SVG file at scale 1:1: its user unit is a mm, and so is its size on paper. Each layer is a group. Throws InputError when the stream fails.
inline void write_svg(std::ostream& out, const Drawing& drawing) {
  constexpr double margin = 5.0e-3;
  auto [low, high] = drawing.box();
  for (const Drawing::Label& label : drawing.labels) {   // letters are at most as wide as high, but for few
    low = {std::min(low[0], label.at[0]), std::min(low[1], label.at[1])};
    high = {std::max(high[0], label.at[0] + 0.85 * label.height * double(label.words.size())), std::max(high[1], label.at[1] + label.height)};
  }
  const double left = low[0] - margin, top = high[1] + margin;
  const std::string width = in_mm(high[0] + margin - left), height = in_mm(top - low[1] + margin);
  const auto at = [&](const Drawing::Point& p) { return in_mm(p[0] - left) + " " + in_mm(top - p[1]); };
  out << "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" << width << "mm\" height=\"" << height << "mm\" viewBox=\"0 0 " << width << " " << height
      << "\" font-family=\"DejaVu Sans, Verdana, Helvetica, sans-serif\">\n<title>" << drawing.title << "</title>\n<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n";
  for (std::size_t k = 0; k < drawing.layers.size(); ++k) {
    const Drawing::Layer& layer = drawing.layers[k];
    out << "<g id=\"" << layer.name << "\" fill=\"none\" stroke=\"" << layer.stroke << "\" stroke-width=\"0.15\" stroke-linejoin=\"round\">\n";
    for (const Drawing::Line& line : drawing.lines) {
      if (std::size_t(line.layer) != k) continue;
      out << "<path d=\"";
      for (std::size_t i = 0; i < line.points.size(); ++i) out << (i == 0 ? "M" : "L") << at(line.points[i]);
      out << (line.closed ? "Z\"/>\n" : "\"/>\n");
    }
    for (const Drawing::Label& label : drawing.labels)
      if (std::size_t(label.layer) == k)   // DejaVu's capitals are 0.73 of its size high
        out << "<text x=\"" << in_mm(label.at[0] - left) << "\" y=\"" << in_mm(top - label.at[1]) << "\" font-size=\"" << in_mm(label.height / 0.73) << "\" fill=\"" << layer.stroke
            << "\" stroke=\"none\">" << label.words << "</text>\n";
    out << "</g>\n";
  }
  out << "</svg>\n";
  if (!out) throw InputError("writing an .svg file failed");
}

}  // namespace lumo
