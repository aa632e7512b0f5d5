#pragma once

#include "lumo/core/error.hpp"
#include "lumo/drawing/svg.hpp"

#include <algorithm>
#include <array>
#include <initializer_list>
#include <limits>
#include <ostream>
#include <string>
#include <utility>
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

/// The drawing as a DXF file, one drawing unit a mm: AutoCAD R12 in ASCII, which every laser cutter's program reads.
/// The format has no place for a unit, so that the drawings state it in words. Throws InputError when the stream fails.
/// Own code, as of .stl and .3mf: a page each, and the same input gives the same bits. Source: Autodesk, DXF Reference,
/// release 12.
inline void write_dxf(std::ostream& out, const Drawing& drawing) {
  using Pairs = std::initializer_list<std::pair<int, std::string>>;
  const auto write = [&out](const Pairs& pairs) {
    for (const auto& [code, value] : pairs) out << std::to_string(code) << "\n" << value << "\n";
  };
  const auto point = [&write](const Drawing::Point& p) { write({{10, in_mm(p[0])}, {20, in_mm(p[1])}, {30, "0"}}); };
  const auto name = [&drawing](int layer) { return drawing.layers[std::size_t(layer)].name; };
  const auto box = drawing.box();

  write({{999, drawing.title + ", mm, 1:1, by lumo"}});
  write({{0, "SECTION"}, {2, "HEADER"}, {9, "$ACADVER"}, {1, "AC1009"}, {9, "$EXTMIN"}});
  point(box[0]);
  write({{9, "$EXTMAX"}});
  point(box[1]);
  write({{0, "ENDSEC"}, {0, "SECTION"}, {2, "TABLES"}, {0, "TABLE"}, {2, "LTYPE"}, {70, "1"}});
  write({{0, "LTYPE"}, {2, "CONTINUOUS"}, {70, "0"}, {3, "Solid line"}, {72, "65"}, {73, "0"}, {40, "0"}});
  write({{0, "ENDTAB"}, {0, "TABLE"}, {2, "LAYER"}, {70, std::to_string(drawing.layers.size())}});
  for (const Drawing::Layer& l : drawing.layers)
    write({{0, "LAYER"}, {2, l.name}, {70, "0"}, {62, std::to_string(l.dxf_color)}, {6, "CONTINUOUS"}});
  write({{0, "ENDTAB"}, {0, "ENDSEC"}, {0, "SECTION"}, {2, "ENTITIES"}});
  for (const Drawing::Line& line : drawing.lines) {
    write({{0, "POLYLINE"}, {8, name(line.layer)}, {66, "1"}});
    point({0.0, 0.0});
    write({{70, line.closed ? "1" : "0"}});
    for (const Drawing::Point& p : line.points) {
      write({{0, "VERTEX"}, {8, name(line.layer)}});
      point(p);
    }
    write({{0, "SEQEND"}, {8, name(line.layer)}});
  }
  for (const Drawing::Label& label : drawing.labels) {
    write({{0, "TEXT"}, {8, name(label.layer)}});
    point(label.at);
    write({{40, in_mm(label.height)}, {1, label.words}});
  }
  write({{0, "ENDSEC"}, {0, "EOF"}});
  if (!out) throw InputError("writing a .dxf file failed");
}

}  // namespace lumo
