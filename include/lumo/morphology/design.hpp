#pragma once

#include "lumo/core/design_space.hpp"

#include <array>
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

/// Lengths that the paper leaves open, shared by all designs, in mm.
struct PadDimensions {
  double width = 29.5;       ///< W: at this width w_s + 2 w_v ≤ 19.5 says the same as 5 mm of silicone at each side
  double length = 60.0;      ///< L, centred on y = 0
  double t_min = 5.0;        ///< smallest silicone thickness
  bool t_min_beside = true;  ///< it holds beside stem and voids, too, not only above them

  bool operator==(const PadDimensions&) const = default;
};

/// Silicone above the voids and the stem: min over |x| ≤ w_s/2 + w_v of z_outer(x) − h_s, in mm.
double vertical_thickness(const FingerDesign& d, const PadDimensions& pad = {});
/// Silicone beside the voids: min over 0 ≤ z ≤ h_s of x_outer(z) − (w_s/2 + w_v), in mm.
double horizontal_thickness(const FingerDesign& d, const PadDimensions& pad = {});

/// The space of θ: bounds, 0.5 mm lattice, the two sums and the thickness rule (paper Table I), decided exactly on the
/// lattice.
inline DesignSpace finger_space(const PadDimensions& pad = {});

/// Nominal design and the five reference designs that start every campaign.
inline FingerDesign baseline_design() { return {6.0, 6.0, 8.0, 5.0, 0.0}; }
inline std::vector<FingerDesign> reference_designs() {
  return {baseline_design(), {4.0, 8.0, 8.0, 5.0, 2.0}, {8.0, 4.0, 6.0, 4.0, 2.0}, {5.0, 10.0, 10.0, 6.0, 3.0},
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
  space.rules = {{[pad](std::span<const double> x) { return detail::vertically_thick(FingerDesign::from(x), pad); },
      [pad, refusal](
          std::span<const double> x) { return refusal("vertical", vertical_thickness(FingerDesign::from(x), pad)); }}};
  if (pad.t_min_beside)
    space.rules.push_back(
        {[pad](std::span<const double> x) { return detail::horizontally_thick(FingerDesign::from(x), pad); },
            [pad, refusal](std::span<const double> x) {
              return refusal("horizontal", horizontal_thickness(FingerDesign::from(x), pad));
            }});
  return space;
}

}  // namespace lumo
