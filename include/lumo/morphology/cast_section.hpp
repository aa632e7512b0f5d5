#pragma once

#include "lumo/morphology/finger.hpp"

#include <array>
#include <vector>

namespace lumo {

/// What a pad that is cast on its carrier looks like, in general words: a dome over a ridge, an open gap along each
/// side of the ridge, the same all along y. Lengths in m, the body's frame: x across, y along, centred, z from the
/// carrier's plate outwards.
struct CastSection {
  std::vector<std::array<double, 2>>
      outline;               ///< half outline (x, z) of the pad: from the plate at x > 0 up and over to (0, height)
  double length = 0.0;       ///< of the pad along y
  double ridge_width = 0.0;  ///< of the rigid ridge in the middle
  double ridge_height = 0.0;
  double gap_width = 0.0;         ///< of the air gap on each side of the ridge, as high as the ridge; 0: none
  double exact_volume_m3 = 0.0;   ///< of the pad with its curve uncut [m³]
  FingerOptions::Leds leds = {};  ///< centred on the ridge, facing up

  double half_width() const { return outline.front()[0]; }
  double height() const { return outline.back()[1]; }
  /// Area inside the cut outline, ridge and gaps taken off [m²].
  double area_m2() const;
};

/// Chords for making things: they leave the curve by less than 5 µm, a tenth of what printers resolve.
inline Chords fabrication_chords() { return {0.5e-3, 0.05, 0.05e-3}; }

/// The section of a feasible design for casting: its stem is the ridge, its voids are the gaps. Throws
/// InfeasibleDesign.
inline CastSection cast_section(const FingerDesign& design, const FingerOptions& options = {},
                                const Chords& chords = fabrication_chords());

inline double CastSection::area_m2() const {
  double half = 0.0;
  for (std::size_t i = 0; i + 1 < outline.size(); ++i)
    half += 0.5 * (outline[i][0] * outline[i + 1][1] - outline[i + 1][0] * outline[i][1]);
  return 2.0 * half - (ridge_width + 2.0 * gap_width) * ridge_height;
}

inline CastSection cast_section(const FingerDesign& design, const FingerOptions& options, const Chords& chords) {
  validate(options);
  const HalfSection half = half_section(design, Twin::none, chords, options.pad);
  CastSection s;
  s.outline.push_back({0.5e-3 * options.pad.width, 0.0});
  for (std::size_t i = 0; i < half.x.size(); ++i)
    if (half.tag[i] == SectionTag::dome || half.tag[i] == SectionTag::mirror)
      s.outline.push_back({half.x[i], half.z[i]});
  s.length = 1e-3 * options.pad.length;
  s.ridge_width = 1e-3 * design.w_s, s.ridge_height = 1e-3 * design.h_s, s.gap_width = 1e-3 * design.w_v;
  s.exact_volume_m3 = 2.0 * half.exact_area_m2() * s.length;
  s.leds = options.leds;
  return s;
}

}  // namespace lumo
