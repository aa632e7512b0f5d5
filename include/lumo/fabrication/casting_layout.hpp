#pragma once

#include "lumo/core/error.hpp"
#include "lumo/fabrication/casting_options.hpp"
#include "lumo/morphology/finger_carrier.hpp"

#include <algorithm>
#include <array>
#include <vector>

namespace lumo {

/// Throws InvalidArgument for an option that is out of range, or does not fit the section.
inline void validate(const CastingOptions& options, const HalfSection& section);

/// The lengths that all parts share, so that they fit each other in every bit; in m, the pad's frame.
struct CastingLayout {
  double half_width, top, half_length;  ///< of the pad; half_length is that of the cavity, too
  double middle_y;                      ///< of pad, plate and mould
  double pour;                          ///< 1: poured with the end at positive y up, −1: with the other one
  double seat, plate, rim;              ///< z of the plate's top; its thickness; the mould's reach below its top
  double block_x;                       ///< half the block on the plate; 0: the plate is flat
  double stem_x, stem_height;           ///< half the stem's width, and its height, which is the voids', too
  double stem_low, stem_high;           ///< y of the ends of stem and block
  double void_x, void_width;            ///< a void's outer wall, and its width; 0: there are none
  double plate_x, plate_y;              ///< half the plate
  double rim_x, rim_y;                  ///< where the mould's rim begins: the plate with its clearance
  double mould_x, mould_y, mould_top;   ///< half the mould, and its height above the base
  double notch_inner, notch_outer, notch_roof;  ///< of the openings for the cores, from the middle out
  double recess_floor;                          ///< height of the recesses' floors, or of the stem
  double pocket_x, pocket_y, pocket_floor;  ///< half the LED strip's pocket, and the height of the strip's underside
  double strip_y;                           ///< half the LED strip

  CastingLayout(const HalfSection& s, const CastingOptions& o) {
    const double c = o.clearance;
    half_width = s.half_width_m();
    top = s.height_m();
    half_length = 0.5 * s.length_m();
    middle_y = 0.5e-3 * s.pad.cap_length;
    pour = has_cap(s) ? -1.0 : 1.0;
    const bool stair = s.pad.shoulder_height > 0.0;
    seat = stair ? -1e-3 * s.pad.shoulder_height : 0.0;
    plate = stair ? 1e-3 * (s.pad.carrier_height - s.pad.shoulder_height) : o.plate;
    rim = stair ? std::min(o.rim, stair_rim * plate) : o.rim;
    block_x = stair ? 1e-3 * s.pad.lip_end() : 0.0;
    stem_x = 0.5e-3 * s.design.w_s;
    stem_height = 1e-3 * s.design.h_s;
    stem_low = middle_y - half_length + 0.5 * c;
    stem_high = has_cap(s) ? 0.5e-3 * s.pad.length : -stem_low;
    void_width = 1e-3 * s.design.w_v;
    void_x = stem_x + void_width;
    plate_x = half_width + o.flange;
    plate_y = half_length + o.tab;
    rim_x = plate_x + c;
    rim_y = plate_y + c;
    mould_x = half_width + o.wall;
    mould_y = rim_y + (mould_x - rim_x);
    mould_top = top + o.wall;
    notch_inner = stem_x - c;
    notch_outer = void_x + c;
    notch_roof = stem_height + c;
    recess_floor = stem_height - (s.lies_on_stem() ? o.recess.depth : 0.0);
    strip_y = 0.5 * ((o.leds.count - 1) * o.leds.pitch + strip_margin);
    pocket_x = 0.5 * o.strip_width + c;
    pocket_y = strip_y + c;
    pocket_floor = recess_floor - o.strip_height;
  }

  bool is_stair() const { return block_x > 0.0; }
  bool has_recesses() const { return recess_floor < stem_height; }
  /// Of the slot that a strip below recesses lies in: where its circuit ends, and the recesses' floors are left.
  double slot_ceiling(const CastingOptions& o) const { return pocket_floor + o.circuit; }
  static bool has_cap(const HalfSection& s) { return s.pad.cap_length > 0.0; }

