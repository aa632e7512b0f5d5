#pragma once

#include "lumo/core/design_space.hpp"
#include "lumo/core/golden_section.hpp"
#include "lumo/core/units.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <vector>

namespace lumo {

/// The paper's design vector θ = [h_fp, h_ep, w_s, h_s, w_v] in mm (paper §III-A).
struct FingerDesign {
  double h_fp = 6.0;  ///< height of the flat sides
  double h_ep = 6.0;  ///< height of the half ellipse above them
  double w_s = 8.0;   ///< width of the rigid stem
  double h_s = 5.0;   ///< height of the stem
  double w_v = 0.0;   ///< width of the lateral void on each side of the stem

  static constexpr double lattice_mm = 0.5;  ///< all five are multiples of it

  /// Values that are multiples of the lattice but for rounding become them, so that 0.1 + 0.4 is 0.5 in every bit;
  /// others are taken as they are.
  static FingerDesign from(std::span<const double> x);
  std::array<double, 5> values() const { return {h_fp, h_ep, w_s, h_s, w_v}; }
  bool operator==(const FingerDesign&) const = default;
};

/// What is meant by the smallest thickness of silicone.
enum class Thickness {
  euclidean,   ///< least distance between the half ellipse and the cavity's walls and roof
  along_axes,  ///< above the cavity along z, beside it along x
  above        ///< above the cavity along z only
};

/// How the silicone sits on the stem.
enum class Stem {
  bonded,  ///< it holds to the stem's top, and to its sides where there is no void
  free     ///< it lies on the stem, which only pushes
};

/// What the paper leaves open about the pad, shared by all designs; lengths in mm. Its defaults are those of the pad
/// that the paper's authors cast: a stair-shaped carrier, bonded shoulders beside its block, a solid distal cap.
/// Source: the first author's public code (dokkev/fingertip-design-framework, August 2026), lumo/fingertip/.
struct PadDimensions {
  double width = 30.0;
  double length = 55.0;          ///< of the part that has a cavity, centred on y = 0
  double cap_length = 5.0;       ///< of a solid end beyond it, at positive y
  double shoulder_width = 5.0;   ///< of silicone that hangs down beside the carrier's block; 0: the base is flat
  double shoulder_height = 8.0;  ///< how far it hangs down below z = 0
  double carrier_height = 10.0;  ///< of the carrier below z = 0
  Stem stem = Stem::free;
  double t_min = 5.0;  ///< smallest silicone thickness
  Thickness thickness = Thickness::euclidean;

