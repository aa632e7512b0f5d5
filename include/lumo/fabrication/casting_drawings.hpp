#pragma once

#include "lumo/core/error.hpp"
#include "lumo/fabrication/drawing.hpp"
#include "lumo/fabrication/solids.hpp"

#include <string>
#include <vector>

namespace lumo {

/// The cross-section of the closed mould through an LED, seen along y, at scale 1:1. Throws InvalidArgument.
inline Drawing section_drawing(const HalfSection& section, const CastingOptions& options = {});
/// The LED strip from above, y to the right: its outline and its LEDs. Throws InvalidArgument.
inline Drawing strip_drawing(const HalfSection& section, const CastingOptions& options = {});
/// The side of a core, for cutting it from sheet. Throws InvalidArgument for a design without voids.
inline Drawing core_drawing(const HalfSection& section, const CastingOptions& options = {});

namespace detail {

inline constexpr double caption_height = 1.8e-3;  ///< of capitals [m], about 7 pt

/// Words under a drawing, and a line of 10 mm by which a print can be measured.
inline void add_caption(Drawing& d, const std::string& words) {
  const int layer = int(d.layers.size());
  d.layers.push_back({"NOTES", 8, "#666666"});
  const auto box = d.box();
  const double x = box[0][0], y = box[0][1] - 5.0e-3;
  d.lines.push_back({layer, {{x, y + 1.0e-3}, {x, y}, {x + 10.0e-3, y}, {x + 10.0e-3, y + 1.0e-3}}, false});
  d.labels.push_back({layer, {x + 12.0e-3, y}, caption_height, "10 mm"});
  d.labels.push_back({layer, {x, y - 4.0e-3}, caption_height, words});
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

namespace detail {

/// Half of the silicone, from the middle of the stem's top to the apex.
inline std::vector<Drawing::Point> silicone_half(const HalfSection& s, const CastingLayout& at) {
  const auto outline = pad_outline(s);
  std::vector<Drawing::Point> half{{at.stem_x, at.stem_height}};
  if (at.void_width > 0.0) half.insert(half.end(), {{at.void_x, at.stem_height}, {at.void_x, 0.0}});
  else half.push_back({at.stem_x, 0.0});
  if (at.is_stair()) half.insert(half.end(), {{at.block_x, 0.0}, {at.block_x, at.seat}});
  half.insert(half.end(), outline.begin(), outline.end());
  return half;
}

/// The carrier through an LED: in one piece about a pocket, in two beside a slot.
inline void add_carrier(Drawing& d, int layer, const CastingLayout& at, const CastingOptions& o) {
  const double bottom = at.seat - at.plate, top = at.recess_floor;
  std::vector<Drawing::Point> half;
  if (at.has_recesses()) {
    const double window = 0.5 * o.leds.width_x + o.clearance, ceiling = at.slot_ceiling(o);
    half = {{at.pocket_x, bottom}, {at.pocket_x, ceiling}, {window, ceiling}, {window, top}};
  } else {
    half = {{at.pocket_x, at.pocket_floor}, {at.pocket_x, top}};
  }
  half.insert(half.end(), {{at.stem_x, top}, {at.stem_x, 0.0}});
  if (at.is_stair()) half.insert(half.end(), {{at.block_x, 0.0}, {at.block_x, at.seat}});
  half.insert(half.end(), {{at.plate_x, at.seat}, {at.plate_x, bottom}});
  if (!at.has_recesses()) {
    d.lines.push_back({layer, mirrored(std::move(half))});
    return;
  }
  d.lines.push_back({layer, half});
  for (auto& p : half) p[0] = -p[0];
  d.lines.push_back({layer, std::move(half)});
}

/// The strip through an LED; its circuit and the LED apart where windows let the LEDs through.
inline void add_strip(Drawing& d, int layer, const CastingLayout& at, const CastingOptions& o) {
  const double led = 0.5 * o.leds.width_x, half = 0.5 * o.strip_width, top = at.recess_floor;
  const double circuit_top = at.has_recesses() ? at.slot_ceiling(o) : top;
  d.lines.push_back(box_line(layer, -half, half, at.pocket_floor, circuit_top));
  if (at.has_recesses()) d.lines.push_back(box_line(layer, -led, led, circuit_top, top));
  else d.lines.push_back({layer, {{-led, top}, {led, top}}, false});
}

}  // namespace detail

inline Drawing section_drawing(const HalfSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  const bool voids = at.void_width > 0.0;
  const auto outline = pad_outline(s);
  Drawing d;
  d.layers = {
      {"SILICONE", 4, "#0072b2"}, {"CARRIER", 8, "#444444"}, {"LED_STRIP", 2, "#b07400"}, {"MOULD", 3, "#009e73"}};
  std::vector<std::string> legend{"silicone", "carrier", "LED strip", "mould"};
  const auto add_layer = [&](const Drawing::Layer& layer, const char* words) {
    d.layers.push_back(layer);
    legend.push_back(words);
  };
  if (voids) add_layer({"CORES", 1, "#d55e00"}, "cores");
  d.lines.push_back({0, detail::mirrored(detail::silicone_half(s, at))});
  detail::add_carrier(d, 1, at, o);
  detail::add_strip(d, 2, at, o);
  for (const double side : {1.0, -1.0}) {
    std::vector<Drawing::Point> half{{at.half_width, at.seat}, {at.rim_x, at.seat}, {at.rim_x, at.seat - at.rim},
        {at.mould_x, at.seat - at.rim}, {at.mould_x, at.mould_top}, {0.0, at.mould_top}};
    half.insert(half.end(), outline.rbegin(), outline.rend() - 1);
    for (auto& p : half) p[0] *= side;
    d.lines.push_back({3, std::move(half)});
    if (voids) d.lines.push_back(detail::box_line(4, side * at.stem_x, side * at.void_x, 0.0, at.stem_height));
  }
  if (at.has_recesses()) {
    const double half = 0.5 * o.strip_width;
    add_layer({"LED_BAR", 6, "#aa4499"}, "LED bar");
    d.lines.push_back(detail::box_line(int(d.layers.size()) - 1, -half, half, at.seat - at.plate, at.pocket_floor));
  }
  for (int layer = 0; layer < int(legend.size()); ++layer)
    d.labels.push_back({layer, {at.mould_x + 3.0e-3, at.mould_top - (2.0 + 4.0 * layer) * 1e-3}, detail::caption_height,
        legend[std::size_t(layer)]});
  detail::add_caption(d, "Section at scale 1:1");
  return d;
}

inline Drawing strip_drawing(const HalfSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  Drawing d;
  d.layers = {{"OUTLINE", 7, "#222222"}, {"LEDS", 2, "#b07400"}};
  d.lines.push_back(detail::box_line(0, -at.strip_y, at.strip_y, -0.5 * o.strip_width, 0.5 * o.strip_width));
  for (const double y : led_places(o.leds))
    d.lines.push_back(detail::box_line(
        1, y - 0.5 * o.leds.length_y, y + 0.5 * o.leds.length_y, -0.5 * o.leds.width_x, 0.5 * o.leds.width_x));
  detail::add_caption(d, message("LED strip at scale 1:1, ", 2e3 * at.strip_y, " x ", 1e3 * o.strip_width,
                             " mm, LEDs every ", 1e3 * o.leds.pitch, " mm"));
  return d;
}

inline Drawing core_drawing(const HalfSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  require_positive("void width", at.void_width * 1e3, "mm");
  Drawing d;
  d.layers = {{"OUTLINE", 7, "#222222"}};
  d.lines.push_back({0, core_outline(s, o)});
  detail::add_caption(d, message("Core at scale 1:1, ", 1e3 * at.void_width, " mm thick, two of them"));
  return d;
}

}  // namespace lumo
