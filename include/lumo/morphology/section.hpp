#pragma once

#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/design.hpp"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <vector>

namespace lumo {

/// Matched variants of a design. The twins without a carrier are for mechanics only (paper §IV-A).
enum class Twin {
  none,             ///< the finger itself
  no_void,          ///< the same θ with w_v = 0
  bonded_base,      ///< the stem's volume is silicone, voids stay, base bonded under the stem too
  unsupported_base  ///< the same, but bonded at the two end faces only: a soft finger that can bend
};

constexpr std::string_view to_string(Twin twin) {
  switch (twin) {
    case Twin::no_void: return "no_void";
    case Twin::bonded_base: return "bonded_base";
    case Twin::unsupported_base: return "unsupported_base";
    default: return "design";
  }
}

/// What a boundary edge of the section is.
enum class SectionTag { mirror, stem_top, stem_side, void_inner, void_roof, void_wall, base, side, dome };

/// Half cross-section x ≥ 0 as a closed polygon in (x, z), counter-clockwise, in metres; edge i runs from point i to
/// i + 1, the last point is the dome's apex.
struct HalfSection {
  FingerDesign design;
  PadDimensions pad;
  Twin twin = Twin::none;
  std::vector<double> x, z;
  std::vector<SectionTag> tag;

  double half_width_m() const { return 0.5e-3 * pad.width; }
  double height_m() const { return z.back(); }  ///< of the dome's apex over the base
  double length_m() const { return 1e-3 * pad.length; }
  /// Exact area of the half section [m²].
  double exact_area_m2() const;
};

/// How a curve is cut into chords.
struct Chords {
  double longest_m;
  double max_turn_rad;
  double shortest_m = 0.0;  ///< about; turning does not ask for shorter ones
};

/// The section of a feasible design, its curve cut into chords, its straight edges left whole. Throws InfeasibleDesign.
inline HalfSection half_section(
    const FingerDesign& design, Twin twin, const Chords& chords, const PadDimensions& pad = {});

namespace detail {

// Angles of points on the quarter ellipse from the side (0) to the apex (π/2): each chord is as long and turns as much
// as allowed, evened out.
inline std::vector<double> ellipse_angles(double a, double b, const Chords& chords) {
  constexpr int fine = 20000;
  std::vector<double> measure(fine + 1, 0.0);
  const auto tangent = [&](double t) { return std::atan2(b * std::cos(t), -a * std::sin(t)); };
  for (int i = 1; i <= fine; ++i) {
    const double t0 = 0.5 * pi * (i - 1) / fine, t1 = 0.5 * pi * i / fine;
    const double arc = std::hypot(a * (std::cos(t1) - std::cos(t0)), b * (std::sin(t1) - std::sin(t0)));
    measure[std::size_t(i)] =
        measure[std::size_t(i) - 1] + arc / chords.longest_m +
        std::min(std::abs(tangent(t1) - tangent(t0)) / chords.max_turn_rad, arc / std::max(chords.shortest_m, 1e-12));
  }
  const int count = std::max(2, int(std::ceil(measure.back() - 1e-9)));
  std::vector<double> angles;
  std::size_t at = 0;
  for (int k = 0; k <= count; ++k) {
    const double want = measure.back() * k / count;
    while (at + 1 < measure.size() && measure[at + 1] < want) ++at;
    if (k == 0) angles.push_back(0.0);
    else if (k == count) angles.push_back(0.5 * pi);
    else angles.push_back(0.5 * pi * (double(at) + (want - measure[at]) / (measure[at + 1] - measure[at])) / fine);
  }
  return angles;
}

}  // namespace detail

inline HalfSection half_section(const FingerDesign& given, Twin twin, const Chords& chords, const PadDimensions& pad) {
  finger_space(pad).check(given.values());
  FingerDesign d = given;
  if (twin == Twin::no_void) d.w_v = 0.0;
  HalfSection s{d, pad, twin, {}, {}, {}};
  const double w = 0.5e-3 * pad.width, fp = 1e-3 * d.h_fp, ep = 1e-3 * d.h_ep;
  const double stem = 0.5e-3 * d.w_s, hs = 1e-3 * d.h_s, outer = stem + 1e-3 * d.w_v;
  const bool soft_stem = twin == Twin::bonded_base || twin == Twin::unsupported_base, has_void = d.w_v > 0.0;
  const auto add = [&](double px, double pz, SectionTag tag) {
    s.x.push_back(px);
    s.z.push_back(pz);
    s.tag.push_back(tag);
  };
  if (soft_stem) {
    if (has_void) {
      add(0.0, 0.0, SectionTag::base);
      add(stem, 0.0, SectionTag::void_inner);
    }
  } else {
    add(0.0, hs, SectionTag::stem_top);
  }
  if (has_void) {
    add(stem, hs, SectionTag::void_roof);
    add(outer, hs, SectionTag::void_wall);
    add(outer, 0.0, SectionTag::base);
  } else if (soft_stem) {
    add(0.0, 0.0, SectionTag::base);
  } else {
    add(stem, hs, SectionTag::stem_side);
    add(stem, 0.0, SectionTag::base);
  }
  add(w, 0.0, SectionTag::side);
  const std::vector<double> angles = detail::ellipse_angles(w, ep, chords);
  for (std::size_t k = 0; k + 1 < angles.size(); ++k)
    add(k == 0 ? w : w * std::cos(angles[k]), fp + ep * std::sin(angles[k]), SectionTag::dome);
  add(0.0, fp + ep, SectionTag::mirror);
  return s;
}

inline double HalfSection::exact_area_m2() const {
  const bool soft_stem = twin == Twin::bonded_base || twin == Twin::unsupported_base;
  const double w = 0.5e-3 * pad.width, cut = (soft_stem ? 0.0 : 0.5e-3 * design.w_s) + 1e-3 * design.w_v;
  return w * 1e-3 * design.h_fp + 0.25 * pi * w * 1e-3 * design.h_ep - cut * 1e-3 * design.h_s;
}

}  // namespace lumo
