#pragma once

#include "lumo/core/error.hpp"
#include "lumo/morphology/cast_section.hpp"

#include <algorithm>
#include <cmath>

namespace lumo {

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

  /// Of the smallest wall that is printed: two lines of a 0.4 mm nozzle.
  static constexpr double thinnest_wall = 0.8e-3;
};

/// Limits of the options in mm, as they are checked and as they are told.
namespace casting_limits {
inline constexpr Limits clearance_mm{0.05, 0.4}, plate_mm{3.0, 20.0}, wall_mm{7.0, 30.0}, strip_width_mm{0.8, 10.0},
    strip_height_mm{0.2, 1.5};
inline constexpr Limits gate_mm{2.0, 4.0}, vent_mm{0.8, 2.0};
}  // namespace casting_limits

/// Throws InvalidArgument for an option that is out of range, or does not fit the section.
inline void validate(const CastingOptions& options, const CastSection& section);

/// The lengths that all parts share, so that they fit each other in every bit; in m, the pad's frame.
struct CastingLayout {
  double half_width, top, half_length;          ///< of the pad; half_length is that of the cavity, too
  double plate_x, plate_y;                      ///< half the plate
  double rim_x, rim_y;                          ///< where the mould's rim begins: the plate with its clearance
  double mould_x, mould_y, mould_top;           ///< half the mould, and its height above the plate
  double notch_inner, notch_outer, notch_roof;  ///< of the openings for the cores, from the middle out
  double pocket_x, pocket_y, pocket_floor;      ///< half the pocket for the LED strip, and its floor's height
  double strip_y;                               ///< half the LED strip

  CastingLayout(const CastSection& s, const CastingOptions& o) {
    const double c = o.clearance;
    half_width = s.half_width(), top = s.height(), half_length = 0.5 * s.length;
    plate_x = half_width + o.flange, plate_y = half_length + o.tab;
    rim_x = plate_x + c, rim_y = plate_y + c;
    mould_x = half_width + o.wall, mould_y = rim_y + (mould_x - rim_x), mould_top = top + o.wall;
    notch_inner = 0.5 * s.ridge_width - c, notch_outer = 0.5 * s.ridge_width + s.gap_width + c,
    notch_roof = s.ridge_height + c;
    strip_y = 0.5 * ((s.leds.count - 1) * s.leds.pitch + strip_margin);
    pocket_x = 0.5 * o.strip_width + c, pocket_y = strip_y + c, pocket_floor = s.ridge_height - o.strip_height;
  }

  static constexpr double strip_margin = 8.0e-3;  ///< of the strip beyond the outer LEDs' centres, both together
  static constexpr double duct_length = 3.0e-3;   ///< of the opening for the wires, along y
};

inline void validate(const CastingOptions& o, const CastSection& s) {
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
  require_in_range("pad width", 2e3 * s.half_width(), 20.0, 200.0, "mm");
  require_in_range("ridge height", s.ridge_height * 1e3, o.strip_height * 1e3 + 0.5, 1e3 * s.height() - 4.9, "mm");
  const CastingLayout at(s, o);
  const double widest = 1e3 * (s.ridge_width - 2.0 * o.clearance - 1.2e-3);
  if (o.strip_width * 1e3 > widest + 1e-9)
    throw InvalidArgument(message("LED strip width is ", exact(o.strip_width * 1e3), " mm, must be at most ", widest,
                                  " mm: 0.6 mm of wall on each side of it in a ridge of ", s.ridge_width * 1e3, " mm"));
  if (at.pocket_y > at.half_length - 1.0e-3)
    throw InvalidArgument(message("LED strip is ", 2e3 * at.strip_y, " mm long, must be at most ",
                                  2e3 * (at.half_length - o.clearance - 1.0e-3), " mm"));
  if (at.notch_outer > at.half_width - 4.55e-3)
    throw InvalidArgument(message("the pad is ", 1e3 * (at.half_width - at.notch_outer + o.clearance),
                                  " mm thick beside its gaps, must be at least ", 4.55 + 1e3 * o.clearance, " mm"));
}

}  // namespace lumo
