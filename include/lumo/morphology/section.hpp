#pragma once

#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/design.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>
#include <vector>

namespace lumo {

/// Matched variants of a design. The twins without a carrier are for mechanics only (paper §IV-A).
enum class Twin {
  none,              ///< the finger itself
  no_void,           ///< the same θ with w_v = 0
  bonded_base,       ///< the stem's volume is silicone, voids stay, base bonded under the stem too
  unsupported_base,  ///< the same, but bonded at the two end faces only: a soft finger that can bend
  held_top           ///< silicone alone in the outline of pad and carrier, held on all of the carrier's back
};

constexpr std::string_view to_string(Twin twin) {
  switch (twin) {
    case Twin::no_void: return "no_void";
    case Twin::bonded_base: return "bonded_base";
    case Twin::unsupported_base: return "unsupported_base";
    case Twin::held_top: return "held_top";
    default: return "design";
  }
}

/// Is there a rigid stem under the silicone?
constexpr bool has_stem(Twin twin) { return twin == Twin::none || twin == Twin::no_void; }

/// What a boundary edge of the section is.
enum class SectionTag {
  mirror,
  stem_top,
  stem_side,
  void_inner,
  void_roof,
  void_wall,
  base,
  shoulder_wall,
  shoulder_top,
  side,
  dome
};

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
  bool lies_on_stem() const { return has_stem(twin) && pad.stem == Stem::free; }
  double length_m() const { return 1e-3 * (pad.length + pad.cap_length); }
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

/// The same of the solid distal cap. Throws likewise, and InvalidArgument for a pad without one.
inline HalfSection cap_section(
    const FingerDesign& design, Twin twin, const Chords& chords, const PadDimensions& pad = {});

/// Half x ≥ 0 of the carrier under the cavity, counter-clockwise from the middle of its back, (x, z) in m.
inline std::vector<std::array<double, 2>> carrier_outline(const FingerDesign& design, const PadDimensions& pad = {});

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

// The polygon of a section, point by point.
struct SectionPen {
  HalfSection& section;
  void add(double x, double z, SectionTag tag) const {
    section.x.push_back(x);
    section.z.push_back(z);
    section.tag.push_back(tag);
  }
  // From the lower end of the side to the apex.
  void add_outside(double low, const Chords& chords) const {
    const double w = section.half_width_m(), fp = 1e-3 * section.design.h_fp, ep = 1e-3 * section.design.h_ep;
    add(w, low, SectionTag::side);
    const std::vector<double> angles = ellipse_angles(w, ep, chords);
    for (std::size_t k = 0; k + 1 < angles.size(); ++k)
      add(k == 0 ? w : w * std::cos(angles[k]), fp + ep * std::sin(angles[k]), SectionTag::dome);
    add(0.0, fp + ep, SectionTag::mirror);
  }
};

inline bool has_soft_stem(Twin twin) { return twin == Twin::bonded_base || twin == Twin::unsupported_base; }

// Edges from the middle of the cavity to the base beside it.
inline void add_cavity(const SectionPen& pen, const HalfSection& s) {
  const FingerDesign& d = s.design;
  const double stem = 0.5e-3 * d.w_s, hs = 1e-3 * d.h_s, outer = stem + 1e-3 * d.w_v;
  const bool has_void = d.w_v > 0.0;
  if (has_soft_stem(s.twin)) {
    pen.add(0.0, 0.0, SectionTag::base);
    if (!has_void) return;
    pen.add(stem, 0.0, SectionTag::void_inner);
  } else if (!s.lies_on_stem()) {
    pen.add(0.0, hs, SectionTag::stem_top);
    if (!has_void) {
      pen.add(stem, hs, SectionTag::stem_side);
      pen.add(stem, 0.0, SectionTag::base);
      return;
    }
  }
  pen.add(s.lies_on_stem() ? 0.0 : stem, hs, SectionTag::void_roof);
  pen.add(outer, hs, SectionTag::void_wall);
  pen.add(outer, 0.0, SectionTag::base);
}

inline HalfSection empty_section(const FingerDesign& given, Twin twin, const PadDimensions& pad) {
  require_feasible(given, pad);
  HalfSection s{given, pad, twin, {}, {}, {}};
  if (twin == Twin::no_void) s.design.w_v = 0.0;
  return s;
}

}  // namespace detail

inline HalfSection half_section(const FingerDesign& given, Twin twin, const Chords& chords, const PadDimensions& pad) {
  HalfSection s = detail::empty_section(given, twin, pad);
  const detail::SectionPen pen{s};
  if (twin == Twin::held_top) {
    const double low = -1e-3 * pad.carrier_height;
    pen.add(0.0, low, SectionTag::base);
    pen.add_outside(low, chords);
    return s;
  }
  detail::add_cavity(pen, s);
  const double low = -1e-3 * pad.shoulder_height;
  if (low < 0.0) {
    pen.add(1e-3 * pad.lip_end(), 0.0, SectionTag::shoulder_wall);
    pen.add(1e-3 * pad.lip_end(), low, SectionTag::shoulder_top);
  }
  pen.add_outside(low, chords);
  return s;
}

inline HalfSection cap_section(const FingerDesign& given, Twin twin, const Chords& chords, const PadDimensions& pad) {
  require_positive("length of the cap", pad.cap_length, "mm");
  HalfSection s = detail::empty_section(given, twin, pad);
  const detail::SectionPen pen{s};
  const double low = twin == Twin::held_top ? -1e-3 * pad.carrier_height : -1e-3 * pad.shoulder_height;
  pen.add(0.0, low, twin == Twin::held_top ? SectionTag::base : SectionTag::shoulder_top);
  pen.add_outside(low, chords);
  return s;
}

inline std::vector<std::array<double, 2>> carrier_outline(const FingerDesign& d, const PadDimensions& pad) {
  const double w = 0.5e-3 * pad.width, lip = 1e-3 * pad.lip_end(), shoulder = -1e-3 * pad.shoulder_height,
               back = -1e-3 * pad.carrier_height, stem = 0.5e-3 * d.w_s, top = 1e-3 * d.h_s;
  std::vector<std::array<double, 2>> outline = {{0.0, back}, {w, back}};
  if (shoulder < 0.0) outline.insert(outline.end(), {{w, shoulder}, {lip, shoulder}});
  outline.insert(outline.end(), {{lip, 0.0}, {stem, 0.0}, {stem, top}, {0.0, top}});
  return outline;
}

inline double HalfSection::exact_area_m2() const {
  const double w = 0.5e-3 * pad.width;
  const double outside = w * 1e-3 * design.h_fp + 0.25 * pi * w * 1e-3 * design.h_ep;
  if (x.front() == 0.0 && z.front() < 0.0) return outside - w * z.front();  // solid: a cap, or a held twin
  const double cut = (detail::has_soft_stem(twin) ? 0.0 : 0.5e-3 * design.w_s) + 1e-3 * design.w_v;
  return outside + 1e-6 * pad.shoulder_width * pad.shoulder_height - cut * 1e-3 * design.h_s;
}

}  // namespace lumo