  static constexpr double strip_margin = 8.0e-3;  ///< of the strip beyond the outer LEDs' centres, both together
  static constexpr double duct_length = 3.0e-3;   ///< of the opening for the wires, along y
  static constexpr double hole_inset = 5.0e-3;    ///< of the mounting holes' centres from the pad's sides
  static constexpr double vent_inset = 2.5e-3;    ///< of the vents' centres from the pad's sides and the plate
  static constexpr double stair_rim = 0.75;       ///< of the plate's thickness: as the defaults on a flat carrier
};

/// Half outline (x, z) of the pad, from the plate at x > 0 up and over to the apex [m].
inline std::vector<std::array<double, 2>> pad_outline(const HalfSection& s) {
  std::vector<std::array<double, 2>> outline;
  for (std::size_t i = 0; i < s.x.size(); ++i)
    if (s.tag[i] == SectionTag::side || s.tag[i] == SectionTag::dome || s.tag[i] == SectionTag::mirror)
      outline.push_back({s.x[i], s.z[i] + 0.0});  // −0 is 0
  return outline;
}

namespace detail {

inline FingerOptions known_of_finger(const HalfSection& s, const CastingOptions& o) {
  return {.twin = s.twin, .pad = s.pad, .leds = o.leds, .recess = o.recess};
}

inline void require_lengths(const CastingOptions& o, const PadDimensions& pad) {
  namespace limits = casting_limits;
  require_in_range("clearance of printed parts", o.clearance * 1e3, limits::clearance_mm, "mm");
  require_in_range("plate thickness", o.plate * 1e3, limits::plate_mm, "mm");
  require_in_range("mould wall", o.wall * 1e3, limits::wall_mm, "mm");
  require_in_range("LED strip width", o.strip_width * 1e3, limits::strip_width_mm, "mm");
  require_in_range("LED strip height", o.strip_height * 1e3, limits::strip_height_mm, "mm");
  require_in_range("gate diameter", o.gate_diameter * 1e3, limits::gate_mm, "mm");
  require_in_range("vent diameter", o.vent_diameter * 1e3, limits::vent_mm, "mm");
  require_in_range("mounting hole diameter", o.hole_diameter * 1e3, 1.0, 5.0, "mm");
  require_in_range("plate beyond the pad's ends", o.tab * 1e3, o.hole_diameter * 1e3 + 3.0, 30.0, "mm");
  require_in_range("plate beyond the pad's sides", o.flange * 1e3, 1.0, (o.wall - o.clearance) * 1e3 - 2.0, "mm");
  require_in_range("mould rim", o.rim * 1e3, 1.0, o.plate * 1e3, "mm");
  if (pad.shoulder_height <= 0.0) return;
  // Below a core's opening the mould needs a wall, and a vent opens between block and side.
  require_in_range("height of the shoulders", pad.shoulder_height, limits::shoulder_height_mm, "mm");
  require_in_range("width of the shoulders", pad.shoulder_width,
      1e3 * (CastingLayout::vent_inset + 0.5 * o.vent_diameter), 100.0, "mm");
  require_in_range(
      "thickness of the carrier's plate", pad.carrier_height - pad.shoulder_height, limits::stair_plate_mm, "mm");
}

inline void require_room_for_strip(const CastingOptions& o, const HalfSection& s, const CastingLayout& at) {
  namespace limits = casting_limits;
  const double widest = 1e3 * (2.0 * at.stem_x - 2.0 * o.clearance - 2.0 * limits::beside_strip);
  if (o.strip_width * 1e3 > widest + 1e-9)
    throw InvalidArgument(message("LED strip width is ", exact(o.strip_width * 1e3), " mm, must be at most ", widest,
        " mm: 0.6 mm of wall on each side of it in a stem of ", 2.0 * at.stem_x * 1e3, " mm"));
  const double half_stem = 0.5e-3 * s.pad.length;
  if (at.pocket_y > half_stem - limits::beyond_strip)
    throw InvalidArgument(message("LED strip is ", 2e3 * at.strip_y, " mm long, must be at most ",
        2e3 * (half_stem - o.clearance - limits::beyond_strip), " mm"));
  if (!at.has_recesses()) return;
  const double thickest = o.strip_height * 1e3 - limits::over_circuit_mm;
  require_in_range("circuit of the LED strip", o.circuit * 1e3, 0.05, thickest + 1e-9, "mm");
  require_in_range("LED width", o.leds.width_x * 1e3, 0.1, o.strip_width * 1e3, "mm");
  require_in_range("length of the LEDs' recesses", o.recess.length_y * 1e3,
      1e3 * (o.leds.length_y + 2.0 * o.clearance + CastingOptions::thinnest_wall),
      2e3 * (half_stem - led_places(o.leds).back() - limits::beyond_strip), "mm");
}

}  // namespace detail

inline void validate(const CastingOptions& o, const HalfSection& s) {
  namespace limits = casting_limits;
  if (!has_stem(s.twin)) throw InvalidArgument("a twin whose stem is of silicone cannot be cast on a carrier");
  validate(detail::known_of_finger(s, o));
  if (o.leds.place != FingerOptions::Leds::Place::top)
    throw InvalidArgument("LEDs are on the stem's sides, must be on its top: one strip holds all of them");
  require_in_range("number of LEDs on the strip", o.leds.count, 1, 1000, "");
  detail::require_lengths(o, s.pad);
  const CastingLayout at(s, o);
  require_in_range("pad width", 2e3 * at.half_width, 20.0, 200.0, "mm");
  const double lowest = at.has_recesses() ? 1e3 * o.recess.depth + limits::over_circuit_mm : o.strip_height * 1e3 + 0.5;
  require_in_range("stem height", at.stem_height * 1e3, lowest, 1e3 * at.top - limits::above_stem_mm, "mm");
  detail::require_room_for_strip(o, s, at);
  if (at.notch_outer > at.half_width - 1e-3 * limits::beside_void_mm)
    throw InvalidArgument(message("the pad is ", 1e3 * (at.half_width - at.notch_outer + o.clearance),
        " mm thick beside its voids, must be at least ", limits::beside_void_mm + 1e3 * o.clearance, " mm"));
  if (at.is_stair() && at.void_x >= at.block_x)
    throw InvalidArgument(message("stem and voids are ", 2e3 * at.void_x,
        " mm wide, must be narrower than the block of ", 2e3 * at.block_x, " mm below them"));
}

}  // namespace lumo
