// lumo in one header; made by single_include/generate, not to be edited. Needs C++20 and Eigen.
//
// MIT License
//
// Copyright (c) 2026 the lumo authors
//
// Permission is hereby granted, free of charge, to any person obtaining a copy
// of this software and associated documentation files (the "Software"), to deal
// in the Software without restriction, including without limitation the rights
// to use, copy, modify, merge, publish, distribute, sublicense, and/or sell
// copies of the Software, and to permit persons to whom the Software is
// furnished to do so, subject to the following conditions:
//
// The above copyright notice and this permission notice shall be included in all
// copies or substantial portions of the Software.
//
// THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR
// IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY,
// FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE
// AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER
// LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM,
// OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE
// SOFTWARE.

#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/Sparse>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <chrono>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <numeric>
#include <optional>
#include <ostream>
#include <set>
#include <span>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <thread>
#include <tuple>
#include <utility>
#include <variant>
#include <vector>

// ---- lumo/core/error.hpp

namespace lumo {

/// Base of everything that lumo throws. The text is one line: what, value, limit, unit.
class Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The caller broke a contract: an argument out of its range, not finite, or of the wrong shape.
class InvalidArgument : public Error {
 public:
  using Error::Error;
};

/// A design outside its space; names the broken constraint and by how much it is broken.
class InfeasibleDesign : public Error {
 public:
  InfeasibleDesign(std::string constraint, double value, double limit, std::string unit, const std::string& text)
      : Error(text), constraint_(std::move(constraint)), value_(value), limit_(limit), unit_(std::move(unit)) {}

  const std::string& constraint() const { return constraint_; }
  double value() const { return value_; }
  double limit() const { return limit_; }
  const std::string& unit() const { return unit_; }
  /// How far beyond the limit, in `unit()`; NaN where the value is not a number.
  double excess() const { return std::abs(value_ - limit_); }

 private:
  std::string constraint_;
  double value_;
  double limit_;
  std::string unit_;
};

/// A surface that cannot be meshed, or a mesh that fails a quality gate.
class MeshError : public Error {
 public:
  enum class Reason {
    not_finite,         ///< a coordinate is NaN, infinite or absurdly large
    bad_index,          ///< a facet names a vertex that is not there
    degenerate,         ///< a facet without area, or a body without volume
    duplicate,          ///< two vertices at one place
    open,               ///< an edge without a partner
    not_manifold,       ///< an edge with more than two facets, or facets of opposite orientation
    self_intersecting,  ///< facets that cross
    crashed,            ///< the mesher died
    timed_out,          ///< the mesher ran out of time
    out_of_memory,      ///< the mesher ran out of memory
    inverted,           ///< an element whose Jacobian is not positive everywhere
    inaccurate          ///< the mesh's volume or surface is not the body's
  };
  MeshError(Reason reason, const std::string& text) : Error(text), reason_(reason) {}
  Reason reason() const { return reason_; }

 private:
  Reason reason_;
};

/// A file or stream that cannot be read or written, or says what makes no sense.
class InputError : public Error {
 public:
  using Error::Error;
};

namespace detail {

/// Joins its arguments into one line of text.
template <class... Args>
std::string text(const Args&... args) {
  std::ostringstream out;
  out.precision(10);
  (out << ... << args);
  return out.str();
}

}  // namespace detail

/// Throws InvalidArgument unless `value` is finite and lies in [low, high].
inline void require_in_range(const char* what, double value, double low, double high, const char* unit) {
  if (std::isfinite(value) && value >= low && value <= high) return;
  throw InvalidArgument(detail::text(what, " is ", value, " ", unit, ", must lie in [", low, ", ", high, "] ", unit));
}

/// Throws InvalidArgument unless `value` is finite and positive.
inline void require_positive(const char* what, double value, const char* unit) {
  if (std::isfinite(value) && value > 0.0) return;
  throw InvalidArgument(detail::text(what, " is ", value, " ", unit, ", must be finite and > 0 ", unit));
}

}  // namespace lumo

// ---- lumo/core/design_space.hpp

namespace lumo {

/// One design variable: bounds and, when `step` > 0, a lattice of multiples of `step` counted from `origin`.
struct Variable {
  std::string name;
  double lower = 0.0;
  double upper = 1.0;
  double step = 0.0;
  std::string unit;
  double origin = 0.0;

  /// The lattice node nearest to `x`, which may lie outside the bounds.
  double nearest_node(double x) const { return origin + std::round((x - origin) / step) * step; }
  /// Is `x` a node, but for rounding?
  bool on_lattice(double x) const {
    return std::abs(x - nearest_node(x)) <= 4.0 * std::numeric_limits<double>::epsilon() * std::max(std::abs(x), std::abs(origin));
  }
};

/// lower ≤ Σ coefficients · x ≤ upper. Coefficients as many as variables.
struct LinearConstraint {
  std::string name;
  std::vector<double> coefficients;
  double lower = -std::numeric_limits<double>::infinity();
  double upper = std::numeric_limits<double>::infinity();
  std::string unit;

  double sum(std::span<const double> x) const {
    double total = 0.0;
    for (std::size_t i = 0; i < x.size(); ++i) total += coefficients[i] * x[i];
    return total;
  }
  /// By how much rounding may have moved the sum: 0.1 + 0.2 must not break a limit of 0.3.
  double rounding(std::span<const double> x) const {
    double size = 0.0;
    for (std::size_t i = 0; i < x.size(); ++i) size += std::abs(coefficients[i] * x[i]);
    return 2.0 * std::numeric_limits<double>::epsilon() * size;
  }
};

/// A constraint of any form. Both are called only where bounds, lattice, linear constraints and the rules before hold.
struct DesignRule {
  std::function<bool(std::span<const double>)> holds;
  std::function<InfeasibleDesign(std::span<const double>)> refusal;  ///< what to say where it does not
};

/// The designs that may be tried, in any number of dimensions: a box or lattice, linear constraints, and further rules.
struct DesignSpace {
  std::vector<Variable> variables;
  std::vector<LinearConstraint> constraints;
  std::vector<DesignRule> rules;

  /// Throws InfeasibleDesign naming the first broken constraint, or InvalidArgument when the number of values is wrong.
  void check(std::span<const double> x) const;

  /// Whether check() would pass. Throws InvalidArgument when the number of values is wrong.
  bool contains(std::span<const double> x) const;
};

inline void DesignSpace::check(std::span<const double> x) const {
  if (x.size() != variables.size())
    throw InvalidArgument(detail::text("design has ", x.size(), " values, the space has ", variables.size(), " variables"));
  for (std::size_t i = 0; i < x.size(); ++i) {
    const Variable& v = variables[i];
    const std::string unit = v.unit.empty() ? "" : " " + v.unit;
    if (!std::isfinite(x[i]))
      throw InfeasibleDesign(v.name + " finite", x[i], v.upper, v.unit, detail::text("infeasible design: ", v.name, " is ", x[i], ", must be a finite number"));
    if (x[i] < v.lower)
      throw InfeasibleDesign(v.name + " lower bound", x[i], v.lower, v.unit,
                             detail::text("infeasible design: ", v.name, " = ", x[i], unit, " is below its lower bound ", v.lower, unit));
    if (x[i] > v.upper)
      throw InfeasibleDesign(v.name + " upper bound", x[i], v.upper, v.unit,
                             detail::text("infeasible design: ", v.name, " = ", x[i], unit, " is above its upper bound ", v.upper, unit));
    if (v.step > 0.0 && !v.on_lattice(x[i]))
      throw InfeasibleDesign(v.name + " lattice", x[i], v.nearest_node(x[i]), v.unit,
                             detail::text("infeasible design: ", v.name, " = ", x[i], unit, " is off the ", v.step, unit, " lattice; nearest is ", v.nearest_node(x[i]), unit));
  }
  for (const LinearConstraint& c : constraints) {
    const double sum = c.sum(x), rounding = c.rounding(x);
    const std::string unit = c.unit.empty() ? "" : " " + c.unit;
    if (sum > c.upper + rounding)
      throw InfeasibleDesign(c.name, sum, c.upper, c.unit, detail::text("infeasible design: ", c.name, " = ", sum, unit, " exceeds its limit ", c.upper, unit));
    if (sum < c.lower - rounding)
      throw InfeasibleDesign(c.name, sum, c.lower, c.unit, detail::text("infeasible design: ", c.name, " = ", sum, unit, " is below its limit ", c.lower, unit));
  }
  for (const DesignRule& r : rules)
    if (!r.holds(x)) throw r.refusal(x);
}

inline bool DesignSpace::contains(std::span<const double> x) const {
  if (x.size() != variables.size()) throw InvalidArgument(detail::text("design has ", x.size(), " values, the space has ", variables.size(), " variables"));
  for (std::size_t i = 0; i < x.size(); ++i) {
    const Variable& v = variables[i];
    if (!(x[i] >= v.lower && x[i] <= v.upper) || (v.step > 0.0 && !v.on_lattice(x[i]))) return false;
  }
  for (const LinearConstraint& c : constraints) {
    const double sum = c.sum(x), rounding = c.rounding(x);
    if (sum > c.upper + rounding || sum < c.lower - rounding) return false;
  }
  return std::all_of(rules.begin(), rules.end(), [&](const DesignRule& r) { return r.holds(x); });
}

}  // namespace lumo

// ---- lumo/core/executor.hpp

namespace lumo {

/// Runs `task(i)` for every i in [0, count), in any order and on any thread, and returns when all are done.
/// Law: each i exactly once; an exception thrown by a task is rethrown to the caller after the others have stopped.
/// Tasks write to disjoint places, so that results do not depend on the number of threads.
template <class E>
concept Executor = requires(const E& executor, std::size_t count) {
  executor.for_each(count, [](std::size_t) {});
};

/// Everything on the calling thread, in order.
struct Serial {
  template <std::invocable<std::size_t> Task>
  void for_each(std::size_t count, Task&& task) const {
    for (std::size_t i = 0; i < count; ++i) task(i);
  }
};

static_assert(Executor<Serial>);

}  // namespace lumo

// ---- lumo/core/units.hpp

namespace lumo {

/// Literals that turn the field's units into SI: `5.0_mm`, `106.0_kPa`, `3.1_dB_per_cm`.
inline namespace literals {

constexpr double operator""_m(long double v) { return double(v); }
constexpr double operator""_mm(long double v) { return double(v * 1e-3L); }
constexpr double operator""_um(long double v) { return double(v * 1e-6L); }
constexpr double operator""_N(long double v) { return double(v); }
constexpr double operator""_Pa(long double v) { return double(v); }
constexpr double operator""_kPa(long double v) { return double(v * 1e3L); }
constexpr double operator""_MPa(long double v) { return double(v * 1e6L); }
constexpr double operator""_W(long double v) { return double(v); }
constexpr double operator""_kg_per_m3(long double v) { return double(v); }
constexpr double operator""_N_per_m3(long double v) { return double(v); }
constexpr double operator""_deg(long double v) { return double(v * 3.14159265358979323846264338327950288L / 180.0L); }
constexpr double operator""_per_m(long double v) { return double(v); }
/// Power attenuation: 10 dB are a factor of ten, so 1 dB/cm = 100 ln(10)/10 per metre.
constexpr double operator""_dB_per_cm(long double v) { return double(v * 23.0258509299404568401799145468436421L); }

}  // namespace literals

inline constexpr double pi = 3.14159265358979323846;

}  // namespace lumo

// ---- lumo/morphology/design.hpp

namespace lumo {

/// The paper's design vector θ = [h_fp, h_ep, w_s, h_s, w_v] in mm (paper §III-A).
struct FingerDesign {
  double h_fp = 6.0;  ///< height of the flat sides
  double h_ep = 6.0;  ///< height of the half ellipse above them
  double w_s = 8.0;   ///< width of the rigid stem
  double h_s = 5.0;   ///< height of the stem
  double w_v = 0.0;   ///< width of the lateral void on each side of the stem

  static FingerDesign from(std::span<const double> x);
  std::array<double, 5> values() const { return {h_fp, h_ep, w_s, h_s, w_v}; }
  bool operator==(const FingerDesign&) const = default;
};

/// Lengths that the paper leaves open, shared by all designs, in mm.
struct PadDimensions {
  double width = 29.5;   ///< W: at this width w_s + 2 w_v ≤ 19.5 says the same as 5 mm of silicone at each side
  double length = 60.0;  ///< L, centred on y = 0
  double t_min = 5.0;    ///< smallest silicone thickness
};

/// Silicone above the voids and the stem: min over |x| ≤ w_s/2 + w_v of z_outer(x) − h_s, in mm.
double vertical_thickness(const FingerDesign& d, const PadDimensions& pad = {});
/// Silicone beside the voids: min over 0 ≤ z ≤ h_s of x_outer(z) − (w_s/2 + w_v), in mm.
double horizontal_thickness(const FingerDesign& d, const PadDimensions& pad = {});

/// The space of θ: bounds, 0.5 mm lattice, the two sums and the thickness rule (paper Table I), decided exactly on the lattice.
DesignSpace finger_space(const PadDimensions& pad = {});

/// Nominal design and the five reference designs that start every campaign.
inline FingerDesign baseline_design() { return {6.0, 6.0, 8.0, 5.0, 0.0}; }
inline std::vector<FingerDesign> reference_designs() {
  return {baseline_design(), {4.0, 8.0, 8.0, 5.0, 2.0}, {8.0, 4.0, 6.0, 4.0, 2.0}, {5.0, 10.0, 10.0, 6.0, 3.0}, {10.0, 5.0, 8.0, 6.0, 1.0}};
}

inline FingerDesign FingerDesign::from(std::span<const double> x) {
  if (x.size() != 5) throw InvalidArgument(detail::text("theta has ", x.size(), " values, must have 5 (h_fp, h_ep, w_s, h_s, w_v in mm)"));
  return {x[0], x[1], x[2], x[3], x[4]};
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

// Squared forms of the two thickness rules: on the lattice every term is a dyadic rational of few bits, so doubles decide them exactly.
inline bool vertically_thick(const FingerDesign& d, const PadDimensions& pad) {
  const double inner = d.w_s + 2.0 * d.w_v, need = pad.t_min + d.h_s - d.h_fp, w2 = pad.width * pad.width;
  if (inner > pad.width) return false;
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
  space.variables = {{"h_fp", 2.0, 29.0, 0.5, "mm"}, {"h_ep", 1.0, 20.0, 0.5, "mm"}, {"w_s", 4.0, 15.0, 0.5, "mm"}, {"h_s", 2.0, 15.0, 0.5, "mm"}, {"w_v", 0.0, 7.5, 0.5, "mm"}};
  const double unbounded = -std::numeric_limits<double>::infinity();
  space.constraints = {{"h_fp + h_ep", {1, 1, 0, 0, 0}, unbounded, 20.0, "mm"}, {"w_s + 2 w_v", {0, 0, 1, 0, 2}, unbounded, 19.5, "mm"}};
  const auto refusal = [pad](const char* where, double value) {
    return InfeasibleDesign(std::string("t_min ") + where, value, pad.t_min, "mm",
                            detail::text("infeasible design: smallest silicone thickness t_min (", where, ") = ", value, " mm is below its limit ", pad.t_min, " mm"));
  };
  space.rules = {{[pad](std::span<const double> x) { return detail::vertically_thick(FingerDesign::from(x), pad); },
                  [pad, refusal](std::span<const double> x) { return refusal("vertical", vertical_thickness(FingerDesign::from(x), pad)); }},
                 {[pad](std::span<const double> x) { return detail::horizontally_thick(FingerDesign::from(x), pad); },
                  [pad, refusal](std::span<const double> x) { return refusal("horizontal", horizontal_thickness(FingerDesign::from(x), pad)); }}};
  return space;
}

}  // namespace lumo

// ---- lumo/morphology/section.hpp

namespace lumo {

/// Matched variants of a design. The twins without a carrier are for mechanics only (paper §IV-A).
enum class Twin {
  none,              ///< the finger itself
  no_void,           ///< the same θ with w_v = 0
  bonded_base,       ///< the stem's volume is silicone, voids stay, base bonded under the stem too
  unsupported_base   ///< the same, but bonded at the two end faces only: a soft finger that can bend
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

/// Half cross-section x ≥ 0 as a closed polygon in (x, z), counter-clockwise, in metres; edge i runs from point i to i + 1.
struct HalfSection {
  FingerDesign design;
  PadDimensions pad;
  Twin twin = Twin::none;
  std::vector<double> x, z;
  std::vector<SectionTag> tag;

  /// Exact area of the half section [m²].
  double exact_area_m2() const;
};

/// How a curve is cut into chords.
struct Chords {
  double longest_m;
  double max_turn_rad;
  double shortest_m = 0.0;   ///< about; turning does not ask for shorter ones
};

/// The section of a feasible design, its curve cut into chords, its straight edges left whole. Throws InfeasibleDesign.
HalfSection half_section(const FingerDesign& design, Twin twin, const Chords& chords, const PadDimensions& pad = {});

namespace detail {

// Angles of points on the quarter ellipse from the side (0) to the apex (π/2): each chord is as long and turns as much as allowed, evened out.
inline std::vector<double> ellipse_angles(double a, double b, const Chords& chords) {
  constexpr int fine = 20000;
  std::vector<double> measure(fine + 1, 0.0);
  const auto tangent = [&](double t) { return std::atan2(b * std::cos(t), -a * std::sin(t)); };
  for (int i = 1; i <= fine; ++i) {
    const double t0 = 0.5 * pi * (i - 1) / fine, t1 = 0.5 * pi * i / fine;
    const double arc = std::hypot(a * (std::cos(t1) - std::cos(t0)), b * (std::sin(t1) - std::sin(t0)));
    measure[std::size_t(i)] = measure[std::size_t(i) - 1] + arc / chords.longest_m +
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
  const auto add = [&](double px, double pz, SectionTag tag) { s.x.push_back(px), s.z.push_back(pz), s.tag.push_back(tag); };
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

// ---- lumo/core/types.hpp

namespace lumo {

using Vec3 = Eigen::Vector3d;
using Mat3 = Eigen::Matrix3d;
/// Derivative of a 3 × 3 tensor by another, both flattened column by column: row i + 3 j, column k + 3 l.
using Mat9 = Eigen::Matrix<double, 9, 9>;

/// Planes of mirror symmetry of a body. `x` is the plane x = 0, `y` the plane y = 0.
struct Symmetry {
  bool x = false;
  bool y = false;
  bool operator==(const Symmetry&) const = default;
};

}  // namespace lumo

// ---- lumo/morphology/optical_data.hpp

namespace lumo {

/// A homogeneous medium: refractive index [–] and extinction coefficient [1/m].
struct Medium {
  double refractive_index = 1.0;
  double extinction_per_m = 0.0;
};

/// How light meets a surface.
struct Dielectric {};                                ///< smooth interface: Fresnel reflection and refraction
struct Lambertian { double albedo = 0.8; };          ///< diffuse, opaque
struct Mirror { double reflectance = 1.0; };         ///< specular, opaque
struct Absorber {};                                  ///< black
using SurfaceOptics = std::variant<Dielectric, Lambertian, Mirror, Absorber>;

/// A flat rectangular emitter with a cosine law into the medium that it touches. It radiates to `half_u` × `half_v`.
struct RectangleEmitter {
  Vec3 center = Vec3::Zero();      ///< [m]
  Vec3 half_u = Vec3::UnitX();     ///< half edge [m]
  Vec3 half_v = Vec3::UnitY();     ///< half edge [m]
  double power_W = 1.0;
  int channel = 0;                 ///< colour channel
};

/// A flat opaque face of the rigid carrier that light can meet through air, as a convex polygon; counter-clockwise seen from the lit side.
struct RigidFace {
  std::string name;
  std::vector<Vec3> corners;       ///< [m]
  SurfaceOptics optics = Lambertian{};
};

}  // namespace lumo

// ---- lumo/morphology/silicone.hpp

namespace lumo {

/// Material card of a transparent silicone. Source: paper Table I (both have Poisson's ratio 0.495).
struct Silicone {
  std::string name;
  double density_kg_per_m3;
  double mu_Pa;                 ///< shear modulus
  double lambda_Pa;             ///< Lamé's first parameter
  double refractive_index;
  double extinction_per_m;      ///< absorption and scattering together

  Medium medium() const { return {refractive_index, extinction_per_m}; }
};

inline Silicone dragon_skin() { return {"DS", 1070.0, 106.0_kPa, 10.494_MPa, 1.4348, 71.3801_per_m}; }
inline Silicone solaris() { return {"Sol", 990.0, 98.5_kPa, 9.750_MPa, 1.4100, 14.5063_per_m}; }

/// Card by its short name, "DS" or "Sol". Throws InvalidArgument for any other.
inline Silicone silicone(std::string_view name) {
  for (const Silicone& card : {dragon_skin(), solaris()})
    if (card.name == name) return card;
  throw InvalidArgument(detail::text("material is '", name, "', must be DS or Sol"));
}

}  // namespace lumo

// ---- lumo/morphology/shape.hpp

namespace lumo {

/// An exact surface that a patch of a body lies on.
/// Laws: closest_point is idempotent; normal(p) is the outward unit normal at closest_point(p).
template <class S>
concept SurfaceShape = requires(const S& shape, const Vec3& p) {
  { shape.closest_point(p) } -> std::convertible_to<Vec3>;
  { shape.normal(p) } -> std::convertible_to<Vec3>;
};

/// The plane through `point` with outward unit normal `direction`.
struct Plane {
  Vec3 point = Vec3::Zero();
  Vec3 direction = Vec3::UnitZ();

  Vec3 closest_point(const Vec3& p) const { return p - direction.dot(p - point) * direction; }
  Vec3 normal(const Vec3&) const { return direction; }
};

/// The upper half (z ≥ centre) of the elliptic cylinder along y: ((x−cx)/semi_x)² + ((z−cz)/semi_z)² = 1, lengths in m.
struct EllipticCylinder {
  Vec3 center = Vec3::Zero();
  double semi_x = 1.0;
  double semi_z = 1.0;

  Vec3 closest_point(const Vec3& p) const;
  Vec3 normal(const Vec3& p) const;
};

/// Sphere of `radius` [m] about `center`; the body is inside.
struct SphereShape {
  Vec3 center = Vec3::Zero();
  double radius = 1.0;

  Vec3 closest_point(const Vec3& p) const { return center + radius * normal(p); }
  Vec3 normal(const Vec3& p) const {
    const Vec3 d = p - center;
    const double r = d.norm();
    return r > 0.0 ? Vec3(d / r) : Vec3(Vec3::UnitZ());
  }
};

using Shape = std::variant<Plane, EllipticCylinder, SphereShape>;

inline Vec3 closest_point(const Shape& shape, const Vec3& p) {
  return std::visit([&](const auto& s) -> Vec3 { return s.closest_point(p); }, shape);
}
inline Vec3 outward_normal(const Shape& shape, const Vec3& p) {
  return std::visit([&](const auto& s) -> Vec3 { return s.normal(p); }, shape);
}

// The foot of the perpendicular on an ellipse, after Eberly, "Distance from a Point to an Ellipse" (2013): the root of a
// monotone function, bracketed and bisected, so that it converges for every aspect ratio and every point.
inline Vec3 EllipticCylinder::closest_point(const Vec3& p) const {
  const double px = std::abs(p.x() - center.x());
  const double pz = std::max(0.0, p.z() - center.z());
  const double side = p.x() < center.x() ? -1.0 : 1.0;
  const bool x_major = semi_x >= semi_z;
  const double a = x_major ? semi_x : semi_z, b = x_major ? semi_z : semi_x;
  const double u = x_major ? px : pz, v = x_major ? pz : px;  // along the major and the minor axis
  double fu = 0.0, fv = 0.0;
  if (v > 0.0) {
    if (u > 0.0) {
      const double r = (a / b) * (a / b), zu = u / a, zv = v / b;
      double low = zv - 1.0, high = std::hypot(r * zu, zv) - 1.0;
      for (int i = 0; i < 200 && low < high; ++i) {
        const double t = 0.5 * (low + high);
        if (t == low || t == high) break;
        const double g = std::pow(r * zu / (t + r), 2) + std::pow(zv / (t + 1.0), 2) - 1.0;
        (g > 0.0 ? low : high) = t;
      }
      const double t = 0.5 * (low + high);
      fu = r * u / (t + r);
      fv = v / (t + 1.0);
    } else {
      fv = b;
    }
  } else {
    const double c = a * a - b * b;
    if (a * u < c) {
      fu = a * a * u / c;
      fv = b * std::sqrt(std::max(0.0, 1.0 - (fu / a) * (fu / a)));
    } else {
      fu = a;
    }
  }
  return {center.x() + side * (x_major ? fu : fv), p.y(), center.z() + (x_major ? fv : fu)};
}

inline Vec3 EllipticCylinder::normal(const Vec3& p) const {
  const Vec3 foot = closest_point(p) - center;
  return Vec3(foot.x() / (semi_x * semi_x), 0.0, foot.z() / (semi_z * semi_z)).normalized();
}

static_assert(SurfaceShape<Plane> && SurfaceShape<EllipticCylinder> && SurfaceShape<SphereShape>);

}  // namespace lumo

// ---- lumo/morphology/body.hpp

namespace lumo {

/// A part of a body's closed surface on which all tags are the same.
struct Patch {
  std::string name;
  Shape shape = Plane{};                  ///< the exact surface; mesh nodes of the patch lie on it
  bool bonded = false;                    ///< fixed to the carrier (closed set: its edge nodes are fixed too)
  bool contactable = false;               ///< the indenter may touch it
  bool meets_carrier = false;             ///< may come to rest on the carrier
  SurfaceOptics optics = Dielectric{};
};

/// A flat polygon of the boundary, by vertex numbers, counter-clockwise seen from outside.
struct Facet {
  std::vector<int> loop;
  int patch = -1;                         ///< index into Body::patches, or Body::mirror_patch for a face in a symmetry plane
};

/// A rigid axis-aligned box that the silicone can come to rest on.
struct RigidBox {
  Vec3 center = Vec3::Zero();             ///< [m]
  Vec3 half = Vec3::Ones();               ///< half edges [m]
};

/// Wanted edge length of the mesh [m] at a place: across and along y. Elements are stretched by the ratio of the two.
struct Sizing {
  std::function<double(const Vec3&)> edge;  ///< across y [m]
  double stretch_y = 1.0;                   ///< edges along y are this much longer
};

/// One soft, transparent body on a rigid carrier: all that meshing, mechanics and optics need to know.
/// SI units, finger frame (x lateral, y along the finger, z outward normal).
struct Body {
  static constexpr int mirror_patch = -1;

  std::string name;
  std::vector<Patch> patches;
  std::vector<Vec3> vertices;               ///< of the boundary of the meshed sector [m]
  std::vector<Facet> facets;                ///< closed boundary of the sector x ≥ 0 and/or y ≥ 0 that `symmetry` leaves
  Symmetry symmetry;                        ///< the whole body is the sector and its mirror images
  Sizing sizing;
  double exact_volume_m3 = 0.0;             ///< of the whole body; 0 when not known

  std::vector<RigidBox> carrier;            ///< union of boxes for mechanical contact
  Vec3 pivot = Vec3::Zero();                ///< approach directions turn about this point (shifted along y) [m]

  Medium medium;                            ///< inside
  Medium surroundings;                      ///< outside (air)
  std::vector<RigidFace> rigid_faces;       ///< carrier faces seen through air
  std::vector<RectangleEmitter> emitters;
  int regions = 0;                          ///< number of readout regions
  /// Region of a point of the surface, from its undeformed position [m] and exact outward normal: 0 … regions−1, or −1.
  std::function<int(const Vec3& position, const Vec3& normal)> region;
  std::vector<int> region_image_x, region_image_y;  ///< region → its mirror image in x = 0 and y = 0; empty: itself
};

/// Exact outward normal at the point of a patch nearest to `p`, also in the mirror images of the sector that the patch describes.
inline Vec3 outward_normal(const Body& body, int patch, const Vec3& p) {
  const Vec3 fold(body.symmetry.x && p.x() < 0.0 ? -1.0 : 1.0, body.symmetry.y && p.y() < 0.0 ? -1.0 : 1.0, 1.0);
  return fold.cwiseProduct(outward_normal(body.patches[std::size_t(patch)].shape, fold.cwiseProduct(p)));
}

}  // namespace lumo

// ---- lumo/morphology/finger.hpp

namespace lumo {

/// What may be chosen about a finger besides θ. Defaults are our readings of what the paper leaves open.
struct FingerOptions {
  /// Mesh size [m]; the defaults come from the refinement study, benchmarks/refinement/results.md.
  struct Mesh {
    double contact_edge = 2.0e-3;     ///< on the surface that an indenter can touch, away from where it does
    double coarsest_edge = 5.0e-3;    ///< at depth
    double growth = 0.6;              ///< edge length gained per length of depth
    double stretch_y = 1.0;           ///< edges along y are this much longer
    double max_turn_rad = 0.6;        ///< largest turning of the profile along one edge
    double shortest_chord = 0.4e-3;   ///< of the profile; turning does not ask for shorter ones
  };
  /// The five LEDs, lengths in m.
  struct Leds {
    int count = 5;
    double pitch = 11.0e-3;
    double length_y = 1.6e-3;
    double width_x = 0.8e-3;
    double power_W = 1.0;             ///< of all together
  };
  /// Readout regions on the outer surface.
  struct Readout {
    int bins = 11;
    double half_range = 27.5e-3;      ///< |y| beyond it is not seen [m]
    double min_abs_nx = 0.5;          ///< the undeformed normal must point this much sideways
  };

  Twin twin = Twin::none;
  PadDimensions pad;
  Mesh mesh;
  Leds leds;
  Readout readout;
  double carrier_albedo = 0.8;
};

/// The whole finger of a feasible design as a body; its quarter x ≥ 0, y ≥ 0 is described, the rest is mirrored.
/// Throws InfeasibleDesign or InvalidArgument. Source: paper §III-A and Table I.
Body finger(const FingerDesign& design, const Silicone& silicone, const FingerOptions& options = {});

namespace detail {

inline Patch finger_patch(SectionTag tag, const HalfSection& s, const FingerOptions& o) {
  const bool supported = s.twin != Twin::unsupported_base;
  const double w = 0.5e-3 * s.pad.width, hs = 1e-3 * s.design.h_s, stem = 0.5e-3 * s.design.w_s;
  const SurfaceOptics wall = Lambertian{o.carrier_albedo};
  switch (tag) {
    case SectionTag::stem_top: return {"stem_top", Plane{{0, 0, hs}, -Vec3::UnitZ()}, true, false, false, wall};
    case SectionTag::stem_side: return {"stem_side", Plane{{stem, 0, 0}, -Vec3::UnitX()}, true, false, false, wall};
    case SectionTag::base: return {"base", Plane{Vec3::Zero(), -Vec3::UnitZ()}, supported, false, false, wall};
    case SectionTag::void_inner: return {"void_inner", Plane{{stem, 0, 0}, Vec3::UnitX()}, false, false, false, Dielectric{}};
    case SectionTag::void_roof: return {"void_roof", Plane{{0, 0, hs}, -Vec3::UnitZ()}, false, false, supported, Dielectric{}};
    case SectionTag::void_wall: return {"void_wall", Plane{{stem + 1e-3 * s.design.w_v, 0, 0}, -Vec3::UnitX()}, false, false, supported, Dielectric{}};
    case SectionTag::side: return {"side", Plane{{w, 0, 0}, Vec3::UnitX()}, false, true, false, Dielectric{}};
    default: return {"dome", EllipticCylinder{{0, 0, 1e-3 * s.design.h_fp}, w, 1e-3 * s.design.h_ep}, false, true, false, Dielectric{}};
  }
}

inline void add_carrier(Body& body, const HalfSection& s, const FingerOptions& o) {
  const double half_length = 0.5e-3 * s.pad.length, w = 0.5e-3 * s.pad.width;
  const double hs = 1e-3 * s.design.h_s, stem = 0.5e-3 * s.design.w_s, outer = stem + 1e-3 * s.design.w_v, thick = 5e-3;
  if (s.twin == Twin::unsupported_base) return;
  body.carrier.push_back({{0, 0, -thick}, {w, half_length, thick}});
  if (s.twin == Twin::bonded_base) return;
  body.carrier.push_back({{0, 0, 0.5 * (hs - thick)}, {stem, half_length, 0.5 * (hs + thick)}});
  if (s.design.w_v <= 0.0) return;
  const SurfaceOptics wall = Lambertian{o.carrier_albedo};
  const auto face = [&](std::string name, Vec3 a, Vec3 b, Vec3 c, Vec3 d) { body.rigid_faces.push_back({std::move(name), {a, b, c, d}, wall}); };
  const double l = half_length;
  face("stem +x", {stem, -l, 0}, {stem, l, 0}, {stem, l, hs}, {stem, -l, hs});
  face("stem -x", {-stem, -l, 0}, {-stem, -l, hs}, {-stem, l, hs}, {-stem, l, 0});
  face("base +x", {stem, -l, 0}, {outer, -l, 0}, {outer, l, 0}, {stem, l, 0});
  face("base -x", {-stem, -l, 0}, {-stem, l, 0}, {-outer, l, 0}, {-outer, -l, 0});
}

inline void add_light(Body& body, const HalfSection& s, const Silicone& silicone, const FingerOptions& o) {
  body.medium = silicone.medium();
  if (s.twin == Twin::bonded_base || s.twin == Twin::unsupported_base) return;
  const auto& led = o.leds;
  for (int k = 0; k < led.count; ++k) {
    const double y = (k - 0.5 * (led.count - 1)) * led.pitch;
    body.emitters.push_back({{0, y, 1e-3 * s.design.h_s}, {0.5 * led.width_x, 0, 0}, {0, 0.5 * led.length_y, 0}, led.power_W / led.count, 0});
  }
  const auto r = o.readout;
  body.regions = r.bins;
  for (int b = 0; b < r.bins; ++b) body.region_image_y.push_back(r.bins - 1 - b);
  body.region = [r](const Vec3& p, const Vec3& n) {
    if (std::abs(n.x()) < r.min_abs_nx || std::abs(p.y()) > r.half_range) return -1;
    const double bin = (p.y() + r.half_range) / (2.0 * r.half_range) * r.bins;
    return std::clamp(int(bin), 0, r.bins - 1);
  };
}

}  // namespace detail

inline Body finger(const FingerDesign& design, const Silicone& silicone, const FingerOptions& o) {
  require_in_range("mesh edge at the contact surface", o.mesh.contact_edge * 1e3, 0.2, 10.0, "mm");
  require_in_range("coarsest mesh edge", o.mesh.coarsest_edge * 1e3, o.mesh.contact_edge * 1e3, 30.0, "mm");
  require_in_range("mesh stretch along y", o.mesh.stretch_y, 0.5, 4.0, "");
  require_in_range("carrier albedo", o.carrier_albedo, 0.0, 1.0, "");
  const HalfSection s = half_section(design, o.twin, {o.mesh.contact_edge, o.mesh.max_turn_rad, o.mesh.shortest_chord}, o.pad);
  const double half_length = 0.5e-3 * o.pad.length;
  Body body;
  body.name = "finger";
  body.symmetry = {true, true};
  body.exact_volume_m3 = 4.0 * s.exact_area_m2() * half_length;
  body.pivot = {0, 0, 1e-3 * s.design.h_fp};
  detail::add_carrier(body, s, o);
  detail::add_light(body, s, silicone, o);

  const int n = int(s.x.size());
  for (int k = 0; k < n; ++k) {
    body.vertices.emplace_back(s.x[std::size_t(k)], 0.0, s.z[std::size_t(k)]);
    body.vertices.emplace_back(s.x[std::size_t(k)], half_length, s.z[std::size_t(k)]);
  }
  std::vector<int> patch_of(std::size_t(SectionTag::dome) + 1, -2);
  for (int k = 0; k < n; ++k) {
    const SectionTag tag = s.tag[std::size_t(k)];
    int& patch = patch_of[std::size_t(tag)];
    if (tag == SectionTag::mirror) patch = Body::mirror_patch;
    if (patch == -2) {
      patch = int(body.patches.size());
      body.patches.push_back(detail::finger_patch(tag, s, o));
    }
    const int next = (k + 1) % n;
    body.facets.push_back({{2 * k, 2 * k + 1, 2 * next + 1, 2 * next}, patch});
  }
  Facet middle{{}, Body::mirror_patch}, end{{}, int(body.patches.size())};
  body.patches.push_back({"end", Plane{{0, half_length, 0}, Vec3::UnitY()}, o.twin == Twin::unsupported_base, false, false, Dielectric{}});
  for (int k = 0; k < n; ++k) {
    middle.loop.push_back(2 * k);
    end.loop.push_back(2 * (n - 1 - k) + 1);
  }
  body.facets.push_back(middle);
  body.facets.push_back(end);

  const auto mesh = o.mesh;
  std::vector<Shape> touchable;
  for (const Patch& p : body.patches)
    if (p.contactable && p.name == "dome") touchable.push_back(p.shape);
  body.sizing.stretch_y = mesh.stretch_y;
  body.sizing.edge = [mesh, touchable](const Vec3& p) {
    double depth = std::numeric_limits<double>::infinity();
    for (const Shape& shape : touchable) depth = std::min(depth, (closest_point(shape, p) - p).norm());
    return std::min(mesh.contact_edge + mesh.growth * depth, mesh.coarsest_edge);
  };
  return body;
}

}  // namespace lumo

// ---- lumo/mesh/mesher.hpp

namespace lumo {

/// Closed polyhedral surface to be filled, with a wanted edge length and optional interior points.
struct MeshInput {
  std::vector<Vec3> vertices;                    ///< [m] or any unit: the mesher is scale-free
  std::vector<Facet> facets;                     ///< closed, manifold, counter-clockwise seen from outside
  std::function<double(const Vec3&)> edge;       ///< wanted edge length, same unit; may be empty
  bool keep_surface = false;                     ///< do not split the given facets
};

/// Straight tetrahedra that fill a MeshInput. Boundary triangles are counter-clockwise seen from outside and carry their facet's patch.
struct LinearTets {
  std::vector<Vec3> vertices;
  std::vector<std::array<int, 4>> tets;          ///< positive orientation: (b−a)×(c−a)·(d−a) > 0
  std::vector<std::array<int, 3>> faces;
  std::vector<int> patches;                      ///< one per face
};

/// Fills a closed surface with tetrahedra. Law: same input, same bits. Throws MeshError, never anything else.
template <class M>
concept Mesher = requires(const M& mesher, const MeshInput& input) {
  { mesher.fill(input) } -> std::same_as<LinearTets>;
};

}  // namespace lumo

// ---- lumo/mesh/tet_mesh.hpp

namespace lumo {

/// Boundary triangle of a tetrahedral mesh, counter-clockwise seen from outside.
/// Nodes: three corners, then the middles of edges 01, 12, 20 (−1 in a linear mesh).
struct BoundaryFace {
  std::array<int, 6> nodes;
  int patch;        ///< index into Body::patches
};

/// Tetrahedral mesh of the *whole* body in its reference configuration.
/// Tet nodes: corners 0…3 (positive orientation), then the middles of edges 01, 12, 02, 03, 13, 23 (−1 in a linear mesh).
struct TetMesh {
  int order = 2;                                 ///< 1 linear, 2 quadratic
  std::vector<Vec3> nodes;                       ///< [m]
  std::vector<std::array<int, 10>> tets;
  std::vector<BoundaryFace> faces;               ///< the closed boundary, patch by patch
  Symmetry symmetry;                             ///< planes in which the mesh is its own exact mirror image
  std::vector<int> mirror_x, mirror_y;           ///< node → its mirror image in x = 0 and y = 0 (empty without symmetry)

  int nodes_per_tet() const { return order == 2 ? 10 : 4; }
  int nodes_per_face() const { return order == 2 ? 6 : 3; }
};

}  // namespace lumo

// ---- lumo/mesh/mirror.hpp

namespace lumo {

/// The mesh together with its mirror image in the plane x = 0 (`axis` 0) or y = 0 (`axis` 1). Nodes with that coordinate exactly 0 are
/// shared; all other nodes lie on the positive side. Original nodes keep their numbers; images follow.
TetMesh mirrored(const TetMesh& half, int axis);

inline TetMesh mirrored(const TetMesh& half, int axis) {
  TetMesh whole = half;
  const std::size_t n = half.nodes.size();
  std::vector<int> image(n);
  for (std::size_t k = 0; k < n; ++k) {
    if (half.nodes[k][axis] == 0.0) {
      image[k] = int(k);
      continue;
    }
    image[k] = int(whole.nodes.size());
    Vec3 x = half.nodes[k];
    x[axis] = -x[axis];
    whole.nodes.push_back(x);
  }
  const auto of = [&](int node) { return node < 0 ? node : image[std::size_t(node)]; };
  // A mirror image has the other orientation: exchange two corners, and the edge nodes that go with them.
  for (const auto& t : half.tets)
    whole.tets.push_back({of(t[1]), of(t[0]), of(t[2]), of(t[3]), of(t[4]), of(t[6]), of(t[5]), of(t[8]), of(t[7]), of(t[9])});
  for (const BoundaryFace& f : half.faces)
    whole.faces.push_back({{of(f.nodes[1]), of(f.nodes[0]), of(f.nodes[2]), of(f.nodes[3]), of(f.nodes[5]), of(f.nodes[4])}, f.patch});

  std::vector<int> partner(whole.nodes.size());
  for (std::size_t k = 0; k < n; ++k) {
    partner[k] = image[k];
    partner[std::size_t(image[k])] = int(k);
  }
  // The other plane's pairing carries over to the images.
  const auto extended = [&](const std::vector<int>& pairs) {
    std::vector<int> all(pairs);
    all.resize(whole.nodes.size());
    for (std::size_t k = 0; k < pairs.size(); ++k) all[std::size_t(image[k])] = image[std::size_t(pairs[k])];
    return all;
  };
  if (axis == 0) {
    whole.symmetry.x = true;
    whole.mirror_x = partner;
    if (half.symmetry.y) whole.mirror_y = extended(half.mirror_y);
  } else {
    whole.symmetry.y = true;
    whole.mirror_y = partner;
    if (half.symmetry.x) whole.mirror_x = extended(half.mirror_x);
  }
  return whole;
}

}  // namespace lumo

// ---- lumo/mesh/quality.hpp

namespace lumo {

/// How good a mesh is.
struct MeshQuality {
  double volume_m3 = 0.0;          ///< exact integral of the Jacobian
  double min_jacobian_ratio = 1.0; ///< smallest Bernstein coefficient of any element's Jacobian over the element's mean: > 0 proves it valid everywhere
  double min_dihedral_deg = 180.0; ///< of the corner tetrahedra
};

/// Bernstein coefficients of det(∂x/∂ξ) over one element: 1 (linear) or 20 (quadratic). All positive proves that the map is
/// invertible at every point, not only at quadrature points. Source: Johnen, Remacle, Geuzaine 2013.
std::vector<double> jacobian_coefficients(const TetMesh& mesh, const std::array<int, 10>& tet);

/// Measures without judging.
MeshQuality measure(const TetMesh& mesh);

/// Throws MeshError unless all Jacobians are positive over the whole element, the surface is a closed manifold, and the volume is
/// within `volume_tolerance` of `exact_volume_m3` (0: not checked).
void require_valid(const TetMesh& mesh, double exact_volume_m3 = 0.0, double volume_tolerance = 0.01);

namespace detail {

// Symmetric multilinear form whose diagonal is the determinant.
inline double mixed_determinant(const Mat3& a, const Mat3& b, const Mat3& c) {
  const auto det = [](const Vec3& u, const Vec3& v, const Vec3& w) { return u.dot(v.cross(w)); };
  return (det(a.col(0), b.col(1), c.col(2)) + det(a.col(0), c.col(1), b.col(2)) + det(b.col(0), a.col(1), c.col(2)) +
          det(b.col(0), c.col(1), a.col(2)) + det(c.col(0), a.col(1), b.col(2)) + det(c.col(0), b.col(1), a.col(2))) / 6.0;
}

}  // namespace detail

inline std::vector<double> jacobian_coefficients(const TetMesh& mesh, const std::array<int, 10>& t) {
  const auto x = [&](int k) -> const Vec3& { return mesh.nodes[std::size_t(t[std::size_t(k)])]; };
  if (mesh.order == 1) return {(x(1) - x(0)).cross(x(2) - x(0)).dot(x(3) - x(0))};
  // The Jacobian of a quadratic map is linear in the barycentric coordinates: its value at the four corners tells all.
  static constexpr int mid[4][4] = {{-1, 4, 6, 7}, {4, -1, 5, 8}, {6, 5, -1, 9}, {7, 8, 9, -1}};
  std::array<Mat3, 4> corner;
  for (int k = 0; k < 4; ++k) {
    std::array<Vec3, 4> by_lambda;  // ∂x/∂λ_j at corner k
    for (int j = 0; j < 4; ++j) by_lambda[std::size_t(j)] = j == k ? Vec3(3.0 * x(k)) : Vec3(4.0 * x(mid[k][j]) - x(j));
    for (int j = 1; j < 4; ++j) corner[std::size_t(k)].col(j - 1) = by_lambda[std::size_t(j)] - by_lambda[0];
  }
  std::vector<double> coefficients;
  for (std::size_t a = 0; a < 4; ++a)
    for (std::size_t b = a; b < 4; ++b)
      for (std::size_t c = b; c < 4; ++c) coefficients.push_back(detail::mixed_determinant(corner[a], corner[b], corner[c]));
  return coefficients;
}

inline MeshQuality measure(const TetMesh& mesh) {
  MeshQuality q;
  for (const auto& t : mesh.tets) {
    const std::vector<double> c = jacobian_coefficients(mesh, t);
    double sum = 0.0;
    for (double v : c) sum += v;
    const double mean = sum / double(c.size());
    q.volume_m3 += mean / 6.0;  // the integral of a Bernstein basis polynomial does not depend on its index
    q.min_jacobian_ratio = std::min(q.min_jacobian_ratio, *std::min_element(c.begin(), c.end()) / std::max(std::abs(mean), 1e-300));
    std::array<Vec3, 4> n;
    for (std::size_t k = 0; k < 4; ++k) {
      const Vec3 &a = mesh.nodes[std::size_t(t[(k + 1) % 4])], &b = mesh.nodes[std::size_t(t[(k + 2) % 4])], &d = mesh.nodes[std::size_t(t[(k + 3) % 4])];
      n[k] = (b - a).cross(d - a).normalized() * (k % 2 == 0 ? 1.0 : -1.0);
    }
    for (std::size_t i = 0; i < 4; ++i)
      for (std::size_t j = i + 1; j < 4; ++j)
        q.min_dihedral_deg = std::min(q.min_dihedral_deg, std::acos(std::clamp(-n[i].dot(n[j]), -1.0, 1.0)) * 180.0 / 3.14159265358979);
  }
  return q;
}

inline void require_valid(const TetMesh& mesh, double exact_volume_m3, double volume_tolerance) {
  using Reason = MeshError::Reason;
  for (const Vec3& x : mesh.nodes)
    if (!x.allFinite()) throw MeshError(Reason::not_finite, "mesh has a node that is not finite");
  for (std::size_t e = 0; e < mesh.tets.size(); ++e)
    for (double c : jacobian_coefficients(mesh, mesh.tets[e]))
      if (!(c > 0.0))
        throw MeshError(Reason::inverted, detail::text("mesh element ", e, " has a Jacobian bound of ", c * 1e9, " mm3, must be > 0 over the whole element"));
  std::map<std::pair<int, int>, int> edges;  // directed edges of the closed surface must pair up
  for (const BoundaryFace& f : mesh.faces)
    for (std::size_t k = 0; k < 3; ++k) ++edges[{f.nodes[k], f.nodes[(k + 1) % 3]}];
  for (const auto& [edge, count] : edges) {
    const auto back = edges.find({edge.second, edge.first});
    if (count != 1 || back == edges.end() || back->second != 1)
      throw MeshError(count != 1 ? Reason::not_manifold : Reason::open, detail::text("mesh surface is not a closed manifold at edge ", edge.first, "-", edge.second));
  }
  if (exact_volume_m3 > 0.0) {
    const double volume = measure(mesh).volume_m3;
    if (!(std::abs(volume / exact_volume_m3 - 1.0) <= volume_tolerance))
      throw MeshError(Reason::inaccurate, detail::text("mesh volume is ", volume * 1e9, " mm3, must be within ", 100 * volume_tolerance, " % of ", exact_volume_m3 * 1e9, " mm3"));
  }
}

}  // namespace lumo

// ---- lumo/mesh/body_mesh.hpp

namespace lumo {

/// Meshes a body: its sector is filled with tetrahedra, boundary nodes are moved to the exact shapes, edges get middle nodes (also on
/// the exact shapes, `order` 2), and the mirror images are added, so that the mesh is exactly symmetric where the body is.
/// Throws MeshError when the surface is bad, the mesher fails, or the result fails a quality gate.
template <Mesher M>
TetMesh mesh_body(const Body& body, const M& mesher, int order = 2);

namespace detail {

// Patches that meet at each vertex or edge of the sector's boundary.
using PatchSet = std::set<int>;

inline Vec3 snapped(const Body& body, const PatchSet& patches, Vec3 p, double tiny) {
  for (int round = 0; round < 2; ++round)
    for (int patch : patches)
      if (patch >= 0) p = closest_point(body.patches[std::size_t(patch)].shape, p);
  if (body.symmetry.x && std::abs(p.x()) < tiny) p.x() = 0.0;
  if (body.symmetry.y && std::abs(p.y()) < tiny) p.y() = 0.0;
  return p;
}

inline void make_quadratic(const Body& body, TetMesh& mesh, const std::map<std::pair<int, int>, PatchSet>& boundary_edges, double tiny) {
  static constexpr int ends[6][2] = {{0, 1}, {1, 2}, {0, 2}, {0, 3}, {1, 3}, {2, 3}};
  std::map<std::pair<int, int>, int> middle;
  const auto middle_of = [&](int a, int b) {
    const std::pair<int, int> key = std::minmax(a, b);
    const auto [it, fresh] = middle.try_emplace(key, int(mesh.nodes.size()));
    if (fresh) {
      const Vec3 half = 0.5 * (mesh.nodes[std::size_t(a)] + mesh.nodes[std::size_t(b)]);
      const auto on_surface = boundary_edges.find(key);
      mesh.nodes.push_back(on_surface == boundary_edges.end() ? half : snapped(body, on_surface->second, half, tiny));
    }
    return it->second;
  };
  for (auto& t : mesh.tets)
    for (std::size_t k = 0; k < 6; ++k) t[4 + k] = middle_of(t[std::size_t(ends[k][0])], t[std::size_t(ends[k][1])]);
  for (BoundaryFace& f : mesh.faces)
    for (std::size_t k = 0; k < 3; ++k) f.nodes[3 + k] = middle_of(f.nodes[k], f.nodes[(k + 1) % 3]);
  mesh.order = 2;
}

}  // namespace detail

template <Mesher M>
TetMesh mesh_body(const Body& body, const M& mesher, int order) {
  if (order != 1 && order != 2) throw InvalidArgument(detail::text("mesh order is ", order, ", must be 1 or 2"));
  const double stretch = body.sizing.stretch_y;
  require_positive("mesh stretch along y", stretch, "");
  MeshInput input;
  input.facets = body.facets;
  // In squeezed space wanted edges are equally long in all directions; lengths in mm keep the mesher's tolerances away from zero.
  for (const Vec3& v : body.vertices) input.vertices.emplace_back(1e3 * v.x(), 1e3 * v.y() / stretch, 1e3 * v.z());
  if (body.sizing.edge)
    input.edge = [&body, stretch](const Vec3& p) { return 1e3 * body.sizing.edge(1e-3 * Vec3(p.x(), p.y() * stretch, p.z())); };
  const LinearTets filled = mesher.fill(input);

  TetMesh mesh;
  mesh.order = 1;
  for (const Vec3& v : filled.vertices) mesh.nodes.emplace_back(1e-3 * v.x(), 1e-3 * v.y() * stretch, 1e-3 * v.z());
  double size = 0.0;
  for (const Vec3& v : body.vertices) size = std::max(size, v.lpNorm<Eigen::Infinity>());
  const double tiny = 1e-9 * size;
  for (const auto& t : filled.tets) mesh.tets.push_back({t[0], t[1], t[2], t[3], -1, -1, -1, -1, -1, -1});

  std::map<int, detail::PatchSet> vertex_patches;
  std::map<std::pair<int, int>, detail::PatchSet> edge_patches;
  for (std::size_t f = 0; f < filled.faces.size(); ++f) {
    const auto& face = filled.faces[f];
    const int patch = filled.patches[f];
    for (std::size_t k = 0; k < 3; ++k) {
      vertex_patches[face[k]].insert(patch);
      edge_patches[std::minmax(face[k], face[(k + 1) % 3])].insert(patch);
    }
    if (patch != Body::mirror_patch) mesh.faces.push_back({{face[0], face[1], face[2], -1, -1, -1}, patch});
  }
  for (const auto& [vertex, patches] : vertex_patches)
    mesh.nodes[std::size_t(vertex)] = detail::snapped(body, patches, mesh.nodes[std::size_t(vertex)], tiny);
  if (order == 2) detail::make_quadratic(body, mesh, edge_patches, tiny);
  if (body.symmetry.x) mesh = mirrored(mesh, 0);
  if (body.symmetry.y) mesh = mirrored(mesh, 1);
  std::stable_sort(mesh.faces.begin(), mesh.faces.end(), [](const BoundaryFace& a, const BoundaryFace& b) { return a.patch < b.patch; });
  // The faces of a straight-sided mesh cut the curved profile short; only the quadratic one is held to the exact volume.
  require_valid(mesh, order == 2 ? body.exact_volume_m3 : 0.0);
  return mesh;
}

}  // namespace lumo

// ---- lumo/mesh/sizing.hpp

namespace lumo {

/// Mesh grading about the places where an indenter touches: the contact radius grows with the load, so edges that grow in proportion to
/// the distance resolve the edge of every contact equally well.
struct Focus {
  double finest = 0.2e-3;     ///< edge length at a place of touch [m]
  double growth = 0.1;        ///< edge length gained per distance from it
  double depth_growth = 0.7;  ///< and per depth below it: only the surface has to follow the edge of contact
};

/// The body with its mesh sizing refined about the given points and their mirror images. Throws InvalidArgument.
inline Body focused(Body body, const std::vector<Vec3>& points, const Focus& focus = {}) {
  require_in_range("finest mesh edge", focus.finest * 1e3, 0.02, 30.0, "mm");
  require_in_range("mesh growth about the contact", focus.growth, 0.01, 10.0, "");
  const Symmetry symmetry = body.symmetry;
  body.sizing.edge = [coarse = body.sizing.edge, points, focus, symmetry](const Vec3& p) {
    double edge = coarse(p);
    for (Vec3 at : points) {
      if (symmetry.x) at.x() = std::abs(at.x());
      if (symmetry.y) at.y() = std::abs(at.y());
      const double depth = std::max(0.0, (at - p).z());
      edge = std::min(edge, focus.finest + focus.growth * (p - at).norm() + focus.depth_growth * depth);
    }
    return edge;
  };
  return body;
}

}  // namespace lumo

// ---- lumo/mesh/vtu.hpp

namespace lumo {

/// Values on the nodes of a mesh: `components` (1 or 3) numbers per node, node by node. The unit belongs in the name.
struct NodeField {
  std::string name;
  int components = 1;
  std::vector<double> values;
};

/// One file of a time series and the value (a load, a time) it stands for.
struct SeriesEntry {
  double value;
  std::string file;
};

/// The mesh as a ParaView unstructured grid (.vtu, coordinates in m, binary arrays), with fields on its nodes.
/// Throws InvalidArgument when a field does not fit the mesh, InputError when the stream fails. Source: VTK file formats, cell types 10 and 24.
void write_vtu(std::ostream& out, const TetMesh& mesh, std::span<const NodeField> fields = {});

/// A ParaView collection (.pvd) of .vtu files.
void write_pvd(std::ostream& out, std::span<const SeriesEntry> entries);

/// The field for write_vtu from one vector per node.
inline NodeField node_field(std::string name, std::span<const Vec3> vectors) {
  NodeField f{std::move(name), 3, {}};
  f.values.reserve(3 * vectors.size());
  for (const Vec3& v : vectors) f.values.insert(f.values.end(), {v.x(), v.y(), v.z()});
  return f;
}

namespace detail {

inline std::string base64(std::span<const unsigned char> bytes) {
  static constexpr std::string_view digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string s;
  s.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t have = std::min<std::size_t>(3, bytes.size() - i);
    unsigned group = unsigned(bytes[i]) << 16;
    if (have > 1) group |= unsigned(bytes[i + 1]) << 8;
    if (have > 2) group |= bytes[i + 2];
    for (std::size_t k = 0; k < 4; ++k) s += k <= have ? digits[group >> (18 - 6 * k) & 63u] : '=';
  }
  return s;
}

// VTK's inline binary: the number of bytes as UInt64, then the values, encoded as one piece.
template <class T>
void vtu_array(std::ostream& out, std::string_view type, std::string_view name, int components, const std::vector<T>& values) {
  const std::uint64_t size = values.size() * sizeof(T);
  std::vector<unsigned char> bytes(sizeof size + size);
  std::memcpy(bytes.data(), &size, sizeof size);
  if (size > 0) std::memcpy(bytes.data() + sizeof size, values.data(), size);
  out << "<DataArray type=\"" << type << "\" Name=\"" << name << "\"";
  if (components > 1) out << " NumberOfComponents=\"" << components << "\"";
  out << " format=\"binary\">" << base64(bytes) << "</DataArray>\n";
}

inline std::string xml_attribute(std::string_view s) {
  std::string out;
  for (const char c : s) {
    if (c == '&') out += "&amp;";
    else if (c == '<') out += "&lt;";
    else if (c == '"') out += "&quot;";
    else out += c;
  }
  return out;
}

}  // namespace detail

inline void write_vtu(std::ostream& out, const TetMesh& mesh, std::span<const NodeField> fields) {
  for (const NodeField& f : fields)
    if ((f.components != 1 && f.components != 3) || f.values.size() != mesh.nodes.size() * std::size_t(f.components))
      throw InvalidArgument(detail::text("field '", f.name, "' has ", f.values.size(), " values of ", f.components, " components, the mesh has ", mesh.nodes.size(), " nodes"));

  const std::size_t per_tet = std::size_t(mesh.nodes_per_tet());
  std::vector<std::int64_t> connectivity, offsets;
  connectivity.reserve(mesh.tets.size() * per_tet);
  offsets.reserve(mesh.tets.size());
  for (const auto& tet : mesh.tets) {   // the edge order 01, 12, 02, 03, 13, 23 is VTK's own
    for (std::size_t k = 0; k < per_tet; ++k) connectivity.push_back(tet[k]);
    offsets.push_back(std::int64_t(connectivity.size()));
  }
  const std::vector<std::uint8_t> types(mesh.tets.size(), mesh.order == 2 ? 24 : 10);

  out << "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\""
      << (std::endian::native == std::endian::little ? "LittleEndian" : "BigEndian") << "\" header_type=\"UInt64\">\n<UnstructuredGrid>\n"
      << "<Piece NumberOfPoints=\"" << mesh.nodes.size() << "\" NumberOfCells=\"" << mesh.tets.size() << "\">\n<Points>\n";
  detail::vtu_array(out, "Float64", "position_m", 3, node_field("", mesh.nodes).values);
  out << "</Points>\n<Cells>\n";
  detail::vtu_array(out, "Int64", "connectivity", 1, connectivity);
  detail::vtu_array(out, "Int64", "offsets", 1, offsets);
  detail::vtu_array(out, "UInt8", "types", 1, types);
  out << "</Cells>\n<PointData>\n";
  for (const NodeField& f : fields) detail::vtu_array(out, "Float64", detail::xml_attribute(f.name), f.components, f.values);
  out << "</PointData>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n";
  if (!out) throw InputError("writing a .vtu file failed");
}

inline void write_pvd(std::ostream& out, std::span<const SeriesEntry> entries) {
  out << "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\">\n<Collection>\n";
  for (const SeriesEntry& e : entries)
    out << "<DataSet timestep=\"" << detail::text(e.value) << "\" part=\"0\" file=\"" << detail::xml_attribute(e.file) << "\"/>\n";
  out << "</Collection>\n</VTKFile>\n";
  if (!out) throw InputError("writing a .pvd file failed");
}

}  // namespace lumo

// ---- lumo/mechanics/indenter.hpp

namespace lumo {

/// Signed distance to a rigid surface with its first and second derivatives by the point.
struct DistanceSample {
  double distance;   ///< [m], negative inside
  Vec3 gradient;     ///< unit outward normal
  Mat3 hessian;      ///< [1/m]
};

/// A rigid tool, given by its signed distance field in its own frame (origin at its centre).
/// Laws: |gradient| = 1 almost everywhere; distance is 1-Lipschitz; derivatives match finite differences.
template <class T>
concept Indenter = requires(const T& tool, const Vec3& p) {
  { tool.distance(p) } -> std::convertible_to<double>;
  { tool.sample(p) } -> std::convertible_to<DistanceSample>;
  { tool.radius_m() } -> std::convertible_to<double>;
  validate(tool);
};

/// Rigid sphere.
struct Sphere {
  double diameter_m = 10e-3;

  bool operator==(const Sphere&) const = default;

  double radius_m() const { return 0.5 * diameter_m; }
  double distance(const Vec3& p) const { return p.norm() - radius_m(); }
  DistanceSample sample(const Vec3& p) const {
    const double r = p.norm();
    const Vec3 n = r > 0.0 ? Vec3(p / r) : Vec3(Vec3::UnitZ());
    return {r - radius_m(), n, (Mat3::Identity() - n * n.transpose()) / (r > 0.0 ? r : radius_m())};
  }
};

inline void validate(const Sphere& s) { require_in_range("sphere diameter", s.diameter_m * 1e3, 0.1, 1000.0, "mm"); }

static_assert(Indenter<Sphere>);

}  // namespace lumo

// ---- lumo/mechanics/scenario.hpp

namespace lumo {

/// One contact: an indenter, the line on which it comes, and the loads at which it is observed.
/// It moves along direction() on the line through Body::pivot shifted by `y_m`; it does not move sideways.
template <Indenter Tool = Sphere>
struct Scenario {
  Tool indenter;
  double angle_rad = 0.0;                                    ///< approach angle from the pad normal, in the x–z plane
  double y_m = 0.0;                                          ///< place along the finger [m]
  std::vector<double> loads_N = {1.0, 2.0, 5.0, 10.0, 15.0};  ///< increasing

  bool operator==(const Scenario&) const = default;

  /// Unit vector of the advance (paper §III-B; model reading: −(sin α, 0, cos α)).
  Vec3 direction() const { return {-std::sin(angle_rad), 0.0, -std::cos(angle_rad)}; }
};

/// Throws InvalidArgument when an angle, place or load makes no sense.
template <Indenter Tool>
void validate(const Scenario<Tool>& s) {
  validate(s.indenter);
  require_in_range("approach angle", s.angle_rad * 180.0 / pi, -80.0, 80.0, "deg");
  require_in_range("contact place y", s.y_m * 1e3, -1e4, 1e4, "mm");
  if (s.loads_N.empty()) throw InvalidArgument("loads: none given, at least one is needed");
  double last = 0.0;
  for (double load : s.loads_N) {
    require_in_range("load", load, 1e-3, 1e4, "N");
    if (load <= last) throw InvalidArgument(detail::text("loads must increase: ", load, " N follows ", last, " N"));
    last = load;
  }
}

}  // namespace lumo

// ---- lumo/mechanics/first_touch.hpp

namespace lumo {

/// Where an indenter that comes along a line first meets the exact undeformed surface.
struct Touch {
  Vec3 origin;        ///< of the indenter's frame at first touch [m]
  Vec3 point;         ///< of the surface [m]
};

/// First touch with the body's contactable patches, on their exact shapes (never on facets). The mesh only says where a patch ends.
/// Throws InvalidArgument when the indenter passes by.
template <Indenter Tool>
Touch first_touch(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario);

namespace detail {

// How far the tool can advance from `start` until it reaches p: sphere tracing, because distance is 1-Lipschitz. +∞: it passes by.
template <Indenter Tool>
double advance_to(const Tool& tool, const Vec3& start, const Vec3& direction, const Vec3& p, double limit) {
  double s = 0.0;
  for (int i = 0; i < 500; ++i) {
    const double gap = tool.distance(p - start - s * direction);
    if (gap < 1e-15) return s;
    s += gap;
    if (s > limit) break;
  }
  return s > limit ? std::numeric_limits<double>::infinity() : s;
}

}  // namespace detail

template <Indenter Tool>
Touch first_touch(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario) {
  const Vec3 direction = scenario.direction();
  double size = 0.0;
  for (const Vec3& p : mesh.nodes) size = std::max(size, p.norm());
  const double reach = 2.0 * size + 2.0 * scenario.indenter.radius_m() + std::abs(scenario.y_m);
  const Vec3 start = body.pivot + Vec3(0, scenario.y_m, 0) - reach * direction;

  double best = std::numeric_limits<double>::infinity();
  Vec3 point = Vec3::Zero();
  for (std::size_t patch = 0; patch < body.patches.size(); ++patch) {
    if (!body.patches[patch].contactable) continue;
    // The patch's box trims its shape; images in symmetry planes are searched as one patch each.
    for (int image = 0; image < 4; ++image) {
      const double sx = image & 1 ? -1.0 : 1.0, sy = image & 2 ? -1.0 : 1.0;
      if ((sx < 0 && !body.symmetry.x) || (sy < 0 && !body.symmetry.y)) continue;
      const auto fold = [&](const Vec3& p) { return Vec3(sx * p.x(), sy * p.y(), p.z()); };
      Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low, seed = Vec3::Zero();
      double nearest = std::numeric_limits<double>::infinity();
      for (const BoundaryFace& f : mesh.faces) {
        if (f.patch != int(patch)) continue;
        for (std::size_t k = 0; k < std::size_t(mesh.nodes_per_face()); ++k) {
          const Vec3 q = fold(mesh.nodes[std::size_t(f.nodes[k])]);
          if ((body.symmetry.x && q.x() < 0) || (body.symmetry.y && q.y() < 0)) continue;
          low = low.cwiseMin(q);
          high = high.cwiseMax(q);
          const double s = detail::advance_to(scenario.indenter, start, direction, fold(q), 2.0 * reach);
          if (s < nearest) nearest = s, seed = q;
        }
      }
      if (!(low.array() <= high.array()).all()) continue;
      const double slack = 1e-12 * size;
      const auto inside = [&](const Vec3& p) { return (p.array() >= low.array() - slack).all() && (p.array() <= high.array() + slack).all(); };
      // Nodes may be too far apart for a small tool: also start from where the tool's centre line comes closest.
      for (double s = 0.0; s < 2.0 * reach;) {
        const Vec3 center = fold(start + s * direction);
        const Vec3 q = closest_point(body.patches[patch].shape, center.cwiseMax(low).cwiseMin(high));
        const double apart = (q - center).norm();
        if (inside(q) && apart < 1.01 * scenario.indenter.radius_m())
          if (const double t = detail::advance_to(scenario.indenter, start, direction, fold(q), 2.0 * reach); t < nearest) nearest = t, seed = q;
        s += std::max(0.2 * apart, 1e-3 * scenario.indenter.radius_m());
      }
      if (!std::isfinite(nearest)) continue;
      // Pattern search on the exact shape: the advance is quadratic about its minimum, so 1 nm of place is far below any depth that matters.
      for (double step = 0.1 * (high - low).norm(); step > 1e-9; step *= 0.5)
        for (bool moved = true; moved;) {
          moved = false;
          const Vec3 n = outward_normal(body.patches[patch].shape, seed);
          const Vec3 u = n.unitOrthogonal(), v = n.cross(u);
          for (int k = 0; k < 8; ++k) {
            const double turn = 0.25 * pi * k;
            Vec3 trial = (seed + step * (std::cos(turn) * u + std::sin(turn) * v)).cwiseMax(low).cwiseMin(high);
            trial = closest_point(body.patches[patch].shape, trial);
            if (!inside(trial)) continue;
            const double s = detail::advance_to(scenario.indenter, start, direction, fold(trial), 2.0 * reach);
            if (s < nearest - 1e-16) nearest = s, seed = trial, moved = true;
          }
        }
      if (nearest < best) best = nearest, point = fold(seed);
    }
  }
  if (!std::isfinite(best))
    throw InvalidArgument(detail::text("the indenter at y = ", scenario.y_m * 1e3, " mm and ", scenario.angle_rad * 180 / pi, " deg passes by the body"));
  return {start + best * direction, point};
}

}  // namespace lumo

// ---- lumo/mechanics/contact_mesh.hpp

namespace lumo {

/// A mesh of the body that is fine where the scenarios' indenters first touch it, and in the mirror images of those places. `coarse` is
/// any mesh of the body. Throws InvalidArgument when an indenter passes by, MeshError when the body cannot be meshed.
template <Mesher M, Indenter Tool>
TetMesh mesh_for_contact(const Body& body, const TetMesh& coarse, const std::vector<Scenario<Tool>>& scenarios, const M& mesher, const Focus& focus = {},
                         int order = 2) {
  std::vector<Vec3> touches;
  for (const Scenario<Tool>& s : scenarios) touches.push_back(first_touch(body, coarse, s).point);
  return mesh_body(focused(body, touches, focus), mesher, order);
}

}  // namespace lumo

// ---- lumo/mechanics/material.hpp

namespace lumo {

/// A function of the volume ratio J with its derivatives: energy density [J/m³], dU/dJ [Pa], d²U/dJ² [Pa].
struct VolumetricSample {
  double energy;
  double stress;
  double stiffness;
};

/// A hyperelastic solid, W(F) = distortion(F) + U(det F). The split lets an element treat the stiff volumetric part U by its mean.
/// Laws: P(I) = 0; W(QF) = W(F) for rotations Q; stress and tangent are the derivatives of the energy; W = +∞ where det F ≤ 0 if the
/// law resists inversion. Stress is the first Piola–Kirchhoff stress [Pa], 3 × 3; tangent is ∂P/∂F, 9 × 9, flattened by columns.
template <class M>
concept HyperelasticMaterial = requires(const M& m, const Mat3& F, double J) {
  { m.distortion_energy(F) } -> std::convertible_to<double>;
  { m.distortion_stress(F) } -> std::convertible_to<Mat3>;
  { m.distortion_tangent(F) } -> std::convertible_to<Mat9>;
  { m.volumetric(J) } -> std::convertible_to<VolumetricSample>;
  { m.shear_modulus() } -> std::convertible_to<double>;
  validate(m);
};

/// Derivative of det F by F: the cofactor matrix.
inline Mat3 cofactor(const Mat3& F) {
  Mat3 c;
  c.col(0) = F.col(1).cross(F.col(2));
  c.col(1) = F.col(2).cross(F.col(0));
  c.col(2) = F.col(0).cross(F.col(1));
  return c;
}

/// Second derivative of det F by F, flattened by columns.
inline Mat9 determinant_hessian(const Mat3& F) {
  const auto cross = [](const Vec3& v) {
    Mat3 m;
    m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
    return m;
  };
  Mat9 h = Mat9::Zero();
  h.block<3, 3>(0, 3) = -cross(F.col(2));
  h.block<3, 3>(0, 6) = cross(F.col(1));
  h.block<3, 3>(3, 0) = cross(F.col(2));
  h.block<3, 3>(3, 6) = -cross(F.col(0));
  h.block<3, 3>(6, 0) = -cross(F.col(1));
  h.block<3, 3>(6, 3) = cross(F.col(0));
  return h;
}

/// Energy density W(F) [J/m³].
template <HyperelasticMaterial M>
double energy_density(const M& m, const Mat3& F) {
  return m.distortion_energy(F) + m.volumetric(F.determinant()).energy;
}

/// First Piola–Kirchhoff stress P = ∂W/∂F [Pa].
template <HyperelasticMaterial M>
Mat3 first_piola(const M& m, const Mat3& F) {
  return m.distortion_stress(F) + m.volumetric(F.determinant()).stress * cofactor(F);
}

/// Tangent ∂P/∂F [Pa], 9 × 9, flattened by columns.
template <HyperelasticMaterial M>
Mat9 elasticity_tangent(const M& m, const Mat3& F) {
  const VolumetricSample u = m.volumetric(F.determinant());
  const Mat3 c = cofactor(F);
  const Eigen::Map<const Eigen::Matrix<double, 9, 1>> flat(c.data());
  return m.distortion_tangent(F) + u.stiffness * flat * flat.transpose() + u.stress * determinant_hessian(F);
}

}  // namespace lumo

// ---- lumo/mechanics/neo_hookean.hpp

namespace lumo {

/// Compressible Neo-Hookean solid, W = μ/2 (I_C − 3) − μ ln J + λ/2 (ln J)². Source: Bonet and Wood 2008, §6.4.3.
struct NeoHookean {
  double mu = 106.0e3;       ///< shear modulus [Pa]
  double lambda = 10.494e6;  ///< Lamé's first parameter [Pa]

  double shear_modulus() const { return mu; }

  double distortion_energy(const Mat3& F) const {
    const double J = F.determinant();
    if (!(J > 0.0)) return std::numeric_limits<double>::infinity();
    return 0.5 * mu * (F.squaredNorm() - 3.0) - mu * std::log(J);
  }
  Mat3 distortion_stress(const Mat3& F) const { return mu * F - (mu / F.determinant()) * cofactor(F); }
  Mat9 distortion_tangent(const Mat3& F) const {
    const double J = F.determinant();
    const Mat3 c = cofactor(F);
    const Eigen::Map<const Eigen::Matrix<double, 9, 1>> flat(c.data());
    return mu * Mat9::Identity() + (mu / (J * J)) * flat * flat.transpose() - (mu / J) * determinant_hessian(F);
  }
  VolumetricSample volumetric(double J) const {
    if (!(J > 0.0)) return {std::numeric_limits<double>::infinity(), 0.0, 0.0};
    const double l = std::log(J);
    return {0.5 * lambda * l * l, lambda * l / J, lambda * (1.0 - l) / (J * J)};
  }
};

inline void validate(const NeoHookean& m) {
  require_positive("shear modulus mu", m.mu, "Pa");
  require_in_range("Lame parameter lambda", m.lambda, 0.0, 1e15, "Pa");
}

static_assert(HyperelasticMaterial<NeoHookean>);

}  // namespace lumo

// ---- lumo/mechanics/contact_handler.hpp

namespace lumo {

/// What a contact law answers to a gap [m]: energy per reference area [J/m²], pressure [Pa] = −dE/dg, stiffness [N/m³] = d²E/dg².
struct ContactResponse {
  double energy;
  double pressure;
  double stiffness;
};

/// A frictionless contact law between the body's surface and a rigid surface.
/// Laws: no pressure at gaps ≥ 0; pressure ≥ 0; pressure and stiffness are the derivatives of the energy.
template <class C>
concept ContactHandler = requires(const C& contact, double gap) {
  { contact.respond(gap) } -> std::convertible_to<ContactResponse>;
  { contact.stiffness_N_per_m3 } -> std::convertible_to<double>;
  validate(contact);
};

/// Penalty on the signed distance, over the full surface (points inside faces, not only vertices), per reference area.
/// Source: paper §III-B ("signed-distance full-surface rigid–soft collision").
struct SDFContact {
  double stiffness_N_per_m3 = 1e11;  ///< overlap at 0.3 MPa is 3 µm

  ContactResponse respond(double gap) const {
    if (gap >= 0.0) return {0.0, 0.0, 0.0};
    return {0.5 * stiffness_N_per_m3 * gap * gap, -stiffness_N_per_m3 * gap, stiffness_N_per_m3};
  }
};

inline void validate(const SDFContact& c) { require_in_range("contact stiffness", c.stiffness_N_per_m3, 1e6, 1e15, "N/m3"); }

static_assert(ContactHandler<SDFContact>);

/// A contact law with all its pressures multiplied by a factor.
template <class Contact>
struct Firmness {
  const Contact* law;
  double factor;
  double stiffness_N_per_m3 = factor * law->stiffness_N_per_m3;

  ContactResponse respond(double gap) const {
    const ContactResponse r = law->respond(gap);
    return {factor * r.energy, factor * r.pressure, factor * r.stiffness};
  }
};

template <class Contact>
void validate(const Firmness<Contact>& c) {
  validate(*c.law);
  require_in_range("factor on contact pressures", c.factor, 1e-6, 1e6, "");
}

static_assert(ContactHandler<Firmness<SDFContact>>);

}  // namespace lumo

// ---- lumo/mechanics/linear_solver.hpp

namespace lumo {

/// Lower triangle of a symmetric matrix, compressed by columns.
using SparseLower = Eigen::SparseMatrix<double, Eigen::ColMajor, int>;

enum class FactorStatus { positive_definite, not_positive_definite, non_finite };

/// Direct solver for symmetric positive definite systems. analyze() sees the pattern once; copies share or copy that analysis.
/// Laws: factorize() reports every matrix that is not positive definite or not finite; equal input, equal bits.
template <class S>
concept LinearSolver = std::copyable<S> && std::default_initializable<S> && requires(S solver, const SparseLower& lower, const Eigen::MatrixXd& rhs) {
  solver.analyze(lower);
  { solver.factorize(lower) } -> std::same_as<FactorStatus>;
  { solver.solve(rhs) } -> std::convertible_to<Eigen::MatrixXd>;
};

/// Eigen's own sparse Cholesky factorisation: needs nothing else, but is some twenty times slower than a supernodal one.
class EigenCholesky {
 public:
  EigenCholesky() = default;
  EigenCholesky(const EigenCholesky& other) { *this = other; }
  EigenCholesky& operator=(const EigenCholesky& other) {  // Eigen's solver does not copy: analyse again
    if (this != &other && other.pattern_.size() > 0) analyze(other.pattern_);
    return *this;
  }

  void analyze(const SparseLower& lower) {
    pattern_ = lower;
    solver_.analyzePattern(lower);
  }
  FactorStatus factorize(const SparseLower& lower) {
    // A Cholesky factorisation of NaN reports success, so finiteness is checked here.
    if (!Eigen::Map<const Eigen::ArrayXd>(lower.valuePtr(), lower.nonZeros()).isFinite().all()) return FactorStatus::non_finite;
    solver_.factorize(lower);
    return solver_.info() == Eigen::Success ? FactorStatus::positive_definite : FactorStatus::not_positive_definite;
  }
  Eigen::MatrixXd solve(const Eigen::MatrixXd& rhs) const { return solver_.solve(rhs); }

 private:
  SparseLower pattern_;
  Eigen::SimplicialLLT<SparseLower, Eigen::Lower> solver_;
};

static_assert(LinearSolver<EigenCholesky>);

}  // namespace lumo

// ---- lumo/mesh/sector.hpp

namespace lumo {

/// The part of a symmetric mesh on the positive side of some of its symmetry planes, as a mesh of its own.
struct Sector {
  Symmetry planes;             ///< planes that bound it
  TetMesh mesh;
  std::vector<int> to_whole;   ///< sector node → node of the whole mesh

  /// What part of the whole it is: 1, ½ or ¼.
  double fraction() const { return (planes.x ? 0.5 : 1.0) * (planes.y ? 0.5 : 1.0); }
};

/// Throws InvalidArgument when the mesh is not symmetric in a wanted plane.
Sector sector_of(const TetMesh& whole, Symmetry planes);

/// A field of vectors on the sector's nodes, mirrored to the whole mesh.
std::vector<Vec3> unfold(const TetMesh& whole, const Sector& sector, const std::vector<Vec3>& field);

/// A field of numbers on the sector's nodes, mirrored to the whole mesh.
std::vector<double> unfold(const TetMesh& whole, const Sector& sector, const std::vector<double>& field);

inline Sector sector_of(const TetMesh& whole, Symmetry planes) {
  if ((planes.x && !whole.symmetry.x) || (planes.y && !whole.symmetry.y)) throw InvalidArgument("sector: the mesh is not symmetric in the wanted plane");
  Sector s;
  s.planes = planes;
  s.mesh.order = whole.order;
  std::vector<int> number(whole.nodes.size(), -1);
  for (std::size_t k = 0; k < whole.nodes.size(); ++k) {
    if ((planes.x && whole.nodes[k].x() < 0.0) || (planes.y && whole.nodes[k].y() < 0.0)) continue;
    number[k] = int(s.to_whole.size());
    s.to_whole.push_back(int(k));
    s.mesh.nodes.push_back(whole.nodes[k]);
  }
  const auto keep = [&](const auto& nodes, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i)
      if (number[std::size_t(nodes[i])] < 0) return false;
    return true;
  };
  const auto renumber = [&](auto nodes) {
    for (int& n : nodes) n = n < 0 ? n : number[std::size_t(n)];
    return nodes;
  };
  for (const auto& t : whole.tets)
    if (keep(t, std::size_t(whole.nodes_per_tet()))) s.mesh.tets.push_back(renumber(t));
  for (const BoundaryFace& f : whole.faces)
    if (keep(f.nodes, std::size_t(whole.nodes_per_face()))) s.mesh.faces.push_back({renumber(f.nodes), f.patch});
  return s;
}

namespace detail {

template <class T, class Flip>
std::vector<T> unfolded(const TetMesh& whole, const Sector& sector, const std::vector<T>& field, Flip flip) {
  std::vector<T> all(whole.nodes.size());
  for (std::size_t k = 0; k < field.size(); ++k) all[std::size_t(sector.to_whole[k])] = field[k];
  const auto reflect = [&](const std::vector<int>& partner, int axis) {
    for (std::size_t k = 0; k < whole.nodes.size(); ++k)
      if (whole.nodes[k][axis] < 0.0) all[k] = flip(all[std::size_t(partner[k])], axis);
  };
  if (sector.planes.x) reflect(whole.mirror_x, 0);
  if (sector.planes.y) reflect(whole.mirror_y, 1);
  return all;
}

}  // namespace detail

inline std::vector<Vec3> unfold(const TetMesh& whole, const Sector& sector, const std::vector<Vec3>& field) {
  return detail::unfolded(whole, sector, field, [](Vec3 v, int axis) {
    v[axis] = -v[axis];
    return v;
  });
}

inline std::vector<double> unfold(const TetMesh& whole, const Sector& sector, const std::vector<double>& field) {
  return detail::unfolded(whole, sector, field, [](double v, int) { return v; });
}

}  // namespace lumo

// ---- lumo/mechanics/equations.hpp

namespace lumo {

/// How a displacement field behaves under reflection in the planes that bound a sector.
struct Parity {
  bool odd_x = false;
  bool odd_y = false;
  bool operator==(const Parity&) const = default;
};

/// Numbers the free displacement components of a sector's nodes, and holds the sparsity pattern of its tangent.
/// Bonded faces are closed sets: all their nodes are fixed. On a bounding plane an even field has no normal component and an odd
/// field has only that one.
struct Equations {
  std::vector<int> of;      ///< 3 · node + component → equation, −1 where fixed
  int count = 0;
  SparseLower pattern;      ///< lower triangle; values are scratch
  std::vector<int> slots;   ///< per tet, (3N)(3N+1)/2 positions in the pattern's values (row ≥ column, column by column), −1 where fixed

  Equations(const Sector& sector, const Body& body, Parity parity);

  /// Position in the pattern's values of an entry of the lower triangle.
  int slot(int row, int column) const;
};

inline int Equations::slot(int row, int column) const {
  if (row < column) std::swap(row, column);
  const int* begin = pattern.innerIndexPtr() + pattern.outerIndexPtr()[column];
  const int* end = pattern.innerIndexPtr() + pattern.outerIndexPtr()[column + 1];
  return int(std::lower_bound(begin, end, row) - pattern.innerIndexPtr());
}

inline Equations::Equations(const Sector& sector, const Body& body, Parity parity) {
  const TetMesh& mesh = sector.mesh;
  const std::size_t n = mesh.nodes.size();
  std::vector<char> fixed(3 * n, 0);
  for (const BoundaryFace& f : mesh.faces)
    if (body.patches[std::size_t(f.patch)].bonded)
      for (int k = 0; k < mesh.nodes_per_face(); ++k)
        for (std::size_t c = 0; c < 3; ++c) fixed[3 * std::size_t(f.nodes[std::size_t(k)]) + c] = 1;
  const auto bound = [&](std::size_t node, std::size_t axis, bool odd) {
    for (std::size_t c = 0; c < 3; ++c)
      if ((c == axis) != odd) fixed[3 * node + c] = 1;
  };
  for (std::size_t k = 0; k < n; ++k) {
    if (sector.planes.x && mesh.nodes[k].x() == 0.0) bound(k, 0, parity.odd_x);
    if (sector.planes.y && mesh.nodes[k].y() == 0.0) bound(k, 1, parity.odd_y);
  }
  of.assign(3 * n, -1);
  for (std::size_t i = 0; i < 3 * n; ++i)
    if (!fixed[i]) of[i] = count++;

  // Node graph first (compact), then the equations of each pair of nodes.
  const std::size_t per = std::size_t(mesh.nodes_per_tet());
  std::vector<std::vector<int>> near(n);
  for (const auto& t : mesh.tets)
    for (std::size_t a = 0; a < per; ++a)
      for (std::size_t b = 0; b < per; ++b) near[std::size_t(t[a])].push_back(t[b]);
  for (auto& list : near) {
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
  }
  std::vector<int> starts{0}, rows;
  for (std::size_t k = 0; k < n; ++k)
    for (std::size_t c = 0; c < 3; ++c) {
      const int column = of[3 * k + c];
      if (column < 0) continue;
      for (int other : near[k])
        for (std::size_t d = 0; d < 3; ++d)
          if (const int row = of[3 * std::size_t(other) + d]; row >= column) rows.push_back(row);
      starts.push_back(int(rows.size()));
    }
  const std::vector<double> zeros(rows.size(), 0.0);
  pattern = Eigen::Map<const SparseLower>(count, count, int(rows.size()), starts.data(), rows.data(), zeros.data());

  slots.reserve(mesh.tets.size() * (3 * per) * (3 * per + 1) / 2);
  for (const auto& t : mesh.tets)
    for (std::size_t j = 0; j < 3 * per; ++j)
      for (std::size_t i = j; i < 3 * per; ++i) {
        const int row = of[3 * std::size_t(t[i / 3]) + i % 3], column = of[3 * std::size_t(t[j / 3]) + j % 3];
        slots.push_back(row < 0 || column < 0 ? -1 : slot(row, column));
      }
}

}  // namespace lumo

// ---- lumo/mechanics/element.hpp

namespace lumo {

/// A tetrahedral finite element: shape functions and quadrature on the reference tetrahedron λ₁, λ₂, λ₃ ≥ 0, λ₁ + λ₂ + λ₃ ≤ 1.
/// Laws: shape functions sum to one, reproduce every polynomial of their order, and the weights sum to 1/6.
template <class E>
concept TetElement = requires(const E& element, const Vec3& xi) {
  requires E::order == 1 || E::order == 2;
  requires E::nodes == (E::order == 1 ? 4 : 10);
  requires E::points >= 1;
  { E::point(0) } -> std::convertible_to<Vec3>;
  { E::weight(0) } -> std::convertible_to<double>;
  { element.mean_dilatation } -> std::convertible_to<bool>;
};

/// Quadratic tetrahedron; with `mean_dilatation` its volumetric energy sees the element's mean of J, which cures locking near
/// incompressibility (Nagtegaal, Parks, Rice 1974). Four-point quadrature of degree 2.
struct QuadraticTet {
  static constexpr int order = 2;
  static constexpr int nodes = 10;
  static constexpr int points = 4;
  bool mean_dilatation = true;

  static Vec3 point(int q) {
    constexpr double a = 0.58541019662496845446, b = 0.13819660112501051518;
    return {q == 1 ? a : b, q == 2 ? a : b, q == 3 ? a : b};
  }
  static double weight(int) { return 1.0 / 24.0; }
};

/// Linear tetrahedron: locks at ν = 0.495 (20–60 % too stiff on pads like LUMO's). Offered for comparison with codes that use it.
struct LinearTet {
  static constexpr int order = 1;
  static constexpr int nodes = 4;
  static constexpr int points = 1;
  bool mean_dilatation = false;

  static Vec3 point(int) { return Vec3::Constant(0.25); }
  static double weight(int) { return 1.0 / 6.0; }
};

static_assert(TetElement<QuadraticTet> && TetElement<LinearTet>);

/// Gradients of the shape functions by (λ₁, λ₂, λ₃) at xi, 3 × nodes, in the node order of TetMesh.
template <int Nodes>
Eigen::Matrix<double, 3, Nodes> shape_gradients(const Vec3& xi) {
  Eigen::Matrix<double, 3, 4> corner;
  corner << -1, 1, 0, 0, -1, 0, 1, 0, -1, 0, 0, 1;
  if constexpr (Nodes == 4) {
    return corner;
  } else {
    const std::array<double, 4> l = {1.0 - xi.sum(), xi.x(), xi.y(), xi.z()};
    static constexpr int ends[6][2] = {{0, 1}, {1, 2}, {0, 2}, {0, 3}, {1, 3}, {2, 3}};
    Eigen::Matrix<double, 3, Nodes> g;
    for (int k = 0; k < 4; ++k) g.col(k) = (4.0 * l[std::size_t(k)] - 1.0) * corner.col(k);
    for (int e = 0; e < 6; ++e)
      g.col(4 + e) = 4.0 * (l[std::size_t(ends[e][1])] * corner.col(ends[e][0]) + l[std::size_t(ends[e][0])] * corner.col(ends[e][1]));
    return g;
  }
}

/// Shape functions of the six-node (or three-node) boundary triangle at barycentric (1−u−v, u, v), in the node order of BoundaryFace.
inline std::array<double, 6> face_shape(double u, double v, int order) {
  const double w = 1.0 - u - v;
  if (order == 1) return {w, u, v, 0.0, 0.0, 0.0};
  return {w * (2 * w - 1), u * (2 * u - 1), v * (2 * v - 1), 4 * w * u, 4 * u * v, 4 * v * w};
}

/// Derivatives of face_shape by u and v.
inline std::array<std::array<double, 2>, 6> face_shape_derivatives(double u, double v, int order) {
  if (order == 1) return {{{-1, -1}, {1, 0}, {0, 1}, {0, 0}, {0, 0}, {0, 0}}};
  const double w = 1.0 - u - v;
  return {{{1 - 4 * w, 1 - 4 * w}, {4 * u - 1, 0}, {0, 4 * v - 1}, {4 * (w - u), -4 * u}, {4 * v, 4 * u}, {-4 * v, 4 * (w - v)}}};
}

}  // namespace lumo

// ---- lumo/mechanics/solid.hpp

namespace lumo {

/// Deformed node positions, 3 × nodes [m].
using Positions = Eigen::Matrix3Xd;

inline Positions positions_of(const TetMesh& mesh) {
  Positions x(3, Eigen::Index(mesh.nodes.size()));
  for (std::size_t k = 0; k < mesh.nodes.size(); ++k) x.col(Eigen::Index(k)) = mesh.nodes[k];
  return x;
}

/// The elastic energy of a tetrahedral mesh with its first and second derivatives.
template <HyperelasticMaterial Material, TetElement Element>
class Solid {
 public:
  static constexpr int N = Element::nodes;
  using Gradients = Eigen::Matrix<double, 3, N>;

  Solid(const TetMesh& mesh, Material material, Element element) : mesh_(&mesh), material_(material), element_(element) {
    if (mesh.order < Element::order) throw InvalidArgument("a quadratic element needs a quadratic mesh");
    gradients_.reserve(mesh.tets.size() * Element::points);
    for (const auto& t : mesh.tets)
      for (int q = 0; q < Element::points; ++q) {
        const Gradients by_xi = shape_gradients<N>(Element::point(q));
        Mat3 jacobian = Mat3::Zero();
        for (int a = 0; a < N; ++a) jacobian += mesh.nodes[std::size_t(t[std::size_t(a)])] * by_xi.col(a).transpose();
        gradients_.push_back(jacobian.inverse().transpose() * by_xi);
        weights_.push_back(Element::weight(q) * jacobian.determinant());
      }
  }

  /// Stored energy [J]; +∞ when an element is inverted at a quadrature point.
  double energy(const Positions& x) const {
    double sum = 0.0;
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e) {
      const ElementState s = state(e, x);
      for (int q = 0; q < Element::points; ++q) {
        sum += weight(e, q) * material_.distortion_energy(s.F[std::size_t(q)]);
        if (!element_.mean_dilatation) sum += weight(e, q) * material_.volumetric(s.J[std::size_t(q)]).energy;
      }
      if (element_.mean_dilatation) sum += s.volume * material_.volumetric(s.mean_J).energy;
      if (!std::isfinite(sum)) return std::numeric_limits<double>::infinity();
    }
    return sum;
  }

  /// Volume ratios that the volumetric energy sees: one per element with the locking cure, else one per quadrature point.
  std::vector<double> volume_ratios(const Positions& x) const {
    std::vector<double> J;
    J.reserve(mesh_->tets.size() * cells());
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e) {
      const ElementState s = state(e, x);
      if (element_.mean_dilatation) J.push_back(s.mean_J);
      else J.insert(J.end(), s.J.begin(), s.J.end());
    }
    return J;
  }

  /// The same, carried on by the displacement dx along the slope that they have at the positions `linear`.
  std::vector<double> predicted_ratios(const Positions& x, const Positions& linear, const Positions& dx) const {
    std::vector<double> J = volume_ratios(x);
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e) {
      const ElementState s = state(e, linear);
      for (int q = 0; q < Element::points; ++q) {
        const Eigen::Matrix<double, 3, N> slope = cofactor(s.F[std::size_t(q)]) * gradient(e, q);
        double rate = 0.0;
        for (int a = 0; a < N; ++a) rate += dx.col(node(e, a)).dot(slope.col(a));
        if (element_.mean_dilatation) J[e] += weight(e, q) / s.volume * rate;
        else J[e * cells() + std::size_t(q)] += rate;
      }
    }
    return J;
  }

  /// Adds the nodal forces ∂energy/∂x [N] to `force` (3 × nodes). With `seen` volume ratios the volumetric stress is linearised about
  /// them, U'(θ) + U''(θ)(J − θ): see QuasiStatic.
  void add_forces(const Positions& x, Positions& force, const std::vector<double>* seen = nullptr) const {
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e) {
      const ElementState s = state(e, x);
      Gradients f = Gradients::Zero();
      for (int q = 0; q < Element::points; ++q) {
        const double J = element_.mean_dilatation ? s.mean_J : s.J[std::size_t(q)], theta = ratio(e, q, s, seen);
        const VolumetricSample u = material_.volumetric(theta);
        const Mat3& F = s.F[std::size_t(q)];
        f += weight(e, q) * (material_.distortion_stress(F) + (u.stress + u.stiffness * (J - theta)) * cofactor(F)) * gradient(e, q);
      }
      for (int a = 0; a < N; ++a) force.col(node(e, a)) += f.col(a);
    }
  }

  /// Adds the tangent [N/m] to the values of each system's lower triangle; the element matrices are made once for all.
  void add_tangent(const Positions& x, const std::vector<const Equations*>& systems, const std::vector<double*>& values,
                   const std::vector<double>* seen = nullptr) const {
    constexpr int size = 3 * N;
    Eigen::Matrix<double, size, size> K;
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e) {
      element_tangent(e, x, seen, K);
      for (std::size_t k = 0; k < systems.size(); ++k) {
        const int* slot = systems[k]->slots.data() + e * (size * (size + 1) / 2);
        double* v = values[k];
        for (int j = 0; j < size; ++j)
          for (int i = j; i < size; ++i, ++slot)
            if (*slot >= 0) v[*slot] += K(i, j);
      }
    }
  }

  /// Smallest det F over all quadrature points.
  double smallest_J(const Positions& x) const {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e)
      for (double J : state(e, x).J) least = std::min(least, J);
    return least;
  }

  const Material& material() const { return material_; }

 private:
  struct ElementState {
    std::array<Mat3, std::size_t(Element::points)> F;
    std::array<double, std::size_t(Element::points)> J;
    double volume = 0.0;
    double mean_J = 0.0;
  };

  int node(std::size_t e, int a) const { return mesh_->tets[e][std::size_t(a)]; }
  double weight(std::size_t e, int q) const { return weights_[e * Element::points + std::size_t(q)]; }
  const Gradients& gradient(std::size_t e, int q) const { return gradients_[e * Element::points + std::size_t(q)]; }

  ElementState state(std::size_t e, const Positions& x) const {
    Eigen::Matrix<double, 3, N> local;
    for (int a = 0; a < N; ++a) local.col(a) = x.col(node(e, a));
    ElementState s;
    for (int q = 0; q < Element::points; ++q) {
      const std::size_t k = std::size_t(q);
      s.F[k].noalias() = local * gradient(e, q).transpose();
      s.J[k] = s.F[k].determinant();
      s.volume += weight(e, q);
      s.mean_J += weight(e, q) * s.J[k];
    }
    s.mean_J /= s.volume;
    return s;
  }

  std::size_t cells() const { return element_.mean_dilatation ? 1 : std::size_t(Element::points); }

  // Volume ratio that the volumetric energy is taken at.
  double ratio(std::size_t e, int q, const ElementState& s, const std::vector<double>* seen) const {
    if (seen) return (*seen)[e * cells() + (element_.mean_dilatation ? 0 : std::size_t(q))];
    return element_.mean_dilatation ? s.mean_J : s.J[std::size_t(q)];
  }

  void element_tangent(std::size_t e, const Positions& x, const std::vector<double>* seen, Eigen::Matrix<double, 3 * N, 3 * N>& K) const {
    const ElementState s = state(e, x);
    Eigen::Matrix<double, 3 * N, 1> dJ = Eigen::Matrix<double, 3 * N, 1>::Zero();  // V ∂(mean J)/∂x
    K.setZero();
    for (int q = 0; q < Element::points; ++q) {
      const Mat3& F = s.F[std::size_t(q)];
      const Gradients& g = gradient(e, q);
      const Mat3 c = cofactor(F);
      const VolumetricSample u = material_.volumetric(ratio(e, q, s, seen));
      Mat9 A = material_.distortion_tangent(F) + u.stress * determinant_hessian(F);
      if (element_.mean_dilatation) {
        Eigen::Map<Gradients>(dJ.data()) += weight(e, q) * c * g;
      } else {
        const Eigen::Map<const Eigen::Matrix<double, 9, 1>> flat(c.data());
        A += u.stiffness * flat * flat.transpose();
      }
      A *= weight(e, q);
      for (int a = 0; a < N; ++a) {
        Eigen::Matrix<double, 9, 3> T = A.template leftCols<3>() * g(0, a);
        T += A.template middleCols<3>(3) * g(1, a);
        T += A.template rightCols<3>() * g(2, a);
        for (int b = a; b < N; ++b)
          K.template block<3, 3>(3 * b, 3 * a) += g(0, b) * T.template topRows<3>() + g(1, b) * T.template middleRows<3>(3) + g(2, b) * T.template bottomRows<3>();
      }
    }
    if (element_.mean_dilatation)
      K.template selfadjointView<Eigen::Lower>().rankUpdate(dJ, material_.volumetric(ratio(e, 0, s, seen)).stiffness / s.volume);
  }

  const TetMesh* mesh_;
  Material material_;
  Element element_;
  std::vector<Gradients, Eigen::aligned_allocator<Gradients>> gradients_;  // per tet and point
  std::vector<double> weights_;                                           // volumes [m³]
};

}  // namespace lumo

// ---- lumo/mechanics/contact_surface.hpp

namespace lumo {

/// A point of the surface at which the gap is taken: shape functions of its face there, and its share of the reference area.
struct SurfacePoint {
  std::array<double, 6> shape;
  double area_m2;
  int part;                     ///< which of the face's four sub-triangles (one in a linear mesh) it lies in
  std::array<double, 3> hat;    ///< barycentric coordinates in that sub-triangle
};

/// Corners of a face's sub-triangles, as places in BoundaryFace::nodes.
inline const std::array<std::array<int, 3>, 4>& face_parts() {
  static constexpr std::array<std::array<int, 3>, 4> parts = {{{0, 3, 5}, {3, 1, 4}, {5, 4, 2}, {3, 4, 5}}};
  return parts;
}

/// Part of a mesh's surface that may come into contact, with its quadrature.
class ContactSurface {
 public:
  /// Faces of the patches for which `chosen` holds.
  template <class Choose>
  ContactSurface(const TetMesh& mesh, const Body& body, Choose chosen) : mesh_(&mesh) {
    for (const BoundaryFace& f : mesh.faces)
      if (chosen(body.patches[std::size_t(f.patch)])) add(f);
  }

  std::size_t size() const { return faces_.size(); }
  const BoundaryFace& face(std::size_t f) const { return faces_[f]; }
  const std::vector<SurfacePoint>& points(std::size_t f) const { return points_[f]; }

  Vec3 position(std::size_t f, const SurfacePoint& p, const Positions& x) const {
    Vec3 at = Vec3::Zero();
    for (std::size_t k = 0; k < std::size_t(mesh_->nodes_per_face()); ++k) at += p.shape[k] * x.col(faces_[f].nodes[k]);
    return at;
  }

  /// A ball that holds the deformed face: its midpoint and radius. The face stays in the hull of its Bézier points.
  std::pair<Vec3, double> ball(std::size_t f, const Positions& x) const {
    const auto& n = faces_[f].nodes;
    const Vec3 a = x.col(n[0]), b = x.col(n[1]), c = x.col(n[2]);
    const Vec3 middle = (a + b + c) / 3.0;
    double r = std::max({(a - middle).norm(), (b - middle).norm(), (c - middle).norm()});
    if (mesh_->order == 2)
      for (std::size_t k = 0; k < 3; ++k)
        r = std::max(r, (2.0 * x.col(n[3 + k]) - 0.5 * x.col(n[k]) - 0.5 * x.col(n[(k + 1) % 3]) - middle).norm());
    return {middle, r};
  }

  int nodes_per_face() const { return mesh_->nodes_per_face(); }

 private:
  void add(const BoundaryFace& face);

  const TetMesh* mesh_;
  std::vector<BoundaryFace> faces_;
  std::vector<std::vector<SurfacePoint>> points_;
};

/// Contact energy, forces and stiffness between a surface and one rigid thing, for a given signed distance.
struct ContactSums {
  double energy = 0.0;        ///< [J]
  double push_N = 0.0;        ///< force on the indenter along −direction: −∂energy/∂advance … with the sign of a reaction
  double push_stiffness = 0.0;///< ∂²energy/∂advance² [N/m]
  double penetration_m = 0.0; ///< largest overlap
};

inline void ContactSurface::add(const BoundaryFace& face) {
  const int order = mesh_->order;
  std::vector<SurfacePoint> points;
  // Corners of the sub-triangles in (u, v); each is quartered once more and takes the three-point rule there.
  const std::array<std::array<double, 2>, 6> uv = {{{0, 0}, {1, 0}, {0, 1}, {0.5, 0}, {0.5, 0.5}, {0, 0.5}}};
  const std::array<std::array<double, 3>, 6> quarter = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {.5, .5, 0}, {0, .5, .5}, {.5, 0, .5}}};
  const int parts = order == 2 ? 4 : 1;
  for (int part = 0; part < parts; ++part) {
    const std::array<int, 3> corner = order == 2 ? face_parts()[std::size_t(part)] : std::array<int, 3>{0, 1, 2};
    for (const auto& small : face_parts())
      for (int q = 0; q < 3; ++q) {
        SurfacePoint p{};
        p.part = part;
        for (std::size_t k = 0; k < 3; ++k)
          for (std::size_t m = 0; m < 3; ++m) p.hat[m] += (int(k) == q ? 2.0 / 3.0 : 1.0 / 6.0) * quarter[std::size_t(small[k])][m];
        double u = 0.0, v = 0.0;
        for (std::size_t m = 0; m < 3; ++m) u += p.hat[m] * uv[std::size_t(corner[m])][0], v += p.hat[m] * uv[std::size_t(corner[m])][1];
        p.shape = face_shape(u, v, order);
        const auto d = face_shape_derivatives(u, v, order);
        Vec3 by_u = Vec3::Zero(), by_v = Vec3::Zero();
        for (std::size_t k = 0; k < std::size_t(mesh_->nodes_per_face()); ++k) {
          by_u += d[k][0] * mesh_->nodes[std::size_t(face.nodes[k])];
          by_v += d[k][1] * mesh_->nodes[std::size_t(face.nodes[k])];
        }
        p.area_m2 = by_u.cross(by_v).norm() * 0.5 / (12.0 * parts);
        points.push_back(p);
      }
  }
  faces_.push_back(face);
  points_.push_back(std::move(points));
}

/// A rigid thing that moves by `advance` along `direction`: anything with distance(p) and sample(p) in its own frame.
template <class Tool>
struct Moving {
  const Tool* tool;
  Vec3 origin;      ///< of the tool's frame, now [m]
  Vec3 direction;   ///< of its advance, unit

  double distance(const Vec3& p) const { return tool->distance(p - origin); }
  DistanceSample sample(const Vec3& p) const { return tool->sample(p - origin); }
};

namespace detail {

// Calls visit(face, point number, point, position) for the surface points that can be in contact: those of faces that the rigid thing
// reaches, or all when the law sees other gaps than the present ones.
template <class Tool, class Visit>
void for_contact_points(const ContactSurface& surface, const Positions& x, const Moving<Tool>& rigid, const std::vector<std::vector<double>>* seen, Visit&& visit) {
  for (std::size_t f = 0; f < surface.size(); ++f) {
    const auto [middle, radius] = surface.ball(f, x);
    const bool near = rigid.distance(middle) <= radius;
    if (!near && !(seen && std::any_of((*seen)[f].begin(), (*seen)[f].end(), [](double g) { return g < 0.0; }))) continue;
    const std::vector<SurfacePoint>& points = surface.points(f);
    for (std::size_t k = 0; k < points.size(); ++k) visit(f, k, points[k], surface.position(f, points[k], x));
  }
}

}  // namespace detail

/// Gaps [m] that the contact law sees at each surface point, face by face; see QuasiStatic.
using SeenGaps = std::vector<std::vector<double>>;

/// Adds the contact energy and forces; `force` (3 × nodes) receives ∂energy/∂x. With `seen` gaps γ the pressure is linearised about them,
/// p(γ) + p'(γ)(g − γ), so that points keep pulling or stay free until the next step says otherwise; the energy is not meant then.
template <ContactHandler Contact, class Tool>
ContactSums add_contact_forces(const ContactSurface& surface, const Contact& contact, const Moving<Tool>& rigid, const Positions& x, Positions* force,
                               const SeenGaps* seen = nullptr) {
  ContactSums sums;
  detail::for_contact_points(surface, x, rigid, seen, [&](std::size_t f, std::size_t k, const SurfacePoint& p, const Vec3& at) {
    const double gap = rigid.distance(at), gamma = seen ? (*seen)[f][k] : gap;
    if (gap < 0.0) sums.penetration_m = std::max(sums.penetration_m, -gap);
    if (gamma >= 0.0) return;
    const ContactResponse r = contact.respond(gamma);
    sums.energy += p.area_m2 * r.energy;
    const Vec3 traction = p.area_m2 * (r.pressure + r.stiffness * (gamma - gap)) * rigid.sample(at).gradient;
    sums.push_N += traction.dot(rigid.direction);
    if (!force) return;
    for (std::size_t n = 0; n < std::size_t(surface.nodes_per_face()); ++n) force->col(surface.face(f).nodes[n]) -= p.shape[n] * traction;
  });
  return sums;
}

/// Adds the contact stiffness to a system's lower triangle; `coupling` (one per equation) receives ∂²energy/∂x∂advance.
template <ContactHandler Contact, class Tool>
ContactSums add_contact_tangent(const ContactSurface& surface, const Contact& contact, const Moving<Tool>& rigid, const Positions& x, const Equations& eq,
                                double* values, Eigen::VectorXd* coupling, const SeenGaps* seen = nullptr) {
  ContactSums sums;
  const std::size_t nodes = std::size_t(surface.nodes_per_face());
  Eigen::Matrix<double, 18, 18> K;
  std::size_t open = std::size_t(-1);
  const auto flush = [&] {
    if (open == std::size_t(-1)) return;
    const auto& n = surface.face(open).nodes;
    for (std::size_t j = 0; j < 3 * nodes; ++j)
      for (std::size_t i = 0; i < 3 * nodes; ++i) {
        const int row = eq.of[3 * std::size_t(n[i / 3]) + i % 3], column = eq.of[3 * std::size_t(n[j / 3]) + j % 3];
        if (row >= column && column >= 0) values[eq.slot(row, column)] += K(Eigen::Index(i), Eigen::Index(j));
      }
  };
  detail::for_contact_points(surface, x, rigid, seen, [&](std::size_t f, std::size_t k, const SurfacePoint& p, const Vec3& at) {
    const double gamma = seen ? (*seen)[f][k] : rigid.distance(at);
    if (gamma >= 0.0) return;
    if (f != open) {
      flush();
      open = f;
      K.setZero();
    }
    const DistanceSample d = rigid.sample(at);
    const ContactResponse r = contact.respond(gamma);
    const Mat3 block = p.area_m2 * (r.stiffness * d.gradient * d.gradient.transpose() - r.pressure * d.hessian);
    sums.push_stiffness += rigid.direction.dot(block * rigid.direction);
    for (std::size_t a = 0; a < nodes; ++a) {
      for (std::size_t b = 0; b < nodes; ++b)
        K.template block<3, 3>(Eigen::Index(3 * a), Eigen::Index(3 * b)) += p.shape[a] * p.shape[b] * block;
      if (!coupling) continue;
      const Vec3 c = -p.shape[a] * (block * rigid.direction);
      for (std::size_t i = 0; i < 3; ++i)
        if (const int row = eq.of[3 * std::size_t(surface.face(f).nodes[a]) + i]; row >= 0) (*coupling)[row] += c[Eigen::Index(i)];
    }
  });
  flush();
  return sums;
}

/// Gaps at all surface points, carried on by the displacement dx and the advance ds along the slope that they have at the positions
/// `linear` with the rigid thing at `then`.
template <class Tool>
SeenGaps predicted_gaps(const ContactSurface& surface, const Moving<Tool>& now, const Positions& x, const Moving<Tool>& then, const Positions& linear,
                        const Positions& dx, double ds) {
  SeenGaps gaps(surface.size());
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (const SurfacePoint& p : surface.points(f))
      gaps[f].push_back(now.distance(surface.position(f, p, x)) +
                        then.sample(surface.position(f, p, linear)).gradient.dot(surface.position(f, p, dx) - ds * now.direction));
  return gaps;
}

}  // namespace lumo

// ---- lumo/mechanics/contact_set.hpp

namespace lumo {

/// Contact field and pressure per mesh node; see MechanicalState.
struct ContactField {
  std::vector<double> field;        ///< > 0 in contact
  std::vector<double> pressure_Pa;
};

/// Reference area of the intersection and of the union of two contact sets [m²].
struct SetOverlap {
  double both = 0.0;
  double either = 0.0;
  /// Intersection over union; 1 for two empty sets.
  double ratio() const { return either > 0.0 ? both / either : 1.0; }
};

/// Signed distance φ [m] to the edge of contact, > 0 inside, at the surface's nodes, and the pressure lumped there. Raw overlaps are no
/// measure of contact: they are a few µm and perforated by the facets' sag. Outside, the gap of a smooth contact grows as the distance to its
/// edge to the power 3/2 (Hertz 1882; Johnson 1985, §4.2), so g^(2/3), scaled by its own slope, *is* that distance; inside it is continued linearly.
template <ContactHandler Contact, class Tool>
ContactField contact_field(const TetMesh& mesh, const ContactSurface& surface, const Contact& contact, const Moving<Tool>& rigid, const Positions& x);

/// Area of {φ > 0} on the given node positions: undeformed ones give A_0(C), deformed ones A(C; X) [m²].
double contact_area(const ContactSurface& surface, const std::vector<double>& field, const Positions& x);

/// Overlap of {φ_a > 0} and {φ_b > 0}, measured on the given node positions.
SetOverlap contact_overlap(const ContactSurface& surface, const std::vector<double>& a, const std::vector<double>& b, const Positions& x);

namespace detail {

// A convex polygon in the barycentric plane of a triangle, with the values of the fields at its corners.
struct ClipPolygon {
  struct Corner {
    double u, v;
    std::array<double, 2> field;
  };
  std::vector<Corner> corners;

  /// Keeps the part where field `k` is positive (Sutherland and Hodgman 1974).
  void clip(std::size_t k) {
    std::vector<Corner> kept;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const Corner &a = corners[i], &b = corners[(i + 1) % corners.size()];
      if (a.field[k] > 0.0) kept.push_back(a);
      if ((a.field[k] > 0.0) != (b.field[k] > 0.0)) {
        const double t = a.field[k] / (a.field[k] - b.field[k]);
        kept.push_back({a.u + t * (b.u - a.u), a.v + t * (b.v - a.v), {a.field[0] + t * (b.field[0] - a.field[0]), a.field[1] + t * (b.field[1] - a.field[1])}});
      }
    }
    corners = std::move(kept);
  }
  /// Part of the triangle's area that it covers.
  double fraction() const {
    double twice = 0.0;
    for (std::size_t i = 1; i + 1 < corners.size(); ++i)
      twice += (corners[i].u - corners[0].u) * (corners[i + 1].v - corners[0].v) - (corners[i + 1].u - corners[0].u) * (corners[i].v - corners[0].v);
    return std::abs(twice);
  }
};

// Calls visit(area, a at the corners, b at the corners) for every sub-triangle of the surface.
template <class Visit>
void for_sub_triangles(const ContactSurface& surface, const Positions& x, Visit&& visit) {
  const std::size_t parts = surface.nodes_per_face() == 6 ? 4 : 1;
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (std::size_t part = 0; part < parts; ++part) {
      std::array<int, 3> node;
      for (std::size_t k = 0; k < 3; ++k) node[k] = surface.face(f).nodes[parts == 4 ? std::size_t(face_parts()[part][k]) : k];
      const Vec3 a = x.col(node[0]), b = x.col(node[1]), c = x.col(node[2]);
      visit(0.5 * (b - a).cross(c - a).norm(), node);
    }
}

// A point of the edge of contact with the direction in which the gap opens there.
struct EdgeSample {
  Vec3 point;
  Vec3 outward;
  double spacing;   // of the nodes about it
};

// Every free sub-triangle near the edge looks along the slope of G = g^(2/3), which falls to zero at the edge of contact. With
// G = αρ + βρ² the squared slope is linear in G, so that a local fit of slope² over G gives α, and the distance is 2 G / (α + slope).
inline std::vector<EdgeSample> edge_of_contact(const ContactSurface& surface, const Positions& x, const std::vector<double>& gap, double tolerance) {
  struct Free {
    Vec3 middle, outward;
    double power, slope, spacing;
  };
  std::vector<Free> free;
  for_sub_triangles(surface, x, [&](double area, const std::array<int, 3>& node) {
    std::array<double, 3> power;
    for (std::size_t k = 0; k < 3; ++k) {
      const double g = gap[std::size_t(node[k])];
      if (!(g > tolerance)) return;
      power[k] = std::cbrt(g * g);
    }
    const Vec3 e1 = x.col(node[1]) - x.col(node[0]), e2 = x.col(node[2]) - x.col(node[0]);
    const Vec3 normal = e1.cross(e2);
    const Vec3 gradient = ((power[1] - power[0]) * e2.cross(normal) + (power[2] - power[0]) * normal.cross(e1)) / normal.squaredNorm();
    const Free f{(x.col(node[0]) + x.col(node[1]) + x.col(node[2])) / 3.0, gradient.normalized(), (power[0] + power[1] + power[2]) / 3.0, gradient.norm(),
                 std::sqrt(2.3 * area)};
    if (f.slope > 0.0 && f.power < 4.0 * f.spacing * f.slope) free.push_back(f);
  });
  std::vector<EdgeSample> samples;
  for (const Free& f : free) {
    // Too near, the kink inside a facet disturbs the gap; too far, the fit has to reach too far.
    if (f.power < 0.25 * f.spacing * f.slope || f.power > 2.0 * f.spacing * f.slope) continue;
    double w = 0.0, g = 0.0, s = 0.0, gg = 0.0, gs = 0.0;
    for (const Free& other : free) {
      const double t = (other.middle - f.middle).squaredNorm() / (16.0 * f.spacing * f.spacing);
      if (t >= 1.0 || other.power < 0.25 * other.spacing * other.slope) continue;
      const double k = std::pow(1.0 - t, 2), square = other.slope * other.slope;
      w += k, g += k * other.power, s += k * square, gg += k * other.power * other.power, gs += k * other.power * square;
    }
    const double spread = gg - g * g / w;
    const double bend = spread > 1e-9 * gg ? (gs - g * s / w) / spread : 0.0;
    const double start = std::max((s - bend * g) / w, 0.25 * s / w), here = std::max(start + bend * f.power, 0.25 * s / w);
    samples.push_back({f.middle - 2.0 * f.power / (std::sqrt(start) + std::sqrt(here)) * f.outward, f.outward, f.spacing});
  }
  return samples;
}

// Signed distance (> 0 inside) from p to the circle that fits the samples about it best. Source: Guennebaud, Germann, Gross 2008
// (algebraic spheres through oriented points).
inline std::optional<double> distance_to_edge(const std::vector<EdgeSample>& samples, const Vec3& p) {
  double w = 0.0, pn = 0.0, pp = 0.0;
  Vec3 sum_p = Vec3::Zero(), sum_n = Vec3::Zero();
  for (const EdgeSample& s : samples) {
    const Vec3 d = s.point - p;
    const double t = d.squaredNorm() / (12.0 * s.spacing * s.spacing);
    if (t >= 1.0) continue;
    const double k = std::pow(1.0 - t, 4);
    w += k;
    sum_p += k * d;
    sum_n += k * s.outward;
    pn += k * d.dot(s.outward);
    pp += k * d.squaredNorm();
  }
  if (!(w > 0.0)) return std::nullopt;
  const double spread = pp - sum_p.squaredNorm() / w;
  const double q = spread > 1e-12 * pp ? 0.5 * (pn - sum_p.dot(sum_n) / w) / spread : 0.0;
  const Vec3 l = (sum_n - 2.0 * q * sum_p) / w;
  const double c = -(l.dot(sum_p) + q * pp) / w;
  // c + l·x + q x² at x = 0, turned into a distance along its slope; the circle's own root where it bends.
  const double root = l.squaredNorm() - 4.0 * q * c;
  if (!(root > 0.0)) return -c / std::max(l.norm(), 1e-300);
  return -2.0 * c / (l.norm() + std::sqrt(root));
}

}  // namespace detail

template <ContactHandler Contact, class Tool>
ContactField contact_field(const TetMesh& mesh, const ContactSurface& surface, const Contact& contact, const Moving<Tool>& rigid, const Positions& x) {
  const std::size_t n = mesh.nodes.size();
  std::vector<double> area(n, 0.0), gap(n, std::numeric_limits<double>::quiet_NaN()), spacing(n, 0.0);
  ContactField c{std::vector<double>(n, -std::numeric_limits<double>::infinity()), std::vector<double>(n, 0.0)};
  double overlap = 0.0;
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (const SurfacePoint& p : surface.points(f)) {
      const double g = rigid.distance(surface.position(f, p, x));
      overlap = std::max(overlap, -g);
      const std::array<int, 3> corner = mesh.order == 2 ? face_parts()[std::size_t(p.part)] : std::array<int, 3>{0, 1, 2};
      for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t node = std::size_t(surface.face(f).nodes[std::size_t(corner[k])]);
        area[node] += p.area_m2 * p.hat[k];
        c.pressure_Pa[node] += p.area_m2 * p.hat[k] * contact.respond(g).pressure;
      }
    }
  for (std::size_t k = 0; k < n; ++k) {
    if (area[k] <= 0.0) continue;
    c.pressure_Pa[k] /= area[k];
    spacing[k] = std::sqrt(1.15 * area[k]);
    gap[k] = rigid.distance(x.col(Eigen::Index(k)));
  }
  // Nodes that hang free by less than the overlap at other points of their facets are in contact.
  const double tolerance = 2.0 * overlap;
  const std::vector<detail::EdgeSample> edge = detail::edge_of_contact(surface, x, gap, tolerance);
  for (std::size_t k = 0; k < n; ++k) {
    if (area[k] <= 0.0) continue;
    const bool open = gap[k] > tolerance;
    const double far = open ? -gap[k] : spacing[k];
    double& field = c.field[k];
    field = detail::distance_to_edge(edge, x.col(Eigen::Index(k))).value_or(far);
    // The fit speaks for the edge's surroundings only; a node well on one side of it stays there.
    if ((field > 0.0) == open && std::abs(field) > 0.5 * spacing[k]) field = far;
  }
  return c;
}

inline SetOverlap contact_overlap(const ContactSurface& surface, const std::vector<double>& a, const std::vector<double>& b, const Positions& x) {
  SetOverlap sum;
  detail::for_sub_triangles(surface, x, [&](double area, const std::array<int, 3>& node) {
    const auto at = [&](std::size_t k) { return std::array<double, 2>{a[std::size_t(node[k])], b[std::size_t(node[k])]}; };
    const detail::ClipPolygon whole{{{0, 0, at(0)}, {1, 0, at(1)}, {0, 1, at(2)}}};
    detail::ClipPolygon in_a = whole, in_b = whole;
    in_a.clip(0);
    in_b.clip(1);
    detail::ClipPolygon in_both = in_a;
    in_both.clip(1);
    const double both = in_both.fraction();
    sum.both += area * both;
    sum.either += area * (in_a.fraction() + in_b.fraction() - both);
  });
  return sum;
}

inline double contact_area(const ContactSurface& surface, const std::vector<double>& field, const Positions& x) {
  return contact_overlap(surface, field, field, x).both;
}

}  // namespace lumo

// ---- lumo/mechanics/carrier.hpp

namespace lumo {

/// Signed distance to the union of a body's rigid boxes. The origin of its frame is the finger's.
struct Carrier {
  std::vector<RigidBox> boxes;

  double distance(const Vec3& p) const {
    double least = std::numeric_limits<double>::infinity();
    for (const RigidBox& b : boxes) least = std::min(least, to_box(b, p).distance);
    return least;
  }
  DistanceSample sample(const Vec3& p) const {
    DistanceSample nearest{std::numeric_limits<double>::infinity(), Vec3::UnitZ(), Mat3::Zero()};
    for (const RigidBox& b : boxes)
      if (const DistanceSample d = to_box(b, p); d.distance < nearest.distance) nearest = d;
    return nearest;
  }

 private:
  static DistanceSample to_box(const RigidBox& b, const Vec3& p) {
    const Vec3 local = p - b.center;
    const Vec3 sign = local.unaryExpr([](double v) { return v < 0.0 ? -1.0 : 1.0; });
    const Vec3 q = local.cwiseAbs() - b.half;
    int axis;
    if (const double inside = q.maxCoeff(&axis); inside <= 0.0) return {inside, sign[axis] * Vec3::Unit(axis), Mat3::Zero()};
    const Vec3 out = q.cwiseMax(0.0);
    const double r = out.norm();
    const Vec3 n = out / r;
    Mat3 h = Mat3::Zero();  // only the directions that are outside bend the distance
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        if (out[i] > 0.0 && out[j] > 0.0) h(i, j) = ((i == j ? 1.0 : 0.0) - n[i] * n[j]) / r * sign[i] * sign[j];
    return {r, n.cwiseProduct(sign), h};
  }
};

}  // namespace lumo

// ---- lumo/mechanics/press_system.hpp

namespace lumo {

/// All that does not change between scenarios on one sector of one mesh: elements, surfaces, equations, symbolic factors.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, LinearSolver Linear>
struct SectorModel {
  Sector sector;
  Body body;
  Contact contact;
  Solid<Material, Element> solid;
  ContactSurface touchable;        ///< against the indenter
  ContactSurface resting;          ///< against the carrier
  Carrier carrier;

  /// Equations of one parity with the symbolic factorisation of their tangent.
  struct Block {
    Equations equations;
    Linear analysed;
  };
  std::vector<Block> blocks;       ///< first the even fields, then every other parity of the bounding planes

  SectorModel(const Body& b, const TetMesh& mesh, Symmetry planes, const Material& material, const Contact& c, const Element& element)
      : sector(sector_of(mesh, planes)), body(b), contact(c), solid(sector.mesh, material, element),
        touchable(sector.mesh, b, [](const Patch& p) { return p.contactable; }),
        resting(sector.mesh, b, [](const Patch& p) { return p.meets_carrier; }), carrier{b.carrier} {
    for (int odd = 0; odd < 4; ++odd) {
      const Parity parity{(odd & 1) != 0, (odd & 2) != 0};
      if ((parity.odd_x && !planes.x) || (parity.odd_y && !planes.y)) continue;
      Block block{Equations(sector, body, parity), Linear{}};
      block.analysed.analyze(block.equations.pattern);
      blocks.push_back(std::move(block));
    }
  }
  SectorModel(const SectorModel&) = delete;  // the solid and the surfaces point into the sector's mesh
  SectorModel& operator=(const SectorModel&) = delete;
};

/// One scenario on one sector: energy, forces and tangent of pad and indenter as functions of positions x and advance s.
/// Loads are the sector's share of the whole load.
template <class Model, Indenter Tool>
struct PressSystem {
  const Model& model;
  const Tool& tool;
  Vec3 origin;      ///< of the indenter at first touch
  Vec3 direction;
  double firmness = 1.0;   ///< factor on all contact pressures; 1 but on the way to equilibrium

  Firmness<decltype(Model::contact)> contact() const { return {&model.contact, firmness}; }
  Moving<Tool> indenter(double advance) const { return {&tool, origin + advance * direction, direction}; }
  Moving<Carrier> support() const { return {&model.carrier, Vec3::Zero(), Vec3::UnitZ()}; }

  /// Elastic + contact energy − load · advance [J]; +∞ for an inverted element.
  double energy(const Positions& x, double advance, double load) const {
    const double elastic = model.solid.energy(x);
    if (!std::isfinite(elastic)) return elastic;
    return elastic + add_contact_forces(model.touchable, contact(), indenter(advance), x, nullptr).energy +
           add_contact_forces(model.resting, contact(), support(), x, nullptr).energy - load * advance;
  }

  /// What the stiff parts of the energy, volume and contact, are linearised about; see QuasiStatic.
  struct Seen {
    std::vector<double> ratios;
    SeenGaps touch, rest;
  };
  /// A configuration of pad and indenter.
  struct Place {
    Positions x;
    double advance = 0.0;
  };
  /// Values at `now`, carried on by (dx, ds) along the slopes at `linear`.
  Seen predicted(const Place& now, const Place& linear, const Positions& dx, double ds) const {
    return {model.solid.predicted_ratios(now.x, linear.x, dx),
            predicted_gaps(model.touchable, indenter(now.advance), now.x, indenter(linear.advance), linear.x, dx, ds),
            predicted_gaps(model.resting, support(), now.x, support(), linear.x, dx, 0.0)};
  }

  /// Out-of-balance force on the free equations and on the indenter.
  struct Residual {
    Eigen::VectorXd free;
    double advance = 0.0;       ///< push − load
    double norm() const { return std::sqrt(free.squaredNorm() + advance * advance); }
  };
  Residual residual(const Positions& x, double advance, double load, const Equations& eq, const Seen* seen = nullptr) const {
    Positions f = Positions::Zero(3, x.cols());
    model.solid.add_forces(x, f, seen ? &seen->ratios : nullptr);
    const ContactSums touch = add_contact_forces(model.touchable, contact(), indenter(advance), x, &f, seen ? &seen->touch : nullptr);
    add_contact_forces(model.resting, contact(), support(), x, &f, seen ? &seen->rest : nullptr);
    Residual r{Eigen::VectorXd(eq.count), touch.push_N - load};
    for (std::size_t i = 0; i < eq.of.size(); ++i)
      if (eq.of[i] >= 0) r.free[eq.of[i]] = f.data()[i];
    return r;
  }

  /// Tangents of several parities at once, the coupling of the even one to the advance, and the indenter's own stiffness.
  struct Tangent {
    std::vector<SparseLower> matrix;   ///< one per block asked for
    Eigen::VectorXd coupling;
    double stiffness = 0.0;
  };
  void tangent(const Positions& x, double advance, std::size_t first, std::size_t last, Tangent& t, const Seen* seen = nullptr) const {
    t.matrix.resize(last - first);
    std::vector<const Equations*> systems;
    std::vector<double*> values;
    for (std::size_t b = first; b < last; ++b) {
      const Equations& eq = model.blocks[b].equations;
      SparseLower& m = t.matrix[b - first];
      if (m.nonZeros() != eq.pattern.nonZeros()) m = eq.pattern;
      std::fill_n(m.valuePtr(), m.nonZeros(), 0.0);
      systems.push_back(&eq);
      values.push_back(m.valuePtr());
    }
    model.solid.add_tangent(x, systems, values, seen ? &seen->ratios : nullptr);
    for (std::size_t k = 0; k < systems.size(); ++k) {
      const bool even = first + k == 0;
      if (even) t.coupling = Eigen::VectorXd::Zero(systems[k]->count);
      const ContactSums s = add_contact_tangent(model.touchable, contact(), indenter(advance), x, *systems[k], values[k], even ? &t.coupling : nullptr,
                                                seen ? &seen->touch : nullptr);
      if (even) t.stiffness = s.push_stiffness;
      add_contact_tangent(model.resting, contact(), support(), x, *systems[k], values[k], nullptr, seen ? &seen->rest : nullptr);
    }
  }

  /// x moved by a field of the given equations.
  static void move(Positions& x, const Equations& eq, const Eigen::VectorXd& by, double factor) {
    for (std::size_t i = 0; i < eq.of.size(); ++i)
      if (eq.of[i] >= 0) x.data()[i] += factor * by[eq.of[i]];
  }
};

}  // namespace lumo

// ---- lumo/mechanics/status.hpp

namespace lumo {

/// How a solve ended. Only `converged` is scored (and `held` where a problem says so).
enum class Status {
  converged,               ///< equilibrium, residual certified, stable
  held,                    ///< a dynamic solver ran its sweeps; no statement about equilibrium
  max_iterations,          ///< residual still too large after the allowed iterations
  line_search,             ///< no step along the search direction lowers the energy
  inverted,                ///< an element is turned inside out
  not_positive_definite,   ///< equilibrium, but unstable: the body would buckle away from it
  non_finite,              ///< NaN or infinity in the state or in a factor
  time_limit               ///< stopped by the caller's time limit
};

constexpr std::string_view to_string(Status s) {
  switch (s) {
    case Status::converged: return "converged";
    case Status::held: return "held";
    case Status::max_iterations: return "max_iterations";
    case Status::line_search: return "line_search";
    case Status::inverted: return "inverted";
    case Status::not_positive_definite: return "not_positive_definite";
    case Status::non_finite: return "non_finite";
    case Status::time_limit: return "time_limit";
  }
  return "non_finite";
}

}  // namespace lumo

// ---- lumo/mechanics/state.hpp

namespace lumo {

/// The pad at one load. Forces act on the indenter, along −direction; all in the finger frame, SI.
struct MechanicalState {
  Status status = Status::non_finite;
  double load_N = 0.0;                       ///< prescribed
  double force_N = 0.0;                      ///< contact wrench · (−direction)
  double depth_m = 0.0;                      ///< advance since first touch of the exact undeformed profile
  std::vector<Vec3> displacement;            ///< per mesh node [m]
  /// Contact field per mesh node: > 0 in contact with the indenter, < 0 outside; −infinity on nodes that it cannot touch.
  /// Linear on the sub-facets of the surface (corners and edge middles); the contact set is {φ > 0}.
  std::vector<double> contact_field;
  std::vector<double> pressure_Pa;           ///< indenter pressure per mesh node, per reference area; 0 off the surface
  double contact_area_m2 = 0.0;              ///< A(C; X), deformed
  double reference_area_m2 = 0.0;            ///< A_0(C), undeformed
  double residual_N = std::numeric_limits<double>::infinity();  ///< norm of the out-of-balance forces, from an independent routine
  double penetration_m = 0.0;                ///< largest overlap of surface and indenter
  int iterations = 0;                        ///< Newton steps spent on this load
};

}  // namespace lumo

// ---- lumo/mechanics/certify.hpp

namespace lumo {

/// Norm of the out-of-balance forces on the free components of the whole body and on the indenter [N], by a routine that shares nothing
/// with the solver: the virtual work of each node's shape function, with stresses from the full law, point by point, on the whole mesh.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, Indenter Tool>
double out_of_balance(const Body& body, const TetMesh& mesh, const Material& material, const Contact& contact, const Element& element,
                      const Tool& tool, const Vec3& origin, const Vec3& direction, double load_N, const std::vector<Vec3>& displacement) {
  std::vector<Vec3> force(mesh.nodes.size(), Vec3::Zero());
  for (const auto& t : mesh.tets) {
    std::array<Eigen::Matrix<double, 3, Element::nodes>, std::size_t(Element::points)> slope;
    std::array<Mat3, std::size_t(Element::points)> F;
    std::array<double, std::size_t(Element::points)> volume;
    double whole = 0.0, changed = 0.0;
    for (std::size_t q = 0; q < std::size_t(Element::points); ++q) {
      const auto by_xi = shape_gradients<Element::nodes>(Element::point(int(q)));
      Mat3 reference = Mat3::Zero();
      for (int a = 0; a < Element::nodes; ++a) reference += mesh.nodes[std::size_t(t[std::size_t(a)])] * by_xi.col(a).transpose();
      slope[q] = reference.transpose().partialPivLu().solve(by_xi);
      F[q] = Mat3::Identity();
      for (int a = 0; a < Element::nodes; ++a) F[q] += displacement[std::size_t(t[std::size_t(a)])] * slope[q].col(a).transpose();
      volume[q] = Element::weight(int(q)) * reference.determinant();
      whole += volume[q];
      changed += volume[q] * F[q].determinant();
    }
    for (std::size_t q = 0; q < std::size_t(Element::points); ++q) {
      const double J = F[q].determinant();
      const double seen = element.mean_dilatation ? changed / whole : J;
      const Mat3 P = material.distortion_stress(F[q]) + material.volumetric(seen).stress * J * F[q].inverse().transpose();
      for (int a = 0; a < Element::nodes; ++a) force[std::size_t(t[std::size_t(a)])] += volume[q] * (P * slope[q].col(a));
    }
  }
  Positions x(3, Eigen::Index(mesh.nodes.size()));
  for (std::size_t k = 0; k < mesh.nodes.size(); ++k) x.col(Eigen::Index(k)) = mesh.nodes[k] + displacement[k];
  const Carrier carrier{body.carrier};
  double push = 0.0;
  const auto press = [&](const ContactSurface& surface, const auto& rigid, bool is_indenter) {
    for (std::size_t f = 0; f < surface.size(); ++f)
      for (const SurfacePoint& p : surface.points(f)) {
        const DistanceSample d = rigid.sample(surface.position(f, p, x));
        const Vec3 traction = contact.respond(d.distance).pressure * d.gradient;
        if (is_indenter) push += p.area_m2 * traction.dot(direction);
        for (std::size_t k = 0; k < std::size_t(mesh.nodes_per_face()); ++k) force[std::size_t(surface.face(f).nodes[k])] -= p.area_m2 * p.shape[k] * traction;
      }
  };
  press(ContactSurface(mesh, body, [](const Patch& p) { return p.contactable; }), Moving<Tool>{&tool, origin, direction}, true);
  press(ContactSurface(mesh, body, [](const Patch& p) { return p.meets_carrier; }), Moving<Carrier>{&carrier, Vec3::Zero(), direction}, false);
  for (const BoundaryFace& f : mesh.faces)
    if (body.patches[std::size_t(f.patch)].bonded)
      for (int k = 0; k < mesh.nodes_per_face(); ++k) force[std::size_t(f.nodes[std::size_t(k)])].setZero();
  double sum = (push - load_N) * (push - load_N);
  for (const Vec3& f : force) sum += f.squaredNorm();
  return std::sqrt(sum);
}

}  // namespace lumo

// ---- lumo/mechanics/quasi_static.hpp

namespace lumo {

/// Static equilibrium at prescribed loads: the indenter's advance is an unknown, so that each load is met exactly (model: solver policy
/// "quasi-static"). Newton's method on energy(x, s) − F s, load by load along 0 → F₁ → F₂ ….
///
/// The stiff parts of the energy, volume change and contact, are linearised about values that are carried on *linearly* by each step
/// (volume ratios θ, gaps γ) instead of those that the moved nodes happen to have: a step's second-order errors in volume then make no
/// spurious pressure, the tangent stays positive definite, and contact points change sides by what the step meant. This is Newton's method
/// for the mixed problem with θ and γ eliminated; its solution is that of the plain one (Magisano, Leonetti, Garcea 2017 for stresses;
/// Hintermüller, Ito, Kunisch 2002 for contact). A factor is used again as long as it contracts.
///
/// A set of contact points that is too large loses its rim ring by ring, one factorisation each. So every stride starts from a good guess of
/// it: the points with the smallest gaps on the area that Hertz's formula gives for the first load, and on the last area × (load/last)^0.6
/// after that. Where the tangent is lost on the way, the load is approached again from the last one, in smaller strides that end closer to
/// equilibrium.
///
/// At each load the unshifted tangent of the *whole* body must be positive definite, fields that break the scenario's symmetry included;
/// otherwise the status says so.
struct QuasiStatic {
  struct Config {
    double residual_tolerance = 1e-7;   ///< of the load
    int max_iterations = 200;           ///< factorisations per load
    int stride_iterations = 40;         ///< factorisations before a stride is cut
    double chord_contraction = 0.02;    ///< a kept factor must shrink the residual by this factor per step
    double load_stride = 1.6;           ///< loads in between are at most this factor apart
    double max_advance = 0.2;           ///< largest advance in one step, in indenter radii
    double time_limit_s = 1e9;          ///< per scenario, wall clock
  };
  Config config = {};

  /// States at the scenario's loads, displacements on the sector's nodes; after the first that is not converged no further one is tried
  /// (it carries the reason).
  template <class Model, Indenter Tool>
  std::vector<MechanicalState> run(const Model& model, const Scenario<Tool>& scenario, const Touch& touch) const;
};

namespace detail {

template <class Model, Indenter Tool>
class QuasiStaticRun {
 public:
  QuasiStaticRun(const Model& model, const Scenario<Tool>& scenario, const Touch& touch, const QuasiStatic::Config& config)
      : config_(config), model_(model), system_{model, scenario.indenter, touch.origin, scenario.direction()},
        eq_(model.blocks.front().equations), linear_(model.blocks.front().analysed), now_{positions_of(model.sector.mesh), 0.0},
        deadline_(std::chrono::steady_clock::now() + std::chrono::duration_cast<std::chrono::steady_clock::duration>(
                                                         std::chrono::duration<double>(std::min(config.time_limit_s, 1e6)))) {}

  /// Equilibrium at `load` (the sector's share), from where the last call ended.
  Status solve(double load) {
    iterations = 0;
    const typename System::Place start = now_;
    const double from = load_;
    double first = std::min(load, largest_first_load()), stride = config_.load_stride, on_the_way = loose;
    for (int cuts = 0; load_ != load;) {
      const double next = load_ == 0.0 ? first : stride_end(load, stride), tolerance = next == load ? config_.residual_tolerance : on_the_way;
      const Status s = load_ == 0.0 ? touch_down(next, tolerance) : approach(next, tolerance, touched_area() * std::pow(next / load_, 0.6));
      if (s == Status::converged) {
        load_ = next;
        continue;
      }
      const bool lost = s == Status::not_positive_definite || s == Status::inverted || s == Status::max_iterations;
      if (!lost || ++cuts > 5 || iterations >= config_.max_iterations) return s;
      now_ = start, load_ = from;   // what was reached loosely on the way may be what led astray
      first /= 4.0;
      stride = std::sqrt(stride);
      on_the_way = close;
    }
    return certify_stability();
  }

  const Positions& positions() const { return now_.x; }
  double advance() const { return now_.advance; }
  int iterations = 0;

 private:
  using System = PressSystem<Model, Tool>;
  static constexpr double loose = 0.3, close = 1e-3;   ///< residual over load at which a stride on the way may end, at first and after a loss

  /// Hertz's load for a contact half as wide as the indenter, on a half-space that keeps its volume.
  double largest_first_load() const { return model_.sector.fraction() * model_.solid.material().shear_modulus() * 2.0 / 3.0 * std::pow(system_.tool.radius_m(), 2); }
  double hertz_area(double load) const {
    const double share = model_.sector.fraction(), whole = load / share;
    return share * pi * std::pow(3.0 * whole * system_.tool.radius_m() / (16.0 * model_.solid.material().shear_modulus()), 2.0 / 3.0);
  }

  /// Where the next of equal strides from load_ to `load` ends.
  double stride_end(double load, double stride) const {
    const double strides = std::ceil(std::abs(std::log(load / load_)) / std::log(stride) - 1e-9);
    return strides <= 1.0 ? load : load_ * std::pow(load / load_, 1.0 / strides);
  }

  /// Reference area of the points that overlap now.
  double touched_area() const {
    double area = 0.0;
    const auto tool = system_.indenter(now_.advance);
    for (std::size_t f = 0; f < model_.touchable.size(); ++f)
      for (const SurfacePoint& p : model_.touchable.points(f))
        if (tool.distance(model_.touchable.position(f, p, now_.x)) < 0.0) area += p.area_m2;
    return area;
  }

  // From first touch. A softer contact forgives a wrong guess of its extent.
  Status touch_down(double load, double tolerance) {
    system_.firmness = 0.1;
    const Status s = approach(load, loose, hertz_area(load));
    const double softer = std::exchange(system_.firmness, 1.0);
    return s == Status::converged ? approach(load, tolerance, 0.0, softer) : s;
  }

  // Equilibrium at a load, from contact on at least `area`. Pressures are kept when overlaps so far were those of a contact `softer` times as firm.
  Status approach(double load, double tolerance, double area, double softer = 1.0) {
    auto seen = system_.predicted(now_, now_, Positions::Zero(3, now_.x.cols()), 0.0);
    for (SeenGaps* gaps : {&seen.touch, &seen.rest})
      for (std::vector<double>& face : *gaps)
        for (double& g : face) g = g < 0.0 ? softer * g : g;
    touch_nearest(seen.touch, area);
    bool fresh = false;
    double last = std::numeric_limits<double>::infinity();
    for (const int stop = iterations + config_.stride_iterations;;) {
      const auto r = system_.residual(now_.x, now_.advance, load, eq_, &seen);
      if (!std::isfinite(r.norm())) return Status::non_finite;
      // The plain residual is what counts; it is looked at when the linearised one is small.
      if (r.norm() <= tolerance * load && system_.residual(now_.x, now_.advance, load, eq_).norm() <= tolerance * load) return Status::converged;
      if (std::chrono::steady_clock::now() > deadline_) return Status::time_limit;
      if (!fresh || r.norm() > config_.chord_contraction * last) {
        if (iterations >= std::min(stop, config_.max_iterations)) return Status::max_iterations;
        ++iterations;
        system_.tangent(now_.x, now_.advance, 0, 1, tangent_, &seen);
        const FactorStatus f = linear_.factorize(tangent_.matrix.front());
        if (f != FactorStatus::positive_definite) return f == FactorStatus::non_finite ? Status::non_finite : Status::not_positive_definite;
        if (!border()) return Status::not_positive_definite;
        factored_ = now_;
        fresh = true;
      }
      last = r.norm();
      if (const Status s = step(r, seen); s != Status::converged) return s;
    }
  }

  // Points that have just come into contact overlap, or gape, by what the last step did not know of; that is to be undone, but it is no
  // pressure yet that could bend the tangent.
  static constexpr double just_touching = -1e-15;
  static void enter(SeenGaps& gaps, const SeenGaps& before) {
    for (std::size_t f = 0; f < gaps.size(); ++f)
      for (std::size_t k = 0; k < gaps[f].size(); ++k)
        if (gaps[f][k] < 0.0 && before[f][k] >= 0.0) gaps[f][k] = just_touching;
  }

  // Brings the points with the smallest gaps into contact until `area` [m²] is.
  void touch_nearest(SeenGaps& gaps, double area) const {
    std::vector<std::pair<double, double>> points;   // gap, area
    for (std::size_t f = 0; f < gaps.size(); ++f)
      for (std::size_t k = 0; k < gaps[f].size(); ++k) points.emplace_back(gaps[f][k], model_.touchable.points(f)[k].area_m2);
    std::sort(points.begin(), points.end());
    double last = 0.0;
    for (std::size_t k = 0; k < points.size() && area > 0.0; ++k) area -= points[k].second, last = points[k].first;
    for (std::vector<double>& face : gaps)
      for (double& g : face)
        if (g >= 0.0 && g <= last) g = just_touching;
  }

  bool border() {
    response_ = linear_.solve(tangent_.coupling);
    schur_ = tangent_.stiffness - tangent_.coupling.dot(response_);
    return std::isfinite(schur_) && schur_ > 0.0;
  }

  // A full Newton step unless the indenter would jump or an element would be turned inside out.
  Status step(const typename System::Residual& r, typename System::Seen& seen) {
    const Eigen::VectorXd z = linear_.solve(r.free);
    const double ds = (-r.advance + tangent_.coupling.dot(z)) / schur_;
    const Eigen::VectorXd du = -z - response_ * ds;
    if (!std::isfinite(ds) || !du.allFinite()) return Status::non_finite;
    const double now = model_.solid.smallest_J(now_.x);
    double t = std::min(1.0, config_.max_advance * system_.tool.radius_m() / std::max(std::abs(ds), 1e-300));
    Positions dx = Positions::Zero(3, now_.x.cols());
    System::move(dx, eq_, du, 1.0);
    for (int k = 0; k < 20; ++k, t *= 0.5) {
      const Positions trial = now_.x + t * dx;
      if (!(model_.solid.smallest_J(trial) > 0.2 * now)) continue;
      auto next = system_.predicted(now_, factored_, t * dx, t * ds);
      if (!(*std::min_element(next.ratios.begin(), next.ratios.end()) > 0.2)) continue;
      enter(next.touch, seen.touch);
      enter(next.rest, seen.rest);
      seen = std::move(next);
      now_.x = trial;
      now_.advance += t * ds;
      return Status::converged;
    }
    return Status::inverted;
  }

  // Tangents of all parities at the state that was reached.
  Status certify_stability() {
    typename System::Tangent t;
    system_.tangent(now_.x, now_.advance, 0, model_.blocks.size(), t);
    for (std::size_t b = 0; b < model_.blocks.size(); ++b) {
      auto linear = model_.blocks[b].analysed;
      const FactorStatus f = linear.factorize(t.matrix[b]);
      if (f != FactorStatus::positive_definite) return f == FactorStatus::non_finite ? Status::non_finite : Status::not_positive_definite;
      if (b > 0) continue;   // the advance moves with the even fields only
      const double stiffness = t.stiffness - t.coupling.dot(Eigen::VectorXd(linear.solve(t.coupling)));
      if (!(stiffness > 0.0)) return std::isfinite(stiffness) ? Status::not_positive_definite : Status::non_finite;
    }
    return Status::converged;
  }

  QuasiStatic::Config config_;
  const Model& model_;
  System system_;
  const Equations& eq_;
  std::decay_t<decltype(std::declval<Model>().blocks.front().analysed)> linear_;
  typename System::Place now_, factored_;   // where we are, and where the factor was made
  std::chrono::steady_clock::time_point deadline_;
  typename System::Tangent tangent_;
  Eigen::VectorXd response_;   // K⁻¹ k
  double schur_ = 0.0;
  double load_ = 0.0;          // last one that was reached
};

}  // namespace detail

template <class Model, Indenter Tool>
std::vector<MechanicalState> QuasiStatic::run(const Model& model, const Scenario<Tool>& scenario, const Touch& touch) const {
  detail::QuasiStaticRun<Model, Tool> path(model, scenario, touch, config);
  const double fraction = model.sector.fraction();
  std::vector<MechanicalState> states;
  for (double load : scenario.loads_N) {
    MechanicalState state;
    state.load_N = load;
    state.status = path.solve(fraction * load);
    state.iterations = path.iterations;
    state.depth_m = path.advance();
    const Positions& x = path.positions();
    for (std::size_t k = 0; k < model.sector.mesh.nodes.size(); ++k) state.displacement.push_back(x.col(Eigen::Index(k)) - model.sector.mesh.nodes[k]);
    states.push_back(std::move(state));
    if (states.back().status != Status::converged) break;
  }
  return states;
}

}  // namespace lumo

// ---- lumo/mechanics/simulator.hpp

namespace lumo {

template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, LinearSolver Linear, class Solver>
class PreparedBody;

/// Presses an indenter into a body. Types choose the physics, values choose the numbers:
/// `Simulator sim{NeoHookean{.mu = 106.0_kPa, .lambda = 10.494_MPa}, SDFContact{}}`.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element = QuadraticTet, LinearSolver Linear = EigenCholesky, class Solver = QuasiStatic>
struct Simulator {
  Material material = {};
  Contact contact = {};
  Element element = {};
  Solver solver = {};

  /// Everything that scenarios on one mesh share (elements, symbolic factorisations); thread-safe, so that scenarios can run side by side.
  /// Throws InvalidArgument for parameters out of range.
  PreparedBody<Material, Contact, Element, Linear, Solver> prepare(const Body& body, const TetMesh& mesh) const {
    validate(material);
    validate(contact);
    return {*this, body, mesh};
  }

  /// One scenario from first touch through its loads.
  template <Indenter Tool>
  std::vector<MechanicalState> press(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario) const {
    return prepare(body, mesh).press(scenario);
  }
};

template <class Material, class Contact>
Simulator(Material, Contact) -> Simulator<Material, Contact>;
template <class Material, class Contact, class Element>
Simulator(Material, Contact, Element) -> Simulator<Material, Contact, Element>;

/// A body ready to be pressed at many places.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, LinearSolver Linear, class Solver>
class PreparedBody {
 public:
  using Model = SectorModel<Material, Contact, Element, Linear>;
  using Maker = Simulator<Material, Contact, Element, Linear, Solver>;

  PreparedBody(const Maker& maker, const Body& body, const TetMesh& mesh) : maker_(maker), body_(body), mesh_(std::make_shared<const TetMesh>(mesh)) {}

  /// States at the scenario's loads, on the whole mesh. Where body and scenario are symmetric only a half or a quarter is solved; fields
  /// that break the symmetry are still tested for stability.
  template <Indenter Tool>
  std::vector<MechanicalState> press(const Scenario<Tool>& scenario) const;

  const TetMesh& mesh() const { return *mesh_; }

 private:
  const Model& model(Symmetry planes) const {
    Slot& slot = (*slots_)[std::size_t((planes.x ? 1 : 0) + (planes.y ? 2 : 0))];
    std::call_once(slot.once, [&] { slot.model = std::make_unique<Model>(body_, *mesh_, planes, maker_.material, maker_.contact, maker_.element); });
    return *slot.model;
  }

  struct Slot {
    std::once_flag once;
    std::unique_ptr<Model> model;
  };
  Maker maker_;
  Body body_;
  std::shared_ptr<const TetMesh> mesh_;
  std::shared_ptr<std::array<Slot, 4>> slots_ = std::make_shared<std::array<Slot, 4>>();
};

template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, LinearSolver Linear, class Solver>
template <Indenter Tool>
std::vector<MechanicalState> PreparedBody<Material, Contact, Element, Linear, Solver>::press(const Scenario<Tool>& scenario) const {
  validate(scenario);
  const Touch touch = first_touch(body_, *mesh_, scenario);
  const Symmetry planes{mesh_->symmetry.x && scenario.angle_rad == 0.0, mesh_->symmetry.y && scenario.y_m == 0.0};
  const Model& sector_model = model(planes);
  std::vector<MechanicalState> states = maker_.solver.run(sector_model, scenario, touch);
  const ContactSurface surface(*mesh_, body_, [](const Patch& p) { return p.contactable; });
  for (MechanicalState& s : states) {
    s.displacement = unfold(*mesh_, sector_model.sector, s.displacement);
    const Vec3 origin = touch.origin + s.depth_m * scenario.direction();
    // Certified on the whole mesh by the independent routine, whatever the solver says of itself.
    s.residual_N = out_of_balance(body_, *mesh_, maker_.material, maker_.contact, maker_.element, scenario.indenter, origin, scenario.direction(), s.load_N, s.displacement);
    if (s.status == Status::converged && !(s.residual_N <= 1e-6 * s.load_N)) s.status = std::isfinite(s.residual_N) ? Status::max_iterations : Status::non_finite;
    Positions x = positions_of(*mesh_);
    for (std::size_t k = 0; k < s.displacement.size(); ++k) x.col(Eigen::Index(k)) += s.displacement[k];
    const Moving<Tool> rigid{&scenario.indenter, origin, scenario.direction()};
    ContactField c = contact_field(*mesh_, surface, maker_.contact, rigid, x);
    const ContactSums sums = add_contact_forces(surface, maker_.contact, rigid, x, nullptr);
    s.force_N = sums.push_N;
    s.penetration_m = sums.penetration_m;
    s.contact_area_m2 = contact_area(surface, c.field, x);
    s.reference_area_m2 = contact_area(surface, c.field, positions_of(*mesh_));
    s.contact_field = std::move(c.field);
    s.pressure_Pa = std::move(c.pressure_Pa);
  }
  return states;
}

}  // namespace lumo

// ---- lumo/core/sobol.hpp

namespace lumo {

namespace detail {

/// Mixes 64 bits; a bijection (Steele, Lea & Flood, "Fast Splittable Pseudorandom Number Generators", 2014).
constexpr std::uint64_t mix64(std::uint64_t x) {
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ull;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebull;
  return x ^ (x >> 31);
}

/// A key for the pair (key, label): counter-based, so that no draw depends on how many came before it.
constexpr std::uint64_t combine(std::uint64_t key, std::uint64_t label) { return mix64(key + 0x9e3779b97f4a7c15ull * (label + 1)); }

/// A number in (0, 1) from a key.
constexpr double uniform(std::uint64_t key) { return (double(key >> 11) + 0.5) * 0x1p-53; }

constexpr std::uint32_t reverse_bits(std::uint32_t x) {
  x = ((x >> 1) & 0x55555555u) | ((x & 0x55555555u) << 1);
  x = ((x >> 2) & 0x33333333u) | ((x & 0x33333333u) << 2);
  x = ((x >> 4) & 0x0f0f0f0fu) | ((x & 0x0f0f0f0fu) << 4);
  x = ((x >> 8) & 0x00ff00ffu) | ((x & 0x00ff00ffu) << 8);
  return (x >> 16) | (x << 16);
}

/// Owen's nested uniform scramble by hashing: every bit is flipped by a hash of the higher bits.
/// Source: Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020; the permutation of Laine & Karras (2011) with
/// the constants that Vegdahl found (2021), which are better mixed than the first ones.
constexpr std::uint32_t owen_scramble(std::uint32_t x, std::uint32_t seed) {
  x = reverse_bits(x);
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16) | 1u;
  x ^= x * 0x05526c56u;
  x ^= x * 0x53a22864u;
  return reverse_bits(x);
}

/// Primitive polynomial (degree, inner coefficients) and first direction numbers of one dimension.
struct SobolSeed {
  int degree;
  std::uint32_t polynomial;
  std::array<std::uint32_t, 7> m;
};

/// Dimensions 2 … 32 (the first is van der Corput's). Source: Joe & Kuo, "Constructing Sobol sequences with better
/// two-dimensional projections", SIAM J. Sci. Comput. 30 (2008), set new-joe-kuo-6.
inline constexpr std::array<SobolSeed, 31> sobol_seeds{{
    {1, 0, {1}},
    {2, 1, {1, 3}},
    {3, 1, {1, 3, 1}},
    {3, 2, {1, 1, 1}},
    {4, 1, {1, 1, 3, 3}},
    {4, 4, {1, 3, 5, 13}},
    {5, 2, {1, 1, 5, 5, 17}},
    {5, 4, {1, 1, 5, 5, 5}},
    {5, 7, {1, 1, 7, 11, 19}},
    {5, 11, {1, 1, 5, 1, 1}},
    {5, 13, {1, 1, 1, 3, 11}},
    {5, 14, {1, 3, 5, 5, 31}},
    {6, 1, {1, 3, 3, 9, 7, 49}},
    {6, 13, {1, 1, 1, 15, 21, 21}},
    {6, 16, {1, 3, 1, 13, 27, 49}},
    {6, 19, {1, 1, 1, 15, 7, 5}},
    {6, 22, {1, 3, 1, 15, 13, 25}},
    {6, 25, {1, 1, 5, 5, 19, 61}},
    {7, 1, {1, 3, 7, 11, 23, 15, 103}},
    {7, 4, {1, 3, 7, 13, 13, 15, 69}},
    {7, 7, {1, 1, 3, 13, 7, 35, 63}},
    {7, 8, {1, 3, 5, 9, 1, 25, 53}},
    {7, 14, {1, 3, 1, 13, 9, 35, 107}},
    {7, 19, {1, 3, 1, 5, 27, 61, 31}},
    {7, 21, {1, 1, 5, 11, 19, 41, 61}},
    {7, 28, {1, 3, 5, 3, 3, 13, 69}},
    {7, 31, {1, 1, 7, 13, 1, 19, 1}},
    {7, 32, {1, 3, 7, 5, 13, 19, 59}},
    {7, 37, {1, 1, 3, 9, 25, 29, 41}},
    {7, 41, {1, 3, 5, 13, 23, 1, 55}},
    {7, 42, {1, 3, 7, 3, 13, 59, 17}},
}};

using SobolTable = std::array<std::array<std::uint32_t, 32>, 32>;

/// Direction numbers, [dimension][bit]. Source: Bratley & Fox, Algorithm 659, ACM TOMS 14 (1988).
constexpr SobolTable make_sobol_table() {
  SobolTable v{};
  for (std::uint32_t k = 0; k < 32; ++k) v[0][k] = 1u << (31 - k);
  for (std::size_t d = 1; d < 32; ++d) {
    const SobolSeed& seed = sobol_seeds[d - 1];
    const std::size_t s = std::size_t(seed.degree);
    for (std::size_t k = 0; k < 32; ++k) {
      if (k < s) {
        v[d][k] = seed.m[k] << (31 - k);
        continue;
      }
      v[d][k] = v[d][k - s] ^ (v[d][k - s] >> s);
      for (std::size_t j = 1; j < s; ++j)
        if ((seed.polynomial >> (s - 1 - j)) & 1u) v[d][k] ^= v[d][k - j];
    }
  }
  return v;
}

inline constexpr SobolTable sobol_table = make_sobol_table();

}  // namespace detail

/// Sobol's low-discrepancy sequence in up to 32 dimensions, in natural order: the first 2^m points are a digital net.
struct Sobol {
  static constexpr int dimensions = 32;

  /// Coordinate `dimension` of point `index` as a 32-bit binary fraction.
  static constexpr std::uint32_t bits(std::uint32_t index, int dimension) {
    std::uint32_t x = 0;
    for (std::size_t k = 0; index != 0; ++k, index >>= 1)
      if (index & 1u) x ^= detail::sobol_table[std::size_t(dimension)][k];
    return x;
  }
};

/// Sobol's sequence under a random Owen scramble per dimension: every point is uniform on [0, 1)^d, nets stay nets, and
/// different seeds are independent. Law: a pure function of (seed, index, dimension).
struct OwenSobol {
  std::uint64_t seed = 0;

  /// In (0, 1): the middle of a cell of width 2^−32. Unchecked: dimension in [0, 32).
  constexpr double operator()(std::uint32_t index, int dimension) const {
    const std::uint32_t key = std::uint32_t(detail::combine(seed, std::uint64_t(dimension)) >> 32);
    return (double(detail::owen_scramble(Sobol::bits(index, dimension), key)) + 0.5) * 0x1p-32;
  }
};

}  // namespace lumo

// ---- lumo/optics/beer_lambert.hpp

namespace lumo {

/// What fills the body, for light that runs straight through it. Made from the Medium data of a body.
/// Laws: transmittance(0) = 1, T(a + b) = T(a)·T(b), not increasing. What is not transmitted is booked as absorbed.
template <class M>
concept TransparentMedium = std::constructible_from<M, Medium> && requires(const M& medium, double path_m) {
  { medium.refractive_index() } -> std::convertible_to<double>;
  { medium.transmittance(path_m) } -> std::convertible_to<double>;
};

/// Exponential extinction along a path. Source: Bouguer 1729, Lambert 1760, Beer 1852; paper §III (μ_ext acts as absorption).
class BeerLambert {
 public:
  /// Throws InvalidArgument unless the index lies in [1, 5] and the extinction in [0, 1e6] 1/m.
  explicit BeerLambert(const Medium& medium) : medium_(medium) {
    require_in_range("refractive index", medium.refractive_index, 1.0, 5.0, "");
    require_in_range("extinction", medium.extinction_per_m, 0.0, 1e6, "1/m");
  }

  double refractive_index() const { return medium_.refractive_index; }
  /// Share of the power left after `path_m` metres.
  double transmittance(double path_m) const { return std::exp(-medium_.extinction_per_m * path_m); }

 private:
  Medium medium_;
};

static_assert(TransparentMedium<BeerLambert>);
static_assert(!TransparentMedium<int>);

}  // namespace lumo

// ---- lumo/optics/intersector.hpp

namespace lumo {

/// Triangle of an optical scene, counter-clockwise seen from outside the body, or from the lit side of a carrier face.
struct SceneTriangle {
  std::array<Vec3, 3> corners;  ///< [m]
  bool in_air_only = false;     ///< a carrier face: met only by rays outside the body
};

/// The first triangle on a ray.
struct RayHit {
  double t = std::numeric_limits<double>::infinity();  ///< along the unit direction [m]; infinite: nothing
  int triangle = -1;
  explicit operator bool() const { return triangle >= 0; }
};

/// Finds what a ray meets first, *given the medium it is in*: inside the body only faces that it can leave by (d·n > 0, not in_air_only)
/// count, outside only faces that it can meet from their front (d·n < 0). A ray that starts on a face can therefore never meet that
/// face again, whatever the rounding, and needs no offset.
template <class S>
concept RayScene = requires(const S& scene, const Vec3& v, bool inside) {
  { scene.first_hit(v, v, inside) } -> std::same_as<RayHit>;
};

/// Builds a RayScene from triangles. Laws: same triangles, same hits; results do not depend on where the scene lies in space.
template <class I>
concept Intersector = requires(const I& intersector, const std::vector<SceneTriangle>& triangles) {
  { intersector.build(triangles) } -> RayScene;
};

}  // namespace lumo

// ---- lumo/optics/bvh.hpp

namespace lumo {

/// Ray scene on a tree of boxes, four children a node: triangles in double precision, boxes in float, rounded outwards.
class BvhScene {
 public:
  /// Throws InvalidArgument when a corner is not finite.
  BvhScene(const std::vector<SceneTriangle>& triangles, int leaf_size);

  /// First triangle on the ray from `origin` [m] along the unit vector `direction`; `inside`: the ray runs in the body.
  RayHit first_hit(const Vec3& origin, const Vec3& direction, bool inside) const;

 private:
  static constexpr std::size_t bins = 16;
  using Box = Eigen::AlignedBox3d;
  struct Triangle {
    Vec3 corner, edge1, edge2;
    int id;
    bool in_air_only;
  };
  struct Node {
    std::array<Eigen::Array4f, 3> low, high;
    std::array<int, 4> child{};  ///< node, or first triangle of a leaf
    std::array<int, 4> count{};  ///< triangles of a leaf, 0 for a node, −1 for nothing
  };
  struct Range {
    int first, last;
    Box box;
  };

  Range bounds(int first, int last) const;
  bool split(const Range& range, std::array<Range, 2>& halves);
  int build(const Range& range);

  std::vector<Triangle> triangles_;
  std::vector<Node> nodes_;
  std::vector<Box> boxes_;      ///< per input triangle, while building
  std::vector<int> order_;      ///< likewise
  Vec3 center_ = Vec3::Zero();  ///< corners are stored relative to it
  double slack_ = 0.0;          ///< rays may start this far behind a face [m]
  int leaf_size_;
};

/// The library's own Intersector; needs Eigen only. Law: independent of the place of the scene (it is centred).
/// Source: binned surface area heuristic, Wald 2007; ray–triangle test, Möller & Trumbore 1997.
struct Bvh {
  struct Config {
    int leaf_size = 4;  ///< triangles up to which a range is not split
  };
  Config config{};

  BvhScene build(const std::vector<SceneTriangle>& triangles) const { return BvhScene(triangles, config.leaf_size); }
};

inline BvhScene::BvhScene(const std::vector<SceneTriangle>& triangles, int leaf_size) : leaf_size_(std::max(1, leaf_size)) {
  Box all;
  for (const SceneTriangle& t : triangles)
    for (const Vec3& p : t.corners) {
      if (!p.allFinite()) throw InvalidArgument("optical scene: a corner is not finite");
      all.extend(p);
    }
  if (triangles.empty()) return;
  center_ = all.center();
  const double extent = all.diagonal().norm(), pad = 1e-6 * extent;
  slack_ = 1e-11 * extent;
  for (const SceneTriangle& t : triangles) {
    Box box;
    for (const Vec3& p : t.corners) box.extend(Vec3(p - center_));
    boxes_.emplace_back(Vec3(box.min().array() - pad), Vec3(box.max().array() + pad));
  }
  order_.resize(triangles.size());
  std::iota(order_.begin(), order_.end(), 0);
  build(bounds(0, int(triangles.size())));
  for (int i : order_) {
    const auto& [a, b, c] = triangles[std::size_t(i)].corners;
    triangles_.push_back({a - center_, b - a, c - a, i, triangles[std::size_t(i)].in_air_only});
  }
  boxes_ = {};
  order_ = {};
}

inline BvhScene::Range BvhScene::bounds(int first, int last) const {
  Range r{first, last, {}};
  for (int i = first; i < last; ++i) r.box.extend(boxes_[std::size_t(order_[std::size_t(i)])]);
  return r;
}

// Cuts the range where the expected cost of a ray is least; false when it is small, or cannot be cut.
inline bool BvhScene::split(const Range& range, std::array<Range, 2>& halves) {
  const int n = range.last - range.first;
  if (n <= leaf_size_) return false;
  Box centers;
  for (int i = range.first; i < range.last; ++i) centers.extend(boxes_[std::size_t(order_[std::size_t(i)])].center());
  int axis = 0;
  const double width = centers.diagonal().maxCoeff(&axis);
  if (!(width > 0.0)) return false;
  const auto bin = [&](int i) {
    const double x = (boxes_[std::size_t(i)].center()[axis] - centers.min()[axis]) / width;
    return std::min(bins - 1, std::size_t(x * double(bins)));
  };
  const auto area = [](const Box& b) {
    const Vec3 d = b.diagonal();
    return d.x() * d.y() + d.y() * d.z() + d.z() * d.x();
  };
  std::array<Box, bins> box;
  std::array<int, bins> count{};
  for (int i = range.first; i < range.last; ++i) {
    const int id = order_[std::size_t(i)];
    box[bin(id)].extend(boxes_[std::size_t(id)]);
    ++count[bin(id)];
  }
  std::array<double, bins> right{};
  Box sweep;
  for (std::size_t b = bins; b-- > 1;) {
    sweep.extend(box[b]);
    right[b] = sweep.isEmpty() ? 0.0 : area(sweep);
  }
  sweep.setEmpty();
  double best = std::numeric_limits<double>::infinity();
  std::size_t cut = 0;
  for (std::size_t b = 1, below = 0; b < bins; ++b) {
    sweep.extend(box[b - 1]);
    below += std::size_t(count[b - 1]);
    if (below == 0 || below == std::size_t(n)) continue;
    const double cost = area(sweep) * double(below) + right[b] * double(std::size_t(n) - below);
    if (cost < best) best = cost, cut = b;
  }
  const auto begin = order_.begin();
  const auto middle = std::partition(begin + range.first, begin + range.last, [&](int id) { return bin(id) < cut; });
  halves = {bounds(range.first, int(middle - begin)), bounds(int(middle - begin), range.last)};
  return true;
}

inline int BvhScene::build(const Range& range) {
  std::vector<Range> parts{range};
  for (std::size_t tried = 0; parts.size() < 4 && tried < parts.size();) {
    std::sort(parts.begin(), parts.end(), [](const Range& a, const Range& b) { return a.last - a.first > b.last - b.first; });
    std::array<Range, 2> halves;
    if (!split(parts[tried], halves)) {
      ++tried;
      continue;
    }
    parts[tried] = halves[0];
    parts.push_back(halves[1]);
    tried = 0;
  }
  const std::size_t me = nodes_.size();
  nodes_.emplace_back();
  for (std::size_t k = 0; k < 4; ++k) {
    for (std::size_t a = 0; a < 3; ++a) {
      const bool used = k < parts.size();
      nodes_[me].low[a][Eigen::Index(k)] = used ? float(parts[k].box.min()[Eigen::Index(a)]) : std::numeric_limits<float>::infinity();
      nodes_[me].high[a][Eigen::Index(k)] = used ? float(parts[k].box.max()[Eigen::Index(a)]) : -std::numeric_limits<float>::infinity();
    }
    if (k >= parts.size()) {
      nodes_[me].count[k] = -1;
      continue;
    }
    const bool leaf = parts.size() == 1 || parts[k].last - parts[k].first <= leaf_size_;
    nodes_[me].count[k] = leaf ? parts[k].last - parts[k].first : 0;
    const int child = leaf ? parts[k].first : build(parts[k]);
    nodes_[me].child[k] = child;
  }
  return int(me);
}

inline RayHit BvhScene::first_hit(const Vec3& origin, const Vec3& direction, bool inside) const {
  RayHit best;
  if (nodes_.empty()) return best;
  const Vec3 o = origin - center_;
  std::array<float, 3> of, inverse;
  for (std::size_t a = 0; a < 3; ++a) {
    const double d = direction[Eigen::Index(a)];
    of[a] = float(o[Eigen::Index(a)]);
    inverse[a] = float(1.0 / (std::abs(d) < 1e-12 ? std::copysign(1e-12, d) : d));
  }
  struct Todo {
    int child, count;
    float t;
  };
  std::array<Todo, 256> stack;  // three a level at most; trees stay far below 80 levels
  std::size_t top = 0;
  stack[top++] = {0, 0, 0.0f};
  while (top > 0) {
    const Todo now = stack[--top];
    if (double(now.t) > best.t) continue;
    for (int i = now.child; i < now.child + now.count; ++i) {
      const Triangle& t = triangles_[std::size_t(i)];
      const Vec3 p = direction.cross(t.edge2);
      const double det = t.edge1.dot(p);  // > 0: against the normal, so from outside
      if (inside ? t.in_air_only || !(det < 0.0) : !(det > 0.0)) continue;
      const double f = 1.0 / det;
      const Vec3 s = o - t.corner;
      const double u = f * s.dot(p);
      if (!(u >= -1e-10 && u <= 1.0 + 1e-10)) continue;
      const Vec3 q = s.cross(t.edge1);
      const double v = f * direction.dot(q);
      if (!(v >= -1e-10 && u + v <= 1.0 + 1e-10)) continue;
      const double d = f * t.edge2.dot(q);
      if (d >= -slack_ && d < best.t) best = {d, t.id};
    }
    if (now.count > 0) continue;
    const Node& node = nodes_[std::size_t(now.child)];
    Eigen::Array4f enter = Eigen::Array4f::Zero(), leave = Eigen::Array4f::Constant(float(best.t));
    for (std::size_t a = 0; a < 3; ++a) {
      const Eigen::Array4f &near = inverse[a] < 0.0f ? node.high[a] : node.low[a], &far = inverse[a] < 0.0f ? node.low[a] : node.high[a];
      enter = enter.max((near - of[a]) * inverse[a]);
      leave = leave.min((far - of[a]) * inverse[a]);
    }
    const std::size_t base = top;
    for (std::size_t k = 0; k < 4; ++k) {
      if (node.count[k] < 0 || !(enter[Eigen::Index(k)] <= leave[Eigen::Index(k)] * 1.000001f) || top == stack.size()) continue;
      std::size_t at = top++;  // keep the nearest on top
      for (; at > base && stack[at - 1].t < enter[Eigen::Index(k)]; --at) stack[at] = stack[at - 1];
      stack[at] = {node.child[k], node.count[k], enter[Eigen::Index(k)]};
    }
  }
  return best;
}

static_assert(RayScene<BvhScene> && Intersector<Bvh>);
static_assert(!Intersector<int>);

}  // namespace lumo

// ---- lumo/optics/ledger.hpp

namespace lumo {

/// Where the emitted power of a run went [W]. Law: emitted = sum of everything else, to rounding.
struct EnergyLedger {
  double emitted = 0.0;
  std::vector<double> channels;       ///< left for good, per channel of the readout (ExitPower: per region)
  double to_indenter = 0.0;           ///< left through the contact set, into the opaque indenter
  double elsewhere = 0.0;             ///< left for good, but through no region
  double absorbed_in_medium = 0.0;    ///< in the silicone
  double absorbed_at_surfaces = 0.0;  ///< at opaque surfaces: carrier and LEDs
  double roulette = 0.0;              ///< ended minus added by Russian roulette; expectation 0, either sign
  double refinement = 0.0;            ///< channels as first traced minus channels as refined; expectation 0, either sign
  double lost = 0.0;                  ///< rays that leaked or bounced too often; target ≤ 1e-6 of emitted

  double accounted() const {
    return std::accumulate(channels.begin(), channels.end(), 0.0) + to_indenter + elsewhere + absorbed_in_medium + absorbed_at_surfaces +
           roulette + refinement + lost;
  }
  /// |emitted − accounted| / emitted.
  double imbalance() const { return emitted > 0.0 ? std::abs(emitted - accounted()) / emitted : std::abs(accounted()); }
};

}  // namespace lumo

// ---- lumo/optics/quadratic_face.hpp

namespace lumo::detail {

/// Shape functions of a quadratic triangle at barycentric (b1, b2); nodes: corners 0, 1, 2, then the middles of edges 01, 12, 20.
inline std::array<double, 6> quadratic_shape(double b1, double b2) {
  const double b0 = 1.0 - b1 - b2;
  return {b0 * (2.0 * b0 - 1.0), b1 * (2.0 * b1 - 1.0), b2 * (2.0 * b2 - 1.0), 4.0 * b0 * b1, 4.0 * b1 * b2, 4.0 * b2 * b0};
}

/// Its point at (b1, b2).
inline Vec3 on_quadratic(const std::array<Vec3, 6>& x, double b1, double b2) {
  const std::array<double, 6> n = quadratic_shape(b1, b2);
  return n[0] * x[0] + n[1] * x[1] + n[2] * x[2] + n[3] * x[3] + n[4] * x[4] + n[5] * x[5];
}

/// The same at (k1, k2)/n. Points on an edge come from the edge's own three nodes in the order of their `numbers`, so that neighbours get the same
/// bits: no cracks.
inline Vec3 lattice_point(const std::array<Vec3, 6>& x, const std::array<int, 6>& numbers, int n, int k1, int k2) {
  const double h = 1.0 / n;
  const auto on_edge = [&](std::size_t a, std::size_t b, std::size_t m, int ka, int kb) {
    if (kb == 0) return x[a];
    if (ka == 0) return x[b];
    if (numbers[a] > numbers[b]) std::swap(a, b), std::swap(ka, kb);
    const double s = ka * h, t = kb * h;
    return Vec3(s * (2.0 * s - 1.0) * x[a] + t * (2.0 * t - 1.0) * x[b] + 4.0 * s * t * x[m]);
  };
  const int k0 = n - k1 - k2;
  if (k2 == 0) return on_edge(0, 1, 3, k0, k1);
  if (k0 == 0) return on_edge(1, 2, 4, k1, k2);
  if (k1 == 0) return on_edge(2, 0, 5, k2, k0);
  return on_quadratic(x, k1 * h, k2 * h);
}

/// Unit normal at (b1, b2); not finite where the triangle is crushed to nothing.
inline Vec3 quadratic_normal(const std::array<Vec3, 6>& x, double b1, double b2) {
  const double b0 = 1.0 - b1 - b2;
  const Vec3 d1 = (1.0 - 4.0 * b0) * x[0] + (4.0 * b1 - 1.0) * x[1] + 4.0 * (b0 - b1) * x[3] + 4.0 * b2 * (x[4] - x[5]);
  const Vec3 d2 = (1.0 - 4.0 * b0) * x[0] + (4.0 * b2 - 1.0) * x[2] + 4.0 * (b0 - b2) * x[5] + 4.0 * b1 * (x[4] - x[3]);
  return d1.cross(d2).normalized();
}

/// A boundary face of the mesh in one state.
struct QuadraticFace {
  std::array<Vec3, 6> reference, deformed;  ///< [m]
  std::array<Vec3, 6> normal;               ///< unit outward normals of the deformed face at its nodes, shared with its neighbours
  std::array<double, 6> contact;            ///< contact field, > 0 in contact, −infinity where there can be none
  int patch;
  bool may_touch;

  /// Inside {φ > 0}, φ linear on the four triangles between corners and edge middles?
  bool in_contact(double b1, double b2) const {
    if (!may_touch) return false;
    const double b0 = 1.0 - b1 - b2;
    double value = 0.0;
    const auto add = [&](double weight, std::size_t node) {
      if (weight > 0.0) value += weight * contact[node];  // a weight of 0 must not meet −infinity
    };
    if (b0 > 0.5) {
      add(2.0 * b0 - 1.0, 0), add(2.0 * b1, 3), add(2.0 * b2, 5);
    } else if (b1 > 0.5) {
      add(2.0 * b1 - 1.0, 1), add(2.0 * b0, 3), add(2.0 * b2, 4);
    } else if (b2 > 0.5) {
      add(2.0 * b2 - 1.0, 2), add(2.0 * b1, 4), add(2.0 * b0, 5);
    } else {
      add(1.0 - 2.0 * b2, 3), add(1.0 - 2.0 * b0, 4), add(1.0 - 2.0 * b1, 5);
    }
    return value > 0.0;
  }
};

}  // namespace lumo::detail

// ---- lumo/optics/normal_recovery.hpp

namespace lumo::detail {

/// Numbers of the six nodes of each face, shared by neighbours on the same patch only, so that a crease keeps both its normals.
inline std::vector<std::array<int, 6>> patchwise_nodes(const std::vector<BoundaryFace>& faces) {
  std::vector<std::array<int, 6>> numbers(faces.size());
  std::map<std::array<int, 3>, int> known;  // patch and the corners of the edge (of a corner: itself twice)
  for (std::size_t f = 0; f < faces.size(); ++f)
    for (std::size_t k = 0; k < 6; ++k) {
      const int a = faces[f].nodes[k % 3], b = k < 3 ? a : faces[f].nodes[(k + 1) % 3];
      numbers[f][k] = known.try_emplace({faces[f].patch, std::min(a, b), std::max(a, b)}, int(known.size())).first->second;
    }
  return numbers;
}

/// Sets the normals of the deformed faces. Those of neighbouring quadratic faces differ, by about as much as a light load turns them; and where
/// the body is undeformed its shape is known. So the exact normals are turned as the faces turn, by the nearest field that is continuous and
/// quadratic on each patch: it turns every node's surroundings as much as the faces do in the mean. Source: Hinton, Campbell 1974.
inline void recover_normals(std::vector<QuadraticFace>& faces, const std::vector<BoundaryFace>& mesh_faces, const Body& body) {
  struct Point {
    double weight, b1, b2;
  };
  constexpr double w = 0.223381589678011, b = 0.445948490915965, v = 0.109951743655322, c = 0.091576213509771;  // degree 4: Dunavant 1985
  constexpr std::array<Point, 6> rule = {{{w, b, b}, {w, 1 - 2 * b, b}, {w, b, 1 - 2 * b}, {v, c, c}, {v, 1 - 2 * c, c}, {v, c, 1 - 2 * c}}};

  const std::vector<std::array<int, 6>> nodes = patchwise_nodes(mesh_faces);
  int size = 0;
  for (const std::array<int, 6>& n : nodes) size = std::max(size, 1 + *std::max_element(n.begin(), n.end()));
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(36 * faces.size());
  Eigen::MatrixX3d turned = Eigen::MatrixX3d::Zero(size, 3);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const std::array<Vec3, 6>& x = faces[f].reference;
    const double area = 0.5 * (x[1] - x[0]).cross(x[2] - x[0]).norm();
    Eigen::Matrix<double, 6, 6> mass = Eigen::Matrix<double, 6, 6>::Zero();
    for (const Point& p : rule) {
      const Eigen::Matrix<double, 6, 1> shape(quadratic_shape(p.b1, p.b2).data());
      mass += area * p.weight * shape * shape.transpose();
      const Vec3 turn = quadratic_normal(faces[f].deformed, p.b1, p.b2) - quadratic_normal(x, p.b1, p.b2);
      if (!turn.allFinite()) continue;  // a face that is crushed to nothing has no normal
      for (std::size_t k = 0; k < 6; ++k) turned.row(nodes[f][k]) += area * p.weight * shape[int(k)] * turn.transpose();
    }
    for (std::size_t k = 0; k < 6; ++k)
      for (std::size_t l = 0; l < 6; ++l) entries.emplace_back(nodes[f][k], nodes[f][l], mass(int(k), int(l)));
  }
  Eigen::SparseMatrix<double> mass(size, size);
  mass.setFromTriplets(entries.begin(), entries.end());
  Eigen::ConjugateGradient<Eigen::SparseMatrix<double>, Eigen::Lower | Eigen::Upper> solver(mass);
  solver.setTolerance(1e-10);
  turned = solver.solve(turned).eval();
  for (std::size_t f = 0; f < faces.size(); ++f)
    for (std::size_t k = 0; k < 6; ++k)
      faces[f].normal[k] = (outward_normal(body, faces[f].patch, faces[f].reference[k]) + turned.row(nodes[f][k]).transpose()).normalized();
}

}  // namespace lumo::detail

// ---- lumo/optics/polygon_cells.hpp

namespace lumo::detail {

/// Cuts a convex polygon into triangles with edges of about `size_m` that fit together corner to corner. How many is decided on the polygon
/// `like` of as many corners, so that a face that is moved keeps its cells. A parallelogram becomes an even number of cells each way, of
/// four triangles each, any other polygon a fan about its middle: mirror images of a polygon have mirror images of its triangles.
inline std::vector<std::array<Vec3, 3>> polygon_cells(const std::vector<Vec3>& c, const std::vector<Vec3>& like, double size_m) {
  std::vector<std::array<Vec3, 3>> cells;
  const auto pieces = [&](double length) { return std::max(1, int(std::ceil(length / size_m - 1e-9))); };
  if (like.size() == 4 && (like[0] + like[2] - like[1] - like[3]).norm() < 1e-9 * (like[2] - like[0]).norm()) {
    const int nu = 2 * pieces(0.5 * (like[1] - like[0]).norm()), nv = 2 * pieces(0.5 * (like[3] - like[0]).norm());
    const auto at = [&](double i, double j) {
      const double u = i / nu, v = j / nv;
      return Vec3((1.0 - u) * (1.0 - v) * c[0] + u * (1.0 - v) * c[1] + u * v * c[2] + (1.0 - u) * v * c[3]);
    };
    for (int i = 0; i < nu; ++i)
      for (int j = 0; j < nv; ++j) {
        const Vec3 middle = at(i + 0.5, j + 0.5);
        const std::array<Vec3, 4> p{at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)};
        for (std::size_t k = 0; k < 4; ++k) cells.push_back({p[k], p[(k + 1) % 4], middle});
      }
    return cells;
  }
  const std::size_t m = c.size();
  double longest = 0.0;
  Vec3 middle = Vec3::Zero();
  for (std::size_t k = 0; k < m; ++k) {
    middle += c[k] / double(m);
    for (std::size_t l = 0; l < k; ++l) longest = std::max(longest, (like[k] - like[l]).norm());
  }
  const int n = pieces(longest);
  for (std::size_t k = 0; k < m; ++k) {
    const auto at = [&](int i, int j) { return Vec3(middle + (double(i) / n) * (c[k] - middle) + (double(j) / n) * (c[(k + 1) % m] - middle)); };
    for (int i = 0; i < n; ++i)
      for (int j = 0; i + j < n; ++j) {
        cells.push_back({at(i, j), at(i + 1, j), at(i, j + 1)});
        if (i + j + 1 < n) cells.push_back({at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)});
      }
  }
  return cells;
}
inline std::vector<std::array<Vec3, 3>> polygon_cells(const std::vector<Vec3>& c, double size_m) { return polygon_cells(c, c, size_m); }

}  // namespace lumo::detail

// ---- lumo/optics/set_back.hpp

namespace lumo::detail {

/// Corners of a carrier face, moved away from the lit side by `gap_m`, or by twice as much as the points `soft` of the body lie behind
/// it if that is more: where a body rests on its carrier the two may cross a little, and light in the gap must still meet the carrier.
/// Throws InvalidArgument for a face that is not a polygon of finite corners with an area.
inline std::vector<Vec3> set_back(const RigidFace& face, const std::vector<Vec3>& soft, double gap_m) {
  const double reach = 1e-3;  // [m]; what lies deeper behind the face does not rest on it
  const std::vector<Vec3>& c = face.corners;
  const std::size_t m = c.size();
  if (m < 3) throw InvalidArgument(text("carrier face '", face.name, "' has ", m, " corners, needs 3"));
  for (const Vec3& p : c)
    if (!p.allFinite()) throw InvalidArgument(text("carrier face '", face.name, "': a corner is not finite"));
  Vec3 n = Vec3::Zero();
  for (std::size_t k = 1; k + 1 < m; ++k) n += (c[k] - c[0]).cross(c[k + 1] - c[0]);
  if (!(n.norm() > 0.0)) throw InvalidArgument(text("carrier face '", face.name, "' has no area"));
  n.normalize();
  std::vector<Vec3> out(m);  // in-plane outward normals of the edges
  for (std::size_t k = 0; k < m; ++k) out[k] = (c[(k + 1) % m] - c[k]).cross(n).normalized();
  double back = gap_m;
  for (const Vec3& x : soft) {
    const double depth = n.dot(c[0] - x);
    if (depth <= 0.5 * back || depth > reach) continue;
    bool over = true;
    for (std::size_t k = 0; k < m && over; ++k) over = out[k].dot(x - c[k]) < 0.0;
    if (over) back = 2.0 * depth;
  }
  // Standing back opens slits along the rim: the face is made larger in its plane, so that light cannot slip through.
  std::vector<Vec3> corner(m);
  for (std::size_t k = 0; k < m; ++k) {
    const Vec3& a = out[(k + m - 1) % m];
    corner[k] = c[k] - back * n + 10.0 * back * (a + out[k]) / (1.0 + std::max(-0.9, a.dot(out[k])));
  }
  return corner;
}

}  // namespace lumo::detail

// ---- lumo/optics/fresnel.hpp

namespace lumo {

/// A smooth interface met under a given angle: share of the power that is reflected, and the cosine behind it.
struct FresnelSplit {
  double reflectance;    ///< 1 under total internal reflection
  double cosine_behind;  ///< of the refracted ray to the normal; 0 under total internal reflection
};

/// Unpolarised power reflectance of a smooth dielectric interface.
/// `cosine` in [0, 1] in front, `index_ratio` = n in front / n behind. Laws: reciprocity (the same on the way back), R + T = 1,
/// ((n−1)/(n+1))² at normal incidence, R_p = 0 at Brewster's angle. Source: Fresnel 1823; Born & Wolf, Principles of Optics, §1.5.
inline FresnelSplit fresnel(double cosine, double index_ratio) {
  const double sine2 = index_ratio * index_ratio * (1.0 - cosine * cosine);
  if (!(sine2 < 1.0)) return {1.0, 0.0};
  const double behind = std::sqrt(1.0 - sine2);
  const double s = (index_ratio * cosine - behind) / (index_ratio * cosine + behind);
  const double p = (cosine - index_ratio * behind) / (cosine + index_ratio * behind);
  return {0.5 * (s * s + p * p), behind};
}

/// Mirror image of the unit direction `d` in the plane with unit normal `n`.
inline Vec3 reflect(const Vec3& d, const Vec3& n) { return (d - 2.0 * d.dot(n) * n).normalized(); }

/// Refracted direction of the unit direction `d` by Snell's law; `n` is the unit normal on the side that light comes from.
inline Vec3 refract(const Vec3& d, const Vec3& n, double index_ratio, double cosine_behind) {
  return (index_ratio * (d - d.dot(n) * n) - cosine_behind * n).normalized();
}

}  // namespace lumo

// ---- lumo/optics/surface_optics.hpp

namespace lumo {

// The policies themselves (Dielectric, Lambertian, Mirror, Absorber) are data of a body: morphology/optical_data.hpp.
// Here is what light does there. Dielectric is the one that lets light through; the tracer splits it by fresnel().

/// Reflectance of an opaque surface [–], in [0, 1]. What is not reflected is booked as absorbed there.
constexpr double reflectance(const Lambertian& s) { return s.albedo; }
constexpr double reflectance(const Mirror& s) { return s.reflectance; }
constexpr double reflectance(const Absorber&) { return 0.0; }

namespace detail {

/// Two unit tangents that make a right-handed frame with the unit vector `n` (after Duff et al., JCGT 6(1), 2017).
inline void tangents(const Vec3& n, Vec3& t1, Vec3& t2) {
  const double sign = n.z() < -0.6180339887 ? -1.0 : 1.0;  // not at 0: walls are upright, and rounding must not turn their frames
  const double a = -1.0 / (sign + n.z()), b = n.x() * n.y() * a;
  t1 = {1.0 + sign * n.x() * n.x() * a, sign * b, -sign * n.x()};
  t2 = {b, sign + n.y() * n.y() * a, -n.y()};
}

/// Direction about the axis `n` with density cos θ/π from two numbers in (0, 1); the azimuth starts at `t1`.
inline Vec3 cosine_direction(const Vec3& t1, const Vec3& t2, const Vec3& n, double u, double azimuth) {
  const double sine = std::sqrt(u);
  return (sine * std::cos(azimuth) * t1 + sine * std::sin(azimuth) * t2 + std::sqrt(1.0 - u) * n).normalized();
}

}  // namespace detail

/// Where opaque surfaces send light: unit direction for the incoming unit direction `d`, unit normal `n` on the lit side, and two
/// numbers in (0, 1). `mirror` (±1, ±1, 1) is the mirror image that the path belongs to: image paths take image directions.
inline Vec3 reflected(const Lambertian&, const Vec3&, const Vec3& n, double u, double v, const Vec3& mirror) {
  const Vec3 m = mirror.cwiseProduct(n);
  Vec3 t1, t2;
  detail::tangents(m, t1, t2);
  return mirror.cwiseProduct(detail::cosine_direction(t1, t2, m, u, 2.0 * pi * v));
}
inline Vec3 reflected(const Mirror&, const Vec3& d, const Vec3& n, double, double, const Vec3&) { return reflect(d, n); }
inline Vec3 reflected(const Absorber&, const Vec3&, const Vec3& n, double, double, const Vec3&) { return n; }

/// An opaque surface. Law: 0 ≤ reflectance ≤ 1, and reflected() stays on the lit side.
template <class S>
concept OpaqueSurface = requires(const S& s, const Vec3& v) {
  { reflectance(s) } -> std::convertible_to<double>;
  { reflected(s, v, v, 0.5, 0.5, v) } -> std::convertible_to<Vec3>;
};

static_assert(OpaqueSurface<Lambertian> && OpaqueSurface<Mirror> && OpaqueSurface<Absorber>);
static_assert(!OpaqueSurface<Dielectric>);

inline bool is_dielectric(const SurfaceOptics& s) { return std::holds_alternative<Dielectric>(s); }

/// Throws InvalidArgument for a reflectance outside [0, 1].
inline void validate(const SurfaceOptics& optics) {
  std::visit(
      [](const auto& s) {
        if constexpr (OpaqueSurface<std::decay_t<decltype(s)>>) require_in_range("surface reflectance", reflectance(s), 0.0, 1.0, "");
      },
      optics);
}

}  // namespace lumo

// ---- lumo/optics/optical_scene.hpp

namespace lumo {

/// Where a ray met the scene.
struct ScenePoint {
  int face = -1;              ///< boundary face of the mesh; −1 on a carrier face
  double b1 = 0.0, b2 = 0.0;  ///< barycentric in the face (of corners 1 and 2)
  double u = 0.0, v = 0.0;    ///< barycentric in the flat triangle (of corners 1 and 2)
};

/// The surface of a body in one state, as light meets it: every face of the mesh cut into sub_facets² triangles on its quadratic map,
/// plus the carrier faces. Knows exact normals, regions (by undeformed position), contact, and the optics of each face.
class OpticalScene {
 public:
  struct Config {
    int sub_facets = 3;            ///< each edge of a quadratic face is cut into this many; linear faces are not cut
    double carrier_gap_m = 20e-6;  ///< carrier faces stand back by this, or by as far as the body is pressed into them if that is more
    double carrier_cell_m = 2.5e-3;  ///< carrier faces are cut into cells of at most this size
  };

  /// `displacement` [m] and `contact_field` per mesh node; either may be empty (undeformed, no contact).
  /// `images`: also label regions for mirror images in the planes of this symmetry.
  /// Throws InvalidArgument for wrong sizes, numbers that are not finite (−infinity is allowed in the field), bad indices or optics.
  OpticalScene(const Body& body, const TetMesh& mesh, const std::vector<Vec3>& displacement, const std::vector<double>& contact_field,
               Symmetry images, const Config& config);

  const std::vector<SceneTriangle>& triangles() const { return triangles_; }

  /// Locates the point `p` [m] on triangle `t`.
  ScenePoint locate(int t, const Vec3& p) const;
  /// Unit normal of triangle `t` (flat, outward).
  Vec3 flat_normal(int t) const;
  /// Unit outward normal of the deformed body.
  Vec3 smooth_normal(const ScenePoint& p) const { return detail::on_quadratic(faces_[std::size_t(p.face)].normal, p.b1, p.b2).normalized(); }
  /// Undeformed position [m].
  Vec3 reference(const ScenePoint& p) const { return detail::on_quadratic(faces_[std::size_t(p.face)].reference, p.b1, p.b2); }
  /// Inside the contact set {φ > 0}, φ linear on the four sub-triangles of the face?
  bool in_contact(const ScenePoint& p) const { return faces_[std::size_t(p.face)].in_contact(p.b1, p.b2); }
  /// Region of the point, or of its mirror image `image` (bit 0: x → −x, bit 1: y → −y).
  int region(const ScenePoint& p, unsigned image) const;
  const SurfaceOptics& optics(int t) const {
    if (!on_body(t)) return body_->rigid_faces[std::size_t(rigid_[std::size_t(t) - body_triangles_])].optics;
    return body_->patches[std::size_t(faces_[std::size_t(t / triangles_per_face())].patch)].optics;
  }
  int triangles_per_face() const { return int(lattice_.size()); }
  bool on_body(int t) const { return std::size_t(t) < body_triangles_; }
  double triangle_area(int t) const;
  double area(int face) const;      ///< of its triangles [m²]
  bool has_region(int face) const { return labels_[0][std::size_t(face)] != -1; }  ///< may a point of it lie in a region?
  std::size_t face_count() const { return faces_.size(); }
  /// Triangle of a face at barycentric (b1, b2), and the point of that (flat) triangle there [m].
  int triangle_at(int face, double b1, double b2, Vec3& point) const;
  const Patch& patch(int face) const { return body_->patches[std::size_t(faces_[std::size_t(face)].patch)]; }
  /// Corners of a face, or of one of its sub-facets (sub ≥ 0), in the undeformed body [m].
  std::array<Vec3, 3> reference_corners(int face, int sub) const;
  /// Corners of triangle `t` in the undeformed body; of a carrier face, where it stands without gap [m].
  std::array<Vec3, 3> reference_corners(int t) const {
    if (!on_body(t)) return rigid_reference_[std::size_t(t) - body_triangles_];
    return reference_corners(t / triangles_per_face(), t % triangles_per_face());
  }
  /// Region of a place on a patch, or of its mirror image.
  int region(int patch, const Vec3& reference, unsigned image) const;
  int patch_number(const ScenePoint& p) const { return faces_[std::size_t(p.face)].patch; }
  /// Number that tells surfaces apart: the patch of a triangle of the body, or a carrier face.
  int surface_number(int t) const {
    return on_body(t) ? faces_[std::size_t(t / triangles_per_face())].patch : int(body_->patches.size()) + rigid_[std::size_t(t) - body_triangles_];
  }
  /// A point a little inside the body from the point `p` on triangle `t`: towards the inside and the middle of the triangle.
  Vec3 pulled_inward(int t, const Vec3& p) const;

 private:
  static constexpr int mixed = -2;
  void add_faces(const TetMesh& mesh, const std::vector<Vec3>& displacement, const std::vector<double>& contact_field);
  void add_carrier(const Config& config);
  void label(Symmetry images);

  const Body* body_;
  int n_;                                                   ///< cuts per edge
  std::vector<std::array<std::array<int, 2>, 3>> lattice_;  ///< (b1, b2)·n of the corners of each sub-facet
  std::vector<detail::QuadraticFace> faces_;
  std::vector<SceneTriangle> triangles_;
  std::vector<int> rigid_;  ///< carrier face of each triangle after those of the body
  std::vector<std::array<Vec3, 3>> rigid_reference_;
  std::size_t body_triangles_ = 0;
  std::array<std::vector<int>, 4> labels_;  ///< per image and face: region, or `mixed`
};

inline OpticalScene::OpticalScene(const Body& body, const TetMesh& mesh, const std::vector<Vec3>& displacement,
                                  const std::vector<double>& contact_field, Symmetry images, const Config& config)
    : body_(&body), n_(mesh.order == 2 ? config.sub_facets : 1) {
  require_in_range("sub-facets per edge", config.sub_facets, 1, 64, "");
  require_in_range("carrier gap", config.carrier_gap_m * 1e6, 0.0, 1000.0, "um");
  require_in_range("carrier cell", config.carrier_cell_m * 1e3, 1e-3, 1e6, "mm");
  if (mesh.order != 1 && mesh.order != 2) throw InvalidArgument(detail::text("optical scene: mesh order ", mesh.order, ", must be 1 or 2"));
  for (const Patch& p : body.patches) validate(p.optics);
  for (const RigidFace& f : body.rigid_faces) validate(f.optics);
  if (body.regions > 0 && !body.region) throw InvalidArgument("optical scene: the body has regions but no region function");
  for (int i = 0; i < n_; ++i)
    for (int j = 0; i + j < n_; ++j) {
      lattice_.push_back({{{i, j}, {i + 1, j}, {i, j + 1}}});
      if (i + j + 1 < n_) lattice_.push_back({{{i + 1, j}, {i + 1, j + 1}, {i, j + 1}}});
    }
  add_faces(mesh, displacement, contact_field);
  detail::recover_normals(faces_, mesh.faces, body);
  body_triangles_ = triangles_.size();
  add_carrier(config);
  label(images);
}

inline void OpticalScene::add_faces(const TetMesh& mesh, const std::vector<Vec3>& displacement, const std::vector<double>& contact_field) {
  const std::size_t nodes = mesh.nodes.size();
  if (!displacement.empty() && displacement.size() != nodes)
    throw InvalidArgument(detail::text("optical scene: ", displacement.size(), " displacements for ", nodes, " nodes"));
  if (!contact_field.empty() && contact_field.size() != nodes)
    throw InvalidArgument(detail::text("optical scene: ", contact_field.size(), " contact values for ", nodes, " nodes"));
  if (mesh.faces.empty()) throw InvalidArgument("optical scene: the mesh has no boundary faces");
  const double none = -std::numeric_limits<double>::infinity();
  faces_.reserve(mesh.faces.size());
  triangles_.reserve(mesh.faces.size() * lattice_.size());
  for (const BoundaryFace& face : mesh.faces) {
    if (face.patch < 0 || std::size_t(face.patch) >= body_->patches.size())
      throw InvalidArgument(detail::text("optical scene: face of patch ", face.patch, ", the body has ", body_->patches.size()));
    detail::QuadraticFace f;
    f.patch = face.patch;
    const std::size_t given = mesh.order == 2 ? 6 : 3;
    for (std::size_t k = 0; k < given; ++k) {
      const std::size_t node = std::size_t(face.nodes[k]);
      if (face.nodes[k] < 0 || node >= nodes)
        throw InvalidArgument(detail::text("optical scene: face with node ", face.nodes[k], " of ", nodes));
      f.reference[k] = mesh.nodes[node];
      f.deformed[k] = displacement.empty() ? mesh.nodes[node] : Vec3(mesh.nodes[node] + displacement[node]);
      f.contact[k] = contact_field.empty() ? none : contact_field[node];
      if (!f.deformed[k].allFinite() || !(f.deformed[k].cwiseAbs().maxCoeff() < 1e6))
        throw InvalidArgument(detail::text("optical scene: node ", node, " is not at a finite place below 1e6 m"));
      if (!(f.contact[k] < std::numeric_limits<double>::infinity()))
        throw InvalidArgument(detail::text("optical scene: contact field of node ", node, " is ", f.contact[k]));
    }
    for (std::size_t k = given; k < 6; ++k) {
      const std::size_t a = k - 3, b = (a + 1) % 3;
      f.reference[k] = 0.5 * (f.reference[a] + f.reference[b]);
      f.deformed[k] = 0.5 * (f.deformed[a] + f.deformed[b]);
      f.contact[k] = 0.5 * (f.contact[a] + f.contact[b]);
    }
    f.may_touch = *std::max_element(f.contact.begin(), f.contact.end()) > 0.0;
    faces_.push_back(f);
    const auto at = [&](const std::array<int, 2>& k) { return detail::lattice_point(f.deformed, face.nodes, n_, k[0], k[1]); };
    for (const auto& c : lattice_) triangles_.push_back({{at(c[0]), at(c[1]), at(c[2])}, false});
  }
}

// The cells are made on the face as it stands, and moved back as a whole: light that is spread over them sees the same cells in every state.
inline void OpticalScene::add_carrier(const Config& config) {
  std::vector<Vec3> soft;
  for (const detail::QuadraticFace& f : faces_)
    if (is_dielectric(body_->patches[std::size_t(f.patch)].optics)) soft.insert(soft.end(), f.deformed.begin(), f.deformed.end());
  for (std::size_t i = 0; i < body_->rigid_faces.size(); ++i) {
    const std::vector<Vec3>& place = body_->rigid_faces[i].corners;
    const std::vector<Vec3> corner = detail::set_back(body_->rigid_faces[i], soft, config.carrier_gap_m);
    const auto cells = detail::polygon_cells(place, config.carrier_cell_m);
    const auto moved = detail::polygon_cells(corner, place, config.carrier_cell_m);
    for (std::size_t k = 0; k < cells.size(); ++k) {
      triangles_.push_back({moved[k], true});
      rigid_reference_.push_back(cells[k]);
      rigid_.push_back(int(i));
    }
  }
}

inline int OpticalScene::region(int patch, const Vec3& reference, unsigned image) const {
  if (!body_->region) return -1;
  const Vec3 mirror(image & 1u ? -1.0 : 1.0, image & 2u ? -1.0 : 1.0, 1.0);
  const Vec3 n = outward_normal(*body_, patch, reference);
  const int r = body_->region(mirror.cwiseProduct(reference), mirror.cwiseProduct(n));
  return r >= 0 && r < body_->regions ? r : -1;
}

// Faces whose nodes share a region need no look-up at a hit; most do.
inline void OpticalScene::label(Symmetry images) {
  for (unsigned image = 0; image < 4; ++image) {
    if (((image & 1u) && !images.x) || ((image & 2u) && !images.y)) continue;
    for (const detail::QuadraticFace& f : faces_) {
      std::array<int, 6> r{};
      for (std::size_t k = 0; k < 6; ++k) r[k] = region(f.patch, f.reference[k], image);
      labels_[image].push_back(std::all_of(r.begin(), r.end(), [&](int x) { return x == r[0]; }) ? r[0] : mixed);
    }
  }
}

inline int OpticalScene::region(const ScenePoint& p, unsigned image) const {
  const int known = labels_[image][std::size_t(p.face)];
  return known != mixed ? known : region(faces_[std::size_t(p.face)].patch, reference(p), image);
}

inline ScenePoint OpticalScene::locate(int t, const Vec3& p) const {
  const auto& [a, b, c] = triangles_[std::size_t(t)].corners;
  const Vec3 e1 = b - a, e2 = c - a, n = e1.cross(e2);
  const double f = 1.0 / n.squaredNorm();
  const auto unit = [](double x) { return x > 0.0 ? std::min(x, 1.0) : 0.0; };  // also takes NaN, of a triangle without area
  double u = unit(f * n.dot((p - a).cross(e2))), v = unit(f * n.dot(e1.cross(p - a)));
  if (const double s = u + v; s > 1.0) u /= s, v /= s;
  ScenePoint r;
  r.u = u, r.v = v;
  if (!on_body(t)) return r;
  r.face = t / int(lattice_.size());
  const auto& l = lattice_[std::size_t(t) % lattice_.size()];
  r.b1 = (l[0][0] + u * (l[1][0] - l[0][0]) + v * (l[2][0] - l[0][0])) / n_;
  r.b2 = (l[0][1] + u * (l[1][1] - l[0][1]) + v * (l[2][1] - l[0][1])) / n_;
  return r;
}

inline std::array<Vec3, 3> OpticalScene::reference_corners(int face, int sub) const {
  const std::array<Vec3, 6>& x = faces_[std::size_t(face)].reference;
  if (sub < 0) return {x[0], x[1], x[2]};
  std::array<Vec3, 3> corners;
  for (std::size_t k = 0; k < 3; ++k) {
    const auto& [i, j] = lattice_[std::size_t(sub)][k];
    corners[k] = detail::on_quadratic(x, double(i) / n_, double(j) / n_);
  }
  return corners;
}

inline double OpticalScene::triangle_area(int t) const {
  const auto& [a, b, c] = triangles_[std::size_t(t)].corners;
  return 0.5 * (b - a).cross(c - a).norm();
}

inline double OpticalScene::area(int face) const {
  double sum = 0.0;
  for (int k = 0; k < triangles_per_face(); ++k) sum += triangle_area(face * triangles_per_face() + k);
  return sum;
}

inline int OpticalScene::triangle_at(int face, double b1, double b2, Vec3& point) const {
  const double x = b1 * n_, y = b2 * n_;
  int i = std::clamp(int(x), 0, n_ - 1), j = std::clamp(int(y), 0, n_ - 1 - i);
  double u = x - i, v = y - j;
  const bool upper = u + v > 1.0 && i + j + 1 < n_;
  const int t = face * int(lattice_.size()) + 2 * n_ * i - i * i + 2 * j + (upper ? 1 : 0);
  const auto& [a, b, c] = triangles_[std::size_t(t)].corners;
  point = upper ? Vec3((1.0 - v) * a + (u + v - 1.0) * b + (1.0 - u) * c) : Vec3((1.0 - u - v) * a + u * b + v * c);
  return t;
}

inline Vec3 OpticalScene::flat_normal(int t) const {
  const auto& [a, b, c] = triangles_[std::size_t(t)].corners;
  return (b - a).cross(c - a).normalized();
}

inline Vec3 OpticalScene::pulled_inward(int t, const Vec3& p) const {
  const auto& [a, b, c] = triangles_[std::size_t(t)].corners;
  const double size = std::sqrt((b - a).cross(c - a).norm());
  return p + 1e-4 * ((a + b + c) / 3.0 - p) - 1e-5 * size * flat_normal(t);
}

}  // namespace lumo

// ---- lumo/optics/place_key.hpp

namespace lumo::detail {

/// A place to about a nanometre, for look-ups.
using PlaceKey = std::array<long long, 3>;

// The odd unit keeps round coordinates off the borders of its cells.
inline PlaceKey place_key(const Vec3& p) {
  constexpr double unit = 1.0471975512e-9;
  return {std::llround(p.x() / unit), std::llround(p.y() / unit), std::llround(p.z() / unit)};
}

/// The mirror image of `p` with x ≥ 0 and y ≥ 0, as far as there is `symmetry`.
inline Vec3 folded(Vec3 p, Symmetry symmetry) {
  if (symmetry.x) p.x() = std::abs(p.x());
  if (symmetry.y) p.y() = std::abs(p.y());
  return p;
}

}  // namespace lumo::detail

// ---- lumo/optics/light_nodes.hpp

namespace lumo::detail {

/// Corners of all triangles of Lambertian surfaces, each with the function that is 1 there, 0 at its neighbours and linear in between.
/// Light that falls on such a surface is shared by the three nodes about it: shares vary continuously with the place and add up to 1.
/// Source: linear elements for radiosity, Heckbert (thesis, 1991). In a plane of `symmetry` mirror images are one node.
class LightNodes {
 public:
  LightNodes(const OpticalScene& scene, Symmetry symmetry) : of_(scene.triangles().size(), std::array<int, 3>{-1, -1, -1}) {
    // Surfaces share a node where they are one patch, or cells of one plane of the carrier. Mirror images may be patches of their own.
    std::map<PlaceKey, int> patch_at;
    const auto place = [&](int t) {
      const auto [a, b, c] = scene.reference_corners(t);
      return place_key(folded((a + b + c) / 3.0, symmetry));
    };
    for (int t = 0; t < int(of_.size()) && scene.on_body(t); ++t)
      if (std::holds_alternative<Lambertian>(scene.optics(t))) {
        const auto [it, fresh] = patch_at.try_emplace(place(t), scene.surface_number(t));
        it->second = std::min(it->second, scene.surface_number(t));
      }
    std::map<std::tuple<int, PlaceKey, PlaceKey, double>, int> known;
    for (int t = 0; t < int(of_.size()); ++t) {
      const SurfaceOptics& optics = scene.optics(t);
      const Lambertian* surface = std::get_if<Lambertian>(&optics);
      if (surface == nullptr) continue;
      const std::array<Vec3, 3> corner = scene.reference_corners(t);
      Vec3 side = Vec3::Zero();
      if (!scene.on_body(t)) {
        const Vec3 middle = (corner[0] + corner[1] + corner[2]) / 3.0;
        side = 1e-3 * (corner[1] - corner[0]).cross(corner[2] - corner[0]).normalized();
        if (symmetry.x && middle.x() < 0.0) side.x() = -side.x();
        if (symmetry.y && middle.y() < 0.0) side.y() = -side.y();
      }
      const int patch = scene.on_body(t) ? patch_at[place(t)] : -1;
      for (std::size_t k = 0; k < 3; ++k) {
        const auto key = std::tuple(patch, place_key(folded(corner[k], symmetry)), place_key(side), surface->albedo);
        const auto [it, fresh] = known.try_emplace(key, int(albedo_.size()));
        if (fresh) albedo_.push_back(surface->albedo), area_.push_back(0.0);
        of_[std::size_t(t)][k] = it->second;
        area_[std::size_t(it->second)] += scene.triangle_area(t) / 3.0;
      }
    }
  }

  std::size_t size() const { return albedo_.size(); }
  /// The three nodes of a triangle; −1: it is not Lambertian.
  const std::array<int, 3>& of(int triangle) const { return of_[std::size_t(triangle)]; }
  /// Shares of the nodes at a point of a triangle.
  static std::array<double, 3> shares(const ScenePoint& p) { return {1.0 - p.u - p.v, p.u, p.v}; }
  double albedo(std::size_t node) const { return albedo_[node]; }
  /// Integral of the node's function, over all its mirror images [m²].
  double area(std::size_t node) const { return area_[node]; }

 private:
  std::vector<std::array<int, 3>> of_;
  std::vector<double> albedo_, area_;
};

}  // namespace lumo::detail

// ---- lumo/optics/exit_power.hpp

namespace lumo {

/// Light that left the body for good: where it last crossed the surface, and where it goes.
struct Escape {
  Vec3 reference;   ///< last exit point in the undeformed body [m]
  Vec3 position;    ///< the same point, deformed [m]
  Vec3 direction;   ///< unit, in air
  int region = -1;  ///< Body::region of the last exit point
};

/// Sorts escaping light into channels. A photodiode or a camera with a finite aperture asks whether (position, direction) reaches it.
/// Laws: a pure function; the channel lies in [0, channels(body)), or is −1 for light that is not seen.
template <class R>
concept ExitReadout = requires(const R& readout, const Body& body, const Escape& escape) {
  { readout.channels(body) } -> std::convertible_to<int>;
  { readout.channel(escape) } -> std::convertible_to<int>;
};

/// All power that leaves through each region of the body, whatever its direction (model reading of paper §III: r_b).
struct ExitPower {
  int channels(const Body& body) const { return body.regions; }
  int channel(const Escape& escape) const { return escape.region; }
};

static_assert(ExitReadout<ExitPower>);
static_assert(!ExitReadout<int>);

}  // namespace lumo

// ---- lumo/optics/emitter.hpp

namespace lumo {

/// Unit normal of the radiating side.
inline Vec3 normal(const RectangleEmitter& e) { return e.half_u.cross(e.half_v).normalized(); }
/// Point [m] from two numbers in (0, 1), uniform in area.
inline Vec3 point(const RectangleEmitter& e, double u, double v) {
  return e.center + (2.0 * u - 1.0) * e.half_u + (2.0 * v - 1.0) * e.half_v;
}

/// A flat source with a cosine law (Lambert 1760) into the medium that it touches; power_W is all that it radiates.
/// Laws: point() is uniform in area over (0, 1)²; |normal| = 1.
template <class E>
concept FlatEmitter = requires(const E& e, double u) {
  { point(e, u, u) } -> std::convertible_to<Vec3>;
  { normal(e) } -> std::convertible_to<Vec3>;
  { e.power_W } -> std::convertible_to<double>;
};

static_assert(FlatEmitter<RectangleEmitter>);

/// Throws InvalidArgument for no emitters, numbers that are not finite, no area, or a power that is not positive.
inline void validate(const std::vector<RectangleEmitter>& emitters) {
  if (emitters.empty()) throw InvalidArgument("emitters: none given, at least one is needed");
  for (const RectangleEmitter& e : emitters) {
    require_positive("emitter power", e.power_W, "W");
    if (!e.center.allFinite() || !e.half_u.allFinite() || !e.half_v.allFinite())
      throw InvalidArgument("emitter: a coordinate is not finite");
    require_positive("emitter area", 4.0 * e.half_u.cross(e.half_v).norm(), "m2");
  }
}

}  // namespace lumo

// ---- lumo/optics/ray_pattern.hpp

namespace lumo {

/// A primary ray and what later events of its path draw their numbers from.
struct PrimaryRay {
  Vec3 origin = Vec3::Zero();      ///< [m]
  Vec3 direction = Vec3::UnitZ();  ///< unit
  std::uint64_t key = 0;           ///< the same for mirror images of a path
  int triangle = -1;               ///< of the scene that it starts on, if known
};

/// The one deterministic set of primary rays for all designs, states and emitters. Closed under x → −x and y → −y: a point of the
/// sequence makes a ray of the emitter moved to the quadrant x ≥ 0, y ≥ 0, and the rays of the real emitters are its mirror images.
/// An emitter that is its own mirror image shoots into a half or a quarter of the hemisphere only, so that nothing is traced twice.
class RayPattern {
 public:
  /// The rays of one emitter that belong to one mirror image.
  struct Beam {
    RectangleEmitter source;  ///< moved to the fundamental quadrant
    Vec3 normal, tangent1, tangent2;
    double azimuth_from = 0.0, azimuth_range = 2.0 * pi;
    Vec3 mirror = Vec3::Ones();  ///< (±1, ±1, 1): from the fundamental ray to the real one
    std::uint64_t orbit = 0;     ///< the same for emitters that are mirror images
    std::uint32_t rays = 0;      ///< per replicate
    double power_W = 0.0;        ///< per ray
  };

  /// `rays` per emitter and replicate, a power of two ≥ 4. With `symmetry` only one beam of each set of mirror images is kept.
  /// Throws InvalidArgument for broken emitters, or when they do not have the symmetry.
  RayPattern(const std::vector<RectangleEmitter>& emitters, std::uint32_t rays, Symmetry symmetry);

  const std::vector<Beam>& beams() const { return beams_; }

  /// Ray `index` of a beam, from numbers in (0, 1): square of the sine and azimuth of its direction, then its place on the emitter.
  static PrimaryRay ray(const Beam& beam, const std::array<double, 4>& u, std::uint64_t seed, std::uint32_t index) {
    const double azimuth = beam.azimuth_from + beam.azimuth_range * u[1];
    const Vec3 d = detail::cosine_direction(beam.tangent1, beam.tangent2, beam.normal, u[0], azimuth);
    const Vec3 p = point(beam.source, u[2], u[3]);
    return {beam.mirror.cwiseProduct(p), beam.mirror.cwiseProduct(d), detail::combine(detail::combine(seed, beam.orbit), index), -1};
  }
  static PrimaryRay ray(const Beam& beam, const OwenSobol& sequence, std::uint32_t index) {
    return ray(beam, {sequence(index, 0), sequence(index, 1), sequence(index, 2), sequence(index, 3)}, sequence.seed, index);
  }

  /// Is the set of emitters its own mirror image in each plane?
  static Symmetry symmetry_of(const std::vector<RectangleEmitter>& emitters);

 private:
  std::vector<Beam> beams_;
};

namespace detail {

/// Mirror image of an emitter. It radiates to the image of its normal, so the handedness of its edges is mended.
inline RectangleEmitter mirrored(const RectangleEmitter& e, const Vec3& m) {
  RectangleEmitter image = e;
  image.center = m.cwiseProduct(e.center);
  image.half_u = m.cwiseProduct(e.half_u);
  image.half_v = m.cwiseProduct(e.half_v) * m.prod();
  return image;
}

/// Do two emitters radiate alike? Edges may point either way.
inline bool same(const RectangleEmitter& a, const RectangleEmitter& b) {
  const double tolerance = 1e-9 * (a.half_u.norm() + a.half_v.norm());
  const auto parallel = [&](const Vec3& p, const Vec3& q) { return std::min((p - q).norm(), (p + q).norm()) <= tolerance; };
  return (a.center - b.center).norm() <= tolerance && parallel(a.half_u, b.half_u) && parallel(a.half_v, b.half_v) &&
         normal(a).dot(normal(b)) > 0.5 && a.power_W == b.power_W && a.channel == b.channel;
}

/// The mirror image with centre (and, in a plane, normal) in x ≥ 0, y ≥ 0 and edges in a standard sense.
inline RectangleEmitter fundamental(const RectangleEmitter& e, Vec3& mirror) {
  const double tolerance = 1e-9 * (e.half_u.norm() + e.half_v.norm());
  mirror = Vec3::Ones();
  for (Eigen::Index a = 0; a < 2; ++a) {
    const bool in_plane = std::abs(e.center[a]) <= tolerance;
    if (in_plane ? normal(e)[a] < -1e-9 : e.center[a] < 0.0) mirror[a] = -1.0;
  }
  RectangleEmitter f = mirrored(e, mirror);
  Eigen::Index k = 0;
  f.half_u.cwiseAbs().maxCoeff(&k);
  if (f.half_u[k] < 0.0) f.half_u = -f.half_u, f.half_v = -f.half_v;
  return f;
}

inline const Vec3 flip_x{-1.0, 1.0, 1.0}, flip_y{1.0, -1.0, 1.0};

}  // namespace detail

inline Symmetry RayPattern::symmetry_of(const std::vector<RectangleEmitter>& emitters) {
  const auto closed = [&](const Vec3& m) {
    return std::all_of(emitters.begin(), emitters.end(), [&](const auto& e) {
      return std::any_of(emitters.begin(), emitters.end(), [&](const auto& other) { return detail::same(detail::mirrored(e, m), other); });
    });
  };
  return {closed(detail::flip_x), closed(detail::flip_y)};
}

inline RayPattern::RayPattern(const std::vector<RectangleEmitter>& emitters, std::uint32_t rays, Symmetry symmetry) {
  validate(emitters);
  const Symmetry has = symmetry_of(emitters);
  if ((symmetry.x && !has.x) || (symmetry.y && !has.y))
    throw InvalidArgument("ray pattern: a symmetric state is claimed, but the emitters are not symmetric");
  std::vector<RectangleEmitter> orbits;
  for (const RectangleEmitter& e : emitters) {
    Beam beam;
    Vec3 home;
    beam.source = detail::fundamental(e, home);
    const auto known = std::find_if(orbits.begin(), orbits.end(), [&](const auto& o) { return detail::same(o, beam.source); });
    beam.orbit = std::uint64_t(known - orbits.begin());
    if (known == orbits.end()) orbits.push_back(beam.source);
    beam.source = orbits[beam.orbit];  // the very same bits for all images
    beam.normal = normal(beam.source);
    const bool own_x = detail::same(detail::mirrored(beam.source, detail::flip_x), beam.source);
    const bool own_y = detail::same(detail::mirrored(beam.source, detail::flip_y), beam.source);
    detail::tangents(beam.normal, beam.tangent1, beam.tangent2);
    if (own_x || own_y) {
      beam.tangent1 = own_x ? Vec3::UnitX() : Vec3::UnitY();
      beam.tangent2 = beam.normal.cross(beam.tangent1);
      beam.azimuth_from = own_x && own_y ? 0.0 : -0.5 * pi;
      beam.azimuth_range = own_x && own_y ? 0.5 * pi : pi;
    }
    const std::uint32_t images = (own_x ? 2u : 1u) * (own_y ? 2u : 1u);
    beam.rays = std::max(1u, rays / images);
    beam.power_W = e.power_W / double(beam.rays * images);
    for (std::uint32_t image = 0; image < 4; ++image) {
      if (((image & 1u) && !own_x) || ((image & 2u) && !own_y)) continue;
      beam.mirror = home;
      if (image & 1u) beam.mirror.x() = -beam.mirror.x();
      if (image & 2u) beam.mirror.y() = -beam.mirror.y();
      if ((symmetry.x && beam.mirror.x() < 0.0) || (symmetry.y && beam.mirror.y() < 0.0)) continue;
      beams_.push_back(beam);
    }
  }
}

}  // namespace lumo

// ---- lumo/optics/face_set.hpp

namespace lumo::detail {

/// Some faces of the body, or triangles of the scene, each with a block of a low-discrepancy sequence as large as its area asks for: points
/// and directions on it that do not depend on the state, and are mirror images on faces that are mirror images. In a plane of `symmetry`
/// mirror images are one face.
class FaceSet {
 public:
  struct Face {
    int face;                         ///< of the body; −1: a single triangle
    int triangle;                     ///< of the scene
    Vec3 mirror;                      ///< (±1, ±1, 1): from the image with x ≥ 0, y ≥ 0 to this face
    std::array<int, 3> corner_order;  ///< corners in an order that mirror images share
    std::uint32_t first = 0;          ///< place in the sequence of rays; the same for mirror images
    std::uint32_t count = 0;          ///< samples of this face, a power of two
  };

  /// `wanted(triangle)` says which belong to it. `whole`: only faces of the body, asked with their first triangle; else all triangles.
  /// About `total` samples in all, counting mirror images that are not traced; at least `least` on each face.
  template <class Predicate>
  FaceSet(const OpticalScene& scene, Symmetry symmetry, bool whole, double total, std::uint32_t least, Predicate&& wanted);

  std::size_t size() const { return faces_.size(); }
  const Face& operator[](std::size_t k) const { return faces_[k]; }
  /// Does a point on the body lie on one of the faces?
  bool has(const ScenePoint& p) const { return p.face >= 0 && member_[std::size_t(p.face)]; }

  /// A point on a face.
  struct Sample {
    ScenePoint at;
    PrimaryRay ray;           ///< starts there; its direction is left open
    Vec3 normal;              ///< unit outward normal of the flat triangle
    double area = 0.0;        ///< that it stands for [m²]
    std::uint32_t index = 0;  ///< in the sequence
  };
  /// Sample `i` of face `k`. Takes dimensions 2 and 3 of the sequence; 0 and 1 are for its direction.
  Sample sample(std::size_t k, const OpticalScene& scene, const OwenSobol& sequence, std::uint32_t i) const;

 private:
  // Place along Morton's curve, 10 bits an axis; cells do not line up with regular grids.
  static std::uint64_t morton(const Vec3& unit_cube);
  void number(const std::vector<Vec3>& centers, const std::vector<double>& areas, const std::vector<int>& images, double total, std::uint32_t least);

  int per_face_;  ///< sub-facets of a face
  std::vector<Face> faces_;
  std::vector<char> member_;  ///< per face of the body
};

inline std::uint64_t FaceSet::morton(const Vec3& p) {
  std::uint64_t code = 0;
  for (int bit = 9; bit >= 0; --bit)
    for (Eigen::Index a = 0; a < 3; ++a) code = (code << 1) | ((std::uint64_t(std::clamp(p[a], 0.0, 1.0) * 1013.37 + 0.318) >> bit) & 1u);
  return code;
}

template <class Predicate>
FaceSet::FaceSet(const OpticalScene& scene, Symmetry symmetry, bool whole, double total, std::uint32_t least, Predicate&& wanted)
    : per_face_(scene.triangles_per_face()), member_(scene.face_count(), 0) {
  std::map<PlaceKey, int> known;  // folded by the symmetry → index
  std::vector<Vec3> centers;      // with x ≥ 0, y ≥ 0
  std::vector<double> areas;      // undeformed [m²]
  std::vector<int> images;        // faces folded onto each
  std::vector<bool> in_plane;
  const auto add = [&](int f, int triangle, const std::array<Vec3, 3>& corner) {
    const Vec3 center = (corner[0] + corner[1] + corner[2]) / 3.0;
    Vec3 mirror = Vec3::Ones();
    for (Eigen::Index a = 0; a < 2; ++a)
      if (center[a] < -1e-9) mirror[a] = -1.0;
    const bool fundamental = !(symmetry.x && mirror.x() < 0.0) && !(symmetry.y && mirror.y() < 0.0);
    Face face{f, triangle, mirror, {0, 1, 2}};
    std::sort(face.corner_order.begin(), face.corner_order.end(), [&](int a, int b) {
      return place_key(mirror.cwiseProduct(corner[std::size_t(a)])) < place_key(mirror.cwiseProduct(corner[std::size_t(b)]));
    });
    const auto [it, fresh] = known.try_emplace(place_key(folded(center, symmetry)), int(faces_.size()));
    const std::size_t k = std::size_t(it->second);
    if (fresh) {
      faces_.push_back(face);
      centers.push_back(mirror.cwiseProduct(center));
      areas.push_back(0.5 * (corner[1] - corner[0]).cross(corner[2] - corner[0]).norm());
      images.push_back(0);
      in_plane.push_back(std::abs(center.x()) < 1e-9 || std::abs(center.y()) < 1e-9);
    } else if (fundamental) {
      faces_[k] = face;
    }
    ++images[k];
  };
  for (int f = 0; whole && f < int(scene.face_count()); ++f)
    if (wanted(f * per_face_)) add(f, -1, scene.reference_corners(f, -1)), member_[std::size_t(f)] = 1;
  for (int t = 0; !whole && t < int(scene.triangles().size()); ++t)
    if (wanted(t)) add(-1, t, scene.reference_corners(t));
  const int expected = (symmetry.x ? 2 : 1) * (symmetry.y ? 2 : 1);
  for (std::size_t k = 0; k < faces_.size(); ++k)
    if (images[k] != expected && !in_plane[k])
      throw InvalidArgument("optical scene: a symmetric state is claimed, but the surface mesh is not symmetric");
  number(centers, areas, images, total, least);
}

// Neighbours take neighbouring blocks of the sequence: together they are stratified more finely than each alone.
inline void FaceSet::number(const std::vector<Vec3>& centers, const std::vector<double>& areas, const std::vector<int>& images, double total,
                            std::uint32_t least) {
  struct Block {
    std::uint64_t code = 0;
    std::uint32_t first = 0, count = 0;
  };
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low;
  double area = 0.0;
  for (std::size_t k = 0; k < faces_.size(); ++k) {
    low = low.cwiseMin(centers[k]), high = high.cwiseMax(centers[k]);
    area += areas[k] * images[k];
  }
  const double scale = faces_.empty() ? 1.0 : 1.0 / std::max(1e-12, (high - low).maxCoeff());
  std::map<PlaceKey, Block> blocks;  // what is found for one of two mirror images serves both: rounding could part them
  for (std::size_t k = 0; k < faces_.size(); ++k) {
    const std::uint32_t wish = std::uint32_t(std::min(double(1 << 24), 1.4142 * total * areas[k] / area));
    blocks.try_emplace(place_key(centers[k]), Block{morton(scale * (centers[k] - low)), 0, std::bit_floor(std::max(least, wish))});
  }
  std::map<std::pair<std::uint64_t, PlaceKey>, Block*> order;
  for (auto& [place, block] : blocks) order[{block.code, place}] = &block;
  std::uint32_t next = 0;
  for (auto& [place, block] : order) {  // blocks of 2^m numbers start at multiples of 2^m: each is a net
    block->first = (next + block->count - 1) / block->count * block->count;
    next = block->first + block->count;
  }
  for (std::size_t k = 0; k < faces_.size(); ++k) {
    const Block& block = blocks[place_key(centers[k])];
    faces_[k].first = block.first, faces_[k].count = block.count;
  }
}

inline FaceSet::Sample FaceSet::sample(std::size_t k, const OpticalScene& scene, const OwenSobol& sequence, std::uint32_t i) const {
  const Face& f = faces_[k];
  Sample x;
  x.index = f.first + i;
  const double s = std::sqrt(sequence(x.index, 2)), v = sequence(x.index, 3);
  std::array<double, 3> b{};
  b[std::size_t(f.corner_order[0])] = 1.0 - s;
  b[std::size_t(f.corner_order[1])] = s * (1.0 - v);
  b[std::size_t(f.corner_order[2])] = s * v;
  if (f.face >= 0) {
    x.ray.triangle = scene.triangle_at(f.face, b[1], b[2], x.ray.origin);
  } else {
    x.ray.triangle = f.triangle;
    const auto& [p, q, r] = scene.triangles()[std::size_t(x.ray.triangle)].corners;
    x.ray.origin = b[0] * p + b[1] * q + b[2] * r;
  }
  x.ray.key = combine(sequence.seed, x.index);
  x.at = scene.locate(x.ray.triangle, x.ray.origin);
  const auto& [p, q, r] = scene.triangles()[std::size_t(x.ray.triangle)].corners;
  const Vec3 normal = (q - p).cross(r - p);
  x.normal = normal.normalized();
  x.area = 0.5 * normal.norm() * (f.face >= 0 ? per_face_ : 1) / f.count;
  return x;
}

}  // namespace lumo::detail

// ---- lumo/optics/light_accounts.hpp

namespace lumo::detail {

/// Where the power of some paths went: booked, or arrived at nodes of Lambertian faces (index, power) from where it goes on.
struct Tally {
  EnergyLedger ledger;
  std::vector<double> direct;    ///< part of the channels: direct light, but not what `gathered` has
  std::vector<double> gathered;  ///< part of the channels that ExitGather finds with less noise
  std::vector<std::pair<int, double>> arrived;
};

/// Light from an emitter that left the body for good after reflections.
struct Exit {
  std::uint64_t route;  ///< the same for paths that met the same surfaces in the same way
  Escape light;         ///< of the traced one of the mirror images; its region is not looked up
  ScenePoint at;
  Vec3 normal;          ///< of the flat facet
  int patch;
  double power;  ///< [W], of one image
};

/// Where the power of paths is booked. A traced path stands for all its mirror images.
template <ExitReadout Readout>
class LightAccounts {
 public:
  LightAccounts(const OpticalScene& surface, const Readout& readout, int channels, std::size_t nodes, Symmetry symmetry)
      : surface_(surface), readout_(readout), channels_(std::size_t(channels)), arrived_(nodes, 0.0) {
    for (unsigned image = 0; image < 4; ++image)
      if (!((image & 1u) && !symmetry.x) && !((image & 2u) && !symmetry.y)) images_.push_back(image);
    reset();
  }

  const std::vector<unsigned>& images() const { return images_; }

  /// `power` [W] of one image, for all of them.
  void book(double& account, double power) { account += power * double(images_.size()); }
  /// Light that falls on a Lambertian face.
  void arrive(int node, double power) {
    double& sum = arrived_[std::size_t(node)];
    if (!(sum > 0.0)) reached_.push_back(node);
    book(sum, power);
  }
  /// Books an exit in a channel, or elsewhere (−1). `power` is that of one image.
  void book_exit(int channel, double power) { (seen(channel) ? ledger.channels[std::size_t(channel)] : ledger.elsewhere) += power; }
  /// Books an exit of all images. `is_direct`: refracted out at most; `is_gathered`: ExitGather finds it, too.
  void book_exit(const Exit& e, bool is_direct, bool is_gathered) {
    for (unsigned image : images_) {
      const int c = channel(e, image);
      book_exit(c, e.power);
      if (!seen(c)) continue;
      if (is_gathered)
        gathered_[std::size_t(c)] += e.power;
      else if (is_direct)
        direct_[std::size_t(c)] += e.power;
    }
  }
  /// Channel of an exit, or −1.
  int channel(const Exit& e, unsigned image) const {
    const Vec3 m(image & 1u ? -1.0 : 1.0, image & 2u ? -1.0 : 1.0, 1.0);
    return readout_.channel({m.cwiseProduct(e.light.reference), m.cwiseProduct(e.light.position), m.cwiseProduct(e.light.direction),
                             e.at.face >= 0 ? surface_.region(e.at, image) : surface_.region(e.patch, e.light.reference, image)});
  }

  /// What was booked since the last call.
  Tally take() {
    Tally t{std::move(ledger), std::move(direct_), std::move(gathered_), {}};
    for (int k : reached_) t.arrived.emplace_back(k, arrived_[std::size_t(k)]), arrived_[std::size_t(k)] = 0.0;
    reached_.clear();
    reset();
    return t;
  }
  /// Σ weight(node)·(power that arrived there), for all that arrived since the last call; forgets everything else that was booked.
  template <class Weight>
  double collect(Weight&& weight) {
    double sum = 0.0;
    for (int k : reached_) sum += weight(std::size_t(k)) * arrived_[std::size_t(k)], arrived_[std::size_t(k)] = 0.0;
    reached_.clear();
    return sum;
  }

  EnergyLedger ledger;

 private:
  bool seen(int channel) const { return channel >= 0 && std::size_t(channel) < ledger.channels.size(); }
  void reset() {
    ledger = {};
    ledger.channels.assign(channels_, 0.0);
    direct_ = gathered_ = ledger.channels;
  }

  const OpticalScene& surface_;
  const Readout& readout_;
  std::size_t channels_;
  std::vector<unsigned> images_;
  std::vector<double> direct_, gathered_;  ///< as in Tally
  std::vector<double> arrived_;            ///< per node
  std::vector<int> reached_;               ///< nodes with arrived_ > 0
};

}  // namespace lumo::detail

// ---- lumo/optics/path_tracer.hpp

namespace lumo::detail {

struct PathLimits {
  double roulette_below;
  int max_events;
};

/// Follows one primary ray through all its branches and books where its power goes. One object per replicate.
/// The medium is a state of the ray, never inferred from counted hits.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout>
class PathTracer {
 public:
  /// `nodes`: collect what falls on Lambertian faces. `exits`: faces whose light ExitGather finds, if it came straight from an emitter or a face.
  PathTracer(const OpticalScene& surface, const Scene& scene, const Medium& medium, double outer_index, const Readout& readout,
             int channels, const LightNodes& nodes, const FaceSet& exits, Symmetry symmetry, const PathLimits& limits)
      : surface_(surface),
        scene_(scene),
        medium_(medium),
        outer_index_(outer_index),
        nodes_(nodes),
        exits_(exits),
        limits_(limits),
        accounts_(surface, readout, channels, nodes.size(), symmetry) {}

  /// Traces `ray`, which starts in the body, or (`inside` false) in the air, as a path of the mirror image `mirror`.
  /// `from_emitter`: not from a Lambertian face. `log`: takes the exits of light from emitters that no gathering finds, instead of the channels.
  void run(const PrimaryRay& ray, const Vec3& mirror, double power_W, bool from_emitter, bool inside = true, std::vector<Exit>* log = nullptr) {
    ++rays;
    mirror_ = mirror;
    start_ = power_W;
    from_emitter_ = from_emitter;
    accounts_.book(accounts_.ledger.emitted, power_W);
    Branch first;
    first.origin = ray.origin, first.direction = ray.direction, first.power = power_W, first.key = ray.key;
    first.triangle = ray.triangle, first.direct = from_emitter, first.inside = inside;
    log_ = log;
    stack_.push_back(first);
    while (!stack_.empty()) {
      const Branch b = stack_.back();
      stack_.pop_back();
      follow(b);
    }
  }

  /// Where the power went.
  LightAccounts<Readout>& accounts() { return accounts_; }

  long rays = 0, segments = 0;

 private:
  struct Branch {
    Vec3 origin = Vec3::Zero(), direction = Vec3::Zero();
    double power = 0.0;
    std::uint64_t key = 0;
    int exit_triangle = -1;
    ScenePoint exit;  ///< where a ray in air left the body
    Vec3 exit_position = Vec3::Zero();
    std::uint64_t route = 0;
    int triangle = -1;  ///< that it starts on
    int events = 0;
    bool inside = true;
    bool direct = true;         ///< light that was refracted out at most
    bool carrier_last = false;  ///< in air: met the carrier since it left the body
  };

  // Russian roulette; what it ends or adds has its own account, so that the ledger closes. False: ended.
  bool survives(Branch& b) {
    b.direct = false;
    if (!(b.power > 0.0)) return false;
    const double full = limits_.roulette_below * start_;
    if (b.power >= full) return true;
    if (uniform(combine(b.key, 0)) * full < b.power) {
      accounts_.book(accounts_.ledger.roulette, b.power - full);
      b.power = full;
      return true;
    }
    accounts_.book(accounts_.ledger.roulette, b.power);
    return false;
  }

  void escape(const Branch& b) {
    EnergyLedger& ledger = accounts_.ledger;
    if (b.exit.face < 0) return accounts_.book(ledger.elsewhere, b.power);
    const bool gathered = exits_.has(b.exit) && !b.carrier_last && (b.direct || !from_emitter_);
    const Escape light{surface_.reference(b.exit), b.exit_position, b.direction, -1};
    const Exit e{b.route, light, b.exit, surface_.flat_normal(b.exit_triangle), surface_.patch_number(b.exit), b.power};
    if (log_ != nullptr && from_emitter_ && !gathered)
      log_->push_back(e);
    else
      accounts_.book_exit(e, b.direct, gathered);
  }

  void follow(Branch b);
  bool meet(Branch& b, int triangle);
  bool meet_dielectric(Branch& b, int triangle, const ScenePoint& at);

  const OpticalScene& surface_;
  const Scene& scene_;
  const Medium& medium_;
  double outer_index_;
  const LightNodes& nodes_;
  const FaceSet& exits_;
  PathLimits limits_;
  LightAccounts<Readout> accounts_;
  std::vector<Exit>* log_ = nullptr;
  std::vector<Branch> stack_;
  Vec3 mirror_ = Vec3::Ones();
  double start_ = 0.0;
  bool from_emitter_ = true;
};

template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout>
void PathTracer<Scene, Medium, Readout>::follow(Branch b) {
  for (;;) {
    RayHit hit;
    if (++b.events <= limits_.max_events && b.direction.allFinite() && b.origin.allFinite()) {
      ++segments;
      hit = scene_.first_hit(b.origin, b.direction, b.inside);
      if (!hit && !b.inside) return escape(b);
      if (!hit && b.triangle >= 0) {  // slipped out by rounding at an edge: once more from a point that is surely inside
        b.origin = surface_.pulled_inward(b.triangle, b.origin);
        hit = scene_.first_hit(b.origin, b.direction, b.inside);
      }
    }
    if (!hit) return accounts_.book(accounts_.ledger.lost, b.power);
    const auto& corner = surface_.triangles()[std::size_t(hit.triangle)].corners;
    const Vec3 n = (corner[1] - corner[0]).cross(corner[2] - corner[0]);
    const double t = std::max(0.0, n.dot(corner[0] - b.origin) / n.dot(b.direction));  // single-precision scenes: t again in double
    const double path_m = std::isfinite(t) ? t : std::max(0.0, hit.t);
    b.origin += path_m * b.direction;
    if (b.inside) {
      const double left = b.power * medium_.transmittance(path_m);
      accounts_.book(accounts_.ledger.absorbed_in_medium, b.power - left);
      b.power = left;
    }
    if (!meet(b, hit.triangle)) return;
  }
}

// What happens at a surface. True: `b` goes on.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout>
bool PathTracer<Scene, Medium, Readout>::meet(Branch& b, int triangle) {
  const ScenePoint at = surface_.locate(triangle, b.origin);
  b.triangle = triangle;
  const SurfaceOptics& optics = surface_.optics(triangle);
  if (is_dielectric(optics)) {
    if (at.face >= 0) return meet_dielectric(b, triangle, at);
    accounts_.book(accounts_.ledger.absorbed_at_surfaces, b.power);  // a carrier face is opaque, whatever it says
    return false;
  }
  if (const auto& nodes = nodes_.of(triangle); nodes[0] >= 0 && b.inside == (at.face >= 0)) {  // goes on with all else that falls there
    const std::array<double, 3> share = LightNodes::shares(at);
    for (std::size_t k = 0; k < 3; ++k)
      if (share[k] > 0.0) accounts_.arrive(nodes[k], share[k] * b.power);
    return false;
  }
  const Vec3 n = b.inside ? Vec3(-surface_.flat_normal(triangle)) : surface_.flat_normal(triangle);
  const std::uint64_t key = combine(b.key, 1);
  std::visit(
      [&](const auto& s) {
        if constexpr (OpaqueSurface<std::decay_t<decltype(s)>>) {
          const double kept = b.power * reflectance(s);
          accounts_.book(accounts_.ledger.absorbed_at_surfaces, b.power - kept);
          b.power = kept;
          b.direction = reflected(s, b.direction, n, uniform(combine(key, 2)), uniform(combine(key, 3)), mirror_);
        }
      },
      optics);
  b.key = key;
  b.carrier_last = !b.inside;
  return survives(b);
}

template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout>
bool PathTracer<Scene, Medium, Readout>::meet_dielectric(Branch& b, int triangle, const ScenePoint& at) {
  const bool touched = surface_.in_contact(at);
  if (!b.inside && touched) {  // from air: the opaque indenter is in the way
    accounts_.book(accounts_.ledger.to_indenter, b.power);
    return false;
  }
  const double side = b.inside ? -1.0 : 1.0;  // normals point back to where the light comes from
  const double ratio = b.inside ? medium_.refractive_index() / outer_index_ : outer_index_ / medium_.refractive_index();
  const Vec3 flat = side * surface_.flat_normal(triangle);
  Vec3 n = side * surface_.smooth_normal(at);
  FresnelSplit split{};
  Vec3 back, on;
  const auto turn = [&] {
    const double cosine = std::min(1.0, -b.direction.dot(n));
    split = fresnel(cosine, ratio);
    back = reflect(b.direction, n);
    on = refract(b.direction, n, ratio, split.cosine_behind);
    return cosine > 0.0 && back.dot(flat) > 0.0 && (split.reflectance >= 1.0 || on.dot(flat) < 0.0);
  };
  if (!turn()) {  // at grazing angles the curved normal may contradict the facet that was hit
    n = flat;
    turn();
  }
  const double reflected_power = b.power * split.reflectance;
  const double refracted_power = b.power - reflected_power;
  const std::uint64_t key = b.key, route = combine(b.route, 2 * std::uint64_t(surface_.surface_number(triangle)));
  if (refracted_power > 0.0) {
    if (b.inside && touched) {
      accounts_.book(accounts_.ledger.to_indenter, refracted_power);
    } else {
      Branch c = b;
      c.direction = on;
      c.power = refracted_power;
      c.key = combine(key, 4);
      c.route = route + 1;
      c.inside = !b.inside;
      if (c.inside) {
        if (survives(c)) stack_.push_back(c);
      } else {
        c.exit = at;
        c.exit_triangle = triangle;
        c.exit_position = b.origin;
        c.carrier_last = false;
        stack_.push_back(c);
      }
    }
  }
  b.direction = back;
  b.power = reflected_power;
  b.key = combine(key, 5);
  b.route = route;
  return survives(b);
}

}  // namespace lumo::detail

// ---- lumo/optics/carrier_exchange.hpp

namespace lumo::detail {

/// Adds `factor` × the accounts of `part`, `emitted` too.
inline void add(EnergyLedger& sum, const EnergyLedger& part, double factor) {
  for (std::size_t c = 0; c < sum.channels.size(); ++c) sum.channels[c] += factor * part.channels[c];
  sum.emitted += factor * part.emitted;
  sum.to_indenter += factor * part.to_indenter;
  sum.elsewhere += factor * part.elsewhere;
  sum.absorbed_in_medium += factor * part.absorbed_in_medium;
  sum.absorbed_at_surfaces += factor * part.absorbed_at_surfaces;
  sum.roulette += factor * part.roulette;
  sum.refinement += factor * part.refinement;
  sum.lost += factor * part.lost;
}

/// Where one watt from each node of Lambertian faces goes.
class CarrierTransport {
 public:
  CarrierTransport(std::size_t nodes, int channels) : sums_(nodes), weights_(nodes, 0.0) {
    for (Tally& t : sums_) t.gathered.assign(std::size_t(channels), 0.0), t.ledger.channels = t.gathered;
  }
  /// Adds what became of a ray of one watt that stands for the area `area_m2` about a point with these shares of the nodes.
  void add(const Tally& ray, const std::array<int, 3>& nodes, const std::array<double, 3>& shares, double area_m2) {
    for (std::size_t k = 0; k < 3; ++k) {
      const double w = shares[k] * area_m2;
      Tally& sum = sums_[std::size_t(nodes[k])];
      weights_[std::size_t(nodes[k])] += w;
      detail::add(sum.ledger, ray.ledger, w);
      for (std::size_t c = 0; c < sum.gathered.size(); ++c) sum.gathered[c] += w * ray.gathered[c];
      for (const auto& [j, power] : ray.arrived) sum.arrived.emplace_back(j, w * power);
    }
  }
  std::size_t size() const { return sums_.size(); }
  const Tally& sum(std::size_t node) const { return sums_[node]; }
  /// What sum(node) is to be multiplied by; 0 where nothing was added.
  double per_watt(std::size_t node) const { return weights_[node] > 0.0 ? 1.0 / weights_[node] : 0.0; }

 private:
  std::vector<Tally> sums_;
  std::vector<double> weights_;
};

/// Light that falls on a Lambertian face goes on as a Lambertian source that is linear between nodes (radiosity: Goral et al. 1984). Which
/// rays a face sends does not depend on what arrives, so that states differ smoothly, and further bounces cost no rays. Sends on what arrived
/// at the nodes, bounce after bounce, until less than 1e-13 of the emitted power is under way. `total`: the emitters' own tally, completed
/// here. Returns what each node sent [W]. Jacobi iteration of the radiosity equation p = e + Tᵀ(albedo·p); it ends because every factor is
/// at most 1.
inline std::vector<double> exchange(const LightNodes& nodes, const CarrierTransport& transport, Tally& total) {
  std::vector<double> now(nodes.size(), 0.0), next(nodes.size(), 0.0), sent(nodes.size(), 0.0);
  for (const auto& [k, power] : total.arrived) now[std::size_t(k)] += power;
  EnergyLedger& ledger = total.ledger;
  const double emitted = ledger.emitted;
  double left = 0.0;
  for (int bounce = 0; bounce < 10000; ++bounce) {
    left = 0.0;
    for (std::size_t k = 0; k < nodes.size(); ++k) {
      const double on = now[k] * nodes.albedo(k);
      ledger.absorbed_at_surfaces += now[k] - on;
      sent[k] += on;
      const double each = on * transport.per_watt(k);
      if (each > 0.0)
        for (const auto& [j, share] : transport.sum(k).arrived) next[std::size_t(j)] += each * share;
    }
    for (double p : next) left += p;
    now.swap(next);
    std::fill(next.begin(), next.end(), 0.0);
    if (left < 1e-13 * emitted) break;
  }
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    const double each = sent[k] * transport.per_watt(k);
    add(ledger, transport.sum(k).ledger, each);
    for (std::size_t c = 0; c < total.gathered.size(); ++c) total.gathered[c] += each * transport.sum(k).gathered[c];
  }
  ledger.emitted = emitted;
  ledger.lost += left;
  return sent;
}

}  // namespace lumo::detail

// ---- lumo/optics/exit_beams.hpp

namespace lumo::detail {

/// Light from the emitters that reaches the readout by reflections, without the noise of rays that jump over borders of regions: rays from one
/// point of an emitter form a grid of directions, and where the three rays of a triangle of neighbours go the same way, their power is
/// spread over the triangle of their exits, linearly, and cut exactly at the borders (beams: Heckbert & Hanrahan 1984). Rays whose neighbours
/// go another way are booked where they are. All power is kept; what spreading changes falls with the square of the grid's spacing.
template <class Path>
class ExitBeams {
 public:
  explicit ExitBeams(Path& path) : path_(path) {}

  /// Traces all rays of a beam: grids of directions, each from one place on the emitter and shifted its own way. Places come in pairs opposite
  /// each other about the middle; places and shifts are a net. With more rays there are more places and finer grids.
  void run(const RayPattern::Beam& beam, const OwenSobol& sequence) {
    const std::uint32_t pairs = std::bit_floor(std::max(1u, std::uint32_t(std::sqrt(double(beam.rays)) / 16.0)));
    const std::uint32_t places = std::min(beam.rays, 2u * pairs), directions = beam.rays / places;
    std::uint32_t rows = 1, columns = 1;  // in sin², in azimuth; cells of a full circle are made squarer
    while (rows * columns < directions) (columns < rows * (beam.azimuth_range > 2.0 ? 2u : 1u) ? columns : rows) *= 2u;
    const bool around = beam.azimuth_range > 6.0;
    for (std::uint32_t place = 0; place < places; ++place) {
      const double shift_u = sequence(place, 0), shift_v = sequence(place, 1), at_u = sequence(place / 2, 2), at_v = sequence(place / 2, 3);
      const double place_u = place % 2 ? 1.0 - at_u : at_u, place_v = place % 2 ? 1.0 - at_v : at_v;
      exits_.clear();
      first_.assign(1, 0);
      for (std::uint32_t i = 0; i < rows; ++i)
        for (std::uint32_t j = 0; j < columns; ++j) {
          const std::array<double, 4> u{(i + shift_u) / rows, (j + shift_v) / columns, place_u, place_v};
          path_.run(RayPattern::ray(beam, u, sequence.seed, (place * rows + i) * columns + j), beam.mirror, beam.power_W, true, true, &exits_);
          first_.push_back(exits_.size());
        }
      left_.assign(exits_.size(), 6);
      const auto at = [&](std::uint32_t i, std::uint32_t j) { return i * columns + j % columns; };
      for (std::uint32_t i = 0; i + 1 < rows; ++i)
        for (std::uint32_t j = 0; j + (around ? 0 : 1) < columns; ++j) {
          spread(at(i, j), at(i + 1, j), at(i, j + 1));
          spread(at(i + 1, j + 1), at(i, j + 1), at(i + 1, j));
        }
      for (std::size_t e = 0; e < exits_.size(); ++e)
        for (unsigned image : path_.accounts().images())
          if (left_[e] > 0) path_.accounts().book_exit(path_.accounts().channel(exits_[e], image), exits_[e].power * left_[e] / 6.0);
    }
  }

 private:
  using Weights = std::array<double, 3>;  ///< of the three exits
  struct Corner {
    Weights at;
    int channel;
  };

  // Each exit has six triangles about it, and gives each a sixth of its power.
  void spread(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    const auto same = [&](std::uint32_t ray, const Exit& e) -> std::size_t {
      for (std::size_t k = first_[ray]; k < first_[ray + 1]; ++k)
        if (exits_[k].route == e.route && exits_[k].normal.dot(e.normal) > 0.5) return k;
      return exits_.size();
    };
    for (std::size_t k = first_[a]; k < first_[a + 1]; ++k) {
      const std::size_t l = same(b, exits_[k]), m = same(c, exits_[k]);
      if (l == exits_.size() || m == exits_.size()) continue;
      corner_ = {&exits_[k], &exits_[l], &exits_[m]};
      --left_[k], --left_[l], --left_[m];
      for (unsigned image : path_.accounts().images()) {
        image_ = image;
        std::array<Corner, 3> t;
        for (std::size_t n = 0; n < 3; ++n) t[n] = {{}, path_.accounts().channel(*corner_[n], image)}, t[n].at[n] = 1.0;
        book(t[0], t[1], t[2], 1.0, 0);
      }
    }
  }

  static Weights mix(const Weights& a, const Weights& b, double t) {
    return {a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2])};
  }
  int channel(const Weights& w) const {
    Exit e = *corner_[0];
    e.at.face = -1;  // between the rays: its place on the surface is not known
    for (Vec3 Escape::*part : {&Escape::reference, &Escape::position, &Escape::direction})
      e.light.*part = w[0] * (corner_[0]->light.*part) + w[1] * (corner_[1]->light.*part) + w[2] * (corner_[2]->light.*part);
    e.light.direction.normalize();
    return path_.accounts().channel(e, image_);
  }
  void book(const Weights& a, const Weights& b, const Weights& c, double area, int channel) {
    double power = 0.0;
    for (std::size_t n = 0; n < 3; ++n) power += (a[n] + b[n] + c[n]) / 3.0 * corner_[n]->power;
    path_.accounts().book_exit(channel, 0.5 * area * power);  // three exits give a sixth each
  }

  // `area`: share of the whole triangle. Where one corner differs the border is found on its two edges; else the triangle is quartered.
  void book(const Corner& a, const Corner& b, const Corner& c, double area, int depth) {
    if (a.channel == b.channel && b.channel == c.channel) return book(a.at, b.at, c.at, area, a.channel);
    const Corner* odd = a.channel == b.channel ? &c : b.channel == c.channel ? &a : a.channel == c.channel ? &b : nullptr;
    const Corner *next = odd == &a ? &b : odd == &b ? &c : &a, *last = odd == &a ? &c : odd == &b ? &a : &b;
    if (odd != nullptr) {
      bool two = true;
      const auto border = [&](const Corner& other) {
        double low = 0.0, high = 1.0;
        for (int step = 0; step < 12 && two; ++step) {
          const double t = 0.5 * (low + high);
          const int here = channel(mix(odd->at, other.at, t));
          two = here == odd->channel || here == other.channel;
          (here == odd->channel ? low : high) = t;
        }
        return 0.5 * (low + high);
      };
      const double s = border(*next), t = two ? border(*last) : 0.0;
      if (two) {
        const Weights p = mix(odd->at, next->at, s), q = mix(odd->at, last->at, t);
        book(odd->at, p, q, area * s * t, odd->channel);
        book(p, next->at, last->at, area * (1.0 - s), next->channel);
        book(p, last->at, q, area * s * (1.0 - t), next->channel);
        return;
      }
    }
    if (depth == 4) {
      for (const Corner* k : {&a, &b, &c}) book(k->at, k->at, k->at, area / 3.0, k->channel);
      return;
    }
    const auto middle = [&](const Corner& p, const Corner& q) {
      const Weights w = mix(p.at, q.at, 0.5);
      return Corner{w, channel(w)};
    };
    const Corner ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
    book(a, ab, ca, area / 4.0, depth + 1), book(ab, b, bc, area / 4.0, depth + 1);
    book(ca, bc, c, area / 4.0, depth + 1), book(ab, bc, ca, area / 4.0, depth + 1);
  }

  Path& path_;
  std::vector<Exit> exits_;
  std::vector<std::size_t> first_;  ///< exit of each ray
  std::vector<int> left_;           ///< sixths of each exit that are not spread
  std::array<const Exit*, 3> corner_{};
  unsigned image_ = 0;
};

}  // namespace lumo::detail

// ---- lumo/optics/exit_gather.hpp

namespace lumo::detail {

/// Finds the light that leaves through faces with regions *from those faces*, instead of waiting for paths to come there: few do.
/// Direct light: points of the face × points of the emitters. Light of the carrier: a path from outside into the body ends on Lambertian
/// faces; by Helmholtz's reciprocity their light takes it backwards (L/n² is kept but for Fresnel and extinction: Clausius 1864;
/// Veach, thesis, 1997, ch. 5). Points lie fixed in the undeformed body: no sample crosses a region's border, so states differ smoothly.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout>
class ExitGather {
 public:
  ExitGather(const Body& body, const OpticalScene& surface, const Scene& scene, const Medium& medium, double outer_index,
             const Readout& readout, int channels, const LightNodes& nodes, const FaceSet& exits, Symmetry symmetry,
             PathTracer<Scene, Medium, Readout>& path)
      : surface_(surface),
        scene_(scene),
        medium_(medium),
        ratio_(medium.refractive_index() / outer_index),
        readout_(readout),
        channels_(channels),
        nodes_(nodes),
        exits_(exits),
        path_(path) {
    for (unsigned image = 0; image < 4; ++image) {
      if (!((image & 1u) && !symmetry.x) && !((image & 2u) && !symmetry.y)) images_.push_back(image);
      const Vec3 m(image & 1u ? -1.0 : 1.0, image & 2u ? -1.0 : 1.0, 1.0);
      for (const RectangleEmitter& e : body.emitters) emitters_[image].push_back({standard(mirrored(e, m)), mirror(normal(e), m)});
    }
  }

  /// Replaces the gathered part of the channels of `total`; `sent`: power of the nodes [W], their images included.
  void run(const OwenSobol& sequence, const std::vector<double>& sent, Tally& total) {
    if (exits_.size() == 0) return;
    direct_.assign(std::size_t(channels_), 0.0);
    diffuse_ = direct_;
    for (std::size_t k = 0; k < exits_.size(); ++k) {
      const std::uint32_t count = exits_[k].count, direct = (count + direct_every - 1) / direct_every;
      for (std::uint32_t i = 0; i < count; ++i) {
        FaceSet::Sample x = exits_.sample(k, surface_, sequence, i);
        if (surface_.in_contact(x.at)) continue;
        reference_ = surface_.reference(x.at);
        for (unsigned image : images_) region_[image] = surface_.region(x.at, image);
        Vec3 n = surface_.smooth_normal(x.at);
        if (!n.allFinite()) n = x.normal;
        if (i % direct_every == 0) gather_direct(x, n, exits_[k].mirror, sequence, x.area * count / direct);
        gather_diffuse(x, n, exits_[k].mirror, sequence, sent);
      }
    }
    path_.accounts().take();  // the paths ran backwards: what they booked on their way is not power
    for (std::size_t c = 0; c < direct_.size(); ++c) {
      const double better = direct_[c] + diffuse_[c] - total.gathered[c];
      total.ledger.channels[c] += better;
      total.ledger.refinement -= better;
      total.direct[c] += direct_[c];
    }
  }

 private:
  struct Source {
    RectangleEmitter emitter;  ///< mirrored to the side of the fundamental face
    Vec3 normal;
  };

  /// Direct light is smooth in place: one point of this many will do.
  static constexpr std::uint32_t direct_every = 2;

  static Vec3 mirror(const Vec3& p, const Vec3& m) { return m.cwiseProduct(p); }
  static RectangleEmitter standard(RectangleEmitter e) {
    for (Vec3* h : {&e.half_u, &e.half_v}) {
      Eigen::Index k = 0;
      h->cwiseAbs().maxCoeff(&k);
      if ((*h)[k] < 0.0) *h = -*h;
    }
    return e;
  }

  // Books `power` for every image, if the way out is free and the readout sees it.
  void book(std::vector<double>& account, const FaceSet::Sample& x, const Vec3& out, double power) const {
    for (unsigned image : images_) {
      const int channel = channel_of(x, out, image);
      if (channel >= 0 && channel < channels_) account[std::size_t(channel)] += power;
    }
  }
  int channel_of(const FaceSet::Sample& x, const Vec3& out, unsigned image) const {
    const Vec3 m(image & 1u ? -1.0 : 1.0, image & 2u ? -1.0 : 1.0, 1.0);
    return readout_.channel({mirror(reference_, m), mirror(x.ray.origin, m), mirror(out, m), region_[image]});
  }
  bool seen(const FaceSet::Sample& x, const Vec3& out) const {
    bool any = false;
    for (unsigned image : images_) any = any || channel_of(x, out, image) >= 0;
    return any && !scene_.first_hit(x.ray.origin, out, false);
  }

  void gather_direct(const FaceSet::Sample& x, const Vec3& n, const Vec3& m, const OwenSobol& sequence, double area) {
    const double u = sequence(x.index, 4), v = sequence(x.index, 5);
    for (const Source& s : emitters_[(m.x() < 0.0 ? 1u : 0u) + (m.y() < 0.0 ? 2u : 0u)]) {
      const Vec3 from = mirror(point(s.emitter, u, v), m), way = x.ray.origin - from;
      const double length = way.norm();
      const Vec3 d = way / length;
      const double leaves = d.dot(mirror(s.normal, m)), meets = d.dot(x.normal), cosine = std::min(1.0, d.dot(n));
      if (!(leaves > 0.0 && meets > 0.0 && cosine > 0.0)) continue;
      const FresnelSplit split = fresnel(cosine, ratio_);
      if (split.reflectance >= 1.0) continue;
      const Vec3 out = refract(d, -n, ratio_, split.cosine_behind);
      if (out.dot(x.normal) <= 0.0 || !seen(x, out)) continue;
      ++path_.segments;
      const RayHit hit = scene_.first_hit(from, d, true);
      if (!hit || hit.t < length - 1e-6 * length) continue;
      const double power = s.emitter.power_W / pi * leaves * meets / (length * length) * area * (1.0 - split.reflectance);
      book(direct_, x, out, power * medium_.transmittance(length));
    }
  }

  void gather_diffuse(FaceSet::Sample& x, const Vec3& n, const Vec3& m, const OwenSobol& sequence, const std::vector<double>& sent) {
    const Vec3 out = reflected(Lambertian{}, n, n, sequence(x.index, 0), sequence(x.index, 1), m);
    if (out.dot(x.normal) <= 0.0) return;
    const FresnelSplit split = fresnel(std::min(1.0, out.dot(n)), 1.0 / ratio_);
    if (split.reflectance >= 1.0) return;
    x.ray.direction = refract(-out, n, 1.0 / ratio_, split.cosine_behind);
    const double slant = x.ray.direction.dot(x.normal) / x.ray.direction.dot(n);  // flat facet, curved normal
    if (!(x.ray.direction.dot(x.normal) < 0.0 && slant > 0.0) || !seen(x, out)) return;
    const double weight = x.area * slant * (1.0 - split.reflectance) / (ratio_ * ratio_);
    path_.run(x.ray, m, weight / double(images_.size()), false);
    book(diffuse_, x, out, path_.accounts().collect([&](std::size_t k) { return sent[k] / nodes_.area(k); }));
  }

  const OpticalScene& surface_;
  const Scene& scene_;
  const Medium& medium_;
  double ratio_;  ///< index inside / outside
  const Readout& readout_;
  int channels_;
  const LightNodes& nodes_;
  const FaceSet& exits_;
  PathTracer<Scene, Medium, Readout>& path_;
  std::vector<unsigned> images_;
  std::array<std::vector<Source>, 4> emitters_;
  std::vector<double> direct_, diffuse_;
  Vec3 reference_ = Vec3::Zero();  ///< of the sample at hand
  std::array<int, 4> region_{};    ///< likewise, per image
};

}  // namespace lumo::detail

// ---- lumo/optics/response.hpp

namespace lumo {

/// What the readout sees of one state. Channels are those of the readout (ExitPower: regions of the body).
struct Response {
  std::vector<double> power_W;  ///< mean over replicates
  std::vector<double> error_W;  ///< standard error of the mean, from the scatter of the replicates
  /// [W], replicates × channels. Replicate k of every state is traced with the same rays, so an error of a *difference* of states
  /// comes from the differences row by row (common random numbers).
  Eigen::MatrixXd replicates;
  Eigen::MatrixXd direct;  ///< the part of `replicates` that met no surface but the one through which it left
  EnergyLedger ledger;     ///< mean over replicates
  long rays = 0;           ///< primary rays traced
  long segments = 0;       ///< straight pieces traced
};

/// Standard error of the mean of each column of `rows` (independent replicates × channels); zeros for one row.
inline std::vector<double> standard_error(const Eigen::MatrixXd& rows) {
  std::vector<double> error(std::size_t(rows.cols()), 0.0);
  const double n = double(rows.rows());
  if (rows.rows() < 2) return error;
  for (Eigen::Index c = 0; c < rows.cols(); ++c)
    error[std::size_t(c)] = std::sqrt((rows.col(c).array() - rows.col(c).mean()).square().sum() / (n * (n - 1.0)));
  return error;
}

}  // namespace lumo

// ---- lumo/optics/tracer.hpp

namespace lumo {

/// Planes in which body, mesh and emitters are their own mirror images.
inline Symmetry symmetry_of(const Body& body, const TetMesh& mesh) {
  const Symmetry s = RayPattern::symmetry_of(body.emitters), m = mesh.symmetry, b = body.symmetry;
  return {s.x && m.x && b.x, s.y && m.y && b.y};
}

/// Traces light from a body's emitters through its deformed shape, and says how much of it each channel of the readout sees.
///
/// Lambertian emitters in the medium, both Fresnel branches at smooth interfaces, opaque carrier, straight rays in air (model: paper §III).
/// 1. Paths from the emitters, on a random grid or net of directions that is the same for every design, state and emitter, until they are
///    absorbed, leave for good, or fall on a Lambertian face. What leaves through regions after reflections is spread between neighbouring
///    paths (exit_beams.hpp).
/// 2. Lambertian faces, of the body and of the carrier seen through air, exchange their light, linear between nodes (carrier_exchange.hpp).
/// 3. What leaves through faces with regions is gathered backwards from them (exit_gather.hpp): direct light and light of Lambertian faces.
/// With exit_rays = 0 steps 1 and 3 are plain forward tracing. Draws of later events are keyed by (path, event). Same arguments, same bits,
/// whatever the thread; const and thread-safe: run one state per task. Errors: of the integration, stated in the Response; of light that is
/// linear between nodes (scene.sub_facets, scene.carrier_cell_m), and of spreading, which are not in it.
template <TransparentMedium Medium = BeerLambert, ExitReadout Readout = ExitPower, Intersector Backend = Bvh>
class Tracer {
 public:
  struct Config {
    int rays_per_emitter = 1 << 16;   ///< over all replicates; a power of two
    int replicates = 8;               ///< independent scrambles of the pattern; a power of two ≥ 2, ≤ rays_per_emitter/4
    int carrier_rays = 1 << 16;       ///< over all replicates and Lambertian faces, by area; at least one on each triangle
    int exit_rays = 1 << 18;          ///< likewise over the faces with regions, from where light is gathered backwards; 0: not done
    double roulette_below = 0.005;    ///< branches below this share of their path's start weight may be ended
    int max_events = 4096;            ///< a branch that meets more surfaces is booked as lost
    std::uint64_t seed = 0;           ///< another number, another independent pattern
    OpticalScene::Config scene{};
  };

  Tracer() = default;
  explicit Tracer(const Config& config, const Readout& readout = {}, const Backend& backend = {})
      : config_(config), readout_(readout), backend_(backend) {}

  const Config& config() const { return config_; }

  /// The same tracer with `factor` times as many rays of each kind, a power of two, and with an independent pattern for each number of `pattern`.
  /// Compare its responses with its own only. Throws InvalidArgument for a factor that is no power of two, or out of range.
  Tracer refined(int factor, std::uint64_t pattern = 0) const;

  /// Response of the undeformed body. Uses its symmetry when mesh and emitters share it.
  Response trace(const Body& body, const TetMesh& mesh) const { return trace(body, mesh, {}, {}, symmetry_of(body, mesh)); }

  /// Response of a mechanical state. `symmetry`: planes in which body *and* state are their own mirror images.
  Response trace(const Body& body, const TetMesh& mesh, const MechanicalState& state, Symmetry symmetry = {}) const {
    return trace(body, mesh, state.displacement, state.contact_field, symmetry);
  }

  /// Response under `displacement` [m] and `contact_field` (> 0 in contact) per mesh node; either may be empty.
  /// In a plane of `symmetry` only one of two mirror images is traced, and booked for both: the caller vouches for it.
  /// Throws InvalidArgument for broken numbers, sizes or settings; never returns a NaN.
  Response trace(const Body& body, const TetMesh& mesh, const std::vector<Vec3>& displacement, const std::vector<double>& contact_field,
                 Symmetry symmetry = {}) const;

 private:
  Config config_{};
  Readout readout_{};
  Backend backend_{};
};

template <TransparentMedium Medium, ExitReadout Readout, Intersector Backend>
Tracer<Medium, Readout, Backend> Tracer<Medium, Readout, Backend>::refined(int factor, std::uint64_t pattern) const {
  require_in_range("refinement factor", factor, 1, 1 << 12, "");
  if (!std::has_single_bit(unsigned(factor))) throw InvalidArgument(detail::text("refinement factor is ", factor, ", must be a power of two"));
  Config c = config_;
  for (int* rays : {&c.rays_per_emitter, &c.carrier_rays, &c.exit_rays}) *rays = int(std::min<long long>(1LL << 28, static_cast<long long>(*rays) * factor));
  if (pattern > 0) c.seed = detail::combine(config_.seed, pattern);
  return Tracer(c, readout_, backend_);
}

template <TransparentMedium Medium, ExitReadout Readout, Intersector Backend>
Response Tracer<Medium, Readout, Backend>::trace(const Body& body, const TetMesh& mesh, const std::vector<Vec3>& displacement,
                                                 const std::vector<double>& contact_field, Symmetry symmetry) const {
  const auto power_of_two = [](const char* what, int value, int low) {
    require_in_range(what, value, low, 1 << 28, "");
    if (!std::has_single_bit(unsigned(value))) throw InvalidArgument(detail::text(what, " is ", value, ", must be a power of two"));
  };
  power_of_two("replicates", config_.replicates, 2);
  power_of_two("rays per emitter", config_.rays_per_emitter, 4 * config_.replicates);
  require_in_range("carrier rays", config_.carrier_rays, 1, 1 << 30, "");
  require_in_range("exit rays", config_.exit_rays, 0, 1 << 30, "");
  require_in_range("roulette_below", config_.roulette_below, 0.0, 1.0, "");
  require_in_range("max_events", config_.max_events, 1, 1 << 28, "");
  if (body.surroundings.extinction_per_m != 0.0)
    throw InvalidArgument(detail::text("surroundings extinguish ", body.surroundings.extinction_per_m, " 1/m, only 0 1/m is known"));

  const Medium medium{body.medium};
  const OpticalScene surface(body, mesh, displacement, contact_field, symmetry, config_.scene);
  const auto scene = backend_.build(surface.triangles());
  const RayPattern pattern(body.emitters, std::uint32_t(config_.rays_per_emitter / config_.replicates), symmetry);
  const detail::LightNodes nodes(surface, symmetry);
  const detail::FaceSet carrier(surface, symmetry, false, double(config_.carrier_rays) / config_.replicates, 1,
                                [&](int t) { return nodes.of(t)[0] >= 0; });
  const detail::FaceSet exits(surface, symmetry, true, double(config_.exit_rays) / config_.replicates, 2, [&](int t) {
    return config_.exit_rays > 0 && is_dielectric(surface.optics(t)) && surface.has_region(t / surface.triangles_per_face());
  });
  const int channels = readout_.channels(body);
  require_in_range("readout channels", channels, 0, 1 << 24, "");
  const double images = (symmetry.x ? 2.0 : 1.0) * (symmetry.y ? 2.0 : 1.0);
  const double outer_index = BeerLambert(body.surroundings).refractive_index();

  Response response;
  response.replicates.resize(config_.replicates, channels);
  response.direct.resize(config_.replicates, channels);
  EnergyLedger& sum = response.ledger;
  sum.channels.assign(std::size_t(channels), 0.0);
  detail::PathTracer path(surface, scene, medium, outer_index, readout_, channels, nodes, exits, symmetry,
                          {config_.roulette_below, config_.max_events});
  detail::ExitBeams beams(path);
  detail::ExitGather gather(body, surface, scene, medium, outer_index, readout_, channels, nodes, exits, symmetry, path);
  for (int r = 0; r < config_.replicates; ++r) {
    const auto sequence = [&](std::uint64_t use) { return OwenSobol{detail::combine(config_.seed, 3 * std::uint64_t(r) + use)}; };
    for (const RayPattern::Beam& beam : pattern.beams()) {
      if (config_.exit_rays > 0)
        beams.run(beam, sequence(0));
      else
        for (std::uint32_t i = 0; i < beam.rays; ++i) path.run(RayPattern::ray(beam, sequence(0), i), beam.mirror, beam.power_W, true);
    }
    detail::Tally total = path.accounts().take();
    detail::CarrierTransport transport(nodes.size(), channels);
    for (std::size_t k = 0; k < carrier.size(); ++k)
      for (std::uint32_t i = 0; i < carrier[k].count; ++i) {
        detail::FaceSet::Sample x = carrier.sample(k, surface, sequence(1), i);
        const bool inside = x.at.face >= 0;
        const Vec3 lit = inside ? Vec3(-x.normal) : x.normal;
        x.ray.direction = reflected(Lambertian{}, -lit, lit, sequence(1)(x.index, 0), sequence(1)(x.index, 1), carrier[k].mirror);
        path.run(x.ray, carrier[k].mirror, 1.0 / images, false, inside);
        transport.add(path.accounts().take(), nodes.of(x.ray.triangle), detail::LightNodes::shares(x.at), x.area);
      }
    const std::vector<double> sent = detail::exchange(nodes, transport, total);
    gather.run(sequence(2), sent, total);
    for (int c = 0; c < channels; ++c) {
      response.replicates(r, c) = total.ledger.channels[std::size_t(c)];
      response.direct(r, c) = total.direct[std::size_t(c)];
    }
    detail::add(sum, total.ledger, 1.0 / config_.replicates);
  }
  response.rays = path.rays;
  response.segments = path.segments;
  for (int c = 0; c < channels; ++c) sum.channels[std::size_t(c)] = response.replicates.col(c).mean();
  response.power_W = sum.channels;
  response.error_W = standard_error(response.replicates);
  return response;
}

}  // namespace lumo

// ---- lumo/objective/contact_progression.hpp

namespace lumo {

/// A number with its numerical error (half width of an interval that should hold a much finer computation's value).
struct Estimate {
  double value = 0.0;
  double error = 0.0;
};

/// The three terms of progressive-constraint contact of one scenario (paper Eq. 2–3). What the loads do not define is empty.
struct ContactTerms {
  std::optional<Estimate> form;     ///< q_form: patch radius at 2 N over indenter radius
  std::optional<Estimate> stable;   ///< q_stable: overlap of the contact sets at 2 N and 10 N, on the reference surface
  std::optional<Estimate> stiff;    ///< q_stiff: 1 − κ(1→2 N)/κ(5→10 N)
  /// (q_form q_stable q_stiff)^(1/3).
  std::optional<Estimate> score() const;
};

/// Relative errors of depth, areas and overlap at the default mesh, from the refinement study (benchmarks/refinement/results.md).
struct MechanicalError {
  double area = 0.03;         ///< relative, of A
  double overlap = 0.015;     ///< absolute, of an intersection over union
  double stiffness = 0.008;   ///< relative, of a secant stiffness
};

/// The paper's loads that enter the terms [N].
struct ContactLoads {
  double first = 1.0, second = 2.0, third = 5.0, fourth = 10.0;
};

/// Terms of one scenario from its states on `mesh`, for a round indenter of `radius_m`. Only converged (or held) states count.
ContactTerms contact_terms(const Body& body, const TetMesh& mesh, const std::vector<MechanicalState>& states, double radius_m,
                           const MechanicalError& error = {}, const ContactLoads& loads = {});

/// How much less than the baseline a pad gives way at the same load, in percent: 100 (1 − δ/δ_baseline). Source: paper Table II.
inline double progressive_constraint_gain(double depth, double baseline_depth) { return 100.0 * (1.0 - depth / baseline_depth); }

inline std::optional<Estimate> ContactTerms::score() const {
  if (!form || !stable || !stiff) return std::nullopt;
  const double value = std::cbrt(form->value * stable->value * stiff->value);
  const auto with = [&](double f, double s, double k) { return std::abs(std::cbrt(std::max(0.0, f) * std::max(0.0, s) * std::max(0.0, k)) - value); };
  // Errors of the three terms are taken as independent; finite changes, because the cube root has no slope at zero.
  const double a = std::max(with(form->value + form->error, stable->value, stiff->value), with(form->value - form->error, stable->value, stiff->value));
  const double b = std::max(with(form->value, stable->value + stable->error, stiff->value), with(form->value, stable->value - stable->error, stiff->value));
  const double c = std::max(with(form->value, stable->value, stiff->value + stiff->error), with(form->value, stable->value, stiff->value - stiff->error));
  return Estimate{value, std::sqrt(a * a + b * b + c * c)};
}

inline ContactTerms contact_terms(const Body& body, const TetMesh& mesh, const std::vector<MechanicalState>& states, double radius_m,
                                  const MechanicalError& error, const ContactLoads& loads) {
  const auto at = [&](double load) -> const MechanicalState* {
    for (const MechanicalState& s : states)
      if (std::abs(s.load_N - load) <= 1e-9 * load && (s.status == Status::converged || s.status == Status::held)) return &s;
    return nullptr;
  };
  const MechanicalState *one = at(loads.first), *two = at(loads.second), *three = at(loads.third), *four = at(loads.fourth);
  ContactTerms q;
  if (two) {
    const double form = std::sqrt(two->contact_area_m2 / (pi * radius_m * radius_m));
    q.form = form >= 1.0 ? Estimate{1.0, 0.0} : Estimate{form, 0.5 * error.area * form};
  }
  if (two && four) {
    const ContactSurface surface(mesh, body, [](const Patch& p) { return p.contactable; });
    q.stable = Estimate{contact_overlap(surface, two->contact_field, four->contact_field, positions_of(mesh)).ratio(), error.overlap};
  }
  if (one && two && three && four) {
    const double early = (two->force_N - one->force_N) / (two->depth_m - one->depth_m);
    const double late = (four->force_N - three->force_N) / (four->depth_m - three->depth_m);
    const double ratio = early / late;
    q.stiff = Estimate{std::clamp(1.0 - ratio, 0.0, 1.0), 1.0 - ratio < 0.0 ? 0.0 : std::sqrt(2.0) * error.stiffness * std::abs(ratio)};
  }
  return q;
}

}  // namespace lumo

// ---- lumo/objective/optical_separation.hpp

namespace lumo {

/// Response of one state with what it is compared by (paper Eq. 4–5).
struct ObservedState {
  std::size_t scenario;       ///< the caller's number of the scenario
  double diameter_m, angle_rad, y_m, load_N;
  Eigen::MatrixXd change;     ///< (r − r_0)/P_emit, replicates × regions
};

/// The closest pair of places: J_obs = min over matched diameter, angle and load, and over pairs of places, of the distance between
/// their response changes; with its error from replicates and the two states that set it.
struct Separation {
  Estimate distance;
  std::size_t first, second;  ///< indices into the states
};

/// Relative error of J_obs by the mesh. Measured on the baseline in DS, 15 mm, 1 N at y = 22 mm, where direct light and what the dent reflects nearly
/// cancel: the change's norm is 3.05 to 3.75 (1e-6) on the default mesh and three like it, and 3.38, 3.15 with edges 0.75, 0.6 times the default, noise 0.15.
struct OpticalError {
  double mesh = 0.12;
};

/// (r − r_0)/P_emit by replicate.
inline Eigen::MatrixXd response_change(const Response& loaded, const Response& unloaded) {
  return (loaded.replicates - unloaded.replicates) / loaded.ledger.emitted;
}

/// Distance of two response changes and its standard error from paired replicates. The square of the distance is the mean over pairs of
/// *different* replicates of the scalar product of their differences (a U-statistic, Hoeffding 1948): unlike the square of the mean difference it
/// is not raised by noise. Where noise makes it negative the distance is 0. The error is that of the larger of distance and noise.
Estimate response_distance(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

/// May these two states be compared: same tool, angle and load, other place?
inline bool comparable(const ObservedState& a, const ObservedState& b) {
  return a.diameter_m == b.diameter_m && a.angle_rad == b.angle_rad && a.load_N == b.load_N && a.y_m != b.y_m;
}

/// States whose noise must fall before J_obs is known to `tolerance` (a fraction of it, one standard error): those of all pairs that come within
/// two errors (of the difference) of the least distance and are noisier than that. Ascending; empty: done, or nothing can be compared. A pure function, so that a
/// campaign that retraces them (Tracer::refined) stays deterministic. Retraced states need the unloaded body retraced with the same rays.
std::vector<std::size_t> undecided_states(const std::vector<ObservedState>& states, double tolerance = 0.02);

/// Empty when no two states can be compared. Cost: all pairs.
std::optional<Separation> optical_separation(const std::vector<ObservedState>& states, const OpticalError& error = {});

inline Estimate response_distance(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  const Eigen::MatrixXd d = a - b;
  const Eigen::RowVectorXd mean = d.colwise().mean();
  const double n = double(d.rows());
  if (d.rows() < 2) return {mean.norm(), 0.0};
  const Eigen::MatrixXd off = d.rowwise() - mean;
  const double noise2 = off.squaredNorm() / (n * (n - 1.0)), square = mean.squaredNorm() - noise2;
  const double distance = std::sqrt(std::max(0.0, square)), scale = std::sqrt(std::max(square, noise2));
  if (scale == 0.0) return {0.0, 0.0};
  // To first order the distance moves with the replicates' components along the mean difference; where there is little but noise that
  // overstates the error somewhat, since the mean difference is noise, too.
  return {distance, std::sqrt((off * mean.transpose()).squaredNorm() / (n * (n - 1.0))) / scale};
}

namespace detail {

/// Distances of all pairs that may be compared.
inline std::vector<Separation> separations(const std::vector<ObservedState>& states) {
  std::vector<Separation> pairs;
  for (std::size_t i = 0; i < states.size(); ++i)
    for (std::size_t j = i + 1; j < states.size(); ++j)
      if (comparable(states[i], states[j])) pairs.push_back({response_distance(states[i].change, states[j].change), i, j});
  return pairs;
}

}  // namespace detail

inline std::vector<std::size_t> undecided_states(const std::vector<ObservedState>& states, double tolerance) {
  const std::vector<Separation> pairs = detail::separations(states);
  // The least of the upper bounds, so that one very noisy pair does not stand for all.
  const auto upper = [](const Separation& p) { return p.distance.value + 2.0 * p.distance.error; };
  const auto least = std::min_element(pairs.begin(), pairs.end(), [&](const Separation& a, const Separation& b) { return upper(a) < upper(b); });
  std::set<std::size_t> wanted;
  for (const Separation& p : pairs) {
    const bool within_reach = p.distance.value - least->distance.value <= 2.0 * std::hypot(p.distance.error, least->distance.error);
    if (within_reach && p.distance.error > tolerance * p.distance.value) wanted.insert({p.first, p.second});
  }
  return {wanted.begin(), wanted.end()};
}

inline std::optional<Separation> optical_separation(const std::vector<ObservedState>& states, const OpticalError& error) {
  const std::vector<Separation> pairs = detail::separations(states);
  const auto closest = std::min_element(pairs.begin(), pairs.end(), [](const Separation& a, const Separation& b) { return a.distance.value < b.distance.value; });
  if (closest == pairs.end()) return std::nullopt;
  Separation least = *closest;
  least.distance.error = std::hypot(2.0 * least.distance.error, error.mesh * least.distance.value);
  return least;
}

}  // namespace lumo

// ---- lumo/optimize/problem.hpp

namespace lumo {

/// Values in variable order.
using Design = std::vector<double>;
using DesignSet = std::set<Design>;

/// One figure of merit. Only what is better than `reference` adds to the hypervolume.
struct Objective {
  std::string name;
  bool maximize = true;
  double reference = 0.0;

  double signed_value(double y) const { return maximize ? y : -y; }  ///< larger is better
};

/// What is to be optimised, and how much of it is fixed beforehand.
struct Problem {
  DesignSpace space;
  std::vector<Objective> objectives;
  std::vector<Design> initial;  ///< asked first
  int sobol = 8;                ///< asked next: points spread over the space
  int evaluations = 40;         ///< told trials at which it ends, initial and Sobol ones included
  std::uint64_t seed = 0;

  /// Throws InvalidArgument or InfeasibleDesign naming what makes no sense; variables and constraints are checked by DesignSampler.
  void validate() const {
    if (objectives.empty()) throw InvalidArgument("problem has no objectives, must have at least 1");
    std::set<std::string> names;
    for (const Objective& o : objectives) {
      if (!names.insert(o.name).second) throw InvalidArgument(detail::text("objective ", o.name, " is there twice"));
      if (!std::isfinite(o.reference)) throw InvalidArgument(detail::text("objective ", o.name, " has reference ", o.reference, ", must be a finite number"));
    }
    if (sobol < 0 || sobol > 100000) throw InvalidArgument(detail::text("number of Sobol points is ", sobol, ", must lie in [0, 100000]"));
    if (evaluations < 1 || evaluations > 100000) throw InvalidArgument(detail::text("number of evaluations is ", evaluations, ", must lie in [1, 100000]"));
    for (const Design& x : initial) space.check(x);
  }
};

/// A design that was asked, and what became of it.
struct Trial {
  enum class State { pending, told, failed };
  int id = 0;  ///< counts from 0 in the order of asking
  Design x;
  State state = State::pending;
  std::vector<double> outputs;  ///< told ones, in their own units and sense
  bool retry = false;           ///< failed for a reason that does not lie in the design
  std::string why;
};

/// A told trial's objectives, in their own units and sense.
struct Outcome {
  int id = 0;
  std::vector<double> objectives;
};

enum class OptimizerStatus {
  running,   ///< there is more to ask
  waiting,   ///< nothing to ask until a pending trial is answered
  finished,  ///< as many trials are told as the problem wants
  exhausted  ///< every feasible design that can be found has been asked
};

}  // namespace lumo

// ---- lumo/optimize/design_sampler.hpp

namespace lumo {

/// Draws feasible designs of a space: fresh ones spread over it, and moves from a given one. Small lattices are listed, so that their last
/// free design is found and their end is known. Law: all that it returns is feasible, on the lattice to the bit, and a function of its key.
class DesignSampler {
 public:
  static constexpr std::size_t list_limit = 100000;  ///< feasible designs up to which a lattice is listed
  static constexpr std::size_t visit_limit = 4000000;  ///< nodes looked at for that
  static constexpr std::uint32_t try_limit = 1u << 18;  ///< points tried for one set of fresh designs

  /// Throws InvalidArgument when the space makes no sense: no variables, a name twice, bounds that are not finite or reversed, a lattice without a
  /// node between them, a constraint with the wrong number of coefficients. It is copied.
  explicit DesignSampler(DesignSpace space);

  const DesignSpace& space() const { return space_; }
  std::size_t dimensions() const { return space_.variables.size(); }
  /// Number of feasible designs, where they are few enough to be listed.
  std::optional<std::size_t> feasible_count() const { return listed_ ? std::optional(list_.size()) : std::nullopt; }

  /// Up to `count` different feasible designs that are not in `taken`; fewer when there are no more, or none is found in `try_limit` tries.
  std::vector<Design> fresh(std::size_t count, std::uint64_t key, const DesignSet& taken) const;

  /// The feasible designs one move away from `x`: along each axis, along pairs of lattice axes and in `extra` random directions. A move is `reach` times
  /// the variable's range, and at least one step of its lattice.
  std::vector<Design> moves(const Design& x, double reach, int extra, std::uint64_t key) const;

  /// Is `reach` too small to make a difference: one step on every lattice, less than 10⁻⁴ of the range elsewhere?
  bool finest(double reach) const;

  /// The same design with lattice values to the bit as the sampler writes them.
  Design canonical(Design x) const;

 private:
  /// Values along one axis: a lattice's nodes, or any between the bounds.
  struct Axis {
    double first_node = 0.0, nodes = 0.0;  ///< index of the first node and number of nodes; none: continuous
    std::vector<double> table;
  };

  double node(std::size_t i, double k) const;
  double place(std::size_t i, double unit) const;
  double shifted(std::size_t i, double x, double by) const;
  void list();
  bool descend(std::size_t i, Design& x, std::size_t& visits);
  std::optional<Design> repaired(Design x) const;
  Design point(const OwenSobol& sequence, std::uint32_t index) const;

  DesignSpace space_;
  std::vector<Axis> axes_;
  std::vector<Design> list_;
  bool listed_ = false;
};

inline DesignSampler::DesignSampler(DesignSpace space) : space_(std::move(space)) {
  if (space_.variables.empty()) throw InvalidArgument("design space has no variables, must have at least 1");
  std::set<std::string> names;
  for (std::size_t i = 0; i < dimensions(); ++i) {
    const Variable& v = space_.variables[i];
    if (!names.insert(v.name).second) throw InvalidArgument(detail::text("variable ", v.name, " is there twice"));
    if (!std::isfinite(v.lower) || !std::isfinite(v.upper) || v.lower > v.upper || !std::isfinite(v.upper - v.lower))
      throw InvalidArgument(detail::text("variable ", v.name, " has bounds ", v.lower, " and ", v.upper, ", must be finite, the lower first"));
    if (!std::isfinite(v.step) || v.step < 0.0) throw InvalidArgument(detail::text("variable ", v.name, " has step ", v.step, ", must be finite and >= 0"));
    Axis axis;
    if (v.step > 0.0) {
      const double slack = 1e-9;  // bounds such as 0.3 on a lattice of 0.1 are meant to be nodes
      axis.first_node = std::ceil((v.lower - v.origin) / v.step - slack);
      axis.nodes = std::floor((v.upper - v.origin) / v.step + slack) - axis.first_node + 1.0;
      if (!(axis.nodes >= 1.0) || axis.nodes > 1e15)
        throw InvalidArgument(detail::text("variable ", v.name, " has ", std::max(0.0, axis.nodes), " nodes of step ", v.step, " between ", v.lower, " and ", v.upper, ", must have 1 to 1e15"));
    }
    axes_.push_back(axis);
    if (axis.nodes > 0.0 && axis.nodes <= 65536.0)
      for (double k = 0.0; k < axis.nodes; ++k) axes_[i].table.push_back(node(i, k));
  }
  for (const LinearConstraint& c : space_.constraints)
    if (c.coefficients.size() != dimensions() || !(c.lower <= c.upper))
      throw InvalidArgument(detail::text("constraint ", c.name, " has ", c.coefficients.size(), " coefficients and limits ", c.lower, " and ", c.upper, ", must have ",
                                         dimensions(), " and the lower limit first"));
  if (std::all_of(axes_.begin(), axes_.end(), [](const Axis& a) { return a.nodes > 0.0; })) list();
}

/// The shortest decimal number for a node: 0.3, not 0.30000000000000004.
inline double DesignSampler::node(std::size_t i, double k) const {
  if (!axes_[i].table.empty() && k < double(axes_[i].table.size())) return axes_[i].table[std::size_t(k)];
  const Variable& v = space_.variables[i];
  const double x = v.origin + (axes_[i].first_node + k) * v.step;
  char digits[40];
  std::snprintf(digits, sizeof digits, "%.14g", x);
  const double rounded = std::strtod(digits, nullptr);
  return std::clamp(std::abs(rounded - x) <= 2.0 * std::numeric_limits<double>::epsilon() * std::abs(x) ? rounded : x, v.lower, v.upper);
}

inline double DesignSampler::place(std::size_t i, double unit) const {
  const Variable& v = space_.variables[i];
  if (axes_[i].nodes > 0.0) return node(i, std::clamp(std::floor(unit * axes_[i].nodes), 0.0, axes_[i].nodes - 1.0));
  return std::clamp(v.lower + unit * (v.upper - v.lower), v.lower, v.upper);
}

inline double DesignSampler::shifted(std::size_t i, double x, double by) const {
  const Variable& v = space_.variables[i];
  if (axes_[i].nodes == 0.0) return std::clamp(x + by, v.lower, v.upper);
  double steps = std::round(by / v.step);
  if (steps == 0.0 && by != 0.0) steps = by > 0.0 ? 1.0 : -1.0;
  return node(i, std::clamp(std::round((x - v.origin) / v.step) - axes_[i].first_node + steps, 0.0, axes_[i].nodes - 1.0));
}

inline Design DesignSampler::canonical(Design x) const {
  for (std::size_t i = 0; i < x.size() && i < dimensions(); ++i)
    if (axes_[i].nodes > 0.0) x[i] = shifted(i, x[i], 0.0);
  return x;
}

inline bool DesignSampler::finest(double reach) const {
  for (std::size_t i = 0; i < dimensions(); ++i) {
    const Variable& v = space_.variables[i];
    const double range = v.upper - v.lower;
    if (axes_[i].nodes > 0.0 ? reach * range >= 1.5 * v.step : reach >= 1e-4 && range > 0.0) return false;
  }
  return true;
}

inline void DesignSampler::list() {
  Design x(dimensions());
  std::size_t visits = 0;
  listed_ = descend(0, x, visits);
  if (!listed_) list_ = {};
}

/// Depth first over the lattice, leaving branches that no choice of the remaining variables can save. False when there is too much.
inline bool DesignSampler::descend(std::size_t i, Design& x, std::size_t& visits) {
  if (++visits > visit_limit) return false;
  for (const LinearConstraint& c : space_.constraints) {
    double least = 0.0, most = 0.0, size = 0.0;
    for (std::size_t j = 0; j < dimensions(); ++j) {
      const Variable& v = space_.variables[j];
      const double a = c.coefficients[j] * (j < i ? x[j] : v.lower), b = c.coefficients[j] * (j < i ? x[j] : v.upper);
      least += std::min(a, b);
      most += std::max(a, b);
      size += std::max(std::abs(a), std::abs(b));
    }
    if (least > c.upper + 1e-12 * size || most < c.lower - 1e-12 * size) return true;
  }
  if (i == dimensions()) {
    if (space_.contains(x)) list_.push_back(x);
    return list_.size() <= list_limit;
  }
  for (double k = 0.0; k < axes_[i].nodes; ++k) {
    x[i] = node(i, k);
    if (!descend(i + 1, x, visits)) return false;
  }
  return true;
}

inline Design DesignSampler::point(const OwenSobol& sequence, std::uint32_t index) const {
  Design x(dimensions());
  for (std::size_t i = 0; i < dimensions(); ++i) {
    const OwenSobol block{detail::combine(sequence.seed, i / std::size_t(Sobol::dimensions))};
    x[i] = place(i, block(index, int(i % std::size_t(Sobol::dimensions))));
  }
  return x;
}

/// Projects on the linear constraints in turn until all hold; nothing when that does not end. For spaces that random points hardly hit.
inline std::optional<Design> DesignSampler::repaired(Design x) const {
  for (int sweep = 0; sweep < 100; ++sweep) {
    if (space_.contains(x)) return x;
    for (const LinearConstraint& c : space_.constraints) {
      const double sum = c.sum(x), inside = std::min(1e-9 * std::abs(sum), std::isfinite(c.upper - c.lower) ? 0.5 * (c.upper - c.lower) : 1.0);
      const double excess = sum > c.upper ? sum - c.upper + inside : sum < c.lower ? sum - c.lower - inside : 0.0;
      if (excess == 0.0) continue;
      double norm = 0.0;  // variables count by their range
      for (std::size_t i = 0; i < x.size(); ++i) norm += std::pow(c.coefficients[i] * (space_.variables[i].upper - space_.variables[i].lower), 2);
      if (!(norm > 0.0)) return std::nullopt;
      for (std::size_t i = 0; i < x.size(); ++i) {
        const double range = space_.variables[i].upper - space_.variables[i].lower;
        const double by = -excess * c.coefficients[i] * range * range / norm;
        x[i] = axes_[i].nodes > 0.0 ? (std::abs(by) > 0.25 * space_.variables[i].step ? shifted(i, x[i], by) : x[i]) : shifted(i, x[i], by);
      }
    }
  }
  return std::nullopt;
}

inline std::vector<Design> DesignSampler::fresh(std::size_t count, std::uint64_t key, const DesignSet& taken) const {
  std::vector<Design> out;
  DesignSet seen;
  std::optional<Design> anchor;
  const OwenSobol sequence{key};
  const std::uint32_t tries = listed_ ? std::uint32_t(std::min<std::size_t>(64 * count, try_limit)) : try_limit;
  for (std::uint32_t index = 0; index < tries && out.size() < count; ++index) {
    Design x = point(sequence, index);
    if (!space_.contains(x)) {
      if (listed_ || out.size() * 1000 > index || index < 4096 || index % 64 != 0) continue;
      auto repair = repaired(x);
      if (!repair) continue;
      x = *repair;
      if (anchor) {  // between two feasible designs of a convex set there are more, away from its faces
        Design between = x;
        const double t = detail::uniform(detail::combine(key, index));
        for (std::size_t i = 0; i < x.size(); ++i) between[i] = shifted(i, (*anchor)[i], t * (x[i] - (*anchor)[i]));
        if (space_.contains(between)) x = between;
      }
      anchor = repair;
    }
    if (!taken.contains(x) && seen.insert(x).second) out.push_back(x);
  }
  // What random points missed of a listed lattice, in an order that hangs on the key.
  std::vector<std::pair<std::uint64_t, std::size_t>> rest;
  for (std::size_t i = 0; i < list_.size() && out.size() < count; ++i)
    if (!taken.contains(list_[i]) && !seen.contains(list_[i])) rest.push_back({detail::combine(key, i), i});
  std::sort(rest.begin(), rest.end());
  for (std::size_t i = 0; i < rest.size() && out.size() < count; ++i) out.push_back(list_[rest[i].second]);
  return out;
}

inline std::vector<Design> DesignSampler::moves(const Design& x, double reach, int extra, std::uint64_t key) const {
  std::vector<Design> out;
  const std::size_t d = dimensions();
  const auto by = [&](std::size_t i) { return reach * (space_.variables[i].upper - space_.variables[i].lower); };
  const auto offer = [&](const Design& y) {
    if (y != x && space_.contains(y)) out.push_back(y);
  };
  for (std::size_t i = 0; i < d; ++i)
    for (const double sign : {-1.0, 1.0}) {
      Design y = x;
      y[i] = shifted(i, x[i], sign * by(i));
      offer(y);
      // One up, its neighbour down (and so on) follows a constraint's face; off lattices, and where pairs are many, the random moves do.
      for (std::size_t k = i + 1; k < d && d <= 8; ++k)
        for (const double other : {-1.0, 1.0}) {
          if (axes_[i].nodes == 0.0 || axes_[k].nodes == 0.0) continue;
          Design z = y;
          z[k] = shifted(k, x[k], other * by(k));
          offer(z);
        }
    }
  for (int e = 0; e < extra; ++e) {
    Design y = x;
    for (std::size_t i = 0; i < d; ++i) {
      const std::uint64_t draw = detail::combine(detail::combine(key, std::uint64_t(e)), i);
      y[i] = shifted(i, x[i], 2.0 * (detail::uniform(draw) - 0.5) * by(i) * 1.5);
    }
    offer(y);
  }
  return out;
}

}  // namespace lumo

// ---- lumo/optimize/candidate_source.hpp

namespace lumo {

/// What a source of candidates may look at.
struct CandidateRequest {
  const DesignSampler& sampler;
  const DesignSet& taken;            ///< never to be proposed
  const std::vector<Design>& front;  ///< told designs that no other dominates, by falling first objective
  std::uint64_t key;
};

/// Utility of designs (columns), larger is better; may be −∞.
using Score = std::function<Eigen::VectorXd(const Eigen::MatrixXd&)>;

/// Searches a space for the design of highest score. Laws: what it returns is feasible and not taken; empty only when no such design is
/// found; a pure function of request and scores.
template <class S>
concept CandidateSource = requires(const S& source, const CandidateRequest& request, const Score& score) {
  { source.best(request, score) } -> std::convertible_to<std::optional<Design>>;
};

namespace detail {

inline Eigen::MatrixXd columns(const std::vector<Design>& designs, std::size_t rows) {
  Eigen::MatrixXd x(Eigen::Index(rows), Eigen::Index(designs.size()));
  for (std::size_t i = 0; i < designs.size(); ++i) x.col(Eigen::Index(i)) = Eigen::Map<const Eigen::VectorXd>(designs[i].data(), Eigen::Index(rows));
  return x;
}

}  // namespace detail

/// The paper's: a number of fresh feasible designs, the best of them.
struct FreshCandidates {
  std::size_t count = 256;

  std::optional<Design> best(const CandidateRequest& request, const Score& score) const {
    const auto pool = request.sampler.fresh(count, request.key, request.taken);
    if (pool.empty()) return std::nullopt;
    Eigen::Index top = 0;
    score(detail::columns(pool, request.sampler.dimensions())).maxCoeff(&top);
    return pool[std::size_t(top)];
  }
};

/// Fresh designs and moves from the current front, and from the best of those uphill by pattern search, until no move on the finest lattice helps.
/// On a lattice this is a discrete local search; elsewhere steps are halved. Source: Hooke & Jeeves, J. ACM 8 (1961).
struct LocalSearchCandidates {
  std::size_t fresh = 256;
  std::size_t from_front = 256;  ///< at most
  std::size_t climbers = 6;      ///< places that are searched from
  double reach = 0.08;           ///< first move, relative to a variable's range
  int random_moves = 12;         ///< per climber and round, besides those along axes
  int rounds = 25;

  std::optional<Design> best(const CandidateRequest& request, const Score& score) const;
};

inline std::optional<Design> LocalSearchCandidates::best(const CandidateRequest& request, const Score& score) const {
  const DesignSampler& sampler = request.sampler;
  std::vector<Design> pool = sampler.fresh(fresh, request.key, request.taken);
  DesignSet seen(pool.begin(), pool.end());
  std::vector<Design> near;
  for (std::size_t i = 0; i < request.front.size(); ++i)
    for (const double r : {0.25 * reach, reach})
      for (Design& x : sampler.moves(request.front[i], r, random_moves, detail::combine(detail::combine(request.key, 1), i)))
        if (!request.taken.contains(x) && seen.insert(x).second) near.push_back(std::move(x));
  for (std::size_t i = 0; i < near.size() && i < from_front; ++i)  // a random choice where the front is long
    std::swap(near[i], near[i + detail::combine(detail::combine(request.key, 2), i) % (near.size() - i)]);
  if (near.size() > from_front) near.resize(from_front);
  pool.insert(pool.end(), near.begin(), near.end());
  if (pool.empty()) return std::nullopt;

  struct Climber {
    Design x;
    double score;
    double reach;
    bool stuck = false;
  };
  const Eigen::VectorXd scores = score(detail::columns(pool, sampler.dimensions()));
  std::vector<std::size_t> order(pool.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return scores[Eigen::Index(a)] > scores[Eigen::Index(b)]; });
  std::vector<Climber> team;
  for (std::size_t i = 0; i < order.size() && team.size() < climbers; ++i) team.push_back({pool[order[i]], scores[Eigen::Index(order[i])], reach});

  for (int round = 0; round < rounds; ++round) {
    std::vector<Design> moves;
    std::vector<std::size_t> owner;
    for (std::size_t c = 0; c < team.size(); ++c) {
      if (team[c].stuck) continue;
      for (Design& x : sampler.moves(team[c].x, team[c].reach, random_moves, detail::combine(detail::combine(request.key, 3 + std::uint64_t(round)), c)))
        if (!request.taken.contains(x)) {
          moves.push_back(std::move(x));
          owner.push_back(c);
        }
    }
    std::vector<Climber> next = team;
    if (!moves.empty()) {
      const Eigen::VectorXd values = score(detail::columns(moves, sampler.dimensions()));
      for (std::size_t i = 0; i < moves.size(); ++i)
        if (values[Eigen::Index(i)] > next[owner[i]].score) next[owner[i]] = {moves[i], values[Eigen::Index(i)], team[owner[i]].reach};
    }
    bool all_stuck = true;
    for (std::size_t c = 0; c < team.size(); ++c) {
      if (!next[c].stuck && next[c].x == team[c].x) {
        next[c].stuck = sampler.finest(team[c].reach);
        next[c].reach *= 0.5;
      }
      for (std::size_t b = 0; b < c; ++b) next[c].stuck = next[c].stuck || next[c].x == next[b].x;  // two on one place: one is enough
      all_stuck = all_stuck && next[c].stuck;
    }
    team = std::move(next);
    if (all_stuck) break;
  }
  const auto top = std::max_element(team.begin(), team.end(), [](const Climber& a, const Climber& b) { return a.score < b.score; });
  return top->x;
}

static_assert(CandidateSource<FreshCandidates>);
static_assert(CandidateSource<LocalSearchCandidates>);

}  // namespace lumo

// ---- lumo/optimize/normal.hpp

namespace lumo {

/// Density of the standard normal distribution.
inline double normal_density(double z) { return 0.39894228040143267794 * std::exp(-0.5 * z * z); }

/// P(Z ≤ z) of the standard normal distribution, accurate in both tails.
inline double normal_probability(double z) { return 0.5 * std::erfc(-0.70710678118654752440 * z); }

/// z with P(Z ≤ z) = p; ∓∞ at 0 and 1. A rational start (Abramowitz & Stegun 1964, 26.2.23), then Halley's iteration.
inline double normal_quantile(double p) {
  if (!(p > 0.0)) return -std::numeric_limits<double>::infinity();
  if (!(p < 1.0)) return std::numeric_limits<double>::infinity();
  const bool upper = p > 0.5;
  const double tail = upper ? 1.0 - p : p;
  const double t = std::sqrt(-2.0 * std::log(tail));
  double z = (2.515517 + t * (0.802853 + t * 0.010328)) / (1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308))) - t;  // of the lower tail
  for (int i = 0; i < 3; ++i) {
    const double error = (normal_probability(z) - tail) / normal_density(z);
    z -= error / (1.0 + 0.5 * z * error);
  }
  return upper ? -z : z;
}

namespace detail {

/// E[(Z + a)⁺] / φ(a) for a ≤ −8: from the continued fraction of Mills' ratio, where a Φ(a) + φ(a) would cancel.
inline double scaled_excess_tail(double a) {
  const double x = -a;
  double c = x;
  for (int k = x < 10.0 ? 13 : x < 16.0 ? 10 : 8; k >= 2; --k) c = x + double(k) / c;  // relative error below 10⁻¹³
  return 1.0 / (x * c + 1.0);
}

/// a Φ(a) + φ(a) on [−8, 8) with its first two derivatives, Φ and φ, at 256 nodes a unit; quintic Hermite interpolation between them leaves a
/// relative error below 10⁻¹³ (h⁶ f⁽⁶⁾/46080) and takes a tenth of the time of erfc and exp.
class ExcessTable {
 public:
  static constexpr double edge = 8.0;

  double operator()(double a) const {
    const double t = (a + edge) * per_unit;
    const auto k = std::min(std::size_t(t), nodes_.size() - 2);
    const double u = t - double(k);
    const Node &p = nodes_[k], &q = nodes_[k + 1];
    const double rise = q.value - p.value - p.slope - 0.5 * p.curvature, turn = q.slope - p.slope - p.curvature, bend = q.curvature - p.curvature;
    const double u3 = 10.0 * rise - 4.0 * turn + 0.5 * bend, u4 = -15.0 * rise + 7.0 * turn - bend, u5 = 6.0 * rise - 3.0 * turn + 0.5 * bend;
    return p.value + u * (p.slope + u * (0.5 * p.curvature + u * (u3 + u * (u4 + u * u5))));
  }

  static const ExcessTable& get() {
    static const ExcessTable table;
    return table;
  }

 private:
  static constexpr double per_unit = 256.0;
  struct Node {
    double value, slope, curvature;   // of the function of u = 256 a
  };
  std::vector<Node> nodes_;

  ExcessTable() {
    for (int k = 0; k <= int(2.0 * edge * per_unit); ++k) {
      const double a = k / per_unit - edge, density = normal_density(a), probability = normal_probability(a);
      // Near the lower edge the two terms of the value cancel.
      const double value = a < -2.0 ? density * scaled_excess(-a) : a * probability + density;
      nodes_.push_back({value, probability / per_unit, density / (per_unit * per_unit)});
    }
  }

  /// E[(Z − x)⁺] / φ(x) for x ≥ 2: the continued fraction from far enough out.
  static double scaled_excess(double x) {
    double c = x;
    for (int k = 200; k >= 2; --k) c = x + double(k) / c;
    return 1.0 / (x * c + 1.0);
  }
};

}  // namespace detail

/// E[(Z + a)⁺] = a Φ(a) + φ(a) for a standard normal Z, to full relative accuracy (10⁻¹³) until it underflows below a = −38.
inline double expected_excess(double a) {
  static const detail::ExcessTable& table = detail::ExcessTable::get();
  if (a >= detail::ExcessTable::edge) return a;
  if (a >= -detail::ExcessTable::edge) return table(a);
  return a > -39.0 ? normal_density(a) * detail::scaled_excess_tail(a) : 0.0;
}

/// log E[(Z + a)⁺], finite for every finite a. Source: Ament, Daulton, Eriksson, Balandat & Bakshy, "Unexpected Improvements to
/// Expected Improvement for Bayesian Optimization", NeurIPS 2023.
inline double log_expected_excess(double a) {
  if (a <= -8.0) return -0.5 * a * a - 0.5 * std::log(2.0 * pi) + std::log(detail::scaled_excess_tail(a));
  return std::log(a * normal_probability(a) + normal_density(a));
}

/// log(eˣ − eʸ) for x ≥ y; −∞ when they are equal.
inline double log_difference(double x, double y) {
  if (!(y < x)) return -std::numeric_limits<double>::infinity();
  const double d = y - x;
  return x + (d > -0.69314718055994530942 ? std::log(-std::expm1(d)) : std::log1p(-std::exp(d)));
}

/// log Σ exp of the numbers in [first, last); −∞ for none.
template <class Iterator>
double log_sum_exp(Iterator first, Iterator last) {
  double top = -std::numeric_limits<double>::infinity();
  for (Iterator i = first; i != last; ++i) top = std::max(top, double(*i));
  if (!std::isfinite(top)) return top;
  double sum = 0.0;
  for (Iterator i = first; i != last; ++i)
    if (*i - top > -745.0) sum += std::exp(*i - top);   // underflow would be slow
  return top + std::log(sum);
}

}  // namespace lumo

// ---- lumo/optimize/hyperparameters.hpp

namespace lumo {

/// Of a Gaussian process without output scale, on inputs normalised to the unit box and outputs standardised.
struct Hyperparameters {
  Eigen::VectorXd length_scale;  ///< one per input
  double noise = 0.0;            ///< variance of an observation
  double mean = 0.0;
};

/// ln x is normal with mean `location` and standard deviation `scale`.
struct LogNormalPrior {
  double location = 0.0;
  double scale = 1.0;

  double log_density(double x) const {
    const double z = (std::log(x) - location) / scale;
    return -std::log(x) - std::log(scale) - 0.5 * std::log(2.0 * pi) - 0.5 * z * z;
  }
  /// d log_density / d ln x.
  double log_slope(double x) const { return -1.0 - (std::log(x) - location) / (scale * scale); }
  double mode() const { return std::exp(location - scale * scale); }
};

/// Priors and bounds under which hyper-parameters are fitted. The mean has no prior.
struct HyperparameterPrior {
  LogNormalPrior length_scale;  ///< of each
  LogNormalPrior noise{-4.0, 1.0};
  double min_length_scale = 0.025;
  double max_length_scale = 1e4;
  double min_noise = 1e-4;
  double max_noise = 10.0;

  /// Length scales grow with the square root of the dimension. Source: Hvarfner, Hellsten & Nardi, "Vanilla Bayesian Optimization
  /// Performs Great in High Dimensions", ICML 2024; the numbers are those of BoTorch 0.18.
  static HyperparameterPrior for_dimension(Eigen::Index d) {
    if (d < 1) throw InvalidArgument(detail::text("Gaussian process has ", d, " inputs, must have at least 1"));
    HyperparameterPrior prior;
    prior.length_scale = {std::sqrt(2.0) + 0.5 * std::log(double(d)), std::sqrt(3.0)};
    return prior;
  }
};

}  // namespace lumo

// ---- lumo/optimize/kernel.hpp

namespace lumo {

/// Correlation of a stationary Gaussian process as a function of the squared distance r² between inputs, each divided by its length scale;
/// element by element, so that it is computed many at a time.
/// Laws: correlation(0) = 1, decreasing, positive definite in any dimension; slope(r², correlation(r²)) = d correlation / d r².
template <class K>
concept CovarianceKernel = requires(const K& kernel, const Eigen::ArrayXXd& r2, const Eigen::ArrayXXd& correlation) {
  { kernel.correlation(r2) } -> std::convertible_to<Eigen::ArrayXXd>;
  { kernel.slope(r2, correlation) } -> std::convertible_to<Eigen::ArrayXXd>;
};

/// Squared exponential: exp(−r²/2). Samples are smooth.
struct RbfKernel {
  Eigen::ArrayXXd correlation(const Eigen::ArrayXXd& r2) const { return (-0.5 * r2).exp(); }
  Eigen::ArrayXXd slope(const Eigen::ArrayXXd&, const Eigen::ArrayXXd& correlation) const { return -0.5 * correlation; }
};

/// Matérn with ν = 5/2: (1 + s + s²/3) e⁻ˢ with s = √5 r. Samples have two derivatives. Source: Stein, Interpolation of Spatial Data, 1999.
struct Matern52Kernel {
  Eigen::ArrayXXd correlation(const Eigen::ArrayXXd& r2) const {
    const Eigen::ArrayXXd s = (5.0 * r2).sqrt();
    return (1.0 + s + s.square() / 3.0) * (-s).exp();
  }
  Eigen::ArrayXXd slope(const Eigen::ArrayXXd& r2, const Eigen::ArrayXXd& correlation) const {
    const Eigen::ArrayXXd s = (5.0 * r2).sqrt();
    return -5.0 / 6.0 * (1.0 + s) / (1.0 + s + s.square() / 3.0) * correlation;
  }
};

static_assert(CovarianceKernel<RbfKernel>);
static_assert(CovarianceKernel<Matern52Kernel>);

}  // namespace lumo

// ---- lumo/optimize/marginal_likelihood.hpp

namespace lumo {

/// Log marginal likelihood of a Gaussian process and its gradient in the logarithms of the hyper-parameters; the mean takes its best value,
/// (1ᵀK⁻¹y) / (1ᵀK⁻¹1), at each. Source: Rasmussen & Williams, Gaussian Processes for Machine Learning, 2006, §5.4.
template <CovarianceKernel Kernel>
class MarginalLikelihood {
 public:
  struct Value {
    double log_likelihood = -std::numeric_limits<double>::infinity();  ///< −∞ where the covariance is not positive definite
    double log_prior = 0.0;
    double mean = 0.0;
    Eigen::VectorXd gradient;            ///< d log_likelihood / d ln(length scales, noise)
    Eigen::VectorXd posterior_gradient;  ///< d (log_likelihood + log_prior) / d the same
  };

  /// `x`: d × n, normalised; `y`: n, standardised.
  MarginalLikelihood(const Eigen::MatrixXd& x, const Eigen::VectorXd& y, Kernel kernel, HyperparameterPrior prior);

  Value operator()(const Hyperparameters& h, bool with_gradient = true) const;

 private:
  Eigen::Index size_;
  Eigen::VectorXd y_;
  Kernel kernel_;
  HyperparameterPrior prior_;
  Eigen::MatrixXd squares_;  ///< (pair i > k, input): squared difference; pairs column by column of the lower triangle
};

template <CovarianceKernel Kernel>
MarginalLikelihood<Kernel>::MarginalLikelihood(const Eigen::MatrixXd& x, const Eigen::VectorXd& y, Kernel kernel, HyperparameterPrior prior)
    : size_(x.cols()), y_(y), kernel_(kernel), prior_(prior), squares_(x.cols() * (x.cols() - 1) / 2, x.rows()) {
  for (Eigen::Index k = 0, first = 0; k < size_; ++k) {
    const Eigen::Index below = size_ - 1 - k;
    squares_.middleRows(first, below) = (x.rightCols(below).colwise() - x.col(k)).array().square().matrix().transpose();
    first += below;
  }
}

template <CovarianceKernel Kernel>
typename MarginalLikelihood<Kernel>::Value MarginalLikelihood<Kernel>::operator()(const Hyperparameters& h, bool with_gradient) const {
  const Eigen::Index n = size_, d = squares_.cols();
  Value value;
  for (Eigen::Index j = 0; j < d; ++j) value.log_prior += prior_.length_scale.log_density(h.length_scale[j]);
  value.log_prior += prior_.noise.log_density(h.noise);

  const Eigen::VectorXd weight = h.length_scale.array().square().inverse();
  const Eigen::ArrayXXd r2 = squares_ * weight, correlation = kernel_.correlation(r2);
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(n, n);
  for (Eigen::Index k = 0, first = 0; k < n; first += n - 1 - k, ++k) {
    covariance(k, k) = 1.0 + h.noise;
    covariance.col(k).tail(n - 1 - k) = correlation.col(0).segment(first, n - 1 - k);
  }
  const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
  if (factor.info() != Eigen::Success) return value;

  Eigen::MatrixXd both(n, 2);
  both << y_, Eigen::VectorXd::Ones(n);
  factor.solveInPlace(both);
  value.mean = both.col(0).sum() / both.col(1).sum();
  const Eigen::VectorXd alpha = both.col(0) - value.mean * both.col(1);
  double log_determinant = 0.0;
  for (Eigen::Index i = 0; i < n; ++i) log_determinant += 2.0 * std::log(factor.matrixLLT()(i, i));
  value.log_likelihood = -0.5 * (alpha.dot((y_.array() - value.mean).matrix()) + log_determinant + double(n) * std::log(2.0 * pi));
  if (!std::isfinite(value.log_likelihood)) value.log_likelihood = -std::numeric_limits<double>::infinity();
  if (!with_gradient || !std::isfinite(value.log_likelihood)) return value;

  // ½ tr((α αᵀ − K⁻¹) dK): each pair counts twice. The mean is at its optimum and adds nothing.
  Eigen::MatrixXd inverse_factor = Eigen::MatrixXd::Identity(n, n);
  for (Eigen::Index first = 0; first < n; first += 32) {  // in blocks of columns, which are zero above the diagonal
    auto below = inverse_factor.block(first, first, n - first, std::min<Eigen::Index>(32, n - first));
    factor.matrixLLT().bottomRightCorner(n - first, n - first).template triangularView<Eigen::Lower>().solveInPlace(below);
  }
  Eigen::MatrixXd inverse = Eigen::MatrixXd::Zero(n, n);
  inverse.template selfadjointView<Eigen::Lower>().rankUpdate(inverse_factor.transpose());
  Eigen::ArrayXXd pull = kernel_.slope(r2, correlation);
  for (Eigen::Index k = 0, first = 0; k < n; first += n - 1 - k, ++k) {
    const Eigen::Index below = n - 1 - k;
    pull.col(0).segment(first, below) *= alpha.tail(below).array() * alpha[k] - inverse.col(k).tail(below).array();
  }
  value.gradient.resize(d + 1);
  value.gradient.head(d) = -2.0 * weight.cwiseProduct(squares_.transpose() * pull.matrix());
  value.gradient[d] = 0.5 * h.noise * (alpha.squaredNorm() - inverse.trace());
  value.posterior_gradient = value.gradient;
  for (Eigen::Index j = 0; j < d; ++j) value.posterior_gradient[j] += prior_.length_scale.log_slope(h.length_scale[j]);
  value.posterior_gradient[d] += prior_.noise.log_slope(h.noise);
  return value;
}

}  // namespace lumo

// ---- lumo/optimize/quasi_newton.hpp

namespace lumo {

/// Where a bounded minimisation ended.
struct Minimum {
  Eigen::VectorXd x;
  double value = 0.0;
  Eigen::VectorXd gradient;
  Eigen::MatrixXd hessian;  ///< as the search has learnt it
  int evaluations = 0;
  bool converged = false;  ///< projected gradient or progress below tolerance
};

/// Minimises a smooth function of a few variables between bounds: BFGS on the variables that are free to move, with projected line
/// searches. Source: Bertsekas, "Projected Newton methods for optimization problems with simple constraints", SIAM J. Control Optim. 20 (1982);
/// damped updates after Powell, 1978.
struct QuasiNewton {
  int max_evaluations = 200;
  double gradient_tolerance = 1e-6;  ///< largest entry of the projected gradient
  double value_tolerance = 1e-9;     ///< relative decrease in one step
  double longest_step = 2.0;         ///< largest change of one variable in one step

  /// `function(x, gradient)` returns the value and fills the gradient; where it is not finite the search steps back.
  /// `start` is moved between the bounds; `hessian`, positive definite, from the search for a like minimum saves steps.
  /// Throws InvalidArgument when sizes differ or the value at the start is not finite.
  template <class Function>
  Minimum minimize(Function&& function, Eigen::VectorXd start, const Eigen::VectorXd& lower, const Eigen::VectorXd& upper,
                   const std::optional<Eigen::MatrixXd>& hessian = std::nullopt) const;
};

template <class Function>
Minimum QuasiNewton::minimize(Function&& function, Eigen::VectorXd start, const Eigen::VectorXd& lower, const Eigen::VectorXd& upper,
                              const std::optional<Eigen::MatrixXd>& known) const {
  const Eigen::Index n = start.size();
  if (lower.size() != n || upper.size() != n)
    throw InvalidArgument(detail::text("minimiser has ", n, " variables but ", lower.size(), " lower and ", upper.size(), " upper bounds"));
  Minimum best;
  best.x = start.cwiseMax(lower).cwiseMin(upper);
  best.gradient.resize(n);
  best.value = function(best.x, best.gradient);
  best.evaluations = 1;
  if (!std::isfinite(best.value) || !best.gradient.allFinite())
    throw InvalidArgument(detail::text("function is ", best.value, " where the minimiser starts, must be finite"));

  Eigen::MatrixXd hessian = known.value_or(Eigen::MatrixXd::Identity(n, n));
  bool fresh = !known;  // the Hessian has seen no curvature yet
  Eigen::VectorXd step(n), trial(n), slope(n);
  while (best.evaluations < max_evaluations) {
    // A variable at a bound that the gradient pushes it against stays there.
    std::vector<Eigen::Index> free;
    double steepest = 0.0;
    for (Eigen::Index i = 0; i < n; ++i) {
      if ((best.x[i] <= lower[i] && best.gradient[i] >= 0.0) || (best.x[i] >= upper[i] && best.gradient[i] <= 0.0)) continue;
      free.push_back(i);
      steepest = std::max(steepest, std::abs(best.gradient[i]));
    }
    if (steepest <= gradient_tolerance) {
      best.converged = true;
      break;
    }
    step.setZero();
    const Eigen::MatrixXd block = hessian(free, free);
    step(free) = -block.llt().solve(Eigen::VectorXd(best.gradient(free)));
    if (!step.allFinite() || step.dot(best.gradient) >= 0.0) {
      hessian.setIdentity();
      fresh = true;
      step.setZero();
      step(free) = -Eigen::VectorXd(best.gradient(free));
    }
    const double longest = step.cwiseAbs().maxCoeff();
    double scale = std::min({1.0, longest_step / longest, fresh ? 0.5 / longest : 1.0});

    bool moved = false;
    double value = best.value;
    for (; scale * longest > 1e-12 && best.evaluations < max_evaluations; scale *= 0.3) {
      trial = (best.x + scale * step).cwiseMax(lower).cwiseMin(upper);
      value = function(trial, slope);
      ++best.evaluations;
      if (std::isfinite(value) && slope.allFinite() && value <= best.value + 1e-4 * best.gradient.dot(trial - best.x) && value < best.value) {
        moved = true;
        break;
      }
    }
    if (!moved) {
      best.converged = best.evaluations < max_evaluations;  // no descent left that rounding would let through
      if (fresh) break;
      hessian.setIdentity();
      fresh = true;
      continue;
    }
    const Eigen::VectorXd s = trial - best.x;
    Eigen::VectorXd y = slope - best.gradient;
    if (fresh && s.dot(y) > 0.0) hessian = Eigen::MatrixXd::Identity(n, n) * (y.squaredNorm() / s.dot(y));
    const Eigen::VectorXd hs = hessian * s;
    const double curvature = s.dot(hs);
    if (s.dot(y) < 0.2 * curvature) {
      const double damping = 0.8 * curvature / (curvature - s.dot(y));
      y = damping * y + (1.0 - damping) * hs;
    }
    hessian += y * y.transpose() / s.dot(y) - hs * hs.transpose() / curvature;
    fresh = false;
    const double decrease = best.value - value;
    best.x = trial;
    best.value = value;
    best.gradient = slope;
    if (decrease <= value_tolerance * std::max(1.0, std::abs(value))) {
      best.converged = true;
      break;
    }
  }
  best.hessian = std::move(hessian);
  return best;
}

}  // namespace lumo

// ---- lumo/optimize/gaussian_process.hpp

namespace lumo {

/// What a Gaussian process learns from: inputs d × n inside [lower, upper], finite outputs n.
struct TrainingData {
  Eigen::MatrixXd x;
  Eigen::VectorXd y;
  Eigen::VectorXd lower, upper;
};

/// Lower Cholesky factor of a covariance, and what was added to its diagonal to get it.
struct JitteredFactor {
  Eigen::MatrixXd lower;
  double jitter = 0.0;
};

/// Adds 0, 10⁻¹², 10⁻¹¹ … 10⁻⁴ times the largest variance until the matrix is positive definite; nothing when even that is too little.
inline std::optional<JitteredFactor> jittered_factor(const Eigen::MatrixXd& covariance) {
  const double top = covariance.size() ? covariance.diagonal().maxCoeff() : 0.0;
  for (double jitter = 0.0; jitter <= 2e-4; jitter = jitter == 0.0 ? 1e-12 : 10.0 * jitter) {
    Eigen::MatrixXd a = covariance;
    a.diagonal().array() += jitter * top;
    const Eigen::LLT<Eigen::MatrixXd> factor(a);
    if (factor.info() == Eigen::Success && factor.matrixLLT().diagonal().minCoeff() > 0.0)
      return JitteredFactor{Eigen::MatrixXd(factor.matrixL()), jitter * top};
  }
  return std::nullopt;
}

/// Gaussian process regression with a constant mean, one length scale per input and homoscedastic noise. Inputs are normalised by their
/// bounds and outputs standardised (n − 1) inside; everything is told in the units of the data. Equal inputs and constant outputs are fine.
template <CovarianceKernel Kernel = RbfKernel>
class GaussianProcess {
 public:
  struct Config {
    Kernel kernel = {};
    std::optional<HyperparameterPrior> prior;  ///< default: HyperparameterPrior::for_dimension
    int starts = 3;                            ///< searches for hyper-parameters; the first begins at the prior's modes
    int probes = 16;                           ///< places, the other starts are the best of
    Eigen::Index subset = 64;                  ///< with more observations, the search over all begins at the best optimum of this many
    QuasiNewton search = {};
  };

  /// Fits hyper-parameters to their maximum a posteriori. Deterministic. Throws InvalidArgument for shapes that do not fit, values that are
  /// not finite, or no observations.
  static GaussianProcess fit(const TrainingData& data, const Config& config = {});

  /// With given hyper-parameters. Throws as fit(), and when no bounded jitter makes the covariance positive definite.
  GaussianProcess(const TrainingData& data, const Hyperparameters& h, const Config& config = {});

  const Hyperparameters& hyperparameters() const { return hyperparameters_; }
  double jitter() const { return jitter_; }  ///< added to the diagonal of the standardised covariance
  bool converged() const { return converged_; }
  Eigen::Index size() const { return x_.cols(); }
  /// (log p(y) + log prior) / n of the standardised outputs: what fit() maximises.
  double objective() const;

  /// Mean and variance of the latent function (without observation noise) at the columns of `x`.
  struct Prediction {
    Eigen::VectorXd mean, variance;
  };
  Prediction predict(const Eigen::MatrixXd& x) const;
  Eigen::VectorXd mean(const Eigen::MatrixXd& x) const;
  /// Posterior covariance of the latent function between two sets of points.
  Eigen::MatrixXd covariance(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) const;
  /// Joint samples at the columns of `x`: points × samples, from standard normal numbers of the same shape. Empty when the covariance
  /// cannot be factorised.
  std::optional<Eigen::MatrixXd> sample(const Eigen::MatrixXd& x, const Eigen::MatrixXd& normals) const;
  /// What each observation would be predicted as without it, with its noise, from the fitted hyper-parameters.
  /// Source: Rasmussen & Williams 2006, eq. 5.12.
  Prediction leave_one_out() const;

  /// K(X, x) after forward substitution: V with posterior covariance k(a, b) − V(a)ᵀV(b). In standardised units.
  Eigen::MatrixXd whitened(const Eigen::MatrixXd& unit_x) const {
    Eigen::MatrixXd v = correlation(x_, unit_x);
    factor_.matrixL().solveInPlace(v);
    return v;
  }
  Eigen::MatrixXd correlation(const Eigen::MatrixXd& unit_a, const Eigen::MatrixXd& unit_b) const;
  Eigen::MatrixXd normalized(const Eigen::MatrixXd& x) const { return ((x.colwise() - lower_).array().colwise() * inverse_width_.array()).matrix(); }
  const Eigen::VectorXd& weights() const { return whitened_y_; }  ///< L⁻¹(y − mean), standardised
  double output_mean() const { return output_mean_; }
  double output_scale() const { return output_scale_; }

 private:
  Eigen::MatrixXd x_;  ///< normalised
  Eigen::VectorXd y_;  ///< standardised
  Eigen::VectorXd lower_, inverse_width_;
  double output_mean_ = 0.0, output_scale_ = 1.0;
  Hyperparameters hyperparameters_;
  Config config_;
  Eigen::LLT<Eigen::MatrixXd> factor_;
  Eigen::VectorXd whitened_y_;
  double jitter_ = 0.0;
  bool converged_ = true;

  explicit GaussianProcess(const TrainingData& data, const Config& config);
  void condition(const Hyperparameters& h);
  // The search for hyper-parameters is in their logarithms; it minimises −(log p(y) + log prior)/n.
  static Hyperparameters unpack(const Eigen::VectorXd& u);
  static double negative(const MarginalLikelihood<Kernel>& likelihood, Eigen::Index n, const Eigen::VectorXd& u, Eigen::VectorXd* gradient);
  Eigen::VectorXd modes() const;
  Minimum descend(const MarginalLikelihood<Kernel>& likelihood, Eigen::Index n, const Eigen::VectorXd& start, const std::optional<Eigen::MatrixXd>& hessian = std::nullopt) const;
  std::vector<Minimum> optima(const MarginalLikelihood<Kernel>& likelihood, Eigen::Index n) const;
  HyperparameterPrior prior() const { return config_.prior ? *config_.prior : HyperparameterPrior::for_dimension(x_.rows()); }
};

template <CovarianceKernel Kernel>
GaussianProcess<Kernel>::GaussianProcess(const TrainingData& data, const Config& config) : lower_(data.lower), config_(config) {
  const Eigen::Index d = data.x.rows(), n = data.x.cols();
  if (n < 1 || d < 1) throw InvalidArgument(detail::text("Gaussian process has ", n, " observations of ", d, " inputs, must have at least 1 of each"));
  if (data.y.size() != n || data.lower.size() != d || data.upper.size() != d)
    throw InvalidArgument(detail::text("Gaussian process has ", n, " observations of ", d, " inputs, but ", data.y.size(), " outputs, ", data.lower.size(), " lower and ",
                                       data.upper.size(), " upper bounds"));
  if (!data.x.allFinite() || !data.y.allFinite() || !data.lower.allFinite() || !data.upper.allFinite())
    throw InvalidArgument("Gaussian process: observations and bounds must be finite numbers");
  inverse_width_ = (data.upper - data.lower).unaryExpr([](double w) { return w > 0.0 ? 1.0 / w : 0.0; });
  x_ = normalized(data.x);

  const double size = std::max(data.y.cwiseAbs().maxCoeff(), std::numeric_limits<double>::min());  // so that squares neither overflow nor vanish
  const Eigen::VectorXd scaled = data.y / size;
  const double mean = scaled.mean();
  const double deviation = n > 1 ? std::sqrt((scaled.array() - mean).square().sum() / double(n - 1)) : 0.0;
  const bool constant = deviation < 1e-14;  // no more than rounding
  output_mean_ = mean * size;
  output_scale_ = constant ? 1.0 : deviation * size;
  y_ = constant ? Eigen::VectorXd::Zero(n) : Eigen::VectorXd((scaled.array() - mean) / deviation);
}

template <CovarianceKernel Kernel>
GaussianProcess<Kernel>::GaussianProcess(const TrainingData& data, const Hyperparameters& h, const Config& config) : GaussianProcess(data, config) {
  if (h.length_scale.size() != x_.rows() || !(h.length_scale.minCoeff() > 0.0) || !(h.noise >= 0.0))
    throw InvalidArgument(detail::text("Gaussian process: needs ", x_.rows(), " length scales > 0 and a noise variance >= 0, has ", h.length_scale.size(), " and ", h.noise));
  condition(h);
}

template <CovarianceKernel Kernel>
Eigen::MatrixXd GaussianProcess<Kernel>::correlation(const Eigen::MatrixXd& unit_a, const Eigen::MatrixXd& unit_b) const {
  const Eigen::ArrayXd inverse = hyperparameters_.length_scale.array().inverse();
  const Eigen::MatrixXd a = (unit_a.array().colwise() * inverse).matrix(), b = (unit_b.array().colwise() * inverse).matrix();
  Eigen::ArrayXXd r2 = Eigen::ArrayXXd::Zero(a.cols(), b.cols());
  for (Eigen::Index i = 0; i < b.cols(); ++i)
    for (Eigen::Index j = 0; j < a.rows(); ++j) r2.col(i) += (a.row(j).array() - b(j, i)).square().transpose();
  return config_.kernel.correlation(r2);
}

template <CovarianceKernel Kernel>
void GaussianProcess<Kernel>::condition(const Hyperparameters& h) {
  hyperparameters_ = h;
  Eigen::MatrixXd covariance = correlation(x_, x_);
  covariance.diagonal().array() += h.noise;
  for (jitter_ = 0.0;; jitter_ = jitter_ == 0.0 ? 1e-12 : 10.0 * jitter_) {
    if (jitter_ > 2e-4) throw InvalidArgument("Gaussian process: covariance is not positive definite, even with a jitter of 1e-4");
    Eigen::MatrixXd a = covariance;
    a.diagonal().array() += jitter_;
    factor_.compute(a);
    if (factor_.info() == Eigen::Success && factor_.matrixLLT().diagonal().minCoeff() > 0.0) break;
  }
  whitened_y_ = (y_.array() - h.mean).matrix();
  factor_.matrixL().solveInPlace(whitened_y_);
}

template <CovarianceKernel Kernel>
GaussianProcess<Kernel> GaussianProcess<Kernel>::fit(const TrainingData& data, const Config& config) {
  GaussianProcess gp(data, config);
  const Eigen::Index n = gp.size();
  const MarginalLikelihood<Kernel> likelihood(gp.x_, gp.y_, config.kernel, gp.prior());
  std::vector<Minimum> optima;
  if (n <= config.subset) {
    optima = gp.optima(likelihood, n);
  } else {
    std::vector<Eigen::Index> some;
    for (Eigen::Index i = 0; i < config.subset; ++i) some.push_back(i * n / config.subset);
    const MarginalLikelihood<Kernel> coarse(gp.x_(Eigen::all, some), gp.y_(some), config.kernel, gp.prior());
    gp.config_.search.value_tolerance = 1e-5;  // a start needs no more
    const std::vector<Minimum> found = gp.optima(coarse, config.subset);
    gp.config_.search = config.search;
    std::optional<std::size_t> nearest;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < found.size(); ++k)
      if (const double value = negative(likelihood, n, found[k].x, nullptr); value < least) least = value, nearest = k;
    optima = {nearest ? gp.descend(likelihood, n, found[*nearest].x, found[*nearest].hessian) : gp.descend(likelihood, n, gp.modes())};
  }
  const Minimum* best = &optima.front();
  for (const Minimum& o : optima) best = o.value < best->value - 1e-9 ? &o : best;
  Hyperparameters h = unpack(best->x);
  h.mean = likelihood(h, false).mean;
  gp.converged_ = best->converged;
  gp.condition(h);
  return gp;
}

template <CovarianceKernel Kernel>
Hyperparameters GaussianProcess<Kernel>::unpack(const Eigen::VectorXd& u) {
  const Eigen::Index d = u.size() - 1;
  return {u.head(d).unaryExpr([](double v) { return std::exp(v); }), std::exp(u[d]), 0.0};
}

template <CovarianceKernel Kernel>
double GaussianProcess<Kernel>::negative(const MarginalLikelihood<Kernel>& likelihood, Eigen::Index n, const Eigen::VectorXd& u, Eigen::VectorXd* gradient) {
  const auto value = likelihood(unpack(u), gradient != nullptr);
  if (!std::isfinite(value.log_likelihood)) return std::numeric_limits<double>::infinity();
  if (gradient) *gradient = -value.posterior_gradient / double(n);
  return -(value.log_likelihood + value.log_prior) / double(n);
}

template <CovarianceKernel Kernel>
Eigen::VectorXd GaussianProcess<Kernel>::modes() const {
  Eigen::VectorXd u = Eigen::VectorXd::Constant(x_.rows() + 1, std::log(prior().length_scale.mode()));
  u[x_.rows()] = std::log(prior().noise.mode());
  return u;
}

template <CovarianceKernel Kernel>
Minimum GaussianProcess<Kernel>::descend(const MarginalLikelihood<Kernel>& likelihood, Eigen::Index n, const Eigen::VectorXd& start,
                                         const std::optional<Eigen::MatrixXd>& hessian) const {
  const Eigen::Index d = x_.rows();
  const HyperparameterPrior p = prior();
  Eigen::VectorXd lower = Eigen::VectorXd::Constant(d + 1, std::log(p.min_length_scale)), upper = Eigen::VectorXd::Constant(d + 1, std::log(p.max_length_scale));
  lower[d] = std::log(p.min_noise);
  upper[d] = std::log(p.max_noise);
  return config_.search.minimize([&](const Eigen::VectorXd& u, Eigen::VectorXd& gradient) { return negative(likelihood, n, u, &gradient); }, start, lower, upper, hessian);
}

/// One start stops in local optima: after the prior's modes come the most promising of some places spread between short and long length
/// scales, little and much noise.
template <CovarianceKernel Kernel>
std::vector<Minimum> GaussianProcess<Kernel>::optima(const MarginalLikelihood<Kernel>& likelihood, Eigen::Index n) const {
  const Eigen::Index d = x_.rows();
  std::vector<Minimum> found = {descend(likelihood, n, modes())};
  std::vector<std::pair<double, Eigen::VectorXd>> probes;
  for (int k = 0; config_.starts > 1 && k < config_.probes; ++k) {
    Eigen::VectorXd u(d + 1);
    for (Eigen::Index j = 0; j <= d; ++j) {
      const double t = OwenSobol{detail::combine(7, std::uint64_t(j / Sobol::dimensions))}(std::uint32_t(k), int(j % Sobol::dimensions));
      u[j] = j < d ? std::log(0.1) + t * (std::log(100.0) + 0.5 * std::log(double(d))) : std::log(1e-4) + t * std::log(1e3);
    }
    if (const double value = negative(likelihood, n, u, nullptr); std::isfinite(value)) probes.emplace_back(value, u);
  }
  std::stable_sort(probes.begin(), probes.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  for (std::size_t k = 0; k < probes.size() && int(k) + 1 < config_.starts; ++k) found.push_back(descend(likelihood, n, probes[k].second));
  return found;
}

template <CovarianceKernel Kernel>
double GaussianProcess<Kernel>::objective() const {
  const auto value = MarginalLikelihood<Kernel>(x_, y_, config_.kernel, prior())(hyperparameters_, false);
  return (value.log_likelihood + value.log_prior) / double(size());
}

template <CovarianceKernel Kernel>
typename GaussianProcess<Kernel>::Prediction GaussianProcess<Kernel>::predict(const Eigen::MatrixXd& x) const {
  const Eigen::MatrixXd v = whitened(normalized(x));
  const Eigen::VectorXd standard = (v.transpose() * whitened_y_).array() + hyperparameters_.mean;
  const Eigen::VectorXd variance = (1.0 - v.colwise().squaredNorm().array()).max(0.0).transpose();
  return {(output_mean_ + output_scale_ * standard.array()).matrix(), output_scale_ * output_scale_ * variance};
}

template <CovarianceKernel Kernel>
Eigen::VectorXd GaussianProcess<Kernel>::mean(const Eigen::MatrixXd& x) const {
  const Eigen::VectorXd alpha = factor_.matrixU().solve(whitened_y_);
  return (output_mean_ + output_scale_ * ((correlation(normalized(x), x_) * alpha).array() + hyperparameters_.mean)).matrix();
}

template <CovarianceKernel Kernel>
Eigen::MatrixXd GaussianProcess<Kernel>::covariance(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) const {
  const Eigen::MatrixXd ua = normalized(a), ub = normalized(b);
  return output_scale_ * output_scale_ * (correlation(ua, ub) - whitened(ua).transpose() * whitened(ub));
}

template <CovarianceKernel Kernel>
std::optional<Eigen::MatrixXd> GaussianProcess<Kernel>::sample(const Eigen::MatrixXd& x, const Eigen::MatrixXd& normals) const {
  if (normals.rows() != x.cols()) throw InvalidArgument(detail::text("samples at ", x.cols(), " points need as many rows of normal numbers, not ", normals.rows()));
  const auto factor = jittered_factor(covariance(x, x));
  if (!factor) return std::nullopt;
  return (factor->lower * normals).colwise() + predict(x).mean;
}

template <CovarianceKernel Kernel>
typename GaussianProcess<Kernel>::Prediction GaussianProcess<Kernel>::leave_one_out() const {
  const Eigen::MatrixXd inverse = factor_.solve(Eigen::MatrixXd::Identity(size(), size()));
  const Eigen::VectorXd alpha = factor_.matrixU().solve(whitened_y_);
  const Eigen::ArrayXd variance = inverse.diagonal().array().inverse();
  return {(output_mean_ + output_scale_ * (y_.array() - alpha.array() * variance)).matrix(), (output_scale_ * output_scale_ * variance).matrix()};
}

}  // namespace lumo

// ---- lumo/optimize/surrogate.hpp

namespace lumo {

/// How observed outputs become objectives. Laws: objectives(outputs) works column by column (outputs × points → objectives × points);
/// there are outputs(m) outputs for m objectives, and objective(k) is the one that output k counts for; identity() only where objectives()
/// returns its argument, so that what is normal stays normal; scaling all outputs of an objective by s > 0 scales the objective by s.
template <class R>
concept Reduction = requires(const R& reduction, const Eigen::MatrixXd& outputs, int k) {
  { reduction.objectives(outputs) } -> std::convertible_to<Eigen::MatrixXd>;
  { reduction.outputs(k) } -> std::convertible_to<int>;
  { reduction.objective(k) } -> std::convertible_to<int>;
  { reduction.identity() } -> std::convertible_to<bool>;
};

/// Each output is an objective.
struct EachOutput {
  const Eigen::MatrixXd& objectives(const Eigen::MatrixXd& outputs) const { return outputs; }
  int outputs(int objectives) const { return objectives; }
  int objective(int output) const { return output; }
  bool identity() const { return true; }
};

/// Composite surrogate: each objective is the least of its terms (scenarios), and each term has a Gaussian process of its own, so that the
/// kinks of the minimum stay out of the model. Source: Astudillo & Frazier, "Bayesian Optimization of Composite Functions", ICML 2019.
struct MinimumOverTerms {
  std::vector<int> terms;  ///< number of consecutive outputs that belong to each objective

  Eigen::MatrixXd objectives(const Eigen::MatrixXd& y) const {
    Eigen::MatrixXd least(Eigen::Index(terms.size()), y.cols());
    Eigen::Index first = 0;
    for (std::size_t j = 0; j < terms.size(); first += terms[j++]) least.row(Eigen::Index(j)) = y.middleRows(first, terms[j]).colwise().minCoeff();
    return least;
  }
  /// Throws InvalidArgument when there are not as many counts as objectives, or one is not positive.
  int outputs(int objectives) const {
    if (int(terms.size()) != objectives || std::any_of(terms.begin(), terms.end(), [](int n) { return n < 1; }))
      throw InvalidArgument(detail::text("minimum over terms needs a positive number of terms for each of ", objectives, " objectives, has ", terms.size(), " numbers"));
    return std::accumulate(terms.begin(), terms.end(), 0);
  }
  int objective(int output) const {
    int j = 0;
    for (; j + 1 < int(terms.size()) && output >= terms[std::size_t(j)]; ++j) output -= terms[std::size_t(j)];
    return j;
  }
  bool identity() const { return std::all_of(terms.begin(), terms.end(), [](int n) { return n == 1; }); }
};

static_assert(Reduction<EachOutput>);
static_assert(Reduction<MinimumOverTerms>);

/// Designs that are told or under way, as acquisitions see them. All objectives are maximised.
struct Evidence {
  Eigen::MatrixXd x;          ///< told: d × n
  Eigen::MatrixXd outputs;    ///< told: outputs × n
  Eigen::MatrixXd pending;    ///< d × p: asked and not yet told
  Eigen::VectorXd lower, upper;
  Eigen::VectorXd reference;  ///< per objective
};

/// Joint posterior of a Gaussian process at base points, drawn once, and of any further point given each draw. With nothing to draw at
/// there is one empty draw, and what is conditional on it is the plain posterior.
template <CovarianceKernel Kernel>
class ConditionalPosterior {
 public:
  /// `normals`: base points × draws. Throws InvalidArgument when they do not fit.
  ConditionalPosterior(const GaussianProcess<Kernel>& gp, const Eigen::MatrixXd& base, const Eigen::MatrixXd& normals)
      : gp_(&gp), base_(gp.normalized(base)), normals_(normals) {
    if (normals.rows() != base.cols()) throw InvalidArgument(detail::text("draws at ", base.cols(), " points need as many rows of normal numbers, not ", normals.rows()));
    if (base.cols() == 0) return;
    whitened_ = gp.whitened(base_);
    const auto factor = jittered_factor(gp.correlation(base_, base_) - whitened_.transpose() * whitened_);
    if (!factor) throw InvalidArgument("posterior covariance of the base points is not positive definite");
    factor_ = factor->lower;
    jitter_ = factor->jitter;
  }

  /// Draws at the base points: points × draws, in the units of the data.
  Eigen::MatrixXd draws() const {
    if (base_.cols() == 0) return Eigen::MatrixXd(0, std::max<Eigen::Index>(1, normals_.cols()));
    const Eigen::MatrixXd standard = (factor_ * normals_).colwise() + standard_mean(whitened_);
    return (gp_->output_mean() + gp_->output_scale() * standard.array()).matrix();
  }

  /// Given each draw, the latent function at the columns of `x` is normal with these means (points × draws) and deviations (points).
  struct Conditional {
    Eigen::MatrixXd mean;
    Eigen::VectorXd deviation;
  };
  Conditional at(const Eigen::MatrixXd& x) const {
    const Eigen::MatrixXd unit = gp_->normalized(x), v = gp_->whitened(unit);
    Eigen::VectorXd variance = (1.0 - v.colwise().squaredNorm().array()).transpose();
    Eigen::MatrixXd standard = standard_mean(v);
    if (base_.cols() > 0) {
      Eigen::MatrixXd cross = gp_->correlation(base_, unit) - whitened_.transpose() * v;
      factor_.template triangularView<Eigen::Lower>().solveInPlace(cross);
      variance.array() -= cross.colwise().squaredNorm().array().transpose();
      standard = (cross.transpose() * normals_).colwise() + Eigen::VectorXd(standard.col(0));
    }
    const double scale = gp_->output_scale();
    return {(gp_->output_mean() + scale * standard.array()).matrix(), scale * variance.cwiseMax(1e-18).cwiseSqrt()};
  }

  double jitter() const { return jitter_; }

 private:
  Eigen::VectorXd standard_mean(const Eigen::MatrixXd& v) const { return ((v.transpose() * gp_->weights()).array() + gp_->hyperparameters().mean).matrix(); }

  const GaussianProcess<Kernel>* gp_;
  Eigen::MatrixXd base_, normals_, whitened_, factor_;
  double jitter_ = 0.0;
};

}  // namespace lumo

// ---- lumo/optimize/acquisition.hpp

namespace lumo {

/// What a design promises: prepared once on models and evidence, then called with candidates (d × n) for the logarithm of its utility (n).
/// Laws: a pure function of its arguments; larger is better; −∞ or finite, never NaN; what is told or pending conditions it.
template <class A, class Models, class R>
concept Acquisition = requires(const A& acquisition, const Models& models, const R& reduction, const Evidence& evidence, std::uint64_t seed, const Eigen::MatrixXd& x) {
  { acquisition.prepare(models, reduction, evidence, seed)(x) } -> std::convertible_to<Eigen::VectorXd>;
};

/// Standard normal numbers, points × draws: each row is an Owen-scrambled Sobol dimension, so that every point sees evenly spread draws.
/// Blocks of 32 dimensions are scrambled independently. Row `point` does not depend on the number of rows.
inline Eigen::MatrixXd base_normals(Eigen::Index points, Eigen::Index draws, std::uint64_t seed) {
  Eigen::MatrixXd z(points, draws);
  for (Eigen::Index i = 0; i < points; ++i) {
    const OwenSobol sequence{detail::combine(seed, std::uint64_t(i / Sobol::dimensions))};
    for (Eigen::Index s = 0; s < draws; ++s) z(i, s) = normal_quantile(sequence(std::uint32_t(s), int(i % Sobol::dimensions)));
  }
  return z;
}

namespace detail {

/// Where base draws are made: at what is told (if that is noisy) and what is pending.
inline Eigen::MatrixXd base_points(const Evidence& evidence, bool noisy) {
  if (!noisy) return evidence.pending;
  Eigen::MatrixXd base(evidence.x.rows(), evidence.x.cols() + evidence.pending.cols());
  base << evidence.x, evidence.pending;
  return base;
}

/// Objectives that stand in draw `s`: the drawn ones, and what was told where that is taken as it is.
template <Reduction R>
Eigen::MatrixXd standing_objectives(const std::vector<Eigen::MatrixXd>& draws, Eigen::Index s, const R& reduction, const Evidence& evidence, bool noisy) {
  const Eigen::Index told = noisy ? 0 : evidence.outputs.cols(), drawn = draws.front().rows();
  Eigen::MatrixXd outputs(Eigen::Index(draws.size()), told + drawn);
  if (told > 0) outputs.leftCols(told) = evidence.outputs;
  for (std::size_t j = 0; j < draws.size(); ++j) outputs.row(Eigen::Index(j)).tail(drawn) = draws[j].col(s).transpose();
  if (outputs.cols() == 0) return Eigen::MatrixXd(evidence.reference.size(), 0);
  return reduction.objectives(outputs);
}

}  // namespace detail

}  // namespace lumo

// ---- lumo/optimize/pareto.hpp

namespace lumo {

/// Does `a` dominate `b`: at least as good everywhere, better somewhere? All objectives are maximised.
template <class A, class B>
bool dominates(const Eigen::DenseBase<A>& a, const Eigen::DenseBase<B>& b) {
  return (a.derived().array() >= b.derived().array()).all() && (a.derived().array() > b.derived().array()).any();
}

/// Columns of `y` (objectives × points, maximised) that no other dominates, by falling first objective, equal ones by index.
inline std::vector<Eigen::Index> pareto_front(const Eigen::MatrixXd& y) {
  std::vector<Eigen::Index> order(std::size_t(y.cols()));
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](Eigen::Index i, Eigen::Index k) {
    for (Eigen::Index j = 0; j < y.rows(); ++j)
      if (y(j, i) != y(j, k)) return y(j, i) > y(j, k);
    return false;
  });
  // In this order nothing is dominated by what comes after it.
  std::vector<Eigen::Index> front;
  for (const Eigen::Index i : order) {
    const bool beaten = y.rows() == 2 ? !front.empty() && dominates(y.col(front.back()), y.col(i))
                                      : std::any_of(front.begin(), front.end(), [&](Eigen::Index k) { return dominates(y.col(k), y.col(i)); });
    if (!beaten) front.push_back(i);
  }
  return front;
}

}  // namespace lumo

// ---- lumo/optimize/hypervolume.hpp

namespace lumo {

/// Boxes that overlap at their faces only: objectives × boxes; upper corners may be infinite.
struct BoxDecomposition {
  Eigen::MatrixXd lower, upper;
};

namespace detail {

/// Slices the space above `reference` that no column of `y` dominates along objective `along`, and each slice along those after it.
inline void slice(const Eigen::MatrixXd& y, Eigen::Index along, Eigen::VectorXd& low, Eigen::VectorXd& high, const Eigen::VectorXd& reference,
                  std::vector<Eigen::VectorXd>& lower, std::vector<Eigen::VectorXd>& upper) {
  const double infinite = std::numeric_limits<double>::infinity();
  if (along + 1 == reference.size()) {
    low[along] = y.cols() ? std::max(reference[along], y.row(along).maxCoeff()) : reference[along];
    high[along] = infinite;
    lower.push_back(low);
    upper.push_back(high);
    return;
  }
  std::vector<double> levels = {reference[along]};
  for (Eigen::Index i = 0; i < y.cols(); ++i) levels.push_back(y(along, i));
  std::sort(levels.begin(), levels.end());
  levels.erase(std::unique(levels.begin(), levels.end()), levels.end());
  for (std::size_t k = 0; k < levels.size(); ++k) {
    const double top = k + 1 < levels.size() ? levels[k + 1] : infinite;
    std::vector<Eigen::Index> reach;  // those that dominate inside the slice
    for (Eigen::Index i = 0; i < y.cols(); ++i)
      if (y(along, i) >= top) reach.push_back(i);
    low[along] = levels[k];
    high[along] = top;
    slice(y(Eigen::all, reach), along + 1, low, high, reference, lower, upper);
  }
}

}  // namespace detail

/// Decomposes what no column of `y` (objectives × points, maximised) dominates and lies above `reference`. Exact for any number of
/// objectives: one more box than the front has points for two, more than proportional for three and above.
inline BoxDecomposition nondominated_boxes(const Eigen::MatrixXd& y, const Eigen::VectorXd& reference) {
  if (reference.size() < 1 || (y.cols() > 0 && y.rows() != reference.size()))
    throw InvalidArgument(detail::text("points have ", y.rows(), " objectives, the reference point has ", reference.size()));
  std::vector<Eigen::Index> above;
  for (Eigen::Index i = 0; i < y.cols(); ++i)
    if ((y.col(i).array() > reference.array()).all()) above.push_back(i);
  Eigen::MatrixXd front = y.cols() ? Eigen::MatrixXd(y(Eigen::all, above)) : Eigen::MatrixXd(reference.size(), 0);
  front = Eigen::MatrixXd(front(Eigen::all, pareto_front(front)));
  std::vector<Eigen::VectorXd> lower, upper;
  Eigen::VectorXd low(reference.size()), high(reference.size());
  detail::slice(front, 0, low, high, reference, lower, upper);
  BoxDecomposition boxes{Eigen::MatrixXd(reference.size(), Eigen::Index(lower.size())), Eigen::MatrixXd(reference.size(), Eigen::Index(lower.size()))};
  for (std::size_t k = 0; k < lower.size(); ++k) {
    boxes.lower.col(Eigen::Index(k)) = lower[k];
    boxes.upper.col(Eigen::Index(k)) = upper[k];
  }
  return boxes;
}

/// Volume between `reference` and what the columns of `y` (objectives × points, maximised) dominate; points not above it add nothing.
/// Exact for any number of objectives, by slicing along the last. Source: Zitzler, 2001; While, Hingston, Barone & Huband, 2006.
inline double hypervolume(const Eigen::MatrixXd& y, const Eigen::VectorXd& reference) {
  const Eigen::Index m = reference.size();
  if (m < 1 || (y.cols() > 0 && y.rows() != m)) throw InvalidArgument(detail::text("points have ", y.rows(), " objectives, the reference point has ", m));
  std::vector<Eigen::Index> order;
  for (Eigen::Index i = 0; i < y.cols(); ++i)
    if ((y.col(i).array() > reference.array()).all()) order.push_back(i);
  if (order.empty()) return 0.0;
  if (m == 1) {
    double best = reference[0];
    for (const Eigen::Index i : order) best = std::max(best, y(0, i));
    return best - reference[0];
  }
  std::stable_sort(order.begin(), order.end(), [&](Eigen::Index i, Eigen::Index k) { return y(m - 1, i) > y(m - 1, k); });
  double volume = 0.0, widest = reference[0];
  for (std::size_t k = 0; k < order.size(); ++k) {
    const double bottom = k + 1 < order.size() ? y(m - 1, order[k + 1]) : reference[m - 1];
    const double height = y(m - 1, order[k]) - bottom;
    if (m == 2) {  // the slice's section is one interval
      widest = std::max(widest, y(0, order[k]));
      volume += height * (widest - reference[0]);
    } else if (height > 0.0) {
      const std::vector<Eigen::Index> reach(order.begin(), order.begin() + std::ptrdiff_t(k) + 1);
      volume += height * hypervolume(Eigen::MatrixXd(y(Eigen::all, reach).topRows(m - 1)), reference.head(m - 1));
    }
  }
  return volume;
}

}  // namespace lumo

// ---- lumo/optimize/expected_hypervolume.hpp

namespace lumo {

/// Expected hypervolume improvement of a point whose objectives are independent and normal, in closed form: over each box of the
/// decomposition the expectation is a product of one-dimensional integrals, and all terms are positive. Exact for any number of objectives.
/// Source: Emmerich, Deutz & Klinkenberg, CEC 2011; Yang, Emmerich, Deutz & Bäck, J. Glob. Optim. 75 (2019), for the slices of two objectives.
class ExpectedHypervolume {
 public:
  /// `y`: objectives × points, maximised; only those above `reference` that no other dominates matter.
  ExpectedHypervolume(const Eigen::MatrixXd& y, const Eigen::VectorXd& reference) : boxes_(nondominated_boxes(y, reference)) {}

  /// log of the expected improvement, finite for all finite `mean` and positive `deviation`.
  template <class Mean, class Deviation>
  double log_value(const Mean& mean, const Deviation& deviation) const {
    const double sum = value(mean, deviation);
    if (sum > 1e-280 && std::isfinite(sum)) return std::log(sum);
    return log_sum(mean, deviation);
  }

  /// The expected improvement itself; underflows to 0 far from the front. Two objectives only take one pass over the front.
  template <class Mean, class Deviation>
  double value(const Mean& mean, const Deviation& deviation) const {
    const Eigen::Index m = boxes_.lower.rows(), count = boxes_.lower.cols();
    if (m != 2) return std::exp(log_sum(mean, deviation));
    double sum = 0.0, above = 0.0, side = std::numeric_limits<double>::quiet_NaN(), excess = 0.0;
    for (Eigen::Index k = count; k-- > 0;) {  // from the topmost slice, which has no upper end, downwards
      if (boxes_.lower(1, k) != side) {
        side = boxes_.lower(1, k);
        excess = expected_excess((mean[1] - side) / deviation[1]);
      }
      const double from = expected_excess((mean[0] - boxes_.lower(0, k)) / deviation[0]);
      sum += excess * (from - above);
      above = from;
    }
    return sum * deviation[0] * deviation[1];
  }

  const BoxDecomposition& boxes() const { return boxes_; }

 private:
  /// log ∫ P(Y > t) dt over [low, high] for Y normal.
  static double log_side(double mean, double deviation, double low, double high) {
    const double a = (mean - low) / deviation;
    if (!std::isfinite(high)) return std::log(deviation) + log_expected_excess(a);
    const double b = (mean - high) / deviation;
    if ((a - b) * std::max(1.0, std::abs(a)) < 1e-5)  // too thin for a difference
      return std::log(high - low) + log_probability(0.5 * (a + b));
    return std::log(deviation) + log_difference(log_expected_excess(a), log_expected_excess(b));
  }
  static double log_probability(double z) {
    if (z > -30.0) return std::log(normal_probability(z));
    return -0.5 * z * z - 0.5 * std::log(2.0 * pi) - std::log(-z) + std::log1p(-1.0 / (z * z) + 3.0 / (z * z * z * z));
  }
  /// Sum over the boxes in logarithms. E[(Z + a)⁺] ≤ e^(−a²/2) for a ≤ 0 and ≤ a + 1 above: boxes that this bound leaves below e⁻⁴⁰ of the most
  /// promising one are passed over.
  template <class Mean, class Deviation>
  double log_sum(const Mean& mean, const Deviation& deviation) const {
    const Eigen::Index count = boxes_.lower.cols(), m = boxes_.lower.rows();
    if (count == 0) return -std::numeric_limits<double>::infinity();
    double scale = 0.0;
    for (Eigen::Index j = 0; j < m; ++j) scale += std::log(deviation[j]);
    Eigen::ArrayXd bound = Eigen::ArrayXd::Constant(count, scale);
    for (Eigen::Index k = 0; k < count; ++k)
      for (Eigen::Index j = 0; j < m; ++j) {
        const double a = (mean[j] - boxes_.lower(j, k)) / deviation[j];
        bound[k] += a > 0.0 ? std::log(a + 1.0) : -0.5 * a * a;
      }
    const auto term = [&](Eigen::Index k) {
      double log = 0.0;
      for (Eigen::Index j = 0; j < m; ++j) log += log_side(mean[j], deviation[j], boxes_.lower(j, k), boxes_.upper(j, k));
      return log;
    };
    Eigen::Index first = 0;
    bound.maxCoeff(&first);
    const double floor = term(first) - 40.0;
    std::vector<double> terms;
    for (Eigen::Index k = 0; k < count; ++k)
      if (bound[k] >= floor) terms.push_back(term(k));
    return log_sum_exp(terms.begin(), terms.end());
  }

  BoxDecomposition boxes_;
};

}  // namespace lumo

// ---- lumo/optimize/log_nehvi.hpp

namespace lumo {

/// Log noisy expected hypervolume improvement with only the standing designs drawn: given a draw of them, a candidate's objectives are
/// independent and normal, so its improvement is known in closed form. Stays exact far from the front, where sampling the candidate too
/// finds no improvement and ranks by distance. Needs a reduction that is the identity.
/// Source of NEHVI: Daulton, Balandat & Bakshy, "Parallel Bayesian Optimization of Multiple Noisy Objectives with Expected Hypervolume
/// Improvement", NeurIPS 2021.
struct LogNehvi {
  int draws = 16;
  bool noisy = true;  ///< false: told values stand as they are, and only pending designs are drawn
  /// Told designs are not drawn when, so many deviations of both towards each other, another still beats them in all objectives: they
  /// would hardly ever be in a front, and cost time.
  double hopeless = 3.0;

  template <CovarianceKernel Kernel>
  class Prepared {
   public:
    Prepared(std::vector<ConditionalPosterior<Kernel>> posteriors, std::vector<ExpectedHypervolume> improvements)
        : posteriors_(std::move(posteriors)), improvements_(std::move(improvements)) {}

    Eigen::VectorXd operator()(const Eigen::MatrixXd& x) const {
      const auto m = Eigen::Index(posteriors_.size()), draws = Eigen::Index(improvements_.size());
      std::vector<typename ConditionalPosterior<Kernel>::Conditional> at;
      for (const auto& p : posteriors_) at.push_back(p.at(x));
      Eigen::VectorXd mean(m), deviation(m), sum = Eigen::VectorXd::Zero(x.cols());
      const auto load = [&](Eigen::Index i, Eigen::Index s) {
        for (Eigen::Index j = 0; j < m; ++j) mean[j] = at[std::size_t(j)].mean(i, s), deviation[j] = at[std::size_t(j)].deviation[i];
      };
      for (Eigen::Index s = 0; s < draws; ++s)
        for (Eigen::Index i = 0; i < x.cols(); ++i) {
          load(i, s);
          sum[i] += improvements_[std::size_t(s)].value(mean, deviation);
        }
      std::vector<double> logs(improvements_.size());
      for (Eigen::Index i = 0; i < x.cols(); ++i) {
        if (sum[i] > 1e-280 && std::isfinite(sum[i])) {
          sum[i] = std::log(sum[i] / double(draws));
          continue;
        }
        for (Eigen::Index s = 0; s < draws; ++s) {   // hopeless, but to be ranked
          load(i, s);
          logs[std::size_t(s)] = improvements_[std::size_t(s)].log_value(mean, deviation);
        }
        sum[i] = log_sum_exp(logs.begin(), logs.end()) - std::log(double(draws));
      }
      return sum;
    }

   private:
    std::vector<ConditionalPosterior<Kernel>> posteriors_;
    std::vector<ExpectedHypervolume> improvements_;
  };

  /// Models are looked at, not copied: they must outlive what is returned. Throws InvalidArgument for a reduction other than the identity.
  template <CovarianceKernel Kernel, Reduction R>
  Prepared<Kernel> prepare(const std::vector<GaussianProcess<Kernel>>& models, const R& reduction, const Evidence& evidence, std::uint64_t seed) const {
    if (!reduction.identity() || Eigen::Index(models.size()) != evidence.reference.size())
      throw InvalidArgument(detail::text("closed-form improvement needs one model for each of ", evidence.reference.size(), " objectives, has ", models.size(), " outputs to reduce"));
    const Eigen::MatrixXd base = noisy ? contenders(models, evidence) : detail::base_points(evidence, noisy);
    const Eigen::Index count = base.cols() ? std::max(1, draws) : 1;
    std::vector<ConditionalPosterior<Kernel>> posteriors;
    std::vector<Eigen::MatrixXd> drawn;
    for (std::size_t j = 0; j < models.size(); ++j) {
      posteriors.emplace_back(models[j], base, base_normals(base.cols(), count, detail::combine(seed, j)));
      drawn.push_back(posteriors.back().draws());
    }
    std::vector<ExpectedHypervolume> improvements;
    for (Eigen::Index s = 0; s < count; ++s) improvements.emplace_back(detail::standing_objectives(drawn, s, reduction, evidence, noisy), evidence.reference);
    return {std::move(posteriors), std::move(improvements)};
  }

 private:
  /// Told designs that may be in a front, and all that are pending.
  template <CovarianceKernel Kernel>
  Eigen::MatrixXd contenders(const std::vector<GaussianProcess<Kernel>>& models, const Evidence& evidence) const {
    const Eigen::Index n = evidence.x.cols(), m = Eigen::Index(models.size());
    Eigen::MatrixXd low(m, n), high(m, n);
    for (Eigen::Index j = 0; j < m; ++j) {
      const auto p = models[std::size_t(j)].predict(evidence.x);
      const Eigen::VectorXd reach = hopeless * p.variance.cwiseSqrt();
      low.row(j) = (p.mean - reach).transpose();
      high.row(j) = (p.mean + reach).transpose();
    }
    std::vector<Eigen::Index> kept;
    for (Eigen::Index i = 0; i < n; ++i) {
      bool beaten = false;
      for (Eigen::Index k = 0; k < n && !beaten; ++k) beaten = (low.col(k).array() > high.col(i).array()).all();
      if (!beaten) kept.push_back(i);
    }
    Eigen::MatrixXd base(evidence.x.rows(), Eigen::Index(kept.size()) + evidence.pending.cols());
    base << Eigen::MatrixXd(evidence.x(Eigen::all, kept)), evidence.pending;
    return base;
  }
};

static_assert(Acquisition<LogNehvi, std::vector<GaussianProcess<RbfKernel>>, EachOutput>);

}  // namespace lumo

// ---- lumo/optimize/qlog_nehvi.hpp

namespace lumo {

namespace detail {

/// log of a smooth max(x, 0) whose lower tail falls like 1/x² instead of exponentially. Source: Ament et al. 2023, appendix A.
inline double log_fat_relu(double x, double tau) {
  const double t = x / tau;
  const double softplus = t > 0.0 ? t + std::log1p(std::exp(-t)) : std::log1p(std::exp(t));
  return std::log(tau) + std::log(softplus + 0.1 / (1.0 + t * t));
}

/// Smooth minimum of two numbers with a tail that falls like a power. Source: Ament et al. 2023, appendix A.
inline double fat_minimum(double a, double b, double tau) {
  const double gap = std::abs(a - b) / tau;
  return std::min(a, b) - tau * std::log1p(2.0 / (2.0 + gap * (2.0 + gap)));
}

}  // namespace detail

/// qLogNEHVI by sampling, for any reduction: q > 1 designs are chosen one after the other, each with those before it pending, and pending
/// designs join the front draw by draw. Fixed base samples. Source: Daulton, Balandat & Bakshy, NeurIPS 2021 (cached box decompositions,
/// sequential greedy choice); Ament et al., NeurIPS 2023 (logarithms and smoothing).
struct QLogNehvi {
  int draws = 128;
  bool noisy = true;        ///< false: told values stand as they are (qLogEHVI)
  double tau_relu = 1e-6;   ///< smoothing of max(·, 0), in the units of the objectives
  double tau_max = 1e-3;    ///< smoothing of minima of logarithms

  /// Standard normal numbers that replace random ones.
  struct BaseSamples {
    std::vector<Eigen::MatrixXd> base;       ///< per output: base points × draws
    std::vector<Eigen::VectorXd> candidate;  ///< per output: draws
  };

  template <CovarianceKernel Kernel, Reduction R>
  class Prepared {
   public:
    Prepared(const QLogNehvi& config, const std::vector<GaussianProcess<Kernel>>& models, const R& reduction, const Evidence& evidence, const BaseSamples& samples)
        : tau_relu_(config.tau_relu), tau_max_(config.tau_max), reduction_(reduction), candidate_(samples.candidate) {
      const Eigen::MatrixXd base = detail::base_points(evidence, config.noisy);
      std::vector<Eigen::MatrixXd> drawn;
      for (std::size_t j = 0; j < models.size(); ++j) {
        posteriors_.emplace_back(models[j], base, samples.base[j]);
        drawn.push_back(posteriors_.back().draws());
      }
      for (Eigen::Index s = 0; s < candidate_.front().size(); ++s)
        boxes_.push_back(nondominated_boxes(detail::standing_objectives(drawn, std::min(s, drawn.front().cols() - 1), reduction, evidence, config.noisy), evidence.reference));
    }

    Eigen::VectorXd operator()(const Eigen::MatrixXd& x) const {
      const Eigen::Index outputs = Eigen::Index(posteriors_.size()), count = candidate_.front().size();
      std::vector<typename ConditionalPosterior<Kernel>::Conditional> at;
      for (const auto& p : posteriors_) at.push_back(p.at(x));
      Eigen::VectorXd out(x.cols());
      Eigen::MatrixXd sample(outputs, count);
      std::vector<double> per_draw(static_cast<std::size_t>(count)), per_box;
      for (Eigen::Index i = 0; i < x.cols(); ++i) {
        for (Eigen::Index j = 0; j < outputs; ++j) {
          const auto& a = at[std::size_t(j)];
          for (Eigen::Index s = 0; s < count; ++s) sample(j, s) = a.mean(i, std::min(s, a.mean.cols() - 1)) + a.deviation[i] * candidate_[std::size_t(j)][s];
        }
        const Eigen::MatrixXd y = reduction_.objectives(sample);
        for (Eigen::Index s = 0; s < count; ++s) {
          const BoxDecomposition& boxes = boxes_[std::size_t(s)];
          per_box.assign(std::size_t(boxes.lower.cols()), 0.0);
          for (Eigen::Index k = 0; k < boxes.lower.cols(); ++k)
            for (Eigen::Index j = 0; j < y.rows(); ++j) {
              const double side = std::log(std::min(boxes.upper(j, k), 1e10) - boxes.lower(j, k));
              per_box[std::size_t(k)] += detail::fat_minimum(detail::log_fat_relu(y(j, s) - boxes.lower(j, k), tau_relu_), side, tau_max_);
            }
          per_draw[std::size_t(s)] = log_sum_exp(per_box.begin(), per_box.end());
        }
        out[i] = log_sum_exp(per_draw.begin(), per_draw.end()) - std::log(double(count));
      }
      return out;
    }

   private:
    double tau_relu_, tau_max_;
    R reduction_;
    std::vector<Eigen::VectorXd> candidate_;
    std::vector<ConditionalPosterior<Kernel>> posteriors_;
    std::vector<BoxDecomposition> boxes_;
  };

  /// Models are looked at, not copied: they must outlive what is returned.
  template <CovarianceKernel Kernel, Reduction R>
  Prepared<Kernel, R> prepare(const std::vector<GaussianProcess<Kernel>>& models, const R& reduction, const Evidence& evidence, std::uint64_t seed) const {
    const Eigen::Index base = detail::base_points(evidence, noisy).cols();
    BaseSamples samples;
    for (std::size_t j = 0; j < models.size(); ++j) {
      const Eigen::MatrixXd z = base_normals(base + 1, draws, detail::combine(seed, j));
      samples.base.push_back(z.topRows(base));
      samples.candidate.push_back(z.row(base).transpose());
    }
    return Prepared<Kernel, R>(*this, models, reduction, evidence, samples);
  }
};

static_assert(Acquisition<QLogNehvi, std::vector<GaussianProcess<RbfKernel>>, EachOutput>);
static_assert(Acquisition<QLogNehvi, std::vector<GaussianProcess<RbfKernel>>, MinimumOverTerms>);

}  // namespace lumo

// ---- lumo/optimize/trial_log.hpp

namespace lumo {

/// The trials of one optimisation: what was asked, told and failed, and what is next where no model is needed. All that an optimiser knows is
/// here, so that restoring the trials restores the optimiser.
class TrialLog {
 public:
  /// `outputs`: values per told trial. Throws InvalidArgument or InfeasibleDesign for a problem that makes no sense.
  TrialLog(Problem problem, int outputs, int retries) : problem_(std::move(problem)), sampler_(problem_.space), outputs_(outputs), retries_(retries) {
    problem_.validate();
    DesignSet known;
    for (const Design& x : problem_.initial)
      if (known.insert(sampler_.canonical(x)).second) starts_.push_back(sampler_.canonical(x));
    for (Design& x : sampler_.fresh(std::size_t(problem_.sobol), detail::combine(problem_.seed, 0), known)) starts_.push_back(std::move(x));
  }

  const Problem& problem() const { return problem_; }
  const DesignSampler& sampler() const { return sampler_; }
  const std::vector<Trial>& trials() const { return trials_; }
  const DesignSet& taken() const { return taken_; }
  int count(Trial::State state) const {
    return int(std::count_if(trials_.begin(), trials_.end(), [state](const Trial& t) { return t.state == state; }));
  }

  /// A failed trial that may be retried, else the next start; nothing when a model has to choose.
  std::optional<Design> scheduled() const;
  /// Adds a pending trial. Throws InvalidArgument or InfeasibleDesign when it cannot have been asked.
  const Trial& open(int id, Design x);
  /// Throw InvalidArgument when the trial is not pending, or the outputs are too few, too many or not finite.
  void tell(int id, std::vector<double> outputs);
  void fail(int id, bool retry, std::string why);

  /// Inputs (d × n) of the trials in a state, by id.
  Eigen::MatrixXd designs(Trial::State state) const;
  /// Outputs of the told trials (outputs × n) by id, in their own units and sense.
  Eigen::MatrixXd told_outputs() const;

 private:
  Trial& pending(int id);

  Problem problem_;
  DesignSampler sampler_;
  int outputs_, retries_;
  std::vector<Design> starts_;
  std::vector<Trial> trials_;
  DesignSet taken_;
};

inline std::optional<Design> TrialLog::scheduled() const {
  for (std::size_t i = 0; i < trials_.size(); ++i) {
    if (trials_[i].state != Trial::State::failed || !trials_[i].retry) continue;
    int attempts = 0;
    bool latest = true;
    for (std::size_t k = 0; k < trials_.size(); ++k) {
      if (trials_[k].x != trials_[i].x) continue;
      ++attempts;
      latest = latest && k <= i;
    }
    if (latest && attempts <= retries_) return trials_[i].x;
  }
  for (const Design& x : starts_)
    if (!taken_.contains(x)) return x;
  return std::nullopt;
}

inline const Trial& TrialLog::open(int id, Design x) {
  if (id != int(trials_.size())) throw InvalidArgument(detail::text("trial has id ", id, ", must have ", trials_.size(), ", the number of trials before it"));
  problem_.space.check(x);
  x = sampler_.canonical(std::move(x));
  if (taken_.contains(x))
    for (const Trial& t : trials_)
      if (t.x == x && !(t.state == Trial::State::failed && t.retry)) throw InvalidArgument(detail::text("trial ", id, " repeats the design of trial ", t.id));
  taken_.insert(x);
  trials_.push_back({id, std::move(x), Trial::State::pending, {}, false, {}});
  return trials_.back();
}

inline Trial& TrialLog::pending(int id) {
  if (id < 0 || id >= int(trials_.size())) throw InvalidArgument(detail::text("trial ", id, " was never asked"));
  Trial& trial = trials_[std::size_t(id)];
  if (trial.state == Trial::State::told) throw InvalidArgument(detail::text("trial ", id, " was told before"));
  if (trial.state == Trial::State::failed) throw InvalidArgument(detail::text("trial ", id, " failed before"));
  return trial;
}

inline void TrialLog::tell(int id, std::vector<double> outputs) {
  Trial& trial = pending(id);
  if (int(outputs.size()) != outputs_) throw InvalidArgument(detail::text("trial ", id, " has ", outputs.size(), " values, must have ", outputs_));
  for (const double y : outputs)
    if (!(std::abs(y) <= 1e150)) throw InvalidArgument(detail::text("trial ", id, " has a value of ", y, ", must be a finite number within +-1e150"));
  trial.outputs = std::move(outputs);
  trial.state = Trial::State::told;
}

inline void TrialLog::fail(int id, bool retry, std::string why) {
  Trial& trial = pending(id);
  trial.state = Trial::State::failed;
  trial.retry = retry;
  trial.why = std::move(why);
}

inline Eigen::MatrixXd TrialLog::designs(Trial::State state) const {
  Eigen::MatrixXd x(Eigen::Index(sampler_.dimensions()), count(state));
  Eigen::Index column = 0;
  for (const Trial& t : trials_)
    if (t.state == state) x.col(column++) = Eigen::Map<const Eigen::VectorXd>(t.x.data(), x.rows());
  return x;
}

inline Eigen::MatrixXd TrialLog::told_outputs() const {
  Eigen::MatrixXd y(outputs_, count(Trial::State::told));
  Eigen::Index column = 0;
  for (const Trial& t : trials_)
    if (t.state == Trial::State::told) y.col(column++) = Eigen::Map<const Eigen::VectorXd>(t.outputs.data(), outputs_);
  return y;
}

}  // namespace lumo

// ---- lumo/optimize/optimizer.hpp

namespace lumo {

/// Bayesian optimisation by ask and tell: it never calls an objective. First come the problem's initial designs, then Sobol points, then the
/// candidate of highest acquisition under Gaussian processes of what was told, given what is still pending. Answers may come in any order.
/// Law: a proposal is a function of the problem, the configuration and the trials before it, to the bit; so whoever keeps the trials can
/// restore() them and go on. No design is asked twice, except after a failure that may be retried.
template <CovarianceKernel Kernel = RbfKernel, class AcquisitionPolicy = LogNehvi, CandidateSource Source = LocalSearchCandidates, Reduction R = EachOutput>
  requires Acquisition<AcquisitionPolicy, std::vector<GaussianProcess<Kernel>>, R>
class Optimizer {
 public:
  struct Config {
    typename GaussianProcess<Kernel>::Config model = {};
    AcquisitionPolicy acquisition = {};
    Source source = {};
    R reduction = {};  ///< told outputs → objectives, after those of an objective that is minimised have changed sign
    int retries = 2;   ///< of one design after failures that may be retried
  };

  /// Throws InvalidArgument for a problem that makes no sense, InfeasibleDesign for an initial design outside the space.
  explicit Optimizer(Problem problem, Config config = {})
      : config_(std::move(config)), log_(problem, config_.reduction.outputs(int(problem.objectives.size())), config_.retries) {}

  /// The next design to evaluate, now pending; nothing when status() says why.
  std::optional<Trial> ask() {
    if (told() + pending() >= problem().evaluations) return std::nullopt;
    auto x = log_.scheduled();
    if (!x) x = chosen();
    exhausted_ = !x;
    if (!x) return std::nullopt;
    return log_.open(int(trials().size()), std::move(*x));
  }

  /// Outputs of a pending trial. Throws InvalidArgument when it is not pending, or the outputs are too few, too many or not finite.
  void tell(int id, std::vector<double> outputs) { log_.tell(id, std::move(outputs)); }

  /// A pending trial that failed; with `retry` it may be asked again under a new id. Throws InvalidArgument when it is not pending.
  void fail(int id, bool retry, std::string why) {
    log_.fail(id, retry, std::move(why));
    exhausted_ = exhausted_ && !retry;
  }

  /// Takes over the next trial of an earlier run, pending; tell() or fail() follow. Throws InvalidArgument or InfeasibleDesign when it
  /// cannot have been asked.
  void restore(int id, Design x) { log_.open(id, std::move(x)); }

  OptimizerStatus status() const {
    if (told() >= problem().evaluations) return OptimizerStatus::finished;
    if (told() + pending() >= problem().evaluations) return OptimizerStatus::waiting;
    if (exhausted_) return pending() > 0 ? OptimizerStatus::waiting : OptimizerStatus::exhausted;
    return OptimizerStatus::running;
  }

  const Problem& problem() const { return log_.problem(); }
  const std::vector<Trial>& trials() const { return log_.trials(); }  ///< by id
  int told() const { return log_.count(Trial::State::told); }
  int pending() const { return log_.count(Trial::State::pending); }

  /// Told trials that no other dominates, from the best in the first objective on.
  std::vector<Outcome> front() const {
    std::vector<int> ids;
    for (const Trial& t : trials())
      if (t.state == Trial::State::told) ids.push_back(t.id);
    const Eigen::MatrixXd y = objectives();
    std::vector<Outcome> out;
    for (const Eigen::Index i : pareto_front(y)) {
      out.push_back({ids[std::size_t(i)], {}});
      for (Eigen::Index j = 0; j < y.rows(); ++j) out.back().objectives.push_back(problem().objectives[std::size_t(j)].signed_value(y(j, i)));
    }
    return out;
  }

  /// What the front dominates above the reference point, in the product of the objectives' units.
  double hypervolume() const {
    Eigen::VectorXd reference(Eigen::Index(problem().objectives.size()));
    for (Eigen::Index j = 0; j < reference.size(); ++j) reference[j] = objective(int(j)).signed_value(objective(int(j)).reference);
    return lumo::hypervolume(objectives(), reference);
  }

  /// Models of the told outputs as they are in evidence(). Empty before two trials are told.
  const std::vector<GaussianProcess<Kernel>>& models() {
    if (told() < 2 || modelled_ == told()) return models_;
    const Evidence e = evidence();
    models_.clear();
    for (Eigen::Index k = 0; k < e.outputs.rows(); ++k)
      models_.push_back(GaussianProcess<Kernel>::fit({e.x, e.outputs.row(k).transpose(), e.lower, e.upper}, config_.model));
    modelled_ = told();
    return models_;
  }

  /// Told and pending trials as models and acquisition see them: outputs less their reference, larger is better, in units of the spread of
  /// their objective.
  Evidence evidence() const {
    Evidence e;
    e.x = log_.designs(Trial::State::told);
    e.pending = log_.designs(Trial::State::pending);
    e.outputs = log_.told_outputs();
    for (int j = 0; j < int(problem().objectives.size()); ++j) {
      std::vector<Eigen::Index> rows;
      for (Eigen::Index k = 0; k < e.outputs.rows(); ++k)
        if (config_.reduction.objective(int(k)) == j) rows.push_back(k);
      Eigen::ArrayXXd y = objective(j).signed_value(1.0) * (e.outputs(rows, Eigen::all).array() - objective(j).reference);
      const double largest = y.size() ? y.abs().maxCoeff() : 0.0;  // so that squares neither overflow nor vanish
      if (largest > 0.0) {
        y /= largest;
        const double spread = std::sqrt((y - y.mean()).square().mean());
        if (spread > 1e-14) y /= spread;
      }
      e.outputs(rows, Eigen::all) = y.matrix();
    }
    const auto& variables = problem().space.variables;
    e.lower.resize(Eigen::Index(variables.size()));
    e.upper.resize(Eigen::Index(variables.size()));
    for (std::size_t i = 0; i < variables.size(); ++i) {
      e.lower[Eigen::Index(i)] = variables[i].lower;
      e.upper[Eigen::Index(i)] = variables[i].upper;
    }
    e.reference = Eigen::VectorXd::Zero(Eigen::Index(problem().objectives.size()));
    return e;
  }

 private:
  const Objective& objective(int j) const { return problem().objectives[std::size_t(j)]; }

  /// Objectives of the told trials (objectives × n) in their units, larger is better.
  Eigen::MatrixXd objectives() const {
    Eigen::MatrixXd y = log_.told_outputs();
    for (Eigen::Index k = 0; k < y.rows(); ++k) y.row(k) *= objective(config_.reduction.objective(int(k))).signed_value(1.0);
    return y.cols() ? Eigen::MatrixXd(config_.reduction.objectives(y)) : Eigen::MatrixXd(Eigen::Index(problem().objectives.size()), 0);
  }

  /// The candidate of highest acquisition; a fresh design while there is too little for a model.
  std::optional<Design> chosen() {
    const std::uint64_t key = detail::combine(detail::combine(problem().seed, 1), trials().size());
    if (models().empty()) {
      auto fresh = log_.sampler().fresh(1, key, log_.taken());
      return fresh.empty() ? std::nullopt : std::optional(std::move(fresh.front()));
    }
    std::vector<Design> standing;
    for (const Outcome& o : front()) standing.push_back(trials()[std::size_t(o.id)].x);
    const auto utility = config_.acquisition.prepare(models_, config_.reduction, evidence(), detail::combine(key, 1));
    return config_.source.best({log_.sampler(), log_.taken(), standing, detail::combine(key, 2)}, utility);
  }

  Config config_;
  TrialLog log_;
  bool exhausted_ = false;
  std::vector<GaussianProcess<Kernel>> models_;
  int modelled_ = 0;  ///< told trials that the models know
};

}  // namespace lumo

// ---- lumo/campaign/ensemble.hpp

namespace lumo {

/// All combinations of diameters, approach angles and places along the finger, at the same loads.
struct Ensemble {
  std::vector<double> diameters_m = {10e-3, 15e-3, 20e-3, 30e-3};
  std::vector<double> angles_rad = {0.0};
  std::vector<double> places_m = {-22e-3, -11e-3, -5.5e-3, 0.0, 5.5e-3, 11e-3, 22e-3};
  std::vector<double> loads_N = {1.0, 2.0, 5.0, 10.0, 15.0};

  std::vector<Scenario<Sphere>> scenarios() const {
    std::vector<Scenario<Sphere>> all;
    for (double d : diameters_m)
      for (double a : angles_rad)
        for (double y : places_m) all.push_back({Sphere{d}, a, y, loads_N});
    return all;
  }
};

/// The paper's pad-normal contacts: 4 diameters × 7 places.
inline Ensemble flat_ensemble() { return {}; }

/// The paper's contacts under five approach angles: 4 × 5 × 7.
inline Ensemble curved_ensemble() {
  Ensemble e;
  e.angles_rad = {-30 * pi / 180, -15 * pi / 180, 0.0, 15 * pi / 180, 30 * pi / 180};
  return e;
}

/// Which scenarios have to be solved when mirror images are solved once.
struct ContactPlan {
  struct Solve {
    Scenario<Sphere> scenario;   ///< with angle ≥ 0 and y ≥ 0 where the body is symmetric
    std::size_t place;           ///< index into `places`
  };
  struct Image {
    std::size_t solve;           ///< which solve it comes from
    bool mirror_x, mirror_y;     ///< by which reflections
  };
  /// Contacts at one angle and place share a mesh.
  struct Place {
    double angle_rad, y_m;
    std::vector<std::size_t> solves;
  };
  std::vector<Solve> solves;
  std::vector<Image> images;     ///< one per scenario of the ensemble
  std::vector<Place> places;
};

/// `mirror_once` false: every scenario is solved for itself.
inline ContactPlan plan_contacts(const std::vector<Scenario<Sphere>>& scenarios, Symmetry symmetry, bool mirror_once = true) {
  ContactPlan plan;
  for (const Scenario<Sphere>& s : scenarios) {
    validate(s);
    const bool mx = mirror_once && symmetry.x && s.angle_rad < 0.0, my = mirror_once && symmetry.y && s.y_m < 0.0;
    Scenario<Sphere> canonical = s;
    canonical.angle_rad = mx ? -s.angle_rad : s.angle_rad;
    canonical.y_m = my ? -s.y_m : s.y_m;
    std::size_t k = 0;
    while (k < plan.solves.size() && !(mirror_once && plan.solves[k].scenario == canonical)) ++k;
    if (k == plan.solves.size()) {
      // One mesh serves a contact and its mirror images: the mesh has the body's symmetry.
      const double angle = symmetry.x ? std::abs(canonical.angle_rad) : canonical.angle_rad, y = symmetry.y ? std::abs(canonical.y_m) : canonical.y_m;
      std::size_t place = 0;
      while (place < plan.places.size() && !(plan.places[place].angle_rad == angle && plan.places[place].y_m == y)) ++place;
      if (place == plan.places.size()) plan.places.push_back({angle, y, {}});
      plan.places[place].solves.push_back(k);
      plan.solves.push_back({canonical, place});
    }
    plan.images.push_back({k, mx, my});
  }
  return plan;
}

}  // namespace lumo

// ---- lumo/campaign/observations.hpp

namespace lumo {

/// One state as it is kept: numbers only, no fields.
struct StateRecord {
  Status status = Status::non_finite;
  double load_N = 0.0, force_N = 0.0, depth_m = 0.0, contact_area_m2 = 0.0, reference_area_m2 = 0.0, residual_N = 0.0, penetration_m = 0.0;
  std::vector<double> response;          ///< per emitted power and region: Observations::unloaded_response + mean change; empty without light
  Eigen::MatrixXd change;                ///< (r − r_0)/P_emit by replicate, replicates × regions, both traced on the scenario's own mesh
};

/// One scenario of an ensemble.
struct ScenarioRecord {
  double diameter_m = 0.0, angle_rad = 0.0, y_m = 0.0;
  Status status = Status::non_finite;    ///< of the last state that was tried
  ContactTerms terms;
  std::vector<StateRecord> states;
};

/// Seconds spent, summed over threads, and by the clock in all.
struct Timing {
  double mesh = 0.0, mechanics = 0.0, optics = 0.0, total = 0.0;
};

/// All states and responses of one body under an ensemble.
struct Observations {
  std::vector<ScenarioRecord> scenarios;        ///< in the ensemble's order, mirror images included
  std::vector<double> unloaded_response;        ///< per emitted power and region, mean over the meshes
  EnergyLedger ledger;                          ///< of the traced state that closes worst
  std::size_t nodes = 0, elements = 0;          ///< of the largest mesh
  Timing seconds;
};

/// All states that can be compared for J_obs.
inline std::vector<ObservedState> observed_states(const std::vector<ScenarioRecord>& scenarios) {
  std::vector<ObservedState> states;
  for (std::size_t k = 0; k < scenarios.size(); ++k)
    for (const StateRecord& s : scenarios[k].states)
      if (s.change.size() > 0) states.push_back({k, scenarios[k].diameter_m, scenarios[k].angle_rad, scenarios[k].y_m, s.load_N, s.change});
  return states;
}

namespace detail {

/// The record of a scenario from that of its mirror image.
inline ScenarioRecord mirrored(ScenarioRecord record, const Scenario<Sphere>& scenario, const Body& body, const ContactPlan::Image& image) {
  record.angle_rad = scenario.angle_rad;
  record.y_m = scenario.y_m;
  const auto renumber = [&](const std::vector<int>& region) {
    if (region.empty()) return;
    for (StateRecord& s : record.states) {
      const Eigen::MatrixXd change = s.change;
      for (Eigen::Index k = 0; k < change.cols(); ++k) s.change.col(region[std::size_t(k)]) = change.col(k);
    }
  };
  if (image.mirror_x) renumber(body.region_image_x);
  if (image.mirror_y) renumber(body.region_image_y);
  return record;
}

}  // namespace detail

}  // namespace lumo

// ---- lumo/campaign/stopwatch.hpp

namespace lumo::detail {

/// Seconds by the clock since it was made.
class Stopwatch {
 public:
  double seconds() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace lumo::detail

// ---- lumo/campaign/lighting.hpp

namespace lumo {

/// Planes in which body, mesh, emitters and the states of a scenario are their own mirror images.
template <Indenter Tool>
Symmetry symmetry_of(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario) {
  const Symmetry unloaded = symmetry_of(body, mesh);
  return {unloaded.x && scenario.angle_rad == 0.0, unloaded.y && scenario.y_m == 0.0};
}

/// How the states that decide J_obs are known better than the others: each round traces those that undecided_states() names with as many new rays
/// as they have had (and the unloaded bodies on their meshes, too), until there are none. What is still undecided then shows in the error.
struct RayRefinement {
  double tolerance = 0.02;   ///< wanted standard error of J_obs, and of all that might be less, as a fraction
  int rounds = 5;            ///< at most this many doublings; 0: everything is traced once
};

namespace detail {

/// A solved scenario with its fields.
struct SolvedScenario {
  ScenarioRecord record;
  std::vector<MechanicalState> states;
  double seconds = 0.0;
};

/// Light in the states of all solved scenarios.
template <class Light, class Pad>
class Lighting {
 public:
  /// `places`: the body on its mesh for each place of the plan.
  Lighting(const Body& body, const ContactPlan& plan, const Light& light, const std::vector<Pad>& places, std::vector<SolvedScenario>& solved)
      : body_(body), plan_(plan), light_(light), places_(places), solved_(solved) {
    for (std::size_t k = 0; k < solved.size(); ++k)
      for (std::size_t s = 0; s < solved[k].states.size(); ++s)
        if (const Status status = solved[k].states[s].status; status == Status::converged || status == Status::held) all_.push_back({k, s});
  }

  struct State {
    std::size_t solve, state;
    auto operator<=>(const State&) const = default;
  };
  const std::vector<State>& all() const { return all_; }

  /// Traces these states with the rays of all rounds up to `round` that they lack, and the unloaded body on their meshes with the same rays.
  /// Round 0 takes all meshes. Rounds have independent patterns and 1, 1, 2, 4, … times the rays, so that each is worth all before it.
  template <Executor E, class Report>
  void trace(const std::vector<State>& wanted, int round, const E& executor, Report&& report) {
    struct Job {
      std::size_t place;
      int round;
      const State* state;  ///< none: unloaded
    };
    unloaded_.resize(std::max(unloaded_.size(), std::size_t(round) + 1), std::vector<Response>(places_.size()));
    std::vector<Job> jobs;
    std::set<std::pair<int, std::size_t>> bare;  // (round, place)
    for (const State& s : wanted)
      for (int r = rounds_[s]; r <= round; ++r) jobs.push_back({plan_.solves[s.solve].place, r, &s}), bare.insert({r, jobs.back().place});
    for (std::size_t place = 0; round == 0 && place < places_.size(); ++place) bare.insert({0, place});
    for (const auto& [r, place] : bare)
      if (unloaded_[std::size_t(r)][place].power_W.empty()) jobs.push_back({place, r, nullptr});
    std::stable_sort(jobs.begin(), jobs.end(), [](const Job& a, const Job& b) { return a.round < b.round; });

    std::vector<Response> lit(jobs.size());
    std::vector<double> spent(jobs.size(), 0.0);
    executor.for_each(jobs.size(), [&](std::size_t task) {
      const Stopwatch watch;
      const std::size_t i = jobs.size() - 1 - task;  // long ones first, so that threads end together
      const auto& [place, r, state] = jobs[i];
      const Light light = light_.refined(r > 0 ? 1 << (r - 1) : 1, std::uint64_t(r));
      const TetMesh& mesh = places_[place]->mesh();
      if (state == nullptr)
        lit[i] = light.trace(body_, mesh);
      else
        lit[i] = light.trace(body_, mesh, solved_[state->solve].states[state->state], symmetry_of(body_, mesh, plan_.solves[state->solve].scenario));
      spent[i] = watch.seconds();
      report(jobs.size());
    });

    for (std::size_t i = 0; i < jobs.size(); ++i) {
      seconds += spent[i];
      if (ledger.emitted == 0.0 || lit[i].ledger.imbalance() >= ledger.imbalance()) ledger = lit[i].ledger;
      if (jobs[i].state == nullptr) unloaded_[std::size_t(jobs[i].round)][jobs[i].place] = lit[i];
    }
    for (std::size_t i = 0; i < jobs.size(); ++i) {
      const auto& [place, r, state] = jobs[i];
      if (state == nullptr) continue;
      const Eigen::MatrixXd change = response_change(lit[i], unloaded_[std::size_t(r)][place]);
      Eigen::MatrixXd& sum = solved_[state->solve].record.states[state->state].change;
      sum = r == 0 ? change : Eigen::MatrixXd(0.5 * (sum + change));
      rounds_[*state] = r + 1;
    }
  }

  /// Responses of the undeformed body on each mesh.
  const std::vector<Response>& unloaded() const { return unloaded_.front(); }

  /// States that decide the least distance of the observed ones, mirror images being one state. A pure function of the responses.
  std::vector<State> undecided(const std::vector<ScenarioRecord>& records, double tolerance) const {
    const std::vector<ObservedState> observed = observed_states(records);
    std::vector<State> states;
    for (std::size_t i : undecided_states(observed, tolerance)) {
      const std::size_t solve = plan_.images[observed[i].scenario].solve;
      const auto& candidates = solved_[solve].record.states;
      const auto it = std::find_if(candidates.begin(), candidates.end(), [&](const StateRecord& s) { return s.load_N == observed[i].load_N; });
      states.push_back({solve, std::size_t(it - candidates.begin())});
    }
    std::sort(states.begin(), states.end());
    states.erase(std::unique(states.begin(), states.end()), states.end());
    return states;
  }

  EnergyLedger ledger;   ///< of the traced state that closes worst
  double seconds = 0.0;  ///< spent in tracing, summed over threads

 private:
  const Body& body_;
  const ContactPlan& plan_;
  const Light& light_;
  const std::vector<Pad>& places_;
  std::vector<SolvedScenario>& solved_;
  std::vector<State> all_;
  std::map<State, int> rounds_;                  ///< that a state has had
  std::vector<std::vector<Response>> unloaded_;  ///< by round and place; empty where it was not needed
};

}  // namespace detail

}  // namespace lumo

// ---- lumo/campaign/observe.hpp

namespace lumo {

/// Tools of one evaluation; policies are types, settings are values.
template <Mesher M, class Simulation, class Light>
struct Pipeline {
  M mesher;
  Simulation simulator;
  Light tracer;
  Focus focus = {};
  MechanicalError mechanical_error = {};
  OpticalError optical_error = {};
  bool mirror_once = true;               ///< solve mirror images once
  RayRefinement rays = {};
};

/// Called after each step: stage, steps done, steps in all. May be called from any thread, one call at a time.
using ProgressReport = std::function<void(std::string_view stage, int done, int total)>;

/// Presses and lights a body in every scenario, and lights those states again with more rays that decide J_obs. Bit-identical for every
/// executor. Throws InvalidArgument and MeshError; a solve that fails is a status in its record.
template <class P, Executor E>
Observations observe(const Body& body, const std::vector<Scenario<Sphere>>& scenarios, const P& pipeline, const E& executor, const ProgressReport& progress = {});

namespace detail {

template <class P, class Pad>
SolvedScenario solve_scenario(const Body& body, const Scenario<Sphere>& scenario, const P& pipeline, const Pad& pad) {
  SolvedScenario out;
  const Stopwatch watch;
  out.states = pad.press(scenario);
  ScenarioRecord& record = out.record;
  record = {scenario.indenter.diameter_m, scenario.angle_rad, scenario.y_m, out.states.back().status, {}, {}};
  record.terms = contact_terms(body, pad.mesh(), out.states, scenario.indenter.radius_m(), pipeline.mechanical_error);
  for (const MechanicalState& s : out.states)
    record.states.push_back({s.status, s.load_N, s.force_N, s.depth_m, s.contact_area_m2, s.reference_area_m2, s.residual_N, s.penetration_m, {}, {}});
  out.seconds = watch.seconds();
  return out;
}

/// Scenarios without a second symmetry plane take longest: they go first, so that threads end together.
inline std::vector<std::size_t> longest_first(const ContactPlan& plan) {
  std::vector<std::size_t> order(plan.solves.size());
  std::iota(order.begin(), order.end(), std::size_t(0));
  const auto halves = [&](std::size_t k) { return (plan.solves[k].scenario.y_m == 0.0) + (plan.solves[k].scenario.angle_rad == 0.0); };
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return halves(a) < halves(b); });
  return order;
}

/// Records of all scenarios of the ensemble from those that were solved.
inline std::vector<ScenarioRecord> unfold(const std::vector<Scenario<Sphere>>& scenarios, const Body& body, const ContactPlan& plan, const std::vector<SolvedScenario>& solved) {
  std::vector<ScenarioRecord> records;
  for (std::size_t k = 0; k < scenarios.size(); ++k) records.push_back(mirrored(solved[plan.images[k].solve].record, scenarios[k], body, plan.images[k]));
  return records;
}

/// Meshes of different places give the same unloaded response up to their facets; that difference would hide small changes, so changes are
/// taken on one mesh and added to the common mean.
inline std::vector<double> mean_per_emitted(const std::vector<Response>& responses, int channels) {
  std::vector<double> mean(std::size_t(channels), 0.0);
  for (const Response& r : responses)
    for (std::size_t b = 0; b < mean.size(); ++b) mean[b] += r.power_W[b] / (r.ledger.emitted * double(responses.size()));
  return mean;
}

}  // namespace detail

template <class P, Executor E>
Observations observe(const Body& body, const std::vector<Scenario<Sphere>>& scenarios, const P& pipeline, const E& executor, const ProgressReport& progress) {
  using Prepared = decltype(pipeline.simulator.prepare(body, std::declval<TetMesh>()));
  const detail::Stopwatch clock;
  Observations out;
  const ContactPlan plan = plan_contacts(scenarios, body.symmetry, pipeline.mirror_once);
  std::mutex reporting;
  int done = 0;
  const auto report = [&](std::string_view stage, std::size_t total) {
    const std::lock_guard lock(reporting);
    if (progress) progress(stage, ++done, int(total));
  };

  // Meshes: scenarios at one place and angle share one.
  const TetMesh coarse = mesh_body(body, pipeline.mesher);
  std::vector<std::unique_ptr<Prepared>> places(plan.places.size());
  std::vector<double> meshing(places.size());
  executor.for_each(places.size(), [&](std::size_t k) {
    const detail::Stopwatch watch;
    std::vector<Scenario<Sphere>> here;
    for (std::size_t s : plan.places[k].solves) here.push_back(plan.solves[s].scenario);
    places[k] = std::make_unique<Prepared>(pipeline.simulator.prepare(body, mesh_for_contact(body, coarse, here, pipeline.mesher, pipeline.focus)));
    meshing[k] = watch.seconds();
    report("mesh", places.size());
  });

  // Equilibria.
  const std::vector<std::size_t> order = detail::longest_first(plan);
  std::vector<detail::SolvedScenario> solved(plan.solves.size());
  done = 0;
  executor.for_each(order.size(), [&](std::size_t i) {
    const ContactPlan::Solve& s = plan.solves[order[i]];
    solved[order[i]] = detail::solve_scenario(body, s.scenario, pipeline, *places[s.place]);
    report("press", order.size());
  });
  const bool all_converged = std::all_of(solved.begin(), solved.end(), [](const auto& s) { return s.record.status == Status::converged; });

  // Light, first for all states, then with more and more rays for those that decide.
  detail::Lighting lighting(body, plan, pipeline.tracer, places, solved);
  if (body.regions > 0) {
    done = 0;
    lighting.trace(lighting.all(), 0, executor, [&](std::size_t n) { report("light", n); });
    out.unloaded_response = detail::mean_per_emitted(lighting.unloaded(), body.regions);
    for (int round = 1; all_converged && round <= pipeline.rays.rounds; ++round) {
      const auto undecided = lighting.undecided(detail::unfold(scenarios, body, plan, solved), pipeline.rays.tolerance);
      if (undecided.empty()) break;
      done = 0;
      lighting.trace(undecided, round, executor, [&](std::size_t n) { report(detail::text("light, ", 1 << round, " times the rays"), n); });
    }
  }

  out.scenarios = detail::unfold(scenarios, body, plan, solved);
  for (ScenarioRecord& record : out.scenarios)
    for (StateRecord& s : record.states)
      for (Eigen::Index b = 0; b < s.change.cols(); ++b) s.response.push_back(out.unloaded_response[std::size_t(b)] + s.change.col(b).mean());
  for (const auto& p : places) {
    out.nodes = std::max(out.nodes, p->mesh().nodes.size());
    out.elements = std::max(out.elements, p->mesh().tets.size());
  }
  out.ledger = lighting.ledger;
  out.seconds.mesh = std::accumulate(meshing.begin(), meshing.end(), 0.0);
  for (const auto& s : solved) out.seconds.mechanics += s.seconds;
  out.seconds.optics = lighting.seconds;
  out.seconds.total = clock.seconds();
  return out;
}

}  // namespace lumo

// ---- lumo/campaign/evaluate.hpp

namespace lumo {

/// What one evaluation of a design gives. An objective is empty when a scenario did not converge, or when its terms are not defined by the loads.
struct Evaluation {
  std::optional<Estimate> J_contact, J_obs;
  std::optional<std::size_t> worst_contact;       ///< scenario that sets J_contact
  std::optional<Separation> worst_observation;    ///< pair of `observed` that sets J_obs
  std::vector<ObservedState> observed;
  Observations observations;
};

/// The worst scenario's contact progression (paper Eq. 3), with the scenario that sets it.
inline std::optional<std::pair<Estimate, std::size_t>> contact_progression(const std::vector<ScenarioRecord>& scenarios);

/// θ → body → meshes → equilibria → responses → objectives. Mirror images are solved once; scenarios run side by side.
/// Throws InfeasibleDesign before anything is computed, MeshError when the body cannot be meshed.
template <class P, Executor E>
Evaluation evaluate(const FingerDesign& design, const Silicone& silicone, const Ensemble& ensemble, const P& pipeline, const FingerOptions& options,
                    const E& executor, const ProgressReport& progress = {}) {
  const Body body = finger(design, silicone, options);

  Evaluation result;
  result.observations = observe(body, ensemble.scenarios(), pipeline, executor, progress);

  const std::vector<ScenarioRecord>& scenarios = result.observations.scenarios;
  for (const ScenarioRecord& s : scenarios)
    if (s.status != Status::converged) return result;  // a numerical failure is a status, never a score

  if (const auto worst = contact_progression(scenarios)) {
    result.J_contact = worst->first;
    result.worst_contact = worst->second;
  }
  result.observed = observed_states(scenarios);
  result.worst_observation = optical_separation(result.observed, pipeline.optical_error);
  if (result.worst_observation) result.J_obs = result.worst_observation->distance;
  return result;
}

inline std::optional<std::pair<Estimate, std::size_t>> contact_progression(const std::vector<ScenarioRecord>& scenarios) {
  std::optional<std::pair<Estimate, std::size_t>> worst;
  for (std::size_t k = 0; k < scenarios.size(); ++k) {
    const auto score = scenarios[k].terms.score();
    if (!score) return std::nullopt;
    if (!worst || score->value < worst->first.value) worst = std::pair(*score, k);
  }
  return worst;
}

}  // namespace lumo

// ---- lumo/campaign/log.hpp

namespace lumo {

/// One entry of a campaign's log. Entries are only ever added; `notes` is what may differ between two runs of the same campaign (times,
/// process numbers), everything else is the same to the last bit.
struct LogEntry {
  std::int64_t number = 0;   ///< from 0, without gaps
  std::string kind;          ///< what happened
  std::string content;       ///< what a resumed campaign needs of it
  std::string record;        ///< the whole result
  std::string notes;
};

/// A log that cannot be opened, read or written.
class StoreError : public Error {
 public:
  enum class Reason {
    corrupt,      ///< what is there is not what was written
    full,         ///< no space left
    busy,         ///< another process holds it for too long
    different,    ///< it belongs to another problem
    unusable      ///< no such folder, no permission, a defect disk, not a store
  };
  StoreError(Reason reason, const std::string& text) : Error(text), reason_(reason) {}
  Reason reason() const { return reason_; }

 private:
  Reason reason_;
};

/// Where a campaign is kept. Entry 0 is the problem. Laws: what `append` returned is there after any crash; two processes never append at once;
/// `next` sees all entries, without their records, and nothing is added between its look and its entry.
template <class L>
concept CampaignLog = requires(L& log, const L& view, std::function<std::optional<LogEntry>(const std::vector<LogEntry>&)> next, std::int64_t number) {
  { view.entries() } -> std::same_as<std::vector<LogEntry>>;
  { view.record(number) } -> std::same_as<std::string>;
  { log.append(next) } -> std::same_as<std::optional<LogEntry>>;
  { log.claim(number) } -> std::same_as<bool>;
};

/// A log that lives as long as its process.
class MemoryLog {
 public:
  explicit MemoryLog(std::string problem) { entries_.push_back({0, "problem", std::move(problem), "", ""}); }

  /// All entries, without their records.
  std::vector<LogEntry> entries() const {
    std::vector<LogEntry> list = entries_;
    for (LogEntry& e : list) e.record.clear();
    return list;
  }
  std::string record(std::int64_t number) const { return entries_.at(std::size_t(number)).record; }

  /// Adds what `next` makes of the entries so far, if anything; returns it with its number.
  template <class Next>
  std::optional<LogEntry> append(Next&& next) {
    std::optional<LogEntry> entry = next(entries());
    if (!entry) return std::nullopt;
    entry->number = std::int64_t(entries_.size());
    entries_.push_back(*entry);
    return entry;
  }

  /// May this process work on what the entry announces? Not when another living one does.
  bool claim(std::int64_t) { return true; }

 private:
  std::vector<LogEntry> entries_;
};

static_assert(CampaignLog<MemoryLog>);

}  // namespace lumo

// ---- lumo/campaign/trial_entry.hpp

namespace lumo::detail {

/// What the log of a campaign says about a trial: "<id> <design>", "<id> <outputs>" or "<id> retry|final <why>".
struct TrialEntry {
  enum class Kind { ask, tell, fail };
  Kind kind = Kind::ask;
  int id = 0;
  std::vector<double> values;   ///< design or outputs
  bool retry = false;
  std::string why;
};

/// The shortest text that reads back as the same number.
inline std::string exact_text(double value) {
  char text[32];
  return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

inline std::string trial_text(int id, const std::vector<double>& values) {
  std::string s = std::to_string(id);
  for (const double v : values) s += ' ' + exact_text(v);
  return s;
}

inline LogEntry ask_entry(int id, const std::vector<double>& design) { return {0, "ask", trial_text(id, design), "", ""}; }
inline LogEntry tell_entry(int id, const std::vector<double>& outputs) { return {0, "tell", trial_text(id, outputs), "", ""}; }
inline LogEntry fail_entry(int id, bool retry, const std::string& why) {
  return {0, "fail", std::to_string(id) + (retry ? " retry " : " final ") + why, "", ""};
}

/// Throws StoreError for an entry that is none of these.
inline TrialEntry parse_trial(const LogEntry& entry) {
  const auto refuse = [&] { throw StoreError(StoreError::Reason::corrupt, text("entry ", entry.number, " is no trial: ", entry.kind, ' ', entry.content)); };
  std::string_view rest = entry.content;
  const auto take = [&](auto& value) {
    const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), value);
    if (error != std::errc{} || (end != rest.data() + rest.size() && *end != ' ')) refuse();
    rest.remove_prefix(std::min(rest.size(), std::size_t(end - rest.data()) + 1));
  };
  TrialEntry t;
  take(t.id);
  if (t.id < 0) refuse();
  if (entry.kind == "fail") {
    t.kind = TrialEntry::Kind::fail;
    t.retry = rest.starts_with("retry ");
    if (!t.retry && !rest.starts_with("final ")) refuse();
    t.why = rest.substr(6);
    return t;
  }
  if (entry.kind != "ask" && entry.kind != "tell") refuse();
  t.kind = entry.kind == "ask" ? TrialEntry::Kind::ask : TrialEntry::Kind::tell;
  while (!rest.empty()) take(t.values.emplace_back());
  return t;
}

}  // namespace lumo::detail

// ---- lumo/campaign/campaign.hpp

namespace lumo {

/// What became of one evaluation.
struct Verdict {
  std::vector<double> outputs;   ///< empty: it failed
  bool retry = false;            ///< failed for a reason of the machine, not of the design
  std::string why;               ///< stage and scenario of the failure
  std::string record;            ///< the whole result, the same in every run
  std::string notes;             ///< what another run may give otherwise: times, machine
};

/// More evaluations failed than a campaign can stand.
class CampaignError : public Error {
 public:
  using Error::Error;
};

/// A campaign's log, read by an optimiser: all that was asked, told and failed so far.
template <class O>
class CampaignState {
 public:
  /// `optimizer` knows the problem and nothing else.
  explicit CampaignState(O optimizer) : optimizer_(std::move(optimizer)) {}

  /// Takes in what is new. Throws StoreError for entries that no campaign of this problem wrote.
  void read(const std::vector<LogEntry>& entries);
  /// The next trial, as the entry that announces it.
  std::optional<LogEntry> ask(const std::vector<LogEntry>& entries);

  const O& optimizer() const { return optimizer_; }
  /// Number of the entry that announced a trial, and of the one that answered it.
  std::int64_t asked(int id) const { return asked_[std::size_t(id)]; }
  std::optional<std::int64_t> answered(int id) const { return answered_[std::size_t(id)]; }
  int failed() const;
  /// Of the latest trial that failed; empty when none did.
  std::string last_failure() const;

 private:
  O optimizer_;
  std::size_t known_ = 1;   // entry 0 is the problem
  std::vector<std::int64_t> asked_;
  std::vector<std::optional<std::int64_t>> answered_;
};

/// How a campaign goes on when things go wrong.
struct CampaignConfig {
  int failures_at_least = 5;       ///< it stops once so many evaluations have failed
  double failures_above = 0.5;     ///< and more than this share of all
  double poll_s = 0.5;             ///< how often it looks whether another process has ended, or died
};

/// Evaluates what the optimiser asks until it has as many results as its problem wants, or no design is left. Continues what the log holds; several
/// processes may work on one log. Each entry depends only on those before it, so a campaign in one process has the same log, to the bit, after
/// any number of crashes. `evaluate(design)` gives a Verdict; `watch(state, id, verdict)` sees each. Throws StoreError and CampaignError.
template <CampaignLog Log, class O, class Evaluate, class Watch>
OptimizerStatus run_campaign(Log& log, const O& optimizer, const Evaluate& evaluate, const Watch& watch, const CampaignConfig& config = {});

template <class O>
void CampaignState<O>::read(const std::vector<LogEntry>& entries) {
  for (; known_ < entries.size(); ++known_) {
    const LogEntry& e = entries[known_];
    try {
      const detail::TrialEntry t = detail::parse_trial(e);
      if (t.kind == detail::TrialEntry::Kind::ask) {
        optimizer_.restore(t.id, t.values);
        asked_.push_back(e.number);
        answered_.emplace_back();
        continue;
      }
      if (t.kind == detail::TrialEntry::Kind::tell) optimizer_.tell(t.id, t.values);
      else optimizer_.fail(t.id, t.retry, t.why);
      answered_[std::size_t(t.id)] = e.number;
    } catch (const StoreError&) {
      throw;
    } catch (const Error& error) {
      throw StoreError(StoreError::Reason::corrupt, detail::text("entry ", e.number, " does not fit those before it: ", error.what()));
    }
  }
}

template <class O>
std::optional<LogEntry> CampaignState<O>::ask(const std::vector<LogEntry>& entries) {
  read(entries);
  O next = optimizer_;
  const std::optional<Trial> trial = next.ask();
  if (!trial) {
    optimizer_ = std::move(next);   // knows why there is none
    return std::nullopt;
  }
  return detail::ask_entry(trial->id, trial->x);
}

template <class O>
int CampaignState<O>::failed() const {
  int n = 0;
  for (const Trial& t : optimizer_.trials()) n += t.state == Trial::State::failed;
  return n;
}

template <class O>
std::string CampaignState<O>::last_failure() const {
  std::string why;
  for (const Trial& t : optimizer_.trials())
    if (t.state == Trial::State::failed) why = t.why;
  return why;
}

namespace detail {

/// A trial for this process: one whose worker died, or a new one. `state` has read the log.
template <CampaignLog Log, class O>
std::optional<int> take(Log& log, CampaignState<O>& state) {
  for (const Trial& t : state.optimizer().trials())
    if (t.state == Trial::State::pending && log.claim(state.asked(t.id))) return t.id;
  const auto entry = log.append([&](const std::vector<LogEntry>& entries) { return state.ask(entries); });
  if (!entry) return std::nullopt;
  state.read(log.entries());
  const int id = parse_trial(*entry).id;
  if (state.optimizer().trials()[std::size_t(id)].state == Trial::State::pending && log.claim(entry->number)) return id;
  return take(log, state);   // somebody else was faster
}

}  // namespace detail

template <CampaignLog Log, class O, class Evaluate, class Watch>
OptimizerStatus run_campaign(Log& log, const O& optimizer, const Evaluate& evaluate, const Watch& watch, const CampaignConfig& config) {
  CampaignState<O> state(optimizer);
  while (true) {
    state.read(log.entries());
    const int failed = state.failed(), ended = failed + state.optimizer().told();
    if (failed >= config.failures_at_least && failed > config.failures_above * ended)
      throw CampaignError(detail::text("campaign stops: ", failed, " of ", ended, " evaluations failed, the limit is ", 100 * config.failures_above,
                                       " % once ", config.failures_at_least, " have; the last: ", state.last_failure()));
    const std::optional<int> id = detail::take(log, state);
    if (!id) {
      if (state.optimizer().status() != OptimizerStatus::waiting) return state.optimizer().status();
      std::this_thread::sleep_for(std::chrono::duration<double>(config.poll_s));
      continue;
    }
    const Verdict verdict = evaluate(state.optimizer().trials()[std::size_t(*id)].x);
    log.append([&](const std::vector<LogEntry>& entries) -> std::optional<LogEntry> {
      state.read(entries);
      if (state.answered(*id)) return std::nullopt;
      LogEntry e = verdict.outputs.empty() ? detail::fail_entry(*id, verdict.retry, verdict.why) : detail::tell_entry(*id, verdict.outputs);
      e.record = verdict.record;
      e.notes = verdict.notes;
      return e;
    });
    state.read(log.entries());
    watch(std::as_const(state), *id, verdict);
  }
}

}  // namespace lumo

// ---- lumo/campaign/finger_campaign.hpp

namespace lumo {

/// The paper's search: J_contact and J_obs as large as can be over θ, from five reference and eight Sobol designs. Source: paper §III-D.
inline Problem finger_problem(int evaluations = 160, std::uint64_t seed = 1) {
  Problem p;
  p.space = finger_space();
  p.objectives = {{"J_contact", true, 0.0}, {"J_obs", true, 0.0}};
  for (const FingerDesign& d : reference_designs()) {
    const auto x = d.values();
    p.initial.emplace_back(x.begin(), x.end());
  }
  p.sobol = 8;
  p.evaluations = evaluations;
  p.seed = seed;
  return p;
}

/// The first scenario that failed, and how; empty when all converged.
inline std::string failed_press(const std::vector<ScenarioRecord>& scenarios) {
  for (const ScenarioRecord& s : scenarios)
    if (s.status != Status::converged)
      return detail::text("press: ", to_string(s.status), " at ", s.states.back().load_N, " N, sphere of ", 1e3 * s.diameter_m, " mm at ", s.angle_rad * 180.0 / pi,
                          " deg, y = ", 1e3 * s.y_m, " mm");
  return "";
}

/// Why an evaluation has no objectives: the stage and the first scenario that failed. Empty when it has both.
inline std::string failure_of(const Evaluation& e) {
  if (e.J_contact && e.J_obs) return "";
  if (std::string why = failed_press(e.observations.scenarios); !why.empty()) return why;
  return !e.J_contact ? "objective: the loads do not define the terms of J_contact" : "objective: no two states can be compared for J_obs";
}

/// What a campaign keeps of an evaluation; a solve that ran out of time may be tried again.
inline Verdict verdict_of(const Evaluation& e) {
  Verdict v;
  v.why = failure_of(e);
  if (v.why.empty()) v.outputs = {e.J_contact->value, e.J_obs->value};
  for (const ScenarioRecord& s : e.observations.scenarios) v.retry = v.retry || s.status == Status::time_limit;
  return v;
}

/// The same of a mesh that could not be made; the machine's limits are not the design's.
inline Verdict verdict_of(const MeshError& e) {
  using enum MeshError::Reason;
  Verdict v;
  v.why = detail::text("mesh: ", e.what());
  v.retry = e.reason() == timed_out || e.reason() == out_of_memory;
  return v;
}

}  // namespace lumo

// ---- lumo/objective/selection.hpp

namespace lumo {

/// The design to build: argmax of min(J_contact/max J_contact, J_obs/max J_obs), the first of equals. Pairs (J_contact, J_obs); nothing when
/// there are none, or one objective is nowhere positive. Source: paper §III-D.
inline std::optional<std::size_t> balanced_choice(const std::vector<std::pair<double, double>>& objectives) {
  double contact = 0.0, observation = 0.0;
  for (const auto& [c, o] : objectives) contact = std::max(contact, c), observation = std::max(observation, o);
  if (!(contact > 0.0 && observation > 0.0)) return std::nullopt;
  std::size_t best = 0;
  const auto score = [&](std::size_t k) { return std::min(objectives[k].first / contact, objectives[k].second / observation); };
  for (std::size_t k = 1; k < objectives.size(); ++k)
    if (score(k) > score(best)) best = k;
  return best;
}

}  // namespace lumo

// ---- lumo/campaign/choice_stability.hpp

namespace lumo {

/// What a search of `evaluations` trials would have chosen with each of `seeds` seeds, were the objectives the posterior means of Gaussian
/// processes of the trials told so far: how much of the choice is the search's luck. Both objectives are maximised, reference (0, 0).
/// `make_optimizer(problem)` gives a fresh optimiser; `watch()` is called after each search, from any thread. Empty where a search found
/// nothing to choose. Throws InvalidArgument with fewer than two told trials.
template <class MakeOptimizer, Executor E, class Watch>
std::vector<std::optional<Design>> choices_over_seeds(const Problem& problem, const std::vector<Trial>& trials, int seeds, int evaluations, const MakeOptimizer& make_optimizer,
                                                      const E& executor, const Watch& watch) {
  std::vector<const Trial*> told;
  for (const Trial& t : trials)
    if (t.state == Trial::State::told) told.push_back(&t);
  if (told.size() < 2) throw InvalidArgument(detail::text("a model of the results needs at least 2 told trials, has ", told.size()));

  const auto n = Eigen::Index(told.size()), d = Eigen::Index(problem.space.variables.size());
  TrainingData data{Eigen::MatrixXd(d, n), Eigen::VectorXd(n), Eigen::VectorXd(d), Eigen::VectorXd(d)};
  for (Eigen::Index i = 0; i < d; ++i) data.lower[i] = problem.space.variables[std::size_t(i)].lower, data.upper[i] = problem.space.variables[std::size_t(i)].upper;
  std::vector<GaussianProcess<>> models;
  for (std::size_t k = 0; k < problem.objectives.size(); ++k) {
    for (Eigen::Index j = 0; j < n; ++j) {
      data.x.col(j) = Eigen::Map<const Eigen::VectorXd>(told[std::size_t(j)]->x.data(), d);
      data.y[j] = told[std::size_t(j)]->outputs[k];
    }
    models.push_back(GaussianProcess<>::fit(data));
  }

  std::vector<std::optional<Design>> choices(std::size_t(seeds), std::nullopt);
  executor.for_each(choices.size(), [&](std::size_t s) {
    Problem searched = problem;
    searched.seed = std::uint64_t(s) + 1;
    searched.evaluations = evaluations;
    auto optimizer = make_optimizer(searched);
    std::vector<std::pair<double, double>> found;
    while (const std::optional<Trial> trial = optimizer.ask()) {
      const Eigen::MatrixXd x = Eigen::Map<const Eigen::VectorXd>(trial->x.data(), d);
      found.emplace_back(models[0].mean(x)[0], models[1].mean(x)[0]);
      optimizer.tell(trial->id, {found.back().first, found.back().second});
    }
    if (const auto best = balanced_choice(found)) choices[s] = optimizer.trials()[*best].x;
    watch();
  });
  return choices;
}

}  // namespace lumo

// ---- lumo/campaign/matched_study.hpp

namespace lumo {

/// A design, or a matched variant of it, under the contacts of a study.
struct VariantResult {
  Twin twin = Twin::none;
  std::string why;                        ///< empty: all scenarios converged
  std::optional<Estimate> J_contact;
  std::optional<std::size_t> worst_contact;
  std::optional<Estimate> change;         ///< D: norm of the response change at the study's load, median over scenarios, per emitted power
  Observations observations;
};

/// What a matched study compares. Source: paper §IV-A.
struct MatchedStudy {
  std::vector<Twin> twins;                ///< each design is compared with these
  bool light = false;                     ///< trace light, too
  double change_load_N = 1.0;             ///< at which D is taken
};

/// Contacts at the middle of the finger, along the pad normal, with the smallest and the largest sphere of the paper.
inline Ensemble middle_contacts() {
  Ensemble e;
  e.diameters_m = {10e-3, 30e-3};
  e.places_m = {0.0};
  return e;
}

/// The designs of a study: feasible lattice points spread over `space` (Owen-scrambled Sobol points), as a problem without a search.
inline Problem study_problem(const DesignSpace& space, int designs, std::uint64_t seed) {
  Problem p;
  p.space = space;
  p.objectives = {{"J_contact", true, 0.0}};
  p.sobol = 1024;   // more than are wanted: some may fail
  p.evaluations = designs;
  p.seed = seed;
  return p;
}

/// The design itself, then its variants, in the order of `study.twins`. What fails in one leaves the others whole. Throws InfeasibleDesign.
template <class P, Executor E>
std::vector<VariantResult> compare_variants(const FingerDesign& design, const Silicone& silicone, const Ensemble& ensemble, const MatchedStudy& study, const P& pipeline,
                                            const FingerOptions& options, const E& executor, const ProgressReport& progress = {});

/// Median over scenarios of the norm of the response change at one load; empty when a scenario has none.
inline std::optional<Estimate> median_change(const std::vector<ScenarioRecord>& scenarios, double load_N, const OpticalError& error) {
  std::vector<Estimate> norms;
  for (const ScenarioRecord& s : scenarios) {
    const auto state = std::find_if(s.states.begin(), s.states.end(), [&](const StateRecord& k) { return k.load_N == load_N && k.change.size() > 0; });
    if (state == s.states.end()) return std::nullopt;
    const Estimate d = response_distance(state->change, Eigen::MatrixXd::Zero(state->change.rows(), state->change.cols()));
    norms.push_back({d.value, std::hypot(2.0 * d.error, error.mesh * d.value)});
  }
  if (norms.empty()) return std::nullopt;
  std::sort(norms.begin(), norms.end(), [](const Estimate& a, const Estimate& b) { return a.value < b.value; });
  const Estimate &low = norms[(norms.size() - 1) / 2], &high = norms[norms.size() / 2];
  return Estimate{0.5 * (low.value + high.value), 0.5 * (low.error + high.error)};   // errors of the mesh are alike in all scenarios
}

namespace detail {

template <class P, Executor E>
VariantResult evaluate_variant(const FingerDesign& design, Twin twin, const Silicone& silicone, const Ensemble& ensemble, const MatchedStudy& study, const P& pipeline,
                               FingerOptions options, const E& executor, const ProgressReport& progress) {
  options.twin = twin;
  Body body = finger(design, silicone, options);
  if (!study.light) body.regions = 0;
  VariantResult result;
  result.twin = twin;
  try {
    result.observations = observe(body, ensemble.scenarios(), pipeline, executor, progress);
  } catch (const MeshError& e) {
    result.why = text("mesh: ", e.what());
    return result;
  }
  const auto& scenarios = result.observations.scenarios;
  result.why = failed_press(scenarios);
  if (!result.why.empty()) return result;
  if (const auto worst = contact_progression(scenarios)) {
    result.J_contact = worst->first;
    result.worst_contact = worst->second;
  }
  if (body.regions > 0) result.change = median_change(scenarios, study.change_load_N, pipeline.optical_error);
  return result;
}

}  // namespace detail

template <class P, Executor E>
std::vector<VariantResult> compare_variants(const FingerDesign& design, const Silicone& silicone, const Ensemble& ensemble, const MatchedStudy& study, const P& pipeline,
                                            const FingerOptions& options, const E& executor, const ProgressReport& progress) {
  std::vector<VariantResult> results = {detail::evaluate_variant(design, Twin::none, silicone, ensemble, study, pipeline, options, executor, progress)};
  for (const Twin twin : study.twins) results.push_back(detail::evaluate_variant(design, twin, silicone, ensemble, study, pipeline, options, executor, progress));
  return results;
}

}  // namespace lumo

// ---- lumo/campaign/paired_differences.hpp

namespace lumo {

/// Of one quantity: what a design has more than its variant. Errors of both are taken as independent.
inline Estimate difference(const Estimate& design, const Estimate& variant) { return {design.value - variant.value, std::hypot(design.error, variant.error)}; }

/// Differences of many designs in a few numbers.
struct PairedSummary {
  std::size_t positive = 0, negative = 0;   ///< signs that count: |difference| above twice its error
  std::size_t undecided = 0;
  std::size_t above_zero = 0;               ///< differences > 0, whatever their error
  double median = 0.0;
  /// Distribution-free interval of the median: the widest order statistics that the binomial law leaves at least 95 %; empty below six
  /// differences, where not even the extremes reach that. Source: Conover, Practical Nonparametric Statistics, §3.2.
  std::optional<std::pair<double, double>> median_95;

  std::size_t count() const { return positive + negative + undecided; }
};

/// Empty without differences.
inline std::optional<PairedSummary> summarize(const std::vector<Estimate>& differences) {
  if (differences.empty()) return std::nullopt;
  PairedSummary s;
  std::vector<double> sorted;
  for (const Estimate& d : differences) {
    if (std::abs(d.value) <= 2.0 * d.error) ++s.undecided;
    else ++(d.value > 0.0 ? s.positive : s.negative);
    s.above_zero += d.value > 0.0;
    sorted.push_back(d.value);
  }
  std::sort(sorted.begin(), sorted.end());
  const std::size_t n = sorted.size();
  s.median = 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]);
  double term = std::pow(0.5, double(n)), outside = 0.0;   // P(exactly k of n below the median), and up to there
  for (std::size_t k = 0; k < n / 2; ++k) {
    outside += term;
    if (outside > 0.025) break;
    s.median_95 = std::pair(sorted[k], sorted[n - 1 - k]);
    term *= double(n - k) / double(k + 1);
  }
  return s;
}

}  // namespace lumo

// ---- lumo/lumo.hpp

// Everything of lumo that needs nothing but Eigen, in the order in which data flows. Foreign libraries enter through lumo/support/.
