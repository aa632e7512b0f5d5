#pragma once

#include "lumo/core/error.hpp"
#include "lumo/fabrication/drawing.hpp"
#include "lumo/fabrication/millimetres.hpp"

#include <ostream>
#include <string>

namespace lumo {

/// The drawing as a DXF file, one drawing unit a mm: AutoCAD R12 in ASCII, which every laser cutter's program reads.
/// The format has no place for a unit, so that the drawings say it in words. Throws InputError when the stream fails.
/// Source: Autodesk, DXF Reference, release 12.
inline void write_dxf(std::ostream& out, const Drawing& drawing) {
  const auto pair = [&out](int code, const std::string& value) { out << code << "\n" << value << "\n"; };
  const auto point = [&pair](int code, const Drawing::Point& p) {
    pair(code, in_mm(p[0])), pair(code + 10, in_mm(p[1])), pair(code + 20, "0");
  };
  const auto begin = [&pair](const char* section) { pair(0, "SECTION"), pair(2, section); };
  const auto name = [&drawing](int layer) { return drawing.layers[std::size_t(layer)].name; };
  const auto box = drawing.box();

  pair(999, drawing.title + ", mm, 1:1, by lumo");
  begin("HEADER");
  pair(9, "$ACADVER"), pair(1, "AC1009");
  pair(9, "$EXTMIN"), point(10, box[0]);
  pair(9, "$EXTMAX"), point(10, box[1]);
  pair(0, "ENDSEC");
  begin("TABLES");
  pair(0, "TABLE"), pair(2, "LTYPE"), pair(70, "1");
  pair(0, "LTYPE"), pair(2, "CONTINUOUS"), pair(70, "0"), pair(3, "Solid line"), pair(72, "65"), pair(73, "0"),
      pair(40, "0");
  pair(0, "ENDTAB");
  pair(0, "TABLE"), pair(2, "LAYER"), pair(70, std::to_string(drawing.layers.size()));
  for (const Drawing::Layer& l : drawing.layers)
    pair(0, "LAYER"), pair(2, l.name), pair(70, "0"), pair(62, std::to_string(l.dxf_color)), pair(6, "CONTINUOUS");
  pair(0, "ENDTAB");
  pair(0, "ENDSEC");
  begin("ENTITIES");
  for (const Drawing::Line& line : drawing.lines) {
    pair(0, "POLYLINE"), pair(8, name(line.layer)), pair(66, "1"), point(10, {0.0, 0.0}),
        pair(70, line.closed ? "1" : "0");
    for (const Drawing::Point& p : line.points) pair(0, "VERTEX"), pair(8, name(line.layer)), point(10, p);
    pair(0, "SEQEND"), pair(8, name(line.layer));
  }
  for (const Drawing::Label& label : drawing.labels)
    pair(0, "TEXT"), pair(8, name(label.layer)), point(10, label.at), pair(40, in_mm(label.height)),
        pair(1, label.words);
  pair(0, "ENDSEC"), pair(0, "EOF");
  if (!out) throw InputError("writing a .dxf file failed");
}

}  // namespace lumo
