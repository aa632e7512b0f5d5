#pragma once

#include "lumo/core/error.hpp"
#include "lumo/morphology/finger.hpp"

#include <array>
#include <vector>

namespace lumo {

/// The section of a feasible design for making things: its chords leave the curve by less than 5 µm, a tenth of what
/// printers resolve. Throws InfeasibleDesign.
inline HalfSection casting_section(const FingerDesign& design, const PadDimensions& pad = {}) {
  return half_section(design, Twin::none, {0.5e-3, 0.05, 0.05e-3}, pad);
}

/// What may be chosen about the parts that a pad is cast with; lengths in m. Every default is our own choice, within
/// what the sources in docs/fabrication.md advise.
struct CastingOptions {
  double clearance = 0.2e-3;      ///< on each side between printed parts that are put together: FDM 0.2 mm, SLA 0.1 mm
  double plate = 4.0e-3;          ///< thickness of the carrier's plate
  double flange = 3.0e-3;         ///< of the plate beyond the pad's long sides: the mould seals on it
  double tab = 7.0e-3;            ///< of the plate beyond the pad's ends, with the mounting holes
  double hole_diameter = 3.4e-3;  ///< of the mounting holes: M3, ISO 273 medium
  double strip_width = 2.0e-3;    ///< of the LED strip
  double strip_height = 0.9e-3;   ///< of the LED strip with its LEDs: 0.3 mm flexible circuit and 0.6 mm LED
  double wall = 8.0e-3;           ///< of the mould about the pad
  double rim = 3.0e-3;            ///< how far the mould reaches down the plate's edge, which it is centred by
  double gate_diameter = 4.0e-3;  ///< at the pad; a Luer tip fits
  double vent_diameter = 2.0e-3;  ///< at the pad: the smallest hole that FDM prints well
  FingerOptions::Leds leds = {};  ///< on the strip, centred on the stem, facing up

  /// Of the smallest wall that is printed: two lines of a 0.4 mm nozzle.
  static constexpr double thinnest_wall = 0.8e-3;
};

/// Limits of the options in mm, for checks and for help texts.
namespace casting_limits {
inline constexpr Limits clearance_mm{0.05, 0.4}, plate_mm{3.0, 20.0}, wall_mm{7.0, 30.0}, strip_width_mm{0.8, 10.0},
    strip_height_mm{0.2, 1.5};
inline constexpr Limits gate_mm{2.0, 4.0}, vent_mm{0.8, 2.0};
/// Least silicone above the stem and beside the voids with their fits [mm]: the design's 5 mm less what clearances and
/// rounding take.
inline constexpr double above_stem_mm = 4.9, beside_void_mm = 4.55;
/// Least wall of the stem on each side of the LED strip's pocket, and of its end beyond the strip [m].
inline constexpr double beside_strip = 0.6e-3, beyond_strip = 1.0e-3;
}  // namespace casting_limits

/// Throws InvalidArgument for an option that is out of range, or does not fit the section.
inline void validate(const CastingOptions& options, const HalfSection& section);

/// The lengths that all parts share, so that they fit each other in every bit; in m, the pad's frame.
struct CastingLayout {
  double half_width, top, half_length;          ///< of the pad; half_length is that of the cavity, too
  double stem_x, stem_height;                   ///< half the stem's width, and its height, which is the voids', too
  double void_x, void_width;                    ///< a void's outer wall, and its width; 0: there are none
  double plate_x, plate_y;                      ///< half the plate
  double rim_x, rim_y;                          ///< where the mould's rim begins: the plate with its clearance
  double mould_x, mould_y, mould_top;           ///< half the mould, and its height above the plate
  double notch_inner, notch_outer, notch_roof;  ///< of the openings for the cores, from the middle out
  double pocket_x, pocket_y, pocket_floor;      ///< half the pocket for the LED strip, and its floor's height
  double strip_y;                               ///< half the LED strip

  CastingLayout(const HalfSection& s, const CastingOptions& o) {
    const double c = o.clearance;
    half_width = s.half_width_m();
    top = s.height_m();
    half_length = 0.5 * s.length_m();
    stem_x = 0.5e-3 * s.design.w_s;
    stem_height = 1e-3 * s.design.h_s;
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
    strip_y = 0.5 * ((o.leds.count - 1) * o.leds.pitch + strip_margin);
    pocket_x = 0.5 * o.strip_width + c;
    pocket_y = strip_y + c;
    pocket_floor = stem_height - o.strip_height;
  }

  static constexpr double strip_margin = 8.0e-3;  ///< of the strip beyond the outer LEDs' centres, both together
  static constexpr double duct_length = 3.0e-3;   ///< of the opening for the wires, along y
  static constexpr double hole_inset = 5.0e-3;    ///< of the mounting holes' centres from the pad's sides
};

/// Half outline (x, z) of the pad, from the plate at x > 0 up and over to the apex [m].
inline std::vector<std::array<double, 2>> pad_outline(const HalfSection& s) {
  std::vector<std::array<double, 2>> outline{{s.half_width_m(), 0.0}};
  for (std::size_t i = 0; i < s.x.size(); ++i)
    if (s.tag[i] == SectionTag::dome || s.tag[i] == SectionTag::mirror) outline.push_back({s.x[i], s.z[i]});
  return outline;
}

inline void validate(const CastingOptions& o, const HalfSection& s) {
  namespace limits = casting_limits;
  if (s.twin == Twin::bonded_base || s.twin == Twin::unsupported_base)
    throw InvalidArgument("a twin whose stem is of silicone cannot be cast on a carrier");
  validate(FingerOptions{.pad = s.pad, .leds = o.leds});
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
  const CastingLayout at(s, o);
  require_in_range("pad width", 2e3 * at.half_width, 20.0, 200.0, "mm");
  require_in_range(
      "stem height", at.stem_height * 1e3, o.strip_height * 1e3 + 0.5, 1e3 * at.top - limits::above_stem_mm, "mm");
  const double widest = 1e3 * (2.0 * at.stem_x - 2.0 * o.clearance - 2.0 * limits::beside_strip);
  if (o.strip_width * 1e3 > widest + 1e-9)
    throw InvalidArgument(message("LED strip width is ", exact(o.strip_width * 1e3), " mm, must be at most ", widest,
        " mm: 0.6 mm of wall on each side of it in a stem of ", 2.0 * at.stem_x * 1e3, " mm"));
  if (at.pocket_y > at.half_length - limits::beyond_strip)
    throw InvalidArgument(message("LED strip is ", 2e3 * at.strip_y, " mm long, must be at most ",
        2e3 * (at.half_length - o.clearance - limits::beyond_strip), " mm"));
  if (at.notch_outer > at.half_width - 1e-3 * limits::beside_void_mm)
    throw InvalidArgument(message("the pad is ", 1e3 * (at.half_width - at.notch_outer + o.clearance),
        " mm thick beside its voids, must be at least ", limits::beside_void_mm + 1e3 * o.clearance, " mm"));
}

}  // namespace lumo
