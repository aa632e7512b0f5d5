#pragma once

#include "lumo/core/error.hpp"
#include "lumo/morphology/finger_options.hpp"
#include "lumo/morphology/section.hpp"

namespace lumo {

inline constexpr Chords casting_chords{.longest_m = 0.5e-3, .max_turn_rad = 0.05, .shortest_m = 0.05e-3};

/// The section of a feasible design for making things, where it has a cavity: its chords leave the curve by less than 5
/// µm, a tenth of what printers resolve. Throws InfeasibleDesign.
inline HalfSection casting_section(const FingerDesign& design, const PadDimensions& pad = {}) {
  return half_section(design, Twin::none, casting_chords, pad);
}

/// The same of the cap of a pad that has one. Throws InvalidArgument for one without.
inline HalfSection casting_cap_section(const HalfSection& section) {
  return cap_section(section.design, section.twin, casting_chords, section.pad);
}

/// What may be chosen about the parts that a pad is cast with; lengths in m. Every default is our own choice, within
/// what the sources in docs/fabrication.md advise.
struct CastingOptions {
  double clearance = 0.2e-3;      ///< on each side between printed parts that are put together: FDM 0.2 mm, SLA 0.1 mm
  double plate = 4.0e-3;          ///< thickness of a flat carrier's plate; that of a stair is the pad's own
  double flange = 3.0e-3;         ///< of the plate beyond the pad's long sides: the mould seals on it
  double tab = 7.0e-3;            ///< of the plate beyond the pad's ends, with the mounting holes
  double hole_diameter = 3.4e-3;  ///< of the mounting holes: M3, ISO 273 medium
  double strip_width = 2.0e-3;    ///< of the LED strip
  double strip_height = 0.9e-3;   ///< of the LED strip with its LEDs: 0.3 mm flexible circuit and 0.6 mm LED
  double wall = 8.0e-3;           ///< of the mould about the pad
  double rim = 3.0e-3;            ///< how far the mould reaches down the plate's edge, which it is centred by; less on
                                  ///< a stair
  double gate_diameter = 4.0e-3;  ///< at the pad; a Luer tip fits
  double vent_diameter = 2.0e-3;  ///< at the pad: the smallest hole that FDM prints well
  double circuit = 0.3e-3;  ///< of strip_height, without LEDs: it lies below the stem's recesses, if there are any
  FingerOptions::Leds leds = {};      ///< on the strip, centred on the stem, facing up
  FingerOptions::Recess recess = {};  ///< of a stem on which the silicone lies free

  /// Of the smallest wall that is printed: two lines of a 0.4 mm nozzle.
  static constexpr double thinnest_wall = 0.8e-3;

  /// The same for a finger with these LEDs and recesses.
  CastingOptions made_for(const FingerOptions& finger) const {
    CastingOptions o = *this;
    o.leds = finger.leds;
    o.recess = finger.recess;
    return o;
  }
  bool operator==(const CastingOptions&) const = default;
};

/// Limits of the options in mm, for checks and for help texts.
namespace casting_limits {
inline constexpr Limits clearance_mm{0.05, 0.4}, plate_mm{3.0, 20.0}, wall_mm{7.0, 30.0}, strip_width_mm{0.8, 10.0},
    strip_height_mm{0.2, 1.5};
inline constexpr Limits stair_plate_mm{1.5, 20.0}, shoulder_height_mm{2.0, 30.0};
inline constexpr Limits gate_mm{2.0, 4.0}, vent_mm{0.8, 2.0};
/// Least silicone above the stem and beside the voids with their fits [mm]: the design's 5 mm less what clearances and
/// rounding take.
inline constexpr double above_stem_mm = 4.9, beside_void_mm = 4.55;
/// Least wall of the stem on each side of the LED strip's pocket, and of its end beyond the strip [m].
inline constexpr double beside_strip = 0.6e-3, beyond_strip = 1.0e-3;
/// Least thickness of a recess's floor over the LED strip, which LEDs reach through: two layers [mm].
inline constexpr double over_circuit_mm = 0.4;
}  // namespace casting_limits

}  // namespace lumo
