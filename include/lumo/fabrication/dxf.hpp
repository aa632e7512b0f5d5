#pragma once

#include "lumo/core/error.hpp"
#include "lumo/fabrication/drawing.hpp"

#include <initializer_list>
#include <ostream>
#include <string>
#include <utility>

namespace lumo {

/// The drawing as a DXF file, one drawing unit a mm: AutoCAD R12 in ASCII, which every laser cutter's program reads.
/// The format has no place for a unit, so that the drawings state it in words. Throws InputError when the stream fails.
/// Own code, as of .stl and .3mf: a page each, and the same input gives the same bits. Source: Autodesk, DXF Reference,
/// release 12.
inline void write_dxf(std::ostream& out, const Drawing& drawing) {
  using Pairs = std::initializer_list<std::pair<int, std::string>>;
  const auto write = [&out](const Pairs& pairs) {
    for (const auto& [code, value] : pairs) out << code << "\n" << value << "\n";
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