  double lip_end() const { return 0.5 * width - shoulder_width; }  ///< |x| up to which the base z = 0 is silicone
  double proximal_end() const { return -0.5 * length; }            ///< y
  double distal_end() const { return 0.5 * length + cap_length; }  ///< y
  bool operator==(const PadDimensions&) const = default;
};

/// The default, by name.
inline PadDimensions built_pad() { return {}; }
/// A pad on a flat base, free at both ends, as lumo had it before the built one was known. At its width w_s + 2 w_v ≤
/// 19.5 says the same as 5 mm of silicone at each side.
inline PadDimensions plain_pad() {
  return {.width = 29.5,
      .length = 60.0,
      .cap_length = 0.0,
      .shoulder_width = 0.0,
      .shoulder_height = 0.0,
      .stem = Stem::bonded,
      .thickness = Thickness::along_axes};
}

/// Silicone above the voids and the stem: min over |x| ≤ w_s/2 + w_v of z_outer(x) − h_s, in mm.
double vertical_thickness(const FingerDesign& d, const PadDimensions& pad = {});
/// Silicone beside the voids: min over 0 ≤ z ≤ h_s of x_outer(z) − (w_s/2 + w_v), in mm.
double horizontal_thickness(const FingerDesign& d, const PadDimensions& pad = {});
/// Least distance between the half ellipse, its ends included, and the cavity's walls and roof, or between cavity and
/// side if that is less, in mm. 0 if the cavity's corner is not under the dome.
double euclidean_thickness(const FingerDesign& d, const PadDimensions& pad = {});

/// The space of θ: bounds, 0.5 mm lattice, the two sums and the thickness rule (paper Table I), decided exactly on the
/// lattice where it is counted along the axes, to 1e-9 mm where it is a distance.
inline DesignSpace finger_space(const PadDimensions& pad = {});

/// The hand-designed finger of the paper's authors, off the lattice. Source: as built_pad().
inline FingerDesign built_baseline() { return {5.0, 9.0, 7.6, 6.0, 2.0}; }
/// The designs that started the authors' campaigns of inclined contacts. Source: as built_pad().
inline std::vector<FingerDesign> built_references() {
  return {{14.5, 4.0, 5.0, 12.5, 5.0}, {13.5, 1.5, 7.0, 9.5, 5.5}, {5.5, 2.0, 9.0, 2.0, 0.5},
      {13.0, 7.0, 7.5, 14.5, 0.0}, {2.5, 17.5, 7.0, 2.0, 3.5}};
}

/// Throws InfeasibleDesign unless the design lies in finger_space(pad); designs that are known by name may lie off its
/// lattice.
inline void require_feasible(const FingerDesign& d, const PadDimensions& pad);

/// The plain finger's nominal design, and the five that start its campaigns.
inline FingerDesign plain_baseline() { return {6.0, 6.0, 8.0, 5.0, 0.0}; }
inline std::vector<FingerDesign> plain_references() {
  return {plain_baseline(), {4.0, 8.0, 8.0, 5.0, 2.0}, {8.0, 4.0, 6.0, 4.0, 2.0}, {5.0, 10.0, 10.0, 6.0, 3.0},
      {10.0, 5.0, 8.0, 6.0, 1.0}};
}

inline FingerDesign FingerDesign::from(std::span<const double> x) {
  if (x.size() != 5)
    throw InvalidArgument(message("theta has ", x.size(), " values, must have 5 (h_fp, h_ep, w_s, h_s, w_v in mm)"));
  const Variable lattice{"length", 0.0, 0.0, lattice_mm, "mm"};
  const auto snapped = [&](double value) { return lattice.on_lattice(value) ? lattice.nearest_node(value) : value; };
  return {snapped(x[0]), snapped(x[1]), snapped(x[2]), snapped(x[3]), snapped(x[4])};
}

inline double vertical_thickness(const FingerDesign& d, const PadDimensions& pad) {
  const double r = (d.w_s + 2.0 * d.w_v) / pad.width;
  return d.h_fp + d.h_ep * std::sqrt(std::max(0.0, 1.0 - r * r)) - d.h_s;
}

inline double euclidean_thickness(const FingerDesign& d, const PadDimensions& pad) {
  // The corner is the point of the cavity that comes nearest: above the roof the ellipse falls towards it, beside the
  // wall it leans towards it.
  const double a = 0.5 * pad.width, c = 0.5 * d.w_s + d.w_v, up = d.h_s - d.h_fp;
  const double under = d.h_ep * d.h_ep * (1.0 - c * c / (a * a));
  if (c >= a || (up > 0.0 && up * up >= under)) return 0.0;
  const auto squared = [&](double t) {
    const double x = a * std::cos(t) - c, z = d.h_ep * std::sin(t) - up;
    return x * x + z * z;
  };
  constexpr int pieces = 64;
  const double step = 0.5 * pi / pieces;
  int nearest = 0;
  for (int k = 1; k <= pieces; ++k)
    if (squared(k * step) < squared(nearest * step)) nearest = k;
  const double low = std::max(0, nearest - 1) * step, high = std::min(pieces, nearest + 1) * step;
  const double least = std::min(squared(0.0), squared(golden_section(squared, low, high, 60)));
  return std::min(a - c, std::sqrt(least));
}

inline double horizontal_thickness(const FingerDesign& d, const PadDimensions& pad) {
  const double above = std::max(0.0, d.h_s - d.h_fp) / d.h_ep;
  return 0.5 * pad.width * std::sqrt(std::max(0.0, 1.0 - above * above)) - 0.5 * (d.w_s + 2.0 * d.w_v);
}

namespace detail {

// Squared forms of the two thickness rules: on the lattice every term is a dyadic rational of few bits, so doubles
// decide them exactly.
inline bool vertically_thick(const FingerDesign& d, const PadDimensions& pad) {
  const double inner = d.w_s + 2.0 * d.w_v, need = pad.t_min + d.h_s - d.h_fp, w2 = pad.width * pad.width;
  if (inner >= pad.width) return false;
  return need <= 0.0 || d.h_ep * d.h_ep * (w2 - inner * inner) >= w2 * need * need;
}

inline bool horizontally_thick(const FingerDesign& d, const PadDimensions& pad) {
  const double need = d.w_s + 2.0 * d.w_v + 2.0 * pad.t_min, above = d.h_s - d.h_fp;
  if (above <= 0.0) return pad.width >= need;
  if (above > d.h_ep) return false;
  return pad.width * pad.width * (d.h_ep * d.h_ep - above * above) >= need * need * d.h_ep * d.h_ep;
}

}  // namespace detail

inline DesignSpace finger_space(const PadDimensions& pad) {
  DesignSpace space;
  const double step = FingerDesign::lattice_mm;
  space.variables = {{"h_fp", 2.0, 29.0, step, "mm"}, {"h_ep", 1.0, 20.0, step, "mm"}, {"w_s", 4.0, 15.0, step, "mm"},
      {"h_s", 2.0, 15.0, step, "mm"}, {"w_v", 0.0, 7.5, step, "mm"}};
  const double unbounded = -std::numeric_limits<double>::infinity();
  space.constraints = {
      {"h_fp + h_ep", {1, 1, 0, 0, 0}, unbounded, 20.0, "mm"}, {"w_s + 2 w_v", {0, 0, 1, 0, 2}, unbounded, 19.5, "mm"}};
  const auto refusal = [pad](const char* where, double value) {
    return InfeasibleDesign(std::string("t_min ") + where, value, pad.t_min, "mm",
        message("infeasible design: smallest silicone thickness t_min (", where, ") = ", value,
            " mm is below its limit ", pad.t_min, " mm"));
  };
  if (pad.thickness == Thickness::euclidean) {
    constexpr double rounding_mm = 1e-9;
    space.rules = {{[pad](std::span<const double> x) {
                      return euclidean_thickness(FingerDesign::from(x), pad) >= pad.t_min - rounding_mm;
                    },
        [pad, refusal](std::span<const double> x) {
          return refusal("distance", euclidean_thickness(FingerDesign::from(x), pad));
        }}};
    return space;
  }
  space.rules = {{[pad](std::span<const double> x) { return detail::vertically_thick(FingerDesign::from(x), pad); },
      [pad, refusal](
          std::span<const double> x) { return refusal("vertical", vertical_thickness(FingerDesign::from(x), pad)); }}};
  if (pad.thickness == Thickness::along_axes)
    space.rules.push_back(
        {[pad](std::span<const double> x) { return detail::horizontally_thick(FingerDesign::from(x), pad); },
            [pad, refusal](std::span<const double> x) {
              return refusal("horizontal", horizontal_thickness(FingerDesign::from(x), pad));
            }});
  return space;
}

inline void require_feasible(const FingerDesign& d, const PadDimensions& pad) {
  DesignSpace space = finger_space(pad);
  if (d == built_baseline())
    for (Variable& v : space.variables) v.step = 0.0;
  space.check(d.values());
}

}  // namespace lumo
