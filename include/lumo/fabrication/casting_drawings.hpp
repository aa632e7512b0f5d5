#pragma once

#include "lumo/core/error.hpp"
#include "lumo/fabrication/core_solid.hpp"
#include "lumo/fabrication/drawing.hpp"

#include <string>
#include <vector>

namespace lumo {

/// The cross-section through the middle of the closed mould, seen along y, at scale 1:1. Throws InvalidArgument.
inline Drawing section_drawing(const CastSection& section, const CastingOptions& options = {});
/// The LED strip from above, y to the right: its outline and its LEDs. Throws InvalidArgument.
inline Drawing strip_drawing(const CastSection& section, const CastingOptions& options = {});
/// The side of a core, for cutting it from sheet. Throws InvalidArgument where there is no gap.
inline Drawing core_drawing(const CastSection& section, const CastingOptions& options = {});

namespace detail {

/// Words under a drawing, and a line of 10 mm by which a print can be measured.
inline void add_caption(Drawing& d, const std::string& words) {
  const int layer = int(d.layers.size());
  d.layers.push_back({"NOTES", 8, "#666666"});
  const auto box = d.box();
  const double x = box[0][0], y = box[0][1] - 5.0e-3;
  d.lines.push_back({layer, {{x, y + 1.0e-3}, {x, y}, {x + 10.0e-3, y}, {x + 10.0e-3, y + 1.0e-3}}, false});
  d.labels.push_back({layer, {x + 12.0e-3, y}, 1.8e-3, "10 mm"});
  d.labels.push_back({layer, {x, y - 4.0e-3}, 1.8e-3, words});
  d.title = words;
}

inline Drawing::Line box_line(int layer, double x0, double x1, double y0, double y1) {
  return {layer, {{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}}};
}

/// A half outline at x > 0 and its mirror image in one loop.
inline std::vector<Drawing::Point> mirrored(std::vector<Drawing::Point> half) {
  for (std::size_t i = half.size(); i-- > 0;)
    if (half[i][0] != 0.0) half.push_back({-half[i][0], half[i][1]});
  return half;
}

}  // namespace detail

inline Drawing section_drawing(const CastSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  const double ridge = 0.5 * s.ridge_width, led = 0.5 * s.leds.width_x;
  Drawing d;
  d.layers = {
      {"SILICONE", 4, "#0072b2"}, {"CARRIER", 8, "#444444"}, {"LED_STRIP", 2, "#b07400"}, {"MOULD", 3, "#009e73"}};
  if (s.gap_width > 0.0) d.layers.push_back({"CORES", 1, "#d55e00"});
  std::vector<Drawing::Point> pad{{ridge, s.ridge_height}};
  if (s.gap_width > 0.0)
    pad.insert(pad.end(), {{ridge + s.gap_width, s.ridge_height}, {ridge + s.gap_width, 0.0}});
  else
    pad.push_back({ridge, 0.0});
  pad.insert(pad.end(), s.outline.begin(), s.outline.end());
  d.lines.push_back({0, detail::mirrored(std::move(pad))});
  d.lines.push_back({1, detail::mirrored({{at.pocket_x, at.pocket_floor},
                                          {at.pocket_x, s.ridge_height},
                                          {ridge, s.ridge_height},
                                          {ridge, 0.0},
                                          {at.plate_x, 0.0},
                                          {at.plate_x, -o.plate}})});
  d.lines.push_back(detail::box_line(2, -0.5 * o.strip_width, 0.5 * o.strip_width, at.pocket_floor, s.ridge_height));
  d.lines.push_back({2, {{-led, s.ridge_height}, {led, s.ridge_height}}, false});
  for (const double side : {1.0, -1.0}) {
    std::vector<Drawing::Point> half{{at.half_width, 0.0},       {at.rim_x, 0.0},
                                     {at.rim_x, -o.rim},         {at.mould_x, -o.rim},
                                     {at.mould_x, at.mould_top}, {0.0, at.mould_top}};
    half.insert(half.end(), s.outline.rbegin(), s.outline.rend() - 1);
    for (auto& p : half) p[0] *= side;
    d.lines.push_back({3, std::move(half)});
    if (s.gap_width > 0.0)
      d.lines.push_back(detail::box_line(4, side * ridge, side * (ridge + s.gap_width), 0.0, s.ridge_height));
  }
  std::vector<std::string> legend{"silicone", "carrier", "LED strip", "mould"};
  if (s.gap_width > 0.0) legend.push_back("cores");
  for (int layer = 0; layer < int(legend.size()); ++layer)
    d.labels.push_back(
        {layer, {at.mould_x + 3.0e-3, at.mould_top - (2.0 + 4.0 * layer) * 1e-3}, 1.8e-3, legend[std::size_t(layer)]});
  detail::add_caption(d, "Section at scale 1:1");
  return d;
}

inline Drawing strip_drawing(const CastSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  Drawing d;
  d.layers = {{"OUTLINE", 7, "#222222"}, {"LEDS", 2, "#b07400"}};
  d.lines.push_back(detail::box_line(0, -at.strip_y, at.strip_y, -0.5 * o.strip_width, 0.5 * o.strip_width));
  for (int k = 0; k < s.leds.count; ++k) {
    const double y = (k - 0.5 * (s.leds.count - 1)) * s.leds.pitch;
    d.lines.push_back(detail::box_line(1, y - 0.5 * s.leds.length_y, y + 0.5 * s.leds.length_y, -0.5 * s.leds.width_x,
                                       0.5 * s.leds.width_x));
  }
  detail::add_caption(d, message("LED strip at scale 1:1, ", 2e3 * at.strip_y, " x ", 1e3 * o.strip_width,
                                 " mm, LEDs every ", 1e3 * s.leds.pitch, " mm"));
  return d;
}

inline Drawing core_drawing(const CastSection& s, const CastingOptions& o) {
  validate(o, s);
  require_positive("gap width", s.gap_width * 1e3, "mm");
  Drawing d;
  d.layers = {{"OUTLINE", 7, "#222222"}};
  d.lines.push_back({0, core_outline(s, o)});
  detail::add_caption(d, message("Core at scale 1:1, ", 1e3 * s.gap_width, " mm thick, two of them"));
  return d;
}

}  // namespace lumo
