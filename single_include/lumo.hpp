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
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <Eigen/Sparse>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <istream>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <numbers>
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
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

// ---- lumo/version.hpp

namespace lumo {

/// Version of this library, by semantic versioning: before 1.0 a new minor version may break its users, a new patch does not.
/// These three numbers are the only place where it stands; CMake and pkg-config read them here.
inline constexpr int version_major = 0;
inline constexpr int version_minor = 1;
inline constexpr int version_patch = 0;

}  // namespace lumo

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

/// The input was sound, and yet there is no result.
class NumericalError : public Error {
 public:
  using Error::Error;
};

/// A surface that cannot be meshed, or a mesh that fails a quality gate.
class MeshError : public NumericalError {
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
  MeshError(Reason reason, const std::string& text) : NumericalError(text), reason_(reason) {}
  Reason reason() const { return reason_; }

 private:
  Reason reason_;
};

/// A press found no equilibrium where one is needed to go on.
class PressFailure : public NumericalError {
 public:
  using NumericalError::NumericalError;
};

/// A file or stream that cannot be read or written, or says what makes no sense.
class InputError : public Error {
 public:
  using Error::Error;
};

namespace detail {

/// The shortest spelling that reads back as the same number: a message must not round a value onto the limit that it breaks. NaN has no sign.
inline std::string exact(double value) {
  if (std::isnan(value)) return "nan";
  char digits[32];
  return {digits, std::to_chars(digits, digits + sizeof digits, value).ptr};
}

/// Foreign text as a message may show it: at most 40 characters, '?' for what is not ASCII.
inline std::string printable(std::string_view s) {
  std::string p;
  for (const char c : s.substr(0, 40)) p += c >= ' ' && c <= '~' ? c : '?';
  return p + (s.size() > 40 ? "..." : "");
}

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
  throw InvalidArgument(detail::text(what, " is ", detail::exact(value), " ", unit, ", must lie in [", low, ", ", high, "] ", unit));
}

/// What a quantity may be, ends included.
struct Limits {
  double low, high;
};

inline void require_in_range(const char* what, double value, const Limits& limits, const char* unit) { require_in_range(what, value, limits.low, limits.high, unit); }

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
      throw InfeasibleDesign(v.name + " finite", x[i], v.upper, v.unit, detail::text("infeasible design: ", v.name, " = ", detail::exact(x[i]), unit, ", must lie in [", v.lower, ", ", v.upper, "]", unit));
    if (x[i] < v.lower)
      throw InfeasibleDesign(v.name + " lower bound", x[i], v.lower, v.unit,
                             detail::text("infeasible design: ", v.name, " = ", detail::exact(x[i]), unit, " is below its lower bound ", v.lower, unit));
    if (x[i] > v.upper)
      throw InfeasibleDesign(v.name + " upper bound", x[i], v.upper, v.unit,
                             detail::text("infeasible design: ", v.name, " = ", detail::exact(x[i]), unit, " is above its upper bound ", v.upper, unit));
    if (v.step > 0.0 && !v.on_lattice(x[i]))
      throw InfeasibleDesign(v.name + " lattice", x[i], v.nearest_node(x[i]), v.unit,
                             detail::text("infeasible design: ", v.name, " = ", detail::exact(x[i]), unit, " is off the ", v.step, unit, " lattice; nearest is ", v.nearest_node(x[i]), unit));
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

  static constexpr double lattice_mm = 0.5;  ///< all five are multiples of it

  /// Values that are multiples of the lattice but for rounding become them, so that 0.1 + 0.4 is 0.5 in every bit; others are taken as they are.
  static FingerDesign from(std::span<const double> x);
  std::array<double, 5> values() const { return {h_fp, h_ep, w_s, h_s, w_v}; }
  bool operator==(const FingerDesign&) const = default;
};

/// Lengths that the paper leaves open, shared by all designs, in mm.
struct PadDimensions {
  double width = 29.5;   ///< W: at this width w_s + 2 w_v ≤ 19.5 says the same as 5 mm of silicone at each side
  double length = 60.0;  ///< L, centred on y = 0
  double t_min = 5.0;    ///< smallest silicone thickness
  bool t_min_beside = true;  ///< it holds beside stem and voids, too, not only above them

  bool operator==(const PadDimensions&) const = default;
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

// Squared forms of the two thickness rules: on the lattice every term is a dyadic rational of few bits, so doubles decide them exactly.
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
  space.variables = {{"h_fp", 2.0, 29.0, step, "mm"}, {"h_ep", 1.0, 20.0, step, "mm"}, {"w_s", 4.0, 15.0, step, "mm"}, {"h_s", 2.0, 15.0, step, "mm"}, {"w_v", 0.0, 7.5, step, "mm"}};
  const double unbounded = -std::numeric_limits<double>::infinity();
  space.constraints = {{"h_fp + h_ep", {1, 1, 0, 0, 0}, unbounded, 20.0, "mm"}, {"w_s + 2 w_v", {0, 0, 1, 0, 2}, unbounded, 19.5, "mm"}};
  const auto refusal = [pad](const char* where, double value) {
    return InfeasibleDesign(std::string("t_min ") + where, value, pad.t_min, "mm",
                            detail::text("infeasible design: smallest silicone thickness t_min (", where, ") = ", value, " mm is below its limit ", pad.t_min, " mm"));
  };
  space.rules = {{[pad](std::span<const double> x) { return detail::vertically_thick(FingerDesign::from(x), pad); },
                  [pad, refusal](std::span<const double> x) { return refusal("vertical", vertical_thickness(FingerDesign::from(x), pad)); }}};
  if (pad.t_min_beside)
    space.rules.push_back({[pad](std::span<const double> x) { return detail::horizontally_thick(FingerDesign::from(x), pad); },
                           [pad, refusal](std::span<const double> x) { return refusal("horizontal", horizontal_thickness(FingerDesign::from(x), pad)); }});
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

// What it costs to include lumo. A compiler instantiates whatever an inline function uses, called or not, and Eigen's expressions made up nearly all of
// the cost. The body of a function template waits for its first call, so a function that computes with matrices, or calls one that does, is one:
// `template <class = void>`. Even there the types of expressions are made at once if they do not depend on a parameter. Hence
// `template <class Mat3 = Mat3>`: under their own names the matrix types are parameters, which nobody passes, and nothing is made before the call.
// Arguments then convert by `In`. benchmarks/parse_cost measures it, tests/repository/check_cost.py guards it.

namespace lumo {

using Vec3 = Eigen::Vector3d;
using Mat3 = Eigen::Matrix3d;
/// Derivative of a 3 × 3 tensor by another, both flattened column by column: row i + 3 j, column k + 3 l.
using Mat9 = Eigen::Matrix<double, 9, 9>;

/// An argument of such a function. Nothing is deduced from it, so it converts as a plain parameter's does.
template <class T>
using In = const std::type_identity_t<T>&;

/// `Type`, of which the compiler knows no more than that it depends on `Parameter`: the same for all members of a class template.
template <class Type, class Parameter>
using Dependent = std::conditional_t<true, Type, Parameter>;

/// Planes of mirror symmetry of a body. `x` is the plane x = 0, `y` the plane y = 0.
struct Symmetry {
  bool x = false;
  bool y = false;
  bool operator==(const Symmetry&) const = default;
};

}  // namespace lumo

// ---- lumo/morphology/optical_data.hpp

namespace lumo {

/// A homogeneous medium: refractive index [–], extinction coefficient [1/m], and what a scattering reading of the extinction needs.
struct Medium {
  double refractive_index = 1.0;
  double extinction_per_m = 0.0;    ///< absorption and scattering together
  double scattering_albedo = 0.0;   ///< share of the extinction that is scattering
  double anisotropy = 0.0;          ///< mean cosine of the angle of scattering
};

/// How light meets a surface.
struct Dielectric { bool operator==(const Dielectric&) const = default; };                               ///< smooth interface: Fresnel reflection and refraction
struct Lambertian { double albedo = 0.8; bool operator==(const Lambertian&) const = default; };         ///< diffuse, opaque
struct Mirror { double reflectance = 1.0; bool operator==(const Mirror&) const = default; };            ///< specular, opaque
struct Absorber { bool operator==(const Absorber&) const = default; };                                   ///< black
using SurfaceOptics = std::variant<Dielectric, Lambertian, Mirror, Absorber>;

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
  double scattering_albedo = 0.0;   ///< share of the extinction that is scattering, for a ScatteringMedium; BeerLambert takes all of it as absorption
  double anisotropy = 0.0;          ///< mean cosine of the angle of scattering; neither is in the paper

  bool operator==(const Silicone&) const = default;
  Medium medium() const { return {refractive_index, extinction_per_m, scattering_albedo, anisotropy}; }
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

// ---- lumo/morphology/emitter.hpp

namespace lumo {

/// Sine (≥ 0) and cosine of the angle between a direction and an axis.
struct Polar {
  double sine, cosine;
};

/// A source of light in the medium that it touches: a flat or pointlike place, from all of which light goes the same ways, evenly round an axis.
/// Optional: `double intensity(double cosine) const` [W/sr], power_W times the density of the directions that polar() draws; with it direct light
/// is gathered backwards, which has less noise, without it (a collimated beam has no such density) it is traced forward. `bool in_air`: it radiates into the
/// air beside the body, not into the body; its light is traced forward.
/// Laws: |axis| = 1; point(u, v) is uniform in area [m] over (0, 1)² (there is less noise where point(1−u, 1−v) lies opposite it about `center`);
/// polar(u) is monotone; mirrored(m), m = (±1, ±1, 1), radiates to the mirror image of the axis, and points do not depend on which of several ways the
/// same source is described; power_W is all that it radiates [W]; `channel` ≥ 0 is its colour.
template <class E>
concept EmitterModel = requires(const E& e, double u, const Vec3& m) {
  { e.center } -> std::convertible_to<Vec3>;
  { e.power_W } -> std::convertible_to<double>;
  { e.channel } -> std::convertible_to<int>;
  { e.axis() } -> std::convertible_to<Vec3>;
  { e.point(u, u) } -> std::convertible_to<Vec3>;
  { e.polar(u) } -> std::convertible_to<Polar>;
  { e.mirrored(m) } -> std::convertible_to<E>;
};

/// A flat rectangular emitter with a cosine law (Lambert 1760). It radiates to `half_u` × `half_v`.
struct RectangleEmitter {
  Vec3 center = Vec3::Zero();      ///< [m]
  Vec3 half_u = Vec3::UnitX();     ///< half edge [m]
  Vec3 half_v = Vec3::UnitY();     ///< half edge [m]
  double power_W = 1.0;
  int channel = 0;                 ///< colour channel
  bool in_air = false;             ///< radiates into the air beside the body

  template <class Vec3 = Vec3>
  Vec3 axis() const { return half_u.cross(half_v).normalized(); }
  template <class Vec3 = Vec3>
  Vec3 point(double u, double v) const { return center + (2.0 * u - 1.0) * half_u + (2.0 * v - 1.0) * half_v; }
  Polar polar(double u) const { return {std::sqrt(u), std::sqrt(1.0 - u)}; }
  double intensity(double cosine) const { return cosine > 0.0 ? power_W / pi * cosine : 0.0; }
  template <class Vec3 = Vec3>
  RectangleEmitter mirrored(In<Vec3> m) const;
};

static_assert(EmitterModel<RectangleEmitter>);

/// Throws InvalidArgument for an emitter without area or with a coordinate that is not finite.
template <class = void>
inline void validate(const RectangleEmitter& e) {
  if (!e.half_u.allFinite() || !e.half_v.allFinite()) throw InvalidArgument("emitter: a coordinate is not finite");
  require_positive("emitter area", 4.0 * e.half_u.cross(e.half_v).norm(), "m2");
}

/// Any model of EmitterModel: a value, cheap to copy.
class Emitter {
 public:
  template <class E>
    requires(!std::same_as<E, Emitter> && EmitterModel<E>)
  Emitter(const E& model) : model_(std::make_shared<const E>(model.mirrored(Vec3::Ones()))), calls_(&calls<E>) {}

  Vec3 center() const { return calls_->center(model_.get()); }
  double power_W() const { return calls_->power_W(model_.get()); }
  int channel() const { return calls_->channel(model_.get()); }
  Vec3 axis() const { return calls_->axis(model_.get()); }
  Vec3 point(double u, double v) const { return calls_->point(model_.get(), u, v); }
  Polar polar(double u) const { return calls_->polar(model_.get(), u); }
  bool has_intensity() const { return calls_->intensity != nullptr; }
  bool in_air() const { return calls_->in_air(model_.get()); }
  /// [W/sr]; only where has_intensity().
  double intensity(double cosine) const { return calls_->intensity(model_.get(), cosine); }
  Emitter mirrored(const Vec3& m) const { return calls_->mirrored(model_.get(), m); }
  /// Its model, if it is an E.
  template <EmitterModel E>
  const E* as() const { return calls_ == &calls<E> ? static_cast<const E*>(model_.get()) : nullptr; }
  bool same_model(const Emitter& other) const { return calls_ == other.calls_; }
  /// Throws InvalidArgument for a power that is not positive, a channel below 0, numbers that are not finite, and what the model's own validate() refuses.
  template <class = void>
  void validate() const;

 private:
  struct Calls {
    Vec3 (*center)(const void*);
    double (*power_W)(const void*);
    int (*channel)(const void*);
    Vec3 (*axis)(const void*);
    Vec3 (*point)(const void*, double, double);
    Polar (*polar)(const void*, double);
    double (*intensity)(const void*, double);  ///< or null
    bool (*in_air)(const void*);
    Emitter (*mirrored)(const void*, const Vec3&);
    void (*validate)(const void*);
  };
  template <class E>
  static const E& model(const void* e) { return *static_cast<const E*>(e); }
  template <class E>
  static constexpr auto intensity_of() -> double (*)(const void*, double) {
    if constexpr (requires(const E& e) { { e.intensity(0.5) } -> std::convertible_to<double>; })
      return [](const void* e, double c) -> double { return model<E>(e).intensity(c); };
    else
      return nullptr;
  }
  template <class E>
  static const Calls calls;

  std::shared_ptr<const void> model_;
  const Calls* calls_;
};

/// Throws InvalidArgument for no emitters, a broken one, or a colour channel below the highest one that no emitter has.
template <class = void>
void validate(const std::vector<Emitter>& emitters);

/// Number of colour channels: one more than the highest; 0 without emitters.
inline int color_count(const std::vector<Emitter>& emitters) {
  int count = 0;
  for (const Emitter& e : emitters) count = std::max(count, e.channel() + 1);
  return count;
}

// A mirror image changes the handedness of the edges, which is mended; of the two ways to name the edges, one is standard.
template <class Vec3>
inline RectangleEmitter RectangleEmitter::mirrored(In<Vec3> m) const {
  RectangleEmitter image = *this;
  image.center = m.cwiseProduct(center);
  image.half_u = m.cwiseProduct(half_u);
  image.half_v = m.cwiseProduct(half_v) * m.prod();
  Eigen::Index k = 0;
  image.half_u.cwiseAbs().maxCoeff(&k);
  if (image.half_u[k] < 0.0) image.half_u = -image.half_u, image.half_v = -image.half_v;
  return image;
}

namespace detail {

/// What the model's own validate() says, if it has one.
template <class E>
void validate_model(const E& model) {
  if constexpr (requires { validate(model); }) validate(model);
}

}  // namespace detail

template <class E>
const Emitter::Calls Emitter::calls = {[](const void* e) -> Vec3 { return model<E>(e).center; },
                                       [](const void* e) -> double { return model<E>(e).power_W; },
                                       [](const void* e) -> int { return model<E>(e).channel; },
                                       [](const void* e) -> Vec3 { return model<E>(e).axis(); },
                                       [](const void* e, double u, double v) -> Vec3 { return model<E>(e).point(u, v); },
                                       [](const void* e, double u) -> Polar { return model<E>(e).polar(u); },
                                       intensity_of<E>(),
                                       [](const void* e) -> bool {
                                         if constexpr (requires { { model<E>(e).in_air } -> std::convertible_to<bool>; }) return model<E>(e).in_air;
                                         else return false;
                                       },
                                       [](const void* e, const Vec3& m) { return Emitter(model<E>(e).mirrored(m)); },
                                       [](const void* e) { detail::validate_model(model<E>(e)); }};

template <class>
inline void Emitter::validate() const {
  require_positive("emitter power", power_W(), "W");
  require_in_range("emitter channel", channel(), 0, 255, "");
  if (!center().allFinite()) throw InvalidArgument("emitter: its centre is not finite");
  calls_->validate(model_.get());
  if (!point(0.3, 0.6).allFinite()) throw InvalidArgument("emitter: a point of it is not finite");
  if (!(std::abs(axis().norm() - 1.0) < 1e-9)) throw InvalidArgument(detail::text("emitter: its axis has length ", axis().norm(), ", must be 1"));
}

template <class>
inline void validate(const std::vector<Emitter>& emitters) {
  if (emitters.empty()) throw InvalidArgument("emitters: none given, at least one is needed");
  for (const Emitter& e : emitters) e.validate();
  for (int c = 0; c < color_count(emitters); ++c)
    if (std::none_of(emitters.begin(), emitters.end(), [&](const Emitter& e) { return e.channel() == c; }))
      throw InvalidArgument(detail::text("emitters: none has colour channel ", c, ", but one has a higher one"));
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

  template <class Vec3 = Vec3>
  Vec3 closest_point(In<Vec3> p) const { return p - direction.dot(p - point) * direction; }
  Vec3 normal(const Vec3&) const { return direction; }
};

/// The upper half (z ≥ centre) of the elliptic cylinder along y: ((x−cx)/semi_x)² + ((z−cz)/semi_z)² = 1, lengths in m.
struct EllipticCylinder {
  Vec3 center = Vec3::Zero();
  double semi_x = 1.0;
  double semi_z = 1.0;

  Vec3 closest_point(const Vec3& p) const;
  template <class Vec3 = Vec3>
  Vec3 normal(In<Vec3> p) const;
};

/// Sphere of `radius` [m] about `center`; the body is inside.
struct SphereShape {
  Vec3 center = Vec3::Zero();
  double radius = 1.0;

  template <class Vec3 = Vec3>
  Vec3 closest_point(In<Vec3> p) const { return center + radius * normal(p); }
  template <class Vec3 = Vec3>
  Vec3 normal(In<Vec3> p) const {
    const Vec3 d = p - center;
    const double r = d.norm();
    return r > 0.0 ? Vec3(d / r) : Vec3(Vec3::UnitZ());
  }
};

using Shape = std::variant<Plane, EllipticCylinder, SphereShape>;

template <class Vec3 = Vec3>
inline Vec3 closest_point(const Shape& shape, In<Vec3> p) {
  return std::visit([&](const auto& s) -> Vec3 { return s.closest_point(p); }, shape);
}
template <class Vec3 = Vec3>
inline Vec3 outward_normal(const Shape& shape, In<Vec3> p) {
  return std::visit([&](const auto& s) -> Vec3 { return s.normal(p); }, shape);
}

// The foot of the perpendicular on an ellipse, after Eberly, "Distance from a Point to an Ellipse" (2013): the root of a
// convex, falling function; Newton's method from the surface, where most points are, and bisection where a step would leave the bracket,
// so that it converges for every aspect ratio and every point.
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
      const double r = (a / b) * (a / b), e = r - 1.0, zu = r * u / a, zv = v / b;
      double low = zv, high = std::hypot(zu, zv), t = std::clamp(1.0, low, high);  // 1: on the surface
      for (int i = 0; i < 200; ++i) {
        const double x = zu / (t + e), y = zv / t, excess = x * x + y * y - 1.0;
        (excess > 0.0 ? low : high) = t;
        const double step = 0.5 * excess / (x * x / (t + e) + y * y / t), next = t + step;
        const bool close = std::abs(step) <= 1e-9 * t;  // then the error that is left is the square of this
        t = close || (next >= low && next <= high) ? next : 0.5 * (low + high);
        if (close || !(low < high)) break;
      }
      fu = r * u / (t + e);
      fv = v / t;
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

template <class Vec3>
inline Vec3 EllipticCylinder::normal(In<Vec3> p) const {
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
  bool visible = true;                    ///< on the outside: light that leaves here may lie in a region
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
  SurfaceOptics touched = Dielectric{};     ///< what light in the body meets where a tool touches; Dielectric: a film of air is left between
  std::vector<RigidFace> rigid_faces;       ///< carrier faces seen through air
  std::vector<Emitter> emitters;
  int regions = 0;                          ///< number of readout regions
  /// Region of a point of the surface, from its position [m] and exact undeformed outward normal: 0 … regions−1, or −1.
  std::function<int(const Vec3& position, const Vec3& normal)> region;
  bool regions_in_space = false;            ///< region() is asked for where a point is, not for where it was undeformed
  /// Region → its mirror image in x = 0 and y = 0; empty: itself; nothing: it is not a region.
  std::optional<std::vector<int>> region_image_x = std::vector<int>{}, region_image_y = std::vector<int>{};
};

/// Exact outward normal at the point of a patch nearest to `p`, also in the mirror images of the sector that the patch describes.
template <class Vec3 = Vec3>
inline Vec3 outward_normal(const Body& body, int patch, In<Vec3> p) {
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
    double growth = 0.35;             ///< edge length gained per length of depth
    double stretch_y = 1.0;           ///< edges along y are this much longer
    double max_turn_rad = 0.6;        ///< largest turning of the profile along one edge
    double shortest_chord = 0.4e-3;   ///< of the profile; turning does not ask for shorter ones

    bool operator==(const Mesh&) const = default;
  };
  /// The five LEDs, lengths in m. On the sides there are as many on each, at half the stem's height, with half the power; beside a void they shine into its air.
  struct Leds {
    enum class Place { top, sides };
    Place place = Place::top;
    int count = 5;
    double pitch = 11.0e-3;
    double length_y = 1.6e-3;
    double width_x = 0.8e-3;          ///< on the sides, their height
    double power_W = 1.0;             ///< of all together

    bool operator==(const Leds&) const = default;
  };
  /// Readout regions on the outer surface.
  struct Readout {
    int bins = 11;
    double half_range = 27.5e-3;      ///< |y| beyond it is not seen [m]
    double min_abs_nx = 0.5;          ///< the undeformed normal must point this much sideways
    bool one_side = false;            ///< only x > 0 is seen
    bool in_space = false;            ///< bins stay where they are; otherwise they move with the material

    bool operator==(const Readout&) const = default;
  };

  Twin twin = Twin::none;
  PadDimensions pad;
  Mesh mesh;
  Leds leds;
  Readout readout;
  double carrier_albedo = 0.8;
  bool bonded_ends = false;           ///< the end faces are held, by something clear: light passes them as before
  SurfaceOptics touched = Dielectric{};   ///< Body::touched

  bool operator==(const FingerOptions&) const = default;
};

/// Throws InvalidArgument for an option that is out of range.
void validate(const FingerOptions& options);

/// The whole finger of a feasible design as a body; its quarter x ≥ 0, y ≥ 0 is described, the rest is mirrored.
/// Throws InfeasibleDesign or InvalidArgument. Source: paper §III-A and Table I.
template <class Vec3 = Vec3>
Body finger(const FingerDesign& design, const Silicone& silicone, const FingerOptions& options = {});

namespace detail {

template <class Vec3 = Vec3>
inline Patch finger_patch(SectionTag tag, const HalfSection& s, const FingerOptions& o) {
  const bool supported = s.twin != Twin::unsupported_base;
  const double w = 0.5e-3 * s.pad.width, hs = 1e-3 * s.design.h_s, stem = 0.5e-3 * s.design.w_s;
  const SurfaceOptics wall = Lambertian{o.carrier_albedo};
  switch (tag) {
    case SectionTag::stem_top: return {"stem_top", Plane{{0, 0, hs}, -Vec3::UnitZ()}, true, false, false, wall};
    case SectionTag::stem_side: return {"stem_side", Plane{{stem, 0, 0}, -Vec3::UnitX()}, true, false, false, wall};
    case SectionTag::base: return {"base", Plane{Vec3::Zero(), -Vec3::UnitZ()}, supported, false, false, wall};
    case SectionTag::void_inner: return {"void_inner", Plane{{stem, 0, 0}, Vec3::UnitX()}, false, false, false, Dielectric{}, false};
    case SectionTag::void_roof: return {"void_roof", Plane{{0, 0, hs}, -Vec3::UnitZ()}, false, false, supported, Dielectric{}, false};
    case SectionTag::void_wall: return {"void_wall", Plane{{stem + 1e-3 * s.design.w_v, 0, 0}, -Vec3::UnitX()}, false, false, supported, Dielectric{}, false};
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

template <class = void>
inline void add_light(Body& body, const HalfSection& s, const Silicone& silicone, const FingerOptions& o) {
  body.medium = silicone.medium();
  if (s.twin == Twin::bonded_base || s.twin == Twin::unsupported_base) return;
  const auto& led = o.leds;
  const double stem = 0.5e-3 * s.design.w_s, height = 1e-3 * s.design.h_s;
  const Vec3 along(0, 0.5 * led.length_y, 0);
  for (int k = 0; k < led.count; ++k) {
    const double y = (k - 0.5 * (led.count - 1)) * led.pitch;
    if (led.place == FingerOptions::Leds::Place::top) {
      body.emitters.push_back(RectangleEmitter{{0, y, height}, {0.5 * led.width_x, 0, 0}, along, led.power_W / led.count, 0});
      continue;
    }
    const bool air = s.design.w_v > 0.0;
    require_in_range("height of the LEDs on the stem's sides", led.width_x * 1e3, 1e-3, s.design.h_s, "mm");
    for (const double side : {1.0, -1.0})   // in air, with the face that stands back (OpticalScene::Config::carrier_gap_m), but in front of it
      body.emitters.push_back(RectangleEmitter{{side * (stem - (air ? 10e-6 : 0.0)), y, 0.5 * height}, along, {0, 0, side * 0.5 * led.width_x}, 0.5 * led.power_W / led.count, 0, air});
  }
  const auto r = o.readout;
  body.touched = o.touched;
  body.regions = r.bins;
  body.regions_in_space = r.in_space;
  std::vector<int> other_end;
  for (int b = 0; b < r.bins; ++b) other_end.push_back(r.bins - 1 - b);
  body.region_image_y = other_end;
  if (r.one_side) body.region_image_x.reset();
  body.region = [r](const Vec3& p, const Vec3& n) {
    if ((r.one_side ? n.x() : std::abs(n.x())) < r.min_abs_nx || std::abs(p.y()) > r.half_range) return -1;
    const double bin = (p.y() + r.half_range) / (2.0 * r.half_range) * r.bins;
    return std::clamp(int(bin), 0, r.bins - 1);
  };
}

}  // namespace detail

inline void validate(const FingerOptions& o) {
  require_in_range("mesh edge at the contact surface", o.mesh.contact_edge * 1e3, 0.2, 10.0, "mm");
  require_in_range("coarsest mesh edge", o.mesh.coarsest_edge * 1e3, o.mesh.contact_edge * 1e3, 30.0, "mm");
  require_in_range("mesh growth with depth", o.mesh.growth, 0.0, 100.0, "");
  require_in_range("mesh stretch along y", o.mesh.stretch_y, 0.5, 4.0, "");
  require_in_range("largest turning along an edge", o.mesh.max_turn_rad, 0.01, 1.6, "rad");
  require_in_range("shortest chord", o.mesh.shortest_chord * 1e3, 0.0, 10.0, "mm");
  require_in_range("pad width", o.pad.width, 1.0, 200.0, "mm");
  require_in_range("pad length", o.pad.length, 1.0, 1000.0, "mm");
  require_in_range("smallest silicone thickness", o.pad.t_min, 0.0, 100.0, "mm");
  require_in_range("number of LEDs", o.leds.count, 0, 1000, "");
  require_in_range("LED pitch", o.leds.pitch * 1e3, 0.0, 1000.0, "mm");
  require_in_range("LED length", o.leds.length_y * 1e3, 1e-3, 100.0, "mm");
  require_in_range("LED width", o.leds.width_x * 1e3, 1e-3, 100.0, "mm");
  require_positive("LED power", o.leds.power_W, "W");
  require_in_range("readout bins", o.readout.bins, 0, 10000, "");
  require_in_range("readout half range", o.readout.half_range * 1e3, 1e-3, 1000.0, "mm");
  require_in_range("least sideways part of a visible normal", o.readout.min_abs_nx, 0.0, 1.0, "");
  require_in_range("carrier albedo", o.carrier_albedo, 0.0, 1.0, "");
  if (const auto* white = std::get_if<Lambertian>(&o.touched)) require_in_range("albedo of a tool that wets the pad", white->albedo, 0.0, 1.0, "");
  if (const auto* mirror = std::get_if<Mirror>(&o.touched)) require_in_range("reflectance of a tool that wets the pad", mirror->reflectance, 0.0, 1.0, "");
}

template <class Vec3>
inline Body finger(const FingerDesign& design, const Silicone& silicone, const FingerOptions& o) {
  validate(o);
  require_in_range("scattering albedo", silicone.scattering_albedo, 0.0, 1.0, "");
  require_in_range("anisotropy of scattering", silicone.anisotropy, -0.999, 0.999, "");
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
  body.patches.push_back({"end", Plane{{0, half_length, 0}, Vec3::UnitY()}, o.bonded_ends || o.twin == Twin::unsupported_base, false, false, Dielectric{}});
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

// ---- lumo/core/tangents.hpp

namespace lumo::detail {

/// Two unit tangents that make a right-handed frame with the unit vector `n` (after Duff et al., JCGT 6(1), 2017).
template <class Vec3 = Vec3>
inline void tangents(In<Vec3> n, Vec3& t1, Vec3& t2) {
  const double sign = n.z() < -0.6180339887 ? -1.0 : 1.0;  // not at 0: walls are upright, and rounding must not turn their frames
  const double a = -1.0 / (sign + n.z()), b = n.x() * n.y() * a;
  t1 = {1.0 + sign * n.x() * n.x() * a, sign * b, -sign * n.x()};
  t2 = {b, sign + n.y() * n.y() * a, -n.y()};
}

}  // namespace lumo::detail

// ---- lumo/morphology/disc_emitter.hpp

namespace lumo {

namespace detail {

/// Point of the unit disc from two numbers in (0, 1), uniform in area; opposite numbers give opposite points. Source: Shirley & Chiu, "A Low Distortion
/// Map Between Disk and Square", J. Graphics Tools 2 (1997).
template <class Vec3 = Vec3>
inline Vec3 on_unit_disc(double u, double v, In<Vec3> t1, In<Vec3> t2) {
  const double a = 2.0 * u - 1.0, b = 2.0 * v - 1.0;
  if (a == 0.0 && b == 0.0) return Vec3::Zero();
  const bool steep = std::abs(b) > std::abs(a);
  const double r = steep ? b : a, turn = steep ? 0.5 * pi - 0.25 * pi * (a / b) : 0.25 * pi * (b / a);
  return r * (std::cos(turn) * t1 + std::sin(turn) * t2);
}

/// Point of the disc about `center` with unit normal `n`; the same for every description of it.
template <class Vec3 = Vec3>
inline Vec3 on_disc(In<Vec3> center, In<Vec3> n, double radius_m, double u, double v) {
  Vec3 t1, t2;
  tangents(n, t1, t2);
  return center + radius_m * on_unit_disc(u, v, t1, t2);
}

}  // namespace detail

/// A flat round emitter with a cosine law (Lambert 1760). It radiates to `normal`.
struct DiscEmitter {
  Vec3 center = Vec3::Zero();      ///< [m]
  Vec3 normal = Vec3::UnitZ();     ///< unit
  double radius_m = 0.5e-3;
  double power_W = 1.0;
  int channel = 0;                 ///< colour channel

  Vec3 axis() const { return normal; }
  template <class Vec3 = Vec3>
  Vec3 point(double u, double v) const { return detail::on_disc(center, normal, radius_m, u, v); }
  Polar polar(double u) const { return {std::sqrt(u), std::sqrt(1.0 - u)}; }
  double intensity(double cosine) const { return cosine > 0.0 ? power_W / pi * cosine : 0.0; }
  template <class Vec3 = Vec3>
  DiscEmitter mirrored(In<Vec3> m) const { return {m.cwiseProduct(center), m.cwiseProduct(normal), radius_m, power_W, channel}; }
};

inline void validate(const DiscEmitter& e) { require_positive("radius of a disc emitter", e.radius_m, "m"); }

static_assert(EmitterModel<DiscEmitter>);

}  // namespace lumo

// ---- lumo/morphology/point_emitter.hpp

namespace lumo {

/// A point that radiates alike in all directions. It must lie inside the medium: of a point on its surface half the light starts out of it.
struct PointEmitter {
  Vec3 center = Vec3::Zero();      ///< [m]
  double power_W = 1.0;
  int channel = 0;                 ///< colour channel

  template <class Vec3 = Vec3>
  Vec3 axis() const { return Vec3::UnitZ(); }
  Vec3 point(double, double) const { return center; }
  Polar polar(double u) const { return {2.0 * std::sqrt(u * (1.0 - u)), 1.0 - 2.0 * u}; }
  double intensity(double) const { return power_W / (4.0 * pi); }
  template <class Vec3 = Vec3>
  PointEmitter mirrored(In<Vec3> m) const { return {m.cwiseProduct(center), power_W, channel}; }
};

static_assert(EmitterModel<PointEmitter>);

}  // namespace lumo

// ---- lumo/morphology/measured_lobe.hpp

namespace lumo {

/// Intensity against the angle from an axis, as data sheets give it, in any unit; linear in the angle's cosine between entries, 0 beyond the last.
class LobeTable {
 public:
  /// `angles_rad` ascend from 0 to at most π, `relative` intensities ≥ 0 are not all 0. Throws InvalidArgument.
  LobeTable(const std::vector<double>& angles_rad, std::vector<double> relative);

  /// Share of the power per solid angle [1/sr]; its integral over all directions is 1.
  double density(double cosine) const;
  /// Cosine of the angle below which the share `u` of the power lies: the inverse of a distribution that is quadratic between entries.
  double cosine(double u) const;

 private:
  std::vector<double> cosine_, density_, below_;  ///< descending; [1/sr]; share of the power up to each entry
};

/// A round flat emitter, or a point where the radius is 0, with a measured lobe.
struct MeasuredLobe {
  LobeTable lobe;
  Vec3 center = Vec3::Zero();         ///< [m]
  Vec3 direction = Vec3::UnitZ();     ///< unit, of the lobe's axis
  double radius_m = 0.0;
  double power_W = 1.0;
  int channel = 0;                    ///< colour channel

  Vec3 axis() const { return direction; }
  template <class Vec3 = Vec3>
  Vec3 point(double u, double v) const { return detail::on_disc(center, direction, radius_m, u, v); }
  Polar polar(double u) const {
    const double c = lobe.cosine(u);
    return {std::sqrt(std::max(0.0, 1.0 - c * c)), c};
  }
  double intensity(double cosine) const { return power_W * lobe.density(cosine); }
  template <class Vec3 = Vec3>
  MeasuredLobe mirrored(In<Vec3> m) const { return {lobe, m.cwiseProduct(center), m.cwiseProduct(direction), radius_m, power_W, channel}; }
};

inline void validate(const MeasuredLobe& e) { require_in_range("radius of a measured lobe", e.radius_m * 1e3, 0.0, 1e3, "mm"); }

static_assert(EmitterModel<MeasuredLobe>);

inline LobeTable::LobeTable(const std::vector<double>& angles_rad, std::vector<double> relative) : density_(std::move(relative)) {
  const std::size_t n = angles_rad.size();
  if (n < 2 || density_.size() != n) throw InvalidArgument(detail::text("lobe: ", n, " angles and ", density_.size(), " intensities, needs as many, at least 2"));
  if (angles_rad[0] != 0.0) throw InvalidArgument(detail::text("lobe: the first angle is ", angles_rad[0], " rad, must be 0 rad"));
  for (std::size_t k = 0; k < n; ++k) {
    require_in_range("angle of a lobe", angles_rad[k], k > 0 ? angles_rad[k - 1] + 1e-9 : 0.0, pi * (1.0 + 1e-12), "rad");
    require_in_range("intensity of a lobe", density_[k], 0.0, 1e300, "");
    cosine_.push_back(std::cos(angles_rad[k]));
  }
  below_.assign(n, 0.0);
  for (std::size_t k = 1; k < n; ++k) below_[k] = below_[k - 1] + pi * (density_[k - 1] + density_[k]) * (cosine_[k - 1] - cosine_[k]);
  const double all = below_.back();
  require_positive("intensity of a lobe, summed over its angles,", all, "");
  for (double& d : density_) d /= all;
  for (double& b : below_) b /= all;
}

inline double LobeTable::density(double c) const {
  if (!(c >= cosine_.back())) return 0.0;
  const auto next = std::lower_bound(cosine_.begin() + 1, cosine_.end() - 1, c, std::greater<>());  // first entry with a cosine ≤ c
  const std::size_t k = std::size_t(next - cosine_.begin());
  const double t = (cosine_[k - 1] - std::min(c, cosine_[k - 1])) / (cosine_[k - 1] - cosine_[k]);
  return density_[k - 1] + t * (density_[k] - density_[k - 1]);
}

inline double LobeTable::cosine(double u) const {
  const auto next = std::upper_bound(below_.begin() + 1, below_.end() - 1, u);
  const std::size_t k = std::size_t(next - below_.begin());
  const double width = cosine_[k - 1] - cosine_[k], a = density_[k - 1], b = density_[k];
  // 2π width (a t + (b − a) t²/2) = what is left of u: the root in [0, 1], in the form that does not cancel.
  const double left = std::clamp(u - below_[k - 1], 0.0, below_[k] - below_[k - 1]) / (2.0 * pi * width);
  const double root = std::sqrt(std::max(0.0, a * a + 2.0 * (b - a) * left));
  const double t = a + root > 0.0 ? std::min(1.0, 2.0 * left / (a + root)) : 0.0;
  return cosine_[k - 1] - t * width;
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
template <class Vec3 = Vec3, class Mat3 = Mat3>
std::vector<double> jacobian_coefficients(const TetMesh& mesh, const std::array<int, 10>& tet);

/// Measures without judging.
template <class Vec3 = Vec3>
MeshQuality measure(const TetMesh& mesh);

/// Throws MeshError unless all Jacobians are positive over the whole element, the surface is a closed manifold, and the volume is
/// within `volume_tolerance` of `exact_volume_m3` (0: not checked).
template <class Vec3 = Vec3>
void require_valid(const TetMesh& mesh, double exact_volume_m3 = 0.0, double volume_tolerance = 0.01);

namespace detail {

// Symmetric multilinear form whose diagonal is the determinant.
template <class Vec3 = Vec3, class Mat3 = Mat3>
inline double mixed_determinant(In<Mat3> a, In<Mat3> b, In<Mat3> c) {
  const auto det = [](const Vec3& u, const Vec3& v, const Vec3& w) { return u.dot(v.cross(w)); };
  return (det(a.col(0), b.col(1), c.col(2)) + det(a.col(0), c.col(1), b.col(2)) + det(b.col(0), a.col(1), c.col(2)) +
          det(b.col(0), c.col(1), a.col(2)) + det(c.col(0), a.col(1), b.col(2)) + det(c.col(0), b.col(1), a.col(2))) / 6.0;
}

}  // namespace detail

template <class Vec3, class Mat3>
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

template <class Vec3>
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

template <class Vec3>
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

template <class Vec3 = Vec3>
inline Vec3 snapped(const Body& body, const PatchSet& patches, std::type_identity_t<Vec3> p, double tiny) {
  for (int round = 0; round < 2; ++round)
    for (int patch : patches)
      if (patch >= 0) p = closest_point(body.patches[std::size_t(patch)].shape, p);
  if (body.symmetry.x && std::abs(p.x()) < tiny) p.x() = 0.0;
  if (body.symmetry.y && std::abs(p.y()) < tiny) p.y() = 0.0;
  return p;
}

template <class Vec3 = Vec3>
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
template <class Vec3 = Vec3>
inline Body focused(Body body, In<std::vector<Vec3>> points, const Focus& focus = {}) {
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

// ---- lumo/mesh/predicates.hpp

// Exact signs of orientation determinants. A rounded value with an error bound decides nearly always; what is too close to call is
// computed without error as an unevaluated sum of doubles of falling size. Source: Shewchuk 1997, Adaptive precision floating-point
// arithmetic and fast robust geometric predicates; his error bounds, his expansions, without his intermediate stages.
// Needs IEEE doubles rounded to nearest (no -ffast-math); exact as long as nothing overflows or underflows (lengths 1e-60 … 1e60).

namespace lumo {

using Point2 = std::array<double, 2>;

/// Sign of (b − a) × (c − a): +1 if a, b, c turn left, −1 right, 0 if they are exactly on a line.
int orient2d(const Point2& a, const Point2& b, const Point2& c);

/// Sign of (b − a) × (c − a) · (d − a): +1 if d is on the side from which a, b, c run counter-clockwise, 0 if exactly in the plane.
template <class Vec3 = Vec3>
int orient3d(In<Vec3> a, In<Vec3> b, In<Vec3> c, In<Vec3> d);

namespace detail {

inline constexpr double half_ulp = 0.5 * std::numeric_limits<double>::epsilon();

/// The sign where rounding errors cannot change it, else 0.
inline int sure_orient2d(const Point2& a, const Point2& b, const Point2& c) {
  const double left = (b[0] - a[0]) * (c[1] - a[1]);
  const double right = (b[1] - a[1]) * (c[0] - a[0]);
  const double bound = 4.0 * half_ulp * (std::abs(left) + std::abs(right));
  return left - right > bound ? 1 : left - right < -bound ? -1 : 0;
}

/// The sign where rounding errors cannot change it, else 0.
template <class Vec3 = Vec3>
inline int sure_orient3d(In<Vec3> a, In<Vec3> b, In<Vec3> c, In<Vec3> d) {
  const Vec3 u = b - a;
  const Vec3 v = c - a;
  const Vec3 w = d - a;
  double value = 0.0;
  double size = 0.0;
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    const int k = (i + 2) % 3;
    const double left = u[j] * v[k];
    const double right = u[k] * v[j];
    value += w[i] * (left - right);
    size += std::abs(w[i]) * (std::abs(left) + std::abs(right));
  }
  const double bound = 8.0 * half_ulp * size;
  return value > bound ? 1 : value < -bound ? -1 : 0;
}

/// A sum of doubles that do not overlap, smallest first, without zeros.
struct Expansion {
  std::size_t size = 0;
  std::array<double, 192> parts;  // as many as a 3 × 3 determinant of differences can need

  void push(double part) {
    if (part != 0.0) parts[size++] = part;
  }
  int sign() const { return size == 0 ? 0 : parts[size - 1] > 0.0 ? 1 : -1; }
};

struct SumAndError {
  double sum;
  double error;
};

inline SumAndError two_sum(double a, double b) {
  const double sum = a + b;
  const double b_part = sum - a;
  const double a_part = sum - b_part;
  return {sum, (a - a_part) + (b - b_part)};
}

inline Expansion difference(double a, double b) {
  const auto [sum, error] = two_sum(a, -b);
  Expansion result;
  result.push(error);
  result.push(sum);
  return result;
}

/// Merges by size, then carries the rounding errors along.
inline Expansion operator+(const Expansion& e, const Expansion& f) {
  Expansion result;
  double carry = 0.0;
  for (std::size_t i = 0, j = 0; i < e.size || j < f.size;) {
    const bool from_e = j == f.size || (i < e.size && std::abs(e.parts[i]) < std::abs(f.parts[j]));
    const auto [sum, error] = two_sum(carry, from_e ? e.parts[i++] : f.parts[j++]);
    result.push(error);
    carry = sum;
  }
  result.push(carry);
  return result;
}

inline Expansion operator*(const Expansion& e, double factor) {
  Expansion result;
  double carry = 0.0;
  for (std::size_t i = 0; i < e.size; ++i) {
    const double product = e.parts[i] * factor;
    const double tail = std::fma(e.parts[i], factor, -product);
    const auto low = two_sum(carry, tail);
    const auto high = two_sum(product, low.sum);
    result.push(low.error);
    result.push(high.error);
    carry = high.sum;
  }
  result.push(carry);
  return result;
}

inline Expansion operator*(const Expansion& e, const Expansion& f) {  // f is a difference: at most two parts
  Expansion result;
  for (std::size_t i = 0; i < f.size; ++i) result = result + e * f.parts[i];
  return result;
}

/// a d − b c of differences.
inline Expansion minor(const Expansion& a, const Expansion& b, const Expansion& c, const Expansion& d) { return a * d + (b * c) * -1.0; }

}  // namespace detail

inline int orient2d(const Point2& a, const Point2& b, const Point2& c) {
  if (const int sure = detail::sure_orient2d(a, b, c); sure != 0) return sure;
  using detail::difference;
  return detail::minor(difference(b[0], a[0]), difference(b[1], a[1]), difference(c[0], a[0]), difference(c[1], a[1])).sign();
}

template <class Vec3>
inline int orient3d(In<Vec3> a, In<Vec3> b, In<Vec3> c, In<Vec3> d) {
  if (const int sure = detail::sure_orient3d(a, b, c, d); sure != 0) return sure;
  std::array<std::array<detail::Expansion, 3>, 3> rows;
  for (int k = 0; k < 3; ++k) {
    rows[0][static_cast<std::size_t>(k)] = detail::difference(b[k], a[k]);
    rows[1][static_cast<std::size_t>(k)] = detail::difference(c[k], a[k]);
    rows[2][static_cast<std::size_t>(k)] = detail::difference(d[k], a[k]);
  }
  detail::Expansion sum;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t j = (i + 1) % 3;
    const std::size_t k = (i + 2) % 3;
    sum = sum + detail::minor(rows[0][j], rows[0][k], rows[1][j], rows[1][k]) * rows[2][i];
  }
  return sum.sign();
}

}  // namespace lumo

// ---- lumo/mesh/facet_triangles.hpp

namespace lumo::detail {

/// A triangle of a surface, by vertex numbers, and the facet that it is part of.
struct SurfaceTriangle {
  std::array<int, 3> corners;
  int facet;
};

/// Twice the area vector of a polygon (Newell's sum), taken about its first corner to keep digits.
template <class Vec3 = Vec3>
inline Vec3 polygon_normal(In<std::vector<Vec3>> vertices, const std::vector<int>& loop) {
  const Vec3& origin = vertices[static_cast<std::size_t>(loop[0])];
  Vec3 sum = Vec3::Zero();
  for (std::size_t i = 1; i + 1 < loop.size(); ++i)
    sum += (vertices[static_cast<std::size_t>(loop[i])] - origin).cross(vertices[static_cast<std::size_t>(loop[i + 1])] - origin);
  return sum;
}

/// Drops one coordinate and keeps the sense of rotation of what faces along `normal`. Exact: nothing is computed.
struct Projection {
  std::size_t first = 0;
  std::size_t second = 1;

  template <class Vec3 = Vec3>
  explicit Projection(In<Vec3> normal) {
    int axis = 0;
    normal.cwiseAbs().maxCoeff(&axis);
    first = static_cast<std::size_t>((axis + 1) % 3);
    second = static_cast<std::size_t>((axis + 2) % 3);
    if (normal[axis] < 0.0) std::swap(first, second);
  }
  Point2 operator()(const Vec3& p) const { return {p[static_cast<Eigen::Index>(first)], p[static_cast<Eigen::Index>(second)]}; }
};

/// Whether p, known to be on the line through a and b, is between them or at an end.
inline bool within(const Point2& a, const Point2& b, const Point2& p) {
  const std::size_t axis = std::abs(b[0] - a[0]) >= std::abs(b[1] - a[1]) ? 0 : 1;
  return std::min(a[axis], b[axis]) <= p[axis] && p[axis] <= std::max(a[axis], b[axis]);
}

/// Whether two closed line segments of the plane have a point in common. Exact.
inline bool segments_meet(const Point2& a, const Point2& b, const Point2& c, const Point2& d) {
  const int ac = orient2d(a, b, c);
  const int ad = orient2d(a, b, d);
  const int ca = orient2d(c, d, a);
  const int cb = orient2d(c, d, b);
  if (ac * ad < 0 && ca * cb < 0) return true;
  return (ac == 0 && within(a, b, c)) || (ad == 0 && within(a, b, d)) || (ca == 0 && within(c, d, a)) || (cb == 0 && within(c, d, b));
}

/// Whether the outline of a polygon meets itself anywhere but at its corners, or turns back on itself. Quadratic in the number of corners.
inline bool outline_crosses(const std::vector<Point2>& points) {
  const std::size_t n = points.size();
  for (std::size_t i = 0; i < n; ++i) {
    const Point2& a = points[i];
    const Point2& b = points[(i + 1) % n];
    const Point2& c = points[(i + 2) % n];
    const bool back = (a[0] - b[0]) * (c[0] - b[0]) + (a[1] - b[1]) * (c[1] - b[1]) > 0.0;
    if (back && orient2d(a, b, c) == 0) return true;
    for (std::size_t j = i + 2; j < n; ++j)
      if ((j + 1) % n != i && segments_meet(a, b, points[j], points[(j + 1) % n])) return true;
  }
  return false;
}

/// Signed height of p over the line from a to b, positive on its left.
inline double height_over(const Point2& a, const Point2& b, const Point2& p) {
  const double x = b[0] - a[0];
  const double y = b[1] - a[1];
  return (x * (p[1] - a[1]) - y * (p[0] - a[0])) / std::hypot(x, y);
}

/// Cuts a flat, simple, perhaps concave polygon with corners on straight edges into triangles that use all corners and no others.
/// Exact, by cutting off ears; first choice are ears to which no other corner comes closer than `slack`.
/// Empty result: the outline is not simple or not counter-clockwise about `normal`.
template <class Vec3 = Vec3>
inline std::optional<std::vector<SurfaceTriangle>> facet_triangles(In<std::vector<Vec3>> vertices, const std::vector<int>& loop, In<Vec3> normal,
                                                                   int facet, double slack) {
  std::vector<SurfaceTriangle> triangles;
  if (loop.size() == 3) {
    triangles.push_back({{loop[0], loop[1], loop[2]}, facet});
    return triangles;
  }
  const Projection project(normal);
  std::vector<Point2> points;
  for (int vertex : loop) points.push_back(project(vertices[static_cast<std::size_t>(vertex)]));
  if (outline_crosses(points)) return std::nullopt;

  std::vector<std::size_t> left(loop.size());
  for (std::size_t i = 0; i < left.size(); ++i) left[i] = i;
  const auto is_ear = [&](std::size_t at, bool careful) {
    const std::size_t before = left[(at + left.size() - 1) % left.size()];
    const std::size_t here = left[at];
    const std::size_t after = left[(at + 1) % left.size()];
    const Point2& a = points[before];
    const Point2& b = points[here];
    const Point2& c = points[after];
    if (orient2d(a, b, c) <= 0 || (careful && height_over(a, c, b) > -slack)) return false;
    return std::none_of(left.begin(), left.end(), [&](std::size_t other) {
      if (other == before || other == here || other == after) return false;
      const Point2& p = points[other];
      if (careful) return height_over(a, b, p) > -slack && height_over(b, c, p) > -slack && height_over(c, a, p) > -slack;
      return orient2d(a, b, p) >= 0 && orient2d(b, c, p) >= 0 && orient2d(c, a, p) >= 0;
    });
  };
  for (std::size_t at = 0; left.size() > 3;) {
    std::size_t tried = 0;
    while (tried < 2 * left.size() && !is_ear(at % left.size(), tried < left.size())) {
      ++at;
      ++tried;
    }
    if (tried == 2 * left.size()) return std::nullopt;
    at %= left.size();
    triangles.push_back({{loop[left[(at + left.size() - 1) % left.size()]], loop[left[at]], loop[left[(at + 1) % left.size()]]}, facet});
    left.erase(left.begin() + static_cast<std::ptrdiff_t>(at));
    ++at;  // the next corner but one: fewer slender triangles than a fan
  }
  if (orient2d(points[left[0]], points[left[1]], points[left[2]]) <= 0) return std::nullopt;
  triangles.push_back({{loop[left[0]], loop[left[1]], loop[left[2]]}, facet});
  return triangles;
}

}  // namespace lumo::detail

// ---- lumo/mesh/polygon_triangles.hpp

namespace lumo::detail {

/// Cuts a flat polygon with holes into triangles that use all of its corners and no others.
/// Each hole is joined to the outline by a bridge to a corner that it sees (Held 2001, section 4), then ears are cut off, the best shaped first. All decisions
/// are exact. Corners on straight edges are allowed.
class PolygonTriangles {
 public:
  using Triangle = std::array<int, 3>;

  template <class Vec3 = Vec3>
  PolygonTriangles(In<std::vector<Vec3>> vertices, In<Vec3> normal) {
    const Projection project(normal);
    for (const Vec3& v : vertices) points_.push_back(project(v));
  }

  /// By vertex numbers; the outline counter-clockwise about the normal, the holes clockwise. Nothing, where outline and holes cross or touch.
  std::optional<std::vector<Triangle>> cut(std::vector<int> outline, std::vector<std::vector<int>> holes) const;

 private:
  const Point2& at(int vertex) const { return points_[std::size_t(vertex)]; }
  int turn(int a, int b, int c) const { return orient2d(at(a), at(b), at(c)); }
  bool crosses(int a, int b, const std::vector<int>& loop) const;
  bool opens_to(const std::vector<int>& loop, std::size_t corner, int to) const;
  bool bridge(std::vector<int>& loop, const std::vector<int>& hole, const std::vector<std::vector<int>>& others) const;
  double shape_of_ear(const std::vector<int>& loop, std::size_t corner) const;

  std::vector<Point2> points_;
};

/// Whether the segment a b meets an edge of the loop that does not end in a or b.
inline bool PolygonTriangles::crosses(int a, int b, const std::vector<int>& loop) const {
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const int p = loop[i], q = loop[(i + 1) % loop.size()];
    const bool shared = p == a || p == b || q == a || q == b;
    if (!shared && segments_meet(at(a), at(b), at(p), at(q))) return true;
  }
  return false;
}

/// Whether `to` is seen from the inside of the loop's corner: bridges make a vertex a corner more than once.
inline bool PolygonTriangles::opens_to(const std::vector<int>& loop, std::size_t corner, int to) const {
  const int before = loop[(corner + loop.size() - 1) % loop.size()], here = loop[corner], after = loop[(corner + 1) % loop.size()];
  const bool left_of_in = turn(before, here, to) > 0, left_of_out = turn(here, after, to) > 0;
  return turn(before, here, after) > 0 ? left_of_in && left_of_out : left_of_in || left_of_out;
}

inline bool PolygonTriangles::bridge(std::vector<int>& loop, const std::vector<int>& hole, const std::vector<std::vector<int>>& others) const {
  const auto start = std::size_t(std::max_element(hole.begin(), hole.end(), [&](int p, int q) { return at(p) < at(q); }) - hole.begin());
  const int from = hole[start];
  std::vector<std::pair<double, std::size_t>> nearest;
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const double dx = at(loop[i])[0] - at(from)[0], dy = at(loop[i])[1] - at(from)[1];
    nearest.emplace_back(dx * dx + dy * dy, i);
  }
  std::sort(nearest.begin(), nearest.end());
  for (const auto& candidate : nearest) {
    const std::size_t corner = candidate.second;
    const int to = loop[corner];
    if (!opens_to(loop, corner, from) || !opens_to(hole, start, to) || crosses(from, to, loop) || crosses(from, to, hole)) continue;
    if (std::any_of(others.begin(), others.end(), [&](const std::vector<int>& other) { return crosses(from, to, other); })) continue;
    std::vector<int> detour{to};
    for (std::size_t k = 0; k <= hole.size(); ++k) detour.push_back(hole[(start + k) % hole.size()]);
    loop.insert(loop.begin() + std::ptrdiff_t(corner), detour.begin(), detour.end());
    return true;
  }
  return false;
}

/// Sine of the smallest angle or so, at most one; 0 where the corner is no ear.
inline double PolygonTriangles::shape_of_ear(const std::vector<int>& loop, std::size_t corner) const {
  const int a = loop[(corner + loop.size() - 1) % loop.size()], b = loop[corner], c = loop[(corner + 1) % loop.size()];
  if (a == c || turn(a, b, c) <= 0) return 0.0;
  for (const int p : loop)
    if (p != a && p != b && p != c && turn(a, b, p) >= 0 && turn(b, c, p) >= 0 && turn(c, a, p) >= 0) return 0.0;
  const auto squared = [&](int p, int q) { return (at(q)[0] - at(p)[0]) * (at(q)[0] - at(p)[0]) + (at(q)[1] - at(p)[1]) * (at(q)[1] - at(p)[1]); };
  const double twice_area = (at(b)[0] - at(a)[0]) * (at(c)[1] - at(a)[1]) - (at(b)[1] - at(a)[1]) * (at(c)[0] - at(a)[0]);
  return twice_area / std::max({squared(a, b), squared(b, c), squared(c, a)});
}

inline std::optional<std::vector<PolygonTriangles::Triangle>> PolygonTriangles::cut(std::vector<int> loop, std::vector<std::vector<int>> holes) const {
  const auto farthest = [&](const std::vector<int>& hole) { return at(*std::max_element(hole.begin(), hole.end(), [&](int p, int q) { return at(p) < at(q); })); };
  std::sort(holes.begin(), holes.end(), [&](const auto& a, const auto& b) { return farthest(a) < farthest(b); });
  while (!holes.empty()) {
    const std::vector<int> hole = std::move(holes.back());
    holes.pop_back();
    if (!bridge(loop, hole, holes)) return std::nullopt;
  }
  std::vector<Triangle> triangles;
  std::vector<double> shape;   // of the ear at each corner
  for (std::size_t i = 0; i < loop.size(); ++i) shape.push_back(shape_of_ear(loop, i));
  while (loop.size() > 3) {
    const auto ear = std::size_t(std::max_element(shape.begin(), shape.end()) - shape.begin());
    if (!(shape[ear] > 0.0)) return std::nullopt;
    const std::size_t n = loop.size();
    triangles.push_back({loop[(ear + n - 1) % n], loop[ear], loop[(ear + 1) % n]});
    loop.erase(loop.begin() + std::ptrdiff_t(ear));
    shape.erase(shape.begin() + std::ptrdiff_t(ear));
    // Only its neighbours change, for what was free of corners stays free; what was not may have become so.
    for (std::size_t i = 0; i < loop.size(); ++i)
      if (shape[i] == 0.0 || i == ear % loop.size() || (i + 1) % loop.size() == ear % loop.size()) shape[i] = shape_of_ear(loop, i);
  }
  if (turn(loop[0], loop[1], loop[2]) <= 0) return std::nullopt;
  triangles.push_back({loop[0], loop[1], loop[2]});
  return triangles;
}

}  // namespace lumo::detail

// ---- lumo/mesh/self_intersection.hpp

namespace lumo::detail {

/// Two triangles that meet elsewhere than in corners that they share, or come closer than `gap` without sharing any.
/// First what is certain in rounded numbers, then exact predicates; a sweep along the longest axis finds the candidates.
class SelfIntersection {
 public:
  SelfIntersection(const std::vector<Vec3>& vertices, const std::vector<SurfaceTriangle>& triangles, double gap)
      : vertices_(vertices), triangles_(triangles), gap_(gap) {}

  /// The first offending pair of triangle numbers, if any. Triangles of one facet are not compared: cutting it up made them disjoint.
  template <class Vec3 = Vec3>
  std::optional<std::pair<int, int>> find() const;

 private:
  using Corners = std::array<int, 3>;

  const Vec3& at(int vertex) const { return vertices_[static_cast<std::size_t>(vertex)]; }
  static bool has(const Corners& t, int vertex) { return t[0] == vertex || t[1] == vertex || t[2] == vertex; }
  template <class Vec3 = Vec3>
  Vec3 normal(const Corners& t) const { return (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])); }

  template <class Vec3 = Vec3>
  bool clash(const Corners& a, const Corners& b) const;
  template <class = void>
  bool surely_apart(const Corners& a, const Corners& b) const;
  bool surely_beside(const Corners& a, const Corners& b, const Projection& project) const;
  template <class Vec3 = Vec3>
  bool folded(const Corners& a, const Corners& b) const;
  template <class = void>
  bool meets(int p, int q, const Corners& t) const;
  template <class Vec3 = Vec3>
  bool close(const Corners& a, const Corners& b) const;

  const std::vector<Vec3>& vertices_;
  const std::vector<SurfaceTriangle>& triangles_;
  double gap_;
};

/// Squared distance between two line segments. Source: Ericson 2005, section 5.1.9.
template <class Vec3 = Vec3>
inline double segment_distance2(In<Vec3> p1, In<Vec3> q1, In<Vec3> p2, In<Vec3> q2) {
  const Vec3 d1 = q1 - p1;
  const Vec3 d2 = q2 - p2;
  const Vec3 r = p1 - p2;
  const double a = d1.squaredNorm();
  const double e = d2.squaredNorm();
  const double b = d1.dot(d2);
  const double c = d1.dot(r);
  const double f = d2.dot(r);
  const double det = a * e - b * b;
  double s = det > 0.0 ? std::clamp((b * f - c * e) / det, 0.0, 1.0) : 0.0;
  const double t = std::clamp((b * s + f) / e, 0.0, 1.0);
  s = std::clamp((b * t - c) / a, 0.0, 1.0);
  return (r + s * d1 - t * d2).squaredNorm();
}

/// All vertices of b strictly on one side of the plane of a, but those that are also a's; or the same with a and b exchanged.
template <class>
inline bool SelfIntersection::surely_apart(const Corners& a, const Corners& b) const {
  int side = 0;
  for (int vertex : b) {
    if (has(a, vertex)) continue;
    const int sign = sure_orient3d(at(a[0]), at(a[1]), at(a[2]), at(vertex));
    if (sign == 0 || sign == -side) return false;
    side = sign;
  }
  return true;
}

/// Seen along one axis, an edge of a has a on one side and b, but shared corners, strictly on the other. What is disjoint in a
/// projection is disjoint in space.
inline bool SelfIntersection::surely_beside(const Corners& a, const Corners& b, const Projection& project) const {
  for (std::size_t i = 0; i < 3; ++i) {
    const int p = a[i];
    const int q = a[(i + 1) % 3];
    const Point2 from = project(at(p));
    const Point2 to = project(at(q));
    const int side = sure_orient2d(from, to, project(at(a[(i + 2) % 3])));
    if (side == 0) continue;
    const auto beyond = [&](int vertex) { return vertex == p || vertex == q || sure_orient2d(from, to, project(at(vertex))) == -side; };
    if (std::all_of(b.begin(), b.end(), beyond)) return true;
  }
  return false;
}

/// Neighbours across an edge that lie on each other, or nearly (dihedral angle below 1e-6).
template <class Vec3>
inline bool SelfIntersection::folded(const Corners& a, const Corners& b) const {
  int apex_a = 0, apex_b = 0;
  std::array<int, 2> edge{};
  std::size_t shared = 0;
  for (int vertex : a) {
    if (has(b, vertex)) edge[shared++] = vertex;
    else apex_a = vertex;
  }
  for (int vertex : b)
    if (!has(a, vertex)) apex_b = vertex;
  const Vec3 along = at(edge[1]) - at(edge[0]);
  const Vec3 u = along.cross(at(apex_a) - at(edge[0]));
  const Vec3 v = along.cross(at(apex_b) - at(edge[0]));
  return u.dot(v) > 0.0 && u.cross(v).norm() < 1e-6 * u.norm() * v.norm();
}

/// Whether the closed segment p q meets the closed triangle t. Exact.
template <class>
inline bool SelfIntersection::meets(int p, int q, const Corners& t) const {
  const int side_p = orient3d(at(t[0]), at(t[1]), at(t[2]), at(p));
  const int side_q = orient3d(at(t[0]), at(t[1]), at(t[2]), at(q));
  if (side_p * side_q > 0) return false;
  if (side_p != 0 || side_q != 0) {
    int low = 0, high = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      const int sign = orient3d(at(p), at(q), at(t[i]), at(t[(i + 1) % 3]));
      low = std::min(low, sign);
      high = std::max(high, sign);
    }
    return low == 0 || high == 0;
  }
  const Projection project(normal(t));
  const std::array<Point2, 3> corners{project(at(t[0])), project(at(t[1])), project(at(t[2]))};
  const Point2 from = project(at(p));
  const Point2 to = project(at(q));
  bool inside = true;
  for (std::size_t i = 0; i < 3; ++i) {
    if (segments_meet(from, to, corners[i], corners[(i + 1) % 3])) return true;
    inside = inside && orient2d(corners[i], corners[(i + 1) % 3], from) > 0;
  }
  return inside;
}

template <class Vec3>
inline bool SelfIntersection::close(const Corners& a, const Corners& b) const {
  for (const auto& [t, other] : {std::pair{&a, &b}, std::pair{&b, &a}}) {
    const Vec3 n = normal(*t).normalized();
    int above = 0, below = 0;
    for (int vertex : *other) {
      const double height = n.dot(at(vertex) - at((*t)[0]));
      above += height > gap_;
      below += height < -gap_;
      if (std::abs(height) > gap_) continue;
      bool inside = true;  // of the prism over the triangle
      for (std::size_t i = 0; i < 3; ++i) {
        const Vec3& corner = at((*t)[i]);
        inside = inside && n.dot((at((*t)[(i + 1) % 3]) - corner).cross(at(vertex) - corner)) >= 0.0;
      }
      if (inside) return true;
    }
    if (above == 3 || below == 3) return false;
  }
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      if (segment_distance2(at(a[i]), at(a[(i + 1) % 3]), at(b[j]), at(b[(j + 1) % 3])) < gap_ * gap_) return true;
  return false;
}

template <class Vec3>
inline bool SelfIntersection::clash(const Corners& a, const Corners& b) const {
  const auto shared = std::count_if(a.begin(), a.end(), [&](int vertex) { return has(b, vertex); });
  if (shared == 3) return true;
  if (shared == 2) return folded(a, b);
  if (shared == 0 && close(a, b)) return true;
  if (surely_apart(a, b) || surely_apart(b, a)) return false;
  for (int axis = 0; axis < 3; ++axis) {
    const Projection project(Vec3::Unit(axis));
    if (surely_beside(a, b, project) || surely_beside(b, a, project)) return false;
  }
  // One shared corner: whatever else they share reaches an edge opposite to it.
  for (const auto& [t, other] : {std::pair{&a, &b}, std::pair{&b, &a}})
    for (std::size_t i = 0; i < 3; ++i) {
      const int p = (*t)[i];
      const int q = (*t)[(i + 1) % 3];
      if (has(*other, p) || has(*other, q)) continue;
      if (meets(p, q, *other)) return true;
    }
  return false;
}

template <class Vec3>
inline std::optional<std::pair<int, int>> SelfIntersection::find() const {
  struct Box {
    Vec3 low, high;
    int triangle;
  };
  std::vector<Box> boxes;
  Vec3 low = Vec3::Constant(HUGE_VAL), high = Vec3::Constant(-HUGE_VAL);
  for (std::size_t i = 0; i < triangles_.size(); ++i) {
    const Corners& t = triangles_[i].corners;
    boxes.push_back({at(t[0]).cwiseMin(at(t[1])).cwiseMin(at(t[2])).array() - 0.5 * gap_, at(t[0]).cwiseMax(at(t[1])).cwiseMax(at(t[2])).array() + 0.5 * gap_,
                     static_cast<int>(i)});
    low = low.cwiseMin(boxes.back().low);
    high = high.cwiseMax(boxes.back().high);
  }
  int axis = 0;
  (high - low).maxCoeff(&axis);
  std::sort(boxes.begin(), boxes.end(),
            [axis](const Box& a, const Box& b) { return a.low[axis] != b.low[axis] ? a.low[axis] < b.low[axis] : a.triangle < b.triangle; });
  for (std::size_t i = 0; i < boxes.size(); ++i)
    for (std::size_t j = i + 1; j < boxes.size() && boxes[j].low[axis] <= boxes[i].high[axis]; ++j) {
      if ((boxes[i].low.array() > boxes[j].high.array()).any() || (boxes[j].low.array() > boxes[i].high.array()).any()) continue;
      const SurfaceTriangle& a = triangles_[static_cast<std::size_t>(boxes[i].triangle)];
      const SurfaceTriangle& b = triangles_[static_cast<std::size_t>(boxes[j].triangle)];
      if (a.facet != b.facet && clash(a.corners, b.corners)) return std::pair{boxes[i].triangle, boxes[j].triangle};
    }
  return std::nullopt;
}

}  // namespace lumo::detail

// ---- lumo/mesh/shells.hpp

namespace lumo::detail {

/// A connected part of a surface. Faces outwards (volume > 0, a solid) or inwards (a cavity).
struct Shell {
  std::vector<int> triangles;
  double area = 0.0;
  double volume = 0.0;
};

/// Union–find with path halving.
class Groups {
 public:
  explicit Groups(std::size_t count) : parent_(count) { std::iota(parent_.begin(), parent_.end(), 0); }
  int find(int i) {
    while (at(i) != i) i = at(i) = at(at(i));
    return i;
  }
  void join(int i, int j) { at(find(i)) = find(j); }

 private:
  int& at(int i) { return parent_[static_cast<std::size_t>(i)]; }
  std::vector<int> parent_;
};

/// Every edge has two facets that run along it in opposite directions, and the facets around each vertex form one fan.
/// Throws MeshError (open, not_manifold).
inline void check_edges(const MeshInput& input) {
  using Reason = MeshError::Reason;
  struct Side {
    int low, high;
    bool up;           // runs from the lower vertex number to the higher
    int facet;
    int from, to;      // corners, numbered through all facets
  };
  std::vector<Side> sides;
  std::vector<int> vertex_of;
  for (std::size_t f = 0; f < input.facets.size(); ++f) {
    const std::vector<int>& loop = input.facets[f].loop;
    const int base = static_cast<int>(vertex_of.size());
    const int n = static_cast<int>(loop.size());
    for (int i = 0; i < n; ++i) {
      const int a = loop[static_cast<std::size_t>(i)];
      const int b = loop[static_cast<std::size_t>((i + 1) % n)];
      sides.push_back({std::min(a, b), std::max(a, b), a < b, static_cast<int>(f), base + i, base + (i + 1) % n});
      vertex_of.push_back(a);
    }
  }
  std::sort(sides.begin(), sides.end(), [](const Side& a, const Side& b) { return std::tie(a.low, a.high, a.from) < std::tie(b.low, b.high, b.from); });
  Groups fans(vertex_of.size());
  for (std::size_t i = 0; i < sides.size();) {
    std::size_t end = i + 1;
    while (end < sides.size() && sides[end].low == sides[i].low && sides[end].high == sides[i].high) ++end;
    const auto edge = text("the edge from vertex ", sides[i].low, " to ", sides[i].high, " of facet ", sides[i].facet);
    if (end - i == 1) throw MeshError(Reason::open, text("surface: ", edge, " has 1 facet, must have 2"));
    if (end - i > 2) throw MeshError(Reason::not_manifold, text("surface: ", edge, " has ", end - i, " facets, must have 2"));
    const Side& a = sides[i];
    const Side& b = sides[i + 1];
    if (a.up == b.up) throw MeshError(Reason::not_manifold, text("surface: ", edge, " has a facet of opposite orientation, ", b.facet));
    fans.join(a.from, b.to);
    fans.join(a.to, b.from);
    i = end;
  }
  std::vector<int> fan_of(input.vertices.size(), -1);
  for (std::size_t corner = 0; corner < vertex_of.size(); ++corner) {
    int& known = fan_of[static_cast<std::size_t>(vertex_of[corner])];
    const int fan = fans.find(static_cast<int>(corner));
    if (known >= 0 && known != fan)
      throw MeshError(Reason::not_manifold, text("surface: vertex ", vertex_of[corner], " joins more than 1 fan of facets, must be 1"));
    known = fan;
  }
}

/// The connected parts of a surface, with areas and enclosed volumes.
template <class Vec3 = Vec3>
inline std::vector<Shell> find_shells(const MeshInput& input, const std::vector<SurfaceTriangle>& triangles) {
  Groups groups(input.vertices.size());
  for (const SurfaceTriangle& t : triangles) {
    groups.join(t.corners[0], t.corners[1]);
    groups.join(t.corners[0], t.corners[2]);
  }
  std::vector<int> number(input.vertices.size(), -1);
  std::vector<Shell> shells;
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    int& shell = number[static_cast<std::size_t>(groups.find(triangles[i].corners[0]))];
    if (shell < 0) {
      shell = static_cast<int>(shells.size());
      shells.emplace_back();
    }
    shells[static_cast<std::size_t>(shell)].triangles.push_back(static_cast<int>(i));
  }
  const auto at = [&](int vertex) -> const Vec3& { return input.vertices[static_cast<std::size_t>(vertex)]; };
  for (Shell& shell : shells) {
    const Vec3 origin = at(triangles[static_cast<std::size_t>(shell.triangles[0])].corners[0]);
    for (int i : shell.triangles) {
      const auto& [a, b, c] = triangles[static_cast<std::size_t>(i)].corners;
      const Vec3 doubled = (at(b) - at(a)).cross(at(c) - at(a));
      shell.area += 0.5 * doubled.norm();
      shell.volume += doubled.dot(at(a) - origin) / 6.0;
    }
  }
  return shells;
}

/// Solid angle of the triangle abc seen from `point`, positive from behind. Source: van Oosterom and Strackee 1983.
template <class Vec3 = Vec3>
inline double solid_angle(In<Vec3> from_a, In<Vec3> from_b, In<Vec3> from_c, In<Vec3> point) {
  const Vec3 a = from_a - point, b = from_b - point, c = from_c - point;
  const double la = a.norm(), lb = b.norm(), lc = c.norm();
  return 2.0 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
}

/// How often a shell winds around a point: 1 inside, 0 outside.
template <class Vec3 = Vec3>
inline double winding(In<std::vector<Vec3>> vertices, const std::vector<SurfaceTriangle>& triangles, const Shell& shell, In<Vec3> point) {
  double angle = 0.0;
  for (int i : shell.triangles) {
    const auto& corners = triangles[static_cast<std::size_t>(i)].corners;
    angle += solid_angle(vertices[static_cast<std::size_t>(corners[0])], vertices[static_cast<std::size_t>(corners[1])],
                         vertices[static_cast<std::size_t>(corners[2])], point);
  }
  return angle / (4.0 * std::numbers::pi);
}

/// Solids lie outside each other, cavities in a solid, interior points in the material.
/// Throws MeshError (not_manifold for shells, bad_index for points).
template <class Vec3 = Vec3>
inline void check_inside(const MeshInput& input, const std::vector<SurfaceTriangle>& triangles, const std::vector<Shell>& shells) {
  const auto total = [&](const Vec3& point, const Shell* without) {
    double sum = 0.0;
    for (const Shell& shell : shells)
      if (&shell != without) sum += winding(input.vertices, triangles, shell, point);
    return sum;
  };
  for (std::size_t i = 0; shells.size() > 1 && i < shells.size(); ++i) {
    const SurfaceTriangle& first = triangles[static_cast<std::size_t>(shells[i].triangles[0])];
    const double around = total(input.vertices[static_cast<std::size_t>(first.corners[0])], &shells[i]);
    const double wanted = shells[i].volume > 0.0 ? 0.0 : 1.0;
    if (std::abs(around - wanted) > 0.25)
      throw MeshError(MeshError::Reason::not_manifold, text("surface: the shell of facet ", first.facet, " with volume ", shells[i].volume, " is wound by other shells ",
                                                            around, " times, must be ", wanted));
  }
  std::vector<char> used(input.vertices.size(), 0);
  for (const SurfaceTriangle& t : triangles)
    for (int vertex : t.corners) used[static_cast<std::size_t>(vertex)] = 1;
  for (std::size_t i = 0; i < used.size(); ++i)
    if (!used[i] && total(input.vertices[i], nullptr) < 0.75)
      throw MeshError(MeshError::Reason::bad_index, text("surface: vertex ", i, " belongs to no facet and is not inside the body"));
}

/// A point inside each cavity: half way from one of its triangles to what faces it.
template <class Vec3 = Vec3>
inline std::vector<Vec3> cavity_points(In<std::vector<Vec3>> vertices, const std::vector<SurfaceTriangle>& triangles, const std::vector<Shell>& shells) {
  std::vector<Vec3> points;
  const auto at = [&](int vertex) -> const Vec3& { return vertices[static_cast<std::size_t>(vertex)]; };
  for (const Shell& shell : shells) {
    if (shell.volume > 0.0) continue;
    const auto& [a, b, c] = triangles[static_cast<std::size_t>(shell.triangles[0])].corners;
    const Vec3 from = (at(a) + at(b) + at(c)) / 3.0;
    const Vec3 ray = (at(b) - at(a)).cross(at(c) - at(a)).normalized();  // out of the material
    double nearest = HUGE_VAL;
    for (std::size_t i = 0; i < triangles.size(); ++i) {
      if (static_cast<int>(i) == shell.triangles[0]) continue;
      const auto& [p, q, r] = triangles[i].corners;
      const Vec3 normal = (at(q) - at(p)).cross(at(r) - at(p));
      const double distance = normal.dot(at(p) - from) / normal.dot(ray);
      if (!(distance > 0.0 && distance < nearest)) continue;
      const Vec3 hit = from + distance * ray;
      const double slack = -1e-9 * normal.squaredNorm();
      const auto left = [&](int v, int w) { return normal.dot((at(w) - at(v)).cross(hit - at(v))) >= slack; };
      if (left(p, q) && left(q, r) && left(r, p)) nearest = distance;
    }
    points.push_back(from + 0.5 * nearest * ray);
  }
  return points;
}

}  // namespace lumo::detail

// ---- lumo/mesh/surface_check.hpp

namespace lumo {

/// What is known of a surface once it is found good.
struct SurfaceReport {
  Vec3 low = Vec3::Zero();                ///< bounding box
  Vec3 high = Vec3::Zero();
  double area = 0.0;
  double volume = 0.0;                    ///< enclosed, cavities not counted
  std::vector<Vec3> cavities;             ///< a point inside each cavity (a closed inner shell that faces inwards)
};

/// Checks that a surface bounds a solid: numbers finite and below 1e6, indices valid, facets flat (1e-8 of their size), simple and not
/// degenerate, no two vertices at one place (1e-8 of the body's size), every edge shared by two facets of one orientation, one fan of
/// facets around each vertex, positive volume, and no facets that cross, touch (1e-8 of the body's size) or lie on each other.
/// Vertices of no facet are interior points. Several separate solids and cavities are legal.
/// Throws MeshError with the reason of the first broken rule; an inside-out surface is not_manifold, no volume is degenerate.
/// Time about n log n for n triangles, quadratic in the corners of a facet.
template <class Vec3 = Vec3>
SurfaceReport validate_surface(const MeshInput& input);

namespace detail {

inline constexpr double largest_coordinate = 1e6;
inline constexpr double flatness = 1e-8;
inline constexpr double closeness = 1e-8;

[[noreturn]] inline void refuse(MeshError::Reason reason, const std::string& line) { throw MeshError(reason, "surface: " + line); }

inline std::string place(const Vec3& p) { return text("(", p.x(), ", ", p.y(), ", ", p.z(), ")"); }

template <class = void>
inline void check_numbers(const MeshInput& input) {
  using Reason = MeshError::Reason;
  if (input.vertices.empty() || input.facets.empty())
    refuse(Reason::degenerate, text("has ", input.vertices.size(), " vertices and ", input.facets.size(), " facets, must have some of both"));
  if (input.vertices.size() > 100'000'000 || input.facets.size() > 100'000'000)
    refuse(Reason::out_of_memory, text("has ", input.vertices.size(), " vertices and ", input.facets.size(), " facets, at most 1e8 of each"));
  for (std::size_t i = 0; i < input.vertices.size(); ++i)
    if (!(input.vertices[i].cwiseAbs().maxCoeff() <= largest_coordinate) || !input.vertices[i].allFinite())
      refuse(Reason::not_finite, text("vertex ", i, " is at ", place(input.vertices[i]), ", coordinates must be finite and at most ", largest_coordinate));
  const auto count = static_cast<int>(input.vertices.size());
  std::vector<int> seen(input.vertices.size(), -1);
  for (std::size_t f = 0; f < input.facets.size(); ++f) {
    const std::vector<int>& loop = input.facets[f].loop;
    for (int vertex : loop)
      if (vertex < 0 || vertex >= count) refuse(Reason::bad_index, text("facet ", f, " names vertex ", vertex, ", must lie in [0, ", count - 1, "]"));
    if (loop.size() < 3) refuse(Reason::degenerate, text("facet ", f, " has ", loop.size(), " corners, must have at least 3"));
    for (int vertex : loop)
      if (std::exchange(seen[static_cast<std::size_t>(vertex)], static_cast<int>(f)) == static_cast<int>(f))
        refuse(Reason::degenerate, text("facet ", f, " has vertex ", vertex, " more than once"));
  }
}

/// Vertices closer than `tolerance`, found by sorting along a direction in which hardly any two agree by accident.
template <class Vec3 = Vec3>
inline void check_duplicates(In<std::vector<Vec3>> vertices, double tolerance) {
  const Vec3 direction = Vec3(0.5477, 0.6083, 0.5744).normalized();
  std::vector<std::pair<double, int>> order;
  for (std::size_t i = 0; i < vertices.size(); ++i) order.emplace_back(direction.dot(vertices[i]), static_cast<int>(i));
  std::sort(order.begin(), order.end());
  for (std::size_t i = 0; i < order.size(); ++i)
    for (std::size_t j = i + 1; j < order.size() && order[j].first - order[i].first <= tolerance; ++j) {
      const Vec3& a = vertices[static_cast<std::size_t>(order[i].second)];
      const double distance = (vertices[static_cast<std::size_t>(order[j].second)] - a).norm();
      if (distance <= tolerance)
        refuse(MeshError::Reason::duplicate, text("vertices ", order[i].second, " and ", order[j].second, " at ", place(a), " are ", distance,
                                                  " apart, must be more than ", tolerance));
    }
}

/// Checks each facet alone and cuts it into triangles.
template <class Vec3 = Vec3>
inline std::vector<SurfaceTriangle> check_facets(const MeshInput& input, double gap) {
  using Reason = MeshError::Reason;
  std::vector<SurfaceTriangle> triangles;
  for (std::size_t f = 0; f < input.facets.size(); ++f) {
    const std::vector<int>& loop = input.facets[f].loop;
    const auto corner = [&](std::size_t i) -> const Vec3& { return input.vertices[static_cast<std::size_t>(loop[i % loop.size()])]; };
    double size = 0.0;
    for (std::size_t i = 0; i < loop.size(); ++i) size = std::max({size, (corner(i) - corner(0)).norm(), (corner(i + 1) - corner(i)).norm()});
    const Vec3 doubled = polygon_normal(input.vertices, loop);
    if (!(doubled.norm() > 2.0 * flatness * size * size))
      refuse(Reason::degenerate, text("facet ", f, " at ", place(corner(0)), " has area ", 0.5 * doubled.norm(), ", must be more than ", flatness * size * size));
    const Vec3 normal = doubled.normalized();
    for (std::size_t i = 1; i < loop.size(); ++i) {
      const double height = std::abs(normal.dot(corner(i) - corner(0)));
      if (loop.size() > 3 && height > flatness * size)
        refuse(Reason::degenerate, text("facet ", f, " at ", place(corner(i)), " is not flat: ", height, " off its plane, at most ", flatness * size));
    }
    const auto pieces = facet_triangles(input.vertices, loop, normal, static_cast<int>(f), 2.0 * gap);
    if (!pieces) refuse(Reason::self_intersecting, text("the outline of facet ", f, " at ", place(corner(0)), " crosses or touches itself"));
    triangles.insert(triangles.end(), pieces->begin(), pieces->end());
  }
  return triangles;
}

}  // namespace detail

template <class Vec3>
inline SurfaceReport validate_surface(const MeshInput& input) {
  using Reason = MeshError::Reason;
  detail::check_numbers(input);
  SurfaceReport report;
  report.low = report.high = input.vertices[0];
  for (const Vec3& vertex : input.vertices) {
    report.low = report.low.cwiseMin(vertex);
    report.high = report.high.cwiseMax(vertex);
  }
  const double size = (report.high - report.low).norm();
  if (!(size >= 1e-30)) detail::refuse(Reason::degenerate, detail::text("has a size of ", size, ", must be at least 1e-30"));
  detail::check_duplicates(input.vertices, detail::closeness * size);
  const std::vector<detail::SurfaceTriangle> triangles = detail::check_facets(input, detail::closeness * size);
  detail::check_edges(input);

  const std::vector<detail::Shell> shells = detail::find_shells(input, triangles);
  for (const detail::Shell& shell : shells) {
    report.area += shell.area;
    report.volume += shell.volume;
    if (!(std::abs(shell.volume) > 1e-9 * shell.area * size))
      detail::refuse(Reason::degenerate, detail::text("the shell of facet ", triangles[static_cast<std::size_t>(shell.triangles[0])].facet, " encloses a volume of ",
                                                      shell.volume, ", must be more than ", 1e-9 * shell.area * size));
  }
  if (!(report.volume > 0.0)) detail::refuse(Reason::not_manifold, detail::text("is inside out: the enclosed volume is ", report.volume, ", must be > 0"));
  if (const auto pair = detail::SelfIntersection(input.vertices, triangles, detail::closeness * size).find()) {
    const detail::SurfaceTriangle& a = triangles[static_cast<std::size_t>(pair->first)];
    const detail::SurfaceTriangle& b = triangles[static_cast<std::size_t>(pair->second)];
    detail::refuse(Reason::self_intersecting, detail::text("facets ", std::min(a.facet, b.facet), " and ", std::max(a.facet, b.facet), " cross or touch near ",
                                                           detail::place(input.vertices[static_cast<std::size_t>(a.corners[0])]), ", must be more than ",
                                                           detail::closeness * size, " apart"));
  }
  detail::check_inside(input, triangles, shells);
  report.cavities = detail::cavity_points(input.vertices, triangles, shells);
  return report;
}

}  // namespace lumo

// ---- lumo/mesh/triangle_surface.hpp

namespace lumo {

/// A surface of triangles, counter-clockwise seen from outside.
struct TriangleSurface {
  std::vector<Vec3> vertices;                  ///< [m]
  std::vector<std::array<int, 3>> triangles;
};

/// Throws MeshError unless the surface is closed, manifold, faces outwards and does not cross itself; see validate_surface.
template <class = void>
inline SurfaceReport validate_surface(const TriangleSurface& surface) {
  MeshInput input;
  input.vertices = surface.vertices;
  for (const auto& t : surface.triangles) input.facets.push_back({{t[0], t[1], t[2]}, 0});
  return validate_surface(input);
}

/// How often the surface winds around a point: 1 inside, 0 outside.
template <class Vec3 = Vec3>
inline double winding_number(const TriangleSurface& surface, In<Vec3> point) {
  double angle = 0.0;
  const auto at = [&](int vertex) -> const Vec3& { return surface.vertices[std::size_t(vertex)]; };
  for (const auto& t : surface.triangles) angle += detail::solid_angle(at(t[0]), at(t[1]), at(t[2]), point);
  return angle / (4.0 * std::numbers::pi);
}

}  // namespace lumo

// ---- lumo/mesh/surface_file.hpp

namespace lumo {

/// Reads a closed surface from a Wavefront .obj or a .stl file (text or binary), whose numbers are in units of `unit_m` [m]; by default mm, as
/// CAD writes them; the ending may be in capitals. Vertices at one place become one. Polygons of an .obj, concave ones too, are cut into triangles.
/// Throws InputError when the file is none, cannot be read or breaks its format (with the line), MeshError when its surface does not bound a solid.
template <class Vec3 = Vec3>
TriangleSurface read_surface(const std::filesystem::path& path, double unit_m = 1e-3);

namespace detail {

// Words of a text, line by line.
class SurfaceText {
 public:
  SurfaceText(std::string_view text, std::string name) : rest_(text), name_(std::move(name)) {}

  /// The words of the next line that has any, without a comment; none at the end.
  std::vector<std::string_view> next() {
    std::vector<std::string_view> words;
    while (words.empty() && !rest_.empty()) {
      const std::size_t end = std::min(rest_.find('\n'), rest_.size());
      std::string_view line = rest_.substr(0, end);
      rest_.remove_prefix(std::min(end + 1, rest_.size()));
      ++line_;
      line = line.substr(0, std::min(line.find('#'), line.size()));
      for (;;) {
        const std::size_t begin = line.find_first_not_of(" \t\r");
        if (begin == std::string_view::npos) break;
        line.remove_prefix(begin);
        const std::size_t stop = std::min(line.find_first_of(" \t\r"), line.size());
        words.push_back(line.substr(0, stop));
        line.remove_prefix(stop);
      }
    }
    return words;
  }

  [[noreturn]] void refuse(const std::string& what) const { throw InputError(text("surface file '", name_, "', line ", line_, ": ", what)); }

  template <class Number>
  Number number(std::string_view word) const {
    Number value{};
    if (!word.empty() && word.front() == '+') word.remove_prefix(1);
    const auto [end, fault] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (fault != std::errc{} || end != word.data() + word.size()) refuse(text("'", word, "' is no number"));
    return value;
  }
  Vec3 point(const std::vector<std::string_view>& words, std::size_t first) const {
    if (words.size() < first + 3) refuse("a point needs three coordinates");
    return {number<double>(words[first]), number<double>(words[first + 1]), number<double>(words[first + 2])};
  }

 private:
  std::string_view rest_;
  std::string name_;
  int line_ = 0;
};

// Adds the triangles of a plane polygon; of one that crosses itself a fan, which is refused with its surface.
template <class Vec3 = Vec3>
inline void add_polygon(TriangleSurface& surface, const std::vector<int>& loop) {
  std::vector<Vec3> corners;
  std::vector<int> order;
  for (const int vertex : loop) {
    order.push_back(int(order.size()));
    corners.push_back(surface.vertices[std::size_t(vertex)]);
  }
  auto triangles = PolygonTriangles(corners, polygon_normal(corners, order)).cut(order, {});
  if (!triangles) {
    triangles.emplace();
    for (std::size_t k = 1; k + 1 < order.size(); ++k) triangles->push_back({0, order[k], order[k + 1]});
  }
  for (const auto& t : *triangles) surface.triangles.push_back({loop[std::size_t(t[0])], loop[std::size_t(t[1])], loop[std::size_t(t[2])]});
}

template <class = void>
inline TriangleSurface read_obj(SurfaceText text) {
  TriangleSurface s;
  for (auto words = text.next(); !words.empty(); words = text.next()) {
    if (words[0] == "v") {
      if (words.size() != 4 && words.size() != 5 && words.size() != 7) text.refuse("a vertex has 3 coordinates, and perhaps a weight or a colour");
      s.vertices.push_back(text.point(words, 1));
    } else if (words[0] == "f") {
      if (words.size() < 4) text.refuse("a face needs at least 3 corners");
      std::vector<int> loop;
      for (std::size_t k = 1; k < words.size(); ++k) {
        const int n = text.number<int>(words[k].substr(0, words[k].find('/'))), count = int(s.vertices.size()), at = n < 0 ? count + n : n - 1;
        if (n == 0 || at < 0 || at >= count) text.refuse(detail::text("a face names vertex ", n, " of ", count));
        loop.push_back(at);
      }
      add_polygon(s, loop);
    } else if (words[0] != "vn" && words[0] != "vt" && words[0] != "o" && words[0] != "g" && words[0] != "s" && words[0] != "usemtl" && words[0] != "mtllib") {
      text.refuse(detail::text("'", words[0], "' is no statement of a polygon surface"));
    }
  }
  return s;
}

inline TriangleSurface read_stl_text(SurfaceText text) {
  TriangleSurface s;
  const auto expect = [&](const std::vector<std::string_view>& words, std::initializer_list<std::string_view> wanted) {
    std::size_t k = 0;
    for (std::string_view w : wanted)
      if (k >= words.size() || words[k++] != w) text.refuse(detail::text("'", w, "' was expected"));
  };
  expect(text.next(), {"solid"});
  for (;;) {
    const auto words = text.next();
    if (!words.empty() && words[0] == "endsolid") break;
    expect(words, {"facet", "normal"});
    expect(text.next(), {"outer", "loop"});
    const int first = int(s.vertices.size());
    for (int k = 0; k < 3; ++k) {
      const auto corner = text.next();
      expect(corner, {"vertex"});
      if (corner.size() != 4) text.refuse("a vertex has 3 coordinates");
      s.vertices.push_back(text.point(corner, 1));
    }
    s.triangles.push_back({first, first + 1, first + 2});
    expect(text.next(), {"endloop"});
    expect(text.next(), {"endfacet"});
  }
  if (!text.next().empty()) text.refuse("there is more after 'endsolid'; one solid a file");
  return s;
}

// 80 bytes of anything, the number of triangles, then 50 bytes each: normal, three corners (little-endian float32), 2 bytes of anything.
inline TriangleSurface read_stl_binary(std::string_view bytes) {
  TriangleSurface s;
  const auto word = [&](std::size_t at) {
    std::uint32_t value = 0;
    for (std::size_t k = 0; k < 4; ++k) value |= std::uint32_t(static_cast<unsigned char>(bytes[at + k])) << (8 * k);
    return value;
  };
  for (std::size_t at = 84; at + 50 <= bytes.size(); at += 50) {
    const int first = int(s.vertices.size());
    for (std::size_t k = 0; k < 3; ++k) {
      Vec3 p;
      for (int i = 0; i < 3; ++i) p[i] = double(std::bit_cast<float>(word(at + 12 + 12 * k + 4 * std::size_t(i))));
      s.vertices.push_back(p);
    }
    s.triangles.push_back({first, first + 1, first + 2});
  }
  return s;
}

// One vertex for each place, in order of first mention.
inline TriangleSurface welded(const TriangleSurface& loose) {
  TriangleSurface s;
  std::map<std::array<double, 3>, int> known;
  std::vector<int> number;
  for (const Vec3& v : loose.vertices) {
    const auto [it, fresh] = known.try_emplace({v.x() + 0.0, v.y() + 0.0, v.z() + 0.0}, int(s.vertices.size()));   // −0 is 0
    if (fresh) s.vertices.push_back(v);
    number.push_back(it->second);
  }
  for (const auto& t : loose.triangles) s.triangles.push_back({number[std::size_t(t[0])], number[std::size_t(t[1])], number[std::size_t(t[2])]});
  return s;
}

}  // namespace detail

template <class Vec3>
inline TriangleSurface read_surface(const std::filesystem::path& path, double unit_m) {
  require_in_range("unit of a surface file", unit_m, 1e-9, 1e3, "m");
  const std::string name = path.string();
  std::string kind = path.extension().string();
  for (char& c : kind) c = c >= 'A' && c <= 'Z' ? char(c - 'A' + 'a') : c;
  if (kind != ".obj" && kind != ".stl") throw InputError(detail::text("surface file '", name, "': its name must end in .obj or .stl"));
  std::error_code none;
  if (!std::filesystem::is_regular_file(path, none)) throw InputError(detail::text("cannot read surface file '", name, "': there is no such file"));   // a pipe would wait
  std::ifstream in(path, std::ios::binary);
  if (!in) throw InputError(detail::text("cannot read surface file '", name, "'"));
  constexpr std::uintmax_t most = 500'000'000;
  if (std::error_code fault; std::filesystem::file_size(path, fault) > most && !fault)
    throw InputError(detail::text("surface file '", name, "' is larger than ", most, " bytes"));
  const std::string bytes{std::istreambuf_iterator<char>(in), {}};
  if (in.bad()) throw InputError(detail::text("cannot read surface file '", name, "'"));

  TriangleSurface s;
  if (kind == ".obj") {
    s = detail::read_obj({bytes, name});
  } else {
    // A text, too, may begin with any 80 bytes; only the length tells.
    std::uint64_t count = 0;
    for (std::size_t k = 0; k < 4 && bytes.size() >= 84; ++k) count |= std::uint64_t(static_cast<unsigned char>(bytes[80 + k])) << (8 * k);
    if (bytes.size() >= 84 && bytes.size() == 84 + 50 * count) s = detail::read_stl_binary(bytes);
    else if (bytes.rfind("solid", 0) == 0) s = detail::read_stl_text({bytes, name});
    else throw InputError(detail::text("surface file '", name, "' has ", bytes.size(), " bytes, a binary .stl of ", count, " triangles has ", 84 + 50 * count));
  }
  for (Vec3& v : s.vertices) {
    if (!v.allFinite()) throw InputError(detail::text("surface file '", name, "': a coordinate is not finite"));   // before they are sorted
    v *= unit_m;
  }
  s = detail::welded(s);
  validate_surface(s);
  return s;
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

/// A rigid tool, given by its signed distance field in its own frame (origin at its centre); radius_m() is that of a ball about the origin
/// that holds it.
/// Laws: |gradient| = 1 almost everywhere; distance is 1-Lipschitz; derivatives match finite differences.
template <class T>
concept Indenter = requires(const T& tool, const Vec3& p) {
  { tool.distance(p) } -> std::convertible_to<double>;
  { tool.sample(p) } -> std::convertible_to<DistanceSample>;
  { tool.radius_m() } -> std::convertible_to<double>;
  validate(tool);
};

/// How strongly a tool is curved where it is meant to touch [m]: its own contact_radius_m(), or the whole tool's radius. Only a scale for first guesses.
template <Indenter Tool>
double contact_radius(const Tool& tool) {
  if constexpr (requires { tool.contact_radius_m(); }) return tool.contact_radius_m();
  else return tool.radius_m();
}

/// Is the tool its own mirror image in the plane across `axis` (0: x, 1: y, 2: z) of its frame? One that does not say so by symmetric(axis) is taken not to be.
template <Indenter Tool>
bool is_symmetric(const Tool& tool, int axis) {
  if constexpr (requires { { tool.symmetric(axis) } -> std::convertible_to<bool>; }) return tool.symmetric(axis);
  else return false;
}

/// Rigid sphere.
struct Sphere {
  double diameter_m = 10e-3;

  bool operator==(const Sphere&) const = default;

  double radius_m() const { return 0.5 * diameter_m; }
  bool symmetric(int) const { return true; }
  template <class Vec3 = Vec3>
  double distance(In<Vec3> p) const { return p.norm() - radius_m(); }
  template <class Vec3 = Vec3, class Mat3 = Mat3>
  DistanceSample sample(In<Vec3> p) const {
    const double r = p.norm();
    const Vec3 n = r > 0.0 ? Vec3(p / r) : Vec3(Vec3::UnitZ());
    return {r - radius_m(), n, (Mat3::Identity() - n * n.transpose()) / (r > 0.0 ? r : radius_m())};
  }
};

inline constexpr Limits sphere_diameters_mm{0.1, 1000.0};

inline void validate(const Sphere& s) { require_in_range("sphere diameter", s.diameter_m * 1e3, sphere_diameters_mm, "mm"); }

static_assert(Indenter<Sphere>);

}  // namespace lumo

// ---- lumo/mechanics/scenario.hpp

namespace lumo {

/// Plane in which an approach is tilted from the pad normal: across the finger, as the paper's are read, or along it.
enum class TiltPlane { xz, yz };

/// One contact: an indenter, the line on which it comes, and the loads at which it is observed.
/// It moves along direction() on the line through Body::pivot shifted by `y_m`; it does not move sideways.
template <Indenter Tool = Sphere>
struct Scenario {
  Tool indenter;
  double angle_rad = 0.0;                                    ///< approach angle from the pad normal
  double y_m = 0.0;                                          ///< place along the finger [m]
  std::vector<double> loads_N = {1.0, 2.0, 5.0, 10.0, 15.0};  ///< increasing
  TiltPlane tilt = TiltPlane::xz;                            ///< in which the angle lies

  bool operator==(const Scenario&) const = default;

  /// Unit vector of the advance (paper §III-B; model reading: −(sin α, 0, cos α)).
  Vec3 direction() const {
    const double sideways = -std::sin(angle_rad);
    return {tilt == TiltPlane::xz ? sideways : 0.0, tilt == TiltPlane::yz ? sideways : 0.0, -std::cos(angle_rad)};
  }
};

/// Planes in which a contact is its own mirror image.
template <Indenter Tool>
Symmetry symmetry_of(const Scenario<Tool>& s) {
  const bool straight = s.angle_rad == 0.0;
  return {(straight || s.tilt == TiltPlane::yz) && is_symmetric(s.indenter, 0), s.y_m == 0.0 && (straight || s.tilt == TiltPlane::xz) && is_symmetric(s.indenter, 1)};
}

/// Mirror image of a contact with a symmetric tool in these planes.
template <Indenter Tool>
Scenario<Tool> mirrored(Scenario<Tool> s, Symmetry planes) {
  if (planes.y) s.y_m = 0.0 - s.y_m;
  if (s.tilt == TiltPlane::xz ? planes.x : planes.y) s.angle_rad = 0.0 - s.angle_rad;
  return s;
}

/// What validate() admits, in the units in which people give it.
inline constexpr Limits approach_angles_deg{-80.0, 80.0}, contact_places_mm{-1e4, 1e4}, loads_admitted_N{1e-3, 1e4};

/// Throws InvalidArgument when an angle, place or load makes no sense.
template <Indenter Tool>
void validate(const Scenario<Tool>& s) {
  validate(s.indenter);
  require_in_range("approach angle", s.angle_rad * 180.0 / pi, approach_angles_deg, "deg");
  require_in_range("contact place y", s.y_m * 1e3, contact_places_mm, "mm");
  if (s.loads_N.empty()) throw InvalidArgument("loads: none given, at least one is needed");
  double last = 0.0;
  for (double load : s.loads_N) {
    require_in_range("load", load, loads_admitted_N, "N");
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

/// First touch with the body's contactable patches, on their exact shapes (never on facets), to 10 nm for convex tools with edges and far
/// better for round ones. The mesh only says where a patch ends.
/// Throws InvalidArgument when the indenter passes by.
template <Indenter Tool>
Touch first_touch(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario);

namespace detail {

// How far the tool can advance from `start` until it reaches p: sphere tracing, because distance is 1-Lipschitz. +∞: it passes by.
template <Indenter Tool>
double advance_to(const Tool& tool, const Vec3& start, const Vec3& direction, const Vec3& p, double limit) {
  double s = 0.0, before = 0.0;
  for (int i = 0; i < 500; ++i) {
    const double gap = tool.distance(p - start - s * direction);
    if (gap < -1e-12) {   // a distance that is not quite one was too long: back to its zero
      for (int k = 0; k < 60; ++k) {
        const double middle = 0.5 * (before + s);
        (tool.distance(p - start - middle * direction) > 0.0 ? before : s) = middle;
      }
      return s;
    }
    if (gap < 1e-15) return s;
    before = s;
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
      const auto search = [&](double first_step, double spin, double gain) {
        double spun = 0.0;
        for (double step = first_step; step > 1e-9; step *= 0.5)
          for (bool moved = true; moved; spun += spin) {
            moved = false;
            const Vec3 n = outward_normal(body.patches[patch].shape, seed);
            const Vec3 u = n.unitOrthogonal(), v = n.cross(u);
            for (int k = 0; k < 8; ++k) {
              const double turn = 0.25 * pi * k + spun;
              Vec3 trial = (seed + step * (std::cos(turn) * u + std::sin(turn) * v)).cwiseMax(low).cwiseMin(high);
              trial = closest_point(body.patches[patch].shape, trial);
              if (!inside(trial)) continue;
              const double s = detail::advance_to(scenario.indenter, start, direction, fold(trial), 2.0 * reach);
              if (s < nearest - gain) nearest = s, seed = trial, moved = true;
            }
          }
      };
      // Pattern search on the exact shape: the advance is quadratic about its minimum, so 1 nm of place is far below any depth that matters.
      search(0.1 * (high - low).norm(), 0.0, 1e-16);
      // Edges of a tool put kinks into the advance, at which fixed directions can get stuck; directions that never repeat do not (Audet, Dennis 2006).
      search(0.1 * (high - low).norm(), 0.25 * pi * 0.61803398875, 1e-12);
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

// ---- lumo/core/lanes.hpp

namespace lumo {

/// Eight numbers that go through the same arithmetic at once: one AVX-512 register, or as many smaller ones as the processor needs.
struct Lanes {
  static constexpr std::size_t width = 8;
  typedef double Register __attribute__((vector_size(64)));
  Register v = {};

  double operator[](std::size_t lane) const { return v[lane]; }
  void set(std::size_t lane, double value) { v[lane] = value; }
  /// values[index[lane]] in each lane.
  static Lanes gathered(const double* values, const std::array<int, width>& index) {
    const auto at = [&](std::size_t lane) { return values[index[lane]]; };
    return {Register{at(0), at(1), at(2), at(3), at(4), at(5), at(6), at(7)}};
  }
  static Lanes of(double value) { return {Register{value, value, value, value, value, value, value, value}}; }

  Lanes& operator+=(const Lanes& b) {
    v += b.v;
    return *this;
  }
  Lanes& operator-=(const Lanes& b) {
    v -= b.v;
    return *this;
  }
};

inline Lanes operator+(const Lanes& a, const Lanes& b) { return {a.v + b.v}; }
inline Lanes operator-(const Lanes& a, const Lanes& b) { return {a.v - b.v}; }
inline Lanes operator*(const Lanes& a, const Lanes& b) { return {a.v * b.v}; }
inline Lanes operator/(const Lanes& a, const Lanes& b) { return {a.v / b.v}; }
inline Lanes operator-(const Lanes& a) { return {-a.v}; }
inline Lanes operator+(double a, const Lanes& b) { return Lanes::of(a) + b; }
inline Lanes operator-(double a, const Lanes& b) { return Lanes::of(a) - b; }
inline Lanes operator*(double a, const Lanes& b) { return Lanes::of(a) * b; }
inline Lanes operator+(const Lanes& a, double b) { return a + Lanes::of(b); }
inline Lanes operator-(const Lanes& a, double b) { return a - Lanes::of(b); }

inline Lanes log(const Lanes& a) {
  Lanes l;
  for (std::size_t lane = 0; lane < Lanes::width; ++lane) l.set(lane, std::log(a[lane]));
  return l;
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

/// h'(J) and h''(J) [Pa] of a solid W = μ/2 (I_C − 3) + h(J), as numbers or arrays of them.
template <class T>
struct DilatationSample {
  T stress;
  T stiffness;
};

/// A solid of the form W = μ/2 (I_C − 3) + h(J), whose P = μ F + h'(J) cof F is cheap enough to be taken for many elements at once.
template <class M>
concept DilatationalMaterial = HyperelasticMaterial<M> && requires(const M& m, const Lanes& J) {
  { m.dilatation(J) } -> std::same_as<DilatationSample<Lanes>>;
};

/// Derivative of det F by F: the cofactor matrix.
template <class Mat3 = Mat3>
inline Mat3 cofactor(In<Mat3> F) {
  Mat3 c;
  c.col(0) = F.col(1).cross(F.col(2));
  c.col(1) = F.col(2).cross(F.col(0));
  c.col(2) = F.col(0).cross(F.col(1));
  return c;
}

/// Second derivative of det F by F, flattened by columns.
template <class Vec3 = Vec3, class Mat3 = Mat3, class Mat9 = Mat9>
inline Mat9 determinant_hessian(In<Mat3> F) {
  const auto cross = [](const Vec3& v) {
    Mat3 m;
    m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
    return m;
  };
  Mat9 h = Mat9::Zero();
  h.template block<3, 3>(0, 3) = -cross(F.col(2));
  h.template block<3, 3>(0, 6) = cross(F.col(1));
  h.template block<3, 3>(3, 0) = cross(F.col(2));
  h.template block<3, 3>(3, 6) = -cross(F.col(0));
  h.template block<3, 3>(6, 0) = -cross(F.col(1));
  h.template block<3, 3>(6, 3) = cross(F.col(0));
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

  template <class Mat3 = Mat3>
  double distortion_energy(In<Mat3> F) const {
    const double J = F.determinant();
    if (!(J > 0.0)) return std::numeric_limits<double>::infinity();
    return 0.5 * mu * (F.squaredNorm() - 3.0) - mu * std::log(J);
  }
  template <class Mat3 = Mat3>
  Mat3 distortion_stress(In<Mat3> F) const { return mu * F - (mu / F.determinant()) * cofactor(F); }
  template <class Mat3 = Mat3, class Mat9 = Mat9>
  Mat9 distortion_tangent(In<Mat3> F) const {
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
  template <class T>
  DilatationSample<T> dilatation(const T& J) const {
    using std::log;
    const T l = log(J);
    return {(lambda * l - mu) / J, (lambda * (1.0 - l) + mu) / (J * J)};
  }
};

inline void validate(const NeoHookean& m) {
  require_positive("shear modulus mu", m.mu, "Pa");
  require_in_range("Lame parameter lambda", m.lambda, 0.0, 1e15, "Pa");
}

static_assert(HyperelasticMaterial<NeoHookean> && DilatationalMaterial<NeoHookean>);

}  // namespace lumo

// ---- lumo/mechanics/stable_neo_hookean.hpp

namespace lumo {

/// Neo-Hookean solid without a logarithm, W = μ/2 (I_C − 3) + λ'/2 (J − α)² less its value at rest, with λ' = λ + μ and α = 1 + μ/λ'.
/// Rest is free of stress, and μ and λ are the Lamé parameters of small strain. Finite where J ≤ 0: an element that is turned inside out
/// is pushed back. Source: Smith, de Goes, Kim 2018, without their logarithmic term, as Newton 1.8 has it.
struct StableNeoHookean {
  double mu = 106.0e3;       ///< shear modulus [Pa]
  double lambda = 10.494e6;  ///< Lamé's first parameter [Pa]

  double shear_modulus() const { return mu; }

  // λ'/2 (J − α)² − μ²/(2 λ') = λ'/2 (J − 1)² − μ (J − 1): only the first term is stiff.
  template <class Mat3 = Mat3>
  double distortion_energy(In<Mat3> F) const { return 0.5 * mu * (F.squaredNorm() - 3.0) - mu * (F.determinant() - 1.0); }
  template <class Mat3 = Mat3>
  Mat3 distortion_stress(In<Mat3> F) const { return mu * (F - cofactor(F)); }
  template <class Mat3 = Mat3, class Mat9 = Mat9>
  Mat9 distortion_tangent(In<Mat3> F) const { return mu * (Mat9::Identity() - determinant_hessian(F)); }
  VolumetricSample volumetric(double J) const {
    const double k = lambda + mu;
    return {0.5 * k * (J - 1.0) * (J - 1.0), k * (J - 1.0), k};
  }
  template <class T>
  DilatationSample<T> dilatation(const T& J) const {
    const double k = lambda + mu;
    return {k * (J - 1.0) - mu, k + 0.0 * J};
  }
};

inline void validate(const StableNeoHookean& m) {
  require_positive("shear modulus mu", m.mu, "Pa");
  require_in_range("Lame parameter lambda", m.lambda, 0.0, 1e15, "Pa");
}

static_assert(HyperelasticMaterial<StableNeoHookean> && DilatationalMaterial<StableNeoHookean>);

}  // namespace lumo

// ---- lumo/mechanics/isochoric.hpp

// What nearly incompressible rubber laws share: invariants of the deformation without its volume change, and one volumetric energy.
namespace lumo {

/// A function of the deformation gradient with its first and second derivative, the latter flattened by columns.
struct InvariantSample {
  double value;
  Mat3 gradient;
  Mat9 hessian;
};

/// Ī₁ = J^(−2/3) tr C; det F must be positive.
template <class Mat3 = Mat3, class Mat9 = Mat9>
InvariantSample first_isochoric_invariant(In<Mat3> F);

/// Ī₂ = J^(−4/3) tr cof C; det F must be positive.
template <class Mat3 = Mat3, class Mat9 = Mat9>
InvariantSample second_isochoric_invariant(In<Mat3> F);

/// U(J) = κ/4 (J² − 1 − 2 ln J): convex, and without limit at both ends. Source: Simo and Taylor 1991.
inline VolumetricSample convex_volumetric(double bulk, double J) {
  if (!(J > 0.0)) return {std::numeric_limits<double>::infinity(), 0.0, 0.0};
  return {0.25 * bulk * (J * J - 1.0 - 2.0 * std::log(J)), 0.5 * bulk * (J - 1.0 / J), 0.5 * bulk * (1.0 + 1.0 / (J * J))};
}

namespace detail {

// I J^(−m), from I with its derivatives.
template <class Mat3 = Mat3, class Mat9 = Mat9>
inline InvariantSample without_volume(In<Mat3> F, const InvariantSample& full, double m) {
  const double J = F.determinant(), scale = std::pow(J, -m);
  const Mat3 c = cofactor(F);
  const Eigen::Map<const Eigen::Matrix<double, 9, 1>> flat(c.data()), slope(full.gradient.data());
  const Mat9 mixed = slope * flat.transpose();
  return {scale * full.value, scale * (full.gradient - (m * full.value / J) * c),
          scale * (full.hessian - (m / J) * (mixed + mixed.transpose()) + (m * (m + 1.0) * full.value / (J * J)) * flat * flat.transpose() -
                   (m * full.value / J) * determinant_hessian(F))};
}

}  // namespace detail

template <class Mat3, class Mat9>
inline InvariantSample first_isochoric_invariant(In<Mat3> F) {
  return detail::without_volume(F, {F.squaredNorm(), 2.0 * F, 2.0 * Mat9::Identity()}, 2.0 / 3.0);
}

template <class Mat3, class Mat9>
inline InvariantSample second_isochoric_invariant(In<Mat3> F) {
  const Mat3 C = F.transpose() * F, B = F * F.transpose();
  const double I1 = C.trace();
  Mat9 h;  // 2 (I₁ dF + 2 (F : dF) F − dF C − F dFᵀ F − B dF)
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k < 3; ++k)
        for (int l = 0; l < 3; ++l) {
          const double same_row = i == k ? 1.0 : 0.0, same_column = j == l ? 1.0 : 0.0;
          h(i + 3 * j, k + 3 * l) =
              2.0 * (I1 * same_row * same_column + 2.0 * F(i, j) * F(k, l) - same_row * C(l, j) - F(i, l) * F(k, j) - same_column * B(i, k));
        }
  return detail::without_volume(F, {0.5 * (I1 * I1 - C.squaredNorm()), 2.0 * (I1 * F - F * C), h}, 4.0 / 3.0);
}

}  // namespace lumo

// ---- lumo/mechanics/mooney_rivlin.hpp

namespace lumo {

/// Mooney–Rivlin solid, W = c₁₀ (Ī₁ − 3) + c₀₁ (Ī₂ − 3) + κ/4 (J² − 1 − 2 ln J). Shear modulus 2 (c₁₀ + c₀₁); +∞ where J ≤ 0.
/// Source: Mooney 1940, Rivlin 1948. The default is Dragon Skin of the paper at small strain, a fifth of it in the second term.
struct MooneyRivlin {
  double c10 = 42.4e3;       ///< [Pa]
  double c01 = 10.6e3;       ///< [Pa]
  double bulk = 10.5647e6;   ///< bulk modulus κ [Pa]

  double shear_modulus() const { return 2.0 * (c10 + c01); }

  template <class Mat3 = Mat3>
  double distortion_energy(In<Mat3> F) const {
    if (!(F.determinant() > 0.0)) return std::numeric_limits<double>::infinity();
    return c10 * (first_isochoric_invariant(F).value - 3.0) + c01 * (second_isochoric_invariant(F).value - 3.0);
  }
  template <class Mat3 = Mat3>
  Mat3 distortion_stress(In<Mat3> F) const { return c10 * first_isochoric_invariant(F).gradient + c01 * second_isochoric_invariant(F).gradient; }
  template <class Mat3 = Mat3, class Mat9 = Mat9>
  Mat9 distortion_tangent(In<Mat3> F) const { return c10 * first_isochoric_invariant(F).hessian + c01 * second_isochoric_invariant(F).hessian; }
  VolumetricSample volumetric(double J) const { return convex_volumetric(bulk, J); }
};

inline void validate(const MooneyRivlin& m) {
  require_in_range("Mooney-Rivlin c10", m.c10, 0.0, 1e12, "Pa");
  require_in_range("Mooney-Rivlin c01", m.c01, 0.0, 1e12, "Pa");
  require_positive("shear modulus 2 (c10 + c01)", m.shear_modulus(), "Pa");
  require_in_range("bulk modulus", m.bulk, 1e-3, 1e15, "Pa");
}

static_assert(HyperelasticMaterial<MooneyRivlin>);

}  // namespace lumo

// ---- lumo/mechanics/yeoh.hpp

namespace lumo {

/// Yeoh solid, W = Σ cₖ (Ī₁ − 3)ᵏ, k = 1, 2, 3, + κ/4 (J² − 1 − 2 ln J). Shear modulus 2 c₁; +∞ where J ≤ 0. Source: Yeoh 1993.
/// The energy's slope by Ī₁ must be positive however far the body is stretched; c₂ may be negative, as fits to rubber that softens and then
/// stiffens have it. The default is Dragon Skin of the paper at small strain.
struct Yeoh {
  double c1 = 53.0e3;        ///< [Pa]
  double c2 = 0.0;           ///< [Pa]
  double c3 = 0.0;           ///< [Pa]
  double bulk = 10.5647e6;   ///< bulk modulus κ [Pa]

  double shear_modulus() const { return 2.0 * c1; }

  template <class Mat3 = Mat3>
  double distortion_energy(In<Mat3> F) const {
    if (!(F.determinant() > 0.0)) return std::numeric_limits<double>::infinity();
    const double s = first_isochoric_invariant(F).value - 3.0;
    return s * (c1 + s * (c2 + s * c3));
  }
  template <class Mat3 = Mat3>
  Mat3 distortion_stress(In<Mat3> F) const {
    const InvariantSample I = first_isochoric_invariant(F);
    return slope(I.value - 3.0) * I.gradient;
  }
  template <class Mat3 = Mat3, class Mat9 = Mat9>
  Mat9 distortion_tangent(In<Mat3> F) const {
    const InvariantSample I = first_isochoric_invariant(F);
    const double s = I.value - 3.0;
    const Eigen::Map<const Eigen::Matrix<double, 9, 1>> g(I.gradient.data());
    return slope(s) * I.hessian + (2.0 * c2 + 6.0 * c3 * s) * g * g.transpose();
  }
  VolumetricSample volumetric(double J) const { return convex_volumetric(bulk, J); }

 private:
  double slope(double s) const { return c1 + s * (2.0 * c2 + s * 3.0 * c3); }
};

inline void validate(const Yeoh& m) {
  require_positive("Yeoh c1", m.c1, "Pa");
  require_in_range("Yeoh c3", m.c3, 0.0, 1e12, "Pa");
  // c₁ + 2 c₂ s + 3 c₃ s² > 0 for all s ≥ 0; where the parabola only touches 0 there is no stiffness left.
  const double least = -std::sqrt(3.0 * m.c1 * m.c3);
  if (!(std::isfinite(m.c2) && m.c2 <= 1e12 && (m.c2 >= 0.0 || m.c2 > least)))
    throw InvalidArgument(detail::text("Yeoh c2 is ", m.c2, " Pa, must lie above -sqrt(3 c1 c3) = ", least, " Pa, or not below 0, and not above 1e12 Pa"));
  require_in_range("bulk modulus", m.bulk, 1e-3, 1e15, "Pa");
}

static_assert(HyperelasticMaterial<Yeoh>);

}  // namespace lumo

// ---- lumo/mechanics/ogden.hpp

namespace lumo {

/// Ogden solid, W = Σ μ_p/α_p (λ̄₁^α_p + λ̄₂^α_p + λ̄₃^α_p − 3) + κ/4 (J² − 1 − 2 ln J), λ̄ᵢ = J^(−1/3) λᵢ the principal stretches without the
/// volume change. Shear modulus ½ Σ μ_p α_p; +∞ where J ≤ 0. Source: Ogden 1972. A term with μ_p = 0 is none. The default is Dragon Skin
/// of the paper at small strain.
struct Ogden {
  struct Term {
    double mu = 0.0;       ///< [Pa], of the sign of alpha
    double alpha = 2.0;    ///< exponent
  };
  std::array<Term, 3> terms = {{{106.0e3, 2.0}, {}, {}}};
  double bulk = 10.5647e6;   ///< bulk modulus κ [Pa]

  double shear_modulus() const {
    double sum = 0.0;
    for (const Term& t : terms) sum += 0.5 * t.mu * t.alpha;
    return sum;
  }

  template <class Vec3 = Vec3, class Mat3 = Mat3>
  double distortion_energy(In<Mat3> F) const;
  template <class Mat3 = Mat3>
  Mat3 distortion_stress(In<Mat3> F) const;
  template <class Mat3 = Mat3, class Mat9 = Mat9>
  Mat9 distortion_tangent(In<Mat3> F) const;
  VolumetricSample volumetric(double J) const { return convex_volumetric(bulk, J); }

 private:
  // Principal stretches l, with F = U diag(l) Vᵀ, and gᵢ = lᵢ ∂W/∂lᵢ.
  struct Principal {
    Mat3 U, V;
    Vec3 l, g;
  };
  template <class Vec3 = Vec3, class Mat3 = Mat3>
  Principal principal(In<Mat3> F) const;
  // ∂gᵢ/∂ln lⱼ
  template <class Vec3 = Vec3, class Mat3 = Mat3>
  Mat3 log_slopes(In<Vec3> l) const;
  // (gᵢ − gⱼ)/(lᵢ − lⱼ), without cancellation where they meet.
  template <class Vec3 = Vec3>
  double divided_difference(In<Vec3> l, int i, int j) const;
};

inline void validate(const Ogden& m) {
  for (const Ogden::Term& t : m.terms) {
    require_in_range("Ogden exponent alpha", t.alpha, -20.0, 20.0, "");
    if (t.mu != 0.0) require_positive("Ogden product mu alpha", t.mu * t.alpha, "Pa");
  }
  require_positive("shear modulus", m.shear_modulus(), "Pa");
  require_in_range("bulk modulus", m.bulk, 1e-3, 1e15, "Pa");
}

template <class Vec3, class Mat3>
inline Ogden::Principal Ogden::principal(In<Mat3> F) const {
  const Eigen::JacobiSVD<Mat3> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Principal p{svd.matrixU(), svd.matrixV(), svd.singularValues(), Vec3::Zero()};
  const double J = p.l.prod();
  for (const Term& t : terms) {
    const Vec3 power = t.mu * std::pow(J, -t.alpha / 3.0) * p.l.array().pow(t.alpha).matrix();
    p.g += power - Vec3::Constant(power.sum() / 3.0);
  }
  return p;
}

template <class Vec3, class Mat3>
inline double Ogden::distortion_energy(In<Mat3> F) const {
  const double J = F.determinant();
  if (!(J > 0.0)) return std::numeric_limits<double>::infinity();
  const Vec3 l = principal(F).l / std::cbrt(J);
  double sum = 0.0;
  for (const Term& t : terms)
    if (t.mu != 0.0) sum += t.mu / t.alpha * (l.array().pow(t.alpha).sum() - 3.0);
  return sum;
}

template <class Mat3>
inline Mat3 Ogden::distortion_stress(In<Mat3> F) const {
  const Principal p = principal(F);
  return p.U * p.g.cwiseQuotient(p.l).asDiagonal() * p.V.transpose();
}

template <class Vec3, class Mat3>
inline Mat3 Ogden::log_slopes(In<Vec3> l) const {
  Mat3 d = Mat3::Zero();
  for (const Term& t : terms) {
    const Vec3 power = t.mu * t.alpha * std::pow(l.prod(), -t.alpha / 3.0) * l.array().pow(t.alpha).matrix();
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) d(i, j) += (i == j ? power[i] : 0.0) - (power[i] + power[j]) / 3.0 + power.sum() / 9.0;
  }
  return d;
}

template <class Vec3>
inline double Ogden::divided_difference(In<Vec3> l, int i, int j) const {
  const double apart = l[i] - l[j];
  double sum = 0.0;
  for (const Term& t : terms) {
    const double scale = t.mu * std::pow(l.prod(), -t.alpha / 3.0) * std::pow(l[j], t.alpha);
    sum += scale * (apart == 0.0 ? t.alpha / l[j] : std::expm1(t.alpha * std::log1p(apart / l[j])) / apart);
  }
  return sum;
}

// In the principal frame stretching couples the diagonal, and each pair of off-diagonal components is a stretch and a turn.
template <class Mat3, class Mat9>
inline Mat9 Ogden::distortion_tangent(In<Mat3> F) const {
  const Principal p = principal(F);
  const Mat3 slopes = log_slopes(p.l);
  Mat9 local = Mat9::Zero();
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      local(4 * i, 4 * j) = (slopes(i, j) - (i == j ? p.g[i] : 0.0)) / (p.l[i] * p.l[j]);
      if (i == j) continue;
      const double stretch = divided_difference(p.l, i, j) / p.l[i] - p.g[j] / (p.l[i] * p.l[j]);
      const double turn = (p.g[i] / p.l[i] + p.g[j] / p.l[j]) / (p.l[i] + p.l[j]);
      local(i + 3 * j, i + 3 * j) = 0.5 * (stretch + turn);
      local(i + 3 * j, j + 3 * i) = 0.5 * (stretch - turn);
    }
  Mat9 frame;  // vec(U X Vᵀ) = frame · vec(X)
  for (int j = 0; j < 3; ++j)
    for (int l = 0; l < 3; ++l) frame.template block<3, 3>(3 * j, 3 * l) = p.V(j, l) * p.U;
  return frame * local * frame.transpose();
}

static_assert(HyperelasticMaterial<Ogden>);

}  // namespace lumo

// ---- lumo/mechanics/box.hpp

namespace lumo {

namespace detail {

/// Signed distance from p to the box |x| ≤ half about the origin.
template <class Vec3 = Vec3, class Mat3 = Mat3>
inline DistanceSample distance_to_box(In<Vec3> half, In<Vec3> p) {
  const Vec3 sign = p.unaryExpr([](double v) { return v < 0.0 ? -1.0 : 1.0; });
  const Vec3 q = p.cwiseAbs() - half;
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

}  // namespace detail

/// Rigid box with edges along the finger's axes, rounded where `edge_radius_m` > 0. Sharp edges concentrate stress without limit: round them.
struct Box {
  Vec3 size_m = Vec3::Constant(10e-3);
  double edge_radius_m = 0.5e-3;

  bool operator==(const Box&) const = default;

  template <class = void>
  double radius_m() const { return 0.5 * size_m.norm(); }
  template <class = void>
  double contact_radius_m() const { return 0.5 * size_m.minCoeff(); }
  bool symmetric(int) const { return true; }
  template <class Vec3 = Vec3>
  double distance(In<Vec3> p) const { return sample(p).distance; }
  template <class Vec3 = Vec3>
  DistanceSample sample(In<Vec3> p) const {
    DistanceSample d = detail::distance_to_box(0.5 * size_m - Vec3::Constant(edge_radius_m), p);
    d.distance -= edge_radius_m;
    return d;
  }
};

template <class = void>
inline void validate(const Box& b) {
  for (double side : {b.size_m.x(), b.size_m.y(), b.size_m.z()}) require_in_range("box side", side * 1e3, 0.1, 1000.0, "mm");
  require_in_range("edge radius of the box", b.edge_radius_m * 1e3, 0.0, 0.499 * b.size_m.minCoeff() * 1e3, "mm");
}

static_assert(Indenter<Box>);

}  // namespace lumo

// ---- lumo/mechanics/capsule.hpp

namespace lumo {

/// Rigid capsule about its own z axis: all points within half a diameter of a segment. Lying (see Oriented) it is a bar with round ends.
struct Capsule {
  double diameter_m = 10e-3;
  double length_m = 20e-3;    ///< of the segment, without the caps

  bool operator==(const Capsule&) const = default;

  double radius_m() const { return 0.5 * (length_m + diameter_m); }
  double contact_radius_m() const { return 0.5 * diameter_m; }
  bool symmetric(int) const { return true; }
  template <class Vec3 = Vec3>
  double distance(In<Vec3> p) const { return (p - nearest(p)).norm() - contact_radius_m(); }
  template <class Vec3 = Vec3, class Mat3 = Mat3>
  DistanceSample sample(In<Vec3> p) const {
    const Vec3 foot = nearest(p), out = p - foot;
    const double r = out.norm();
    const Vec3 n = r > 0.0 ? Vec3(out / r) : Vec3(Vec3::UnitX());
    const bool side = std::abs(p.z()) <= 0.5 * length_m;
    Mat3 across = Mat3::Identity() - n * n.transpose();
    if (side) across -= Vec3::UnitZ() * Vec3::UnitZ().transpose();
    return {r - contact_radius_m(), n, across / (r > 0.0 ? r : contact_radius_m())};
  }

 private:
  Vec3 nearest(const Vec3& p) const { return {0.0, 0.0, std::clamp(p.z(), -0.5 * length_m, 0.5 * length_m)}; }
};

inline void validate(const Capsule& c) {
  require_in_range("capsule diameter", c.diameter_m * 1e3, 0.1, 1000.0, "mm");
  require_in_range("capsule length", c.length_m * 1e3, 0.0, 1000.0, "mm");
}

static_assert(Indenter<Capsule>);

}  // namespace lumo

// ---- lumo/mechanics/cylinder.hpp

namespace lumo {

/// Rigid cylinder about its own z axis, with rounded rims where `edge_radius_m` > 0: a flat punch; lying (see Oriented), a bar.
struct Cylinder {
  double diameter_m = 10e-3;
  double length_m = 20e-3;
  double edge_radius_m = 0.5e-3;

  bool operator==(const Cylinder&) const = default;

  double radius_m() const { return 0.5 * std::hypot(diameter_m, length_m); }
  double contact_radius_m() const { return 0.5 * diameter_m; }
  bool symmetric(int) const { return true; }
  template <class Vec3 = Vec3>
  double distance(In<Vec3> p) const { return sample(p).distance; }
  template <class Vec3 = Vec3, class Mat3 = Mat3>
  DistanceSample sample(In<Vec3> p) const;
};

inline void validate(const Cylinder& c) {
  require_in_range("cylinder diameter", c.diameter_m * 1e3, 0.1, 1000.0, "mm");
  require_in_range("cylinder length", c.length_m * 1e3, 0.1, 1000.0, "mm");
  require_in_range("edge radius of the cylinder", c.edge_radius_m * 1e3, 0.0, 0.499 * std::min(c.diameter_m, c.length_m) * 1e3, "mm");
}

// A rectangle in the half-plane through the axis, turned about it.
template <class Vec3, class Mat3>
inline DistanceSample Cylinder::sample(In<Vec3> p) const {
  const double rho = std::hypot(p.x(), p.y()), up = p.z() < 0.0 ? -1.0 : 1.0;
  const Vec3 radial = rho > 0.0 ? Vec3(p.x() / rho, p.y() / rho, 0.0) : Vec3(Vec3::UnitX()), axial = up * Vec3::UnitZ();
  const Vec3 around = Vec3::UnitZ().cross(radial);
  const double beyond = std::abs(p.z()) - 0.5 * length_m + edge_radius_m, aside = rho - 0.5 * diameter_m + edge_radius_m;
  if (beyond > 0.0 && aside > 0.0) {
    const double r = std::hypot(beyond, aside);
    const Vec3 n = (beyond * axial + aside * radial) / r, t = (aside * axial - beyond * radial) / r;
    return {r - edge_radius_m, n, t * t.transpose() / r + aside / (r * rho) * around * around.transpose()};
  }
  if (beyond > aside) return {beyond - edge_radius_m, axial, Mat3::Zero()};
  return {aside - edge_radius_m, radial, around * around.transpose() / (rho > 0.0 ? rho : 0.5 * diameter_m)};
}

static_assert(Indenter<Cylinder>);

}  // namespace lumo

// ---- lumo/mechanics/oriented.hpp

namespace lumo {

/// A tool turned in the finger's frame: `turn` takes vectors of the tool's own frame there.
template <Indenter Tool>
struct Oriented {
  Tool tool;
  Mat3 turn = Mat3::Identity();

  bool operator==(const Oriented&) const = default;

  double radius_m() const { return tool.radius_m(); }
  double contact_radius_m() const { return contact_radius(tool); }
  bool symmetric(int axis) const {  // where an axis of the tool lies along it
    for (int k = 0; k < 3; ++k)
      if (std::abs(turn(axis, k)) == 1.0) return is_symmetric(tool, k);
    return false;
  }
  double distance(const Vec3& p) const { return tool.distance(turn.transpose() * p); }
  DistanceSample sample(const Vec3& p) const {
    const DistanceSample d = tool.sample(turn.transpose() * p);
    return {d.distance, turn * d.gradient, turn * d.hessian * turn.transpose()};
  }
};

template <Indenter Tool>
Oriented(Tool, Mat3) -> Oriented<Tool>;

/// A tool that is long along its own z, laid along y, the finger: its z becomes y.
template <Indenter Tool>
Oriented<Tool> lying_along_y(const Tool& tool) {
  Mat3 turn;
  turn << 1, 0, 0, 0, 0, 1, 0, -1, 0;
  return {tool, turn};
}

/// The same, laid along x, across the finger.
template <Indenter Tool>
Oriented<Tool> lying_along_x(const Tool& tool) {
  Mat3 turn;
  turn << 0, 0, 1, 0, 1, 0, -1, 0, 0;
  return {tool, turn};
}

template <Indenter Tool>
void validate(const Oriented<Tool>& o) {
  validate(o.tool);
  if (!((o.turn.transpose() * o.turn - Mat3::Identity()).norm() < 1e-9 && o.turn.determinant() > 0.0))
    throw InvalidArgument(detail::text("turn of a tool: its determinant is ", o.turn.determinant(), ", must be a rotation"));
}

static_assert(Indenter<Oriented<Sphere>>);

}  // namespace lumo

// ---- lumo/mesh/triangle_tree.hpp

namespace lumo {

/// Where on a triangle abc a point is nearest to another, and on what of it.
struct TrianglePoint {
  Vec3 point = Vec3::Zero();
  int feature = inside;   ///< corner a, b, c: 0, 1, 2; edge ab, bc, ca: 3, 4, 5; or
  static constexpr int inside = 6;
};

/// Point of the triangle abc nearest to p. Source: Ericson 2005, §5.1.5.
template <class Vec3 = Vec3>
inline TrianglePoint closest_point(In<Vec3> p, In<Vec3> a, In<Vec3> b, In<Vec3> c) {
  const Vec3 ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0.0 && d2 <= 0.0) return {a, 0};
  const Vec3 bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0.0 && d4 <= d3) return {b, 1};
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return {a + d1 / (d1 - d3) * ab, 3};
  const Vec3 cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0.0 && d5 <= d6) return {c, 2};
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return {a + d2 / (d2 - d6) * ac, 5};
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0.0 && d4 >= d3 && d5 >= d6) return {b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b), 4};
  const double scale = 1.0 / (va + vb + vc);
  return {a + vb * scale * ab + vc * scale * ac, TrianglePoint::inside};
}

template <class Vec3 = Vec3>
inline Vec3 closest_on_triangle(In<Vec3> p, In<Vec3> a, In<Vec3> b, In<Vec3> c) { return closest_point(p, a, b, c).point; }

/// Boxes about the triangles of a surface, for the distance to it. The surface must outlive the tree.
class TriangleTree {
 public:
  template <class = void>
  explicit TriangleTree(const TriangleSurface& surface) : surface_(&surface), order_(surface.triangles.size()) {
    std::iota(order_.begin(), order_.end(), 0);
    if (!order_.empty()) build(0, int(order_.size()));
  }

  /// The place on the surface that is nearest to a point.
  struct Nearest {
    int triangle = -1;   ///< −1: there is none so near
    TrianglePoint at;
    double distance = std::numeric_limits<double>::infinity();   ///< unsigned [m]
  };

  /// Looks no farther than `near` [m] from p.
  template <class Vec3 = Vec3>
  Nearest nearest(In<Vec3> p, double near = std::numeric_limits<double>::infinity()) const {
    Nearest best;
    double least = near * near;
    if (!nodes_.empty()) search(0, p, least, best);
    best.distance = std::sqrt(least);
    return best;
  }

  /// Unsigned distance [m] from p to the surface; `near` or more when it is farther than that.
  template <class Vec3 = Vec3>
  double distance(In<Vec3> p, double near = std::numeric_limits<double>::infinity()) const { return nearest(p, near).distance; }

 private:
  struct Node {
    Eigen::AlignedBox3d box;
    int first, count;   ///< triangles of a leaf; count 0: the children are at `first` and `second`
    int second;
  };

  const Vec3& corner(int triangle, std::size_t k) const { return surface_->vertices[std::size_t(surface_->triangles[std::size_t(triangle)][k])]; }

  template <class AlignedBox3d = Eigen::AlignedBox3d>
  int build(int begin, int end) {
    const int self = int(nodes_.size());
    nodes_.push_back({{}, begin, end - begin, -1});
    AlignedBox3d box;
    for (int i = begin; i < end; ++i)
      for (std::size_t k = 0; k < 3; ++k) box.extend(corner(order_[std::size_t(i)], k));
    nodes_[std::size_t(self)].box = box;
    if (end - begin <= 4) return self;
    int axis;
    box.sizes().maxCoeff(&axis);
    const auto middle = [&](int t) { return corner(t, 0)[axis] + corner(t, 1)[axis] + corner(t, 2)[axis]; };
    const int half = (begin + end) / 2;
    std::nth_element(order_.begin() + begin, order_.begin() + half, order_.begin() + end, [&](int a, int b) {
      const double x = middle(a), y = middle(b);
      return x < y || (x == y && a < b);
    });
    const int left = build(begin, half), right = build(half, end);
    nodes_[std::size_t(self)].first = left;
    nodes_[std::size_t(self)].count = 0;
    nodes_[std::size_t(self)].second = right;
    return self;
  }

  template <class Vec3 = Vec3>
  void search(int at, In<Vec3> p, double& least, Nearest& best) const {
    const Node& n = nodes_[std::size_t(at)];
    if (n.count > 0) {
      for (int i = n.first; i < n.first + n.count; ++i) {
        const int t = order_[std::size_t(i)];
        const TrianglePoint on = closest_point(p, corner(t, 0), corner(t, 1), corner(t, 2));
        if (const double squared = (on.point - p).squaredNorm(); squared < least) least = squared, best.triangle = t, best.at = on;
      }
      return;
    }
    int near = n.first, far = n.second;
    double to_near = nodes_[std::size_t(near)].box.squaredExteriorDistance(p), to_far = nodes_[std::size_t(far)].box.squaredExteriorDistance(p);
    if (to_far < to_near) std::swap(near, far), std::swap(to_near, to_far);
    if (to_near < least) search(near, p, least, best);
    if (to_far < least) search(far, p, least, best);
  }

  const TriangleSurface* surface_;
  std::vector<int> order_;
  std::vector<Node> nodes_;
};

}  // namespace lumo

// ---- lumo/mesh/signed_distance.hpp

namespace lumo {

/// Exact signed distance to a closed surface of triangles, negative inside. The sign is that of the outward direction at the nearest place, with the normals
/// of the triangles that meet there weighted by their angles. Source: Bærentzen & Aanæs 2005. The surface must outlive it and be valid (unchecked).
class SignedDistance {
 public:
  template <class Vec3 = Vec3>
  explicit SignedDistance(const TriangleSurface& surface) : surface_(&surface), tree_(surface), at_corner_(surface.vertices.size(), Vec3::Zero()) {
    for (const auto& t : surface.triangles) {
      const Vec3 n = (corner(t, 1) - corner(t, 0)).cross(corner(t, 2) - corner(t, 0)).normalized();
      normal_.push_back(n);
      for (std::size_t k = 0; k < 3; ++k) {
        const Vec3 forth = corner(t, (k + 1) % 3) - corner(t, k), back = corner(t, (k + 2) % 3) - corner(t, k);
        at_corner_[std::size_t(t[k])] += std::atan2(forth.cross(back).norm(), forth.dot(back)) * n;
        at_edge_.try_emplace(key(t, k), Vec3::Zero()).first->second += n;
      }
    }
  }

  /// Distance [m] with its first two derivatives; at the surface itself the gradient is the outward direction there.
  struct Sample {
    double distance;
    Vec3 gradient;
    Mat3 hessian;   ///< [1/m]
  };
  template <class Vec3 = Vec3, class Mat3 = Mat3>
  Sample sample(In<Vec3> p) const {
    const TriangleTree::Nearest n = tree_.nearest(p);
    const Vec3 out = outward(n), way = p - n.at.point;
    const double sign = way.dot(out) < 0.0 ? -1.0 : 1.0;
    Sample s{sign * n.distance, n.distance > 0.0 ? Vec3(sign / n.distance * way) : Vec3(out.normalized()), Mat3::Zero()};
    if (n.at.feature == TrianglePoint::inside || !(n.distance > 0.0)) return s;
    Mat3 turning = Mat3::Identity() - s.gradient * s.gradient.transpose();   // a plane's distance is straight, an edge's bends across it, a corner's all around
    if (n.at.feature > 2) {
      const auto& t = surface_->triangles[std::size_t(n.triangle)];
      const std::size_t k = std::size_t(n.at.feature) - 3;
      const Vec3 along = (corner(t, (k + 1) % 3) - corner(t, k)).normalized();
      turning -= along * along.transpose();
    }
    s.hessian = turning / s.distance;
    return s;
  }

  /// Distance alone; `near`: a bound [m] that its size is known to keep.
  template <class Vec3 = Vec3>
  double distance(In<Vec3> p, double near = std::numeric_limits<double>::infinity()) const {
    const TriangleTree::Nearest n = tree_.nearest(p, near);
    return n.triangle >= 0 && (p - n.at.point).dot(outward(n)) < 0.0 ? -n.distance : n.distance;
  }

 private:
  const Vec3& corner(const std::array<int, 3>& t, std::size_t k) const { return surface_->vertices[std::size_t(t[k])]; }
  static std::pair<int, int> key(const std::array<int, 3>& t, std::size_t k) { return std::minmax(int(t[k]), int(t[(k + 1) % 3])); }

  Vec3 outward(const TriangleTree::Nearest& n) const {
    const auto& t = surface_->triangles[std::size_t(n.triangle)];
    if (n.at.feature < 3) return at_corner_[std::size_t(t[std::size_t(n.at.feature)])];
    if (n.at.feature < TrianglePoint::inside) return at_edge_.at(key(t, std::size_t(n.at.feature) - 3));
    return normal_[std::size_t(n.triangle)];
  }

  const TriangleSurface* surface_;
  TriangleTree tree_;
  std::vector<Vec3> normal_, at_corner_;
  std::map<std::pair<int, int>, Vec3> at_edge_;
};

}  // namespace lumo

// ---- lumo/mechanics/distance_grid.hpp

namespace lumo {

/// Signed distance to a closed triangle surface on a cubic grid, carried on between its points by the cubic spline through them: twice
/// continuously differentiable, of fourth order where the distance is smooth. Near sharp edges the spline rounds by a fraction of a cell.
/// From two cells outside the surface's box on it passes, within one cell, into the exact distance. Source: Unser 1999 (spline through samples).
class DistanceGrid {
 public:
  /// `cells` across the surface's longest side. Throws MeshError for a surface that bounds no solid, InvalidArgument for other than 8 … 256 cells.
  template <class Vec3 = Vec3, class AlignedBox3d = Eigen::AlignedBox3d>
  DistanceGrid(const TriangleSurface& surface, int cells);
  DistanceGrid(const DistanceGrid&) = delete;   // what is exact points into the surface
  DistanceGrid& operator=(const DistanceGrid&) = delete;

  template <class Vec3 = Vec3>
  double distance(In<Vec3> p) const { return sample(p).distance; }

  /// Distance with its derivatives.
  template <class Vec3 = Vec3, class Mat3 = Mat3>
  DistanceSample sample(In<Vec3> p) const;

  double spacing_m() const { return h_; }
  const TriangleSurface& surface() const { return surface_; }
  /// Largest difference from the exact distance that was found at the middles of all cells within one spacing of the surface [m].
  double error_m() const { return error_; }

 private:
  static constexpr int pad = 6, rim = 3;   // cells about the surface, of which the outer ones only feed the spline

  double& at(int i, int j, int k) { return c_[std::size_t(i) + std::size_t(n_[0]) * (std::size_t(j) + std::size_t(n_[1]) * std::size_t(k))]; }
  double at(int i, int j, int k) const { return const_cast<DistanceGrid*>(this)->at(i, j, k); }
  template <class Vec3 = Vec3>
  Vec3 node(int i, int j, int k) const { return origin_ + h_ * Vec3(i, j, k); }

  template <class = void>
  void fill();
  void filter();
  template <class Vec3 = Vec3>
  void measure();
  template <class Vec3 = Vec3, class Mat3 = Mat3>
  DistanceSample spline(In<Vec3> p) const;
  template <class Vec3 = Vec3>
  DistanceSample exact(In<Vec3> p) const;

  TriangleSurface surface_;
  SignedDistance exact_;
  Vec3 origin_, low_, high_;   // first node; box in which the spline holds
  std::array<int, 3> n_{};     // nodes each way
  double h_ = 0.0, error_ = 0.0;
  std::vector<double> c_;      // spline coefficients
};

template <class Vec3, class AlignedBox3d>
inline DistanceGrid::DistanceGrid(const TriangleSurface& surface, int cells) : surface_((validate_surface(surface), surface)), exact_(surface_) {
  if (cells < 8 || cells > 256) throw InvalidArgument(detail::text("cells of a distance grid are ", cells, ", must lie in [8, 256]"));
  AlignedBox3d box;
  for (const Vec3& v : surface_.vertices) box.extend(v);
  const Vec3 size = box.sizes();
  h_ = size.maxCoeff() / cells;
  origin_ = box.min() - pad * h_ * Vec3::Ones();
  for (int a = 0; a < 3; ++a) n_[std::size_t(a)] = int(std::ceil(size[a] / h_ - 1e-9)) + 2 * pad + 1;
  low_ = origin_ + rim * h_ * Vec3::Ones();
  high_ = node(n_[0] - 1 - rim, n_[1] - 1 - rim, n_[2] - 1 - rim);
  c_.resize(std::size_t(n_[0]) * std::size_t(n_[1]) * std::size_t(n_[2]));
  fill();
  filter();
  measure();
}

template <class>
inline void DistanceGrid::fill() {
  for (int k = 0; k < n_[2]; ++k)
    for (int j = 0; j < n_[1]; ++j)
      for (int i = 0; i < n_[0]; ++i)   // from node to node the distance changes by no more than the way
        at(i, j, k) = exact_.distance(node(i, j, k), i > 0 ? std::abs(at(i - 1, j, k)) + 1.001 * h_ : std::numeric_limits<double>::infinity());
}

// The spline through the samples, line by line in all three directions, mirrored at the ends.
inline void DistanceGrid::filter() {
  const double pole = std::sqrt(3.0) - 2.0;
  const auto line = [&](int count, auto&& value) {
    double first = 0.0, power = 1.0;
    for (int i = 0; i < std::min(count, 30); ++i, power *= pole) first += power * value(i);
    value(0) = first;
    for (int i = 1; i < count; ++i) value(i) += pole * value(i - 1);
    value(count - 1) = pole / (pole * pole - 1.0) * (value(count - 1) + pole * value(count - 2));
    for (int i = count - 2; i >= 0; --i) value(i) = pole * (value(i + 1) - value(i));
    for (int i = 0; i < count; ++i) value(i) *= 6.0;
  };
  for (int k = 0; k < n_[2]; ++k)
    for (int j = 0; j < n_[1]; ++j) line(n_[0], [&](int i) -> double& { return at(i, j, k); });
  for (int k = 0; k < n_[2]; ++k)
    for (int i = 0; i < n_[0]; ++i) line(n_[1], [&](int j) -> double& { return at(i, j, k); });
  for (int j = 0; j < n_[1]; ++j)
    for (int i = 0; i < n_[0]; ++i) line(n_[2], [&](int k) -> double& { return at(i, j, k); });
}

template <class Vec3>
inline void DistanceGrid::measure() {
  for (int k = rim; k < n_[2] - 1 - rim; ++k)
    for (int j = rim; j < n_[1] - 1 - rim; ++j)
      for (int i = rim; i < n_[0] - 1 - rim; ++i) {
        const Vec3 p = node(i, j, k) + Vec3::Constant(0.5 * h_);
        const double d = spline(p).distance;
        if (std::abs(d) < h_) error_ = std::max(error_, std::abs(d - exact_.distance(p, 3.0 * h_)));
      }
}

template <class Vec3, class Mat3>
inline DistanceSample DistanceGrid::spline(In<Vec3> p) const {
  std::array<int, 3> cell;
  std::array<std::array<double, 4>, 3> w, dw, ddw;   // weights of the four nodes about p each way, and their derivatives
  for (std::size_t a = 0; a < 3; ++a) {
    const double u = (p[Eigen::Index(a)] - origin_[Eigen::Index(a)]) / h_;
    cell[a] = std::min(int(std::fmin(std::fmax(u, 1.0), n_[a])), n_[a] - 3);   // of NaN, any cell
    const double t = u - cell[a], s = 1.0 - t;
    w[a] = {s * s * s / 6.0, 2.0 / 3.0 - 0.5 * t * t * (2.0 - t), 2.0 / 3.0 - 0.5 * s * s * (2.0 - s), t * t * t / 6.0};
    dw[a] = {-0.5 * s * s / h_, 0.5 * t * (3.0 * t - 4.0) / h_, -0.5 * s * (3.0 * s - 4.0) / h_, 0.5 * t * t / h_};
    ddw[a] = {s / (h_ * h_), (3.0 * t - 2.0) / (h_ * h_), (3.0 * s - 2.0) / (h_ * h_), t / (h_ * h_)};
  }
  DistanceSample d{0.0, Vec3::Zero(), Mat3::Zero()};
  for (std::size_t k = 0; k < 4; ++k)
    for (std::size_t j = 0; j < 4; ++j) {
      double f = 0.0, fx = 0.0, fxx = 0.0;
      for (std::size_t i = 0; i < 4; ++i) {
        const double c = at(cell[0] + int(i) - 1, cell[1] + int(j) - 1, cell[2] + int(k) - 1);
        f += w[0][i] * c, fx += dw[0][i] * c, fxx += ddw[0][i] * c;
      }
      d.distance += w[1][j] * w[2][k] * f;
      d.gradient += Vec3(w[1][j] * w[2][k] * fx, dw[1][j] * w[2][k] * f, w[1][j] * dw[2][k] * f);
      d.hessian(0, 0) += w[1][j] * w[2][k] * fxx;
      d.hessian(1, 1) += ddw[1][j] * w[2][k] * f;
      d.hessian(2, 2) += w[1][j] * ddw[2][k] * f;
      d.hessian(1, 0) += dw[1][j] * w[2][k] * fx;
      d.hessian(2, 0) += w[1][j] * dw[2][k] * fx;
      d.hessian(2, 1) += dw[1][j] * dw[2][k] * f;
    }
  d.hessian.triangularView<Eigen::StrictlyUpper>() = d.hessian.transpose();
  return d;
}

template <class Vec3, class Mat3>
inline DistanceSample DistanceGrid::sample(In<Vec3> p) const {
  // How far p has gone from the spline to the exact distance, from 0 to 1 over the box's outermost cell, and how that changes.
  double gone = 0.0;
  Vec3 slope = Vec3::Zero();
  Mat3 bend = Mat3::Zero();
  for (int a = 0; a < 3; ++a) {
    const double side = p[a] < 0.5 * (low_[a] + high_[a]) ? -1.0 : 1.0, t = (side < 0.0 ? low_[a] - p[a] : p[a] - high_[a]) / h_ + 1.0;
    if (!(t > 0.0)) continue;
    if (t >= 1.0) return exact(p);
    // 1 − Π (1 − w) with w = t³ (10 − 15 t + 6 t²), whose first two derivatives vanish at both ends
    const double w = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t), dw = side / h_ * 30.0 * t * t * (1.0 - t) * (1.0 - t);
    const double ddw = 60.0 * t * (1.0 - t) * (1.0 - 2.0 * t) / (h_ * h_);
    bend *= 1.0 - w;
    bend.col(a) -= dw * slope;
    bend.row(a) -= dw * slope.transpose();
    bend(a, a) += ddw * (1.0 - gone);
    slope *= 1.0 - w;
    slope[a] += dw * (1.0 - gone);
    gone += w * (1.0 - gone);
  }
  const DistanceSample near = spline(p);
  if (gone == 0.0) return near;
  const DistanceSample far = exact(p);
  const double apart = far.distance - near.distance;
  const Vec3 turn = far.gradient - near.gradient;
  return {near.distance + gone * apart, near.gradient + gone * turn + apart * slope,
          near.hessian + gone * (far.hessian - near.hessian) + slope * turn.transpose() + turn * slope.transpose() + apart * bend};
}

template <class Vec3>
inline DistanceSample DistanceGrid::exact(In<Vec3> p) const {
  const SignedDistance::Sample s = exact_.sample(p);
  return {s.distance, s.gradient, s.hessian};
}

}  // namespace lumo

// ---- lumo/mechanics/mesh_indenter.hpp

namespace lumo {

/// Rigid tool of any closed triangle surface, by the signed distance on a grid; the surface's own coordinates are the tool's frame. Copies
/// share the grid. `MeshIndenter tool(read_surface("knob.stl"))`.
class MeshIndenter {
 public:
  /// Throws as DistanceGrid does.
  template <class Vec3 = Vec3, class AlignedBox3d = Eigen::AlignedBox3d>
  explicit MeshIndenter(const TriangleSurface& surface, int cells = 64) : grid_(std::make_shared<const DistanceGrid>(surface, cells)) {
    AlignedBox3d box;
    for (const Vec3& v : surface.vertices) radius_m_ = std::max(radius_m_, v.norm()), box.extend(v);
    contact_radius_m_ = 0.5 * box.sizes().minCoeff();
  }

  /// The same surface on as fine a grid.
  bool operator==(const MeshIndenter& other) const {
    const TriangleSurface &a = grid_->surface(), &b = other.grid_->surface();
    return grid_ == other.grid_ || (grid_->spacing_m() == other.grid_->spacing_m() && a.vertices == b.vertices && a.triangles == b.triangles);
  }

  double radius_m() const { return radius_m_; }
  double contact_radius_m() const { return contact_radius_m_; }
  template <class Vec3 = Vec3>
  double distance(In<Vec3> p) const { return grid_->distance(p); }
  template <class Vec3 = Vec3>
  DistanceSample sample(In<Vec3> p) const { return grid_->sample(p); }
  const DistanceGrid& grid() const { return *grid_; }

 private:
  std::shared_ptr<const DistanceGrid> grid_;
  double radius_m_ = 0.0, contact_radius_m_ = 0.0;
};

inline void validate(const MeshIndenter& m) { require_in_range("radius about a mesh indenter's origin", m.radius_m() * 1e3, 0.05, 1000.0, "mm"); }

static_assert(Indenter<MeshIndenter>);

}  // namespace lumo

// ---- lumo/mechanics/contact_handler.hpp

namespace lumo {

/// What a contact law answers to a gap [m]: energy per reference area [J/m²], pressure [Pa] = −dE/dg, stiffness [N/m³] = d²E/dg².
struct ContactResponse {
  double energy;
  double pressure;
  double stiffness;
};

/// A contact law between the body's surface and a rigid surface. It is frictionless unless it has a `friction`, Coulomb's coefficient, and
/// acts all over the surface unless it has `points`.
/// Laws: no pressure at gaps ≥ 0; pressure ≥ 0; pressure and stiffness are the derivatives of the energy.
template <class C>
concept ContactHandler = requires(const C& contact, double gap) {
  { contact.respond(gap) } -> std::convertible_to<ContactResponse>;
  { contact.stiffness_N_per_m3 } -> std::convertible_to<double>;
  validate(contact);
};

/// Where a contact law is asked: at many points inside all faces, or at the mesh's nodes, each with its share of the area.
enum class ContactPoints { surface, vertices };

template <ContactHandler Contact>
constexpr ContactPoints contact_points() {
  if constexpr (requires { { Contact::points } -> std::convertible_to<ContactPoints>; }) return Contact::points;
  else return ContactPoints::surface;
}

/// Coulomb's coefficient of a law; 0 where it has none.
template <ContactHandler Contact>
double friction_coefficient(const Contact& contact) {
  if constexpr (requires { contact.friction; }) return contact.friction;
  else return 0.0;
}

/// Area [m²] that the law gives each vertex instead of its share of the surface; 0: its share.
template <ContactHandler Contact>
double area_per_vertex(const Contact& contact) {
  if constexpr (requires { contact.area_per_vertex_m2; }) return contact.area_per_vertex_m2;
  else return 0.0;
}

/// Answer of a spring of `stiffness` [N/m³] to a gap: nothing while it is open.
inline ContactResponse penalty(double stiffness, double gap) {
  if (gap >= 0.0) return {0.0, 0.0, 0.0};
  return {0.5 * stiffness * gap * gap, -stiffness * gap, stiffness};
}

/// Penalty on the signed distance, over the full surface (points inside faces, not only vertices), per reference area.
/// Source: paper §III-B ("signed-distance full-surface rigid–soft collision").
struct SDFContact {
  double stiffness_N_per_m3 = 1e11;  ///< overlap at 0.3 MPa is 3 µm
  double friction = 0.0;             ///< Coulomb's coefficient

  ContactResponse respond(double gap) const { return penalty(stiffness_N_per_m3, gap); }
};

inline void validate(const SDFContact& c) {
  require_in_range("contact stiffness", c.stiffness_N_per_m3, 1e6, 1e15, "N/m3");
  require_in_range("friction coefficient", c.friction, 0.0, 10.0, "");
}

static_assert(ContactHandler<SDFContact>);

/// A contact law with all its pressures multiplied by a factor.
template <class Contact>
struct Firmness {
  const Contact* law;
  double factor;
  double stiffness_N_per_m3 = factor * law->stiffness_N_per_m3;
  double friction = friction_coefficient(*law);
  static constexpr ContactPoints points = contact_points<Contact>();

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

// ---- lumo/mechanics/vertex_contact.hpp

namespace lumo {

/// Penalty at the mesh's nodes with Coulomb friction, as Newton 1.8 has it: faces may overlap the indenter between their nodes. A solver that
/// goes in time steps takes each node's tangent plane of the indenter at the step's start (`plane_frozen`).
/// Newton's stiffness k_e [N/m] belongs to a vertex, whatever its share of the surface: that is stiffness_N_per_m3 · area_per_vertex_m2.
struct VertexContact {
  static constexpr ContactPoints points = ContactPoints::vertices;
  static constexpr bool plane_frozen = true;
  double stiffness_N_per_m3 = 1e11;
  double friction = 0.5;              ///< Coulomb's coefficient
  double area_per_vertex_m2 = 0.0;    ///< the same for all; 0: each vertex has its share of the surface

  ContactResponse respond(double gap) const { return penalty(stiffness_N_per_m3, gap); }
};

inline void validate(const VertexContact& c) {
  require_in_range("contact stiffness", c.stiffness_N_per_m3, 1e6, 1e15, "N/m3");
  require_in_range("friction coefficient", c.friction, 0.0, 10.0, "");
  require_in_range("contact area per vertex", c.area_per_vertex_m2 * 1e6, 0.0, 1e6, "mm2");
}

static_assert(ContactHandler<VertexContact>);

}  // namespace lumo

// ---- lumo/mechanics/carrier.hpp

namespace lumo {

/// Signed distance to the union of a body's rigid boxes. The origin of its frame is the finger's.
struct Carrier {
  std::vector<RigidBox> boxes;

  template <class Vec3 = Vec3>
  double distance(In<Vec3> p) const {
    double least = std::numeric_limits<double>::infinity();
    for (const RigidBox& b : boxes) least = std::min(least, to_box(b, p).distance);
    return least;
  }
  template <class Vec3 = Vec3, class Mat3 = Mat3>
  DistanceSample sample(In<Vec3> p) const {
    DistanceSample nearest{std::numeric_limits<double>::infinity(), Vec3::UnitZ(), Mat3::Zero()};
    for (const RigidBox& b : boxes)
      if (const DistanceSample d = to_box(b, p); d.distance < nearest.distance) nearest = d;
    return nearest;
  }

 private:
  template <class Vec3 = Vec3>
  static DistanceSample to_box(const RigidBox& b, In<Vec3> p) { return detail::distance_to_box(b.half, p - b.center); }
};

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

  template <class = void>
  void analyze(const SparseLower& lower) {
    pattern_ = lower;
    solver_.analyzePattern(lower);
  }
  template <class ArrayXd = Eigen::ArrayXd>
  FactorStatus factorize(const SparseLower& lower) {
    // A Cholesky factorisation of NaN reports success, so finiteness is checked here.
    if (!Eigen::Map<const ArrayXd>(lower.valuePtr(), lower.nonZeros()).isFinite().all()) return FactorStatus::non_finite;
    solver_.factorize(lower);
    return solver_.info() == Eigen::Success ? FactorStatus::positive_definite : FactorStatus::not_positive_definite;
  }
  template <class MatrixXd = Eigen::MatrixXd>
  Eigen::MatrixXd solve(In<MatrixXd> rhs) const { return solver_.solve(rhs); }

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

  template <class = void>
  Equations(const Sector& sector, const Body& body, Parity parity);

  /// Position in the pattern's values of an entry of the lower triangle.
  template <class = void>
  int slot(int row, int column) const;
};

template <class>
inline int Equations::slot(int row, int column) const {
  if (row < column) std::swap(row, column);
  const int* begin = pattern.innerIndexPtr() + pattern.outerIndexPtr()[column];
  const int* end = pattern.innerIndexPtr() + pattern.outerIndexPtr()[column + 1];
  return int(std::lower_bound(begin, end, row) - pattern.innerIndexPtr());
}

template <class>
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

  template <class Vec3 = Vec3>
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

// ---- lumo/mechanics/element_points.hpp

namespace lumo {

/// Gradients of the shape functions by the place at rest, and volumes, at the quadrature points of all tetrahedra of a mesh.
template <TetElement Element>
class ElementPoints {
 public:
  using Gradients = Eigen::Matrix<double, 3, Element::nodes>;

  /// Throws InvalidArgument where the mesh is not of the element's order: nodes in the middle of edges would belong to no element, or be missing.
  explicit ElementPoints(const TetMesh& mesh) {
    if (mesh.order != Element::order)
      throw InvalidArgument(detail::text("elements are of order ", Element::order, ", the mesh is of order ", mesh.order, ", must be the same"));
    gradients_.reserve(mesh.tets.size() * Element::points);
    weights_.reserve(mesh.tets.size() * Element::points);
    for (const auto& t : mesh.tets)
      for (int q = 0; q < Element::points; ++q) {
        const Gradients by_xi = shape_gradients<Element::nodes>(Element::point(q));
        Mat3 jacobian = Mat3::Zero();
        for (int a = 0; a < Element::nodes; ++a) jacobian += mesh.nodes[std::size_t(t[std::size_t(a)])] * by_xi.col(a).transpose();
        gradients_.push_back(jacobian.inverse().transpose() * by_xi);
        weights_.push_back(Element::weight(q) * jacobian.determinant());
      }
  }

  /// [1/m], of tetrahedron e at point q.
  const Gradients& gradient(std::size_t e, int q) const { return gradients_[e * std::size_t(Element::points) + std::size_t(q)]; }
  /// Volume that the point stands for [m³].
  double weight(std::size_t e, int q) const { return weights_[e * std::size_t(Element::points) + std::size_t(q)]; }

 private:
  std::vector<Gradients, Eigen::aligned_allocator<Gradients>> gradients_;
  std::vector<double> weights_;
};

}  // namespace lumo

// ---- lumo/mechanics/solid.hpp

namespace lumo {

/// Deformed node positions, 3 × nodes [m].
using Positions = Eigen::Matrix3Xd;

template <class = void>
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

  /// Throws InvalidArgument where the mesh is not of the element's order.
  Solid(const TetMesh& mesh, Material material, Element element) : mesh_(&mesh), material_(material), element_(element), points_(mesh) {}

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

  /// Smallest undeformed volume that a quadrature point stands for [m³]; not positive where the mesh has an element that is inside out.
  double smallest_volume() const {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e)
      for (int q = 0; q < Element::points; ++q) least = std::min(least, weight(e, q));
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
  double weight(std::size_t e, int q) const { return points_.weight(e, q); }
  const Gradients& gradient(std::size_t e, int q) const { return points_.gradient(e, q); }

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
  ElementPoints<Element> points_;
};

}  // namespace lumo

// ---- lumo/mechanics/contact_surface.hpp

namespace lumo {

/// A point of the surface at which the gap is taken: shape functions of its face there, and its share of the reference area.
struct SurfacePoint {
  std::array<double, 6> shape;
  double area_m2;
  double weight_m2;             ///< area that the contact law's pressure acts on: area_m2, unless the law says otherwise
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
  /// Faces of the patches for which `chosen` holds, with points inside them.
  template <class Choose>
  ContactSurface(const TetMesh& mesh, const Body& body, Choose chosen) : mesh_(&mesh) {
    for (const BoundaryFace& f : mesh.faces)
      if (chosen(body.patches[std::size_t(f.patch)])) add(f);
  }

  /// The same with the points that a contact law wants.
  template <class Choose, ContactHandler Contact>
  ContactSurface(const TetMesh& mesh, const Body& body, Choose chosen, const Contact& law) : ContactSurface(mesh, body, chosen) {
    if (contact_points<Contact>() == ContactPoints::vertices) gather_at_vertices(area_per_vertex(law));
  }

  std::size_t size() const { return faces_.size(); }
  const BoundaryFace& face(std::size_t f) const { return faces_[f]; }
  const std::vector<SurfacePoint>& points(std::size_t f) const { return points_[f]; }

  template <class Vec3 = Vec3>
  Vec3 position(std::size_t f, const SurfacePoint& p, const Positions& x) const {
    Vec3 at = Vec3::Zero();
    for (std::size_t k = 0; k < std::size_t(mesh_->nodes_per_face()); ++k) at += p.shape[k] * x.col(faces_[f].nodes[k]);
    return at;
  }

  /// A ball that holds the deformed face: its midpoint and radius. The face stays in the hull of its Bézier points.
  template <class Vec3 = Vec3>
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
  template <class Vec3 = Vec3>
  void add(const BoundaryFace& face);
  void gather_at_vertices(double area_per_vertex);

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

template <class Vec3>
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
        p.weight_m2 = p.area_m2;
        points.push_back(p);
      }
  }
  faces_.push_back(face);
  points_.push_back(std::move(points));
}

// Every node once, on the first face that has it, with all of its area.
inline void ContactSurface::gather_at_vertices(double area_per_vertex) {
  std::vector<double> area(mesh_->nodes.size(), 0.0);
  std::vector<char> done(mesh_->nodes.size(), 0);
  const auto corners = [&](int part) { return mesh_->order == 2 ? face_parts()[std::size_t(part)] : std::array<int, 3>{0, 1, 2}; };
  for (std::size_t f = 0; f < faces_.size(); ++f)
    for (const SurfacePoint& p : points_[f])
      for (std::size_t k = 0; k < 3; ++k) area[std::size_t(faces_[f].nodes[std::size_t(corners(p.part)[k])])] += p.area_m2 * p.hat[k];
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    points_[f].clear();
    for (int part = 0; part < (mesh_->order == 2 ? 4 : 1); ++part)
      for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t local = std::size_t(corners(part)[k]), node = std::size_t(faces_[f].nodes[local]);
        if (std::exchange(done[node], char(1))) continue;
        SurfacePoint p{{}, area[node], area_per_vertex > 0.0 ? area_per_vertex : area[node], part, {}};
        p.shape[local] = 1.0;
        p.hat[k] = 1.0;
        points_[f].push_back(p);
      }
  }
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

// What a contact without friction would answer.
struct NoFriction {
  struct Answer {
    Vec3 traction;
    Mat3 stiffness;
  };
  template <class Vec3 = Vec3, class Mat3 = Mat3>
  Answer answer(std::size_t, std::size_t, In<Vec3>, In<Vec3>, In<Vec3>, double) const { return {Vec3::Zero(), Mat3::Zero()}; }
};

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
/// Friction, where a history of it is given, enters forces but not the energy.
template <ContactHandler Contact, class Tool, class Friction = detail::NoFriction>
ContactSums add_contact_forces(const ContactSurface& surface, const Contact& contact, const Moving<Tool>& rigid, const Positions& x, Positions* force,
                               const SeenGaps* seen = nullptr, const Friction* friction = nullptr) {
  ContactSums sums;
  detail::for_contact_points(surface, x, rigid, seen, [&](std::size_t f, std::size_t k, const SurfacePoint& p, const Vec3& at) {
    const double gap = rigid.distance(at), gamma = seen ? (*seen)[f][k] : gap;
    if (gap < 0.0) sums.penetration_m = std::max(sums.penetration_m, -gap);
    if (gamma >= 0.0) return;
    const ContactResponse r = contact.respond(gamma);
    sums.energy += p.weight_m2 * r.energy;
    const double pressure = r.pressure + r.stiffness * (gamma - gap);
    const Vec3 normal = rigid.sample(at).gradient;
    Vec3 traction = p.weight_m2 * pressure * normal;
    if (friction) traction += p.weight_m2 * friction->answer(f, k, at, rigid.origin, normal, pressure).traction;
    sums.push_N += traction.dot(rigid.direction);
    if (!force) return;
    for (std::size_t n = 0; n < std::size_t(surface.nodes_per_face()); ++n) force->col(surface.face(f).nodes[n]) -= p.shape[n] * traction;
  });
  return sums;
}

/// Adds the contact stiffness to a system's lower triangle; `coupling` (one per equation) receives ∂²energy/∂x∂advance.
template <ContactHandler Contact, class Tool, class Friction = detail::NoFriction>
ContactSums add_contact_tangent(const ContactSurface& surface, const Contact& contact, const Moving<Tool>& rigid, const Positions& x, const Equations& eq,
                                double* values, Eigen::VectorXd* coupling, const SeenGaps* seen = nullptr, const Friction* friction = nullptr) {
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
    Mat3 block = p.weight_m2 * (r.stiffness * d.gradient * d.gradient.transpose() - r.pressure * d.hessian);
    if (friction) block += p.weight_m2 * friction->answer(f, k, at, rigid.origin, d.gradient, r.pressure + r.stiffness * (gamma - d.distance)).stiffness;
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

// ---- lumo/mechanics/lumped_mass.hpp

namespace lumo {

/// Mass of each node [kg]: a tetrahedron's shared in equal parts among four corners, or with 1/36 for a corner and 4/27 for the middle of an
/// edge among ten, in proportion to the diagonal of the consistent matrix (Hinton, Rock, Zienkiewicz 1976): row sums would be negative.
/// Throws InvalidArgument where the mesh is not of the element's order.
template <TetElement Element>
std::vector<double> lumped_masses(const TetMesh& mesh, double density_kg_per_m3) {
  std::vector<double> mass(mesh.nodes.size(), 0.0);
  const ElementPoints<Element> points(mesh);
  for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
    double volume = 0.0;
    for (int q = 0; q < Element::points; ++q) volume += points.weight(e, q);
    for (int a = 0; a < Element::nodes; ++a)
      mass[std::size_t(mesh.tets[e][std::size_t(a)])] += density_kg_per_m3 * volume * (Element::nodes == 4 ? 0.25 : a < 4 ? 1.0 / 36.0 : 4.0 / 27.0);
  }
  return mass;
}

}  // namespace lumo

// ---- lumo/mechanics/vertex_block.hpp

namespace lumo {

/// Newton's equation of one node, the others held: block · step = force, both of the node's own three components.
struct VertexBlock {
  Vec3 force = Vec3::Zero();   ///< [N]
  Mat3 block = Mat3::Zero();   ///< [N/m]
};

/// Elastic and viscous force and stiffness of single nodes, for any material and element.
/// Viscosity is absolute, on the rate of C = FᵀF since the step's start: force −η ∂/∂x ½ ∫ |Ċ|² dt, as Newton 1.8 has it.
template <HyperelasticMaterial Material, TetElement Element>
class VertexElasticity {
 public:
  /// Throws InvalidArgument where the mesh is not of the element's order.
  VertexElasticity(const TetMesh& mesh, const Material& material, const Element& element) : mesh_(&mesh), material_(material), element_(element), points_(mesh) {
    at_.resize(mesh.nodes.size());
    for (std::size_t e = 0; e < mesh.tets.size(); ++e)
      for (int a = 0; a < N; ++a) at_[std::size_t(mesh.tets[e][std::size_t(a)])].push_back({int(e), a});
  }

  /// Adds node v's share at positions x; `start` are the positions at the step's start, `rate` = η/Δt [Pa].
  void add(int v, const Positions& x, const Positions& start, double rate, VertexBlock& out) const {
    for (const Incidence& in : at_[std::size_t(v)]) {
      std::array<Mat3, std::size_t(Element::points)> F;
      double volume = 0.0, changed = 0.0;
      for (int q = 0; q < Element::points; ++q) {
        F[std::size_t(q)] = deformation(in.tet, q, x);
        volume += weight(in.tet, q);
        changed += weight(in.tet, q) * F[std::size_t(q)].determinant();
      }
      Vec3 dilation = Vec3::Zero();   // of the whole element by the node's place
      for (int q = 0; q < Element::points; ++q) {
        const Mat3& f = F[std::size_t(q)];
        const Vec3 g = gradient(in.tet, q).col(in.place);
        const double w = weight(in.tet, q);
        const Vec3 c = cofactor(f) * g;
        out.force -= w * (material_.distortion_stress(f) * g);
        out.block += w * contracted(material_.distortion_tangent(f), g);
        dilation += w * c;
        if (!element_.mean_dilatation) {
          const VolumetricSample u = material_.volumetric(f.determinant());
          out.force -= w * u.stress * c;
          out.block += w * u.stiffness * c * c.transpose();   // the second derivative of J vanishes on a node's own block
        }
        if (rate > 0.0) {
          const Mat3 before = deformation(in.tet, q, start);
          const Vec3 fg = f * g;
          out.force -= 2.0 * w * rate * (f * ((f.transpose() * f - before.transpose() * before) * g));
          out.block += 2.0 * w * rate * (g.squaredNorm() * f * f.transpose() + fg * fg.transpose());
        }
      }
      if (element_.mean_dilatation) {
        const VolumetricSample u = material_.volumetric(changed / volume);
        out.force -= u.stress * dilation;
        out.block += u.stiffness / volume * dilation * dilation.transpose();
      }
    }
  }

  /// Largest part t ≤ 1 of a step of node v that leaves every det F about it above a tenth of what it is (det F is linear in one node).
  double feasible_part(int v, const Positions& x, const Vec3& step) const {
    double t = 1.0;
    for (const Incidence& in : at_[std::size_t(v)])
      for (int q = 0; q < Element::points; ++q) {
        const Mat3 f = deformation(in.tet, q, x);
        const double slope = (cofactor(f) * gradient(in.tet, q).col(in.place)).dot(step), J = f.determinant();
        if (J + t * slope < 0.1 * J) t = -0.9 * J / slope;
      }
    return t;
  }

  /// Smallest det F.
  double smallest_J(const Positions& x) const {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e)
      for (int q = 0; q < Element::points; ++q) least = std::min(least, deformation(int(e), q, x).determinant());
    return least;
  }

  const Material& material() const { return material_; }

  /// Where a node takes part: its tetrahedra, and which of their nodes it is.
  struct Incidence {
    int tet, place;
  };
  const std::vector<Incidence>& incidences(int v) const { return at_[std::size_t(v)]; }
  const typename ElementPoints<Element>::Gradients& gradient(int e, int q) const { return points_.gradient(std::size_t(e), q); }
  double weight(int e, int q) const { return points_.weight(std::size_t(e), q); }

 private:
  static constexpr int N = Element::nodes;

  Mat3 deformation(int e, int q, const Positions& x) const {
    Mat3 F = Mat3::Zero();
    for (int a = 0; a < N; ++a) F += x.col(mesh_->tets[std::size_t(e)][std::size_t(a)]) * gradient(e, q).col(a).transpose();
    return F;
  }

  // Σ gₖ A(i + 3k, j + 3l) gₗ
  static Mat3 contracted(const Mat9& A, const Vec3& g) {
    Eigen::Matrix<double, 9, 3> right = A.leftCols<3>() * g[0] + A.middleCols<3>(3) * g[1] + A.rightCols<3>() * g[2];
    return right.topRows<3>() * g[0] + right.middleRows<3>(3) * g[1] + right.bottomRows<3>() * g[2];
  }

  const TetMesh* mesh_;
  Material material_;
  Element element_;
  std::vector<std::vector<Incidence>> at_;
  ElementPoints<Element> points_;
};

}  // namespace lumo

// ---- lumo/mechanics/vertex_colors.hpp

namespace lumo {

/// Groups of nodes no two of which share a tetrahedron: each node takes the first group that is free, in the order of node numbers.
using VertexColors = std::vector<std::vector<int>>;

inline VertexColors color_vertices(const TetMesh& mesh) {
  const std::size_t per = std::size_t(mesh.nodes_per_tet());
  std::vector<std::vector<int>> tets_of(mesh.nodes.size());
  for (std::size_t e = 0; e < mesh.tets.size(); ++e)
    for (std::size_t a = 0; a < per; ++a) tets_of[std::size_t(mesh.tets[e][a])].push_back(int(e));
  VertexColors colors;
  std::vector<int> color(mesh.nodes.size(), -1), last_seen;
  for (std::size_t v = 0; v < mesh.nodes.size(); ++v) {
    for (int e : tets_of[v])
      for (std::size_t a = 0; a < per; ++a)
        if (const int c = color[std::size_t(mesh.tets[std::size_t(e)][a])]; c >= 0) last_seen[std::size_t(c)] = int(v);
    std::size_t free = 0;
    while (free < colors.size() && last_seen[free] == int(v)) ++free;
    if (free == colors.size()) colors.emplace_back(), last_seen.push_back(-1);
    color[v] = int(free);
    colors[free].push_back(int(v));
  }
  return colors;
}

/// Throws InvalidArgument unless every node is in one group and no two nodes of a group share a tetrahedron.
inline void validate(const VertexColors& colors, const TetMesh& mesh) {
  std::vector<int> color(mesh.nodes.size(), -1);
  for (std::size_t c = 0; c < colors.size(); ++c)
    for (int v : colors[c]) {
      if (v < 0 || std::size_t(v) >= mesh.nodes.size()) throw InvalidArgument(detail::text("color ", c, " names node ", v, " of ", mesh.nodes.size()));
      if (color[std::size_t(v)] >= 0) throw InvalidArgument(detail::text("node ", v, " has more than one color"));
      color[std::size_t(v)] = int(c);
    }
  for (std::size_t v = 0; v < color.size(); ++v)
    if (color[v] < 0) throw InvalidArgument(detail::text("node ", v, " has no color"));
  for (const auto& t : mesh.tets)
    for (int a = 0; a < mesh.nodes_per_tet(); ++a)
      for (int b = 0; b < a; ++b)
        if (color[std::size_t(t[std::size_t(a)])] == color[std::size_t(t[std::size_t(b)])])
          throw InvalidArgument(detail::text("nodes ", t[std::size_t(a)], " and ", t[std::size_t(b)], " of one tetrahedron have one color"));
}

}  // namespace lumo

// ---- lumo/mechanics/vertex_lanes.hpp

namespace lumo {

/// Elastic and viscous forces and blocks of eight vertices of one colour at once, on linear tetrahedra of a dilatational solid. What a
/// vertex's tetrahedra need lies in the order of use; vertices with as many tetrahedra go together.
template <DilatationalMaterial Material>
class VertexLanes {
 public:
  static constexpr std::size_t width = Lanes::width;

  /// Up to eight vertices of one colour; −1 where there is none.
  struct Batch {
    std::array<int, width> vertex;
    std::size_t first, count;   ///< their slots
  };
  /// Squares C = FᵀF at a step's start, per slot: 11, 22, 33, 12, 13, 23.
  using Start = std::vector<std::array<Lanes, 6>>;

  /// `colors` name the vertices that move.
  VertexLanes(const TetMesh& mesh, const VertexElasticity<Material, LinearTet>& elasticity, const VertexColors& colors);

  /// Batches color by color.
  const std::vector<std::vector<Batch>>& batches() const { return batches_; }
  std::size_t slots() const { return slots_.size(); }

  /// Squares of one batch at positions x, into their places in `start`.
  void remember(const Batch& batch, const Positions& x, Start& start) const;

  /// Adds the shares of a batch's vertices; see VertexElasticity::add. `start` is not looked at without viscosity.
  void add(const Batch& batch, const Positions& x, const Start& start, double rate, std::array<VertexBlock, width>& out) const;

  /// Largest part of each vertex's step that is safe; see VertexElasticity::feasible_part.
  std::array<double, width> feasible_parts(const Batch& batch, const Positions& x, const std::array<Vec3, width>& steps) const;

 private:
  // One tetrahedron of each of the batch's vertices: its three other nodes and the gradients of their shape functions.
  struct Slot {
    std::array<Lanes, 9> gradient;
    Lanes weight;
    Lanes area_scale;   // signed 1/(6 V): the opposite face's doubled area vector times it is the slope of det F by the vertex
    std::array<std::array<int, width>, 3> node;   // times three: where its x is
  };
  // Where a batch's vertices are.
  static std::array<Lanes, 3> places(const Batch& batch, const Positions& x);
  // From vertices at `self` to the slot's other nodes.
  using Edges = std::array<std::array<Lanes, 3>, 3>;
  [[gnu::always_inline]] static Edges edges(const std::array<Lanes, 3>& self, const Slot& slot, const Positions& x) {
    Edges e;
    for (std::size_t b = 0; b < 3; ++b)
      for (std::size_t i = 0; i < 3; ++i) e[b][i] = Lanes::gathered(x.data() + i, slot.node[b]) - self[i];
    return e;
  }
  // F, column by column.
  [[gnu::always_inline]] static std::array<Lanes, 9> deformation(const Edges& e, const Slot& slot) {
    std::array<Lanes, 9> F;
    for (std::size_t j = 0; j < 3; ++j)
      for (std::size_t i = 0; i < 3; ++i) F[i + 3 * j] = e[0][i] * slot.gradient[j] + e[1][i] * slot.gradient[3 + j] + e[2][i] * slot.gradient[6 + j];
    return F;
  }
  [[gnu::always_inline]] static std::array<Lanes, 6> squares(const std::array<Lanes, 9>& F) {
    const auto dot = [&](std::size_t i, std::size_t j) -> Lanes { return F[3 * i] * F[3 * j] + F[3 * i + 1] * F[3 * j + 1] + F[3 * i + 2] * F[3 * j + 2]; };
    return {dot(0, 0), dot(1, 1), dot(2, 2), dot(0, 1), dot(0, 2), dot(1, 2)};
  }
  // Gradient of the vertex's own shape function.
  static std::array<Lanes, 3> own_gradient(const Slot& slot) {
    std::array<Lanes, 3> g;
    for (std::size_t j = 0; j < 3; ++j) g[j] = -(slot.gradient[j] + slot.gradient[3 + j] + slot.gradient[6 + j]);
    return g;
  }
  // det F and its slope c by the vertex's place, cof F applied to its gradient: the doubled area vector of the opposite face.
  [[gnu::always_inline]] static Lanes dilation(const Edges& e, const Lanes& scale, std::array<Lanes, 3>& c) {
    std::array<Lanes, 3> a, b;
    for (std::size_t i = 0; i < 3; ++i) a[i] = e[1][i] - e[0][i], b[i] = e[2][i] - e[0][i];
    for (std::size_t i = 0; i < 3; ++i) c[i] = scale * (a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3]);
    return -(c[0] * e[0][0] + c[1] * e[0][1] + c[2] * e[0][2]);
  }

  Material material_;
  std::vector<std::vector<Batch>> batches_;
  std::vector<Slot> slots_;
};

template <DilatationalMaterial Material>
VertexLanes<Material>::VertexLanes(const TetMesh& mesh, const VertexElasticity<Material, LinearTet>& elasticity, const VertexColors& colors) : material_(elasticity.material()) {
  for (const std::vector<int>& color : colors) {
    std::vector<int> order = color;
    std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return elasticity.incidences(a).size() > elasticity.incidences(b).size(); });
    batches_.emplace_back();
    for (std::size_t begin = 0; begin < order.size(); begin += width) {
      Batch batch{{}, slots_.size(), elasticity.incidences(order[begin]).size()};
      for (std::size_t lane = 0; lane < width; ++lane) batch.vertex[lane] = begin + lane < order.size() ? order[begin + lane] : -1;
      for (std::size_t k = 0; k < batch.count; ++k) {
        Slot slot;
        for (std::size_t lane = 0; lane < width; ++lane) {
          // What is missing repeats something sound without weight, so that no lane makes NaN.
          const int v = batch.vertex[lane] >= 0 ? batch.vertex[lane] : order[begin];
          const auto& at = elasticity.incidences(v);
          const bool real = batch.vertex[lane] >= 0 && k < at.size();
          const auto& in = at[std::min(k, at.size() - 1)];
          const auto& g = elasticity.gradient(in.tet, 0);
          std::array<Vec3, 3> at_rest;
          for (int b = 0, other = 0; b < 4; ++b) {
            if (b == in.place) continue;
            at_rest[std::size_t(other)] = mesh.nodes[std::size_t(mesh.tets[std::size_t(in.tet)][std::size_t(b)])];
            slot.node[std::size_t(other)][lane] = 3 * mesh.tets[std::size_t(in.tet)][std::size_t(b)];
            for (int c = 0; c < 3; ++c) slot.gradient[std::size_t(3 * other + c)].set(lane, g(c, b));
            ++other;
          }
          const Vec3 area = (at_rest[1] - at_rest[0]).cross(at_rest[2] - at_rest[0]);
          slot.area_scale.set(lane, area.dot(g.col(in.place)) / area.squaredNorm());   // at rest the slope is the vertex's own gradient
          slot.weight.set(lane, real ? elasticity.weight(in.tet, 0) : 0.0);
        }
        slots_.push_back(slot);
      }
      for (std::size_t lane = 0; lane < width; ++lane)
        if (batch.vertex[lane] < 0) batch.vertex[lane] = -1 - order[begin];   // its place is read, and no other's
      batches_.back().push_back(batch);
    }
  }
}

template <DilatationalMaterial Material>
std::array<Lanes, 3> VertexLanes<Material>::places(const Batch& batch, const Positions& x) {
  std::array<Lanes, 3> self;
  for (std::size_t lane = 0; lane < width; ++lane) {
    const int v = batch.vertex[lane] < 0 ? -1 - batch.vertex[lane] : batch.vertex[lane];
    for (std::size_t c = 0; c < 3; ++c) self[c].set(lane, x.data()[3 * std::size_t(v) + c]);
  }
  return self;
}

template <DilatationalMaterial Material>
std::array<double, VertexLanes<Material>::width> VertexLanes<Material>::feasible_parts(const Batch& batch, const Positions& x,
                                                                                       const std::array<Vec3, width>& steps) const {
  std::array<double, width> part;
  part.fill(1.0);
  std::array<Lanes, 3> step;
  for (std::size_t lane = 0; lane < width; ++lane)
    for (std::size_t i = 0; i < 3; ++i) step[i].set(lane, steps[lane][Eigen::Index(i)]);
  const std::array<Lanes, 3> self = places(batch, x);
  for (std::size_t k = batch.first; k < batch.first + batch.count; ++k) {
    std::array<Lanes, 3> c;
    const Lanes J = dilation(edges(self, slots_[k], x), slots_[k].area_scale, c);
    const Lanes slope = c[0] * step[0] + c[1] * step[1] + c[2] * step[2];
    for (std::size_t lane = 0; lane < width; ++lane)
      if (J[lane] + part[lane] * slope[lane] < 0.1 * J[lane]) part[lane] = -0.9 * J[lane] / slope[lane];
  }
  return part;
}

template <DilatationalMaterial Material>
void VertexLanes<Material>::remember(const Batch& batch, const Positions& x, Start& start) const {
  const std::array<Lanes, 3> self = places(batch, x);
  for (std::size_t k = batch.first; k < batch.first + batch.count; ++k) start[k] = squares(deformation(edges(self, slots_[k], x), slots_[k]));
}

template <DilatationalMaterial Material>
void VertexLanes<Material>::add(const Batch& batch, const Positions& x, const Start& start, double rate, std::array<VertexBlock, width>& out) const {
  const double mu = material_.shear_modulus();
  std::array<Lanes, 3> force;
  std::array<Lanes, 6> block;   // 11, 22, 33, 12, 13, 23
  const std::array<Lanes, 3> self = places(batch, x);
  static constexpr std::size_t row[6] = {0, 1, 2, 0, 0, 1}, column[6] = {0, 1, 2, 1, 2, 2};
  for (std::size_t k = batch.first; k < batch.first + batch.count; ++k) {
    const Slot& slot = slots_[k];
    const Edges e = edges(self, slot, x);
    const std::array<Lanes, 9> F = deformation(e, slot);
    const std::array<Lanes, 3> g = own_gradient(slot);
    std::array<Lanes, 3> Fg, c;
    for (std::size_t i = 0; i < 3; ++i) Fg[i] = F[i] * g[0] + F[i + 3] * g[1] + F[i + 6] * g[2];
    const DilatationSample<Lanes> h = material_.dilatation(dilation(e, slot.area_scale, c));
    const Lanes square = g[0] * g[0] + g[1] * g[1] + g[2] * g[2];
    const Lanes push = slot.weight * h.stress, stretch = mu * slot.weight, bulk = slot.weight * h.stiffness;
    for (std::size_t i = 0; i < 3; ++i) {
      force[i] -= stretch * Fg[i] + push * c[i];
      block[i] += stretch * square;
    }
    for (std::size_t m = 0; m < 6; ++m) block[m] += bulk * c[row[m]] * c[column[m]];
    if (rate > 0.0) {
      std::array<Lanes, 6> change = squares(F);
      for (std::size_t m = 0; m < 6; ++m) change[m] -= start[k][m];
      const Lanes w = (2.0 * rate) * slot.weight;
      const std::array<Lanes, 3> d = {change[0] * g[0] + change[3] * g[1] + change[4] * g[2], change[3] * g[0] + change[1] * g[1] + change[5] * g[2],
                                      change[4] * g[0] + change[5] * g[1] + change[2] * g[2]};
      for (std::size_t i = 0; i < 3; ++i) force[i] -= w * (F[i] * d[0] + F[i + 3] * d[1] + F[i + 6] * d[2]);
      for (std::size_t m = 0; m < 6; ++m) {
        const std::size_t i = row[m], j = column[m];
        block[m] += w * (square * (F[i] * F[j] + F[i + 3] * F[j + 3] + F[i + 6] * F[j + 6]) + Fg[i] * Fg[j]);
      }
    }
  }
  for (std::size_t lane = 0; lane < width; ++lane) {
    out[lane].force += Vec3(force[0][lane], force[1][lane], force[2][lane]);
    for (std::size_t m = 0; m < 6; ++m) {
      out[lane].block(Eigen::Index(row[m]), Eigen::Index(column[m])) += block[m][lane];
      if (m > 2) out[lane].block(Eigen::Index(column[m]), Eigen::Index(row[m])) += block[m][lane];
    }
  }
}

}  // namespace lumo

// ---- lumo/mechanics/descent_model.hpp

namespace lumo {

/// Where the sweeps of a time step begin.
enum class Predictor {
  position,       ///< where the last step ended
  inertia,        ///< as if nothing held it: x + v Δt, as Newton 1.8 does
  acceleration    ///< as if the last step's acceleration went on: x + v Δt + a Δt² (Chen et al. 2024, without their clamp to gravity)
};

/// Settings of vertex block descent; the defaults are the paper's.
struct DescentConfig {
  double time_step_s = 0.01;
  int sweeps = 10;                        ///< per time step
  Predictor predictor = Predictor::inertia;
  double density_kg_per_m3 = 1070.0;      ///< Dragon Skin
  double viscosity_Pa_s = 10.0;           ///< η on the rate of C = FᵀF
  double speed_m_per_s = 5e-3;            ///< of the indenter's advance
  double hold_s = 1.0;                    ///< at each load
  double slip_speed_m_per_s = 1e-2;       ///< below it friction is smooth
  double detection_m = 1e-3;              ///< points nearer than this at a step's start are watched during the step
  double max_advance_m = 20e-3;           ///< a load that is not met by then is given up
  double time_limit_s = 1e9;              ///< per scenario, wall clock
  bool lanes = true;                      ///< eight vertices of a color at once, where material and element allow it
  VertexColors colors = {};               ///< empty: color_vertices
};

/// Throws InvalidArgument for settings out of range.
inline void validate(const DescentConfig& c) {
  require_in_range("time step", c.time_step_s, 1e-6, 1.0, "s");
  require_in_range("sweeps", c.sweeps, 1, 1e6, "");
  require_in_range("density", c.density_kg_per_m3, 1.0, 1e5, "kg/m3");
  require_in_range("viscosity", c.viscosity_Pa_s, 0.0, 1e6, "Pa s");
  require_in_range("speed of the indenter", c.speed_m_per_s * 1e3, 1e-3, 1e3, "mm/s");
  require_in_range("time of a hold", c.hold_s, 0.0, 1e3, "s");
  require_in_range("slip speed", c.slip_speed_m_per_s, 1e-9, 1e3, "m/s");
  require_in_range("distance at which contact is watched", c.detection_m * 1e3, 1e-3, 100.0, "mm");
  require_in_range("largest advance", c.max_advance_m * 1e3, 1e-3, 1e3, "mm");
}

/// All that does not change between scenarios on one mesh: masses, colors, elements, surfaces.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element>
struct DescentModel {
  static constexpr bool batched = DilatationalMaterial<Material> && std::same_as<Element, LinearTet>;

  Sector sector;
  Contact contact;
  VertexElasticity<Material, Element> elasticity;
  ContactSurface touchable;          ///< against the indenter
  ContactSurface resting;            ///< against the carrier
  Carrier carrier;
  std::vector<double> mass;          ///< per node [kg]
  std::vector<char> moves;           ///< per node: it is not bonded
  VertexColors colors;               ///< of the nodes that move
  bool resists_inversion;            ///< the material's energy has no bound where J ≤ 0

  struct NoLanes {};
  static auto lanes_type() {
    if constexpr (batched) return std::optional<VertexLanes<Material>>();
    else return std::optional<NoLanes>();
  }
  static auto squares_type() {
    if constexpr (batched) return typename VertexLanes<Material>::Start();
    else return NoLanes();
  }
  using Squares = decltype(squares_type());
  decltype(lanes_type()) lanes;

  /// Throws InvalidArgument when the given colors are none.
  DescentModel(const Body& body, const TetMesh& mesh, Symmetry planes, const Material& material, const Contact& law, const Element& element, const DescentConfig& config)
      : sector(sector_of(mesh, planes)), contact(law), elasticity(sector.mesh, material, element),
        touchable(sector.mesh, body, [](const Patch& p) { return p.contactable; }, law),
        resting(sector.mesh, body, [](const Patch& p) { return p.meets_carrier; }, law), carrier{body.carrier},
        mass(lumped_masses<Element>(sector.mesh, config.density_kg_per_m3)), moves(sector.mesh.nodes.size(), 1),
        resists_inversion(!std::isfinite(energy_density(material, Mat3(-Mat3::Identity())))) {
    for (const BoundaryFace& f : sector.mesh.faces)
      if (body.patches[std::size_t(f.patch)].bonded)
        for (int k = 0; k < sector.mesh.nodes_per_face(); ++k) moves[std::size_t(f.nodes[std::size_t(k)])] = 0;
    const VertexColors all = config.colors.empty() ? color_vertices(sector.mesh) : config.colors;
    validate(all, sector.mesh);
    for (const std::vector<int>& color : all) {
      colors.emplace_back();
      for (int v : color)
        if (moves[std::size_t(v)]) colors.back().push_back(v);
    }
    if constexpr (batched)
      if (config.lanes) lanes.emplace(sector.mesh, elasticity, colors);
  }
  DescentModel(const DescentModel&) = delete;  // elements and surfaces point into the sector's mesh
  DescentModel& operator=(const DescentModel&) = delete;
};

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
template <class Vec3 = Vec3>
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
template <class Vec3 = Vec3>
inline std::optional<double> distance_to_edge(const std::vector<EdgeSample>& samples, In<Vec3> p) {
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
        c.pressure_Pa[node] += p.weight_m2 * p.hat[k] * contact.respond(g).pressure;
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

// ---- lumo/mechanics/friction.hpp

namespace lumo {

/// Friction on the body's nodes [N], and what of its reaction pushes the indenter back along its way.
struct FrictionForces {
  std::vector<Vec3> on_nodes;   ///< per mesh node; empty: none
  double push_N = 0.0;
};

/// Coulomb friction that remembers: a point of the surface sticks by a stiff spring along the rigid surface until the spring's force is the
/// coefficient times the pressure, and then slides with it. The spring's stretch is carried from one equilibrium to the next.
/// Source: Wriggers 2006, §5.2 (regularised Coulomb law, return mapping).
struct FrictionHistory {
  double coefficient = 0.0;
  double stiffness_N_per_m3 = 0.0;             ///< of the spring
  double turning = 1.0;                        ///< 1: a sliding point's stiffness is its force's slope; 0: the secant, with which far starts do not cycle
  Vec3 origin = Vec3::Zero();                  ///< of the rigid thing's frame at the last equilibrium [m]
  std::vector<std::vector<Vec3>> place;        ///< of each surface point there, face by face [m]
  std::vector<std::vector<Vec3>> stretch;      ///< of its spring there [m]

  /// Everything unstretched at positions x. The spring is a tenth as stiff as the law's penalty: it stretches by ten overlaps times the coefficient.
  template <ContactHandler Contact>
  FrictionHistory(const ContactSurface& surface, const Contact& law, const Positions& x, const Vec3& rigid_origin)
      : coefficient(friction_coefficient(law)), stiffness_N_per_m3(0.1 * law.stiffness_N_per_m3), origin(rigid_origin), place(surface.size()), stretch(surface.size()) {
    if (coefficient == 0.0) return;
    for (std::size_t f = 0; f < surface.size(); ++f)
      for (const SurfacePoint& p : surface.points(f)) {
        place[f].push_back(surface.position(f, p, x));
        stretch[f].push_back(Vec3::Zero());
      }
  }

  /// Traction [Pa] on the body at a point in contact, its stiffness [N/m³] at constant pressure, and the spring's stretch [m].
  struct Answer {
    Vec3 traction;
    Mat3 stiffness;
    Vec3 stretch;
  };
  template <class Vec3 = Vec3, class Mat3 = Mat3>
  Answer answer(std::size_t face, std::size_t point, In<Vec3> at, In<Vec3> rigid_origin, In<Vec3> normal, double pressure) const {
    const Mat3 along = Mat3::Identity() - normal * normal.transpose();
    const Vec3 s = along * (stretch[face][point] + (at - place[face][point]) - (rigid_origin - origin));
    const double length = s.norm(), most = coefficient * std::max(pressure, 0.0) / stiffness_N_per_m3;
    if (length <= most) return {-stiffness_N_per_m3 * s, stiffness_N_per_m3 * along, s};
    const Vec3 way = s / length;
    return {-stiffness_N_per_m3 * most * way, stiffness_N_per_m3 * most / length * (along - turning * way * way.transpose()), most * way};
  }

  /// Makes the equilibrium at positions x, with the rigid thing as it is now, the last one. Points out of contact let go.
  template <ContactHandler Contact, class Tool>
  void settle(const ContactSurface& surface, const Contact& law, const Moving<Tool>& rigid, const Positions& x) {
    if (coefficient == 0.0) return;
    for (std::size_t f = 0; f < surface.size(); ++f)
      for (std::size_t k = 0; k < surface.points(f).size(); ++k) {
        const Vec3 at = surface.position(f, surface.points(f)[k], x);
        const DistanceSample d = rigid.sample(at);
        stretch[f][k] = d.distance < 0.0 ? answer(f, k, at, rigid.origin, d.gradient, law.respond(d.distance).pressure).stretch : Vec3(Vec3::Zero());
      }
    for (std::size_t f = 0; f < surface.size(); ++f)
      for (std::size_t k = 0; k < surface.points(f).size(); ++k) place[f][k] = surface.position(f, surface.points(f)[k], x);
    origin = rigid.origin;
  }

  /// Adds friction on the body's nodes [N] at positions x; returns their sum.
  template <ContactHandler Contact, class Tool>
  Vec3 add_nodal_forces(const ContactSurface& surface, const Contact& law, const Moving<Tool>& rigid, const Positions& x, std::vector<Vec3>& on_nodes) const {
    Vec3 sum = Vec3::Zero();
    for (std::size_t f = 0; f < surface.size() && coefficient > 0.0; ++f)
      for (std::size_t k = 0; k < surface.points(f).size(); ++k) {
        const SurfacePoint& p = surface.points(f)[k];
        const Vec3 at = surface.position(f, p, x);
        const DistanceSample d = rigid.sample(at);
        if (d.distance >= 0.0) continue;
        const Vec3 force = p.weight_m2 * answer(f, k, at, rigid.origin, d.gradient, law.respond(d.distance).pressure).traction;
        for (std::size_t n = 0; n < std::size_t(surface.nodes_per_face()); ++n) on_nodes[std::size_t(surface.face(f).nodes[n])] += p.shape[n] * force;
        sum += force;
      }
    return sum;
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
        touchable(sector.mesh, b, [](const Patch& p) { return p.contactable; }, c),
        resting(sector.mesh, b, [](const Patch& p) { return p.meets_carrier; }, c), carrier{b.carrier} {
    blocks.reserve(4);
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
  const FrictionHistory* touch_friction = nullptr;   ///< with the indenter
  const FrictionHistory* rest_friction = nullptr;    ///< with the carrier

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

  /// Out-of-balance forces on the free equations and, last, on the indenter: push − load.
  Eigen::VectorXd residual(const Positions& x, double advance, double load, const Equations& eq, const Seen* seen = nullptr) const {
    Positions f = Positions::Zero(3, x.cols());
    model.solid.add_forces(x, f, seen ? &seen->ratios : nullptr);
    const ContactSums touch = add_contact_forces(model.touchable, contact(), indenter(advance), x, &f, seen ? &seen->touch : nullptr, touch_friction);
    add_contact_forces(model.resting, contact(), support(), x, &f, seen ? &seen->rest : nullptr, rest_friction);
    Eigen::VectorXd r(eq.count + 1);
    for (std::size_t i = 0; i < eq.of.size(); ++i)
      if (eq.of[i] >= 0) r[eq.of[i]] = f.data()[i];
    r[eq.count] = touch.push_N - load;
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
                                                seen ? &seen->touch : nullptr, touch_friction);
      if (even) t.stiffness = s.push_stiffness;
      add_contact_tangent(model.resting, contact(), support(), x, *systems[k], values[k], nullptr, seen ? &seen->rest : nullptr, rest_friction);
    }
  }

  /// x moved by a field of the given equations.
  static void move(Positions& x, const Equations& eq, const Eigen::VectorXd& by, double factor) {
    for (std::size_t i = 0; i < eq.of.size(); ++i)
      if (eq.of[i] >= 0) x.data()[i] += factor * by[eq.of[i]];
  }
};

}  // namespace lumo

// ---- lumo/mechanics/secant_pairs.hpp

namespace lumo {

/// What the steps with a kept factor have shown of a symmetric, positive definite tangent since it was made: the BFGS correction of the factor's inverse
/// (Matthies, Strang 1979, doi:10.1002/nme.1620141104), applied by Nocedal's two loops (1980, doi:10.1090/S0025-5718-1980-0572855-7).
class SecantPairs {
 public:
  void clear() { pairs_.clear(); }

  /// A step with the change of the residual that came with it; of equal sizes. Without effect where the residual did not grow along the step beyond
  /// rounding: the corrected inverse stays positive definite.
  void add(Eigen::VectorXd step, Eigen::VectorXd change) {
    const double curvature = step.dot(change);
    if (curvature > 1e-12 * step.norm() * change.norm()) pairs_.push_back({std::move(step), std::move(change), 1.0 / curvature});
  }

  /// Solution of the corrected system, where `factor` is that of the kept one: a function of a vector.
  template <class Factor, class VectorXd = Eigen::VectorXd>
  VectorXd solve(std::type_identity_t<VectorXd> residual, Factor&& factor) const {
    std::vector<double> along(pairs_.size());
    for (std::size_t k = pairs_.size(); k-- > 0;) {
      along[k] = pairs_[k].scale * pairs_[k].step.dot(residual);
      residual -= along[k] * pairs_[k].change;
    }
    VectorXd solution = factor(residual);
    for (std::size_t k = 0; k < pairs_.size(); ++k) solution += (along[k] - pairs_[k].scale * pairs_[k].change.dot(solution)) * pairs_[k].step;
    return solution;
  }

 private:
  struct Pair {
    Eigen::VectorXd step, change;
    double scale;   ///< 1 / (step · change)
  };
  std::vector<Pair> pairs_;
};

}  // namespace lumo

// ---- lumo/mechanics/status.hpp

namespace lumo {

/// How a solve ended. Only `converged` is scored (and `held` where a problem says so).
enum class Status {
  converged,               ///< equilibrium, residual certified, stable
  held,                    ///< a dynamic solver ran its sweeps; no statement about equilibrium
  max_iterations,          ///< residual still too large after the allowed iterations
  line_search,             ///< even the shortest step leaves an element less than a fifth of its volume by the solver's prediction: it is crushed, or flattened
  inverted,                ///< an element is turned inside out
  not_positive_definite,   ///< equilibrium, but unstable: the body would buckle away from it
  non_finite,              ///< NaN or infinity in the state or in a factor
  time_limit               ///< stopped by the caller's time limit
};

/// Whether objectives may rest on a state that ended so. `accept_held`: the problem says that it is about held states (the paper's mechanics).
constexpr bool is_scored(Status s, bool accept_held = false) { return s == Status::converged || (accept_held && s == Status::held); }

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
  bool certified = false;                    ///< equilibrium, found so by an independent routine; never of a state that is only held
  double force_N = 0.0;                      ///< contact wrench · (−direction)
  double met_force_N = 0.0;                  ///< the force when a solver that goes in time stopped the advance, before the hold
  double depth_m = 0.0;                      ///< advance since first touch of the exact undeformed profile
  std::vector<Vec3> displacement;            ///< per mesh node [m]
  /// Contact field per mesh node: > 0 in contact with the indenter, < 0 outside; −infinity on nodes that it cannot touch.
  /// Linear on the sub-facets of the surface (corners and edge middles); the contact set is {φ > 0}.
  std::vector<double> contact_field;
  std::vector<Vec3> friction_N;              ///< friction on the body per mesh node; empty without
  double friction_push_N = 0.0;              ///< what of it is in force_N
  std::vector<double> pressure_Pa;           ///< indenter pressure per mesh node, per reference area; 0 off the surface
  double contact_area_m2 = 0.0;              ///< A(C; X), deformed
  double reference_area_m2 = 0.0;            ///< A_0(C), undeformed
  double residual_N = std::numeric_limits<double>::infinity();  ///< norm of the out-of-balance forces, from an independent routine
  double penetration_m = 0.0;                ///< largest overlap of surface and indenter
  int iterations = 0;                        ///< Newton steps, or sweeps, spent on this load
};

}  // namespace lumo

// ---- lumo/mechanics/quasi_static.hpp

namespace lumo {

/// Settings of the quasi-static solver.
struct QuasiStaticConfig {
  double residual_tolerance = 1e-7;   ///< of the load
  int max_iterations = 200;           ///< factorisations per load
  int stride_iterations = 40;         ///< factorisations before a stride is cut
  double chord_contraction = 0.02;    ///< a kept factor must shrink the residual by this factor per step
  double late_contraction = 0.8;      ///< by this one, when the residual is below 1 % of the load: a step costs a tenth of a factor
  double load_stride = 1.6;           ///< loads in between are at most this factor apart
  double max_advance = 0.2;           ///< largest advance in one step, in radii of the indenter's contact
  double time_limit_s = 1e9;          ///< per scenario, wall clock
};

/// Static equilibrium at prescribed loads: the indenter's advance is an unknown, so that each load is met exactly (model: solver policy
/// "quasi-static"). Newton's method on energy(x, s) − F s, load by load along 0 → F₁ → F₂ ….
///
/// The stiff parts of the energy, volume change and contact, are linearised about values that are carried on *linearly* by each step
/// (volume ratios θ, gaps γ) instead of those that the moved nodes happen to have: a step's second-order errors in volume then make no
/// spurious pressure, the tangent stays positive definite, and contact points change sides by what the step meant. This is Newton's method
/// for the mixed problem with θ and γ eliminated; its solution is that of the plain one (Magisano, Leonetti, Garcea 2017 for stresses;
/// Hintermüller, Ito, Kunisch 2002 for contact). A factor is used again, corrected by what its steps show (SecantPairs), as long as it contracts.
///
/// A set of contact points that is too large loses its rim ring by ring, one factorisation each. So every stride starts from a good guess of
/// it: the points with the smallest gaps on the area that Hertz's formula gives for the first load, and on the last area × (load/last)^0.6
/// after that. Where the tangent is lost on the way, the load is approached again from the last one, in smaller strides that end closer to
/// equilibrium.
///
/// With friction the residual is that of Coulomb's law and the tangent leaves out how friction grows with pressure, so that it stays symmetric:
/// convergence is linear, and states depend on the strides that lead to them.
///
/// At each load the unshifted tangent of the *whole* body must be positive definite, fields that break the scenario's symmetry included;
/// otherwise the status says so.
template <LinearSolver Linear = EigenCholesky>
struct QuasiStatic {
  template <class Material, class Contact, class Element>
  using Model = SectorModel<Material, Contact, Element, Linear>;
  using Config = QuasiStaticConfig;
  static constexpr bool uses_symmetry = true;
  Config config = {};

  template <class Material, class Contact, class Element>
  std::unique_ptr<Model<Material, Contact, Element>> model(const Body& body, const TetMesh& mesh, Symmetry planes, const Material& material, const Contact& contact,
                                                           const Element& element) const {
    return std::make_unique<Model<Material, Contact, Element>>(body, mesh, planes, material, contact, element);
  }

  /// States at the scenario's loads, displacements on the sector's nodes; after the first that is not converged no further one is tried
  /// (it carries the reason).
  template <class SomeModel, Indenter Tool>
  std::vector<MechanicalState> run(const SomeModel& model, const Scenario<Tool>& scenario, const Touch& touch) const;
};

namespace detail {

template <class Model, Indenter Tool>
class QuasiStaticRun {
 public:
  QuasiStaticRun(const Model& model, const Scenario<Tool>& scenario, const Touch& touch, const QuasiStaticConfig& config)
      : config_(config), model_(model), system_{model, scenario.indenter, touch.origin, scenario.direction()},
        eq_(model.blocks.front().equations), now_{positions_of(model.sector.mesh), 0.0},
        touched_(model.touchable, model.contact, now_.x, touch.origin), rested_(model.resting, model.contact, now_.x, Vec3::Zero()),
        deadline_(std::chrono::steady_clock::now() + std::chrono::duration_cast<std::chrono::steady_clock::duration>(
                                                         std::chrono::duration<double>(std::min(config.time_limit_s, 1e6)))) {
    linear_.reserve(model.blocks.size());
    for (const auto& block : model.blocks) linear_.push_back(block.analysed);
  }

  /// Equilibrium at `load` (the sector's share), from where the last call ended.
  Status solve(double load) {
    iterations = 0;
    if (load_ == 0.0 && !(model_.solid.smallest_volume() > 0.0)) return Status::inverted;
    const typename System::Place start = now_;
    const FrictionHistory touched_before = touched_, rested_before = rested_;
    const double from = load_;
    double first = std::min(load, largest_first_load()), stride = config_.load_stride, on_the_way = loose;
    for (int cuts = 0; load_ != load;) {
      const double next = load_ == 0.0 ? first : stride_end(load, stride), tolerance = next == load ? config_.residual_tolerance : on_the_way;
      const Status s = load_ == 0.0 ? touch_down(next, tolerance) : approach(next, tolerance, touched_area() * std::pow(next / load_, 0.6));
      if (s == Status::converged) {
        load_ = next;
        touched_.settle(model_.touchable, model_.contact, system_.indenter(now_.advance), now_.x);
        rested_.settle(model_.resting, model_.contact, system_.support(), now_.x);
        continue;
      }
      const bool lost = s == Status::not_positive_definite || s == Status::inverted || s == Status::line_search || s == Status::max_iterations;
      if (!lost || ++cuts > 5 || iterations >= config_.max_iterations) return s;
      now_ = start, touched_ = touched_before, rested_ = rested_before, load_ = from;   // what was reached loosely on the way may be what led astray
      first /= 4.0;
      stride = std::sqrt(stride);
      on_the_way = close;
    }
    return certify_stability();
  }

  const Positions& positions() const { return now_.x; }
  double advance() const { return now_.advance; }
  /// Friction on the sector's nodes as parts of the whole body's, and the whole's push against the advance.
  FrictionForces friction() const;
  int iterations = 0;

 private:
  using System = PressSystem<Model, Tool>;
  static constexpr double loose = 0.3, close = 1e-3;   ///< residual over load at which a stride on the way may end, at first and after a loss
  static constexpr double settled = 1e-2;              ///< residual over load below which points seldom come and go, or change between sticking and sliding

  /// Hertz's load for a contact half as wide as the indenter, on a half-space that keeps its volume.
  double largest_first_load() const { return model_.sector.fraction() * model_.solid.material().shear_modulus() * 2.0 / 3.0 * std::pow(contact_radius(system_.tool), 2); }
  double hertz_area(double load) const {
    const double share = model_.sector.fraction(), whole = load / share;
    return share * pi * std::pow(3.0 * whole * contact_radius(system_.tool) / (16.0 * model_.solid.material().shear_modulus()), 2.0 / 3.0);
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
    if (touched_.coefficient > 0.0) system_.touch_friction = &touched_, system_.rest_friction = &rested_;
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
    Eigen::VectorXd before;   // residual at the start of the last step; none before the first factor
    for (const int stop = iterations + config_.stride_iterations;;) {
      Eigen::VectorXd r = system_.residual(now_.x, now_.advance, load, eq_, &seen);
      const double unbalanced = r.norm();
      const bool nearly_there = unbalanced < settled * load;
      if (!std::isfinite(unbalanced)) return Status::non_finite;
      // The plain residual is what counts; it is looked at when the linearised one is small.
      if (unbalanced <= tolerance * load && system_.residual(now_.x, now_.advance, load, eq_).norm() <= tolerance * load) return Status::converged;
      if (std::chrono::steady_clock::now() > deadline_) return Status::time_limit;
      if (before.size() > 0 && unbalanced <= (nearly_there ? config_.late_contraction : config_.chord_contraction) * before.norm()) {
        steps_.add(std::move(last_step_), r - before);
      } else {
        if (iterations >= std::min(stop, config_.max_iterations)) return Status::max_iterations;
        ++iterations;
        touched_.turning = rested_.turning = nearly_there ? 1.0 : 0.0;
        system_.tangent(now_.x, now_.advance, 0, 1, tangent_, &seen);
        const FactorStatus f = linear_.front().factorize(tangent_.matrix.front());
        if (f != FactorStatus::positive_definite) return f == FactorStatus::non_finite ? Status::non_finite : Status::not_positive_definite;
        if (!border()) return Status::not_positive_definite;
        factored_ = now_;
        steps_.clear();
      }
      if (const Status s = step(r, seen); s != Status::converged) return s;
      before = std::move(r);
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
    response_ = linear_.front().solve(tangent_.coupling);
    schur_ = tangent_.stiffness - tangent_.coupling.dot(response_);
    return std::isfinite(schur_) && schur_ > 0.0;
  }

  // Solution with the last factor for all equations, the advance's included.
  Eigen::VectorXd solve_factored(const Eigen::VectorXd& r) {
    Eigen::VectorXd d(r.size());
    const Eigen::VectorXd z = linear_.front().solve(r.head(eq_.count));
    d[eq_.count] = (r[eq_.count] - tangent_.coupling.dot(z)) / schur_;
    d.head(eq_.count) = z - d[eq_.count] * response_;
    return d;
  }

  // A full step unless the indenter would jump, an element would be turned inside out, or lose most of the volume that is predicted for it.
  // What refuses even the shortest step says why there is none.
  Status step(const Eigen::VectorXd& r, typename System::Seen& seen) {
    const Eigen::VectorXd d = -steps_.solve(r, [&](const Eigen::VectorXd& rest) { return solve_factored(rest); });
    if (!d.allFinite()) return Status::non_finite;
    const double ds = d[eq_.count];
    const double now = model_.solid.smallest_J(now_.x);
    double t = std::min(1.0, config_.max_advance * contact_radius(system_.tool) / std::max(std::abs(ds), 1e-300));
    Positions dx = Positions::Zero(3, now_.x.cols());
    System::move(dx, eq_, d, 1.0);
    Status refusal = Status::inverted;
    for (int k = 0; k < 20; ++k, t *= 0.5) {
      const Positions trial = now_.x + t * dx;
      refusal = Status::inverted;
      if (!(model_.solid.smallest_J(trial) > 0.2 * now)) continue;
      refusal = Status::line_search;
      auto next = system_.predicted(now_, factored_, t * dx, t * ds);
      if (!(*std::min_element(next.ratios.begin(), next.ratios.end()) > 0.2)) continue;
      enter(next.touch, seen.touch);
      enter(next.rest, seen.rest);
      seen = std::move(next);
      now_.x = trial;
      now_.advance += t * ds;
      last_step_ = t * d;
      return Status::converged;
    }
    return refusal;
  }

  // Tangents of all parities at the state that was reached.
  Status certify_stability() {
    typename System::Tangent t;
    system_.tangent(now_.x, now_.advance, 0, model_.blocks.size(), t);
    for (std::size_t b = 0; b < model_.blocks.size(); ++b) {
      const FactorStatus f = linear_[b].factorize(t.matrix[b]);
      if (f != FactorStatus::positive_definite) return f == FactorStatus::non_finite ? Status::non_finite : Status::not_positive_definite;
      if (b > 0) continue;   // the advance moves with the even fields only
      const double stiffness = t.stiffness - t.coupling.dot(Eigen::VectorXd(linear_[b].solve(t.coupling)));
      if (!(stiffness > 0.0)) return std::isfinite(stiffness) ? Status::not_positive_definite : Status::non_finite;
    }
    return Status::converged;
  }

  QuasiStaticConfig config_;
  const Model& model_;
  System system_;
  const Equations& eq_;
  std::vector<std::decay_t<decltype(std::declval<Model>().blocks.front().analysed)>> linear_;   // by parity; the first one's factor is that of the steps
  typename System::Place now_, factored_;   // where we are, and where the factor was made
  FrictionHistory touched_, rested_;        // at the end of the last stride
  std::chrono::steady_clock::time_point deadline_;
  typename System::Tangent tangent_;
  Eigen::VectorXd response_;   // K⁻¹ k
  double schur_ = 0.0;
  SecantPairs steps_;          // with that factor
  Eigen::VectorXd last_step_;
  double load_ = 0.0;          // last one that was reached
};

template <class Model, Indenter Tool>
FrictionForces QuasiStaticRun<Model, Tool>::friction() const {
  FrictionForces out;
  if (touched_.coefficient == 0.0) return out;
  const Sector& sector = model_.sector;
  out.on_nodes.assign(sector.mesh.nodes.size(), Vec3::Zero());
  rested_.add_nodal_forces(model_.resting, model_.contact, system_.support(), now_.x, out.on_nodes);
  out.push_N = touched_.add_nodal_forces(model_.touchable, model_.contact, system_.indenter(now_.advance), now_.x, out.on_nodes).dot(system_.direction) / sector.fraction();
  for (std::size_t k = 0; k < out.on_nodes.size(); ++k)   // nodes in a bounding plane have as much on the other side
    for (int axis = 0; axis < 2; ++axis)
      if ((axis == 0 ? sector.planes.x : sector.planes.y) && sector.mesh.nodes[k][axis] == 0.0) {
        out.on_nodes[k] *= 2.0;
        out.on_nodes[k][axis] = 0.0;
      }
  return out;
}

}  // namespace detail

template <LinearSolver Linear>
template <class SomeModel, Indenter Tool>
std::vector<MechanicalState> QuasiStatic<Linear>::run(const SomeModel& model, const Scenario<Tool>& scenario, const Touch& touch) const {
  detail::QuasiStaticRun<SomeModel, Tool> path(model, scenario, touch, config);
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
    FrictionForces friction = path.friction();
    state.friction_N = std::move(friction.on_nodes);
    state.friction_push_N = friction.push_N;
    states.push_back(std::move(state));
    if (states.back().status != Status::converged) break;
  }
  return states;
}

}  // namespace lumo

// ---- lumo/mechanics/press_solver.hpp

namespace lumo {

/// How the states under a scenario's loads are found. model() makes what scenarios on one mesh share, for a sector of it where the solver
/// `uses_symmetry`; run() gives one state per load, displacements on the sector's nodes, up to the first that fails.
/// Laws: same input, same bits, also side by side; a state is `converged` or `held` or says why not; run() changes nothing in the model.
template <class S, class Material, class Contact, class Element>
concept PressSolver = std::copyable<S> && requires(const S& solver, const Body& body, const TetMesh& mesh, Symmetry planes, const Material& material,
                                                   const Contact& contact, const Element& element,
                                                   const typename S::template Model<Material, Contact, Element>& model, const Scenario<Sphere>& scenario, const Touch& touch) {
  { S::uses_symmetry } -> std::convertible_to<bool>;
  { solver.model(body, mesh, planes, material, contact, element) } -> std::same_as<std::unique_ptr<typename S::template Model<Material, Contact, Element>>>;
  { solver.run(model, scenario, touch) } -> std::same_as<std::vector<MechanicalState>>;
};

namespace detail {

template <class Method>
struct SolverOf {
  using type = Method;
};
template <LinearSolver Method>
struct SolverOf<Method> {
  using type = QuasiStatic<Method>;
};

}  // namespace detail

/// The solver that a simulator's last parameter names: a linear solver stands for the quasi-static one that uses it.
template <class Method>
using SolverOf = typename detail::SolverOf<Method>::type;

}  // namespace lumo

// ---- lumo/mechanics/step_contacts.hpp

namespace lumo {

/// The contact points of one time step between a surface and one rigid thing, with Coulomb friction on the slip since the step's start.
/// Friction is smooth below a slip `stick_m`: (2 − u/stick) u/stick of its full size (Li et al. 2020; Newton 1.8).
template <ContactHandler Contact, class Tool>
class StepContacts {
 public:
  StepContacts(const ContactSurface& surface, const Contact& law) : surface_(&surface), law_(law) {}

  /// The points that come within `reach_m` of the rigid thing, which moved by `moved` since the last step and is now at its place.
  void find(const Positions& start, const Moving<Tool>& rigid, const Vec3& moved, double reach_m, double stick_m);

  /// Adds node v's share at positions x.
  void add(int v, const Positions& x, VertexBlock& out) const {
    for (int k = first_[std::size_t(v)]; k < first_[std::size_t(v) + 1]; ++k) {
      const auto [point, shape] = corners_[std::size_t(k)];
      const VertexBlock at = response(points_[std::size_t(point)], x);
      out.force += shape * at.force;
      out.block += shape * shape * at.block;
    }
  }

  /// Force on the whole surface at positions x, and friction alone on the nodes.
  struct Sums {
    Vec3 force = Vec3::Zero(), friction = Vec3::Zero();
  };
  Sums sum(const Positions& x, std::vector<Vec3>* friction_on_nodes) const {
    Sums s;
    for (const Point& p : points_) {
      const Vec3 force = response(p, x).force, friction = force - normal_force(p, x);
      s.force += force;
      s.friction += friction;
      if (!friction_on_nodes || law_friction() == 0.0) continue;
      for (std::size_t a = 0; a < std::size_t(surface_->nodes_per_face()); ++a)
        (*friction_on_nodes)[std::size_t(surface_->face(p.face).nodes[a])] += surface_->points(p.face)[p.number].shape[a] * friction;
    }
    return s;
  }

 private:
  static constexpr bool frozen = requires { requires Contact::plane_frozen; };
  struct Point {
    std::size_t face, number;
    Vec3 start;     // its place at the step's start
    Vec3 foot;      // of the plane
    Vec3 normal;
  };
  struct Corner {
    int point;
    double shape;
  };

  double law_friction() const { return friction_coefficient(law_); }
  std::pair<double, Vec3> gap(const Point& p, const Vec3& at) const {
    if constexpr (frozen) {
      return {p.normal.dot(at - p.foot), p.normal};
    } else {
      const DistanceSample d = rigid_.sample(at);
      return {d.distance, d.gradient};
    }
  }
  Vec3 place(const Point& p, const Positions& x) const { return surface_->position(p.face, surface_->points(p.face)[p.number], x); }
  Vec3 normal_force(const Point& p, const Positions& x) const {
    const auto [g, n] = gap(p, place(p, x));
    return surface_->points(p.face)[p.number].weight_m2 * law_.respond(g).pressure * n;
  }
  // Force on the surface at the point, and its stiffness without the curvature of the rigid thing.
  VertexBlock response(const Point& p, const Positions& x) const {
    const Vec3 at = place(p, x);
    const auto [g, n] = gap(p, at);
    if (g >= 0.0) return {};
    const ContactResponse r = law_.respond(g);
    const double weight = surface_->points(p.face)[p.number].weight_m2, push = weight * r.pressure;
    VertexBlock out{push * n, weight * r.stiffness * n * n.transpose()};
    if (law_friction() == 0.0) return out;
    const Vec3 slip = at - p.start - moved_, along = slip - n.dot(slip) * n;
    const double u = along.norm(), scale = law_friction() * push * (u > stick_m_ ? 1.0 / u : (2.0 - u / stick_m_) / stick_m_);
    out.force -= scale * along;
    out.block += scale * (Mat3::Identity() - n * n.transpose());
    return out;
  }

  const ContactSurface* surface_;
  Contact law_;
  Moving<Tool> rigid_{};
  Vec3 moved_ = Vec3::Zero();
  double stick_m_ = 1.0;
  std::vector<Point> points_;
  std::vector<int> first_;         // per node, into corners_
  std::vector<Corner> corners_;
};

template <ContactHandler Contact, class Tool>
void StepContacts<Contact, Tool>::find(const Positions& start, const Moving<Tool>& rigid, const Vec3& moved, double reach_m, double stick_m) {
  rigid_ = rigid;
  moved_ = moved;
  stick_m_ = stick_m;
  points_.clear();
  std::vector<std::vector<Corner>> of_node(std::size_t(start.cols()));
  for (std::size_t f = 0; f < surface_->size(); ++f) {
    const auto [middle, radius] = surface_->ball(f, start);
    if (rigid.distance(middle) > radius + reach_m) continue;
    const std::vector<SurfacePoint>& points = surface_->points(f);
    for (std::size_t k = 0; k < points.size(); ++k) {
      const Vec3 at = surface_->position(f, points[k], start);
      const DistanceSample d = rigid.sample(at);
      if (d.distance > reach_m) continue;
      for (std::size_t a = 0; a < std::size_t(surface_->nodes_per_face()); ++a)
        if (points[k].shape[a] != 0.0) of_node[std::size_t(surface_->face(f).nodes[a])].push_back({int(points_.size()), points[k].shape[a]});
      points_.push_back({f, k, at, at - d.distance * d.gradient, d.gradient});
    }
  }
  first_.assign(1, 0);
  corners_.clear();
  for (const auto& corners : of_node) {
    corners_.insert(corners_.end(), corners.begin(), corners.end());
    first_.push_back(int(corners_.size()));
  }
}

}  // namespace lumo

// ---- lumo/mechanics/vertex_block_descent.hpp

namespace lumo {

/// The paper's solver: implicit Euler in time, each step a fixed number of sweeps over the vertices, color by color; each vertex is moved by
/// Newton's method on its own three components, with inertia, elasticity, viscosity and contact in the 3×3 block. The indenter advances at a
/// constant speed until a load is met, then stands still for `hold_s`, and the state is recorded: `held`, which says nothing of equilibrium.
/// Vertices of one color do not meet, so that any executor gives the same bits.
/// Source: Chen, Liu, Yang, Yuksel 2024 (vertex block descent); protocol of the paper's §III-B and its table of settings.
template <Executor E = Serial>
struct BlockDescent {
  template <class Material, class Contact, class Element>
  using Model = DescentModel<Material, Contact, Element>;
  using Config = DescentConfig;
  static constexpr bool uses_symmetry = false;
  Config config = {};
  E executor = {};

  /// Throws InvalidArgument for settings out of range and for colors that are none.
  template <class Material, class Contact, class Element>
  std::unique_ptr<Model<Material, Contact, Element>> model(const Body& body, const TetMesh& mesh, Symmetry planes, const Material& material, const Contact& contact,
                                                           const Element& element) const {
    validate(config);
    return std::make_unique<Model<Material, Contact, Element>>(body, mesh, planes, material, contact, element, config);
  }

  /// States after each load's hold. A load that is not met within `max_advance_m` ends as max_iterations; a step without finite positions as non_finite, with
  /// the state before it.
  template <class SomeModel, Indenter Tool>
  std::vector<MechanicalState> run(const SomeModel& model, const Scenario<Tool>& scenario, const Touch& touch) const;
};

using VertexBlockDescent = BlockDescent<>;

namespace detail {

/// One body under one indenter in time.
template <class Model, Indenter Tool, Executor E>
class Descent {
 public:
  Descent(const Model& model, const Tool& tool, const Touch& touch, const Vec3& direction, const DescentConfig& config, const E& executor)
      : model_(model), config_(config), executor_(executor), tool_(tool), origin_(touch.origin), direction_(direction), x_(positions_of(model.sector.mesh)),
        start_(x_), target_(x_), velocity_(Positions::Zero(3, x_.cols())), last_velocity_(velocity_), touching_(model.touchable, model.contact),
        resting_(model.resting, model.contact) {
    if constexpr (Model::batched)
      if (model.lanes) squares_.resize(model.lanes->slots());
  }

  /// One time step, at whose start the indenter moves on by `by` [m]. False where it ends in what is no place on earth: then all is as it was before.
  bool step(double by) {
    advance_ += by;
    const double dt = config_.time_step_s, stick = config_.slip_speed_m_per_s * dt;
    start_ = x_;
    predict();
    touching_.find(start_, {&tool_, origin_ + advance_ * direction_, direction_}, by * direction_, config_.detection_m, stick);
    resting_.find(start_, {&model_.carrier, Vec3::Zero(), Vec3::UnitZ()}, Vec3::Zero(), config_.detection_m, stick);
    if constexpr (Model::batched)
      if (rate() > 0.0) for_batches([&](const auto& batch) { model_.lanes->remember(batch, start_, squares_); });
    for (int k = 0; k < config_.sweeps; ++k) sweep();
    // A kilometre off, a pad is as lost as with NaN, and its forces are about to overflow.
    if (!(x_.array().abs() < 1e3).all()) return x_ = start_, advance_ -= by, false;
    last_velocity_ = velocity_;
    velocity_ = (x_ - start_) / dt;
    return true;
  }

  /// What the indenter feels against its advance [N].
  double push() const { return touching_.sum(x_, nullptr).force.dot(direction_); }
  /// Friction on the nodes, and its part of the push.
  double friction(std::vector<Vec3>& on_nodes) const {
    on_nodes.assign(std::size_t(x_.cols()), Vec3::Zero());
    resting_.sum(x_, &on_nodes);
    return touching_.sum(x_, &on_nodes).friction.dot(direction_);
  }
  const Positions& positions() const { return x_; }
  double advance() const { return advance_; }

 private:
  double rate() const { return config_.viscosity_Pa_s / config_.time_step_s; }

  // Where inertia alone would carry the vertices, and where the sweeps begin.
  void predict() {
    const double dt = config_.time_step_s;
    target_ = start_ + dt * velocity_;
    Positions ahead = Positions::Zero(3, x_.cols());
    if (config_.predictor != Predictor::position) ahead = dt * velocity_;
    if (config_.predictor == Predictor::acceleration) ahead += dt * (velocity_ - last_velocity_);
    for (Eigen::Index v = 0; v < x_.cols(); ++v)
      if (!model_.moves[std::size_t(v)]) ahead.col(v).setZero();
    x_ = start_ + ahead;
    // A law without an energy inside out must not begin there.
    if (model_.resists_inversion && config_.predictor != Predictor::position) {
      const double floor = 0.2 * model_.elasticity.smallest_J(start_);
      for (int k = 0; k < 10 && !(model_.elasticity.smallest_J(x_) > floor); ++k) ahead *= 0.5, x_ = start_ + ahead;
      if (!(model_.elasticity.smallest_J(x_) > floor)) x_ = start_;
    }
  }

  // Pieces of work that are large enough to hand out.
  static constexpr std::size_t piece = 16;

  template <class Visit>
  void for_batches(Visit&& visit) const {
    if constexpr (Model::batched)
      if (model_.lanes)
        for (const auto& batches : model_.lanes->batches()) over(batches.size(), [&](std::size_t k) { visit(batches[k]); });
  }
  template <class Visit>
  void over(std::size_t count, Visit&& visit) const {
    executor_.for_each((count + piece - 1) / piece, [&](std::size_t p) {
      for (std::size_t k = p * piece; k < std::min(count, (p + 1) * piece); ++k) visit(k);
    });
  }

  void sweep() {
    if constexpr (Model::batched)
      if (model_.lanes) {
        for_batches([&](const auto& batch) {
          std::array<VertexBlock, Lanes::width> blocks;
          model_.lanes->add(batch, x_, squares_, rate(), blocks);
          std::array<Vec3, Lanes::width> steps;
          steps.fill(Vec3::Zero());
          for (std::size_t lane = 0; lane < Lanes::width; ++lane)
            if (batch.vertex[lane] >= 0) steps[lane] = step_of(batch.vertex[lane], blocks[lane]);
          if (model_.resists_inversion) {
            const auto part = model_.lanes->feasible_parts(batch, x_, steps);
            for (std::size_t lane = 0; lane < Lanes::width; ++lane) steps[lane] *= part[lane];
          }
          for (std::size_t lane = 0; lane < Lanes::width; ++lane)
            if (batch.vertex[lane] >= 0) x_.col(batch.vertex[lane]) += steps[lane];
        });
        return;
      }
    for (const std::vector<int>& color : model_.colors)
      over(color.size(), [&](std::size_t k) {
        VertexBlock b;
        model_.elasticity.add(color[k], x_, start_, rate(), b);
        const Vec3 step = step_of(color[k], b);
        x_.col(color[k]) += (model_.resists_inversion ? model_.elasticity.feasible_part(color[k], x_, step) : 1.0) * step;
      });
  }

  // Adds inertia and contact, and solves for the vertex's step.
  Vec3 step_of(int v, VertexBlock& b) const {
    const double inertia = model_.mass[std::size_t(v)] / (config_.time_step_s * config_.time_step_s);
    b.force += inertia * (target_.col(v) - x_.col(v));
    b.block += inertia * Mat3::Identity();
    touching_.add(v, x_, b);
    resting_.add(v, x_, b);
    const Mat3& H = b.block;
    const Mat3 c = cofactor(H);   // of a symmetric matrix: its inverse times the determinant
    const double determinant = H.col(0).dot(c.col(0));
    if (H(0, 0) > 0.0 && c(2, 2) > 0.0 && determinant > 1e-14 * H(0, 0) * H(1, 1) * H(2, 2)) return c * b.force / determinant;
    if (!H.allFinite() || !b.force.allFinite()) return Vec3::Constant(std::numeric_limits<double>::quiet_NaN());   // seen at the step's end
    // Curvatures that are negative change sign: a step along them still lowers the energy.
    const Eigen::SelfAdjointEigenSolver<Mat3> eigen(H);
    const Vec3 l = eigen.eigenvalues().cwiseAbs();
    return eigen.eigenvectors() * (eigen.eigenvectors().transpose() * b.force).cwiseQuotient(l.cwiseMax(1e-9 * l.maxCoeff()));
  }

  const Model& model_;
  const DescentConfig& config_;
  const E& executor_;
  const Tool& tool_;
  Vec3 origin_, direction_;
  double advance_ = 0.0;
  Positions x_, start_, target_, velocity_, last_velocity_;
  StepContacts<std::decay_t<decltype(std::declval<Model>().contact)>, Tool> touching_;
  StepContacts<std::decay_t<decltype(std::declval<Model>().contact)>, Carrier> resting_;
  typename Model::Squares squares_;
};

}  // namespace detail

template <Executor E>
template <class SomeModel, Indenter Tool>
std::vector<MechanicalState> BlockDescent<E>::run(const SomeModel& model, const Scenario<Tool>& scenario, const Touch& touch) const {
  using Clock = std::chrono::steady_clock;
  const auto begun = Clock::now();
  const auto late = [&] { return std::chrono::duration<double>(Clock::now() - begun).count() > config.time_limit_s; };
  detail::Descent<SomeModel, Tool, E> body(model, scenario.indenter, touch, scenario.direction(), config, executor);
  const int hold = int(std::lround(config.hold_s / config.time_step_s));
  std::vector<MechanicalState> states;
  int steps = 0;
  for (double load : scenario.loads_N) {
    MechanicalState state;
    state.load_N = load;
    state.status = Status::held;
    const int before = steps;
    const auto go = [&](double by) {
      ++steps;
      if (!body.step(by)) state.status = Status::non_finite;
      else if (late()) state.status = Status::time_limit;
    };
    while (state.status == Status::held && body.push() < load) {
      if (body.advance() >= config.max_advance_m) state.status = Status::max_iterations;
      else go(config.speed_m_per_s * config.time_step_s);
    }
    state.met_force_N = body.push();
    for (int k = 0; k < hold && state.status == Status::held; ++k) go(0.0);
    state.iterations = config.sweeps * (steps - before);
    state.depth_m = body.advance();
    const Positions& x = body.positions();
    for (std::size_t k = 0; k < model.sector.mesh.nodes.size(); ++k) state.displacement.push_back(x.col(Eigen::Index(k)) - model.sector.mesh.nodes[k]);
    if (friction_coefficient(model.contact) > 0.0) state.friction_push_N = body.friction(state.friction_N);
    states.push_back(std::move(state));
    if (states.back().status != Status::held) break;
  }
  return states;
}

}  // namespace lumo

// ---- lumo/mechanics/certify.hpp

namespace lumo {

/// Norm of the out-of-balance forces on the free components of the whole body and on the indenter [N], by a routine that shares no assembly
/// with the solver: the virtual work of each node's shape function, point by point, on the whole mesh, without sectors, equations or linearised
/// volumes and gaps. It does share the policies (the material's stresses, the element's points and shape functions, the contact's response) and the
/// points and weights of ContactSurface: a fault in one of these is not found here but by the policies' own tests.
/// Friction depends on the way that was taken and is given.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, Indenter Tool>
double out_of_balance(const Body& body, const TetMesh& mesh, const Material& material, const Contact& contact, const Element& element,
                      const Tool& tool, const Vec3& origin, const Vec3& direction, double load_N, const std::vector<Vec3>& displacement, const FrictionForces& friction = {}) {
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
  double push = friction.push_N;
  for (std::size_t k = 0; k < friction.on_nodes.size(); ++k) force[k] -= friction.on_nodes[k];
  const auto press = [&](const ContactSurface& surface, const auto& rigid, bool is_indenter) {
    for (std::size_t f = 0; f < surface.size(); ++f)
      for (const SurfacePoint& p : surface.points(f)) {
        const DistanceSample d = rigid.sample(surface.position(f, p, x));
        const Vec3 traction = contact.respond(d.distance).pressure * d.gradient;
        if (is_indenter) push += p.weight_m2 * traction.dot(direction);
        for (std::size_t k = 0; k < std::size_t(mesh.nodes_per_face()); ++k) force[std::size_t(surface.face(f).nodes[k])] -= p.weight_m2 * p.shape[k] * traction;
      }
  };
  press(ContactSurface(mesh, body, [](const Patch& p) { return p.contactable; }, contact), Moving<Tool>{&tool, origin, direction}, true);
  press(ContactSurface(mesh, body, [](const Patch& p) { return p.meets_carrier; }, contact), Moving<Carrier>{&carrier, Vec3::Zero(), direction}, false);
  for (const BoundaryFace& f : mesh.faces)
    if (body.patches[std::size_t(f.patch)].bonded)
      for (int k = 0; k < mesh.nodes_per_face(); ++k) force[std::size_t(f.nodes[std::size_t(k)])].setZero();
  double sum = (push - load_N) * (push - load_N);
  for (const Vec3& f : force) sum += f.squaredNorm();
  return std::sqrt(sum);
}

}  // namespace lumo

// ---- lumo/mechanics/simulator.hpp

namespace lumo {

template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, class Method>
  requires PressSolver<SolverOf<Method>, Material, Contact, Element>
class PreparedBody;

/// Presses an indenter into a body. Types choose the physics, values choose the numbers:
/// `Simulator sim{NeoHookean{.mu = 106.0_kPa, .lambda = 10.494_MPa}, SDFContact{}}`.
/// `Method` is a solver, such as VertexBlockDescent, or a linear solver for the quasi-static one, such as Cholmod.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element = QuadraticTet, class Method = EigenCholesky>
  requires PressSolver<SolverOf<Method>, Material, Contact, Element>
struct Simulator {
  Material material = {};
  Contact contact = {};
  Element element = {};
  SolverOf<Method> solver = {};

  /// Everything that scenarios on one mesh share (elements, symbolic factorisations); thread-safe, so that scenarios can run side by side.
  /// Throws InvalidArgument for parameters out of range.
  PreparedBody<Material, Contact, Element, Method> prepare(const Body& body, const TetMesh& mesh) const {
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
template <class Material, class Contact, class Element, class Solver>
Simulator(Material, Contact, Element, Solver) -> Simulator<Material, Contact, Element, Solver>;

/// A body ready to be pressed at many places.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, class Method>
  requires PressSolver<SolverOf<Method>, Material, Contact, Element>
class PreparedBody {
 public:
  using Model = typename SolverOf<Method>::template Model<Material, Contact, Element>;
  using Maker = Simulator<Material, Contact, Element, Method>;

  PreparedBody(const Maker& maker, const Body& body, const TetMesh& mesh) : maker_(maker), body_(body), mesh_(std::make_shared<const TetMesh>(mesh)) {}

  /// States at the scenario's loads, on the whole mesh. Where body and scenario are symmetric the quasi-static solver takes only a half or a
  /// quarter; fields that break the symmetry are still tested for stability.
  template <Indenter Tool>
  std::vector<MechanicalState> press(const Scenario<Tool>& scenario) const;

  const TetMesh& mesh() const { return *mesh_; }

 private:
  const Model& model(Symmetry planes) const {
    Slot& slot = (*slots_)[std::size_t((planes.x ? 1 : 0) + (planes.y ? 2 : 0))];
    const std::lock_guard one(slot.making);   // glibc aborts where std::call_once lets "out of memory" pass
    if (!slot.model) slot.model = maker_.solver.model(body_, *mesh_, planes, maker_.material, maker_.contact, maker_.element);
    return *slot.model;
  }

  struct Slot {
    std::mutex making;
    std::unique_ptr<Model> model;
  };
  Maker maker_;
  Body body_;
  std::shared_ptr<const TetMesh> mesh_;
  std::shared_ptr<std::array<Slot, 4>> slots_ = std::make_shared<std::array<Slot, 4>>();
};

template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, class Method>
  requires PressSolver<SolverOf<Method>, Material, Contact, Element>
template <Indenter Tool>
std::vector<MechanicalState> PreparedBody<Material, Contact, Element, Method>::press(const Scenario<Tool>& scenario) const {
  validate(scenario);
  const Touch touch = first_touch(body_, *mesh_, scenario);
  // A fixed area per vertex knows no halves of vertices.
  const bool fold = SolverOf<Method>::uses_symmetry && area_per_vertex(maker_.contact) == 0.0;
  const Symmetry contact = symmetry_of(scenario), planes{fold && mesh_->symmetry.x && contact.x, fold && mesh_->symmetry.y && contact.y};
  const Model& sector_model = model(planes);
  std::vector<MechanicalState> states = maker_.solver.run(sector_model, scenario, touch);
  const ContactSurface surface(*mesh_, body_, [](const Patch& p) { return p.contactable; }, maker_.contact);
  for (MechanicalState& s : states) {
    s.displacement = unfold(*mesh_, sector_model.sector, s.displacement);
    if (!s.friction_N.empty()) s.friction_N = unfold(*mesh_, sector_model.sector, s.friction_N);
    const Vec3 origin = touch.origin + s.depth_m * scenario.direction();
    Positions x = positions_of(*mesh_);
    for (std::size_t k = 0; k < s.displacement.size(); ++k) x.col(Eigen::Index(k)) += s.displacement[k];
    const Moving<Tool> rigid{&scenario.indenter, origin, scenario.direction()};
    ContactField c = contact_field(*mesh_, surface, maker_.contact, rigid, x);
    const ContactSums sums = add_contact_forces(surface, maker_.contact, rigid, x, nullptr);
    s.force_N = sums.push_N + s.friction_push_N;
    s.penetration_m = sums.penetration_m;
    s.contact_area_m2 = contact_area(surface, c.field, x);
    s.reference_area_m2 = contact_area(surface, c.field, positions_of(*mesh_));
    s.contact_field = std::move(c.field);
    s.pressure_Pa = std::move(c.pressure_Pa);
    // Certified on the whole mesh by the independent routine, whatever the solver says of itself. A held indenter bears any force.
    const double wanted = s.status == Status::held ? s.force_N : s.load_N;
    s.residual_N = out_of_balance(body_, *mesh_, maker_.material, maker_.contact, maker_.element, scenario.indenter, origin, scenario.direction(), wanted, s.displacement,
                                  {s.friction_N, s.friction_push_N});
    if (s.status == Status::converged && !(s.residual_N <= 1e-6 * s.load_N)) s.status = std::isfinite(s.residual_N) ? Status::max_iterations : Status::non_finite;
    if (std::isnan(s.residual_N)) s.residual_N = std::numeric_limits<double>::infinity();
    s.certified = s.status == Status::converged;
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

/// By ratio, of `wish` ≤ 2²⁴; counts of points that fill evenly. 1 for less than 1.
inline std::uint32_t nearest_power_of_two(double wish) { return std::max(1u, std::bit_floor(std::uint32_t(std::min(double(1 << 24), 1.4142 * wish)))); }

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
  template <class Vec3 = Vec3>
  BvhScene(const std::vector<SceneTriangle>& triangles, int leaf_size);

  /// First triangle on the ray from `origin` [m] along the unit vector `direction`; `inside`: the ray runs in the body.
  template <class Vec3 = Vec3>
  RayHit first_hit(In<Vec3> origin, In<Vec3> direction, bool inside) const;

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

  template <class = void>
  Range bounds(int first, int last) const;
  template <class Vec3 = Vec3>
  bool split(const Range& range, std::array<Range, 2>& halves);
  template <class = void>
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

  template <class = void>
  BvhScene build(const std::vector<SceneTriangle>& triangles) const { return BvhScene(triangles, config.leaf_size); }
};

template <class Vec3>
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

template <class>
inline BvhScene::Range BvhScene::bounds(int first, int last) const {
  Range r{first, last, {}};
  for (int i = first; i < last; ++i) r.box.extend(boxes_[std::size_t(order_[std::size_t(i)])]);
  return r;
}

// Cuts the range where the expected cost of a ray is least; false when it is small, or cannot be cut.
template <class Vec3>
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

template <class>
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

template <class Vec3>
inline RayHit BvhScene::first_hit(In<Vec3> origin, In<Vec3> direction, bool inside) const {
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
template <class Vec3 = Vec3>
inline Vec3 on_quadratic(In<std::array<Vec3, 6>> x, double b1, double b2) {
  const std::array<double, 6> n = quadratic_shape(b1, b2);
  return n[0] * x[0] + n[1] * x[1] + n[2] * x[2] + n[3] * x[3] + n[4] * x[4] + n[5] * x[5];
}

/// The same at (k1, k2)/n. Points on an edge come from the edge's own three nodes in the order of their `numbers`, so that neighbours get the same
/// bits: no cracks.
template <class Vec3 = Vec3>
inline Vec3 lattice_point(In<std::array<Vec3, 6>> x, const std::array<int, 6>& numbers, int n, int k1, int k2) {
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
template <class Vec3 = Vec3>
inline Vec3 quadratic_normal(In<std::array<Vec3, 6>> x, double b1, double b2) {
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
template <class Vec3 = Vec3, class MatrixX3d = Eigen::MatrixX3d>
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
  MatrixX3d turned = MatrixX3d::Zero(size, 3);
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
template <class Vec3 = Vec3>
inline std::vector<std::array<Vec3, 3>> polygon_cells(In<std::vector<Vec3>> c, In<std::vector<Vec3>> like, double size_m) {
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
template <class Vec3 = Vec3>
inline std::vector<std::array<Vec3, 3>> polygon_cells(In<std::vector<Vec3>> c, double size_m) { return polygon_cells(c, c, size_m); }

}  // namespace lumo::detail

// ---- lumo/optics/set_back.hpp

namespace lumo::detail {

/// Corners of a carrier face, moved away from the lit side by `gap_m`, or by twice as much as the points `soft` of the body lie behind
/// it if that is more: where a body rests on its carrier the two may cross a little, and light in the gap must still meet the carrier.
/// Throws InvalidArgument for a face that is not a polygon of finite corners with an area.
template <class Vec3 = Vec3>
inline std::vector<Vec3> set_back(const RigidFace& face, In<std::vector<Vec3>> soft, double gap_m) {
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
template <class Vec3 = Vec3>
inline Vec3 reflect(In<Vec3> d, In<Vec3> n) { return (d - 2.0 * d.dot(n) * n).normalized(); }

/// Refracted direction of the unit direction `d` by Snell's law; `n` is the unit normal on the side that light comes from.
template <class Vec3 = Vec3>
inline Vec3 refract(In<Vec3> d, In<Vec3> n, double index_ratio, double cosine_behind) {
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

/// Direction about the axis `n` with density cos θ/π from two numbers in (0, 1); the azimuth starts at `t1`.
template <class Vec3 = Vec3>
inline Vec3 cosine_direction(In<Vec3> t1, In<Vec3> t2, In<Vec3> n, double u, double azimuth) {
  const double sine = std::sqrt(u);
  return (sine * std::cos(azimuth) * t1 + sine * std::sin(azimuth) * t2 + std::sqrt(1.0 - u) * n).normalized();
}

}  // namespace detail

/// Where opaque surfaces send light: unit direction for the incoming unit direction `d`, unit normal `n` on the lit side, and two
/// numbers in (0, 1). `mirror` (±1, ±1, 1) is the mirror image that the path belongs to: image paths take image directions.
template <class Vec3 = Vec3>
inline Vec3 reflected(const Lambertian&, In<Vec3>, In<Vec3> n, double u, double v, In<Vec3> mirror) {
  const Vec3 m = mirror.cwiseProduct(n);
  Vec3 t1, t2;
  detail::tangents(m, t1, t2);
  return mirror.cwiseProduct(detail::cosine_direction(t1, t2, m, u, 2.0 * pi * v));
}
template <class Vec3 = Vec3>
inline Vec3 reflected(const Mirror&, In<Vec3> d, In<Vec3> n, double, double, In<Vec3>) { return reflect(d, n); }
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
/// plus the carrier faces. Knows exact normals, regions, contact, and the optics of each face.
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
  template <class Vec3 = Vec3>
  OpticalScene(const Body& body, const TetMesh& mesh, In<std::vector<Vec3>> displacement, const std::vector<double>& contact_field,
               Symmetry images, const Config& config);

  const std::vector<SceneTriangle>& triangles() const { return triangles_; }

  /// Locates the point `p` [m] on triangle `t`.
  template <class Vec3 = Vec3>
  ScenePoint locate(int t, In<Vec3> p) const;
  /// Unit normal of triangle `t` (flat, outward).
  template <class Vec3 = Vec3>
  Vec3 flat_normal(int t) const;
  /// Unit outward normal of the deformed body.
  template <class Vec3 = Vec3>
  Vec3 smooth_normal(const ScenePoint& p) const { return detail::on_quadratic(faces_[std::size_t(p.face)].normal, p.b1, p.b2).normalized(); }
  /// Undeformed position [m].
  template <class Vec3 = Vec3>
  Vec3 reference(const ScenePoint& p) const { return detail::on_quadratic(faces_[std::size_t(p.face)].reference, p.b1, p.b2); }
  /// Deformed position on the quadratic map [m].
  template <class Vec3 = Vec3>
  Vec3 position(const ScenePoint& p) const { return detail::on_quadratic(faces_[std::size_t(p.face)].deformed, p.b1, p.b2); }
  /// What light inside the body meets where a tool touches it.
  const SurfaceOptics& touched() const { return body_->touched; }
  /// Inside the contact set {φ > 0}, φ linear on the four sub-triangles of the face?
  bool in_contact(const ScenePoint& p) const { return faces_[std::size_t(p.face)].in_contact(p.b1, p.b2); }
  /// Region of the point, or of its mirror image `image` (bit 0: x → −x, bit 1: y → −y).
  template <class = void>
  int region(const ScenePoint& p, unsigned image) const;
  const SurfaceOptics& optics(int t) const {
    if (!on_body(t)) return body_->rigid_faces[std::size_t(rigid_[std::size_t(t) - body_triangles_])].optics;
    return body_->patches[std::size_t(faces_[std::size_t(t / triangles_per_face())].patch)].optics;
  }
  int triangles_per_face() const { return int(lattice_.size()); }
  bool on_body(int t) const { return std::size_t(t) < body_triangles_; }
  template <class = void>
  double triangle_area(int t) const;
  template <class = void>
  double area(int face) const;      ///< of its triangles [m²]
  /// May a point of a face, or of one of its mirror images, lie in a region while the body is undeformed?
  bool has_region(int face) const { return has_region_[std::size_t(face)] != 0; }
  std::size_t face_count() const { return faces_.size(); }
  /// Triangle of a face at barycentric (b1, b2), and the point of that (flat) triangle there [m].
  template <class Vec3 = Vec3>
  int triangle_at(int face, double b1, double b2, Vec3& point) const;
  const Patch& patch(int face) const { return body_->patches[std::size_t(faces_[std::size_t(face)].patch)]; }
  /// Corners of a face, or of one of its sub-facets (sub ≥ 0), in the undeformed body [m].
  template <class Vec3 = Vec3>
  std::array<Vec3, 3> reference_corners(int face, int sub) const;
  /// Corners of triangle `t` in the undeformed body; of a carrier face, where it stands without gap [m].
  template <class Vec3 = Vec3>
  std::array<Vec3, 3> reference_corners(int t) const {
    if (!on_body(t)) return rigid_reference_[std::size_t(t) - body_triangles_];
    return reference_corners(t / triangles_per_face(), t % triangles_per_face());
  }
  /// Region of a place on a patch, undeformed and as it is now, or of its mirror image.
  template <class Vec3 = Vec3>
  int region(int patch, In<Vec3> reference, In<Vec3> position, unsigned image) const;
  int patch_number(const ScenePoint& p) const { return faces_[std::size_t(p.face)].patch; }
  /// Number that tells surfaces apart: the patch of a triangle of the body, or a carrier face.
  int surface_number(int t) const {
    return on_body(t) ? faces_[std::size_t(t / triangles_per_face())].patch : int(body_->patches.size()) + rigid_[std::size_t(t) - body_triangles_];
  }
  /// A point a little inside the body from the point `p` on triangle `t`: towards the inside and the middle of the triangle.
  template <class Vec3 = Vec3>
  Vec3 pulled_inward(int t, In<Vec3> p) const;

 private:
  static constexpr int mixed = -2;
  template <class Vec3 = Vec3>
  void add_faces(const TetMesh& mesh, In<std::vector<Vec3>> displacement, const std::vector<double>& contact_field);
  template <class Vec3 = Vec3>
  void add_carrier(const Config& config);
  template <class = void>
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
  std::vector<char> has_region_;            ///< per face, undeformed: the same in all states, also where regions stay in space
};

template <class Vec3>
inline OpticalScene::OpticalScene(const Body& body, const TetMesh& mesh, In<std::vector<Vec3>> displacement,
                                  const std::vector<double>& contact_field, Symmetry images, const Config& config)
    : body_(&body), n_(mesh.order == 2 ? config.sub_facets : 1) {
  require_in_range("sub-facets per edge", config.sub_facets, 1, 64, "");
  require_in_range("carrier gap", config.carrier_gap_m * 1e6, 0.0, 1000.0, "um");
  require_in_range("carrier cell", config.carrier_cell_m * 1e3, 1e-3, 1e6, "mm");
  if (mesh.order != 1 && mesh.order != 2) throw InvalidArgument(detail::text("optical scene: mesh order ", mesh.order, ", must be 1 or 2"));
  for (const Patch& p : body.patches) validate(p.optics);
  for (const RigidFace& f : body.rigid_faces) validate(f.optics);
  validate(body.touched);
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

template <class Vec3>
inline void OpticalScene::add_faces(const TetMesh& mesh, In<std::vector<Vec3>> displacement, const std::vector<double>& contact_field) {
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
template <class Vec3>
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

template <class Vec3>
inline int OpticalScene::region(int patch, In<Vec3> reference, In<Vec3> position, unsigned image) const {
  if (!body_->region || !body_->patches[std::size_t(patch)].visible) return -1;
  const Vec3 mirror(image & 1u ? -1.0 : 1.0, image & 2u ? -1.0 : 1.0, 1.0);
  const Vec3 n = outward_normal(*body_, patch, reference);
  const int r = body_->region(mirror.cwiseProduct(body_->regions_in_space ? position : reference), mirror.cwiseProduct(n));
  return r >= 0 && r < body_->regions ? r : -1;
}

// Faces whose nodes share a region need no look-up at a hit; most do.
template <class>
inline void OpticalScene::label(Symmetry images) {
  has_region_.assign(faces_.size(), 0);
  for (unsigned image = 0; image < 4; ++image) {
    if (((image & 1u) && !images.x) || ((image & 2u) && !images.y)) continue;
    for (std::size_t face = 0; face < faces_.size(); ++face) {
      const detail::QuadraticFace& f = faces_[face];
      std::array<int, 6> r{};
      for (std::size_t k = 0; k < 6; ++k) {
        r[k] = region(f.patch, f.reference[k], f.deformed[k], image);
        const int undeformed = body_->regions_in_space ? region(f.patch, f.reference[k], f.reference[k], image) : r[k];
        has_region_[face] = has_region_[face] || undeformed != -1;
      }
      labels_[image].push_back(std::all_of(r.begin(), r.end(), [&](int x) { return x == r[0]; }) ? r[0] : mixed);
    }
  }
}

template <class>
inline int OpticalScene::region(const ScenePoint& p, unsigned image) const {
  const int known = labels_[image][std::size_t(p.face)];
  return known != mixed ? known : region(faces_[std::size_t(p.face)].patch, reference(p), position(p), image);
}

template <class Vec3>
inline ScenePoint OpticalScene::locate(int t, In<Vec3> p) const {
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

template <class Vec3>
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

template <class>
inline double OpticalScene::triangle_area(int t) const {
  const auto& [a, b, c] = triangles_[std::size_t(t)].corners;
  return 0.5 * (b - a).cross(c - a).norm();
}

template <class>
inline double OpticalScene::area(int face) const {
  double sum = 0.0;
  for (int k = 0; k < triangles_per_face(); ++k) sum += triangle_area(face * triangles_per_face() + k);
  return sum;
}

template <class Vec3>
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

template <class Vec3>
inline Vec3 OpticalScene::flat_normal(int t) const {
  const auto& [a, b, c] = triangles_[std::size_t(t)].corners;
  return (b - a).cross(c - a).normalized();
}

template <class Vec3>
inline Vec3 OpticalScene::pulled_inward(int t, In<Vec3> p) const {
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
  template <class Vec3 = Vec3>
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
/// Optional: `std::optional<std::vector<int>> image_channels(const Body&, int axis) const`, channel → its mirror image in the plane across axis 0 or 1
/// (empty: itself; nothing: it has none), lets one of two mirrored states stand for both.
/// Laws: a pure function; the channel lies in [0, channels(body)), or is −1 for light that is not seen.
template <class R>
concept ExitReadout = requires(const R& readout, const Body& body, const Escape& escape) {
  { readout.channels(body) } -> std::convertible_to<int>;
  { readout.channel(escape) } -> std::convertible_to<int>;
};

/// A direction [unit] and the solid angle [sr] that it stands for; 0: there is no way.
struct Connection {
  Vec3 direction = Vec3::UnitZ();
  double solid_angle_sr = 0.0;
};

/// A readout behind openings that are small seen from the body: few paths come there by themselves. What Lambertian faces send is gathered from ways
/// that start at an opening (next-event estimation: Coveyou, Cain & Yost 1967); light that never met such a face is traced forward, as for others.
/// Laws: connect(k, p, u, v) leads from the point p through a point of opening k, and the mean of f(direction)·solid_angle over (u, v) in (0, 1)² is
/// the integral of f over the solid angle of the opening; channel() is −1 for light that passes no opening, and what passes one has one channel.
template <class R>
concept ConnectedReadout = ExitReadout<R> && requires(const R& readout, const Vec3& p, int k, double u) {
  { readout.openings() } -> std::convertible_to<int>;
  { readout.connect(k, p, u, u) } -> std::same_as<Connection>;
};

/// All power that leaves through each region of the body, whatever its direction (model reading of paper §III: r_b).
struct ExitPower {
  int channels(const Body& body) const { return body.regions; }
  int channel(const Escape& escape) const { return escape.region; }
  std::optional<std::vector<int>> image_channels(const Body& body, int axis) const { return axis == 0 ? body.region_image_x : body.region_image_y; }
};

static_assert(ExitReadout<ExitPower>);
static_assert(!ExitReadout<int> && !ConnectedReadout<ExitPower>);

}  // namespace lumo

// ---- lumo/optics/ray_focus.hpp

namespace lumo {

/// How densely rays are sent along y: most where the body is pressed, since rays far from there find nothing changed. Default: evenly.
/// Changes how sure a response is, not its expected value. Compare responses of one focus: then only what the press changed is left.
struct RayFocus {
  double y_m = 0.0;
  double length_m = 0.0;      ///< the density falls by e over this distance; 0: nowhere
  double least = 1.0 / 8.0;  ///< of the density at y_m

  double density(double y) const { return length_m > 0.0 ? std::max(least, std::exp(-std::abs(y - y_m) / length_m)) : 1.0; }
  /// The same for y and −y?
  bool is_symmetric() const { return y_m == 0.0 || length_m == 0.0; }
};

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
    Emitter source;  ///< moved to the fundamental quadrant
    Vec3 axis = Vec3::UnitZ(), tangent1 = Vec3::UnitX(), tangent2 = Vec3::UnitY();
    double azimuth_from = 0.0, azimuth_range = 2.0 * pi;
    Vec3 mirror = Vec3::Ones();  ///< (±1, ±1, 1): from the fundamental ray to the real one
    std::uint64_t orbit = 0;     ///< the same for emitters that are mirror images
    std::uint32_t rays = 0;      ///< per replicate
    double power_W = 0.0;        ///< per ray
  };

  /// `rays` per emitter and replicate, a power of two ≥ 4; with a focus about so many on average, each a power of two. With `symmetry` only one
  /// beam of each set of mirror images is kept. Throws InvalidArgument for broken emitters, or when they do not have the symmetry.
  template <class Vec3 = Vec3>
  RayPattern(const std::vector<Emitter>& emitters, std::uint32_t rays, Symmetry symmetry, const RayFocus& focus = {});

  const std::vector<Beam>& beams() const { return beams_; }

  /// Ray `index` of a beam, from numbers in (0, 1): angle to the axis and azimuth of its direction, then its place on the emitter.
  template <class Vec3 = Vec3>
  static PrimaryRay ray(const Beam& beam, const std::array<double, 4>& u, std::uint64_t seed, std::uint32_t index) {
    const double azimuth = beam.azimuth_from + beam.azimuth_range * u[1];
    const Polar polar = beam.source.polar(u[0]);
    const Vec3 d = (polar.sine * std::cos(azimuth) * beam.tangent1 + polar.sine * std::sin(azimuth) * beam.tangent2 + polar.cosine * beam.axis).normalized();
    const Vec3 p = beam.source.point(u[2], u[3]);
    return {beam.mirror.cwiseProduct(p), beam.mirror.cwiseProduct(d), detail::combine(detail::combine(seed, beam.orbit), index), -1};
  }
  template <class = void>
  static PrimaryRay ray(const Beam& beam, const OwenSobol& sequence, std::uint32_t index) {
    return ray(beam, {sequence(index, 0), sequence(index, 1), sequence(index, 2), sequence(index, 3)}, sequence.seed, index);
  }

  /// Is the set of emitters its own mirror image in each plane?
  template <class Vec3 = Vec3>
  static Symmetry symmetry_of(const std::vector<Emitter>& emitters);

 private:
  std::vector<Beam> beams_;
};

namespace detail {

/// Lengths below which two places of an emitter are one [m].
template <class = void>
inline double tolerance(const Emitter& e) { return 1e-12 + 1e-9 * (e.point(0.1, 0.2) - e.point(0.9, 0.8)).norm(); }

/// Do two emitters radiate alike? Points and directions at some numbers tell.
template <class = void>
inline bool same(const Emitter& a, const Emitter& b) {
  if (!a.same_model(b) || a.power_W() != b.power_W() || a.channel() != b.channel() || a.in_air() != b.in_air()) return false;
  const double reach = tolerance(a);
  if ((a.center() - b.center()).norm() > reach || a.axis().dot(b.axis()) < 1.0 - 1e-12) return false;
  for (const auto& [u, v] : {std::pair(0.1, 0.2), std::pair(0.7, 0.1), std::pair(0.4, 0.9)})
    if ((a.point(u, v) - b.point(u, v)).norm() > reach) return false;
  for (double u : {0.05, 0.3, 0.5, 0.7, 0.95})
    if (std::abs(a.polar(u).cosine - b.polar(u).cosine) > 1e-12) return false;
  return true;
}

/// The mirror image with centre (and, in a plane, axis) in x ≥ 0, y ≥ 0.
template <class Vec3 = Vec3>
inline Emitter fundamental(const Emitter& e, Vec3& mirror) {
  const Vec3 center = e.center(), axis = e.axis();
  mirror = Vec3::Ones();
  for (Eigen::Index a = 0; a < 2; ++a) {
    const bool in_plane = std::abs(center[a]) <= tolerance(e);
    if (in_plane ? axis[a] < -1e-9 : center[a] < 0.0) mirror[a] = -1.0;
  }
  return e.mirrored(mirror);
}

inline const Vec3 flip_x{-1.0, 1.0, 1.0}, flip_y{1.0, -1.0, 1.0};

}  // namespace detail

template <class Vec3>
inline Symmetry RayPattern::symmetry_of(const std::vector<Emitter>& emitters) {
  const auto closed = [&](const Vec3& m) {
    return std::all_of(emitters.begin(), emitters.end(), [&](const auto& e) {
      return std::any_of(emitters.begin(), emitters.end(), [&](const auto& other) { return detail::same(e.mirrored(m), other); });
    });
  };
  return {closed(detail::flip_x), closed(detail::flip_y)};
}

template <class Vec3>
inline RayPattern::RayPattern(const std::vector<Emitter>& emitters, std::uint32_t rays, Symmetry symmetry, const RayFocus& focus) {
  if (emitters.empty()) throw InvalidArgument("ray pattern: no emitters given, at least one is needed");
  for (const Emitter& e : emitters) e.validate();
  const Symmetry has = symmetry_of(emitters);
  if ((symmetry.x && !has.x) || (symmetry.y && !has.y))
    throw InvalidArgument("ray pattern: a symmetric state is claimed, but the emitters are not symmetric");
  double density = 0.0;
  for (const Emitter& e : emitters) density += focus.density(e.center().y()) / double(emitters.size());
  std::vector<Emitter> orbits;
  for (const Emitter& e : emitters) {
    Vec3 home;
    Beam beam{detail::fundamental(e, home)};
    const auto known = std::find_if(orbits.begin(), orbits.end(), [&](const auto& o) { return detail::same(o, beam.source); });
    beam.orbit = std::uint64_t(known - orbits.begin());
    if (known == orbits.end()) orbits.push_back(beam.source);
    beam.source = orbits[beam.orbit];  // the very same bits for all images
    beam.axis = beam.source.axis();
    const bool own_x = detail::same(beam.source.mirrored(detail::flip_x), beam.source);
    const bool own_y = detail::same(beam.source.mirrored(detail::flip_y), beam.source);
    detail::tangents(beam.axis, beam.tangent1, beam.tangent2);
    if (own_x || own_y) {
      beam.tangent1 = own_x ? Vec3::UnitX() : Vec3::UnitY();
      beam.tangent2 = beam.axis.cross(beam.tangent1);
      beam.azimuth_from = own_x && own_y ? 0.0 : -0.5 * pi;
      beam.azimuth_range = own_x && own_y ? 0.5 * pi : pi;
    }
    const std::uint32_t images = (own_x ? 2u : 1u) * (own_y ? 2u : 1u);
    const double wish = rays * focus.density(e.center().y()) / density;
    beam.rays = std::max(1u, std::max(4u, detail::nearest_power_of_two(wish)) / images);
    beam.power_W = e.power_W() / double(beam.rays * images);
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
  /// About `total` samples in all, counting mirror images that are not traced; at least `least` on each face, and more of them where the
  /// focus is, which must have the symmetry.
  template <class Predicate>
  FaceSet(const OpticalScene& scene, Symmetry symmetry, bool whole, double total, std::uint32_t least, const RayFocus& focus, Predicate&& wanted);

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
  template <class Vec3 = Vec3>
  Sample sample(std::size_t k, const OpticalScene& scene, const OwenSobol& sequence, std::uint32_t i) const;

 private:
  // Place along Morton's curve, 10 bits an axis; cells do not line up with regular grids.
  static std::uint64_t morton(const Vec3& unit_cube);
  template <class Vec3 = Vec3>
  void number(In<std::vector<Vec3>> centers, const std::vector<double>& shares, const std::vector<int>& images, double total, std::uint32_t least);

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
FaceSet::FaceSet(const OpticalScene& scene, Symmetry symmetry, bool whole, double total, std::uint32_t least, const RayFocus& focus, Predicate&& wanted)
    : per_face_(scene.triangles_per_face()), member_(scene.face_count(), 0) {
  std::map<PlaceKey, int> known;  // folded by the symmetry → index
  std::vector<Vec3> centers;      // with x ≥ 0, and y ≥ 0 where mirror images have equally many samples
  std::vector<double> shares;     // undeformed area [m²] × density
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
      centers.push_back(folded(center, {true, focus.is_symmetric()}));
      shares.push_back(0.5 * (corner[1] - corner[0]).cross(corner[2] - corner[0]).norm() * focus.density(center.y()));
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
  number(centers, shares, images, total, least);
}

// Neighbours take neighbouring blocks of the sequence: together they are stratified more finely than each alone.
template <class Vec3>
inline void FaceSet::number(In<std::vector<Vec3>> centers, const std::vector<double>& shares, const std::vector<int>& images, double total,
                            std::uint32_t least) {
  struct Block {
    std::uint64_t code = 0;
    std::uint32_t first = 0, count = 0;
  };
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low;
  double all = 0.0;
  for (std::size_t k = 0; k < faces_.size(); ++k) {
    low = low.cwiseMin(centers[k]), high = high.cwiseMax(centers[k]);
    all += shares[k] * images[k];
  }
  const double scale = faces_.empty() ? 1.0 : 1.0 / std::max(1e-12, (high - low).maxCoeff());
  std::map<PlaceKey, Block> blocks;  // what is found for one of two mirror images serves both: rounding could part them
  for (std::size_t k = 0; k < faces_.size(); ++k) {
    blocks.try_emplace(place_key(centers[k]), Block{morton(scale * (centers[k] - low)), 0, std::max(least, detail::nearest_power_of_two(total * shares[k] / all))});
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

template <class Vec3>
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
                             e.at.face >= 0 ? surface_.region(e.at, image) : surface_.region(e.patch, e.light.reference, e.light.position, image)});
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

// ---- lumo/optics/scattering_medium.hpp

namespace lumo {

/// A medium that also turns light aside. transmittance() is the share that runs straight on; of the rest, albedo() is scattered.
/// Laws: albedo in [0, 1]; free_path_m(path_m, u) is where light that does not come through `path_m` ends, drawn with the density −dT/ds on
/// [0, path_m]; scattering_cosine(u) is drawn from the phase function, which is the same forwards and backwards (reciprocity).
template <class M>
concept TurbidMedium = TransparentMedium<M> && requires(const M& medium, double x) {
  { medium.albedo() } -> std::convertible_to<double>;
  { medium.free_path_m(x, x) } -> std::convertible_to<double>;
  { medium.scattering_cosine(x) } -> std::convertible_to<double>;
};

/// Exponential extinction, of which a share is scattering with Henyey and Greenstein's phase function
/// p(cos θ) = (1 − g²)/(4π (1 + g² − 2 g cos θ)^(3/2)), mean cosine g. With albedo 0 it is BeerLambert, to the last bit.
/// Source: Henyey & Greenstein, Astrophys. J. 93 (1941); sampling: Witt, Astrophys. J. Suppl. 35 (1977).
class ScatteringMedium {
 public:
  /// Throws InvalidArgument unless index and extinction are BeerLambert's, the albedo lies in [0, 1] and the anisotropy in [−0.999, 0.999].
  explicit ScatteringMedium(const Medium& medium) : straight_(medium), medium_(medium) {
    require_in_range("scattering albedo", medium.scattering_albedo, 0.0, 1.0, "");
    require_in_range("anisotropy of scattering", medium.anisotropy, -0.999, 0.999, "");
  }

  double refractive_index() const { return straight_.refractive_index(); }
  double transmittance(double path_m) const { return straight_.transmittance(path_m); }
  double albedo() const { return medium_.scattering_albedo; }
  double free_path_m(double path_m, double u) const {
    const double depth = medium_.extinction_per_m * path_m;
    return depth > 0.0 ? std::clamp(-std::log1p(u * std::expm1(-depth)) / medium_.extinction_per_m, 0.0, path_m) : u * path_m;
  }
  double scattering_cosine(double u) const {
    const double g = medium_.anisotropy, s = 2.0 * u - 1.0;
    if (std::abs(g) < 1e-4) return std::clamp(s + 1.5 * g * (1.0 - s * s), -1.0, 1.0);  // the formula's limit, where it would cancel
    const double q = (1.0 - g * g) / (1.0 + g * s);
    return std::clamp((1.0 + g * g - q * q) / (2.0 * g), -1.0, 1.0);
  }

 private:
  BeerLambert straight_;
  Medium medium_;
};

static_assert(TurbidMedium<ScatteringMedium>);
static_assert(!TurbidMedium<BeerLambert>);

}  // namespace lumo

// ---- lumo/optics/path_tracer.hpp

namespace lumo::detail {

struct PathLimits {
  double roulette_below, scattered_below;
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
  /// `gathers_direct`: ExitGather finds the emitter's direct light.
  void run(const PrimaryRay& ray, const Vec3& mirror, double power_W, bool from_emitter, bool inside = true, std::vector<Exit>* log = nullptr,
           bool gathers_direct = true) {
    ++rays;
    mirror_ = mirror;
    start_ = power_W;
    from_emitter_ = from_emitter;
    gathers_direct_ = gathers_direct;
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
    bool scattered = false;     ///< in the medium, once at least
    bool spread = false;        ///< by a tool that wets the body: like a scattered one it has no neighbours
  };

  // Russian roulette; what it ends or adds has its own account, so that the ledger closes. False: ended.
  bool survives(Branch& b) {
    b.direct = false;
    if (!(b.power > 0.0)) return false;
    const double full = (b.scattered ? limits_.scattered_below : limits_.roulette_below) * start_;
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
    const bool gathered = exits_.has(b.exit) && !b.carrier_last && (b.direct ? gathers_direct_ : !from_emitter_);
    const bool lone = b.scattered || b.spread || (b.direct && !gathers_direct_);  // no neighbour to share with, or counted as direct light
    const Escape light{surface_.reference(b.exit), b.exit_position, b.direction, -1};
    const Exit e{b.route, light, b.exit, surface_.flat_normal(b.exit_triangle), surface_.patch_number(b.exit), b.power};
    if (log_ != nullptr && from_emitter_ && !gathered && !lone)
      log_->push_back(e);
    else
      accounts_.book_exit(e, b.direct, gathered);
  }

  void follow(Branch b);
  void scatter(const Branch& b, double path_m, double power);
  bool meet(Branch& b, int triangle);
  bool reflect_off(Branch& b, const SurfaceOptics& optics, const Vec3& normal, double& absorbed);
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
  bool from_emitter_ = true, gathers_direct_ = true;
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
    if (b.inside) {
      const double left = b.power * medium_.transmittance(path_m);
      double absorbed = b.power - left;
      if constexpr (TurbidMedium<Medium>) {
        const double scattered = medium_.albedo() * absorbed;
        absorbed -= scattered;
        scatter(b, path_m, scattered);
      }
      accounts_.book(accounts_.ledger.absorbed_in_medium, absorbed);
      b.power = left;
    }
    b.origin += path_m * b.direction;
    if (!meet(b, hit.triangle)) return;
  }
}

// Light that is scattered on a straight piece goes on from one place on it. The rest runs straight through as in a clear medium, so that direct light
// and what is gathered backwards stay free of scattering's noise: there too, each piece sends on both.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout>
void PathTracer<Scene, Medium, Readout>::scatter(const Branch& b, double path_m, double power) {
  if constexpr (TurbidMedium<Medium>) {
    if (!(power > 0.0)) return;
    Branch c = b;
    c.power = power;
    c.key = combine(b.key, 6);
    c.scattered = true;
    if (!survives(c)) return;
    const Vec3 axis = mirror_.cwiseProduct(b.direction);  // image paths take image directions
    const double cosine = medium_.scattering_cosine(uniform(combine(c.key, 2))), azimuth = 2.0 * pi * uniform(combine(c.key, 3));
    const double sine = std::sqrt(std::max(0.0, 1.0 - cosine * cosine));
    Vec3 t1, t2;
    tangents(axis, t1, t2);
    c.origin += medium_.free_path_m(path_m, uniform(combine(c.key, 4))) * b.direction;
    c.direction = mirror_.cwiseProduct((sine * std::cos(azimuth) * t1 + sine * std::sin(azimuth) * t2 + cosine * axis).normalized());
    stack_.push_back(c);
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
  b.carrier_last = !b.inside;
  return reflect_off(b, optics, b.inside ? Vec3(-surface_.flat_normal(triangle)) : surface_.flat_normal(triangle), accounts_.ledger.absorbed_at_surfaces);
}

// At an opaque surface whose unit normal points back to where the light comes from.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout>
bool PathTracer<Scene, Medium, Readout>::reflect_off(Branch& b, const SurfaceOptics& optics, const Vec3& normal, double& absorbed) {
  b.key = combine(b.key, 1);
  std::visit(
      [&](const auto& s) {
        if constexpr (OpaqueSurface<std::decay_t<decltype(s)>>) {
          const double kept = b.power * reflectance(s);
          accounts_.book(absorbed, b.power - kept);
          b.power = kept;
          b.direction = reflected(s, b.direction, normal, uniform(combine(b.key, 2)), uniform(combine(b.key, 3)), mirror_);
        }
      },
      optics);
  return survives(b);
}

template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout>
bool PathTracer<Scene, Medium, Readout>::meet_dielectric(Branch& b, int triangle, const ScenePoint& at) {
  const bool touched = surface_.in_contact(at);
  if (!b.inside && touched) {  // from air: the opaque indenter is in the way
    accounts_.book(accounts_.ledger.to_indenter, b.power);
    return false;
  }
  if (touched && !is_dielectric(surface_.touched())) {  // the tool wets it: no air is left between
    const Vec3 flat = -surface_.flat_normal(triangle), curved = -surface_.smooth_normal(at);
    const bool specular = std::holds_alternative<Mirror>(surface_.touched());
    b.spread = b.spread || !specular;
    const bool smooth = specular && b.direction.dot(curved) < 0.0 && reflect(b.direction, curved).dot(flat) > 0.0;
    return reflect_off(b, surface_.touched(), smooth ? curved : flat, accounts_.ledger.to_indenter);
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
          path_.run(RayPattern::ray(beam, u, sequence.seed, (place * rows + i) * columns + j), beam.mirror, beam.power_W, true, true, &exits_,
                    beam.source.has_intensity());
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
/// Veach, thesis, 1997, ch. 5), scattered in the medium or not. A readout behind openings is gathered from ways through them; then direct light is not.
/// Points lie fixed in the undeformed body: no sample crosses the border of a region that moves with it, so states differ smoothly.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout>
class ExitGather {
 public:
  ExitGather(const std::vector<Emitter>& emitters, const OpticalScene& surface, const Scene& scene, const Medium& medium, double outer_index,
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
      const Vec3 m = sign(image);
      for (const Emitter& e : emitters)
        if (e.has_intensity() && !e.in_air()) emitters_[image].push_back({e.mirrored(m), mirror(e.axis(), m)});
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
        if constexpr (ConnectedReadout<Readout>) {
          gather_connected(x, n, exits_[k].mirror, sequence, sent);
        } else {
          if (i % direct_every == 0) gather_direct(x, n, exits_[k].mirror, sequence, x.area * count / direct);
          gather_diffuse(x, n, exits_[k].mirror, sequence, sent);
        }
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
    Emitter emitter;  ///< mirrored to the side of the fundamental face
    Vec3 axis;
  };

  /// Direct light is smooth in place: one point of this many will do.
  static constexpr std::uint32_t direct_every = 2;

  static Vec3 mirror(const Vec3& p, const Vec3& m) { return m.cwiseProduct(p); }
  static Vec3 sign(unsigned image) { return {image & 1u ? -1.0 : 1.0, image & 2u ? -1.0 : 1.0, 1.0}; }

  // Books `power` for every image, if the way out is free and the readout sees it.
  void book(std::vector<double>& account, const FaceSet::Sample& x, const Vec3& out, double power) const {
    for (unsigned image : images_) {
      const int channel = channel_of(x, out, image);
      if (channel >= 0 && channel < channels_) account[std::size_t(channel)] += power;
    }
  }
  int channel_of(const FaceSet::Sample& x, const Vec3& out, unsigned image) const {
    const Vec3 m = sign(image);
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
      const Vec3 from = mirror(s.emitter.point(u, v), m), way = x.ray.origin - from;
      const double length = way.norm();
      const Vec3 d = way / length;
      const double intensity = s.emitter.intensity(d.dot(mirror(s.axis, m))), meets = d.dot(x.normal), cosine = std::min(1.0, d.dot(n));
      if (!(intensity > 0.0 && meets > 0.0 && cosine > 0.0)) continue;
      const FresnelSplit split = fresnel(cosine, ratio_);
      if (split.reflectance >= 1.0) continue;
      const Vec3 out = refract(d, -n, ratio_, split.cosine_behind);
      if (out.dot(x.normal) <= 0.0 || !seen(x, out)) continue;
      ++path_.segments;
      const RayHit hit = scene_.first_hit(from, d, true);
      if (!hit || hit.t < length - 1e-6 * length) continue;
      const double power = intensity * meets / (length * length) * area * (1.0 - split.reflectance);
      book(direct_, x, out, power * medium_.transmittance(length));
    }
  }

  void gather_diffuse(FaceSet::Sample& x, const Vec3& n, const Vec3& m, const OwenSobol& sequence, const std::vector<double>& sent) {
    const Vec3 out = reflected(Lambertian{}, n, n, sequence(x.index, 0), sequence(x.index, 1), m);
    double weight = 0.0;
    if (out.dot(x.normal) <= 0.0 || !enter(x, n, out, weight) || !seen(x, out)) return;
    book(diffuse_, x, out, radiosity(x, m, weight, sent));
  }

  // Openings are not mirror images of each other: each image of the point has its own way out.
  void gather_connected(FaceSet::Sample& x, const Vec3& n, const Vec3& m, const OwenSobol& sequence, const std::vector<double>& sent) {
    for (unsigned image : images_)
      for (int k = 0; k < readout_.openings(); ++k) {
        const Connection way = readout_.connect(k, mirror(x.ray.origin, sign(image)), sequence(x.index, 0), sequence(x.index, 1));
        const Vec3 out = mirror(way.direction, sign(image));
        double weight = 0.0;
        if (!(way.solid_angle_sr > 0.0 && out.dot(x.normal) > 0.0 && out.dot(n) > 0.0) || !enter(x, n, out, weight)) continue;
        const int channel = channel_of(x, out, image);
        if (channel < 0 || channel >= channels_ || scene_.first_hit(x.ray.origin, out, false)) continue;
        diffuse_[std::size_t(channel)] += radiosity(x, m, weight * out.dot(n) * way.solid_angle_sr / pi, sent);
      }
  }

  // Turns the ray into the body, against light that leaves along `out`. `weight` [m²]: that light's power is weight·radiosity of where it comes from,
  // if its directions have a cosine law. False: there is no such light.
  bool enter(FaceSet::Sample& x, const Vec3& n, const Vec3& out, double& weight) const {
    const FresnelSplit split = fresnel(std::min(1.0, out.dot(n)), 1.0 / ratio_);
    if (split.reflectance >= 1.0) return false;
    x.ray.direction = refract(-out, n, 1.0 / ratio_, split.cosine_behind);
    const double slant = x.ray.direction.dot(x.normal) / x.ray.direction.dot(n);  // flat facet, curved normal
    if (!(x.ray.direction.dot(x.normal) < 0.0 && slant > 0.0)) return false;
    weight = x.area * slant * (1.0 - split.reflectance) / (ratio_ * ratio_);
    return true;
  }

  double radiosity(const FaceSet::Sample& x, const Vec3& m, double weight, const std::vector<double>& sent) {
    path_.run(x.ray, m, weight / double(images_.size()), false);
    return path_.accounts().collect([&](std::size_t k) { return sent[k] / nodes_.area(k); });
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

/// What the readout sees of one state. Channels are those of the readout (ExitPower: regions of the body), once for each colour of the emitters.
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
template <class MatrixXd = Eigen::MatrixXd>
inline std::vector<double> standard_error(In<MatrixXd> rows) {
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
template <class = void>
inline Symmetry symmetry_of(const Body& body, const TetMesh& mesh) {
  const Symmetry s = RayPattern::symmetry_of(body.emitters), m = mesh.symmetry, b = body.symmetry;
  return {s.x && m.x && b.x, s.y && m.y && b.y};
}

/// Traces light from a body's emitters through its deformed shape, and says how much of it each channel of the readout sees.
///
/// Emitters in the medium (or in air beside it), both Fresnel branches at smooth interfaces, opaque carrier, straight rays in air (model: paper §III). Channels of the
/// response: those of the readout for the light of the first colour, then for that of the next. A medium that scatters sends on light twice from
/// each straight piece, straight and scattered; steps 1 to 3 hold for both, but emitters' light that was scattered is neither spread nor gathered.
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
    int carrier_rays = 1 << 15;       ///< over all replicates and Lambertian faces, by area; at least one on each triangle
    int exit_rays = 1 << 18;          ///< likewise over the faces with regions, from where light is gathered backwards; 0: not done
    double roulette_below = 0.005;    ///< branches below this share of their path's start weight may be ended
    double scattered_below = 0.25;    ///< the same for branches that were scattered in the medium, of which there are many
    int max_events = 4096;            ///< a branch that meets more surfaces is booked as lost
    std::uint64_t seed = 0;           ///< another number, another independent pattern
    OpticalScene::Config scene{};
  };

  Tracer() = default;
  explicit Tracer(const Config& config, const Readout& readout = {}, const Backend& backend = {})
      : config_(config), readout_(readout), backend_(backend) {}

  const Config& config() const { return config_; }

  /// Channels of the response: those of the readout for each colour; 0 without emitters.
  int channels(const Body& body) const { return color_count(body.emitters) * readout_.channels(body); }
  /// Channel → its mirror image in the plane across `axis` (0: x, 1: y). Nothing where the emitters are not symmetric or the readout does not say.
  std::optional<std::vector<int>> image_channels(const Body& body, int axis) const;

  /// The same tracer with `factor` times as many rays of each kind, a power of two, and with an independent pattern for each number of `pattern`.
  /// Compare its responses with its own only. Throws InvalidArgument for a factor that is no power of two, or out of range.
  Tracer refined(int factor, std::uint64_t pattern = 0) const;

  /// Response of the undeformed body. Uses its symmetry when mesh and emitters share it.
  Response trace(const Body& body, const TetMesh& mesh) const { return trace(body, mesh, {}, {}, symmetry_of(body, mesh)); }

  /// Response of a mechanical state. `symmetry`: planes in which body *and* state are their own mirror images.
  Response trace(const Body& body, const TetMesh& mesh, const MechanicalState& state, Symmetry symmetry = {}, const RayFocus& focus = {}) const {
    return trace(body, mesh, state.displacement, state.contact_field, symmetry, focus);
  }

  /// Response under `displacement` [m] and `contact_field` (> 0 in contact) per mesh node; either may be empty.
  /// In a plane of `symmetry` only one of two mirror images is traced, and booked for both: the caller vouches for it. `focus` must have the symmetry.
  /// Throws InvalidArgument for broken numbers, sizes or settings; never returns a NaN.
  Response trace(const Body& body, const TetMesh& mesh, const std::vector<Vec3>& displacement, const std::vector<double>& contact_field,
                 Symmetry symmetry = {}, const RayFocus& focus = {}) const;

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
std::optional<std::vector<int>> Tracer<Medium, Readout, Backend>::image_channels(const Body& body, int axis) const {
  if constexpr (requires { { readout_.image_channels(body, axis) } -> std::convertible_to<std::optional<std::vector<int>>>; }) {
    const Symmetry light = RayPattern::symmetry_of(body.emitters);
    if (axis == 0 ? !light.x : !light.y) return std::nullopt;
    const std::optional<std::vector<int>> one = readout_.image_channels(body, axis);
    if (!one) return std::nullopt;
    std::vector<int> all;
    for (int color = 0; color < color_count(body.emitters); ++color)
      for (int c : *one) all.push_back(color * int(one->size()) + c);
    return all;
  } else {
    return std::nullopt;
  }
}

template <TransparentMedium Medium, ExitReadout Readout, Intersector Backend>
Response Tracer<Medium, Readout, Backend>::trace(const Body& body, const TetMesh& mesh, const std::vector<Vec3>& displacement,
                                                 const std::vector<double>& contact_field, Symmetry symmetry,
                                                 const RayFocus& focus) const {
  const auto power_of_two = [](const char* what, int value, int low) {
    require_in_range(what, value, low, 1 << 28, "");
    if (!std::has_single_bit(unsigned(value))) throw InvalidArgument(detail::text(what, " is ", value, ", must be a power of two"));
  };
  power_of_two("replicates", config_.replicates, 2);
  power_of_two("rays per emitter", config_.rays_per_emitter, 4 * config_.replicates);
  require_in_range("carrier rays", config_.carrier_rays, 1, 1 << 30, "");
  require_in_range("exit rays", config_.exit_rays, 0, 1 << 30, "");
  require_in_range("roulette_below", config_.roulette_below, 0.0, 1.0, "");
  require_in_range("scattered_below", config_.scattered_below, 0.0, 1.0, "");
  require_in_range("max_events", config_.max_events, 1, 1 << 28, "");
  if (body.surroundings.extinction_per_m != 0.0)
    throw InvalidArgument(detail::text("surroundings extinguish ", body.surroundings.extinction_per_m, " 1/m, only 0 1/m is known"));

  require_in_range("focus of the rays", focus.y_m, -1e3, 1e3, "m");
  require_in_range("length of the rays' focus", focus.length_m, 0.0, 1e3, "m");
  require_in_range("least density of rays", focus.least, 1e-6, 1.0, "");
  if (symmetry.y && !focus.is_symmetric()) throw InvalidArgument(detail::text("rays are focussed on y = ", focus.y_m * 1e3, " mm, must be 0 mm in a state that is symmetric in y"));
  validate(body.emitters);
  const Medium medium{body.medium};
  const OpticalScene surface(body, mesh, displacement, contact_field, symmetry, config_.scene);
  const auto scene = backend_.build(surface.triangles());
  const detail::LightNodes nodes(surface, symmetry);
  const detail::FaceSet carrier(surface, symmetry, false, double(config_.carrier_rays) / config_.replicates, 1, {},
                                [&](int t) { return nodes.of(t)[0] >= 0; });
  const detail::FaceSet exits(surface, symmetry, true, double(config_.exit_rays) / config_.replicates, 2, focus, [&](int t) {
    return config_.exit_rays > 0 && is_dielectric(surface.optics(t)) && (ConnectedReadout<Readout> || surface.has_region(t / surface.triangles_per_face()));
  });
  const int channels = readout_.channels(body), colors = color_count(body.emitters);
  require_in_range("readout channels", channels, 0, 1 << 24, "");
  const double images = (symmetry.x ? 2.0 : 1.0) * (symmetry.y ? 2.0 : 1.0);
  const double outer_index = BeerLambert(body.surroundings).refractive_index();

  Response response;
  response.replicates.resize(config_.replicates, colors * channels);
  response.direct.resize(config_.replicates, colors * channels);
  EnergyLedger& sum = response.ledger;
  detail::PathTracer path(surface, scene, medium, outer_index, readout_, channels, nodes, exits, symmetry,
                          {config_.roulette_below, config_.scattered_below, config_.max_events});
  detail::ExitBeams beams(path);
  struct Color {
    RayPattern pattern;
    detail::ExitGather<std::remove_const_t<decltype(scene)>, Medium, Readout> gather;
  };
  std::vector<Color> light;
  for (int c = 0; c < colors; ++c) {
    std::vector<Emitter> emitters;
    std::copy_if(body.emitters.begin(), body.emitters.end(), std::back_inserter(emitters), [&](const Emitter& e) { return e.channel() == c; });
    light.push_back({RayPattern(emitters, std::uint32_t(config_.rays_per_emitter / config_.replicates), symmetry, focus),
                     {emitters, surface, scene, medium, outer_index, readout_, channels, nodes, exits, symmetry, path}});
  }
  const auto covered = [&](const PrimaryRay& ray) {  // has the body been pressed onto an emitter that was in air?
    const RayHit in = scene.first_hit(ray.origin, ray.direction, true), out = scene.first_hit(ray.origin, ray.direction, false);
    return in && (!out || in.t < out.t);
  };
  constexpr bool gathers_direct = !ConnectedReadout<Readout>;  // few ways from a face and an emitter lead through an opening
  for (int r = 0; r < config_.replicates; ++r) {
    const auto sequence = [&](std::uint64_t use) { return OwenSobol{detail::combine(config_.seed, 3 * std::uint64_t(r) + use)}; };
    std::vector<detail::Tally> totals;
    for (const Color& color : light) {
      for (const RayPattern::Beam& beam : color.pattern.beams()) {
        if (config_.exit_rays > 0 && !ConnectedReadout<Readout> && !beam.source.in_air())  // an opening is too small to be found between rays
          beams.run(beam, sequence(0));
        else
          for (std::uint32_t i = 0; i < beam.rays; ++i) {
            const PrimaryRay ray = RayPattern::ray(beam, sequence(0), i);
            const bool air = beam.source.in_air();
            path.run(ray, beam.mirror, beam.power_W, true, !air || covered(ray), nullptr, gathers_direct && beam.source.has_intensity() && !air);
          }
      }
      totals.push_back(path.accounts().take());
    }
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
    for (int k = 0; k < colors; ++k) {
      detail::Tally& total = totals[std::size_t(k)];
      const std::vector<double> sent = detail::exchange(nodes, transport, total);
      light[std::size_t(k)].gather.run(sequence(2), sent, total);
      for (int c = 0; c < channels; ++c) {
        response.replicates(r, k * channels + c) = total.ledger.channels[std::size_t(c)];
        response.direct(r, k * channels + c) = total.direct[std::size_t(c)];
      }
      total.ledger.channels.clear();
      detail::add(sum, total.ledger, 1.0 / config_.replicates);
    }
  }
  response.rays = path.rays;
  response.segments = path.segments;
  for (Eigen::Index c = 0; c < response.replicates.cols(); ++c) sum.channels.push_back(response.replicates.col(c).mean());
  response.power_W = sum.channels;
  response.error_W = standard_error(response.replicates);
  return response;
}

}  // namespace lumo

// ---- lumo/optics/photodiode.hpp

namespace lumo {

/// A flat detector outside the body, a parallelogram or an ellipse. It sees light that falls on the side to which `half_u` × `half_v` points.
struct Photodiode {
  Vec3 center = Vec3::Zero();       ///< [m]
  Vec3 half_u = 1e-3 * Vec3::UnitX();  ///< half edge, or half axis [m]
  Vec3 half_v = 1e-3 * Vec3::UnitY();  ///< likewise
  bool round = false;               ///< an ellipse with these half axes
  double acceptance_rad = 0.5 * pi;  ///< largest angle between the light and the normal

  template <class = void>
  double area_m2() const { return (round ? pi : 4.0) * half_u.cross(half_v).norm(); }
  template <class Vec3 = Vec3>
  Vec3 normal() const { return half_u.cross(half_v).normalized(); }
};

/// Photodiodes, a channel each: the power that falls on them [W], as if none stood in another's light.
class Photodiodes {
 public:
  /// Throws InvalidArgument for no photodiodes, or one without area or acceptance.
  template <class = void>
  explicit Photodiodes(std::vector<Photodiode> diodes);

  int channels(const Body&) const { return int(diodes_.size()); }
  /// Of several photodiodes behind each other the first one.
  template <class Vec3 = Vec3>
  int channel(const Escape& escape) const;
  int openings() const { return int(diodes_.size()); }
  template <class Vec3 = Vec3>
  Connection connect(int k, In<Vec3> from, double u, double v) const;

 private:
  template <class Vec3 = Vec3>
  static bool accepts(const Photodiode& d, In<Vec3> direction) { return -direction.dot(d.normal()) > std::cos(d.acceptance_rad) - 1e-12; }

  std::vector<Photodiode> diodes_;
};

static_assert(ConnectedReadout<Photodiodes>);

template <class>
inline Photodiodes::Photodiodes(std::vector<Photodiode> diodes) : diodes_(std::move(diodes)) {
  if (diodes_.empty()) throw InvalidArgument("photodiodes: none given, at least one is needed");
  for (const Photodiode& d : diodes_) {
    if (!d.center.allFinite()) throw InvalidArgument("photodiode: its centre is not finite");
    require_positive("area of a photodiode", d.area_m2(), "m2");
    require_in_range("acceptance angle of a photodiode", d.acceptance_rad * 180.0 / pi, 0.1, 90.0, "deg");
  }
}

template <class Vec3>
inline int Photodiodes::channel(const Escape& escape) const {
  int best = -1;
  double nearest = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < diodes_.size(); ++k) {
    const Photodiode& d = diodes_[k];
    if (!(escape.direction.dot(d.normal()) < 0.0) || !accepts(d, escape.direction)) continue;
    const double way = (d.center - escape.position).dot(d.normal()) / escape.direction.dot(d.normal());
    if (!(way > 0.0 && way < nearest)) continue;
    const Vec3 p = escape.position + way * escape.direction - d.center, n = d.half_u.cross(d.half_v);
    const double a = p.cross(d.half_v).dot(n) / n.squaredNorm(), b = d.half_u.cross(p).dot(n) / n.squaredNorm();
    if (d.round ? a * a + b * b < 1.0 : std::abs(a) < 1.0 && std::abs(b) < 1.0) best = int(k), nearest = way;
  }
  return best;
}

template <class Vec3>
inline Connection Photodiodes::connect(int k, In<Vec3> from, double u, double v) const {
  const Photodiode& d = diodes_[std::size_t(k)];
  const Vec3 at = d.center + (d.round ? detail::on_unit_disc(u, v, d.half_u, d.half_v) : Vec3((2.0 * u - 1.0) * d.half_u + (2.0 * v - 1.0) * d.half_v));
  const Vec3 way = at - from;
  const double length = way.norm();
  if (!(length > 0.0)) return {};
  const Vec3 direction = way / length;
  if (!(direction.dot(d.normal()) < 0.0) || !accepts(d, direction)) return {};
  return {direction, -direction.dot(d.normal()) * d.area_m2() / (length * length)};
}

}  // namespace lumo

// ---- lumo/optics/pinhole_camera.hpp

namespace lumo {

/// A camera with one small round opening. Channel row·columns + column holds the power [W] that passes the opening into that pixel; pixels are numbered from
/// the upper left corner of the upright image. The opening holds an ideal thin lens focused at `focus_m`: what lies at another distance z is
/// blurred to a disc of about 2 aperture_m |z/focus_m − 1| there, and nothing else is approximate.
class PinholeCamera {
 public:
  struct Config {
    Vec3 position = Vec3::Zero();        ///< of the opening [m]
    Vec3 view = Vec3::UnitZ();           ///< the way that the camera looks
    Vec3 up = Vec3::UnitY();             ///< what is up in the image; not along `view`
    double field_of_view_rad = 60.0 * pi / 180.0;  ///< across all columns
    int columns = 32;
    int rows = 32;
    double aperture_m = 0.25e-3;         ///< radius of the opening
    double focus_m = 20e-3;              ///< distance along `view` that is sharp
  };

  /// Throws InvalidArgument for numbers out of range.
  template <class = void>
  explicit PinholeCamera(const Config& config);

  const Config& config() const { return config_; }
  int channels(const Body&) const { return config_.columns * config_.rows; }
  template <class Vec3 = Vec3>
  int channel(const Escape& escape) const;
  int openings() const { return 1; }
  template <class Vec3 = Vec3>
  Connection connect(int, In<Vec3> from, double u, double v) const;
  /// Pixel that sees the point `p` [m], by the ray through the middle of the opening; −1: outside the image.
  template <class Vec3 = Vec3>
  int pixel(In<Vec3> p) const;

 private:
  int pixel_of(double right, double up) const;

  Config config_;
  Vec3 view_, right_, up_;
  double half_width_, half_height_;  ///< of the image at distance 1
};

static_assert(ConnectedReadout<PinholeCamera>);

template <class>
inline PinholeCamera::PinholeCamera(const Config& config) : config_(config) {
  require_in_range("columns of the camera", config.columns, 1, 4096, "");
  require_in_range("rows of the camera", config.rows, 1, 4096, "");
  require_in_range("field of view", config.field_of_view_rad * 180.0 / pi, 0.1, 170.0, "deg");
  require_in_range("radius of the camera's opening", config.aperture_m * 1e3, 1e-6, 1e3, "mm");
  require_positive("focus distance of the camera", config.focus_m, "m");
  if (!config.position.allFinite()) throw InvalidArgument("camera: its position is not finite");
  view_ = config.view.normalized();
  right_ = view_.cross(config.up).normalized();
  up_ = right_.cross(view_);
  if (!(std::abs(up_.norm() - 1.0) < 1e-9)) throw InvalidArgument("camera: the directions of view and up are not finite, or are parallel");
  half_width_ = std::tan(0.5 * config.field_of_view_rad);
  half_height_ = half_width_ * config.rows / config.columns;
}

inline int PinholeCamera::pixel_of(double right, double up) const {
  const double column = 0.5 * (right / half_width_ + 1.0) * config_.columns, row = 0.5 * (1.0 - up / half_height_) * config_.rows;
  if (!(column >= 0.0 && column < config_.columns && row >= 0.0 && row < config_.rows)) return -1;
  return int(row) * config_.columns + int(column);
}

template <class Vec3>
inline int PinholeCamera::pixel(In<Vec3> p) const {
  const Vec3 way = p - config_.position;
  const double z = way.dot(view_);
  return z > 0.0 ? pixel_of(way.dot(right_) / z, way.dot(up_) / z) : -1;
}

template <class Vec3>
inline int PinholeCamera::channel(const Escape& escape) const {
  const double toward = -escape.direction.dot(view_), z = (escape.position - config_.position).dot(view_);
  if (!(toward > 0.0 && z > 0.0)) return -1;
  const Vec3 hit = escape.position + (z / toward) * escape.direction;
  if (!((hit - config_.position).squaredNorm() < config_.aperture_m * config_.aperture_m)) return -1;
  return pixel(hit - (config_.focus_m / toward) * escape.direction);
}

template <class Vec3>
inline Connection PinholeCamera::connect(int, In<Vec3> from, double u, double v) const {
  const Vec3 way = config_.position + config_.aperture_m * detail::on_unit_disc(u, v, right_, up_) - from;
  const double length = way.norm(), toward = -way.dot(view_);
  if (!(toward > 0.0)) return {};
  return {way / length, toward / length * pi * config_.aperture_m * config_.aperture_m / (length * length)};
}

}  // namespace lumo

// ---- lumo/objective/contact_progression.hpp

namespace lumo {

/// A number with its numerical error (half width of an interval that should hold a much finer computation's value).
struct Estimate {
  double value = 0.0;
  double error = 0.0;
};

/// The three terms of progressive-constraint contact of one scenario (paper Eq. 3–5). What the loads do not define is empty.
struct ContactTerms {
  std::optional<Estimate> form;     ///< q_form: patch radius at 2 N over indenter radius
  std::optional<Estimate> stable;   ///< q_stable: overlap of the contact sets at 2 N and 10 N, on the reference surface
  std::optional<Estimate> stiff;    ///< q_stiff: 1 − κ(1→2 N)/κ(5→10 N)
  /// (q_form q_stable q_stiff)^(1/3).
  std::optional<Estimate> score() const;
};

/// Errors of areas, overlap and stiffness at the default mesh, from the refinement study (benchmarks/refinement/results.md).
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
template <class = void>
ContactTerms contact_terms(const Body& body, const TetMesh& mesh, const std::vector<MechanicalState>& states, double radius_m,
                           const MechanicalError& error = {}, const ContactLoads& loads = {});

/// How much less than the baseline a pad gives way at the same load, in percent: 100 (1 − δ/δ_baseline). Source: paper Table II.
inline double progressive_constraint_gain(double depth, double baseline_depth) { return 100.0 * (1.0 - depth / baseline_depth); }

namespace detail {

/// A term in [0, 1]; where it is cut off, what of its error reaches back over the edge.
inline Estimate clipped(const Estimate& e) {
  const double value = std::clamp(e.value, 0.0, 1.0);
  return {value, std::max(0.0, e.error - std::abs(e.value - value))};
}

}  // namespace detail

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

template <class>
inline ContactTerms contact_terms(const Body& body, const TetMesh& mesh, const std::vector<MechanicalState>& states, double radius_m,
                                  const MechanicalError& error, const ContactLoads& loads) {
  const auto at = [&](double load) -> const MechanicalState* {
    for (const MechanicalState& s : states)
      if (std::abs(s.load_N - load) <= 1e-9 * load && is_scored(s.status, true)) return &s;
    return nullptr;
  };
  const MechanicalState *one = at(loads.first), *two = at(loads.second), *three = at(loads.third), *four = at(loads.fourth);
  ContactTerms q;
  if (two) {
    const double form = std::sqrt(two->contact_area_m2 / (pi * radius_m * radius_m));
    q.form = detail::clipped({form, 0.5 * error.area * form});
  }
  if (two && four) {
    const ContactSurface surface(mesh, body, [](const Patch& p) { return p.contactable; });
    q.stable = Estimate{contact_overlap(surface, two->contact_field, four->contact_field, positions_of(mesh)).ratio(), error.overlap};
  }
  if (one && two && three && four) {
    const double early = (two->force_N - one->force_N) / (two->depth_m - one->depth_m);
    const double late = (four->force_N - three->force_N) / (four->depth_m - three->depth_m);
    const double ratio = early / late;
    // A held indenter's force may pass the next load before it moves on: no advance, no stiffness.
    const bool advanced = two->depth_m > one->depth_m && four->depth_m > three->depth_m;
    if (advanced && late > 0.0) q.stiff = detail::clipped({1.0 - ratio, std::sqrt(2.0) * error.stiffness * std::abs(ratio)});
  }
  return q;
}

}  // namespace lumo

// ---- lumo/objective/optical_separation.hpp

namespace lumo {

/// Response of one state with what it is compared by (paper Eq. 6–7).
struct ObservedState {
  std::size_t scenario;       ///< the caller's number of the scenario
  double diameter_m, angle_rad, y_m, load_N;
  Eigen::MatrixXd change;     ///< (r − r_0)/P_emit, replicates × regions
  TiltPlane tilt = TiltPlane::xz;
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
template <class MatrixXd = Eigen::MatrixXd>
inline Eigen::MatrixXd response_change(const Response& loaded, const Response& unloaded) {
  return (loaded.replicates - unloaded.replicates) / loaded.ledger.emitted;
}

/// Distance of two response changes and its standard error from paired replicates. The square of the distance is the mean over pairs of
/// *different* replicates of the scalar product of their differences (a U-statistic, Hoeffding 1948): unlike the square of the mean difference it
/// is not raised by noise. Where noise makes it negative the distance is 0. The error is that of the larger of distance and noise.
template <class MatrixXd = Eigen::MatrixXd, class RowVectorXd = Eigen::RowVectorXd>
Estimate response_distance(In<MatrixXd> a, In<MatrixXd> b);

/// May these two states be compared: same tool, angle and load, other place?
inline bool comparable(const ObservedState& a, const ObservedState& b) {
  return a.diameter_m == b.diameter_m && a.angle_rad == b.angle_rad && a.tilt == b.tilt && a.load_N == b.load_N && a.y_m != b.y_m;
}

/// States whose noise must fall before J_obs is known to `tolerance` (a fraction of it, one standard error): those of all pairs that come within
/// two errors (of the difference) of the least distance and are noisier than that. Ascending; empty: done, or nothing can be compared. A pure function, so that a
/// campaign that retraces them (Tracer::refined) stays deterministic. Retraced states need the unloaded body retraced with the same rays.
template <class = void>
std::vector<std::size_t> undecided_states(const std::vector<ObservedState>& states, double tolerance = 0.02);

/// Empty when no two states can be compared. Cost: all pairs.
template <class = void>
std::optional<Separation> optical_separation(const std::vector<ObservedState>& states, const OpticalError& error = {});

template <class MatrixXd, class RowVectorXd>
inline Estimate response_distance(In<MatrixXd> a, In<MatrixXd> b) {
  const MatrixXd d = a - b;
  const RowVectorXd mean = d.colwise().mean();
  const double n = double(d.rows());
  if (d.rows() < 2) return {mean.norm(), 0.0};
  const MatrixXd off = d.rowwise() - mean;
  const double noise2 = off.squaredNorm() / (n * (n - 1.0)), square = mean.squaredNorm() - noise2;
  const double distance = std::sqrt(std::max(0.0, square)), scale = std::sqrt(std::max(square, noise2));
  if (scale == 0.0) return {0.0, 0.0};
  // To first order the distance moves with the replicates' components along the mean difference; where there is little but noise that
  // overstates the error somewhat, since the mean difference is noise, too.
  return {distance, std::sqrt((off * mean.transpose()).squaredNorm() / (n * (n - 1.0))) / scale};
}

namespace detail {

/// Distances of all pairs that may be compared.
template <class = void>
inline std::vector<Separation> separations(const std::vector<ObservedState>& states) {
  std::vector<Separation> pairs;
  for (std::size_t i = 0; i < states.size(); ++i)
    for (std::size_t j = i + 1; j < states.size(); ++j)
      if (comparable(states[i], states[j])) pairs.push_back({response_distance(states[i].change, states[j].change), i, j});
  return pairs;
}

}  // namespace detail

template <class>
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

template <class>
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
  std::optional<Design> repaired(Design x, std::uint64_t key) const;
  static double excess(const LinearConstraint& c, const Design& x);
  void settle(const LinearConstraint& c, Design& x, std::uint64_t key) const;
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

/// By how much a sum is above its upper limit, or (negative) below its lower one, and a little more, so that rounding does not matter.
inline double DesignSampler::excess(const LinearConstraint& c, const Design& x) {
  const double sum = c.sum(x), inside = std::min(1e-9 * std::abs(sum), std::isfinite(c.upper - c.lower) ? 0.5 * (c.upper - c.lower) : 1.0);
  return sum > c.upper ? sum - c.upper + inside : sum < c.lower ? sum - c.lower - inside : 0.0;
}

/// Moves single lattice variables by the steps that the excess is worth, in an order that hangs on the key, where that lessens it.
inline void DesignSampler::settle(const LinearConstraint& c, Design& x, std::uint64_t key) const {
  for (std::size_t k = 0; k < x.size(); ++k) {
    const double before = excess(c, x);
    if (std::abs(before) <= c.rounding(x)) return;
    const std::size_t i = (std::size_t(key % x.size()) + k) % x.size();
    if (axes_[i].nodes == 0.0 || c.coefficients[i] == 0.0) continue;
    const double steps = -before / (c.coefficients[i] * space_.variables[i].step);
    Design moved = x;
    moved[i] = shifted(i, x[i], std::copysign(std::ceil(std::abs(steps) - 1e-6), steps) * space_.variables[i].step);
    if (std::abs(excess(c, moved)) < std::abs(before)) x = std::move(moved);
  }
}

/// Projects on the linear constraints in turn until all hold; nothing when that does not end. For spaces that random points hardly hit.
inline std::optional<Design> DesignSampler::repaired(Design x, std::uint64_t key) const {
  for (int sweep = 0; sweep < 100; ++sweep) {
    if (space_.contains(x)) return x;
    for (const LinearConstraint& c : space_.constraints) {
      const double too_much = excess(c, x);
      if (too_much == 0.0) continue;
      double norm = 0.0;  // variables count by their range
      for (std::size_t i = 0; i < x.size(); ++i) norm += std::pow(c.coefficients[i] * (space_.variables[i].upper - space_.variables[i].lower), 2);
      if (!(norm > 0.0)) return std::nullopt;
      for (std::size_t i = 0; i < x.size(); ++i) {
        const double range = space_.variables[i].upper - space_.variables[i].lower;
        const double by = -too_much * c.coefficients[i] * range * range / norm;
        x[i] = axes_[i].nodes > 0.0 ? (std::abs(by) > 0.25 * space_.variables[i].step ? shifted(i, x[i], by) : x[i]) : shifted(i, x[i], by);
      }
      settle(c, x, detail::combine(key, std::uint64_t(sweep)));   // what rounding left, or was too little to move any
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
      auto repair = repaired(x, detail::combine(key, index));
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

template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
inline Eigen::MatrixXd columns(const std::vector<Design>& designs, std::size_t rows) {
  MatrixXd x(Eigen::Index(rows), Eigen::Index(designs.size()));
  for (std::size_t i = 0; i < designs.size(); ++i) x.col(Eigen::Index(i)) = Eigen::Map<const VectorXd>(designs[i].data(), Eigen::Index(rows));
  return x;
}

}  // namespace detail

/// The paper's: a number of fresh feasible designs, the best of them.
struct FreshCandidates {
  std::size_t count = 256;

  template <class = void>
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

  template <class VectorXd = Eigen::VectorXd>
  std::optional<Design> best(const CandidateRequest& request, const Score& score) const;
};

template <class VectorXd>
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
  const VectorXd scores = score(detail::columns(pool, sampler.dimensions()));
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
      const VectorXd values = score(detail::columns(moves, sampler.dimensions()));
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
  if (a >= detail::ExcessTable::edge) return a;
  if (a >= -detail::ExcessTable::edge) return detail::ExcessTable::get()(a);
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
  template <class ArrayXXd = Eigen::ArrayXXd>
  Eigen::ArrayXXd correlation(In<ArrayXXd> r2) const { return (-0.5 * r2).exp(); }
  template <class ArrayXXd = Eigen::ArrayXXd>
  Eigen::ArrayXXd slope(In<ArrayXXd>, In<ArrayXXd> correlation) const { return -0.5 * correlation; }
};

/// Matérn with ν = 5/2: (1 + s + s²/3) e⁻ˢ with s = √5 r. Samples have two derivatives. Source: Stein, Interpolation of Spatial Data, 1999.
struct Matern52Kernel {
  template <class ArrayXXd = Eigen::ArrayXXd>
  Eigen::ArrayXXd correlation(In<ArrayXXd> r2) const {
    const ArrayXXd s = (5.0 * r2).sqrt();
    return (1.0 + s + s.square() / 3.0) * (-s).exp();
  }
  template <class ArrayXXd = Eigen::ArrayXXd>
  Eigen::ArrayXXd slope(In<ArrayXXd> r2, In<ArrayXXd> correlation) const {
    const ArrayXXd s = (5.0 * r2).sqrt();
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
  using MatrixXd = Dependent<Eigen::MatrixXd, Kernel>;
  using VectorXd = Dependent<Eigen::VectorXd, Kernel>;
  using ArrayXXd = Dependent<Eigen::ArrayXXd, Kernel>;

 public:
  struct Value {
    double log_likelihood = -std::numeric_limits<double>::infinity();  ///< −∞ where the covariance is not positive definite
    double log_prior = 0.0;
    double mean = 0.0;
    VectorXd gradient;            ///< d log_likelihood / d ln(length scales, noise)
    VectorXd posterior_gradient;  ///< d (log_likelihood + log_prior) / d the same
  };

  /// `x`: d × n, normalised; `y`: n, standardised.
  MarginalLikelihood(const MatrixXd& x, const VectorXd& y, Kernel kernel, HyperparameterPrior prior);

  Value operator()(const Hyperparameters& h, bool with_gradient = true) const;

 private:
  Eigen::Index size_;
  VectorXd y_;
  Kernel kernel_;
  HyperparameterPrior prior_;
  MatrixXd squares_;  ///< (pair i > k, input): squared difference; pairs column by column of the lower triangle
};

template <CovarianceKernel Kernel>
MarginalLikelihood<Kernel>::MarginalLikelihood(const MatrixXd& x, const VectorXd& y, Kernel kernel, HyperparameterPrior prior)
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

  const VectorXd weight = h.length_scale.array().square().inverse();
  const ArrayXXd r2 = squares_ * weight, correlation = kernel_.correlation(r2);
  MatrixXd covariance = MatrixXd::Zero(n, n);
  for (Eigen::Index k = 0, first = 0; k < n; first += n - 1 - k, ++k) {
    covariance(k, k) = 1.0 + h.noise;
    covariance.col(k).tail(n - 1 - k) = correlation.col(0).segment(first, n - 1 - k);
  }
  const Eigen::LLT<MatrixXd> factor(covariance);
  if (factor.info() != Eigen::Success) return value;

  MatrixXd both(n, 2);
  both << y_, VectorXd::Ones(n);
  factor.solveInPlace(both);
  value.mean = both.col(0).sum() / both.col(1).sum();
  const VectorXd alpha = both.col(0) - value.mean * both.col(1);
  double log_determinant = 0.0;
  for (Eigen::Index i = 0; i < n; ++i) log_determinant += 2.0 * std::log(factor.matrixLLT()(i, i));
  value.log_likelihood = -0.5 * (alpha.dot((y_.array() - value.mean).matrix()) + log_determinant + double(n) * std::log(2.0 * pi));
  if (!std::isfinite(value.log_likelihood)) value.log_likelihood = -std::numeric_limits<double>::infinity();
  if (!with_gradient || !std::isfinite(value.log_likelihood)) return value;

  // ½ tr((α αᵀ − K⁻¹) dK): each pair counts twice. The mean is at its optimum and adds nothing.
  MatrixXd inverse_factor = MatrixXd::Identity(n, n);
  for (Eigen::Index first = 0; first < n; first += 32) {  // in blocks of columns, which are zero above the diagonal
    auto below = inverse_factor.block(first, first, n - first, std::min<Eigen::Index>(32, n - first));
    factor.matrixLLT().bottomRightCorner(n - first, n - first).template triangularView<Eigen::Lower>().solveInPlace(below);
  }
  MatrixXd inverse = MatrixXd::Zero(n, n);
  inverse.template selfadjointView<Eigen::Lower>().rankUpdate(inverse_factor.transpose());
  ArrayXXd pull = kernel_.slope(r2, correlation);
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
  template <class Function, class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
  Minimum minimize(Function&& function, std::type_identity_t<VectorXd> start, In<VectorXd> lower, In<VectorXd> upper,
                   In<std::optional<MatrixXd>> hessian = std::nullopt) const;
};

template <class Function, class MatrixXd, class VectorXd>
Minimum QuasiNewton::minimize(Function&& function, std::type_identity_t<VectorXd> start, In<VectorXd> lower, In<VectorXd> upper,
                              In<std::optional<MatrixXd>> known) const {
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

  MatrixXd hessian = known.value_or(MatrixXd::Identity(n, n));
  bool fresh = !known;  // the Hessian has seen no curvature yet
  VectorXd step(n), trial(n), slope(n);
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
    const MatrixXd block = hessian(free, free);
    step(free) = -block.llt().solve(VectorXd(best.gradient(free)));
    if (!step.allFinite() || step.dot(best.gradient) >= 0.0) {
      hessian.setIdentity();
      fresh = true;
      step.setZero();
      step(free) = -VectorXd(best.gradient(free));
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
    const VectorXd s = trial - best.x;
    VectorXd y = slope - best.gradient;
    if (fresh && s.dot(y) > 0.0) hessian = MatrixXd::Identity(n, n) * (y.squaredNorm() / s.dot(y));
    const VectorXd hs = hessian * s;
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
template <class MatrixXd = Eigen::MatrixXd>
inline std::optional<JitteredFactor> jittered_factor(In<MatrixXd> covariance) {
  const double top = covariance.size() ? covariance.diagonal().maxCoeff() : 0.0;
  for (double jitter = 0.0; jitter <= 2e-4; jitter = jitter == 0.0 ? 1e-12 : 10.0 * jitter) {
    MatrixXd a = covariance;
    a.diagonal().array() += jitter * top;
    const Eigen::LLT<MatrixXd> factor(a);
    if (factor.info() == Eigen::Success && factor.matrixLLT().diagonal().minCoeff() > 0.0)
      return JitteredFactor{MatrixXd(factor.matrixL()), jitter * top};
  }
  return std::nullopt;
}

/// Gaussian process regression with a constant mean, one length scale per input and homoscedastic noise. Inputs are normalised by their
/// bounds and outputs standardised (n − 1) inside; everything is told in the units of the data. Equal inputs and constant outputs are fine.
template <CovarianceKernel Kernel = RbfKernel>
class GaussianProcess {
  using MatrixXd = Dependent<Eigen::MatrixXd, Kernel>;
  using VectorXd = Dependent<Eigen::VectorXd, Kernel>;
  using ArrayXXd = Dependent<Eigen::ArrayXXd, Kernel>;
  using ArrayXd = Dependent<Eigen::ArrayXd, Kernel>;

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
    VectorXd mean, variance;
  };
  Prediction predict(const MatrixXd& x) const;
  Eigen::VectorXd mean(const MatrixXd& x) const;
  /// Posterior covariance of the latent function between two sets of points.
  Eigen::MatrixXd covariance(const MatrixXd& a, const MatrixXd& b) const;
  /// Joint samples at the columns of `x`: points × samples, from standard normal numbers of the same shape. Empty when the covariance
  /// cannot be factorised.
  std::optional<Eigen::MatrixXd> sample(const MatrixXd& x, const MatrixXd& normals) const;
  /// What each observation would be predicted as without it, with its noise, from the fitted hyper-parameters.
  /// Source: Rasmussen & Williams 2006, eq. 5.12.
  Prediction leave_one_out() const;

  /// K(X, x) after forward substitution: V with posterior covariance k(a, b) − V(a)ᵀV(b). In standardised units.
  Eigen::MatrixXd whitened(const MatrixXd& unit_x) const {
    MatrixXd v = correlation(x_, unit_x);
    factor_.matrixL().solveInPlace(v);
    return v;
  }
  Eigen::MatrixXd correlation(const MatrixXd& unit_a, const MatrixXd& unit_b) const;
  Eigen::MatrixXd normalized(const MatrixXd& x) const { return ((x.colwise() - lower_).array().colwise() * inverse_width_.array()).matrix(); }
  const VectorXd& weights() const { return whitened_y_; }  ///< L⁻¹(y − mean), standardised
  double output_mean() const { return output_mean_; }
  double output_scale() const { return output_scale_; }

 private:
  MatrixXd x_;  ///< normalised
  VectorXd y_;  ///< standardised
  VectorXd lower_, inverse_width_;
  double output_mean_ = 0.0, output_scale_ = 1.0;
  Hyperparameters hyperparameters_;
  Config config_;
  Eigen::LLT<MatrixXd> factor_;
  VectorXd whitened_y_;
  double jitter_ = 0.0;
  bool converged_ = true;

  explicit GaussianProcess(const TrainingData& data, const Config& config);
  void condition(const Hyperparameters& h);
  // The search for hyper-parameters is in their logarithms; it minimises −(log p(y) + log prior)/n.
  static Hyperparameters unpack(const VectorXd& u);
  static double negative(const MarginalLikelihood<Kernel>& likelihood, Eigen::Index n, const VectorXd& u, VectorXd* gradient);
  Eigen::VectorXd modes() const;
  Minimum descend(const MarginalLikelihood<Kernel>& likelihood, Eigen::Index n, const VectorXd& start, const std::optional<MatrixXd>& hessian = std::nullopt) const;
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
  const VectorXd scaled = data.y / size;
  const double mean = scaled.mean();
  const double deviation = n > 1 ? std::sqrt((scaled.array() - mean).square().sum() / double(n - 1)) : 0.0;
  const bool constant = deviation < 1e-14;  // no more than rounding
  output_mean_ = mean * size;
  output_scale_ = constant ? 1.0 : deviation * size;
  y_ = constant ? VectorXd::Zero(n) : VectorXd((scaled.array() - mean) / deviation);
}

template <CovarianceKernel Kernel>
GaussianProcess<Kernel>::GaussianProcess(const TrainingData& data, const Hyperparameters& h, const Config& config) : GaussianProcess(data, config) {
  if (h.length_scale.size() != x_.rows() || !(h.length_scale.minCoeff() > 0.0) || !(h.noise >= 0.0))
    throw InvalidArgument(detail::text("Gaussian process: needs ", x_.rows(), " length scales > 0 and a noise variance >= 0, has ", h.length_scale.size(), " and ", h.noise));
  condition(h);
}

template <CovarianceKernel Kernel>
Eigen::MatrixXd GaussianProcess<Kernel>::correlation(const MatrixXd& unit_a, const MatrixXd& unit_b) const {
  const ArrayXd inverse = hyperparameters_.length_scale.array().inverse();
  const MatrixXd a = (unit_a.array().colwise() * inverse).matrix(), b = (unit_b.array().colwise() * inverse).matrix();
  ArrayXXd r2 = ArrayXXd::Zero(a.cols(), b.cols());
  for (Eigen::Index i = 0; i < b.cols(); ++i)
    for (Eigen::Index j = 0; j < a.rows(); ++j) r2.col(i) += (a.row(j).array() - b(j, i)).square().transpose();
  return config_.kernel.correlation(r2);
}

template <CovarianceKernel Kernel>
void GaussianProcess<Kernel>::condition(const Hyperparameters& h) {
  hyperparameters_ = h;
  MatrixXd covariance = correlation(x_, x_);
  covariance.diagonal().array() += h.noise;
  for (jitter_ = 0.0;; jitter_ = jitter_ == 0.0 ? 1e-12 : 10.0 * jitter_) {
    if (jitter_ > 2e-4) throw InvalidArgument("Gaussian process: covariance is not positive definite, even with a jitter of 1e-4");
    MatrixXd a = covariance;
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
Hyperparameters GaussianProcess<Kernel>::unpack(const VectorXd& u) {
  const Eigen::Index d = u.size() - 1;
  return {u.head(d).unaryExpr([](double v) { return std::exp(v); }), std::exp(u[d]), 0.0};
}

template <CovarianceKernel Kernel>
double GaussianProcess<Kernel>::negative(const MarginalLikelihood<Kernel>& likelihood, Eigen::Index n, const VectorXd& u, VectorXd* gradient) {
  const auto value = likelihood(unpack(u), gradient != nullptr);
  if (!std::isfinite(value.log_likelihood)) return std::numeric_limits<double>::infinity();
  if (gradient) *gradient = -value.posterior_gradient / double(n);
  return -(value.log_likelihood + value.log_prior) / double(n);
}

template <CovarianceKernel Kernel>
Eigen::VectorXd GaussianProcess<Kernel>::modes() const {
  VectorXd u = VectorXd::Constant(x_.rows() + 1, std::log(prior().length_scale.mode()));
  u[x_.rows()] = std::log(prior().noise.mode());
  return u;
}

template <CovarianceKernel Kernel>
Minimum GaussianProcess<Kernel>::descend(const MarginalLikelihood<Kernel>& likelihood, Eigen::Index n, const VectorXd& start,
                                         const std::optional<MatrixXd>& hessian) const {
  const Eigen::Index d = x_.rows();
  const HyperparameterPrior p = prior();
  VectorXd lower = VectorXd::Constant(d + 1, std::log(p.min_length_scale)), upper = VectorXd::Constant(d + 1, std::log(p.max_length_scale));
  lower[d] = std::log(p.min_noise);
  upper[d] = std::log(p.max_noise);
  return config_.search.minimize([&](const VectorXd& u, VectorXd& gradient) { return negative(likelihood, n, u, &gradient); }, start, lower, upper, hessian);
}

/// One start stops in local optima: after the prior's modes come the most promising of some places spread between short and long length
/// scales, little and much noise.
template <CovarianceKernel Kernel>
std::vector<Minimum> GaussianProcess<Kernel>::optima(const MarginalLikelihood<Kernel>& likelihood, Eigen::Index n) const {
  const Eigen::Index d = x_.rows();
  std::vector<Minimum> found = {descend(likelihood, n, modes())};
  std::vector<std::pair<double, VectorXd>> probes;
  for (int k = 0; config_.starts > 1 && k < config_.probes; ++k) {
    VectorXd u(d + 1);
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
typename GaussianProcess<Kernel>::Prediction GaussianProcess<Kernel>::predict(const MatrixXd& x) const {
  const MatrixXd v = whitened(normalized(x));
  const VectorXd standard = (v.transpose() * whitened_y_).array() + hyperparameters_.mean;
  const VectorXd variance = (1.0 - v.colwise().squaredNorm().array()).max(0.0).transpose();
  return {(output_mean_ + output_scale_ * standard.array()).matrix(), output_scale_ * output_scale_ * variance};
}

template <CovarianceKernel Kernel>
Eigen::VectorXd GaussianProcess<Kernel>::mean(const MatrixXd& x) const {
  const VectorXd alpha = factor_.matrixU().solve(whitened_y_);
  return (output_mean_ + output_scale_ * ((correlation(normalized(x), x_) * alpha).array() + hyperparameters_.mean)).matrix();
}

template <CovarianceKernel Kernel>
Eigen::MatrixXd GaussianProcess<Kernel>::covariance(const MatrixXd& a, const MatrixXd& b) const {
  const MatrixXd ua = normalized(a), ub = normalized(b);
  return output_scale_ * output_scale_ * (correlation(ua, ub) - whitened(ua).transpose() * whitened(ub));
}

template <CovarianceKernel Kernel>
std::optional<Eigen::MatrixXd> GaussianProcess<Kernel>::sample(const MatrixXd& x, const MatrixXd& normals) const {
  if (normals.rows() != x.cols()) throw InvalidArgument(detail::text("samples at ", x.cols(), " points need as many rows of normal numbers, not ", normals.rows()));
  const auto factor = jittered_factor(covariance(x, x));
  if (!factor) return std::nullopt;
  return (factor->lower * normals).colwise() + predict(x).mean;
}

template <CovarianceKernel Kernel>
typename GaussianProcess<Kernel>::Prediction GaussianProcess<Kernel>::leave_one_out() const {
  const MatrixXd inverse = factor_.solve(MatrixXd::Identity(size(), size()));
  const VectorXd alpha = factor_.matrixU().solve(whitened_y_);
  const ArrayXd variance = inverse.diagonal().array().inverse();
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

  template <class MatrixXd = Eigen::MatrixXd>
  Eigen::MatrixXd objectives(In<MatrixXd> y) const {
    MatrixXd least(Eigen::Index(terms.size()), y.cols());
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
  using MatrixXd = Dependent<Eigen::MatrixXd, Kernel>;
  using VectorXd = Dependent<Eigen::VectorXd, Kernel>;

 public:
  /// `normals`: base points × draws. Throws InvalidArgument when they do not fit.
  ConditionalPosterior(const GaussianProcess<Kernel>& gp, const MatrixXd& base, const MatrixXd& normals)
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
    if (base_.cols() == 0) return MatrixXd(0, std::max<Eigen::Index>(1, normals_.cols()));
    const MatrixXd standard = (factor_ * normals_).colwise() + standard_mean(whitened_);
    return (gp_->output_mean() + gp_->output_scale() * standard.array()).matrix();
  }

  /// Given each draw, the latent function at the columns of `x` is normal with these means (points × draws) and deviations (points).
  struct Conditional {
    MatrixXd mean;
    VectorXd deviation;
  };
  Conditional at(const MatrixXd& x) const {
    const MatrixXd unit = gp_->normalized(x), v = gp_->whitened(unit);
    VectorXd variance = (1.0 - v.colwise().squaredNorm().array()).transpose();
    MatrixXd standard = standard_mean(v);
    if (base_.cols() > 0) {
      MatrixXd cross = gp_->correlation(base_, unit) - whitened_.transpose() * v;
      factor_.template triangularView<Eigen::Lower>().solveInPlace(cross);
      variance.array() -= cross.colwise().squaredNorm().array().transpose();
      standard = (cross.transpose() * normals_).colwise() + VectorXd(standard.col(0));
    }
    const double scale = gp_->output_scale();
    return {(gp_->output_mean() + scale * standard.array()).matrix(), scale * variance.cwiseMax(1e-18).cwiseSqrt()};
  }

  double jitter() const { return jitter_; }

 private:
  Eigen::VectorXd standard_mean(const MatrixXd& v) const { return ((v.transpose() * gp_->weights()).array() + gp_->hyperparameters().mean).matrix(); }

  const GaussianProcess<Kernel>* gp_;
  MatrixXd base_, normals_, whitened_, factor_;
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
template <class MatrixXd = Eigen::MatrixXd>
inline Eigen::MatrixXd base_points(const Evidence& evidence, bool noisy) {
  if (!noisy) return evidence.pending;
  MatrixXd base(evidence.x.rows(), evidence.x.cols() + evidence.pending.cols());
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
template <class MatrixXd = Eigen::MatrixXd>
inline std::vector<Eigen::Index> pareto_front(In<MatrixXd> y) {
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
template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
inline void slice(In<MatrixXd> y, Eigen::Index along, VectorXd& low, VectorXd& high, In<VectorXd> reference,
                  std::vector<VectorXd>& lower, std::vector<VectorXd>& upper) {
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
template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
inline BoxDecomposition nondominated_boxes(In<MatrixXd> y, In<VectorXd> reference) {
  if (reference.size() < 1 || (y.cols() > 0 && y.rows() != reference.size()))
    throw InvalidArgument(detail::text("points have ", y.rows(), " objectives, the reference point has ", reference.size()));
  std::vector<Eigen::Index> above;
  for (Eigen::Index i = 0; i < y.cols(); ++i)
    if ((y.col(i).array() > reference.array()).all()) above.push_back(i);
  MatrixXd front = y.cols() ? MatrixXd(y(Eigen::all, above)) : MatrixXd(reference.size(), 0);
  front = MatrixXd(front(Eigen::all, pareto_front(front)));
  std::vector<VectorXd> lower, upper;
  VectorXd low(reference.size()), high(reference.size());
  detail::slice(front, 0, low, high, reference, lower, upper);
  BoxDecomposition boxes{MatrixXd(reference.size(), Eigen::Index(lower.size())), MatrixXd(reference.size(), Eigen::Index(lower.size()))};
  for (std::size_t k = 0; k < lower.size(); ++k) {
    boxes.lower.col(Eigen::Index(k)) = lower[k];
    boxes.upper.col(Eigen::Index(k)) = upper[k];
  }
  return boxes;
}

/// Volume between `reference` and what the columns of `y` (objectives × points, maximised) dominate; points not above it add nothing.
/// Exact for any number of objectives, by slicing along the last. Source: Zitzler, 2001; While, Hingston, Barone & Huband, 2006.
template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
inline double hypervolume(In<MatrixXd> y, In<VectorXd> reference) {
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
      volume += height * hypervolume(MatrixXd(y(Eigen::all, reach).topRows(m - 1)), reference.head(m - 1));
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
  template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
  ExpectedHypervolume(In<MatrixXd> y, In<VectorXd> reference) : boxes_(nondominated_boxes(y, reference)) {}

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
      const auto m = Eigen::Index(posteriors_.size()), drawn = Eigen::Index(improvements_.size());
      std::vector<typename ConditionalPosterior<Kernel>::Conditional> at;
      for (const auto& p : posteriors_) at.push_back(p.at(x));
      Eigen::VectorXd mean(m), deviation(m), sum = Eigen::VectorXd::Zero(x.cols());
      const auto load = [&](Eigen::Index i, Eigen::Index s) {
        for (Eigen::Index j = 0; j < m; ++j) mean[j] = at[std::size_t(j)].mean(i, s), deviation[j] = at[std::size_t(j)].deviation[i];
      };
      for (Eigen::Index s = 0; s < drawn; ++s)
        for (Eigen::Index i = 0; i < x.cols(); ++i) {
          load(i, s);
          sum[i] += improvements_[std::size_t(s)].value(mean, deviation);
        }
      std::vector<double> logs(improvements_.size());
      for (Eigen::Index i = 0; i < x.cols(); ++i) {
        if (sum[i] > 1e-280 && std::isfinite(sum[i])) {
          sum[i] = std::log(sum[i] / double(drawn));
          continue;
        }
        for (Eigen::Index s = 0; s < drawn; ++s) {   // hopeless, but to be ranked
          load(i, s);
          logs[std::size_t(s)] = improvements_[std::size_t(s)].log_value(mean, deviation);
        }
        sum[i] = log_sum_exp(logs.begin(), logs.end()) - std::log(double(drawn));
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
    const Eigen::MatrixXd base = noisy ? contenders(models, evidence) : evidence.pending;
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
              const double side = std::log(boxes.upper(j, k) - boxes.lower(j, k));   // ∞ where the box is open
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

// ---- lumo/optimize/success_model.hpp

namespace lumo {

/// How likely an evaluation is to succeed, for objectives that are not defined everywhere and do not say where: a Gaussian process of 1 where
/// one succeeded and 0 where it failed for good, and the probability that it is above one half. Labels are taken as numbers with noise, so
/// that no iteration is needed. Source: hidden constraints of Lee, Gramacy, Linkletter & Gray, Pacific J. Optim. 7 (2011); their
/// probability as a factor of the acquisition: Gelbart, Snoek & Adams, UAI 2014.
template <CovarianceKernel Kernel = RbfKernel>
class SuccessModel {
  using MatrixXd = Dependent<Eigen::MatrixXd, Kernel>;
  using VectorXd = Dependent<Eigen::VectorXd, Kernel>;

 public:
  static constexpr double least_probability = 1e-12;   ///< so that a design remains to be chosen where all are thought to fail
  static constexpr double negligible = 1e-3;           ///< utility that is not worth a failure: of objectives in units of their spread

  /// Designs (d × n each) inside [lower, upper], at least one in all. Throws InvalidArgument as GaussianProcess::fit().
  SuccessModel(const MatrixXd& succeeded, const MatrixXd& failed, const VectorXd& lower, const VectorXd& upper, const typename GaussianProcess<Kernel>::Config& config = {})
      : process_(GaussianProcess<Kernel>::fit(labelled(succeeded, failed, lower, upper), config)) {}

  /// log P(success) at the columns of `x`, from log least_probability to 0.
  Eigen::VectorXd log_probability(const Eigen::MatrixXd& x) const;

  /// log((utility + negligible) P(success)) from log utility at the columns of `x`. Where a search has converged on the edge of what fails, all
  /// that still promises anything lies beyond it, by many orders of magnitude; without the constant it would be asked to no end.
  Eigen::VectorXd expected(const Eigen::VectorXd& log_utility, const Eigen::MatrixXd& x) const {
    const VectorXd floor = VectorXd::Constant(x.cols(), std::log(negligible)), high = log_utility.cwiseMax(floor), low = log_utility.cwiseMin(floor);
    return high + (low - high).array().exp().log1p().matrix() + log_probability(x);
  }

 private:
  static TrainingData labelled(const MatrixXd& succeeded, const MatrixXd& failed, const VectorXd& lower, const VectorXd& upper) {
    MatrixXd x(lower.size(), succeeded.cols() + failed.cols());
    x << succeeded, failed;
    VectorXd y(x.cols());
    y << VectorXd::Ones(succeeded.cols()), VectorXd::Zero(failed.cols());
    return {x, y, lower, upper};
  }

  GaussianProcess<Kernel> process_;
};

template <CovarianceKernel Kernel>
Eigen::VectorXd SuccessModel<Kernel>::log_probability(const Eigen::MatrixXd& x) const {
  const auto label = process_.predict(x);
  VectorXd log(x.cols());
  for (Eigen::Index i = 0; i < x.cols(); ++i) {
    const double deviation = std::max(std::sqrt(label.variance[i]), 1e-9);   // labels are of order 1
    log[i] = std::log(std::max(normal_probability((label.mean[i] - 0.5) / deviation), least_probability));
  }
  return log;
}

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

  /// Inputs (d × n) of the trials in a state, by id; failed ones only where the failure lay in the design.
  template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
  Eigen::MatrixXd designs(Trial::State state) const;
  /// Outputs of the told trials (outputs × n) by id, in their own units and sense.
  template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
  Eigen::MatrixXd told_outputs() const;

 private:
  Trial& pending(int id);
  bool superseded(const Trial& trial) const;
  bool tries_left(const Trial& trial) const;

  Problem problem_;
  DesignSampler sampler_;
  int outputs_, retries_;
  std::vector<Design> starts_;
  std::vector<Trial> trials_;
  DesignSet taken_;
};

/// By a later trial of its design.
inline bool TrialLog::superseded(const Trial& trial) const {
  return std::any_of(trials_.begin() + trial.id + 1, trials_.end(), [&](const Trial& t) { return t.x == trial.x; });
}

inline bool TrialLog::tries_left(const Trial& trial) const {
  return std::count_if(trials_.begin(), trials_.end(), [&](const Trial& t) { return t.x == trial.x; }) <= retries_;
}

inline std::optional<Design> TrialLog::scheduled() const {
  for (const Trial& t : trials_)
    if (t.state == Trial::State::failed && t.retry && !superseded(t) && tries_left(t)) return t.x;
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

template <class MatrixXd, class VectorXd>
inline Eigen::MatrixXd TrialLog::designs(Trial::State state) const {
  MatrixXd x(Eigen::Index(sampler_.dimensions()), count(state));
  Eigen::Index column = 0;
  for (const Trial& t : trials_)
    if (t.state == state && !(state == Trial::State::failed && t.retry)) x.col(column++) = Eigen::Map<const VectorXd>(t.x.data(), x.rows());
  return x.leftCols(column);
}

template <class MatrixXd, class VectorXd>
inline Eigen::MatrixXd TrialLog::told_outputs() const {
  MatrixXd y(outputs_, count(Trial::State::told));
  Eigen::Index column = 0;
  for (const Trial& t : trials_)
    if (t.state == Trial::State::told) y.col(column++) = Eigen::Map<const VectorXd>(t.outputs.data(), outputs_);
  return y;
}

}  // namespace lumo

// ---- lumo/optimize/optimizer.hpp

namespace lumo {

/// Bayesian optimisation by ask and tell: it never calls an objective. First come the problem's initial designs, then Sobol points, then the
/// candidate of highest acquisition under Gaussian processes of what was told, given what is still pending. Once a trial has failed for a reason of its design
/// it is that of highest acquisition times the probability of success. Answers may come in any order.
/// Law: a proposal is a function of the problem, the configuration and the trials before it, to the bit; so whoever keeps the trials can
/// restore() them and go on. No design is asked twice, except after a failure that may be retried.
template <CovarianceKernel Kernel = RbfKernel, class AcquisitionPolicy = LogNehvi, CandidateSource Source = LocalSearchCandidates, Reduction R = EachOutput>
  requires Acquisition<AcquisitionPolicy, std::vector<GaussianProcess<Kernel>>, R>
class Optimizer {
  using MatrixXd = Dependent<Eigen::MatrixXd, Kernel>;
  using VectorXd = Dependent<Eigen::VectorXd, Kernel>;
  using ArrayXXd = Dependent<Eigen::ArrayXXd, Kernel>;

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
  std::optional<Trial> ask();

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
  std::vector<Outcome> front() const;

  /// What the front dominates above the reference point, in the product of the objectives' units.
  double hypervolume() const;

  /// Models of the told outputs as they are in evidence(). Empty before two trials are told.
  const std::vector<GaussianProcess<Kernel>>& models();

  /// Told and pending trials as models and acquisition see them: outputs less their reference, larger is better, in units of the spread of
  /// their objective.
  Evidence evidence() const;

 private:
  const Objective& objective(int j) const { return problem().objectives[std::size_t(j)]; }

  /// Objectives of the told trials (objectives × n) in their units, larger is better.
  Eigen::MatrixXd objectives() const;

  /// Where evaluations succeed; nothing while none has failed for a reason of its design.
  std::optional<SuccessModel<Kernel>> success(const Evidence& e) const;

  /// The candidate of highest acquisition; a fresh design while there is too little for a model.
  std::optional<Design> chosen();

  Config config_;
  TrialLog log_;
  bool exhausted_ = false;
  std::vector<GaussianProcess<Kernel>> models_;
  int modelled_ = 0;  ///< told trials that the models know
};

template <CovarianceKernel K, class A, CandidateSource S, Reduction R>
  requires Acquisition<A, std::vector<GaussianProcess<K>>, R>
std::optional<Trial> Optimizer<K, A, S, R>::ask() {
  if (told() + pending() >= problem().evaluations) return std::nullopt;
  auto x = log_.scheduled();
  if (!x) x = chosen();
  exhausted_ = !x;
  if (!x) return std::nullopt;
  return log_.open(int(trials().size()), std::move(*x));
}

template <CovarianceKernel K, class A, CandidateSource S, Reduction R>
  requires Acquisition<A, std::vector<GaussianProcess<K>>, R>
std::vector<Outcome> Optimizer<K, A, S, R>::front() const {
  std::vector<int> ids;
  for (const Trial& t : trials())
    if (t.state == Trial::State::told) ids.push_back(t.id);
  const MatrixXd y = objectives();
  std::vector<Outcome> out;
  for (const Eigen::Index i : pareto_front(y)) {
    out.push_back({ids[std::size_t(i)], {}});
    for (Eigen::Index j = 0; j < y.rows(); ++j) out.back().objectives.push_back(problem().objectives[std::size_t(j)].signed_value(y(j, i)));
  }
  return out;
}

template <CovarianceKernel K, class A, CandidateSource S, Reduction R>
  requires Acquisition<A, std::vector<GaussianProcess<K>>, R>
double Optimizer<K, A, S, R>::hypervolume() const {
  VectorXd reference(Eigen::Index(problem().objectives.size()));
  for (Eigen::Index j = 0; j < reference.size(); ++j) reference[j] = objective(int(j)).signed_value(objective(int(j)).reference);
  return lumo::hypervolume(objectives(), reference);
}

template <CovarianceKernel K, class A, CandidateSource S, Reduction R>
  requires Acquisition<A, std::vector<GaussianProcess<K>>, R>
const std::vector<GaussianProcess<K>>& Optimizer<K, A, S, R>::models() {
  if (told() < 2 || modelled_ == told()) return models_;
  const Evidence e = evidence();
  models_.clear();
  for (Eigen::Index k = 0; k < e.outputs.rows(); ++k)
    models_.push_back(GaussianProcess<K>::fit({e.x, e.outputs.row(k).transpose(), e.lower, e.upper}, config_.model));
  modelled_ = told();
  return models_;
}

template <CovarianceKernel K, class A, CandidateSource S, Reduction R>
  requires Acquisition<A, std::vector<GaussianProcess<K>>, R>
Evidence Optimizer<K, A, S, R>::evidence() const {
  Evidence e;
  e.x = log_.designs(Trial::State::told);
  e.pending = log_.designs(Trial::State::pending);
  e.outputs = log_.told_outputs();
  for (int j = 0; j < int(problem().objectives.size()); ++j) {
    std::vector<Eigen::Index> rows;
    for (Eigen::Index k = 0; k < e.outputs.rows(); ++k)
      if (config_.reduction.objective(int(k)) == j) rows.push_back(k);
    ArrayXXd y = objective(j).signed_value(1.0) * (e.outputs(rows, Eigen::all).array() - objective(j).reference);
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
  e.reference = VectorXd::Zero(Eigen::Index(problem().objectives.size()));
  return e;
}

template <CovarianceKernel K, class A, CandidateSource S, Reduction R>
  requires Acquisition<A, std::vector<GaussianProcess<K>>, R>
Eigen::MatrixXd Optimizer<K, A, S, R>::objectives() const {
  MatrixXd y = log_.told_outputs();
  for (Eigen::Index k = 0; k < y.rows(); ++k) y.row(k) *= objective(config_.reduction.objective(int(k))).signed_value(1.0);
  return y.cols() ? MatrixXd(config_.reduction.objectives(y)) : MatrixXd(Eigen::Index(problem().objectives.size()), 0);
}

template <CovarianceKernel K, class A, CandidateSource S, Reduction R>
  requires Acquisition<A, std::vector<GaussianProcess<K>>, R>
std::optional<SuccessModel<K>> Optimizer<K, A, S, R>::success(const Evidence& e) const {
  const MatrixXd failed = log_.designs(Trial::State::failed);
  if (failed.cols() == 0) return std::nullopt;
  return SuccessModel<K>(e.x, failed, e.lower, e.upper, config_.model);
}

template <CovarianceKernel K, class A, CandidateSource S, Reduction R>
  requires Acquisition<A, std::vector<GaussianProcess<K>>, R>
std::optional<Design> Optimizer<K, A, S, R>::chosen() {
  const std::uint64_t key = detail::combine(detail::combine(problem().seed, 1), trials().size());
  if (models().empty()) {
    auto fresh = log_.sampler().fresh(1, key, log_.taken());
    return fresh.empty() ? std::nullopt : std::optional(std::move(fresh.front()));
  }
  std::vector<Design> standing;
  for (const Outcome& o : front()) standing.push_back(trials()[std::size_t(o.id)].x);
  const Evidence e = evidence();
  const auto utility = config_.acquisition.prepare(models_, config_.reduction, e, detail::combine(key, 1));
  const CandidateRequest request{log_.sampler(), log_.taken(), standing, detail::combine(key, 2)};
  const auto model = success(e);
  if (!model) return config_.source.best(request, utility);
  return config_.source.best(request, [&](const MatrixXd& x) -> Eigen::VectorXd { return model->expected(utility(x), x); });
}

}  // namespace lumo

// ---- lumo/sense/frame.hpp

namespace lumo {

/// Bytes of a pixel: one of grey, or blue, green, red.
enum class PixelFormat { grey, bgr };

constexpr int channels(PixelFormat f) { return f == PixelFormat::grey ? 1 : 3; }

/// A view of 8-bit pixels that something else owns. Rows run from the top, columns from the left.
struct ImageView {
  const std::uint8_t* data = nullptr;
  int width = 0;
  int height = 0;
  std::ptrdiff_t stride = 0;  ///< bytes from a row to the next
  PixelFormat format = PixelFormat::bgr;

  const std::uint8_t* row(int y) const { return data + y * stride; }
  /// Green value, or the grey one. Unchecked.
  std::uint8_t green(int x, int y) const { return format == PixelFormat::grey ? row(y)[x] : row(y)[3 * x + 1]; }
  bool empty() const { return !data || width <= 0 || height <= 0; }
};

/// An image that owns its pixels; rows without padding.
struct Image {
  int width = 0;
  int height = 0;
  PixelFormat format = PixelFormat::bgr;
  std::vector<std::uint8_t> pixels;

  /// Black. Throws InvalidArgument for sizes outside 1 … 32768.
  static Image black(int width, int height, PixelFormat format = PixelFormat::bgr) {
    require_in_range("image width", width, 1, 32768, "px");
    require_in_range("image height", height, 1, 32768, "px");
    return {width, height, format, std::vector<std::uint8_t>(std::size_t(width) * std::size_t(height) * std::size_t(channels(format)))};
  }
  ImageView view() const { return {pixels.data(), width, height, std::ptrdiff_t(width) * channels(format), format}; }
  std::uint8_t* row(int y) { return pixels.data() + std::ptrdiff_t(y) * width * channels(format); }
};

/// One picture of a camera and how it was taken.
struct Frame {
  ImageView image;
  std::int64_t stamp_ns = 0;  ///< as the source tells it, on the clock that the session names; by how much that is after the exposure's middle is the session's frame delay
  double exposure_s = 0.0;    ///< 0: not known
  double gain = 0.0;          ///< linear factor, or the driver's own number where that is all there is; 0: not known
  std::int64_t index = 0;     ///< counted by the source
};

}  // namespace lumo

// ---- lumo/sense/stream.hpp

namespace lumo {

/// What a source of frames or samples can still give.
enum class StreamState {
  open,   ///< there may be more
  ended,  ///< a recording has been read to its end
  failed  ///< unplugged or unreadable; what it gave before remains good
};

}  // namespace lumo

// ---- lumo/sense/camera.hpp

namespace lumo {

/// A source of frames: live, a video, a folder of images.
/// Laws: `next` gives each frame once, in the order of taking, and nothing when there is none now; it does not wait for a frame longer than the model
/// says; the pixels stay valid until the next call; while the state is not `open`, there is no frame.
template <class C>
concept Camera = requires(C& camera, const C& view) {
  { camera.next() } -> std::same_as<std::optional<Frame>>;
  { view.state() } -> std::same_as<StreamState>;
};

}  // namespace lumo

// ---- lumo/sense/recorded_camera.hpp

namespace lumo {

/// A frame together with its pixels.
struct RecordedFrame {
  Image image;
  std::int64_t stamp_ns = 0;
  double exposure_s = 0.0;
  double gain = 0.0;
};

/// Frames that are in memory, given as fast as they are asked for.
class RecordedCamera {
 public:
  explicit RecordedCamera(std::vector<RecordedFrame> frames) : frames_(std::move(frames)) {}

  std::optional<Frame> next() {
    if (next_ == frames_.size()) return std::nullopt;
    const RecordedFrame& f = frames_[next_];
    return Frame{f.image.view(), f.stamp_ns, f.exposure_s, f.gain, std::int64_t(next_++)};
  }
  StreamState state() const { return next_ == frames_.size() ? StreamState::ended : StreamState::open; }

 private:
  std::vector<RecordedFrame> frames_;
  std::size_t next_ = 0;
};

static_assert(Camera<RecordedCamera>);

}  // namespace lumo

// ---- lumo/sense/joint_sample.hpp

namespace lumo {

/// A finger or hand has at most this many joints; vectors of joints need no heap.
inline constexpr int max_joints = 8;

using JointVector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, max_joints, 1>;

/// What a motor driver's effort is. A current becomes a torque by the torque model's constants.
enum class Effort { current_A, torque_Nm };

/// State of all joints at one time.
struct JointSample {
  std::int64_t stamp_ns = 0;  ///< on the clock that the session names
  JointVector position_rad;
  JointVector velocity_rad_per_s;
  JointVector effort;  ///< of the motor on the joint, positive along the joint's axis
  Effort unit = Effort::current_A;
  bool saturated = false;  ///< the driver says that a value stands at the end of its range: it may be more
};

}  // namespace lumo

// ---- lumo/sense/actuator.hpp

namespace lumo {

/// A source of joint samples: live motors or a recording.
/// Laws: `next` gives each sample once, in the order of arrival, and nothing when there is none now; it never waits; all samples have the same number
/// of joints, in the same order; while the state is not `open`, there is no sample.
template <class A>
concept Actuator = requires(A& actuator, const A& view) {
  { actuator.next() } -> std::same_as<std::optional<JointSample>>;
  { view.state() } -> std::same_as<StreamState>;
};

}  // namespace lumo

// ---- lumo/sense/recorded_actuator.hpp

namespace lumo {

/// Joint samples that are in memory, given as fast as they are asked for. `read_joint_log` (sense/log.hpp) reads them from a file.
class RecordedActuator {
 public:
  explicit RecordedActuator(std::vector<JointSample> samples) : samples_(std::move(samples)) {}

  std::optional<JointSample> next() { return next_ == samples_.size() ? std::nullopt : std::optional(samples_[next_++]); }
  StreamState state() const { return next_ == samples_.size() ? StreamState::ended : StreamState::open; }

 private:
  std::vector<JointSample> samples_;
  std::size_t next_ = 0;
};

static_assert(Actuator<RecordedActuator>);

}  // namespace lumo

// ---- lumo/sense/alignment.hpp

namespace lumo {

/// Stamps lie within ±this [ns], 146 years, so that the difference of any two is one of 64 bits.
inline constexpr std::int64_t stamp_limit_ns = 4'600'000'000'000'000'000;

/// From one clock to another: to = from + offset + drift · (from − origin).
struct ClockMap {
  std::int64_t origin_ns = 0;
  double offset_s = 0.0;
  double drift = 0.0;         ///< seconds per second
  double residual_s = 0.0;    ///< RMS of what a fit left; 0 where it was given, not fitted
  bool operator==(const ClockMap&) const = default;

  /// Ends at the limit of stamps.
  std::int64_t operator()(std::int64_t from_ns) const {
    constexpr double limit = double(stamp_limit_ns);
    const double shift = 1e9 * offset_s + drift * (double(from_ns) - double(origin_ns));
    return std::clamp<std::int64_t>(from_ns + std::llround(std::clamp(shift, -limit, limit)), -stamp_limit_ns, stamp_limit_ns);
  }

  /// From the stamps of the same events on both clocks, by least squares; one event gives the offset alone. Throws InvalidArgument for none.
  static ClockMap fit(std::span<const std::int64_t> from_ns, std::span<const std::int64_t> to_ns) {
    if (from_ns.empty() || from_ns.size() != to_ns.size())
      throw InvalidArgument(detail::text("clocks have ", from_ns.size(), " and ", to_ns.size(), " common events, must have as many, at least 1"));
    for (std::size_t i = 0; i < from_ns.size(); ++i)
      for (const std::int64_t stamp : {from_ns[i], to_ns[i]})
        if (stamp < -stamp_limit_ns || stamp > stamp_limit_ns) throw InvalidArgument(detail::text("stamp of a common event is ", stamp, " ns, must lie within 4.6e18 ns"));
    ClockMap map;
    map.origin_ns = from_ns[from_ns.size() / 2];
    const double n = double(from_ns.size());
    double sum_t = 0.0, sum_d = 0.0, sum_tt = 0.0, sum_td = 0.0;
    for (std::size_t i = 0; i < from_ns.size(); ++i) {
      const double t = 1e-9 * double(from_ns[i] - map.origin_ns), d = 1e-9 * double(to_ns[i] - from_ns[i]);
      sum_t += t, sum_d += d, sum_tt += t * t, sum_td += t * d;
    }
    const double det = n * sum_tt - sum_t * sum_t;
    map.drift = det > 1e-9 * n * n ? (n * sum_td - sum_t * sum_d) / det : 0.0;
    map.offset_s = (sum_d - map.drift * sum_t) / n;
    double squares = 0.0;
    for (std::size_t i = 0; i < from_ns.size(); ++i) squares += std::pow(1e-9 * double(to_ns[i] - map(from_ns[i])), 2);
    map.residual_s = std::sqrt(squares / n);
    return map;
  }
};

/// A recorded quantity of some channels over time, and what linear interpolation makes of it.
class TimeSeries {
 public:
  /// `value`: channels × stamps. Stamps ascend strictly. Throws InvalidArgument.
  TimeSeries(std::vector<std::int64_t> stamp_ns, Eigen::MatrixXd value) : stamp_(std::move(stamp_ns)), value_(std::move(value)) {
    if (value_.cols() != Eigen::Index(stamp_.size())) throw InvalidArgument(detail::text("time series has ", stamp_.size(), " stamps and ", value_.cols(), " values"));
    for (std::size_t i = 1; i < stamp_.size(); ++i)
      if (stamp_[i] <= stamp_[i - 1])  // of ascending stamps the ends tell of all
        throw InvalidArgument(detail::text("time series: stamp ", i, " is ", stamp_[i], " ns, must exceed its predecessor, ", stamp_[i - 1], " ns"));
    if (!stamp_.empty() && (stamp_.front() < -stamp_limit_ns || stamp_.back() > stamp_limit_ns))
      throw InvalidArgument(detail::text("time series goes from ", stamp_.front(), " to ", stamp_.back(), " ns, must lie within 4.6e18 ns"));
  }

  /// Value at a time; nothing outside of the series, or in a gap longer than `max_gap_s`.
  template <class VectorXd = Eigen::VectorXd>
  std::optional<Eigen::VectorXd> at(std::int64_t stamp_ns, double max_gap_s) const {
    const auto after = std::lower_bound(stamp_.begin(), stamp_.end(), stamp_ns);
    if (after == stamp_.end()) return std::nullopt;
    const auto j = Eigen::Index(after - stamp_.begin());
    if (*after == stamp_ns) return VectorXd(value_.col(j));
    if (after == stamp_.begin()) return std::nullopt;
    const double gap = double(*after - *(after - 1));
    if (1e-9 * gap > max_gap_s) return std::nullopt;
    const double share = double(stamp_ns - *(after - 1)) / gap;
    return VectorXd((1.0 - share) * value_.col(j - 1) + share * value_.col(j));
  }

  /// RMS difference between each inner sample and the line through its neighbours, per channel: noise and curvature that interpolation does not follow. For
  /// white noise of standard deviation σ it is √1.5 σ; interpolation itself spans half the distance and errs by about a quarter of the curvature's part.
  template <class VectorXd = Eigen::VectorXd>
  Eigen::VectorXd interpolation_residual() const {
    VectorXd squares = VectorXd::Zero(value_.rows());
    for (std::size_t i = 1; i + 1 < stamp_.size(); ++i) {
      const double share = double(stamp_[i] - stamp_[i - 1]) / double(stamp_[i + 1] - stamp_[i - 1]);
      const auto k = Eigen::Index(i);
      squares += (value_.col(k) - (1.0 - share) * value_.col(k - 1) - share * value_.col(k + 1)).cwiseAbs2();
    }
    return stamp_.size() < 3 ? squares : VectorXd((squares / double(stamp_.size() - 2)).cwiseSqrt());
  }
  double largest_gap_s() const {
    std::int64_t gap = 0;
    for (std::size_t i = 1; i < stamp_.size(); ++i) gap = std::max(gap, stamp_[i] - stamp_[i - 1]);
    return 1e-9 * double(gap);
  }
  std::size_t size() const { return stamp_.size(); }

 private:
  std::vector<std::int64_t> stamp_;
  Eigen::MatrixXd value_;
};

}  // namespace lumo

// ---- lumo/sense/csv.hpp

namespace lumo {

/// Reads comma-separated tables strictly: one header line whose names carry their units, then rows of as many fields. No quotes, no empty lines but at the
/// end, no comments; fields may have spaces around them, lines may end in CR LF. Every fault is an InputError of one line with file, line and column.
class CsvReader {
 public:
  static constexpr std::size_t max_line = 65536, max_columns = 256;

  /// Reads the header. `name` stands in messages.
  CsvReader(std::istream& in, std::string name) : in_(in), name_(std::move(name)) {
    if (!read_line()) throw InputError(detail::text(name_, ": is empty, must begin with a line of column names"));
    if (line_text_.starts_with("\xef\xbb\xbf")) line_text_.erase(0, 3);
    split();
    for (const std::string_view f : fields_) {
      if (f.empty()) throw InputError(detail::text(name_, ":1: column ", columns_.size() + 1, " has no name"));
      for (const std::string& c : columns_)
        if (c == f) throw InputError(detail::text(name_, ":1: column '", detail::printable(f), "' is there twice"));
      columns_.emplace_back(f);
    }
  }

  const std::vector<std::string>& columns() const { return columns_; }
  /// Place of a column, or −1.
  int find(std::string_view column) const {
    for (std::size_t i = 0; i < columns_.size(); ++i)
      if (columns_[i] == column) return int(i);
    return -1;
  }
  /// Place of a column that must be there.
  int require(std::string_view column) const {
    if (const int i = find(column); i >= 0) return i;
    throw InputError(detail::text(name_, ":1: column '", column, "' is missing"));
  }
  /// Throws for the first column that is none of those known.
  template <class Known>
  void require_known(Known known) const {
    for (const std::string& c : columns_)
      if (!known(std::string_view(c))) throw InputError(detail::text(name_, ":1: column '", detail::printable(c), "' is not known"));
  }

  /// Goes to the next row; false at the end of the file.
  bool next() {
    if (!read_line()) return false;
    if (line_text_.find_first_not_of(" \t") == std::string::npos) {
      while (read_line())
        if (line_text_.find_first_not_of(" \t") != std::string::npos) throw InputError(detail::text(name_, ":", line_ - 1, ": is empty, only the end of the file may be"));
      return false;
    }
    split();
    if (fields_.size() != columns_.size()) throw InputError(detail::text(name_, ":", line_, ": has ", fields_.size(), " fields, the header ", columns_.size()));
    return true;
  }
  std::string_view text(int column) const { return fields_[std::size_t(column)]; }
  /// A finite number.
  double number(int column) const {
    const std::string_view f = text(column);
    double v = 0.0;
    const auto [end, error] = std::from_chars(f.data(), f.data() + f.size(), v);
    if (error != std::errc() || end != f.data() + f.size() || !std::isfinite(v)) fail(column, "is no finite number");
    return v;
  }
  std::int64_t integer(int column) const {
    const std::string_view f = text(column);
    std::int64_t v = 0;
    const auto [end, error] = std::from_chars(f.data(), f.data() + f.size(), v);
    if (error != std::errc() || end != f.data() + f.size()) fail(column, "is no whole number of 64 bits");
    return v;
  }
  long line() const { return line_; }
  const std::string& name() const { return name_; }
  /// Throws the error of a field: file, line, column, what it says, what is wrong.
  [[noreturn]] void fail(int column, std::string_view why) const {
    throw InputError(detail::text(name_, ":", line_, ": column ", detail::printable(columns_[std::size_t(column)]), ": '", detail::printable(text(column)), "' ", why));
  }

 private:
  bool read_line() {
    line_text_.clear();
    ++line_;
    for (int c = in_.get(); c != std::istream::traits_type::eof(); c = in_.get()) {
      if (c == '\n') {
        if (line_text_.ends_with('\r')) line_text_.pop_back();
        return true;
      }
      if (c == '\0') throw InputError(detail::text(name_, ":", line_, ": holds a zero byte, is no text"));
      line_text_ += char(c);
      if (line_text_.size() > max_line) throw InputError(detail::text(name_, ":", line_, ": is longer than ", max_line, " bytes"));
    }
    if (in_.bad()) throw InputError(detail::text(name_, ":", line_, ": cannot be read"));
    return !line_text_.empty();
  }

  void split() {
    fields_.clear();
    const std::string_view all = line_text_;
    if (const auto quote = all.find('"'); quote != std::string_view::npos)
      throw InputError(detail::text(name_, ":", line_, ": holds a quote at byte ", quote + 1, ", fields are not quoted"));
    for (std::size_t from = 0;;) {
      const std::size_t to = std::min(all.find(',', from), all.size());
      std::string_view f = all.substr(from, to - from);
      while (!f.empty() && (f.front() == ' ' || f.front() == '\t')) f.remove_prefix(1);
      while (!f.empty() && (f.back() == ' ' || f.back() == '\t')) f.remove_suffix(1);
      fields_.push_back(f);
      if (fields_.size() > max_columns) throw InputError(detail::text(name_, ":", line_, ": has more than ", max_columns, " fields"));
      if (to == all.size()) return;
      from = to + 1;
    }
  }

  std::istream& in_;
  std::string name_, line_text_;
  std::vector<std::string> columns_;
  std::vector<std::string_view> fields_;
  long line_ = 0;
};

/// The shortest text that reads back as the same number. Throws InvalidArgument for what is not finite.
inline std::string csv_number(double v) {
  if (!std::isfinite(v)) throw InvalidArgument("a table's number must be finite");
  char buffer[32];
  const auto [end, error] = std::to_chars(buffer, buffer + sizeof buffer, v);
  return {buffer, end};
}

}  // namespace lumo

// ---- lumo/sense/log.hpp

namespace lumo {

// A log is a folder (docs/log_format.md):
//   session.json        what was done, with what (support/json.hpp reads it)
//   frames.csv          stamp_ns | time_s, file, exposure_s, gain       file: path below frames/; the column is absent where there is a video
//   frames/…            8-bit images, colour or grey; or video.* instead
//   joint.csv           stamp_ns | time_s, position_rad_0, velocity_rad_per_s_0, current_A_0 | torque_Nm_0, position_rad_1, …
//   wrench.csv          stamp_ns | time_s, force_x_N, force_y_N, force_z_N[, torque_x_Nm, torque_y_Nm, torque_z_Nm]
//   marker.csv          stamp_ns | time_s, displacement_m
//   photodiode.csv      stamp_ns | time_s, signal_V_0, signal_V_1, …
// All but session.json may be absent. Stamps ascend strictly. Columns may stand in any order; unknown ones are errors.

/// A row of frames.csv.
struct FrameRecord {
  std::int64_t stamp_ns = 0;
  std::string file;         ///< below frames/; empty in a video's table
  double exposure_s = 0.0;  ///< 0: not known
  double gain = 0.0;        ///< 0: not known
};

/// What a force/torque sensor says: the object on the finger, in the finger's frame, about its origin.
struct WrenchSample {
  std::int64_t stamp_ns = 0;
  Vec3 force_N = Vec3::Zero();
  Vec3 torque_Nm = Vec3::Zero();
  double normal_force_N() const { return -force_N.z(); }  ///< positive where the finger is pressed
};

struct MarkerSample {
  std::int64_t stamp_ns = 0;
  double displacement_m = 0.0;
};

namespace detail {

/// The time column of a log's table, as integer nanoseconds; strictly ascending.
class StampColumn {
 public:
  explicit StampColumn(const CsvReader& csv) : column_(csv.find("stamp_ns")), seconds_(column_ < 0) {
    if (seconds_) column_ = csv.find("time_s");
    if (column_ < 0) throw InputError(text(csv.name(), ":1: column 'stamp_ns' (or 'time_s') is missing"));
    if (!seconds_ && csv.find("time_s") >= 0) throw InputError(text(csv.name(), ":1: has both 'stamp_ns' and 'time_s'"));
  }
  std::int64_t read(const CsvReader& csv) {
    std::int64_t stamp = 0;
    if (seconds_) {
      const double s = csv.number(column_);
      if (std::abs(s) > 1e-9 * double(stamp_limit_ns)) csv.fail(column_, "s is beyond the range of stamps");
      stamp = std::llround(s * 1e9);
    } else {
      stamp = csv.integer(column_);
      if (stamp < -stamp_limit_ns || stamp > stamp_limit_ns) csv.fail(column_, "is beyond the range of stamps");
    }
    if (last_ && stamp <= *last_) csv.fail(column_, "does not exceed the stamp before it");
    last_ = stamp;
    return stamp;
  }

 private:
  int column_;
  bool seconds_;
  std::optional<std::int64_t> last_;
};

/// A path below a log's frames/ that a table can hold.
inline bool is_below_frames(std::string_view file) {
  const bool plain = std::none_of(file.begin(), file.end(), [](char c) { return c == ',' || c == '"' || static_cast<unsigned char>(c) < ' '; });
  return plain && !file.empty() && file.front() != '/' && file.front() != ' ' && file.back() != ' ' && file.find("..") == std::string_view::npos &&
         file.find('\\') == std::string_view::npos;
}

/// Text of a stamp to be written. Throws InvalidArgument for one that StampColumn would refuse.
inline std::string stamp_text(std::int64_t stamp_ns, std::optional<std::int64_t>& last) {
  if (stamp_ns < -stamp_limit_ns || stamp_ns > stamp_limit_ns || (last && stamp_ns <= *last))
    throw InvalidArgument(text("stamp to write is ", stamp_ns, " ns, must lie within 4.6e18 ns", last ? text(" and exceed the one before it, ", *last, " ns") : std::string()));
  last = stamp_ns;
  return std::to_string(stamp_ns);
}

inline bool is_time(std::string_view c) { return c == "stamp_ns" || c == "time_s"; }

/// Column of a name with a joint's (diode's) number behind it.
inline std::string numbered(const char* name, int i) { return std::string(name) + '_' + std::to_string(i); }

/// Opens a file for reading. Throws InputError.
inline std::ifstream open_text(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw InputError(text(path, ": cannot be opened"));
  return in;
}

}  // namespace detail

/// Reads frames.csv. `video`: there is no column `file`. Files must be relative paths without "..".
inline std::vector<FrameRecord> read_frame_log(std::istream& in, const std::string& name, bool video = false) {
  CsvReader csv(in, name);
  csv.require_known([&](std::string_view c) { return detail::is_time(c) || c == "exposure_s" || c == "gain" || (!video && c == "file"); });
  detail::StampColumn stamp(csv);
  const int file = video ? -1 : csv.require("file"), exposure = csv.find("exposure_s"), gain = csv.find("gain");
  std::vector<FrameRecord> list;
  while (csv.next()) {
    FrameRecord f{stamp.read(csv), "", 0.0, 0.0};
    if (file >= 0) {
      f.file = csv.text(file);
      if (!detail::is_below_frames(f.file)) csv.fail(file, "is no path below frames/");
    }
    if (exposure >= 0 && (f.exposure_s = csv.number(exposure)) < 0.0) csv.fail(exposure, "s is negative");
    if (gain >= 0 && (f.gain = csv.number(gain)) < 0.0) csv.fail(gain, "is negative");
    list.push_back(std::move(f));
  }
  return list;
}

/// Reads joint.csv. Joints are numbered from 0 without gaps; all have a current or all a torque.
inline std::vector<JointSample> read_joint_log(std::istream& in, const std::string& name) {
  CsvReader csv(in, name);
  detail::StampColumn stamp(csv);
  int joints = 0;
  while (joints < max_joints && csv.find(detail::numbered("position_rad", joints)) >= 0) ++joints;
  if (joints == 0) csv.require("position_rad_0");
  const Effort unit = csv.find("current_A_0") >= 0 ? Effort::current_A : Effort::torque_Nm;
  const char* effort_name = unit == Effort::current_A ? "current_A" : "torque_Nm";
  std::vector<int> position, velocity, effort;
  for (int j = 0; j < joints; ++j) {
    position.push_back(csv.require(detail::numbered("position_rad", j)));
    velocity.push_back(csv.require(detail::numbered("velocity_rad_per_s", j)));
    effort.push_back(csv.require(detail::numbered(effort_name, j)));
  }
  csv.require_known([&](std::string_view c) {
    bool known = detail::is_time(c);
    for (int j = 0; j < joints; ++j)
      for (const char* column : {"position_rad", "velocity_rad_per_s", effort_name}) known = known || c == detail::numbered(column, j);
    return known;
  });
  std::vector<JointSample> list;
  while (csv.next()) {
    JointSample s{stamp.read(csv), JointVector(joints), JointVector(joints), JointVector(joints), unit};
    for (int j = 0; j < joints; ++j) {
      s.position_rad[j] = csv.number(position[std::size_t(j)]);
      s.velocity_rad_per_s[j] = csv.number(velocity[std::size_t(j)]);
      s.effort[j] = csv.number(effort[std::size_t(j)]);
    }
    list.push_back(std::move(s));
  }
  return list;
}

/// Reads wrench.csv; torques may be absent altogether.
inline std::vector<WrenchSample> read_wrench_log(std::istream& in, const std::string& name) {
  static constexpr const char* forces[] = {"force_x_N", "force_y_N", "force_z_N"};
  static constexpr const char* torques[] = {"torque_x_Nm", "torque_y_Nm", "torque_z_Nm"};
  CsvReader csv(in, name);
  detail::StampColumn stamp(csv);
  bool with_torque = false;
  for (const char* t : torques) with_torque = with_torque || csv.find(t) >= 0;
  int column[6] = {};
  for (int k = 0; k < 3; ++k) column[k] = csv.require(forces[k]), column[3 + k] = with_torque ? csv.require(torques[k]) : -1;
  csv.require_known([&](std::string_view c) {
    bool known = detail::is_time(c);
    for (int k = 0; k < 3; ++k) known = known || c == forces[k] || c == torques[k];
    return known;
  });
  std::vector<WrenchSample> list;
  while (csv.next()) {
    WrenchSample w;
    w.stamp_ns = stamp.read(csv);
    for (int k = 0; k < 3; ++k) {
      w.force_N[k] = csv.number(column[k]);
      if (with_torque) w.torque_Nm[k] = csv.number(column[3 + k]);
    }
    list.push_back(w);
  }
  return list;
}

/// Reads marker.csv.
inline std::vector<MarkerSample> read_marker_log(std::istream& in, const std::string& name) {
  CsvReader csv(in, name);
  detail::StampColumn stamp(csv);
  const int place = csv.require("displacement_m");
  csv.require_known([](std::string_view c) { return detail::is_time(c) || c == "displacement_m"; });
  std::vector<MarkerSample> list;
  while (csv.next()) {
    const std::int64_t at = stamp.read(csv);
    list.push_back({at, csv.number(place)});
  }
  return list;
}

/// The tables as text, with numbers that read back as they were. Throw InvalidArgument for what the readers would refuse.
inline std::string frame_log_text(const std::vector<FrameRecord>& frames, bool video = false) {
  std::string t = video ? "stamp_ns,exposure_s,gain\n" : "stamp_ns,file,exposure_s,gain\n";
  std::optional<std::int64_t> last;
  for (const FrameRecord& f : frames) {
    if (!video && !detail::is_below_frames(f.file)) throw InvalidArgument("frame log: a file is no path below frames/, or holds a comma, quote or line's end");
    if (f.exposure_s < 0.0 || f.gain < 0.0) throw InvalidArgument(detail::text("frame log: exposure is ", f.exposure_s, " s, gain ", f.gain, ", must not be negative"));
    t += detail::stamp_text(f.stamp_ns, last) + ',' + (video ? "" : f.file + ',') + csv_number(f.exposure_s) + ',' + csv_number(f.gain) + '\n';
  }
  return t;
}

inline std::string joint_log_text(const std::vector<JointSample>& samples) {
  const auto joints = samples.empty() ? Eigen::Index(1) : samples.front().effort.size();
  const Effort unit = samples.empty() ? Effort::current_A : samples.front().unit;
  std::string t = "stamp_ns";
  for (int j = 0; j < int(joints); ++j)
    for (const char* column : {"position_rad", "velocity_rad_per_s", unit == Effort::current_A ? "current_A" : "torque_Nm"}) t += ',' + detail::numbered(column, j);
  t += '\n';
  std::optional<std::int64_t> last;
  for (const JointSample& s : samples) {
    if (s.effort.size() != joints || s.position_rad.size() != joints || s.velocity_rad_per_s.size() != joints || s.unit != unit)
      throw InvalidArgument("joint log: samples must have the same number of joints and the same kind of effort");
    t += detail::stamp_text(s.stamp_ns, last);
    for (Eigen::Index j = 0; j < joints; ++j) t += ',' + csv_number(s.position_rad[j]) + ',' + csv_number(s.velocity_rad_per_s[j]) + ',' + csv_number(s.effort[j]);
    t += '\n';
  }
  return t;
}

inline std::string wrench_log_text(const std::vector<WrenchSample>& samples) {
  std::string t = "stamp_ns,force_x_N,force_y_N,force_z_N,torque_x_Nm,torque_y_Nm,torque_z_Nm\n";
  std::optional<std::int64_t> last;
  for (const WrenchSample& w : samples) {
    t += detail::stamp_text(w.stamp_ns, last);
    for (const Vec3& v : {w.force_N, w.torque_Nm})
      for (int k = 0; k < 3; ++k) t += ',' + csv_number(v[k]);
    t += '\n';
  }
  return t;
}

inline std::string marker_log_text(const std::vector<MarkerSample>& samples) {
  std::string t = "stamp_ns,displacement_m\n";
  std::optional<std::int64_t> last;
  for (const MarkerSample& m : samples) t += detail::stamp_text(m.stamp_ns, last) + ',' + csv_number(m.displacement_m) + '\n';
  return t;
}

}  // namespace lumo

// ---- lumo/sense/readout.hpp

namespace lumo {

/// Light along the finger at one time.
struct Profile {
  std::int64_t stamp_ns = 0;
  Eigen::VectorXd value;  ///< one for each position of the readout; its unit is the readout's
  /// Share of what was read that stood at the top of its range: values there are lower bounds.
  double saturated = 0.0;
};

/// Turns one raw sample (a camera's frame, a row of photodiodes) into a longitudinal profile.
/// Laws: linear in the light as long as nothing saturates; value i belongs to `positions_m()[i]` on the finger's y axis, ascending; a sample that
/// is not of the readout's size or kind gives false and leaves the profile as it was; no memory is taken after the first call.
template <class R>
concept Readout = requires(R& readout, const R& view, const typename R::Sample& sample, Profile& profile) {
  { readout.read(sample, profile) } -> std::same_as<bool>;
  { view.positions_m() } -> std::convertible_to<const Eigen::VectorXd&>;
};

}  // namespace lumo

// ---- lumo/sense/photodiodes.hpp

namespace lumo {

/// One reading of a row of photodiodes.
struct PhotodiodeSample {
  std::int64_t stamp_ns = 0;
  Eigen::VectorXd signal_V;
};

/// A row of photodiodes along the finger: the readout without a camera. Values are photocurrents in units of the calibration, (V − dark) · scale.
class PhotodiodeArray {
 public:
  using Sample = PhotodiodeSample;

  struct Config {
    Eigen::VectorXd position_m;  ///< along the finger, ascending
    Eigen::VectorXd dark_V;      ///< without light; empty: 0
    Eigen::VectorXd scale;       ///< per volt; empty: 1
    double full_scale_V = 3.3;   ///< of the converter
  };

  /// Throws InvalidArgument for lengths that differ, positions that do not ascend, or numbers that are not finite.
  template <class VectorXd = Eigen::VectorXd>
  explicit PhotodiodeArray(Config config) : config_(std::move(config)) {
    const Eigen::Index n = config_.position_m.size();
    if (n < 2) throw InvalidArgument(detail::text("photodiode array has ", n, " diodes, must have at least 2"));
    if (config_.dark_V.size() == 0) config_.dark_V = VectorXd::Zero(n);
    if (config_.scale.size() == 0) config_.scale = VectorXd::Ones(n);
    if (config_.dark_V.size() != n || config_.scale.size() != n)
      throw InvalidArgument(detail::text("photodiode array has ", n, " positions, ", config_.dark_V.size(), " dark values and ", config_.scale.size(),
          " scales, must be as many"));
    if (!config_.position_m.allFinite() || !config_.dark_V.allFinite() || !config_.scale.allFinite()) throw InvalidArgument("photodiode array: numbers must be finite");
    for (Eigen::Index i = 1; i < n; ++i)
      if (!(config_.position_m[i] > config_.position_m[i - 1]))
        throw InvalidArgument(detail::text("photodiode ", i, " is at ", config_.position_m[i], " m, must lie beyond its predecessor at ", config_.position_m[i - 1], " m"));
    require_positive("photodiode full scale", config_.full_scale_V, "V");
  }

  template <class = void>
  bool read(const PhotodiodeSample& sample, Profile& profile) const {
    if (sample.signal_V.size() != config_.position_m.size() || !sample.signal_V.allFinite()) return false;
    profile.stamp_ns = sample.stamp_ns;
    profile.value = (sample.signal_V - config_.dark_V).cwiseProduct(config_.scale);
    profile.saturated = double((sample.signal_V.array() >= config_.full_scale_V).count()) / double(sample.signal_V.size());
    return true;
  }
  const Eigen::VectorXd& positions_m() const { return config_.position_m; }

 private:
  Config config_;
};

static_assert(Readout<PhotodiodeArray>);

}  // namespace lumo

// ---- lumo/sense/photodiode_log.hpp

namespace lumo {

/// Reads photodiode.csv: stamp_ns (or time_s), signal_V_0, signal_V_1, … without gaps in the numbers. Throws InputError.
inline std::vector<PhotodiodeSample> read_photodiode_log(std::istream& in, const std::string& name) {
  CsvReader csv(in, name);
  detail::StampColumn stamp(csv);
  std::vector<int> column;
  while (csv.find(detail::numbered("signal_V", int(column.size()))) >= 0) column.push_back(csv.find(detail::numbered("signal_V", int(column.size()))));
  if (column.empty()) csv.require("signal_V_0");
  csv.require_known([&](std::string_view c) {
    bool known = detail::is_time(c);
    for (std::size_t i = 0; i < column.size(); ++i) known = known || c == detail::numbered("signal_V", int(i));
    return known;
  });
  std::vector<PhotodiodeSample> list;
  while (csv.next()) {
    PhotodiodeSample s{stamp.read(csv), Eigen::VectorXd(Eigen::Index(column.size()))};
    for (std::size_t i = 0; i < column.size(); ++i) s.signal_V[Eigen::Index(i)] = csv.number(column[i]);
    list.push_back(std::move(s));
  }
  return list;
}

inline std::string photodiode_log_text(const std::vector<PhotodiodeSample>& samples) {
  std::string t = "stamp_ns";
  const auto n = samples.empty() ? Eigen::Index(1) : samples.front().signal_V.size();
  for (Eigen::Index i = 0; i < n; ++i) t += ',' + detail::numbered("signal_V", int(i));
  t += '\n';
  std::optional<std::int64_t> last;
  for (const PhotodiodeSample& s : samples) {
    if (s.signal_V.size() != n) throw InvalidArgument("photodiode log: samples must have the same number of diodes");
    t += detail::stamp_text(s.stamp_ns, last);
    for (Eigen::Index i = 0; i < n; ++i) t += ',' + csv_number(s.signal_V[i]);
    t += '\n';
  }
  return t;
}

}  // namespace lumo

// ---- lumo/sense/mini_cheetah.hpp

namespace lumo {

/// A number as an unsigned integer of some bits over a symmetric range: 0 is −limit, all ones is +limit.
struct FixedRange {
  double low, high;
  int bits;

  double step() const { return (high - low) / double((1u << bits) - 1u); }
  std::uint32_t pack(double v) const { return std::uint32_t(std::lround((std::clamp(v, low, high) - low) / step())); }
  double unpack(std::uint32_t n) const { return low + step() * double(n); }
};

/// The CAN protocol of the MIT mini-cheetah actuators and of the drivers that follow it (source: B. Katz's public firmware and its documentation;
/// widths and byte order are common, ranges differ by make and firmware and must be set to those of the motor at hand).
/// Command, 8 bytes: position 16 bits, velocity 12, kp 12, kd 12, feed-forward torque 12, most significant first.
/// Reply, 6 bytes (later firmware appends temperature and error, which are not read): number of the motor 8 bits, position 16, velocity 12, torque or current 12.
struct MiniCheetahProtocol {
  double position_rad = 12.5;
  double velocity_rad_per_s = 65.0;
  double kp_max = 500.0;  ///< N·m/rad
  double kd_max = 5.0;    ///< N·m·s/rad
  double torque_Nm = 18.0;
  double effort = 18.0;  ///< range of the reply's last field: N·m, or A (40 in Katz's first firmware)

  struct Command {
    double position_rad = 0.0, velocity_rad_per_s = 0.0, kp = 0.0, kd = 0.0, torque_Nm = 0.0;
  };
  struct Reply {
    int motor = 0;
    double position_rad = 0.0, velocity_rad_per_s = 0.0, effort = 0.0;
    bool saturated = false;  ///< a field stands at the end of its range
  };
  using Bytes = std::array<std::uint8_t, 8>;

  static constexpr Bytes enter{0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xfc};  ///< motor on
  static constexpr Bytes leave{0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xfd};  ///< motor off
  static constexpr Bytes zero{0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xfe};   ///< here is position 0

  /// Values beyond a range are clamped to it. Throws InvalidArgument for numbers that are not finite.
  Bytes pack(const Command& c) const {
    for (const double v : {c.position_rad, c.velocity_rad_per_s, c.kp, c.kd, c.torque_Nm})
      if (!std::isfinite(v)) throw InvalidArgument("motor command: numbers must be finite");
    const std::uint32_t p = range(position_rad, 16).pack(c.position_rad), v = range(velocity_rad_per_s, 12).pack(c.velocity_rad_per_s);
    const std::uint32_t kp = FixedRange{0.0, kp_max, 12}.pack(c.kp), kd = FixedRange{0.0, kd_max, 12}.pack(c.kd), t = range(torque_Nm, 12).pack(c.torque_Nm);
    return {std::uint8_t(p >> 8), std::uint8_t(p & 0xff), std::uint8_t(v >> 4), std::uint8_t((v & 0xf) << 4 | kp >> 8),
            std::uint8_t(kp & 0xff), std::uint8_t(kd >> 4), std::uint8_t((kd & 0xf) << 4 | t >> 8), std::uint8_t(t & 0xff)};
  }
  /// Nothing for fewer than six bytes.
  std::optional<Reply> unpack(std::span<const std::uint8_t> b) const {
    if (b.size() < 6) return std::nullopt;
    const std::uint32_t p = std::uint32_t(b[1]) << 8 | b[2], v = std::uint32_t(b[3]) << 4 | b[4] >> 4, t = std::uint32_t(b[4] & 0xf) << 8 | b[5];
    const bool full = p == 0 || p == 0xffff || v == 0 || v == 0xfff || t == 0 || t == 0xfff;
    return Reply{int(b[0]), range(position_rad, 16).unpack(p), range(velocity_rad_per_s, 12).unpack(v), range(effort, 12).unpack(t), full};
  }

  static FixedRange range(double limit, int bits) { return {-limit, limit, bits}; }
};

/// Throws InvalidArgument for a range that is not positive.
inline void validate(const MiniCheetahProtocol& p) {
  require_positive("motor's position range", p.position_rad, "rad");
  require_positive("motor's velocity range", p.velocity_rad_per_s, "rad/s");
  require_positive("motor's kp range", p.kp_max, "N·m/rad");
  require_positive("motor's kd range", p.kd_max, "N·m·s/rad");
  require_positive("motor's torque range", p.torque_Nm, "N·m");
  require_positive("motor's effort range", p.effort, "");
}

}  // namespace lumo

// ---- lumo/sense/axis_map.hpp

namespace lumo {

/// How a straight line on the finger (its LEDs) lies in the image: u pixels from `origin_px` along `direction` is the finger coordinate
/// y = (a + b s)/(1 + c s), s = u/half_length_px; c is the perspective's. With the covariance of (a, b, c) from the fit.
struct AxisMap {
  Eigen::Vector2d origin_px = Eigen::Vector2d::Zero();     ///< pixel centres lie on whole numbers
  Eigen::Vector2d direction = Eigen::Vector2d::UnitX();    ///< unit, towards the finger's tip (+y)
  double half_length_px = 1.0;
  Eigen::Vector3d coefficients{0.0, 1.0, 0.0};             ///< a [m], b [m], c
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  double centroid_sigma_px = 0.0;                          ///< assumed or found, whichever is larger
  double residual_px = 0.0;                                ///< RMS of what the fit leaves

  template <class Vector2d = Eigen::Vector2d>
  double u_px(In<Vector2d> pixel) const { return (pixel - origin_px).dot(direction); }
  double y_m(double u) const {
    const double s = u / half_length_px;
    return (coefficients[0] + coefficients[1] * s) / (1.0 + coefficients[2] * s);
  }
  /// Inverse of y_m.
  double u_px(double y) const { return half_length_px * (y - coefficients[0]) / (coefficients[1] - coefficients[2] * y); }
  /// dy/du [m/px].
  double scale_m_per_px(double u) const {
    const double w = 1.0 + coefficients[2] * u / half_length_px;
    return (coefficients[1] - coefficients[0] * coefficients[2]) / (half_length_px * w * w);
  }
  /// Variance of y at u [m²] that comes from the map itself.
  template <class Vector3d = Eigen::Vector3d>
  double variance_m2(double u) const {
    const Vector3d g = gradient(u);
    return g.dot(covariance * g);
  }
  /// ∂y/∂(a, b, c).
  Eigen::Vector3d gradient(double u) const {
    const double s = u / half_length_px, w = 1.0 + coefficients[2] * s;
    return {1.0 / w, s / w, -s * (coefficients[0] + coefficients[1] * s) / (w * w)};
  }

  /// Fit to places in the image (2 × n, ascending in y) of known finger coordinates, by least squares in pixels. Three places fix the map, more give a
  /// residual. |c| is at most ½. `sigma_px`: what a centroid is believed to be good for. Throws InvalidArgument for fewer than three, wrong order or numbers that are not
  /// finite.
  template <class VectorXd = Eigen::VectorXd, class Vector3d = Eigen::Vector3d, class Matrix2d = Eigen::Matrix2d, class Matrix2Xd = Eigen::Matrix2Xd, class Matrix3d = Eigen::Matrix3d,
            class MatrixX3d = Eigen::MatrixX3d>
  static AxisMap fit(In<Matrix2Xd> pixel, In<VectorXd> y_m, double sigma_px = 0.3);
};

template <class VectorXd, class Vector3d, class Matrix2d, class Matrix2Xd, class Matrix3d, class MatrixX3d>
inline AxisMap AxisMap::fit(In<Matrix2Xd> pixel, In<VectorXd> y_m, double sigma_px) {
  const Eigen::Index n = y_m.size();
  if (n < 3 || pixel.cols() != n) throw InvalidArgument(detail::text("axis map has ", pixel.cols(), " places and ", n, " coordinates, must have at least 3 of each"));
  if (!pixel.allFinite() || !y_m.allFinite()) throw InvalidArgument("axis map: places and coordinates must be finite");
  require_positive("centroid error", sigma_px, "px");
  for (Eigen::Index i = 1; i < n; ++i)
    if (!(y_m[i] > y_m[i - 1])) throw InvalidArgument(detail::text("axis map: coordinate ", i, " is ", y_m[i], " m, must exceed its predecessor, ", y_m[i - 1], " m"));

  AxisMap map;
  map.origin_px = pixel.rowwise().mean();
  const Matrix2Xd centred = pixel.colwise() - map.origin_px;
  Eigen::SelfAdjointEigenSolver<Matrix2d> spread;
  spread.computeDirect(centred * centred.transpose());
  map.direction = spread.eigenvectors().col(1);
  if (map.direction.dot(pixel.col(n - 1) - pixel.col(0)) < 0.0) map.direction = -map.direction;
  const VectorXd u = centred.transpose() * map.direction;
  for (Eigen::Index i = 1; i < n; ++i)
    if (!(u[i] > u[i - 1])) throw InvalidArgument(detail::text("axis map: place ", i, " does not follow its predecessor in the image"));
  map.half_length_px = 0.5 * (u[n - 1] - u[0]);

  // Gauss–Newton on u − u(y) ≈ (y(u) − y)/y'(u); the start is the affine map through the ends.
  const double b = 0.5 * (y_m[n - 1] - y_m[0]);
  map.coefficients = {y_m[0] - b * u[0] / map.half_length_px, b, 0.0};
  MatrixX3d J(n, 3);
  Matrix3d normal;
  VectorXd r(n);
  const auto linearise = [&] {
    for (Eigen::Index i = 0; i < n; ++i) {
      const double slope = map.scale_m_per_px(u[i]);
      r[i] = (map.y_m(u[i]) - y_m[i]) / slope;
      J.row(i) = map.gradient(u[i]).transpose() / slope;
    }
    normal = J.transpose() * J;
  };
  for (int k = 0; k < 20; ++k) {
    linearise();
    Vector3d step = normal.ldlt().solve(Vector3d(J.transpose() * r));
    const double c = std::clamp(map.coefficients[2] - step[2], -0.5, 0.5);  // beyond, the line's end lies near the camera
    if (c != map.coefficients[2] - step[2]) {  // a and b are then those that fit best with c at its limit
      step[2] = map.coefficients[2] - c;
      map.coefficients[2] = c;
      linearise();
      step.template head<2>() = Matrix2d(normal.template topLeftCorner<2, 2>()).inverse() * (J.template leftCols<2>().transpose() * r);
      map.coefficients.head<2>() -= step.template head<2>();
    } else {
      map.coefficients -= step;
    }
    if (step.norm() < 1e-14) break;
  }
  linearise();
  map.residual_px = std::sqrt(r.squaredNorm() / double(n));
  map.centroid_sigma_px = std::max(sigma_px, n > 3 ? std::sqrt(r.squaredNorm() / double(n - 3)) : 0.0);
  map.covariance = map.centroid_sigma_px * map.centroid_sigma_px * normal.inverse();
  return map;
}

}  // namespace lumo

// ---- lumo/sense/led_detector.hpp

namespace lumo {

/// The finger's lights in an image, from proximal to distal, and the map they give.
struct LedDetection {
  Eigen::Matrix2Xd centroid_px;
  Eigen::VectorXd contrast;  ///< green above the brightest of its surroundings [DN]
  AxisMap map;
};

/// Finds the LEDs of a finger by what is known of them: bright spots in a row, at one pitch, in equal steps but for perspective.
/// Runs once for a camera's place, not on every frame.
struct LedDetector {
  int count = 5;
  double pitch_m = 11.0_mm;
  double first_y_m = -22.0_mm;  ///< of the most proximal one
  Eigen::Vector2d distal{1.0, 0.0};  ///< direction in the image, at most a right angle from that of the tip
  int spot_radius_px = 0;            ///< of a LED's image; 0: the image's larger side over 120, at least 2
  double min_contrast = 8.0;         ///< green above the surroundings [DN]
  double min_share = 0.3;            ///< of the row's brightest spot that its dimmest must have
  double max_residual = 0.06;        ///< RMS distance of the spots from the fitted row, in pitches
  double centroid_sigma_px = 0.3;
  int max_candidates = 24;

  /// Nothing when no such row is seen. Throws InvalidArgument for numbers that make no sense.
  template <class VectorXd = Eigen::VectorXd, class Vector2d = Eigen::Vector2d, class Matrix2Xd = Eigen::Matrix2Xd>
  std::optional<LedDetection> find(const ImageView& image) const;

 private:
  struct Spot {
    Eigen::Vector2d place;
    double contrast;
  };
  template <class Vector2d = Eigen::Vector2d>
  std::vector<Spot> spots(const ImageView& image, int radius) const;
};

namespace detail {

/// Sums of green over rectangles in constant time.
class IntegralImage {
 public:
  explicit IntegralImage(const ImageView& v) : width_(v.width), height_(v.height), sum_(std::size_t(v.width + 1) * std::size_t(v.height + 1)) {
    for (int y = 0; y < v.height; ++y) {
      std::uint32_t row = 0;
      for (int x = 0; x < v.width; ++x) {
        row += v.green(x, y);
        at(x + 1, y + 1) = at(x + 1, y) + row;
      }
    }
  }
  /// Mean over the square of half width r about (x, y), as far as it lies in the image.
  double mean(int x, int y, int r) const {
    const int x0 = std::max(0, x - r), x1 = std::min(width_, x + r + 1), y0 = std::max(0, y - r), y1 = std::min(height_, y + r + 1);
    const std::uint32_t s = at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0);  // wraps round and back
    return double(s) / (double(x1 - x0) * double(y1 - y0));
  }

 private:
  std::uint32_t& at(int x, int y) { return sum_[std::size_t(y) * std::size_t(width_ + 1) + std::size_t(x)]; }
  std::uint32_t at(int x, int y) const { return sum_[std::size_t(y) * std::size_t(width_ + 1) + std::size_t(x)]; }
  int width_, height_;
  std::vector<std::uint32_t> sum_;
};

}  // namespace detail

template <class Vector2d>
inline std::vector<LedDetector::Spot> LedDetector::spots(const ImageView& image, int radius) const {
  const detail::IntegralImage sums(image);
  const int r = radius, far = 4 * radius;
  std::vector<float> contrast(std::size_t(image.width) * std::size_t(image.height));
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) {
      double around = 0.0;  // the brightest of eight neighbours, so that edges and streaks are no spots
      for (int j = -far; j <= far; j += far)
        for (int i = -far; i <= far; i += far)
          if (i != 0 || j != 0) around = std::max(around, sums.mean(std::clamp(x + i, 0, image.width - 1), std::clamp(y + j, 0, image.height - 1), r));
      contrast[std::size_t(y) * std::size_t(image.width) + std::size_t(x)] = float(sums.mean(x, y, r) - around);
    }
  const auto at = [&](int x, int y) { return contrast[std::size_t(y) * std::size_t(image.width) + std::size_t(x)]; };

  std::vector<Spot> found;
  for (int y = r; y < image.height - r; ++y)
    for (int x = r; x < image.width - r; ++x) {
      const float c = at(x, y);
      if (c < min_contrast) continue;
      bool top = true;
      for (int j = -2 * r; top && j <= 2 * r; ++j)
        for (int i = -2 * r; top && i <= 2 * r; ++i) {
          const int xx = x + i, yy = y + j;
          if (xx < 0 || yy < 0 || xx >= image.width || yy >= image.height || (i == 0 && j == 0)) continue;
          const float other = at(xx, yy);
          top = other < c || (other == c && (j > 0 || (j == 0 && i > 0)));  // of equals, the first
        }
      if (!top) continue;
      // Centroid of what stands above the surroundings, three times, each about the last one's middle: the window must not pull it.
      Vector2d centre(x, y);
      const double ground = sums.mean(x, y, far);
      for (int pass = 0; pass < 3; ++pass) {
        Vector2d moment = Vector2d::Zero();
        double weight = 0.0;
        const int cx = int(std::lround(centre.x())), cy = int(std::lround(centre.y()));
        for (int yy = std::max(0, cy - 3 * r); yy <= std::min(image.height - 1, cy + 3 * r); ++yy)
          for (int xx = std::max(0, cx - 3 * r); xx <= std::min(image.width - 1, cx + 3 * r); ++xx) {
            const Vector2d p(xx, yy);
            const double window = std::exp(-0.5 * (p - centre).squaredNorm() / (1.5 * r * 1.5 * r));
            const double w = window * std::max(0.0, image.green(xx, yy) - ground);
            moment += w * p;
            weight += w;
          }
        if (weight <= 0.0) break;
        // A Gaussian window on a Gaussian spot halves the way to its centre (for equal widths): step nearly twice as far.
        centre += 1.8 * (moment / weight - centre);
      }
      if ((centre - Vector2d(x, y)).norm() < 2.0 * r) found.push_back({centre, c});
    }
  std::stable_sort(found.begin(), found.end(), [](const Spot& a, const Spot& b) { return a.contrast > b.contrast; });
  if (found.size() > std::size_t(max_candidates)) found.resize(std::size_t(max_candidates));
  return found;
}

template <class VectorXd, class Vector2d, class Matrix2Xd>
inline std::optional<LedDetection> LedDetector::find(const ImageView& image) const {
  require_in_range("number of LEDs", count, 3, 64, "");
  require_positive("LED pitch", pitch_m, "m");
  require_positive("length of the distal direction", distal.norm(), "");
  if (image.empty()) throw InvalidArgument("LED detection: the image is empty");
  const int radius = spot_radius_px > 0 ? spot_radius_px : std::max(2, std::max(image.width, image.height) / 120);
  const std::vector<Spot> all = spots(image, radius);

  VectorXd y(count);
  for (int k = 0; k < count; ++k) y[k] = first_y_m + pitch_m * k;
  std::optional<LedDetection> best;
  double best_score = 0.0;
  for (const Spot& first : all)
    for (const Spot& last : all) {
      const Vector2d step = (last.place - first.place) / double(count - 1);
      if (step.dot(distal) <= 0.0 || step.norm() < 2.5 * radius) continue;
      LedDetection row{Matrix2Xd(2, count), VectorXd(count), {}};
      bool whole = true;
      for (int k = 0; whole && k < count; ++k) {
        const Vector2d expected = first.place + k * step;
        const auto off = [&](const Spot& s) { return (s.place - expected).squaredNorm(); };
        const auto near = std::min_element(all.begin(), all.end(), [&](const Spot& a, const Spot& b) { return off(a) < off(b); });
        whole = (near->place - expected).norm() < 0.3 * step.norm() && (k == 0 || near->place != Vector2d(row.centroid_px.col(k - 1)));
        row.centroid_px.col(k) = near->place;
        row.contrast[k] = near->contrast;
      }
      if (!whole) continue;
      for (int k = 1; whole && k < count; ++k) whole = (row.centroid_px.col(k) - row.centroid_px.col(k - 1)).dot(step) > 0.25 * step.squaredNorm();
      if (!whole || row.contrast.minCoeff() < min_share * row.contrast.maxCoeff()) continue;
      row.map = AxisMap::fit(row.centroid_px, y, centroid_sigma_px);
      const Vector2d across(-row.map.direction.y(), row.map.direction.x());
      const double off = ((row.centroid_px.colwise() - row.map.origin_px).transpose() * across).squaredNorm() / count;
      const double residual = std::sqrt(row.map.residual_px * row.map.residual_px + off) / step.norm();
      if (residual > max_residual) continue;
      const double score = row.contrast.minCoeff() * std::exp(-0.5 * std::pow(residual / (0.3 * max_residual), 2));
      if (score > best_score) best_score = score, best = row;
    }
  return best;
}

}  // namespace lumo

// ---- lumo/sense/statistics.hpp

namespace lumo {

/// A number with a lower and an upper bound.
struct Interval {
  double value = 0.0, low = 0.0, high = 0.0;
};

/// Middle one of the numbers, mean of the middle two for an even count. Throws InvalidArgument for none.
inline double median(std::vector<double> v) {
  if (v.empty()) throw InvalidArgument("median of no numbers");
  const auto half = v.begin() + std::ptrdiff_t(v.size() / 2);
  std::nth_element(v.begin(), half, v.end());
  return v.size() % 2 ? *half : 0.5 * (*half + *std::max_element(v.begin(), half));
}

/// Quantile by linear interpolation between order statistics (type 7 of Hyndman & Fan 1996). Throws InvalidArgument for none.
inline double quantile(std::vector<double> v, double p) {
  if (v.empty()) throw InvalidArgument("quantile of no numbers");
  require_in_range("quantile", p, 0.0, 1.0, "");
  std::sort(v.begin(), v.end());
  const double place = p * double(v.size() - 1);
  const auto i = std::size_t(place);
  return i + 1 == v.size() ? v[i] : v[i] + (place - double(i)) * (v[i + 1] - v[i]);
}

/// Root mean square of the entries.
template <class VectorXd = Eigen::VectorXd>
inline double rms(In<Eigen::Ref<const VectorXd>> v) { return v.size() ? v.norm() / std::sqrt(double(v.size())) : 0.0; }

/// Median of each row.
template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
inline Eigen::VectorXd pointwise_median(In<MatrixXd> m) {
  VectorXd r(m.rows());
  for (Eigen::Index i = 0; i < m.rows(); ++i) {
    const VectorXd row = m.row(i);
    r[i] = median({row.data(), row.data() + row.size()});
  }
  return r;
}

/// Wilson's score interval of a share, `right` of `all`; z = 1.96 for 95 %. Source: Wilson 1927.
inline Interval wilson_interval(int right, int all, double z = 1.959963984540054) {
  if (all < 1 || right < 0 || right > all) throw InvalidArgument(detail::text("share is ", right, " of ", all, ", must have 0 <= right <= all, all >= 1"));
  const double n = all, p = right / n, z2 = z * z, middle = (p + 0.5 * z2 / n) / (1.0 + z2 / n);
  const double half = z * std::sqrt(p * (1.0 - p) / n + 0.25 * z2 / (n * n)) / (1.0 + z2 / n);
  return {p, std::max(0.0, middle - half), std::min(1.0, middle + half)};
}

namespace detail {

/// Standard normal numbers from a counter; a pure function of (seed, number of calls). Source: Box & Muller 1958.
class CountedNormals {
 public:
  explicit CountedNormals(std::uint64_t seed) : seed_(seed) {}
  double operator()() {
    const double radius = std::sqrt(-2.0 * std::log(uniform(combine(seed_, count_)))), turn = uniform(combine(seed_, count_ + 1));
    count_ += 2;
    return radius * std::cos(6.2831853071795864769 * turn);
  }

 private:
  std::uint64_t seed_, count_ = 0;
};

}  // namespace detail

}  // namespace lumo

// ---- lumo/sense/cycle_metrics.hpp

namespace lumo {

/// One run of cycles within maintained contact: `load[k]` holds the responses at matched force k, channels × cycles.
struct CycleRun {
  std::vector<Eigen::MatrixXd> load;
};

/// W_cycle: median over runs, forces and cycles of the RMS deviation from the pointwise median over the run's cycles at that force. The paper says
/// "matched-force variation across cycles"; that it is taken as W_recontact is, with cycles for re-contacts, is our reading.
/// Throws InvalidArgument for no runs, fewer than two cycles, or shapes that differ.
template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
inline double cycle_variation(const std::vector<CycleRun>& runs) {
  std::vector<double> deviation;
  for (const CycleRun& run : runs)
    for (const MatrixXd& cycles : run.load) {
      if (cycles.cols() < 2 || cycles.rows() < 1)
        throw InvalidArgument(detail::text("cycle variation: ", cycles.rows(), " channels × ", cycles.cols(), " cycles, must have at least 1 × 2"));
      if (!cycles.allFinite()) throw InvalidArgument("cycle variation: responses must be finite");
      const VectorXd middle = pointwise_median(cycles);
      for (Eigen::Index c = 0; c < cycles.cols(); ++c) deviation.push_back(rms(cycles.col(c) - middle));
    }
  if (deviation.empty()) throw InvalidArgument("cycle variation: no runs");
  return median(deviation);
}

/// Regional RMS change: of each channel, over re-contacts, from a low load to a high one (paper: 2 to 15 N). Both channels × re-contacts.
template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
inline Eigen::VectorXd regional_rms_change(In<MatrixXd> low, In<MatrixXd> high) {
  if (low.rows() != high.rows() || low.cols() != high.cols() || low.cols() < 1)
    throw InvalidArgument(detail::text("regional change: ", low.rows(), " × ", low.cols(), " and ", high.rows(), " × ", high.cols(),
        " responses, must be the same, at least one re-contact"));
  if (!low.allFinite() || !high.allFinite()) throw InvalidArgument("regional change: responses must be finite");
  return ((high - low).rowwise().squaredNorm() / double(low.cols())).cwiseSqrt();
}

/// 100 (1 − W/W_base) [%]: by how much a variation is smaller than the baseline's.
inline double reduction_percent(double value, double baseline) {
  require_positive("baseline's value", baseline, "");
  require_in_range("value", value, -1e300, 1e300, "");
  return 100.0 * (1.0 - value / baseline);
}
/// 100 (D/D_base − 1) [%].
inline double gain_percent(double value, double baseline) { return -reduction_percent(value, baseline); }

}  // namespace lumo

// ---- lumo/sense/decoder.hpp

namespace lumo {

/// Responses with the place that each belongs to. Places are numbered from 0 along the finger.
struct LabelledResponses {
  Eigen::MatrixXd response;  ///< features × observations
  std::vector<int> place;    ///< of each observation
  Eigen::VectorXd place_m;   ///< where the places are, ascending
  int places() const { return int(place_m.size()); }
};

/// Throws InvalidArgument unless shapes fit, numbers are finite, places ascend and every place has an observation.
template <class = void>
inline void validate(const LabelledResponses& d) {
  if (d.places() < 2 || d.response.rows() < 1 || d.response.cols() != Eigen::Index(d.place.size()))
    throw InvalidArgument(detail::text("labelled responses: ", d.response.rows(), " features × ", d.response.cols(), " observations, ", d.place.size(), " labels, ",
        d.places(), " places"));
  if (!d.response.allFinite() || !d.place_m.allFinite()) throw InvalidArgument("labelled responses: numbers must be finite");
  for (Eigen::Index i = 1; i < d.place_m.size(); ++i)
    if (!(d.place_m[i] > d.place_m[i - 1]))
      throw InvalidArgument(detail::text("labelled responses: place ", i, " lies at ", d.place_m[i], " m, must exceed its predecessor, ", d.place_m[i - 1], " m"));
  std::vector<bool> seen(std::size_t(d.places()), false);
  for (const int p : d.place) {
    if (p < 0 || p >= d.places()) throw InvalidArgument(detail::text("labelled responses: place ", p, ", must lie in [0, ", d.places() - 1, "]"));
    seen[std::size_t(p)] = true;
  }
  for (std::size_t p = 0; p < seen.size(); ++p)
    if (!seen[p]) throw InvalidArgument(detail::text("labelled responses: no observation of place ", p));
}

/// What a decoder says of one response.
struct Decoding {
  int place = 0;
  Eigen::VectorXd probability;  ///< of each place; sums to 1
};

/// Learns places from labelled responses; the model it gives decodes new ones.
/// Laws: `fit` is a pure function of its data; the place decoded is (one of) the most probable; the answer does not depend on the order of observations
/// (up to rounding).
template <class D>
concept Decoder = requires(const D& decoder, const LabelledResponses& training, const Eigen::VectorXd& response) {
  { decoder.fit(training).decode(response) } -> std::same_as<Decoding>;
};

namespace detail {

/// Softmax of log weights, and its mode.
template <class VectorXd = Eigen::VectorXd>
inline Decoding decoding_of(In<VectorXd> log_weight) {
  Decoding d;
  Eigen::Index top = 0;
  const double most = log_weight.maxCoeff(&top);
  d.place = int(top);
  d.probability = (log_weight.array() - most).exp();
  d.probability /= d.probability.sum();
  return d;
}

/// Mean response of each place, features × places.
template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
inline Eigen::MatrixXd place_means(const LabelledResponses& t) {
  MatrixXd mean = MatrixXd::Zero(t.response.rows(), t.places());
  VectorXd count = VectorXd::Zero(t.places());
  for (std::size_t i = 0; i < t.place.size(); ++i) mean.col(t.place[i]) += t.response.col(Eigen::Index(i)), count[t.place[i]] += 1.0;
  return mean * count.cwiseInverse().asDiagonal();
}

}  // namespace detail

}  // namespace lumo

// ---- lumo/sense/recontact_metrics.hpp

namespace lumo {

/// Slope of each channel's response over force [unit/N], by least squares with an intercept. `response`: channels × loads.
/// Throws InvalidArgument for fewer than two different loads or numbers that are not finite.
template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
inline Eigen::VectorXd intensity_force_slope(In<MatrixXd> response, In<VectorXd> force_N) {
  if (force_N.size() < 2 || response.cols() != force_N.size())
    throw InvalidArgument(detail::text("slope over force: ", response.cols(), " responses and ", force_N.size(), " loads, must be as many, at least 2"));
  if (!response.allFinite() || !force_N.allFinite()) throw InvalidArgument("slope over force: numbers must be finite");
  const VectorXd centred = force_N.array() - force_N.mean();
  const double spread = centred.squaredNorm();
  if (!(spread > 1e-12 * force_N.squaredNorm())) throw InvalidArgument("slope over force: all loads are the same");
  return response * centred / spread;
}

/// How well neighbouring places are told apart, against how well re-contacts repeat (paper Eq. 9).
struct RecontactMetrics {
  double D_neighbor = 0.0;    ///< median over neighbours of the RMS difference of their median profiles [unit/N]
  double W_recontact = 0.0;   ///< median over places and re-contacts of the RMS deviation from the median profile [unit/N]
  std::optional<double> Q;    ///< D/W; empty where W is 0
};

/// Q with what happens to it when one re-contact is left out (the paper's whiskers), and a bootstrap interval.
struct RecontactQuality {
  RecontactMetrics metrics;
  double Q_low = 0.0, Q_high = 0.0;                      ///< least and greatest with one re-contact left out everywhere, and of all
  /// Interval of the Q that infinitely many re-contacts at these places would give. Few re-contacts make Q too large, for their median lies among them;
  /// the interval makes up for that and so need not hold the sample's own Q.
  double bootstrap_low = 0.0, bootstrap_high = 0.0;
};

/// `slope[i]`: profiles of slopes at place i along the finger, channels × re-contacts. Throws InvalidArgument for fewer than two places, no
/// re-contacts, or shapes that differ.
template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
RecontactMetrics recontact_metrics(In<std::vector<MatrixXd>> slope);

/// At least three re-contacts at each place, as many everywhere (of two, the whiskers' one would be its own median). The interval is a parametric bootstrap
/// of log Q: re-contacts are drawn about each place's median from a Gaussian with the covariance that the place's own re-contacts have (channels scatter
/// together where a contact shifts), and the errors of log Q against that known model are taken off. Drawing the re-contacts themselves anew would not do: few of
/// them repeat each other, and then W is too small. `confidence` of the interval. Source: Efron & Tibshirani 1993, §6.5 and §13.
/// Throws InvalidArgument where Q is not defined.
template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
RecontactQuality recontact_quality(In<std::vector<MatrixXd>> slope, int resamples = 2000, std::uint64_t seed = 1, double confidence = 0.95);

template <class MatrixXd, class VectorXd>
inline RecontactMetrics recontact_metrics(In<std::vector<MatrixXd>> slope) {
  if (slope.size() < 2) throw InvalidArgument(detail::text("re-contact metrics have ", slope.size(), " places, must have at least 2"));
  std::vector<VectorXd> middle;
  std::vector<double> between, within;
  for (const MatrixXd& p : slope) {
    if (p.cols() < 1 || p.rows() != slope.front().rows() || p.rows() < 1)
      throw InvalidArgument(detail::text("re-contact metrics: place ", middle.size(), " has ", p.rows(), " channels × ", p.cols(), " re-contacts, the first ",
          slope.front().rows(), " channels"));
    if (!p.allFinite()) throw InvalidArgument(detail::text("re-contact metrics: slopes at place ", middle.size(), " must be finite"));
    middle.push_back(pointwise_median(p));
    for (Eigen::Index r = 0; r < p.cols(); ++r) within.push_back(rms(p.col(r) - middle.back()));
  }
  for (std::size_t i = 1; i < middle.size(); ++i) between.push_back(rms(middle[i] - middle[i - 1]));
  RecontactMetrics m{median(between), median(within), {}};
  if (m.W_recontact > 0.0) m.Q = m.D_neighbor / m.W_recontact;
  return m;
}

template <class MatrixXd, class VectorXd>
inline RecontactQuality recontact_quality(In<std::vector<MatrixXd>> slope, int resamples, std::uint64_t seed, double confidence) {
  require_in_range("bootstrap resamples", resamples, 20, 1e6, "");
  require_in_range("confidence", confidence, 0.0, 1.0, "");
  RecontactQuality q;
  q.metrics = recontact_metrics(slope);
  const Eigen::Index repeats = slope.front().cols();
  for (const MatrixXd& p : slope)
    if (p.cols() != repeats || repeats < 3)
      throw InvalidArgument(detail::text("re-contact quality needs as many re-contacts everywhere, at least 3; has ", p.cols(), " and ", repeats));
  if (!q.metrics.Q) throw InvalidArgument("re-contact quality is not defined: all re-contacts are the same");
  if (!(*q.metrics.Q > 0.0)) throw InvalidArgument("re-contact quality is not defined: all places are the same");
  q.Q_low = q.Q_high = *q.metrics.Q;
  std::vector<MatrixXd> some(slope.size());
  for (Eigen::Index left_out = 0; left_out < repeats; ++left_out) {
    for (std::size_t i = 0; i < slope.size(); ++i) {
      some[i].resize(slope[i].rows(), repeats - 1);
      some[i] << slope[i].leftCols(left_out), slope[i].rightCols(repeats - 1 - left_out);
    }
    if (const auto without = recontact_metrics(some).Q) q.Q_low = std::min(q.Q_low, *without), q.Q_high = std::max(q.Q_high, *without);
  }
  std::vector<VectorXd> middle;
  std::vector<MatrixXd> scatter;  // times a vector of normal numbers: a deviation of that place
  for (const MatrixXd& p : slope) {
    middle.push_back(pointwise_median(p));
    scatter.push_back((p.colwise() - p.rowwise().mean()) / std::sqrt(double(repeats) - 1.0));
  }
  detail::CountedNormals normal(seed);
  VectorXd numbers(repeats);
  const auto deviation = [&](std::size_t place) {
    for (double& z : numbers) z = normal();
    return VectorXd(scatter[place] * numbers);
  };
  std::vector<double> sizes, error;
  for (int k = 0; k < resamples; ++k)
    for (std::size_t i = 0; i < slope.size(); ++i) sizes.push_back(rms(deviation(i)));
  const double W = median(sizes);  // of the model
  some = slope;
  for (int k = 0; k < resamples && W > 0.0; ++k) {
    for (std::size_t i = 0; i < slope.size(); ++i)
      for (Eigen::Index r = 0; r < repeats; ++r) some[i].col(r) = middle[i] + deviation(i);
    if (const auto drawn = recontact_metrics(some).Q; drawn && *drawn > 0.0) error.push_back(std::log(*drawn * W / q.metrics.D_neighbor));
  }
  if (error.empty()) throw InvalidArgument("re-contact quality has no interval: at most places all re-contacts are the same");
  // The scatter itself is known from so many re-contacts only: wider by √(n/(n − 1)) about the middle.
  const double centre = median(error), wider = std::sqrt(double(repeats) / (double(repeats) - 1.0));
  const auto limit = [&](double p) { return *q.metrics.Q * std::exp(-centre - wider * (quantile(error, p) - centre)); };
  q.bootstrap_low = limit(0.5 * (1.0 + confidence));
  q.bootstrap_high = limit(0.5 * (1.0 - confidence));
  return q;
}

}  // namespace lumo

// ---- lumo/sense/golden_section.hpp

namespace lumo {

/// Where a function of one number is least between a and b, if it has one minimum there: `steps` sections, each of which leaves 0.618 of the stretch.
/// Source: Kiefer 1953.
template <class Function>
double golden_section(Function function, double a, double b, int steps) {
  constexpr double golden = 0.61803398874989484820;
  for (int k = 0; k < steps; ++k) {
    const double c = b - golden * (b - a), d = a + golden * (b - a);
    if (function(c) <= function(d))
      b = d;
    else
      a = c;
  }
  return 0.5 * (a + b);
}

}  // namespace lumo

// ---- lumo/sense/identification.hpp

namespace lumo {

/// Parameters from a linear least-squares problem, with what the data do not tell.
struct Identification {
  Eigen::VectorXd value;       ///< of least norm in units of the scales: nothing is added along null directions
  Eigen::MatrixXd covariance;  ///< along the identified directions only
  Eigen::Index rank = 0;
  Eigen::MatrixXd null_space;  ///< parameters × (parameters − rank), unit columns in units of the scales: may be added at will
  double residual = 0.0;       ///< RMS of what the fit leaves

  Eigen::Index unknowns() const { return value.size(); }
  bool complete() const { return rank == unknowns(); }
};

/// Solves a x ≈ b for equal, independent errors. `scale` makes parameters of unlike units comparable (a typical size of each). Singular values below
/// `tolerance` times the largest do not count. `sigma`: standard deviation of an entry of b; where it is 0, that of the residual is taken. `known` > 0: nor do
/// directions whose standard deviation exceeds that many scales, for of those the data tell less than was known before.
/// Throws InvalidArgument for shapes that do not fit or numbers that are not finite.
template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
inline Identification identify(In<MatrixXd> a, In<VectorXd> b, In<VectorXd> scale, double sigma = 0.0, double tolerance = 1e-6,
                               double known = 0.0) {
  const Eigen::Index n = a.cols();
  if (n < 1 || a.rows() != b.size() || scale.size() != n)
    throw InvalidArgument(detail::text("identification has ", a.rows(), " × ", n, " coefficients, ", b.size(), " observations and ", scale.size(), " scales"));
  if (!a.allFinite() || !b.allFinite() || !(scale.array() > 0.0).all()) throw InvalidArgument("identification: numbers must be finite, scales positive");
  Identification r;
  const MatrixXd scaled = a * scale.asDiagonal();
  if (a.rows() == 0 || scaled.cwiseAbs().maxCoeff() == 0.0) {
    r.value = VectorXd::Zero(n);
    r.covariance = MatrixXd::Zero(n, n);
    r.null_space = MatrixXd::Identity(n, n);
    r.residual = b.size() ? b.norm() / std::sqrt(double(b.size())) : 0.0;
    return r;
  }
  const Eigen::JacobiSVD<MatrixXd> svd(scaled, Eigen::ComputeThinU | Eigen::ComputeFullV);
  const VectorXd& s = svd.singularValues();
  r.rank = (s.array() > tolerance * s[0]).count();
  const VectorXd projection = svd.matrixU().transpose() * b;
  const auto deviation = [&] {
    const double left = std::max(b.squaredNorm() - projection.head(r.rank).squaredNorm(), 0.0);
    return sigma > 0.0 ? sigma : b.size() > r.rank ? std::sqrt(left / double(b.size() - r.rank)) : 0.0;
  };
  while (known > 0.0 && r.rank > 0 && deviation() > known * s[r.rank - 1]) --r.rank;
  const MatrixXd v = svd.matrixV().leftCols(r.rank);
  const VectorXd inverse = s.head(r.rank).cwiseInverse();
  r.value = scale.asDiagonal() * (v * inverse.cwiseProduct(projection.head(r.rank)));
  r.null_space = svd.matrixV().rightCols(n - r.rank);
  const double left = (a * r.value - b).squaredNorm();
  r.residual = std::sqrt(left / double(b.size()));
  const double variance = sigma > 0.0 ? sigma * sigma : b.size() > r.rank ? left / double(b.size() - r.rank) : 0.0;
  const MatrixXd half = scale.asDiagonal() * v * inverse.asDiagonal();
  r.covariance = variance * half * half.transpose();
  return r;
}

}  // namespace lumo

// ---- lumo/sense/torque_model.hpp

namespace lumo {

/// One joint without contact: what the motor spends on friction, weight and offset. Friction is Coulomb's, Stribeck's rise towards standstill and a
/// viscous part (Armstrong-Hélouvry, Dupont & Canudas de Wit 1994); weight is that of one rigid link, gravity_sin · sin q + gravity_cos · cos q.
struct TorqueModel {
  double torque_constant_Nm_per_A = 1.0;  ///< at the joint, gear included; not seen by an unloaded run
  double coulomb_Nm = 0.0;
  double stribeck_Nm = 0.0;             ///< by which friction at standstill exceeds Coulomb's
  double viscous_Nm_s_per_rad = 0.0;
  double bias_Nm = 0.0;
  double gravity_sin_Nm = 0.0, gravity_cos_Nm = 0.0;
  double stribeck_velocity_rad_per_s = 0.1;
  double rest_velocity_rad_per_s = 0.02;  ///< below, the joint may stand, and the sign of friction is not known
  double noise_Nm = 0.01;                 ///< of one sample

  /// Torque of the motor [N·m] from its effort.
  double motor_torque(double effort, Effort unit) const { return unit == Effort::current_A ? torque_constant_Nm_per_A * effort : effort; }
  double friction(double velocity) const { return std::tanh(velocity / rest_velocity_rad_per_s) * magnitude(velocity) + viscous_Nm_s_per_rad * velocity; }
  double unloaded(double position, double velocity) const {
    return friction(velocity) + bias_Nm + gravity_sin_Nm * std::sin(position) + gravity_cos_Nm * std::cos(position);
  }
  /// What friction at standstill leaves open [N·m]: uniform between its two signs.
  double stiction_sigma(double velocity) const {
    const double t = std::tanh(velocity / rest_velocity_rad_per_s);
    return (1.0 - t * t) * magnitude(velocity) / std::sqrt(3.0);
  }

 private:
  double magnitude(double velocity) const { return coulomb_Nm + stribeck_Nm * std::exp(-std::pow(velocity / stribeck_velocity_rad_per_s, 2)); }
};

/// Throws InvalidArgument for numbers that make no sense.
inline void validate(const TorqueModel& m) {
  if (!(std::abs(m.torque_constant_Nm_per_A) >= 1e-6 && std::abs(m.torque_constant_Nm_per_A) <= 1e3))
    throw InvalidArgument(detail::text("torque constant is ", m.torque_constant_Nm_per_A, " N·m/A, must lie in [1e-6, 1000] N·m/A, on either side of 0"));
  for (const double v : {m.coulomb_Nm, m.stribeck_Nm, m.bias_Nm, m.gravity_sin_Nm, m.gravity_cos_Nm})
    require_in_range("friction, offset or weight of a torque model", v, -1e3, 1e3, "N·m");
  require_in_range("viscous friction", m.viscous_Nm_s_per_rad, -1e3, 1e3, "N·m·s/rad");
  require_in_range("Stribeck velocity", m.stribeck_velocity_rad_per_s, 1e-9, 1e6, "rad/s");
  require_in_range("velocity below which a joint may stand", m.rest_velocity_rad_per_s, 1e-9, 1e6, "rad/s");
  require_in_range("noise of the torque", m.noise_Nm, 0.0, 1e3, "N·m");
}

/// A torque model from an unloaded run, and what that run could not tell.
struct TorqueIdentification {
  static constexpr std::array<const char*, 6> names{"coulomb_Nm", "stribeck_Nm", "viscous_Nm_s_per_rad", "bias_Nm", "gravity_sin_Nm", "gravity_cos_Nm"};
  TorqueModel model;     ///< what is not identified stays 0 along the null directions
  Identification linear;  ///< of `names`, in this order
};

/// Fits friction, bias and weight of joint `joint` to samples without contact. `start` gives the constants that such a run does not tell. The Stribeck
/// velocity is searched for by sections; all else is linear. Throws InvalidArgument for no samples or numbers that are not finite.
template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
inline TorqueIdentification identify_unloaded(std::span<const JointSample> samples, int joint, const TorqueModel& start = {}) {
  std::vector<double> q, v, t;
  for (const JointSample& s : samples) {
    if (joint < 0 || joint >= s.effort.size() || joint >= s.position_rad.size() || joint >= s.velocity_rad_per_s.size())
      throw InvalidArgument(detail::text("unloaded run has no joint ", joint));
    q.push_back(s.position_rad[joint]), v.push_back(s.velocity_rad_per_s[joint]), t.push_back(start.motor_torque(s.effort[joint], s.unit));
  }
  if (t.empty()) throw InvalidArgument("unloaded run has no samples");
  const auto n = Eigen::Index(t.size());
  const VectorXd torque = Eigen::Map<const VectorXd>(t.data(), n);
  const auto fit = [&](double stribeck_velocity) {
    MatrixXd a(n, 6);
    for (Eigen::Index i = 0; i < n; ++i) {
      const double w = v[std::size_t(i)], sign = std::tanh(w / start.rest_velocity_rad_per_s);
      a.row(i) << sign, sign * std::exp(-std::pow(w / stribeck_velocity, 2)), w, 1.0, std::sin(q[std::size_t(i)]), std::cos(q[std::size_t(i)]);
    }
    // Parameters are of some 50 mN·m; what the run does not tell to half of that stays out, or noise would speak where the run did not go.
    return identify(a, torque, VectorXd::Constant(6, 0.05), 0.0, 1e-6, 0.5);
  };
  // Golden sections in the logarithm, after a coarse look: the residual has one minimum near its smallest coarse value.
  double fastest = 0.0;
  for (const double w : v) fastest = std::max(fastest, std::abs(w));
  const double low = std::log(std::max(1.5 * start.rest_velocity_rad_per_s, 1e-6)), high = std::max(low + 1e-3, std::log(std::max(fastest, 1e-6)));
  constexpr int looks = 13;
  int least = 0;
  double smallest = 1e300;
  for (int k = 0; k < looks; ++k)
    if (const double r = fit(std::exp(low + (high - low) * k / (looks - 1))).residual; r < smallest * (1.0 - 1e-9)) smallest = r, least = k;
  const double a = low + (high - low) * std::max(0, least - 1) / (looks - 1), b = low + (high - low) * std::min(looks - 1, least + 1) / (looks - 1);
  const double best = std::exp(golden_section([&](double at) { return fit(std::exp(at)).residual; }, a, b, 24));
  TorqueIdentification result{start, fit(best)};
  const VectorXd& x = result.linear.value;
  TorqueModel& m = result.model;
  m.stribeck_velocity_rad_per_s = best;
  m.coulomb_Nm = x[0], m.stribeck_Nm = x[1], m.viscous_Nm_s_per_rad = x[2], m.bias_Nm = x[3], m.gravity_sin_Nm = x[4], m.gravity_cos_Nm = x[5];
  m.noise_Nm = result.linear.residual;
  return result;
}

}  // namespace lumo

// ---- lumo/sense/session.hpp

namespace lumo {

/// A stretch of a log whose circumstances were known to whoever made it: what decoders learn from and metrics compare. Estimators do not read it.
struct Segment {
  std::int64_t from_ns = 0, to_ns = 0;
  std::string kind = "hold";  ///< "unloaded", "approach", "hold", "cycle", "retract" or anything else
  int place = -1;             ///< number of the tested place, from 0; −1: none
  double y_mm = 0.0;          ///< of that place
  int repetition = -1;        ///< re-contact or run, from 0; −1: none
  int cycle = -1;             ///< within maintained contact
  double load_N = 0.0;
  double angle_deg = 0.0;
  double diameter_mm = 0.0;   ///< of the indenter; 0: not said
  bool operator==(const Segment&) const = default;
};

/// What session.json says.
struct Session {
  std::string title;
  std::string clock = "monotonic";  ///< on which frames are stamped
  std::string material;             ///< of the pad
  std::vector<double> theta_mm;     ///< its design; may be empty
  std::string video;                ///< file name beside session.json; empty: frames/
  int led_count = 5;
  double led_pitch_m = 11.0_mm, led_first_y_m = -22.0_mm;
  Eigen::Vector2d distal{1.0, 0.0};    ///< direction of the tip in the image
  double joint_to_origin_m = 0.05;     ///< from the joint's axis to the finger's origin
  std::vector<double> torque_constant_Nm_per_A{1.0};  ///< of each joint, gear included
  double frame_delay_s = 0.0, joint_delay_s = 0.0;    ///< from the event to the stamp
  ClockMap joint_clock, wrench_clock;  ///< onto the frames' clock
  std::vector<Segment> segments;
};

/// Throws InputError for what makes no sense; `name` stands in the message.
template <class = void>
inline void validate(const Session& s, const std::string& name) {
  const auto require = [&](bool good, const std::string& what) {
    if (!good) throw InputError(detail::text(name, ": ", what));
  };
  require(s.led_count >= 3 && s.led_count <= 64, detail::text("led count is ", s.led_count, ", must lie in [3, 64]"));
  require(s.led_pitch_m > 0.0 && s.led_pitch_m < 1.0, detail::text("led pitch is ", 1e3 * s.led_pitch_m, " mm, must lie in (0, 1000) mm"));
  require(std::isfinite(s.distal.norm()) && s.distal.norm() > 0.0, "distal direction must not be zero");
  require(!s.torque_constant_Nm_per_A.empty() && s.torque_constant_Nm_per_A.size() <= std::size_t(max_joints),
          detail::text("has ", s.torque_constant_Nm_per_A.size(), " torque constants, must have 1 to ", max_joints));
  require(s.video.find('/') == std::string::npos && s.video.find('\\') == std::string::npos && s.video != "..", "video must be a file name beside session.json");
  require(std::isfinite(s.led_first_y_m) && std::abs(s.led_first_y_m) <= 10.0, detail::text("first LED's y is ", 1e3 * s.led_first_y_m, " mm, must lie within 10000 mm"));
  require(std::abs(s.joint_to_origin_m) <= 10.0, detail::text("way from joint to origin is ", 1e3 * s.joint_to_origin_m, " mm, must lie within 10000 mm"));
  for (const double k : s.torque_constant_Nm_per_A)
    require(std::abs(k) >= 1e-6 && std::abs(k) <= 1e3, detail::text("torque constant is ", k, " N·m/A, must lie in [1e-6, 1000] N·m/A, on either side of 0"));
  for (const double theta : s.theta_mm) require(std::isfinite(theta), "design must be finite");
  for (const double delay : {s.frame_delay_s, s.joint_delay_s}) require(std::abs(delay) <= 10.0, detail::text("delay is ", delay, " s, must lie within 10 s"));
  const auto stamp = [&](std::int64_t ns) { require(ns >= -stamp_limit_ns && ns <= stamp_limit_ns, detail::text("stamp ", ns, " ns is beyond the range of stamps")); };
  for (const ClockMap& map : {s.joint_clock, s.wrench_clock}) {
    stamp(map.origin_ns);
    require(std::abs(map.offset_s) <= 4e9, detail::text("offset of a clock is ", map.offset_s, " s, must lie within 4e9 s"));
    require(std::abs(map.drift) <= 0.1, detail::text("drift of a clock is ", map.drift, ", must lie within 0.1"));
    require(map.residual_s >= 0.0 && std::isfinite(map.residual_s), detail::text("residual of a clock is ", map.residual_s, " s, must not be negative"));
  }
  for (std::size_t i = 0; i < s.segments.size(); ++i) {
    const Segment& g = s.segments[i];
    stamp(g.from_ns), stamp(g.to_ns);
    require(g.to_ns >= g.from_ns, detail::text("segment ", i, " ends at ", g.to_ns, " ns, before it begins at ", g.from_ns, " ns"));
    for (const double v : {g.y_mm, g.load_N, g.angle_deg, g.diameter_mm}) require(std::isfinite(v), detail::text("numbers of segment ", i, " must be finite"));
  }
}

}  // namespace lumo

// ---- lumo/sense/segment_responses.hpp

namespace lumo {

/// Mean response over each hold of a log, ready for metrics and decoders.
struct HoldResponse {
  Segment segment;
  Eigen::VectorXd response;  ///< mean over the segment's profiles, minus the unloaded one that came last before it
  int profiles = 0;
};

/// Responses of all segments of kind "hold" or "cycle" that have profiles. Each is taken against the mean over the last segment of kind "unloaded" that
/// ended before it, because lamps drift between re-contacts; a session without any is an error. Throws InvalidArgument.
template <class VectorXd = Eigen::VectorXd>
inline std::vector<HoldResponse> hold_responses(std::span<const Profile> profiles, const std::vector<Segment>& segments) {
  const auto mean = [&](const Segment& s) {
    std::pair<VectorXd, int> m{VectorXd(), 0};
    for (const Profile& p : profiles) {
      if (p.stamp_ns < s.from_ns || p.stamp_ns > s.to_ns) continue;
      if (m.second == 0) m.first = VectorXd::Zero(p.value.size());
      if (p.value.size() != m.first.size()) throw InvalidArgument(detail::text("profiles have ", m.first.size(), " and ", p.value.size(), " values"));
      m.first += p.value;
      ++m.second;
    }
    if (m.second > 0) m.first /= double(m.second);
    return m;
  };
  std::vector<HoldResponse> list;
  std::map<std::size_t, VectorXd> unloaded;
  for (const Segment& s : segments) {
    if (s.kind != "hold" && s.kind != "cycle") continue;
    const Segment* before = nullptr;
    for (const Segment& u : segments)
      if (u.kind == "unloaded" && u.to_ns <= s.from_ns && (!before || u.to_ns > before->to_ns)) before = &u;
    if (!before) throw InvalidArgument(detail::text("the segment that begins at ", s.from_ns, " ns has no unloaded segment before it"));
    auto& reference = unloaded[std::size_t(before - segments.data())];
    if (reference.size() == 0) reference = mean(*before).first;
    const auto [value, count] = mean(s);
    if (count == 0) continue;
    if (reference.size() != value.size()) throw InvalidArgument(detail::text("the unloaded segment that ends at ", before->to_ns, " ns has no profiles"));
    list.push_back({s, value - reference, count});
  }
  return list;
}

/// Those holds and cycles of one indenter at one approach angle: places are compared under the same contact only.
inline std::vector<HoldResponse> responses_of(const std::vector<HoldResponse>& holds, double diameter_mm, double angle_deg) {
  std::vector<HoldResponse> list;
  for (const HoldResponse& h : holds)
    if (h.segment.diameter_mm == diameter_mm && h.segment.angle_deg == angle_deg) list.push_back(h);
  return list;
}

namespace detail {

/// Holds by place, re-contact and load. Throws InvalidArgument unless one indenter at one angle made them all, each load of a re-contact is held once, and
/// places, numbered along the finger, ascend in y.
inline std::map<int, std::map<int, std::map<double, const HoldResponse*>>> recontacts(const std::vector<HoldResponse>& holds) {
  std::map<int, std::map<int, std::map<double, const HoldResponse*>>> by_place;
  const Segment* first = nullptr;
  for (const HoldResponse& h : holds) {
    const Segment& s = h.segment;
    if (s.kind != "hold" || s.place < 0 || s.repetition < 0) continue;
    if (!first) first = &s;
    if (s.diameter_mm != first->diameter_mm || s.angle_deg != first->angle_deg)
      throw InvalidArgument(text("holds are of indenters of ", first->diameter_mm, " mm at ", first->angle_deg, "° and of ", s.diameter_mm, " mm at ", s.angle_deg,
          "°, must be of one: take each by itself"));
    if (!by_place[s.place][s.repetition].emplace(s.load_N, &h).second)
      throw InvalidArgument(text("place ", s.place, ", re-contact ", s.repetition, " has two holds at ", s.load_N, " N"));
  }
  const Segment* before = nullptr;
  for (const auto& place : by_place) {
    const Segment& s = place.second.begin()->second.begin()->second->segment;
    for (const auto& recontact : place.second)
      for (const auto& hold : recontact.second)
        if (hold.second->segment.y_mm != s.y_mm) throw InvalidArgument(text("place ", s.place, " lies at y = ", s.y_mm, " and at ", hold.second->segment.y_mm, " mm"));
    if (before && !(s.y_mm > before->y_mm))
      throw InvalidArgument(text("place ", s.place, " lies at y = ", s.y_mm, " mm, must exceed that of place ", before->place, ", ", before->y_mm, " mm"));
    before = &s;
  }
  return by_place;
}

}  // namespace detail

/// Slope profiles p_{i,r} over all loads of each re-contact: for each place along the finger, channels × re-contacts. Throws InvalidArgument where
/// more than one indenter or angle is among the holds, a load is held twice, or a place between two others is missing: its neighbours are none of each other.
template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
inline std::vector<Eigen::MatrixXd> slope_profiles(const std::vector<HoldResponse>& holds) {
  std::vector<MatrixXd> slopes;
  int next = -1;
  for (const auto& place : detail::recontacts(holds)) {
    if (next >= 0 && place.first != next) throw InvalidArgument(detail::text("place ", next, " has no re-contacts, but places before and after it have"));
    next = place.first + 1;
    MatrixXd m(holds.front().response.size(), Eigen::Index(place.second.size()));
    Eigen::Index column = 0;
    for (const auto& recontact : place.second) {
      MatrixXd response(m.rows(), Eigen::Index(recontact.second.size()));
      VectorXd load(response.cols());
      Eigen::Index k = 0;
      for (const auto& hold : recontact.second) response.col(k) = hold.second->response, load[k++] = hold.first;
      m.col(column++) = intensity_force_slope(response, load);
    }
    slopes.push_back(std::move(m));
  }
  return slopes;
}

/// The decoder's observations, with the repetition of each as its fold.
struct DecodingTask {
  LabelledResponses data;
  std::vector<int> fold;
};

/// Loads [N] of at least `least_N` at which every re-contact was held, ascending. Throws InvalidArgument as slope_profiles does.
template <class = void>
inline std::vector<double> common_loads(const std::vector<HoldResponse>& holds, double least_N) {
  std::map<double, int> count;
  int recontacts = 0;
  for (const auto& place : detail::recontacts(holds))
    for (const auto& recontact : place.second) {
      ++recontacts;
      for (const auto& hold : recontact.second) ++count[hold.first];
    }
  std::vector<double> loads;
  for (const auto& [load, times] : count)
    if (times == recontacts && load >= least_N) loads.push_back(load);
  return loads;
}

/// Signed change of response from load to load (paper: from 2 to 5 N), the steps one below the other. `load_N`: at least two. Re-contacts that lack one of
/// them are left out. Throws InvalidArgument when fewer than two places are left, and as slope_profiles does for holds that are not of one kind.
template <class = void>
inline DecodingTask decoding_task(const std::vector<HoldResponse>& holds, const std::vector<double>& load_N) {
  if (load_N.size() < 2) throw InvalidArgument(detail::text("decoding needs at least 2 loads, has ", load_N.size()));
  struct Contact {
    int place, repetition;
    std::vector<const HoldResponse*> at;  // the loads
  };
  std::vector<Contact> contacts;
  std::map<int, double> place_m;
  for (const auto& place : detail::recontacts(holds))
    for (const auto& recontact : place.second) {
      Contact c{place.first, recontact.first, {}};
      for (const double load : load_N)
        for (const auto& hold : recontact.second)
          if (std::abs(hold.first - load) < 1e-6) c.at.push_back(hold.second);
      if (c.at.size() != load_N.size()) continue;
      place_m[c.place] = 1e-3 * c.at.front()->segment.y_mm;
      contacts.push_back(std::move(c));
    }
  if (place_m.size() < 2) throw InvalidArgument(detail::text("decoding: ", place_m.size(), " places have all the loads, must be at least 2"));
  DecodingTask task;
  const Eigen::Index channels = contacts.front().at.front()->response.size(), steps = Eigen::Index(load_N.size()) - 1;
  task.data.response.resize(channels * steps, Eigen::Index(contacts.size()));
  task.data.place_m.resize(Eigen::Index(place_m.size()));
  std::map<int, int> number;
  for (const auto& p : place_m) {
    const int next = int(number.size());
    task.data.place_m[next] = p.second;
    number[p.first] = next;
  }
  for (std::size_t i = 0; i < contacts.size(); ++i) {
    const Contact& c = contacts[i];
    for (Eigen::Index k = 0; k < steps; ++k)
      task.data.response.block(k * channels, Eigen::Index(i), channels, 1) = c.at[std::size_t(k) + 1]->response - c.at[std::size_t(k)]->response;
    task.data.place.push_back(number[c.place]);
    task.fold.push_back(c.repetition);
  }
  return task;
}

/// Runs of cycles within maintained contact: one for each indenter, place, angle and repetition, with its matched loads.
template <class MatrixXd = Eigen::MatrixXd>
inline std::vector<CycleRun> cycle_runs(const std::vector<HoldResponse>& holds) {
  std::map<std::tuple<double, int, double, int>, std::map<double, std::vector<const HoldResponse*>>> runs;
  for (const HoldResponse& h : holds)
    if (const Segment& s = h.segment; s.kind == "cycle") runs[{s.diameter_mm, s.place, s.angle_deg, s.repetition}][s.load_N].push_back(&h);
  std::vector<CycleRun> list;
  for (const auto& run : runs) {
    CycleRun r;
    for (const auto& load : run.second) {
      MatrixXd m(load.second.front()->response.size(), Eigen::Index(load.second.size()));
      for (Eigen::Index k = 0; k < m.cols(); ++k) m.col(k) = load.second[std::size_t(k)]->response;
      r.load.push_back(std::move(m));
    }
    list.push_back(std::move(r));
  }
  return list;
}

}  // namespace lumo

// ---- lumo/sense/nearest_template.hpp

namespace lumo {

/// The paper's decoder: the place whose mean response is nearest (Euclidean). Probabilities are those of equal, round Gaussians about the templates, as
/// wide as the training data scatter.
struct NearestTemplate {
  class Model {
   public:
    template <class = void>
    explicit Model(const LabelledResponses& training) : template_(detail::place_means(training)) {
      double squares = 0.0;
      for (std::size_t i = 0; i < training.place.size(); ++i) squares += (training.response.col(Eigen::Index(i)) - template_.col(training.place[i])).squaredNorm();
      const double freedom = double(training.response.rows()) * std::max(1.0, double(training.place.size()) - double(training.places()));
      variance_ = std::max(squares / freedom, 1e-12 * template_.cwiseAbs2().maxCoeff() + 1e-300);
    }
    /// Throws InvalidArgument for another number of features.
    template <class VectorXd = Eigen::VectorXd>
    Decoding decode(In<VectorXd> response) const {
      if (response.size() != template_.rows()) throw InvalidArgument(detail::text("response has ", response.size(), " features, the templates ", template_.rows()));
      return detail::decoding_of((template_.colwise() - response).colwise().squaredNorm().transpose() * (-0.5 / variance_));
    }
    const Eigen::MatrixXd& templates() const { return template_; }

   private:
    Eigen::MatrixXd template_;
    double variance_ = 1.0;
  };

  /// Throws InvalidArgument for data that do not fit together.
  template <class = void>
  Model fit(const LabelledResponses& training) const {
    validate(training);
    return Model(training);
  }
};

static_assert(Decoder<NearestTemplate>);

}  // namespace lumo

// ---- lumo/sense/linear_decoder.hpp

namespace lumo {

namespace detail {

/// Covariance of residuals (features × observations) about means that took `parameters` degrees of freedom, shrunk towards a multiple of the identity;
/// a negative shrinkage asks for Ledoit and Wolf's and is replaced by it. `floor`: the least mean variance that is believed.
template <class MatrixXd = Eigen::MatrixXd>
inline Eigen::MatrixXd shrunk_covariance(In<MatrixXd> residual, Eigen::Index parameters, double& shrinkage, double floor = 1e-300) {
  const Eigen::Index d = residual.rows(), n = residual.cols();
  const MatrixXd s = residual * residual.transpose() / double(n);
  const double level = std::max(s.trace() / double(d), floor);
  const MatrixXd target = level * MatrixXd::Identity(d, d);
  if (shrinkage < 0.0) {
    double scatter = 0.0;
    for (Eigen::Index i = 0; i < n; ++i) scatter += (residual.col(i) * residual.col(i).transpose() - s).squaredNorm();
    const double far = (s - target).squaredNorm();
    shrinkage = far > 0.0 ? std::clamp(scatter / (double(n) * double(n)) / far, 0.0, 1.0) : 1.0;
  }
  const double left = double(std::max<Eigen::Index>(1, n - parameters)) / double(n);
  return ((1.0 - shrinkage) * s + (shrinkage + 1e-9) * target) / left;
}

}  // namespace detail

/// Regularised linear discriminant: Gaussians about the places' means with one covariance, shrunk towards a multiple of the identity because a
/// finger gives few re-contacts for many regions. Source: Friedman 1989; the shrinkage is Ledoit & Wolf's (2004) from the data, or given.
struct LinearDecoder {
  double shrinkage = -1.0;  ///< 0 … 1; negative: Ledoit and Wolf's

  class Model {
   public:
    template <class MatrixXd = Eigen::MatrixXd>
    Model(const LabelledResponses& t, double shrinkage) : mean_(detail::place_means(t)) {
      MatrixXd residual = t.response;
      for (Eigen::Index i = 0; i < residual.cols(); ++i) residual.col(i) -= mean_.col(t.place[std::size_t(i)]);
      const MatrixXd covariance = detail::shrunk_covariance(residual, t.places(), shrinkage, 1e-12 * mean_.cwiseAbs2().maxCoeff() + 1e-300);
      shrinkage_ = shrinkage;
      factor_.compute(covariance);
      weight_ = factor_.solve(mean_);
      offset_ = -0.5 * mean_.cwiseProduct(weight_).colwise().sum().transpose();
    }
    /// Throws InvalidArgument for another number of features.
    template <class VectorXd = Eigen::VectorXd>
    Decoding decode(In<VectorXd> response) const { return detail::decoding_of(log_likelihood(response)); }
    /// Of each place, up to one common constant.
    template <class VectorXd = Eigen::VectorXd>
    Eigen::VectorXd log_likelihood(In<VectorXd> response) const {
      if (response.size() != mean_.rows()) throw InvalidArgument(detail::text("response has ", response.size(), " features, the decoder ", mean_.rows()));
      return weight_.transpose() * response + offset_;
    }
    double shrinkage() const { return shrinkage_; }

   private:
    Eigen::MatrixXd mean_, weight_;
    Eigen::VectorXd offset_;
    Eigen::LLT<Eigen::MatrixXd> factor_;
    double shrinkage_ = 0.0;
  };

  /// Throws InvalidArgument for data that do not fit together.
  template <class = void>
  Model fit(const LabelledResponses& training) const {
    validate(training);
    require_in_range("shrinkage", shrinkage, -1e300, 1.0, "");
    return Model(training, shrinkage);
  }
};

static_assert(Decoder<LinearDecoder>);

}  // namespace lumo

// ---- lumo/sense/bayes_decoder.hpp

namespace lumo {

/// Bayes filter over the places: takes one response after the other and keeps the probability of each. The contact stays where it is but for a
/// `change` per step.
class PlaceFilter {
 public:
  /// Throws InvalidArgument for fewer than two places or a change that is no probability.
  template <class VectorXd = Eigen::VectorXd>
  explicit PlaceFilter(int places, double change = 0.0) : change_(change), probability_(VectorXd::Constant(std::max(places, 1), 1.0 / std::max(places, 1))) {
    require_in_range("number of places", places, 2, 1e6, "");
    require_in_range("change of place per step", change, 0.0, 1.0, "");
  }
  /// Takes the log likelihoods of the places (up to a constant) under the next response.
  template <class VectorXd = Eigen::VectorXd>
  const Eigen::VectorXd& update(In<VectorXd> log_likelihood) {
    const double n = double(probability_.size());
    probability_ = ((1.0 - change_) * probability_.array() + change_ / n).max(1e-300);
    probability_ = detail::decoding_of((probability_.array().log() + log_likelihood.array()).matrix()).probability;
    return probability_;
  }
  const Eigen::VectorXd& probability() const { return probability_; }

 private:
  double change_;
  Eigen::VectorXd probability_;
};

/// Decodes a contact from several steps of its loading: a response is `steps` blocks of features, one below the other, each with a linear
/// discriminant of its own, and the places' probabilities pass from step to step. With one step it is the linear decoder.
struct BayesDecoder {
  int steps = 1;
  double change = 0.0;  ///< of place from step to step
  LinearDecoder step = {};

  class Model {
   public:
    Model(std::vector<LinearDecoder::Model> steps, int places, double change) : steps_(std::move(steps)), places_(places), change_(change) {}
    /// Throws InvalidArgument for another number of features.
    template <class VectorXd = Eigen::VectorXd>
    Decoding decode(In<VectorXd> response) const {
      const auto n = Eigen::Index(steps_.size());
      if (response.size() % n != 0) throw InvalidArgument(detail::text("response has ", response.size(), " features, must be ", n, " steps of as many"));
      PlaceFilter filter(places_, change_);
      for (Eigen::Index k = 0; k < n; ++k) filter.update(steps_[std::size_t(k)].log_likelihood(response.segment(k * (response.size() / n), response.size() / n)));
      return detail::decoding_of(filter.probability().array().max(1e-300).log().matrix());
    }

   private:
    std::vector<LinearDecoder::Model> steps_;
    int places_;
    double change_;
  };

  /// Throws InvalidArgument for data that do not fit together, or features that are not `steps` blocks.
  template <class = void>
  Model fit(const LabelledResponses& training) const {
    validate(training);
    require_in_range("steps of the decoder", steps, 1, 1e6, "");
    if (training.response.rows() % steps != 0)
      throw InvalidArgument(detail::text("responses have ", training.response.rows(), " features, must be ", steps, " steps of as many"));
    std::vector<LinearDecoder::Model> models;
    const Eigen::Index rows = training.response.rows() / steps;
    for (int k = 0; k < steps; ++k) models.push_back(step.fit({training.response.middleRows(k * rows, rows), training.place, training.place_m}));
    return Model(std::move(models), training.places(), change);
  }
};

static_assert(Decoder<BayesDecoder>);

}  // namespace lumo

// ---- lumo/sense/cross_validation.hpp

namespace lumo {

/// What a decoder made of observations that it had not seen.
struct DecodingReport {
  struct Prediction {
    int observation = 0, fold = 0, place = 0, decoded = 0;
    double probability = 0.0;  ///< that the decoder gave to the place decoded
  };
  std::vector<Prediction> predictions;  ///< by observation
  Eigen::MatrixXi confusion;            ///< true place × decoded place
  Interval accuracy;                    ///< share of right ones, with Wilson's 95 % interval
  double mean_error_m = 0.0;            ///< mean distance between the places
  double log_score = 0.0;               ///< mean logarithm of the probability given to the true place, at least −700
};

/// Leaves out one fold after the other (the paper: one repetition of all places), fits on the others and decodes it. `fold[i]` of observation i.
/// Throws InvalidArgument for fewer than two folds, or when a place is only in one fold.
template <Decoder D>
DecodingReport cross_validate(const D& decoder, const LabelledResponses& data, const std::vector<int>& fold) {
  validate(data);
  if (fold.size() != data.place.size()) throw InvalidArgument(detail::text("cross-validation: ", data.place.size(), " observations and ", fold.size(), " folds"));
  const std::set<int> folds(fold.begin(), fold.end());
  if (folds.size() < 2) throw InvalidArgument("cross-validation needs at least 2 folds");
  DecodingReport report;
  report.confusion = Eigen::MatrixXi::Zero(data.places(), data.places());
  report.predictions.resize(data.place.size());
  int right = 0;
  for (const int out : folds) {
    std::vector<Eigen::Index> kept;
    for (std::size_t i = 0; i < fold.size(); ++i)
      if (fold[i] != out) kept.push_back(Eigen::Index(i));
    LabelledResponses training{data.response(Eigen::all, kept), {}, data.place_m};
    for (const Eigen::Index i : kept) training.place.push_back(data.place[std::size_t(i)]);
    const auto model = decoder.fit(training);
    for (std::size_t i = 0; i < fold.size(); ++i) {
      if (fold[i] != out) continue;
      const Decoding d = model.decode(data.response.col(Eigen::Index(i)));
      const int place = data.place[i];
      report.predictions[i] = {int(i), out, place, d.place, d.probability[d.place]};
      ++report.confusion(place, d.place);
      right += d.place == place;
      report.mean_error_m += std::abs(data.place_m[d.place] - data.place_m[place]) / double(fold.size());
      report.log_score += std::max(std::log(std::max(d.probability[place], 1e-305)), -700.0) / double(fold.size());
    }
  }
  report.accuracy = wilson_interval(right, int(fold.size()));
  return report;
}

}  // namespace lumo

// ---- lumo/sense/constraint_gain.hpp

namespace lumo {

/// Finds when a force sensor first feels the contact.
struct OnsetDetector {
  int baseline = 20;        ///< samples at the start that are without contact
  double threshold = 5.0;   ///< standard deviations of the baseline
  double min_force_N = 0.05;  ///< above the baseline's mean, however quiet it was
  int hold = 3;             ///< samples in a row that must lie above
  int fit = 5;              ///< samples from the crossing on, through which a line goes back to the baseline; 0: take the crossing itself

  /// Place of the onset in samples (fractional), and the force's baseline there.
  struct Onset {
    double sample = 0.0;
    double baseline_N = 0.0;
  };
  /// Nothing when the force stays below the threshold. Throws InvalidArgument for too few samples or forces that are not finite.
  std::optional<Onset> find(std::span<const double> force_N) const;
};

inline std::optional<OnsetDetector::Onset> OnsetDetector::find(std::span<const double> force_N) const {
  require_in_range("samples without contact", baseline, 2, 1e9, "");
  require_in_range("samples above the threshold", hold, 1, 1e6, "");
  require_in_range("threshold of the onset", threshold, 0.0, 1e6, "standard deviations");
  require_in_range("least force of the onset", min_force_N, 0.0, 1e6, "N");
  require_in_range("samples of the onset's line", fit, 0, 1e6, "");
  const auto n = std::ptrdiff_t(force_N.size());
  if (n <= baseline) throw InvalidArgument(detail::text("onset: ", n, " forces, must have more than the ", baseline, " without contact"));
  for (const double f : force_N)
    if (!std::isfinite(f)) throw InvalidArgument("onset: forces must be finite");
  double mean = 0.0, squares = 0.0;
  for (int i = 0; i < baseline; ++i) mean += force_N[std::size_t(i)] / baseline;
  for (int i = 0; i < baseline; ++i) squares += std::pow(force_N[std::size_t(i)] - mean, 2);
  const double limit = mean + std::max(threshold * std::sqrt(squares / (baseline - 1)), min_force_N);
  int above = 0;
  for (std::ptrdiff_t i = baseline; i < n; ++i) {
    above = force_N[std::size_t(i)] > limit ? above + 1 : 0;
    if (above < hold) continue;
    const double first = double(i - hold + 1);
    // The force has risen before it crosses: a line through the next samples goes back to where it left the baseline.
    double si = 0.0, sf = 0.0, sii = 0.0, sif = 0.0;
    int count = 0;
    for (auto k = std::ptrdiff_t(first); k < n && count < fit; ++k, ++count) {
      const double t = double(k) - first, f = force_N[std::size_t(k)] - mean;
      si += t, sf += f, sii += t * t, sif += t * f;
    }
    const double det = count * sii - si * si, slope = det > 0.0 ? (count * sif - si * sf) / det : 0.0;
    if (!(slope > 0.0)) return Onset{first, mean};
    const double at = (sf - slope * si) / count;  // of the line, at the crossing
    return Onset{std::clamp(first - at / slope, double(baseline - 1), first), mean};
  }
  return std::nullopt;
}

/// How far the marker on the indenter goes from contact onset until the force (above its baseline) first reaches `force_N`, interpolated linearly [m].
/// Nothing when there is no onset or the force is not reached. Both series at the same times.
inline std::optional<double> displacement_from_onset(std::span<const double> force, std::span<const double> marker_m, double force_N, const OnsetDetector& detector = {}) {
  if (force.size() != marker_m.size()) throw InvalidArgument(detail::text("displacement: ", force.size(), " forces and ", marker_m.size(), " marker places, must be as many"));
  require_positive("force to reach", force_N, "N");
  for (const double x : marker_m)
    if (!std::isfinite(x)) throw InvalidArgument("displacement: marker places must be finite");
  const auto onset = detector.find(force);
  if (!onset) return std::nullopt;
  const auto marker_at = [&](double sample) {
    const auto i = std::min(std::size_t(sample), marker_m.size() - 1), j = std::min(i + 1, marker_m.size() - 1);
    return marker_m[i] + (sample - double(i)) * (marker_m[j] - marker_m[i]);
  };
  const double target = onset->baseline_N + force_N;
  for (auto i = std::size_t(std::floor(onset->sample)) + 1; i < force.size(); ++i)
    if (force[i] >= target) {
      const double before = force[i - 1], step = force[i] - before;
      const double reached = before >= target || !(step > 0.0) ? double(i - 1) : double(i - 1) + (target - before) / step;
      return std::abs(marker_at(reached) - marker_at(onset->sample));
    }
  return std::nullopt;
}

/// Progressive-Constraint Gain [%]: by how much less the indenter sinks in from onset to the load than into the baseline (paper, contact cycling).
inline double progressive_constraint_gain_percent(double displacement_m, double baseline_m) {
  require_positive("baseline's displacement", baseline_m, "m");
  require_in_range("displacement", displacement_m, 0.0, 1e3, "m");
  return 100.0 * (1.0 - displacement_m / baseline_m);
}

}  // namespace lumo

// ---- lumo/sense/location_estimator.hpp

namespace lumo {

/// Where the finger is touched, and how sure that is.
struct ContactLocation {
  double y_m = 0.0;
  double variance_m2 = 0.0;  ///< of all errors
  double amplitude = 0.0;    ///< of the response there, in the readout's unit
  double bias_variance_m2 = 0.0;   ///< what of it stays the same from profile to profile
  double noise_variance_m2 = 0.0;  ///< of what this profile adds to its predecessors, without bias: for a filter that takes estimates as independent
};

/// Throws InvalidArgument unless positions of a profile are finite and ascend.
inline void require_ascending_positions(const Eigen::VectorXd& position_m) {
  for (Eigen::Index i = 0; i < position_m.size(); ++i) {
    require_in_range("position of a profile's value", position_m[i], -10.0, 10.0, "m");
    if (i > 0 && !(position_m[i] > position_m[i - 1]))
      throw InvalidArgument(detail::text("position ", i, " of a profile is ", position_m[i], " m, must exceed its predecessor, ", position_m[i - 1], " m"));
  }
}

/// What one profile (and those before it) says about contacts. Always finite.
struct LocationEstimate {
  std::int64_t stamp_ns = 0;
  int contacts = 0;                        ///< 0, 1 or 2
  std::array<ContactLocation, 2> contact;  ///< the first `contacts` count, the stronger one first
  double probability = 1.0;                ///< of this number of contacts, as far as the model tells
};

/// Locates contacts from responses: profiles minus the unloaded reference.
/// Laws: causal, what it says depends on this and earlier responses only; finite for finite responses; one that is not newer than its predecessor
/// changes nothing but the answer's stamp; after `reset` it is as new.
template <class L>
concept LocationEstimator = requires(L& localizer, const Profile& response) {
  { localizer.update(response) } -> std::same_as<LocationEstimate>;
  localizer.reset();
};

}  // namespace lumo

// ---- lumo/sense/peak_localizer.hpp

namespace lumo {

/// The paper's localiser: the strongest peak of the low-passed response above a noise threshold. No labels, no training.
/// A contact starts above `threshold` noises and ends below `release`. The filter is first order in time and starts anew after a gap.
class PeakLocalizer {
 public:
  struct Config {
    Eigen::VectorXd position_m;      ///< of the profile's values
    Eigen::VectorXd noise;           ///< standard deviation of each, unloaded
    double time_constant_s = 0.05;   ///< of the filter
    double gap_s = 0.5;              ///< longer without a profile: forget
    double threshold = 6.0;          ///< in noises of the filtered profile
    double release = 4.0;
    double bias_sigma_m = 1.0_mm;    ///< how far the brightest place is believed to lie from the contact; assumed
  };

  /// Throws InvalidArgument for lengths that differ or numbers that make no sense.
  explicit PeakLocalizer(Config config) : config_(std::move(config)) {
    const Eigen::Index n = config_.position_m.size();
    if (n < 3 || config_.noise.size() != n)
      throw InvalidArgument(detail::text("localiser has ", n, " positions and ", config_.noise.size(), " noises, must have at least 3 of each"));
    for (Eigen::Index i = 0; i < n; ++i) require_positive("noise of a profile's value", config_.noise[i], "");
    require_ascending_positions(config_.position_m);
    require_positive("time constant of the localiser", config_.time_constant_s, "s");
    require_positive("gap of the localiser", config_.gap_s, "s");
    require_in_range("release threshold", config_.release, 0.0, config_.threshold, "noises");
    require_in_range("bias of the peak", config_.bias_sigma_m, 0.0, 1.0, "m");
    reset();
  }

  void reset() { fresh_ = true, touching_ = false, share_ = 1.0; }

  template <class = void>
  LocationEstimate update(const Profile& response) {
    if (response.value.size() != config_.position_m.size())
      throw InvalidArgument(detail::text("response has ", response.value.size(), " values, the localiser ", config_.position_m.size()));
    const double step_s = 1e-9 * double(response.stamp_ns - stamp_ns_);
    if (!fresh_ && step_s <= 0.0) return answer(response.stamp_ns);
    if (fresh_ || step_s > config_.gap_s) {
      filtered_ = response.value;
      share_ = 1.0;
      fresh_ = touching_ = false;
    } else {
      const double weight = -std::expm1(-step_s / config_.time_constant_s);
      filtered_ += weight * (response.value - filtered_);
      share_ = (1.0 - weight) * (1.0 - weight) * share_ + weight * weight;  // of the white noise's variance
    }
    stamp_ns_ = response.stamp_ns;
    return answer(stamp_ns_);
  }

 private:
  template <class = void>
  LocationEstimate answer(std::int64_t stamp_ns) {
    LocationEstimate e{stamp_ns, 0, {}, 1.0};
    if (fresh_) return e;
    Eigen::Index top = 0;
    filtered_.maxCoeff(&top);
    const double sigma = config_.noise[top] * std::sqrt(share_), peak = filtered_[top];
    touching_ = peak > (touching_ ? config_.release : config_.threshold) * sigma;
    if (!touching_) return e;
    e.contacts = 1;
    e.contact[0] = vertex(top, sigma);
    return e;
  }

  /// The parabola through the peak and its neighbours; at the ends of the profile, the end itself.
  ContactLocation vertex(Eigen::Index top, double sigma) const {
    const auto& x = config_.position_m;
    const double bias2 = config_.bias_sigma_m * config_.bias_sigma_m, peak = filtered_[top];
    const double width = top == 0 ? x[1] - x[0] : x[top] - x[top - 1];
    const auto at = [&](double y, double variance) { return ContactLocation{y, variance + bias2, peak, bias2, variance / share_}; };  // white noise: of one profile
    if (top == 0 || top + 1 == x.size()) return at(x[top], width * width / 3.0);
    const double left = x[top - 1] - x[top], right = x[top + 1] - x[top];
    const double a = (filtered_[top - 1] - peak) / left, b = (filtered_[top + 1] - peak) / right;
    const double curvature = (b - a) / (right - left);  // ≤ 0 at a peak
    if (!(curvature < 0.0)) return at(x[top], width * width / 12.0);
    const double slope = a - curvature * left;  // at the peak's own place
    const double y = std::clamp(-0.5 * slope / curvature, 0.5 * left, 0.5 * right);
    // Noise moves the vertex by its error of the slope over the curvature; beyond the bin, by no more than the bin tells.
    const double slope_sigma = sigma * std::sqrt(2.0) / (right - left);
    const double moved = std::min(0.5 * slope_sigma / -curvature, 0.5 * (right - left));
    return at(x[top] + y, moved * moved);
  }

  Config config_;
  Eigen::VectorXd filtered_;
  std::int64_t stamp_ns_ = 0;
  double share_ = 1.0;
  bool fresh_ = true, touching_ = false;
};

static_assert(LocationEstimator<PeakLocalizer>);

}  // namespace lumo

// ---- lumo/sense/grid_moments.hpp

namespace lumo::detail {

/// Mean and variance of a distribution over places, and the number of its most probable one.
struct GridMoments {
  double mean, variance;
  Eigen::Index mode;
};

/// About the mode: a part below 10⁻⁴ of it, as new contacts that may be anywhere leave it, does not count. As many weights as places, one of them positive.
template <class VectorXd = Eigen::VectorXd>
inline GridMoments moments_about_mode(In<VectorXd> place, In<VectorXd> weight) {
  GridMoments m{0.0, 0.0, 0};
  const double most = weight.maxCoeff(&m.mode);
  double sum = 0.0, first = 0.0, second = 0.0;
  for (Eigen::Index j = 0; j < weight.size(); ++j) {
    const double w = weight[j] > 1e-4 * most ? weight[j] : 0.0, d = place[j] - place[m.mode];
    sum += w, first += w * d, second += w * d * d;
  }
  m.mean = place[m.mode] + first / sum;
  m.variance = std::max(second / sum - first * first / (sum * sum), 0.0);
  return m;
}

}  // namespace lumo::detail

// ---- lumo/sense/bayes_localizer.hpp

namespace lumo {

/// Filter over the number of contacts (none, one, two) and, for one, over its place on a grid. A contact is taken as a bright bump of unknown height
/// and one of a few widths on top of what is not contact: noise, and slow changes of the lamps and of ambient light, which are integrated out.
/// No labels, no training. How far a real bump is from the assumed shape is said by `shape_error` and `bias_sigma_m`.
class BayesLocalizer {
 public:
  struct Config {
    Eigen::VectorXd position_m;   ///< of the profile's values
    Eigen::VectorXd noise;        ///< standard deviation of each, unloaded
    Eigen::VectorXd unloaded;     ///< mean profile of the unloaded finger; empty: lamps are steady
    double lamp_sigma = 0.01;     ///< relative change of all lamps together; assumed
    double ambient_sigma = 0.3;   ///< change of ambient light, in the profile's unit; assumed
    double from_m = -30.0_mm, to_m = 30.0_mm, spacing_m = 0.5_mm;  ///< grid
    std::array<double, 4> width_m{3.0_mm, 4.0_mm, 5.5_mm, 8.0_mm};        ///< standard deviations of bumps
    double amplitude_sigma = 50.0;  ///< prior of a bump's height, half normal, in the profile's unit
    double shape_error = 0.05;      ///< of the assumed bump, relative to the response; counts as noise
    double bias_sigma_m = 0.5_mm;   ///< how far the bump's middle is believed to lie from the contact; assumed
    double min_separation_m = 12.0_mm;  ///< of two contacts
    double min_share = 0.2;             ///< of the stronger contact's height that the weaker one must have: less may be the bump's own shape
    double change_rate_per_s = 2.0;     ///< how often contacts come and go
    double creep_m_per_sqrt_s = 1.0_mm;  ///< random walk of a contact that stays
    double gap_s = 0.5;                  ///< longer without a profile: forget
  };

  /// Throws InvalidArgument for lengths that differ or numbers that make no sense.
  template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
  explicit BayesLocalizer(Config config);

  void reset() { fresh_ = true; }
  template <class VectorXd = Eigen::VectorXd, class Vector3d = Eigen::Vector3d>
  LocationEstimate update(const Profile& response);

  const Eigen::VectorXd& grid_m() const { return grid_; }
  /// Posterior of the place given one contact; sums to 1.
  const Eigen::VectorXd& place() const { return place_; }
  /// Posterior of none, one, two contacts.
  const Eigen::Vector3d& number() const { return number_; }

 private:
  static constexpr Eigen::Index widths = 4;
  static constexpr double most_cells = 1024.0;  ///< pairs of places are looked up in tables of cells²

  /// Two bumps of one width, the higher one first.
  struct Pair {
    Eigen::Index first = 0, second = 0, width = 0;
    double explained = -1.0;  ///< by how much they lower χ²; −1: there is no such pair
  };

  double log_evidence(double s, double g, double tempering) const;
  double log_evidence(const Pair& pair, double tempering) const;
  Pair best_pair(double tempering) const;
  template <class VectorXd = Eigen::VectorXd>
  bool dips_between(In<VectorXd> response, const Pair& pair) const;
  std::array<double, 2> heights(const Pair& pair, double tempering, double& det) const;
  template <class Vector3d = Eigen::Vector3d>
  void predict(double step_s);
  template <class = void>
  ContactLocation one() const;
  template <class = void>
  LocationEstimate answer(std::int64_t stamp_ns) const;

  Config config_;
  Eigen::VectorXd grid_;
  Eigen::MatrixXd bumps_;      ///< profile × (grid · widths): the width varies slowest
  Eigen::MatrixXd matched_;    ///< Σ⁻¹ bumps
  Eigen::MatrixXd precision_;  ///< Σ⁻¹ of the profile
  std::array<Eigen::MatrixXd, 4> gram_;  ///< bumpsᵀ Σ⁻¹ bumps of each width
  Eigen::VectorXd energy_;     ///< diagonal of it, all widths
  Eigen::VectorXd score_, place_, likelihood_, spread_, expected_;  ///< expected_: place_ before the newest profile
  Eigen::Vector3d number_{1.0, 0.0, 0.0};
  Pair pair_;
  std::int64_t stamp_ns_ = 0;
  bool fresh_ = true;
};

template <class MatrixXd, class VectorXd>
inline BayesLocalizer::BayesLocalizer(Config config) : config_(std::move(config)) {
  const Eigen::Index n = config_.position_m.size();
  if (n < 3 || config_.noise.size() != n || (config_.unloaded.size() != 0 && config_.unloaded.size() != n))
    throw InvalidArgument(detail::text("localiser has ", n, " positions, ", config_.noise.size(), " noises and ", config_.unloaded.size(),
        " unloaded values, must have as many, at least 3"));
  for (Eigen::Index i = 0; i < n; ++i) require_positive("noise of a profile's value", config_.noise[i], "");
  require_ascending_positions(config_.position_m);
  if (config_.unloaded.size() && !config_.unloaded.allFinite()) throw InvalidArgument("localiser: unloaded values must be finite");
  require_in_range("relative change of the lamps", config_.lamp_sigma, 0.0, 1e3, "");
  require_in_range("change of ambient light", config_.ambient_sigma, 0.0, 1e6, "");
  require_positive("grid spacing", config_.spacing_m, "m");
  require_in_range("grid's start", config_.from_m, -10.0, 10.0, "m");
  require_in_range("grid's end", config_.to_m, config_.from_m + 2.0 * config_.spacing_m, config_.from_m + most_cells * config_.spacing_m, "m");
  for (const double w : config_.width_m) require_positive("width of a bump", w, "m");
  require_positive("height of a bump", config_.amplitude_sigma, "");
  require_in_range("shape error", config_.shape_error, 0.0, 1.0, "");
  require_in_range("share of the weaker contact", config_.min_share, 0.0, 1.0, "");
  require_positive("rate of change of contacts", config_.change_rate_per_s, "1/s");
  require_in_range("bias of a bump", config_.bias_sigma_m, 0.0, 1.0, "m");
  require_in_range("separation of two contacts", config_.min_separation_m, 0.0, 10.0, "m");
  require_in_range("creep of a contact", config_.creep_m_per_sqrt_s, 0.0, 10.0, "m/sqrt(s)");
  require_positive("gap of the localiser", config_.gap_s, "s");

  const auto cells = Eigen::Index(std::floor((config_.to_m - config_.from_m) / config_.spacing_m + 0.5)) + 1;
  grid_ = VectorXd::LinSpaced(cells, config_.from_m, config_.to_m);
  MatrixXd covariance = config_.noise.cwiseAbs2().asDiagonal();
  covariance.array() += config_.ambient_sigma * config_.ambient_sigma;
  if (config_.unloaded.size()) covariance += config_.lamp_sigma * config_.lamp_sigma * config_.unloaded * config_.unloaded.transpose();
  precision_ = covariance.llt().solve(MatrixXd::Identity(n, n));
  bumps_.resize(n, cells * widths);
  for (Eigen::Index w = 0; w < widths; ++w)
    for (Eigen::Index j = 0; j < cells; ++j)
      bumps_.col(w * cells + j) = (-0.5 * ((config_.position_m.array() - grid_[j]) / config_.width_m[std::size_t(w)]).square()).exp();
  matched_ = precision_ * bumps_;
  energy_ = bumps_.cwiseProduct(matched_).colwise().sum().transpose();
  for (Eigen::Index w = 0; w < widths; ++w) gram_[std::size_t(w)] = bumps_.middleCols(w * cells, cells).transpose() * matched_.middleCols(w * cells, cells);
  place_ = VectorXd::Constant(cells, 1.0 / double(cells));
  likelihood_ = spread_ = expected_ = place_;
  score_.resize(bumps_.cols());
}

/// Log of the Bayes factor of a bump with matched score s and energy g against none; its height is half normal and integrated out.
inline double BayesLocalizer::log_evidence(double s, double g, double tempering) const {
  const double prior = 1.0 / (config_.amplitude_sigma * config_.amplitude_sigma), h = g * tempering + prior, t = s * tempering;
  const double z = t / std::sqrt(h);
  // log of 2 Φ(z) e^{z²/2}, without overflow on either side
  const double tail = z > -6.0 ? 0.5 * z * z + std::log(std::erfc(-0.70710678118654752440 * z)) : std::log(0.79788456080286535588 / -z) - 1.0 / (z * z);
  return tail + 0.5 * std::log(prior / h);
}

/// Heights of the two bumps under the prior's ridge, the first's first; `det` of the two equations.
inline std::array<double, 2> BayesLocalizer::heights(const Pair& p, double tempering, double& det) const {
  const Eigen::MatrixXd& gram = gram_[std::size_t(p.width)];
  const double prior = 1.0 / (config_.amplitude_sigma * config_.amplitude_sigma);
  const double a = tempering * gram(p.first, p.first) + prior, b = tempering * gram(p.second, p.second) + prior, c = tempering * gram(p.first, p.second);
  const double s = tempering * score_[p.width * grid_.size() + p.first], t = tempering * score_[p.width * grid_.size() + p.second];
  det = a * b - c * c;
  return {(b * s - c * t) / det, (a * t - c * s) / det};
}

/// Searched on every other cell, then about the best.
inline BayesLocalizer::Pair BayesLocalizer::best_pair(double tempering) const {
  const Eigen::Index cells = grid_.size();
  const double prior = 1.0 / (config_.amplitude_sigma * config_.amplitude_sigma);
  const auto apart = std::max<Eigen::Index>(1, Eigen::Index(std::ceil(config_.min_separation_m / config_.spacing_m - 1e-9)));
  Pair best;
  const auto look = [&](Eigen::Index width, Eigen::Index i, Eigen::Index j) {
    const Eigen::MatrixXd& gram = gram_[std::size_t(width)];
    const double a = tempering * gram(i, i) + prior, b = tempering * gram(j, j) + prior, c = tempering * gram(j, i);
    const double s = tempering * score_[width * cells + i], t = tempering * score_[width * cells + j];
    const double hi = b * s - c * t, hj = a * t - c * s;  // heights times the determinant
    if (!(std::min(hi, hj) > config_.min_share * std::max(hi, hj))) return;
    const double explained = (s * hi + t * hj) / (a * b - c * c);
    if (explained > best.explained) best = {hi >= hj ? i : j, hi >= hj ? j : i, width, explained};
  };
  for (Eigen::Index width = 0; width < widths; ++width)
    for (Eigen::Index i = 0; i < cells; i += 2)
      for (Eigen::Index j = i + apart; j < cells; j += 2) look(width, i, j);
  if (best.explained < 0.0) return best;
  const Eigen::Index i = std::min(best.first, best.second), j = std::max(best.first, best.second);
  for (Eigen::Index k = std::max<Eigen::Index>(0, i - 1); k <= i + 1; ++k)
    for (Eigen::Index l = std::max(j - 1, k + apart); l <= std::min(cells - 1, j + 1); ++l) look(best.width, k, l);
  return best;
}

/// Two contacts must show as two peaks, so that two within about three bump widths count as one: a bump whose shape is not quite the assumed one, and changes
/// of the lamps, are else taken for a second one.
template <class VectorXd>
inline bool BayesLocalizer::dips_between(In<VectorXd> response, const Pair& pair) const {
  const auto index = [&](Eigen::Index cell) {
    Eigen::Index i = 0;
    (config_.position_m.array() - grid_[cell]).abs().minCoeff(&i);
    return i;
  };
  double det = 1.0;
  const Eigen::Index a = index(pair.first), b = index(pair.second);
  const double least = response.segment(std::min(a, b), std::abs(a - b) + 1).minCoeff();
  return response[b] - least > 0.25 * heights(pair, 1.0, det)[1];
}

/// Log of the Bayes factor of two bumps against none.
inline double BayesLocalizer::log_evidence(const Pair& p, double tempering) const {
  if (p.explained < 0.0) return -1e300;
  double det = 1.0;
  const auto h = heights(p, tempering, det);
  const double prior = 1.0 / (config_.amplitude_sigma * config_.amplitude_sigma), cells = double(grid_.size());
  const double fit = 0.5 * tempering * (score_[p.width * grid_.size() + p.first] * h[0] + score_[p.width * grid_.size() + p.second] * h[1]);
  // The sum over pairs is replaced by the best one times the cells that it stands for (Laplace): √(2π) times a bump's error of place, width/√L of the log
  // likelihood L = fit/2 that it explains, for L falls off as L (1 − d²/(2 width²)) does when the bump is moved by d.
  const double width = config_.width_m[std::size_t(p.width)];
  const double sharp = std::max(1.0, 2.5066282746310002 * width / std::sqrt(std::max(0.5 * fit, 1.0)) / config_.spacing_m);
  const double apart = config_.min_separation_m / config_.spacing_m, pairs = 0.5 * (cells - apart) * (cells - apart + 1.0);
  return fit + 0.5 * std::log(prior * prior / det) + std::log(4.0) + 2.0 * std::log(sharp) - std::log(std::max(pairs, 1.0)) - std::log(double(widths));
}

template <class Vector3d>
inline void BayesLocalizer::predict(double step_s) {
  const double change = -std::expm1(-config_.change_rate_per_s * step_s);
  number_ = (1.0 - change) * number_ + Vector3d::Constant(change / 3.0);
  // A contact that stays creeps; one that is new may be anywhere.
  const double walk = config_.creep_m_per_sqrt_s * std::sqrt(step_s) / config_.spacing_m, cells = double(place_.size());
  // A Gaussian narrower than a cell loses its variance when it is sampled; a step to either side keeps it.
  const bool narrow = walk <= 1.0;
  const auto reach = std::min<Eigen::Index>(place_.size() - 1, narrow ? 1 : Eigen::Index(std::ceil(4.0 * walk)));
  spread_.setZero();
  double whole = 0.0;
  for (Eigen::Index k = -reach; k <= reach; ++k) {
    const double w = !narrow ? std::exp(-0.5 * double(k * k) / (walk * walk)) : k == 0 ? 1.0 - walk * walk : 0.5 * walk * walk;
    whole += w;
    const Eigen::Index n = place_.size() - std::abs(k);
    spread_.segment(std::max<Eigen::Index>(k, 0), n) += w * place_.segment(std::max<Eigen::Index>(-k, 0), n);
  }
  place_ = (1.0 - change) / whole * spread_;
  place_.array() += (1.0 - place_.sum()) / cells;
}

template <class VectorXd, class Vector3d>
inline LocationEstimate BayesLocalizer::update(const Profile& response) {
  if (response.value.size() != config_.position_m.size())
    throw InvalidArgument(detail::text("response has ", response.value.size(), " values, the localiser ", config_.position_m.size()));
  const double step_s = 1e-9 * double(response.stamp_ns - stamp_ns_);
  if (!fresh_ && step_s <= 0.0) return answer(response.stamp_ns);
  const Eigen::Index cells = grid_.size();
  if (fresh_ || step_s > config_.gap_s) {
    number_ = Vector3d(1.0, 1.0, 1.0) / 3.0;
    place_.setConstant(1.0 / double(cells));
    fresh_ = false;
  } else {
    predict(step_s);
  }
  stamp_ns_ = response.stamp_ns;
  expected_ = place_;

  score_.noalias() = matched_.transpose() * response.value;
  // The error of the assumed shape grows with the response; it makes all that is seen less certain by one factor.
  const double typical = config_.noise.mean(), shape = config_.shape_error * response.value.cwiseAbs().maxCoeff();
  double tempering = typical * typical / (typical * typical + shape * shape);

  // Best of one and of two bumps; where even that leaves more than noise, what is seen is no sum of such bumps, and noise stands for it (Birge).
  const double explained = (score_.cwiseMax(0.0).cwiseAbs2().cwiseQuotient(energy_)).maxCoeff();
  pair_ = best_pair(tempering);
  if (pair_.explained > 0.0 && !dips_between(response.value, pair_)) pair_.explained = -1.0;
  const double chi2 = response.value.dot(precision_ * response.value), freedom = double(std::max<Eigen::Index>(1, response.value.size() - 4));
  const double left = chi2 - std::max(explained, pair_.explained / tempering);
  if (left > freedom + 3.0 * std::sqrt(2.0 * freedom)) tempering = std::min(tempering, freedom / left);  // more than noise alone does

  double top = -1e300;
  for (Eigen::Index j = 0; j < cells; ++j) {
    std::array<double, std::size_t(widths)> e{};
    for (std::size_t w = 0; w < e.size(); ++w) {
      const Eigen::Index k = Eigen::Index(w) * cells + j;
      e[w] = log_evidence(score_[k], energy_[k], tempering);
    }
    const double most = *std::max_element(e.begin(), e.end());
    double sum = 0.0;
    for (const double v : e) sum += std::exp(v - most);
    likelihood_[j] = most + std::log(sum / double(widths));
    top = std::max(top, likelihood_[j]);
  }
  likelihood_ = (likelihood_.array() - top).exp();
  const double log_one = top + std::log(std::max(likelihood_.mean(), 1e-300));
  place_ = place_.cwiseProduct(likelihood_);
  const double sum = place_.sum();
  place_ = sum > 0.0 ? VectorXd(place_ / sum) : VectorXd(likelihood_ / likelihood_.sum());

  const double log_two = log_evidence(pair_, tempering);
  const double highest = std::max({0.0, log_one, log_two});
  number_ = number_.cwiseProduct(Vector3d(std::exp(-highest), std::exp(log_one - highest), std::exp(log_two - highest)));
  number_ = number_.cwiseMax(1e-12);
  number_ /= number_.sum();
  return answer(stamp_ns_);
}

template <class>
inline ContactLocation BayesLocalizer::one() const {
  const detail::GridMoments now = detail::moments_about_mode(grid_, place_), before = detail::moments_about_mode(grid_, expected_);
  const double cell2 = config_.spacing_m * config_.spacing_m / 12.0, bias2 = config_.bias_sigma_m * config_.bias_sigma_m;
  // What was known before is taken off again: 1/noise = 1/posterior − 1/prior. A profile that tells little has a large noise; one that tells of another place owes
  // nothing to what was known.
  const double posterior = now.variance + cell2, prior = before.variance + cell2, moved = now.mean - before.mean;
  const double noise = moved * moved > 9.0 * (prior + posterior) ? posterior : posterior * prior / std::max(prior - posterior, 1e-3 * prior);
  const Eigen::Index k = grid_.size() + now.mode;  // of the second width, a middling one
  return {now.mean, posterior + bias2, std::max(0.0, score_[k] / energy_[k]), bias2, noise};
}

template <class>
inline LocationEstimate BayesLocalizer::answer(std::int64_t stamp_ns) const {
  LocationEstimate e{stamp_ns, 0, {}, 1.0};
  if (fresh_) return e;
  Eigen::Index n = 0;
  e.probability = number_.maxCoeff(&n);
  e.contacts = int(n);
  if (n == 1) e.contact[0] = one();
  if (n == 2) {
    double det = 1.0;
    const auto h = heights(pair_, 1.0, det);
    // Each bends the other. Places of pairs are not followed in time.
    const double cell2 = config_.spacing_m * config_.spacing_m / 12.0, bias2 = 4.0 * config_.bias_sigma_m * config_.bias_sigma_m;
    e.contact[0] = {grid_[pair_.first], cell2 + bias2, std::max(0.0, h[0]), bias2, cell2};
    e.contact[1] = {grid_[pair_.second], cell2 + bias2, std::max(0.0, h[1]), bias2, cell2};
  }
  return e;
}

static_assert(LocationEstimator<BayesLocalizer>);

}  // namespace lumo

// ---- lumo/sense/contact_jacobian.hpp

namespace lumo {

/// A place on the pad of one of the links.
struct ContactPoint {
  int link = 0;      ///< counted from the base; the link after joint `link`
  double y_m = 0.0;  ///< finger coordinate on it
};

/// How a normal force on a pad shows in the motors. The force is that of the object on the finger, against the pad's outward normal, at the
/// contact point; `column` is the torque that the motors add to hold it, n × 1 [N·m per N = m], positive along each joint's axis.
/// Laws: joints beyond the contact's link carry nothing; `slope` is the derivative of `column` by y_m.
template <class J>
concept ContactJacobian = requires(const J& j, const JointVector& q, const ContactPoint& c) {
  { j.joints() } -> std::convertible_to<int>;
  { j.column(q, c) } -> std::same_as<JointVector>;
  { j.slope(q, c) } -> std::same_as<JointVector>;
};

/// Torques of unit normal forces at several contacts, joints × contacts [m].
template <ContactJacobian J>
Eigen::MatrixXd contact_columns(const J& jacobian, const JointVector& q, std::span<const ContactPoint> contacts) {
  Eigen::MatrixXd a(jacobian.joints(), Eigen::Index(contacts.size()));
  for (std::size_t i = 0; i < contacts.size(); ++i) a.col(Eigen::Index(i)) = jacobian.column(q, contacts[i]);
  return a;
}

}  // namespace lumo

// ---- lumo/sense/serial_chain.hpp

namespace lumo {

/// Revolute joints in a row, each with one link that may carry a pad.
class SerialChain {
 public:
  struct Link {
    Eigen::Isometry3d joint = Eigen::Isometry3d::Identity();  ///< pose of the joint's frame in the frame of the link before (or the base), at angle 0
    Vec3 axis = Vec3::UnitX();                                ///< of rotation, in the joint's frame; unit
    Eigen::Isometry3d finger = Eigen::Isometry3d::Identity();  ///< pose of the pad's finger frame (y along it, z out of it) in the joint's frame
  };

  /// Throws InvalidArgument for no or too many links, or numbers that make no sense.
  template <class Mat3 = Mat3, class Isometry3d = Eigen::Isometry3d>
  explicit SerialChain(std::vector<Link> links) : links_(std::move(links)) {
    if (links_.empty() || links_.size() > std::size_t(max_joints))
      throw InvalidArgument(detail::text("serial chain has ", links_.size(), " links, must have 1 to ", max_joints));
    for (Link& l : links_) {
      if (!l.joint.matrix().allFinite() || !l.finger.matrix().allFinite()) throw InvalidArgument("serial chain: poses must be finite");
      for (const Isometry3d& pose : {l.joint, l.finger})
        if ((pose.linear().transpose() * pose.linear() - Mat3::Identity()).norm() > 1e-6 || pose.linear().determinant() < 0.0)
          throw InvalidArgument("serial chain: poses must turn and move, not stretch or mirror");
      require_positive("length of a joint's axis", l.axis.norm(), "");
      l.axis.normalize();
    }
  }

  int joints() const { return int(links_.size()); }

  template <class Vec3 = Vec3>
  JointVector column(const JointVector& q, const ContactPoint& c) const {
    const Pose p = pose(q, c.link);
    return torques(p, p.finger * Vec3(0.0, c.y_m, 0.0), p.finger.linear().col(2), true);
  }
  template <class = void>
  JointVector slope(const JointVector& q, const ContactPoint& c) const {
    const Pose p = pose(q, c.link);
    return torques(p, p.finger.linear().col(1), p.finger.linear().col(2), false);
  }
  /// Where the contact is, in the base's frame [m].
  template <class Vec3 = Vec3>
  Vec3 position(const JointVector& q, const ContactPoint& c) const { return pose(q, c.link).finger * Vec3(0.0, c.y_m, 0.0); }
  /// Outward normal of the pad there, in the base's frame.
  template <class Vec3 = Vec3>
  Vec3 normal(const JointVector& q, const ContactPoint& c) const { return pose(q, c.link).finger.linear().col(2); }

 private:
  struct Pose {
    Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, max_joints> axis, origin;  ///< of the joints up to the contact's
    Eigen::Isometry3d finger;
  };

  template <class Isometry3d = Eigen::Isometry3d, class AngleAxisd = Eigen::AngleAxisd>
  Pose pose(const JointVector& q, int link) const {
    if (link < 0 || link >= joints()) throw InvalidArgument(detail::text("contact lies on link ", link, ", the chain has ", joints()));
    if (q.size() != joints()) throw InvalidArgument(detail::text("chain has ", joints(), " joints, got ", q.size(), " angles"));
    Pose p;
    p.axis.resize(3, link + 1);
    p.origin.resize(3, link + 1);
    Isometry3d frame = Isometry3d::Identity();
    for (int i = 0; i <= link; ++i) {
      const Link& l = links_[std::size_t(i)];
      frame = frame * l.joint;
      p.axis.col(i) = frame.linear() * l.axis;
      p.origin.col(i) = frame.translation();
      frame.rotate(AngleAxisd(q[i], l.axis));
    }
    p.finger = frame * links_[std::size_t(link)].finger;
    return p;
  }

  /// The motors balance a force −n at `place`: axis · ((place − origin) × n). Directions have no origin.
  template <class Vec3 = Vec3>
  JointVector torques(const Pose& p, In<Vec3> place, In<Vec3> n, bool is_place) const {
    JointVector t = JointVector::Zero(joints());
    for (Eigen::Index i = 0; i < p.axis.cols(); ++i) {
      const Vec3 arm = is_place ? Vec3(place - p.origin.col(i)) : place;
      t[i] = p.axis.col(i).dot(arm.cross(n));
    }
    return t;
  }

  std::vector<Link> links_;
};

static_assert(ContactJacobian<SerialChain>);

}  // namespace lumo

// ---- lumo/sense/offset_walk.hpp

namespace lumo {

/// Kalman filter of a random walk x that is seen together with a slowly changing offset b (first-order Gauss–Markov): two states, linear, exact.
/// The offset keeps many alike measurements (a motor that sticks, frames of one peak) from looking like many independent ones.
struct OffsetWalk {
  double x = 0.0, b = 0.0;
  double xx = 0.0, xb = 0.0, bb = 0.0;  ///< covariance

  /// `walk`: growth of the variance of x per second, up to `most`. `offset`: stationary variance of b, which forgets within `time_s`.
  void predict(double dt, double walk, double most, double offset, double time_s) {
    const double keep = std::exp(-dt / time_s);
    b *= keep;
    xb *= keep;
    bb = keep * keep * bb + (1.0 - keep * keep) * offset;
    xx += walk * dt;
    if (xx > most) {
      xb *= std::sqrt(most / xx);
      xx = most;
    }
  }
  /// Takes z = x + share · b + noise.
  void update(double z, double variance, double share = 1.0) {
    const double px = xx + share * xb, pb = xb + share * bb, s = px + share * pb + variance;
    const double innovation = (z - x - share * b) / s;
    x += px * innovation;
    b += pb * innovation;
    xx = std::max(xx - px * px / s, 0.0);
    bb = std::max(bb - pb * pb / s, 0.0);
    xb -= px * pb / s;
  }
  /// Variance of what is seen, without noise.
  double seen() const { return xx + 2.0 * xb + bb; }
};

}  // namespace lumo

// ---- lumo/sense/contact_filter.hpp

namespace lumo {

/// Place and normal force of one contact with their covariance.
struct ContactBelief {
  double y_m = 0.0;
  double force_N = 0.0;
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  ///< of (y [m], F [N])
};

/// Fuses contact locations and joint torques, which come at different rates and with different delays. Filtered are what is seen: y, and the
/// contact's torque on each joint, each with the offset of its sensor; these filters are linear. Place and force follow from them at the moment of
/// asking (posterior mode, Gauss–Newton), so that no linearisation about an old guess remains – an extended Kalman filter on (y, F) would come to believe
/// that one joint's torque tells the place. The torque's offset is learnt while nothing touches.
/// A measurement that arrives late is put where it belongs, and what came after it is done again.
template <ContactJacobian Jacobian>
class ContactFilter {
 public:
  struct Config {
    int link = 0;
    double from_m = -27.5_mm, to_m = 27.5_mm;      ///< of the pad: the prior of y is uniform on it
    double creep_m_per_sqrt_s = 5.0_mm;            ///< random walk of y
    double torque_Nm_per_sqrt_s = 0.3;             ///< random walk of the contact's torques
    double torque_prior_Nm = 2.0, force_prior_N = 100.0;
    double location_bias_m = 1.0_mm, location_bias_s = 0.5;  ///< standard deviation and time constant of the localiser's offset
    double torque_bias_Nm = 0.02, torque_bias_s = 5.0;       ///< of the torques'; assumed
    double no_contact_Nm = 0.01;                   ///< torque of what may act on the pad unseen
    double jump_gate = 5.0;                        ///< a location or torque this many standard deviations off is a new contact or load
    std::size_t history = 512;                     ///< measurements that a late one may precede
  };

  /// Throws InvalidArgument for numbers that make no sense.
  explicit ContactFilter(Jacobian jacobian, const Config& config = {});

  /// Contact torques (motor minus torque model) of all joints with the variances of their noises. False: older than the history, ignored. Throws InvalidArgument,
  /// as add_location does, for numbers that are not finite or belong to no finger.
  bool add_torque(std::int64_t stamp_ns, const JointVector& torque_Nm, const JointVector& variance) {
    if (torque_Nm.size() != jacobian_.joints() || variance.size() != jacobian_.joints())
      throw InvalidArgument(detail::text("contact filter has ", jacobian_.joints(), " joints, got ", torque_Nm.size(), " torques and ", variance.size(), " variances"));
    for (Eigen::Index j = 0; j < torque_Nm.size(); ++j) {
      require_in_range("contact torque", torque_Nm[j], -1e9, 1e9, "N·m");
      require_in_range("variance of a contact torque", variance[j], 1e-18, 1e12, "N²·m²");
    }
    return add({stamp_ns, Kind::torque, torque_Nm, variance, 0.0, 0.0, {}});
  }
  /// Location with the variance of its noise, without the localiser's offset.
  bool add_location(std::int64_t stamp_ns, double y_m, double variance_m2) {
    require_in_range("place of a contact", y_m, -10.0, 10.0, "m");
    require_in_range("variance of a place", variance_m2, 1e-18, 100.0, "m²");
    return add({stamp_ns, Kind::location, {}, {}, y_m, variance_m2, {}});
  }
  /// Nothing touches the finger.
  bool add_no_contact(std::int64_t stamp_ns) { return add({stamp_ns, Kind::no_contact, {}, {}, 0.0, 0.0, {}}); }

  /// At a time not before the last measurement's (prediction only), at joint angles q.
  ContactBelief at(std::int64_t stamp_ns, const JointVector& q) const;
  /// Offset of a joint's torque that has been learnt [N·m].
  double torque_offset(int joint) const { return last().torque[std::size_t(joint)].b; }
  void reset() { begin_ = 0, size_ = 0, started_ = false; }
  const Jacobian& jacobian() const { return jacobian_; }

 private:
  enum class Kind { torque, location, no_contact };
  struct Seen {
    std::int64_t stamp_ns = 0;
    OffsetWalk place;
    std::array<OffsetWalk, std::size_t(max_joints)> torque;
  };
  struct Event {
    std::int64_t stamp_ns;
    Kind kind;
    JointVector torque, torque_variance;
    double y, y_variance;
    Seen after;
  };

  Event& event(std::size_t i) { return events_[(begin_ + i) % events_.size()]; }
  const Event& event(std::size_t i) const { return events_[(begin_ + i) % events_.size()]; }
  const Seen& last() const { return size_ ? event(size_ - 1).after : prior_; }
  double pad_variance() const { return (config_.to_m - config_.from_m) * (config_.to_m - config_.from_m) / 12.0; }
  bool add(Event e);
  void predict(Seen& s, std::int64_t stamp_ns) const;
  void apply(Seen& s, const Event& e) const;

  Jacobian jacobian_;
  Config config_;
  std::vector<Event> events_;  ///< ring, in the order of stamps
  std::size_t begin_ = 0, size_ = 0;
  Seen prior_;
  bool started_ = false;
};

template <ContactJacobian Jacobian>
ContactFilter<Jacobian>::ContactFilter(Jacobian jacobian, const Config& config) : jacobian_(std::move(jacobian)), config_(config) {
  require_in_range("pad's end", config.to_m, config.from_m, 10.0, "m");
  require_in_range("joints of the Jacobian", jacobian_.joints(), 1, max_joints, "");
  using Row = std::tuple<const char*, double, const char*>;
  for (const auto& [what, value, unit] :
       {Row{"creep of the contact", config.creep_m_per_sqrt_s, "m/sqrt(s)"}, Row{"random walk of the torque", config.torque_Nm_per_sqrt_s, "N·m/sqrt(s)"},
        Row{"prior of the torque", config.torque_prior_Nm, "N·m"}, Row{"prior of the force", config.force_prior_N, "N"},
        Row{"time of the localiser's offset", config.location_bias_s, "s"}, Row{"time of the torque's offset", config.torque_bias_s, "s"},
        Row{"torque without contact", config.no_contact_Nm, "N·m"}, Row{"jump gate", config.jump_gate, ""}})
    require_positive(what, value, unit);
  require_in_range("offset of the localiser", config.location_bias_m, 0.0, 1.0, "m");
  require_in_range("offset of the torque", config.torque_bias_Nm, 0.0, 1e3, "N·m");
  require_in_range("history of the filter", double(config.history), 2.0, 1e6, "measurements");
  events_.resize(config.history);
  prior_.place = {0.5 * (config.from_m + config.to_m), 0.0, pad_variance(), 0.0, config.location_bias_m * config.location_bias_m};
  prior_.torque.fill({0.0, 0.0, config.torque_prior_Nm * config.torque_prior_Nm, 0.0, config.torque_bias_Nm * config.torque_bias_Nm});
}

template <ContactJacobian Jacobian>
bool ContactFilter<Jacobian>::add(Event e) {
  if (!started_) prior_.stamp_ns = e.stamp_ns, started_ = true;
  if (e.stamp_ns < prior_.stamp_ns) return false;
  if (size_ == events_.size()) {  // the oldest measurement becomes part of the prior
    if (e.stamp_ns < event(0).stamp_ns) return false;
    prior_ = event(0).after;
    begin_ = (begin_ + 1) % events_.size();
    --size_;
  }
  std::size_t place = size_++;
  for (; place > 0 && event(place - 1).stamp_ns > e.stamp_ns; --place) event(place) = event(place - 1);
  event(place) = std::move(e);
  for (std::size_t i = place; i < size_; ++i) {
    Event& now = event(i);
    now.after = i ? event(i - 1).after : prior_;
    predict(now.after, now.stamp_ns);
    apply(now.after, now);
  }
  return true;
}

template <ContactJacobian Jacobian>
void ContactFilter<Jacobian>::predict(Seen& s, std::int64_t stamp_ns) const {
  const double dt = 1e-9 * double(stamp_ns - s.stamp_ns);
  if (!(dt > 0.0)) return;
  s.stamp_ns = stamp_ns;
  const auto square = [](double v) { return v * v; };
  s.place.predict(dt, square(config_.creep_m_per_sqrt_s), pad_variance(), square(config_.location_bias_m), config_.location_bias_s);
  for (int j = 0; j < jacobian_.joints(); ++j)
    s.torque[std::size_t(j)].predict(dt, square(config_.torque_Nm_per_sqrt_s), square(config_.torque_prior_Nm), square(config_.torque_bias_Nm), config_.torque_bias_s);
}

template <ContactJacobian Jacobian>
void ContactFilter<Jacobian>::apply(Seen& s, const Event& e) const {
  if (e.kind == Kind::location) {
    const double off = e.y - s.place.x - s.place.b;
    if (off * off > config_.jump_gate * config_.jump_gate * (s.place.seen() + e.y_variance))  // another contact
      s.place = {e.y, 0.0, pad_variance(), 0.0, config_.location_bias_m * config_.location_bias_m};
    s.place.update(e.y, e.y_variance);
  } else {
    for (int j = 0; j < jacobian_.joints(); ++j) {
      OffsetWalk& t = s.torque[std::size_t(j)];
      if (e.kind == Kind::torque) {
        const double off = e.torque[j] - t.x - t.b;
        if (off * off > config_.jump_gate * config_.jump_gate * (t.seen() + e.torque_variance[j]))  // loads jump, offsets do not
          t.xx = config_.torque_prior_Nm * config_.torque_prior_Nm, t.xb = 0.0;
        t.update(e.torque[j], e.torque_variance[j]);
      } else {
        t.update(0.0, config_.no_contact_Nm * config_.no_contact_Nm, 0.0);
      }
    }
  }
}

template <ContactJacobian Jacobian>
ContactBelief ContactFilter<Jacobian>::at(std::int64_t stamp_ns, const JointVector& q) const {
  Seen s = last();
  predict(s, stamp_ns);
  const int n = jacobian_.joints();
  const double place = s.place.x, place_weight = 1.0 / std::max(s.place.xx, 1e-14), force_weight = 1.0 / (config_.force_prior_N * config_.force_prior_N);
  // Mode of exp(−½ [(y − place)²/P_y + Σ (T_j − F a_j(y))²/P_j + F²/P_F]).
  ContactBelief belief;
  double y = place, force = 0.0;
  Eigen::Matrix2d information;
  for (int k = 0; k < 8; ++k) {
    const double inside = std::clamp(y, config_.from_m, config_.to_m);
    const JointVector a = jacobian_.column(q, {config_.link, inside}), slope = jacobian_.slope(q, {config_.link, inside});
    double aa = force_weight, at = 0.0;
    for (int j = 0; j < n; ++j) {
      const OffsetWalk& t = s.torque[std::size_t(j)];
      const double weight = 1.0 / std::max(t.xx, 1e-14);
      aa += weight * a[j] * a[j];
      at += weight * a[j] * t.x;
    }
    if (k == 0) force = at / aa;  // of that place
    information << place_weight, 0.0, 0.0, aa;
    Eigen::Vector2d gradient(place_weight * (place - y), at - aa * force);
    for (int j = 0; j < n; ++j) {
      const OffsetWalk& t = s.torque[std::size_t(j)];
      const double weight = 1.0 / std::max(t.xx, 1e-14), h = slope[j] * force;
      information(0, 0) += weight * h * h;
      information(0, 1) += weight * h * a[j];
      gradient[0] += weight * h * (t.x - a[j] * force);
    }
    information(1, 0) = information(0, 1);
    belief.covariance = information.inverse();
    const Eigen::Vector2d step = belief.covariance * gradient;
    y = std::clamp(y + step[0], config_.from_m - 5.0_mm, config_.to_m + 5.0_mm);
    force += step[1];
    if (std::abs(step[0]) < 1e-9 && std::abs(step[1]) < 1e-7) break;
  }
  belief.y_m = y;
  belief.force_N = force;
  return belief;
}

}  // namespace lumo

// ---- lumo/sense/faults.hpp

namespace lumo {

/// What can be wrong with a finger's two streams. The first block concerns frames, the second joint samples.
enum class Fault : std::uint32_t {
  frame_dropped,      ///< a frame is missing between two
  frames_missing,     ///< none for longer than the limit
  frame_repeated,     ///< the same picture or the same stamp again
  frame_late,         ///< older than allowed when it came
  frame_time,         ///< its stamp runs backwards or lies in the future
  frame_corrupt,      ///< wrong size or format, or light that no contact makes
  frame_black,
  frame_saturated,
  led_dead,           ///< dark about one LED
  exposure_changed,   ///< by its metadata, or all lights together
  camera_lost,        ///< the source has failed
  joint_dropped,
  joint_missing,
  joint_time,
  joint_not_finite,   ///< a value is not a number, or the number of joints is another
  torque_stuck,       ///< the very same effort for too long
  torque_spike,
  torque_saturated,   ///< beyond the motor's range, or at the end of what its driver can say
  position_jump,      ///< faster, or farther, than the joint can turn
  actuator_lost,
  count
};

/// A set of faults.
class Faults {
 public:
  void add(Fault f) { bits_ |= 1u << unsigned(f); }
  bool has(Fault f) const { return bits_ >> unsigned(f) & 1u; }
  bool any() const { return bits_ != 0; }
  Faults& operator|=(Faults o) { return bits_ |= o.bits_, *this; }
  bool operator==(const Faults&) const = default;

 private:
  std::uint32_t bits_ = 0;
};

/// Names, separated by spaces.
inline std::string to_string(Faults faults) {
  static constexpr std::array<const char*, std::size_t(Fault::count)> names{
      "frame_dropped", "frames_missing", "frame_repeated", "frame_late", "frame_time", "frame_corrupt", "frame_black", "frame_saturated", "led_dead",
      "exposure_changed", "camera_lost", "joint_dropped", "joint_missing", "joint_time", "joint_not_finite", "torque_stuck", "torque_spike",
      "torque_saturated", "position_jump", "actuator_lost"};
  std::string text;
  for (std::size_t i = 0; i < names.size(); ++i)
    if (faults.has(Fault(i))) text += (text.empty() ? "" : " ") + std::string(names[i]);
  return text;
}

}  // namespace lumo

// ---- lumo/sense/force_estimate.hpp

namespace lumo {

/// Which streams an estimate rests on.
enum class EstimatorState {
  ok,           ///< both, without faults
  degraded,     ///< both, but something is or was just wrong with one
  torque_only,  ///< no usable frame for too long
  vision_only,  ///< no usable joint sample for too long
  invalid       ///< neither
};

constexpr const char* to_string(EstimatorState s) {
  constexpr std::array<const char*, 5> names{"ok", "degraded", "torque_only", "vision_only", "invalid"};
  return names[std::size_t(s)];
}

/// One contact: the place on the finger and the normal force of the object on the pad. What cannot be told is empty; the rest is finite.
struct ContactForce {
  std::optional<double> y_m;
  std::optional<double> force_N;
  double y_variance_m2 = 0.0;      ///< also where y is empty
  double force_variance_N2 = 0.0;  ///< what is not told has that of the prior
  double covariance_m_N = 0.0;
};

struct ForceEstimate {
  std::int64_t stamp_ns = 0;  ///< the time that it is for
  EstimatorState state = EstimatorState::invalid;
  Faults faults;
  int contacts = 0;
  std::array<ContactForce, 2> contact;  ///< the first max(1, contacts) mean something
  /// Unknowns are (y, F) of one contact or (F₁, F₂) of two, in units of what counts as known; `rank` of them (or combinations) are.
  int rank = 0;
  Eigen::Matrix2d null_directions = Eigen::Matrix2d::Zero();  ///< the last 2 − rank columns: unit directions that the data leave open
  std::int64_t frame_stamp_ns = 0;  ///< of the newest usable frame
  std::int64_t joint_stamp_ns = 0;  ///< of the newest usable joint sample
};

}  // namespace lumo

// ---- lumo/sense/force_solution.hpp

namespace lumo {

/// Normal forces [N] at known places from the torques that contacts put on the motors. Forces that the torques do not tell apart come back
/// as null directions: three contacts on two joints, two on one link of one joint, any at a joint's axis.
template <ContactJacobian J>
Identification solve_forces(const J& jacobian, const JointVector& q, const JointVector& contact_torque_Nm, std::span<const ContactPoint> contacts, double torque_sigma_Nm) {
  const auto m = Eigen::Index(contacts.size());
  // A contact within a tenth of a millimetre of all axes counts as on them.
  const Eigen::MatrixXd a = contact_columns(jacobian, q, contacts);
  const double largest = a.size() ? a.cwiseAbs().maxCoeff() : 0.0;
  if (largest < 1e-4) return {Eigen::VectorXd::Zero(m), Eigen::MatrixXd::Zero(m, m), 0, Eigen::MatrixXd::Identity(m, m), 0.0};
  return identify(a, contact_torque_Nm, Eigen::VectorXd::Ones(m), torque_sigma_Nm, 1e-3);
}

/// One contact from torques alone: place and force together, as far as the joints tell.
struct TorqueOnlySolution {
  double y_m = 0.0;
  double force_N = 0.0;
  int rank = 0;                                         ///< of (y, force): 2 both, 1 a combination, 0 nothing
  Eigen::Vector2d null_direction = Eigen::Vector2d::Zero();  ///< (y in units of 10 mm, force in N), unit; where the rank is 1
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();   ///< of (y [m], force [N]); where the rank is 2
};

/// On one link, between `from_m` and `to_m`: two joints before the contact give the place by the ratio of their torques (paper's torque-only
/// baseline is τ₁/τ₂). A single joint has rank 1. The value along a null direction is that of the range's middle.
template <ContactJacobian J>
TorqueOnlySolution solve_torque_only(const J& jacobian, const JointVector& q, const JointVector& contact_torque_Nm, int link, double from_m, double to_m,
    double torque_sigma_Nm) {
  require_in_range("end of the finger", to_m, from_m, 10.0, "m");
  require_positive("error of the torque", torque_sigma_Nm, "N·m");
  const auto force_at = [&](double y, double& misfit) {
    const JointVector a = jacobian.column(q, {link, y});
    const double force = a.dot(contact_torque_Nm) / std::max(a.squaredNorm(), 1e-12);
    misfit = (contact_torque_Nm - force * a).squaredNorm();
    return force;
  };
  TorqueOnlySolution s;
  s.y_m = 0.5 * (from_m + to_m);
  double misfit = 0.0;
  s.force_N = force_at(s.y_m, misfit);
  const auto sensitivity = [&] {
    Eigen::MatrixXd h(jacobian.joints(), 2);
    h.col(0) = 0.01 * s.force_N * jacobian.slope(q, {link, s.y_m});
    h.col(1) = jacobian.column(q, {link, s.y_m});
    return h;
  };
  const auto look = [&] { return identify(sensitivity(), Eigen::VectorXd(contact_torque_Nm), Eigen::Vector2d::Ones(), torque_sigma_Nm, 1e-3); };
  Identification local = look();
  if (local.complete()) {
    constexpr int cells = 64;
    double least = 1e300;
    int best = 0;
    for (int k = 0; k <= cells; ++k) {
      force_at(from_m + (to_m - from_m) * k / cells, misfit);
      if (misfit < least) least = misfit, best = k;
    }
    const double a = from_m + (to_m - from_m) * std::max(0, best - 1) / cells, b = from_m + (to_m - from_m) * std::min(cells, best + 1) / cells;
    s.y_m = golden_section([&](double y) { return force_at(y, misfit), misfit; }, a, b, 40);
    s.force_N = force_at(s.y_m, misfit);
    local = look();
  }
  s.rank = int(local.rank);
  if (s.rank == 1) s.null_direction = local.null_space.col(0);
  if (s.rank == 2) {
    const Eigen::Vector2d unit(0.01, 1.0);
    s.covariance = unit.asDiagonal() * local.covariance * unit.asDiagonal();
  }
  return s;
}

}  // namespace lumo

// ---- lumo/sense/frame_monitor.hpp

namespace lumo {

/// Says of each frame's profile whether it can be trusted, by comparison with the unloaded one and with its predecessor.
class FrameMonitor {
 public:
  struct Config {
    Eigen::VectorXd position_m;        ///< of the profile's values
    Eigen::VectorXd unloaded;          ///< mean profile without contact
    std::vector<double> led_m{-22.0_mm, -11.0_mm, 0.0, 11.0_mm, 22.0_mm};
    double period_s = 1.0 / 30.0;      ///< of the frames
    double max_age_s = 0.15;           ///< from stamp to arrival
    double max_ahead_s = 0.01;         ///< how far a stamp may lie in the future
    double black = 0.25;               ///< mean light, relative to unloaded, below which a frame is black
    double saturated = 0.05;           ///< share of full pixels that is too many
    double led_dark = 0.6;             ///< light about one LED, relative to the others', below which it is dead
    double exposure = 0.15;            ///< change of all lights (median over the finger) that no contact makes
    double corrupt_low = 0.4, corrupt_high = 4.0;  ///< light anywhere, relative to unloaded, outside of which the picture is damaged
    double exposure_s = 0.0, gain = 0.0;  ///< under which the reference was taken; 0: not known
  };

  /// Throws InvalidArgument for lengths that differ or numbers that make no sense.
  explicit FrameMonitor(Config config) : config_(std::move(config)) {
    const Eigen::Index n = config_.position_m.size();
    if (n < 1 || config_.unloaded.size() != n)
      throw InvalidArgument(detail::text("frame monitor has ", n, " positions and ", config_.unloaded.size(), " unloaded values, must have as many"));
    for (Eigen::Index i = 0; i < n; ++i) require_positive("unloaded light at every position", config_.unloaded[i], "");
    require_positive("period of the frames", config_.period_s, "s");
    require_positive("greatest age of a frame", config_.max_age_s, "s");
  }

  struct Verdict {
    Faults faults;
    bool usable = true;
  };

  /// Before anything is read of it: the time. A frame that fails is not to be read.
  Verdict check_time(std::int64_t stamp_ns, std::int64_t now_ns) {
    Verdict v;
    if (stamp_ns < -stamp_limit_ns || stamp_ns > stamp_limit_ns) return reject(Fault::frame_time);
    if (const double ahead = 1e-9 * double(stamp_ns - now_ns); ahead > config_.max_ahead_s) return reject(Fault::frame_time);
    if (seen_ && stamp_ns == stamp_ns_) return reject(Fault::frame_repeated);
    if (seen_ && stamp_ns < stamp_ns_) return reject(Fault::frame_time);
    if (1e-9 * double(now_ns - stamp_ns) > config_.max_age_s) v.faults.add(Fault::frame_late);
    if (seen_ && 1e-9 * double(stamp_ns - stamp_ns_) > 1.6 * config_.period_s) v.faults.add(Fault::frame_dropped);
    seen_ = true;
    stamp_ns_ = stamp_ns;
    return v;
  }

  /// The light itself, before the reference is subtracted.
  template <class = void>
  Verdict check_light(const Profile& p, double exposure_s, double gain) {
    Verdict v;
    const bool same = last_.size() == p.value.size() && last_ == p.value;
    last_ = p.value;
    if (same) return reject(Fault::frame_repeated);
    if (!p.value.allFinite()) return reject(Fault::frame_corrupt);
    const auto differs = [](double a, double b) { return a > 0.0 && b > 0.0 && std::abs(a / b - 1.0) > 0.01; };
    if (differs(exposure_s, config_.exposure_s) || differs(gain, config_.gain)) v.faults.add(Fault::exposure_changed);
    if (p.value.mean() < config_.black * config_.unloaded.mean()) v.faults.add(Fault::frame_black);
    if (p.saturated > config_.saturated) v.faults.add(Fault::frame_saturated);
    ratio_ = p.value.cwiseQuotient(config_.unloaded);
    sorted_ = ratio_;
    const Eigen::Index n = ratio_.size();
    std::nth_element(sorted_.data(), sorted_.data() + n / 2, sorted_.data() + n);
    const double median = sorted_[n / 2];
    if (!v.faults.any()) {
      const bool dead = std::any_of(config_.led_m.begin(), config_.led_m.end(), [&](double y) { return led_ratio(y) < config_.led_dark * median; });
      if (dead)
        v.faults.add(Fault::led_dead);
      else if (ratio_.minCoeff() < config_.corrupt_low || ratio_.maxCoeff() > config_.corrupt_high)
        v.faults.add(Fault::frame_corrupt);
      if (std::abs(median - 1.0) > config_.exposure) v.faults.add(Fault::exposure_changed);
    }
    v.usable = !v.faults.any();
    return v;
  }

  static Verdict reject(Fault f) {
    Verdict v;
    v.faults.add(f);
    v.usable = false;
    return v;
  }

 private:
  /// Of the position that is nearest to the LED.
  template <class = void>
  double led_ratio(double y) const {
    Eigen::Index i = 0;
    (config_.position_m.array() - y).abs().minCoeff(&i);
    return ratio_[i];
  }

  Config config_;
  Eigen::VectorXd last_, ratio_, sorted_;
  std::int64_t stamp_ns_ = 0;
  bool seen_ = false;
};

}  // namespace lumo

// ---- lumo/sense/longitudinal_bins.hpp

namespace lumo {

/// Where along the finger a profile is averaged: bin i lies between edges i and i + 1.
struct LongitudinalBins {
  Eigen::VectorXd edges_m;  ///< ascending

  /// The paper's 11 regions: 5 mm each on [−27.5, 27.5] mm.
  template <class = void>
  static LongitudinalBins regions() { return uniform(-27.5e-3, 27.5e-3, 11); }
  template <class VectorXd = Eigen::VectorXd>
  static LongitudinalBins uniform(double from_m, double to_m, int count) {
    require_in_range("number of bins", count, 1, 4096, "");
    require_in_range("first edge", from_m, -10.0, 10.0, "m");
    require_in_range("last edge", to_m, -10.0, 10.0, "m");
    LongitudinalBins bins{VectorXd::LinSpaced(count + 1, from_m, to_m)};
    validate(bins);
    return bins;
  }

  Eigen::Index size() const { return edges_m.size() - 1; }
  template <class VectorXd = Eigen::VectorXd>
  Eigen::VectorXd centres_m() const { return 0.5 * (edges_m.head(size()) + edges_m.tail(size())); }

  /// Throws InvalidArgument unless there are at least two edges that ascend.
  friend void validate(const LongitudinalBins& b) {
    if (b.edges_m.size() < 2) throw InvalidArgument(detail::text("longitudinal bins have ", b.edges_m.size(), " edges, must have at least 2"));
    for (Eigen::Index i = 1; i < b.edges_m.size(); ++i)
      if (!(b.edges_m[i] > b.edges_m[i - 1]))
        throw InvalidArgument(detail::text("edge ", i, " of the longitudinal bins is ", b.edges_m[i], " m, must exceed its predecessor, ", b.edges_m[i - 1], " m"));
  }
};

}  // namespace lumo

// ---- lumo/sense/strip.hpp

namespace lumo::detail {

/// The pixels of a band along the finger, laid out once as runs in the image's rows. Lines of equal y cross the axis at right
/// angles, in steps of whole pixels along the image's direction that is nearer to the axis.
class Strip {
 public:
  Strip(const AxisMap& map, const LongitudinalBins& bins, double low_m, double high_m, int width, int height, PixelFormat format, int row_step);

  bool fits(const ImageView& image) const { return !image.empty() && image.width == width_ && image.height == height_ && image.format == format_; }

  /// Mean of value(pixels, reference pixels, byte) over each bin. Bytes of all channels are summed, which is cheaper than to pick one of three.
  template <class Value>
  void sum(const ImageView& image, Value value, const ImageView* reference, Eigen::VectorXd& mean);

  /// Share of bytes of the measured channel that are 255, on every eighth row read.
  double saturated_share(const ImageView& image) const;

 private:
  struct Run {
    int row, first, count;  ///< pixels
    int place;              ///< first place along the axis; a run along the axis goes on from it, one across it stays
  };

  void flush();

  int width_, height_, places_ = 0, channels_, channel_;
  PixelFormat format_;
  bool along_;  ///< the axis runs along image rows
  std::vector<Run> runs_;
  std::vector<double> inverse_count_;          ///< 1/pixels at each place
  std::vector<double> edges_;                  ///< of the bins, in places
  std::vector<std::uint16_t> narrow_;          ///< bytes of the places; wrap after 257 rows
  std::vector<std::uint32_t> wide_;
  std::vector<double> integral_;               ///< of the mean, from the first place
};

inline Strip::Strip(const AxisMap& map, const LongitudinalBins& bins, double low_m, double high_m, int width, int height, PixelFormat format, int row_step)
    : width_(width), height_(height), channels_(lumo::channels(format)), channel_(format == PixelFormat::bgr ? 1 : 0), format_(format) {
  require_in_range("frame width", width, 1, 32768, "px");
  require_in_range("frame height", height, 1, 32768, "px");
  require_in_range("row step", row_step, 1, height, "");
  require_in_range("band's upper limit", high_m, low_m, 10.0, "m");
  validate(bins);
  const Eigen::Vector2d d = map.direction;
  along_ = std::abs(d.x()) >= std::abs(d.y());
  const double scale = map.scale_m_per_px(map.u_px(0.5 * (bins.edges_m[0] + bins.edges_m[bins.size()])));
  const double v0 = low_m / scale, v1 = high_m / scale;
  for (const double y : {bins.edges_m[0], bins.edges_m[bins.size()]})
    if (const double u = map.u_px(y); !(std::isfinite(u) && map.scale_m_per_px(u) > 0.0 && 1.0 + map.coefficients[2] * u / map.half_length_px > 0.0))
      throw InvalidArgument(text("the axis map has no place in the image for y = ", 1e3 * y, " mm"));

  // Place of a pixel: its column (or row) sheared onto the line, so that u = (place − origin) · main; equal places have equal u.
  const double main = along_ ? d.x() : d.y(), shear = along_ ? d.y() / d.x() : d.x() / d.y();
  const double main_origin = along_ ? map.origin_px.x() : map.origin_px.y(), cross_origin = along_ ? map.origin_px.y() : map.origin_px.x();
  const auto place_of = [&](double y) { return main_origin + map.u_px(y) / main; };
  const double from = std::min(place_of(bins.edges_m[0]), place_of(bins.edges_m[bins.size()]));
  const double to = std::max(place_of(bins.edges_m[0]), place_of(bins.edges_m[bins.size()]));
  const int base = int(std::floor(from + 0.5)), last = int(std::floor(to + 0.5));  // place k covers [k − ½, k + ½)
  if (!(to - from < 65536.0)) throw InvalidArgument("finger's bins reach far beyond the image");
  places_ = last - base + 1;

  std::vector<int> count(std::size_t(places_), 0);
  const auto inside = [&](int x, int y, int& place) {
    const double px = x - map.origin_px.x(), py = y - map.origin_px.y();
    const double across = px * -d.y() + py * d.x();
    if (across < v0 || across >= v1) return false;
    const double cross = along_ ? y : x;
    place = (along_ ? x : y) + int(std::lround((cross - cross_origin) * shear)) - base;
    return place >= 0 && place < places_;
  };
  // Lines along the axis are left out, so that every place keeps some pixels.
  for (int y = 0; y < height; y += along_ ? row_step : 1)
    for (int x = 0; x < width; x += along_ ? 1 : row_step) {
      int place = 0;
      if (!inside(x, y, place)) continue;
      ++count[std::size_t(place)];
      const bool joins = !runs_.empty() && runs_.back().row == y && runs_.back().first + runs_.back().count == x &&
                         place == runs_.back().place + (along_ ? runs_.back().count : 0);
      if (joins)
        ++runs_.back().count;
      else
        runs_.push_back({y, x, 1, place});
    }
  for (std::size_t k = 0; k < count.size(); ++k) {
    if (count[k] == 0)
      throw InvalidArgument(text("the finger's band leaves the image: no pixel at y = ", 1e3 * map.y_m((double(base) + double(k) - main_origin) * main), " mm"));
    inverse_count_.push_back(1.0 / count[k]);
  }
  for (Eigen::Index i = 0; i < bins.edges_m.size(); ++i) edges_.push_back(place_of(bins.edges_m[i]) + 0.5 - base);
  for (double& e : edges_) e = std::clamp(e, 0.0, double(places_));
  const std::size_t bytes = std::size_t(places_) * std::size_t(along_ ? channels_ : 1);
  narrow_.resize(bytes);
  wide_.resize(bytes);
  integral_.resize(std::size_t(places_) + 1);
}

inline void Strip::flush() {
  for (std::size_t i = 0; i < narrow_.size(); ++i) wide_[i] += narrow_[i];
  std::fill(narrow_.begin(), narrow_.end(), std::uint16_t(0));
}

template <class Value>
void Strip::sum(const ImageView& image, Value value, const ImageView* reference, Eigen::VectorXd& mean) {
  std::fill(wide_.begin(), wide_.end(), 0u);
  std::fill(narrow_.begin(), narrow_.end(), std::uint16_t(0));
  int rows = 0, row = -1;
  for (const Run& run : runs_) {
    const std::uint8_t* __restrict p = image.row(run.row) + std::ptrdiff_t(run.first) * channels_;
    const std::uint8_t* __restrict q = reference ? reference->row(run.row) + std::ptrdiff_t(run.first) * channels_ : nullptr;
    const std::size_t bytes = std::size_t(run.count) * std::size_t(channels_);
    if (along_) {
      if (run.row != row && (row = run.row, ++rows) == 256) flush(), rows = 0;
      std::uint16_t* __restrict to = narrow_.data() + std::ptrdiff_t(run.place) * channels_;
      for (std::size_t i = 0; i < bytes; ++i) to[i] = std::uint16_t(to[i] + value(p, q, i));  // -O3 makes vectors of it, which is four times as fast
    } else {
      // 48 lanes are a whole number of pixels in either format; a lane takes 257 bytes.
      std::uint16_t lane[48] = {};
      std::uint32_t total = 0;
      const auto collect = [&] {
        for (int k = channel_; k < 48; k += channels_) total += lane[k];
        std::memset(lane, 0, sizeof lane);
      };
      std::size_t i = 0;
      for (int turns = 0; i + 48 <= bytes; i += 48) {
        for (std::size_t k = 0; k < 48; ++k) lane[k] = std::uint16_t(lane[k] + value(p + i, q ? q + i : nullptr, k));
        if (++turns == 256) collect(), turns = 0;
      }
      collect();
      for (i += std::size_t(channel_); i < bytes; i += std::size_t(channels_)) total += value(p, q, i);
      wide_[std::size_t(run.place)] += total;
    }
  }
  if (along_) flush();

  const int stride = along_ ? channels_ : 1, offset = along_ ? channel_ : 0;
  for (int k = 0; k < places_; ++k)
    integral_[std::size_t(k) + 1] = integral_[std::size_t(k)] + wide_[std::size_t(k * stride + offset)] * inverse_count_[std::size_t(k)];
  const auto up_to = [&](double place) {
    const auto whole = std::min(std::size_t(place), integral_.size() - 2);
    return integral_[whole] + (place - double(whole)) * (integral_[whole + 1] - integral_[whole]);
  };
  mean.resize(Eigen::Index(edges_.size()) - 1);
  for (Eigen::Index i = 0; i < mean.size(); ++i) {
    const double a = edges_[std::size_t(i)], b = edges_[std::size_t(i) + 1];
    mean[i] = (up_to(b) - up_to(a)) / (b - a);
  }
}

inline double Strip::saturated_share(const ImageView& image) const {
  std::size_t full = 0, seen = 0;
  int row = -1, turn = 7;
  for (const Run& run : runs_) {
    if (run.row != row) row = run.row, turn = (turn + 1) % 8;
    if (turn != 0) continue;
    const std::uint8_t* p = image.row(run.row) + std::ptrdiff_t(run.first) * channels_ + channel_;
    unsigned here = 0;
    for (int i = 0; i < run.count; ++i) here += p[std::ptrdiff_t(i) * channels_] == 255;
    full += here;
    seen += std::size_t(run.count);
  }
  return seen ? double(full) / double(seen) : 0.0;
}

}  // namespace lumo::detail

// ---- lumo/sense/green_profile.hpp

namespace lumo {

/// Mean green of a camera's frame over each longitudinal bin of the finger [DN, 0 … 255].
/// Only the pixels of the finger's band are read; sums are whole numbers, so that the order of summation does not matter.
class GreenProfile {
 public:
  using Sample = Frame;

  struct Config {
    AxisMap map;
    LongitudinalBins bins = LongitudinalBins::regions();
    double band_low_m = -8.0_mm;   ///< the band's limits to the sides of the map's line; positive lies clockwise of the tip's direction in the image (image y runs down)
    double band_high_m = 8.0_mm;
    int width = 640, height = 480;  ///< of the frames [px]
    PixelFormat format = PixelFormat::bgr;
    int row_step = 1;  ///< reads every n-th line along the finger only (of image rows, or columns for an upright finger)
  };

  /// Throws InvalidArgument for a band outside the image or numbers that make no sense.
  template <class = void>
  explicit GreenProfile(const Config& config)
      : strip_(strip_of(config)),
        centres_(config.bins.centres_m()) {}

  bool read(const Frame& frame, Profile& profile) {
    if (!strip_.fits(frame.image)) return false;
    profile.stamp_ns = frame.stamp_ns;
    strip_.sum(frame.image, [](const std::uint8_t* p, const std::uint8_t*, std::size_t i) { return p[i]; }, nullptr, profile.value);
    profile.saturated = strip_.saturated_share(frame.image);
    return true;
  }
  const Eigen::VectorXd& positions_m() const { return centres_; }

  /// The pixels that a configuration reads. Throws as the constructor.
  static detail::Strip strip_of(const Config& c) { return {c.map, c.bins, c.band_low_m, c.band_high_m, c.width, c.height, c.format, c.row_step}; }

 private:
  detail::Strip strip_;
  Eigen::VectorXd centres_;
};

static_assert(Readout<GreenProfile>);

/// Mean over each bin of how far green exceeds the unloaded image, pixel by pixel; what got darker counts nothing (paper, force estimation).
/// Not linear near zero: noise leaves a positive mean there, which an unloaded reference of these profiles takes away.
class PositiveGreenProfile {
 public:
  using Sample = Frame;

  /// `unloaded` must have the frames' size and format. Throws InvalidArgument as GreenProfile.
  template <class = void>
  PositiveGreenProfile(const GreenProfile::Config& config, Image unloaded)
      : strip_(GreenProfile::strip_of(config)),
        centres_(config.bins.centres_m()),
        unloaded_(std::move(unloaded)) {
    if (!strip_.fits(unloaded_.view())) throw InvalidArgument("unloaded image has not the size or format of the frames");
  }

  bool read(const Frame& frame, Profile& profile) {
    if (!strip_.fits(frame.image)) return false;
    profile.stamp_ns = frame.stamp_ns;
    const ImageView reference = unloaded_.view();
    strip_.sum(
        frame.image, [](const std::uint8_t* p, const std::uint8_t* q, std::size_t i) { return std::uint8_t(p[i] > q[i] ? p[i] - q[i] : 0); }, &reference, profile.value);
    profile.saturated = strip_.saturated_share(frame.image);
    return true;
  }
  const Eigen::VectorXd& positions_m() const { return centres_; }

 private:
  detail::Strip strip_;
  Eigen::VectorXd centres_;
  Image unloaded_;
};

static_assert(Readout<PositiveGreenProfile>);

}  // namespace lumo

// ---- lumo/sense/joint_monitor.hpp

namespace lumo {

/// Says of each joint sample whether it can be trusted.
class JointMonitor {
 public:
  struct Config {
    int joints = 1;
    double period_s = 1e-3;
    double max_ahead_s = 0.01;        ///< how far a stamp may lie in the future
    double stuck_s = 0.1;             ///< the very same effort of a joint for this long is stuck; at least 20 samples. Real currents are noisy
    /// Step in which efforts come, and standard deviation of their noise before they are rounded to it, both in the effort's unit. Where there is a step, as many
    /// samples more must be the same as noise alone would not make so in 10⁹ trials; noise far below half a step never tells. 0: no step.
    double quantum = 0.0, noise = 0.0;
    double spike = 0.5;               ///< jump against the median of the last five [A or N·m, as the effort]
    double max_effort = 40.0;         ///< of the motor, same unit
    double max_velocity_rad_per_s = 65.0;
    double max_position_rad = 1e4;    ///< beyond, the encoder is out of its mind
  };

  /// Throws InvalidArgument for numbers that make no sense.
  explicit JointMonitor(const Config& config) : config_(config) {
    require_in_range("number of joints", config.joints, 1, max_joints, "");
    require_in_range("period of the joint samples", config.period_s, 1e-6, 1e3, "s");
    require_positive("time after which an effort is stuck", config.stuck_s, "s");
    require_positive("spike", config.spike, "");
    require_in_range("largest effort", config.max_effort, 1e-9, 1e4, "");
    require_in_range("largest velocity", config.max_velocity_rad_per_s, 1e-6, 1e4, "rad/s");
    require_in_range("largest position", config.max_position_rad, 1e-3, 1e9, "rad");
    require_in_range("step of the effort", config.quantum, 0.0, config.max_effort, "");
    require_in_range("noise of the effort", config.noise, 0.0, config.max_effort, "");
    if (config.quantum > 0.0) {
      const double same = config.noise > 0.0 ? std::erf(config.quantum / (2.8284271247461901 * config.noise)) : 1.0;  // share of samples on a step's middle
      least_same_ = std::max(least_same_, same < 1.0 ? std::log(1e-9) / std::log(same) : std::numeric_limits<double>::infinity());
    }
  }

  struct Verdict {
    Faults faults;
    bool usable = true;
  };

  template <class = void>
  Verdict check(const JointSample& s, std::int64_t now_ns) {
    Verdict v;
    const auto reject = [&](Fault f) { v.faults.add(f), v.usable = false; };
    if (s.stamp_ns < -stamp_limit_ns || s.stamp_ns > stamp_limit_ns) return reject(Fault::joint_time), v;
    if (1e-9 * double(s.stamp_ns - now_ns) > config_.max_ahead_s || (seen_ && s.stamp_ns <= stamp_ns_)) return reject(Fault::joint_time), v;
    const double step_s = seen_ ? 1e-9 * double(s.stamp_ns - stamp_ns_) : 0.0;
    if (step_s > 2.5 * config_.period_s) v.faults.add(Fault::joint_dropped);
    stamp_ns_ = s.stamp_ns;
    const Eigen::Index n = config_.joints;
    if (s.effort.size() != n || s.position_rad.size() != n || s.velocity_rad_per_s.size() != n || !s.effort.allFinite() || !s.position_rad.allFinite() ||
        !s.velocity_rad_per_s.allFinite())
      return seen_ = true, reject(Fault::joint_not_finite), v;
    if (s.position_rad.cwiseAbs().maxCoeff() > config_.max_position_rad || s.velocity_rad_per_s.cwiseAbs().maxCoeff() > config_.max_velocity_rad_per_s)
      return seen_ = true, reject(Fault::position_jump), v;
    if (!filled_) position_ = s.position_rad;

    const double reach = config_.max_velocity_rad_per_s * std::max(1e-9 * double(s.stamp_ns - position_ns_), config_.period_s);
    if (filled_ && (s.position_rad - position_).cwiseAbs().maxCoeff() > 1.5 * reach) reject(Fault::position_jump);
    if (v.usable) position_ = s.position_rad, position_ns_ = s.stamp_ns;
    if (s.saturated || s.effort.cwiseAbs().maxCoeff() > config_.max_effort) reject(Fault::torque_saturated);

    for (Eigen::Index j = 0; j < n; ++j) {
      Sameness& same = same_[std::size_t(j)];
      if (!filled_ || s.effort[j] != last_[j])
        same = {0, s.stamp_ns};
      else if (++same.samples >= least_same_ && 1e-9 * double(s.stamp_ns - same.since_ns) > config_.stuck_s)
        reject(Fault::torque_stuck);
    }
    last_ = s.effort;

    // A real step fills the window within three samples and then is no spike.
    if (filled_ >= window)
      for (Eigen::Index j = 0; j < n; ++j) {
        std::array<double, window> sorted{};
        for (std::size_t k = 0; k < window; ++k) sorted[k] = recent_[k][j];
        std::nth_element(sorted.begin(), sorted.begin() + window / 2, sorted.end());
        if (std::abs(s.effort[j] - sorted[window / 2]) > config_.spike) reject(Fault::torque_spike);
      }
    recent_[std::size_t(next_)] = s.effort;
    next_ = (next_ + 1) % int(window);
    filled_ = std::min<std::size_t>(filled_ + 1, window);
    seen_ = true;
    return v;
  }

 private:
  static constexpr std::size_t window = 5;
  Config config_;
  std::array<JointVector, window> recent_;
  JointVector position_, last_;
  std::size_t filled_ = 0;
  struct Sameness {
    double samples = 0.0;  ///< that repeated the one before
    std::int64_t since_ns = 0;
  };
  std::array<Sameness, std::size_t(max_joints)> same_;
  double least_same_ = 20.0;
  int next_ = 0;
  std::int64_t stamp_ns_ = 0, position_ns_ = 0;
  bool seen_ = false;
};

}  // namespace lumo

// ---- lumo/sense/moment_arm.hpp

namespace lumo {

/// One joint whose axis crosses the finger at right angles: the torque is force times distance.
struct MomentArm {
  double joint_to_origin_m = 0.05;  ///< from the joint's axis to the finger's origin, along y
  double sign = 1.0;                ///< −1 where the motor turns the other way: positive torque lifts the pad off

  int joints() const { return 1; }
  template <class = void>
  JointVector column(const JointVector&, const ContactPoint& c) const { return JointVector::Constant(1, sign * (joint_to_origin_m + c.y_m)); }
  template <class = void>
  JointVector slope(const JointVector&, const ContactPoint&) const { return JointVector::Constant(1, sign); }
};

static_assert(ContactJacobian<MomentArm>);

}  // namespace lumo

// ---- lumo/sense/unloaded_reference.hpp

namespace lumo {

/// Mean profile of the unloaded finger and the scatter of single profiles about it: what responses are measured against.
class UnloadedReference {
 public:
  /// Adds a profile of the unloaded finger (Welford's running moments). Throws InvalidArgument for another length or values that are not finite.
  template <class VectorXd = Eigen::VectorXd>
  void add(const Profile& p) {
    if (count_ == 0) mean_ = squares_ = VectorXd::Zero(p.value.size());
    if (p.value.size() != mean_.size()) throw InvalidArgument(detail::text("unloaded profile has ", p.value.size(), " values, the reference ", mean_.size()));
    if (!p.value.allFinite()) throw InvalidArgument("unloaded profile: values must be finite");
    ++count_;
    const VectorXd before = p.value - mean_;
    mean_ += before / double(count_);
    squares_ += before.cwiseProduct(p.value - mean_);
  }

  int count() const { return count_; }
  const Eigen::VectorXd& mean() const { return mean_; }
  /// Standard deviation of one response at each position, at least `floor` (an 8-bit camera that gives the same number twice is not free of noise). The
  /// mean's own error is part of it.
  template <class VectorXd = Eigen::VectorXd>
  Eigen::VectorXd noise(double floor = 0.02) const {
    if (count_ < 2) return VectorXd::Constant(mean_.size(), floor);
    const double n = count_;
    return (squares_ / (n - 1.0) * (1.0 + 1.0 / n)).cwiseSqrt().cwiseMax(floor);
  }
  /// Profile minus the mean. Lengths must agree (unchecked).
  template <class = void>
  void subtract(Profile& p) const { p.value -= mean_; }

 private:
  int count_ = 0;
  Eigen::VectorXd mean_, squares_;
};

}  // namespace lumo

// ---- lumo/sense/force_estimator.hpp

namespace lumo {

/// Place and force of a contact from a camera and motors, as both deliver. Each `step` takes what has arrived and checks it; it waits no
/// longer than the camera's `next` does.
/// Whatever the streams do, the answer is finite and says what it rests on; a faulty frame or sample is left out, and `fault_hold_s` after the
/// last fault the state is ok again.
template <Camera Camera_, Actuator Actuator_, LocationEstimator Localizer, Readout Readout_ = GreenProfile, ContactJacobian Jacobian = MomentArm>
  requires std::same_as<typename Readout_::Sample, Frame>
class ForceEstimator {
  using JointVector = Dependent<lumo::JointVector, Jacobian>;
  using MatrixXd = Dependent<Eigen::MatrixXd, Jacobian>;
  using Vector2d = Dependent<Eigen::Vector2d, Jacobian>;
  using Matrix2d = Dependent<Eigen::Matrix2d, Jacobian>;

  static_assert(!std::same_as<Readout_, PositiveGreenProfile>,
      "frames are checked by their light against the unloaded finger's: the readout must be linear in it, as GreenProfile is");

 public:
  struct Config {
    FrameMonitor::Config frames;  ///< its positions and unloaded values are filled in where empty; exposure and gain of the reference, where known, are the caller's
    JointMonitor::Config joints;
    typename ContactFilter<Jacobian>::Config filter;
    std::vector<TorqueModel> torque{TorqueModel{}};  ///< one for each joint
    double frame_delay_s = 0.0;       ///< from the light to the stamp, known
    double joint_delay_s = 0.0;
    double frame_timeout_s = 0.2;
    double joint_timeout_s = 0.05;
    double fault_hold_s = 0.15;       ///< a fault is reported for this long
    double map_sigma_m = 0.0;         ///< of the map from image to finger (AxisMap::variance_m2); the same in all frames, so no filter lessens it
    double stiction_time_s = 0.5;     ///< how long a joint sticks on one side; assumed
    double smoothing_s = 0.01;        ///< time constant of the torques that forces of two contacts are from
    double known_location_m = 6.0_mm;  ///< standard deviation up to which y counts as known
    double known_force_N = 5.0;
    int max_frames = 4, max_samples = 256;  ///< taken in one step
  };

  /// Camera and actuator stay the caller's and must outlive the estimator. `unloaded` is of the same readout. Throws InvalidArgument for parts that do not fit.
  ForceEstimator(Camera_& camera, Actuator_& actuator, Readout_ readout, Localizer localizer, Jacobian jacobian, UnloadedReference unloaded, Config config);

  /// Takes all that has arrived and answers for the time `now_ns`, on the clock of the stamps.
  ForceEstimate step(std::int64_t now_ns);

  /// What the newest usable frame said.
  const LocationEstimate& location() const { return location_; }
  /// Its profile minus the unloaded one.
  const Profile& response() const { return profile_; }
  const ContactFilter<Jacobian>& filter() const { return filter_; }

 private:
  void take(const JointSample& s);
  void take(const Frame& f);
  void note(Faults faults) {
    for (unsigned i = 0; i < unsigned(Fault::count); ++i)
      if (faults.has(Fault(i))) fault_ns_[i] = now_ns_, faulty_[i] = true;
  }
  void note(Fault f) {
    Faults one;
    one.add(f);
    note(one);
  }
  bool within(bool seen, std::int64_t stamp_ns, double limit_s) const { return seen && 1e-9 * double(now_ns_ - stamp_ns) <= limit_s; }
  void describe_one(ForceEstimate& e) const;
  void describe_two(ForceEstimate& e, bool with_forces) const;

  Camera_* camera_;
  Actuator_* actuator_;
  Readout_ readout_;
  Localizer localizer_;
  UnloadedReference unloaded_;
  Config config_;
  FrameMonitor frame_monitor_;
  JointMonitor joint_monitor_;
  ContactFilter<Jacobian> filter_;
  Profile reading_, profile_;
  LocationEstimate location_;
  JointVector joint_q_, joint_torque_, joint_variance_;  ///< newest angles, smoothed contact torque and the variance of its noise
  std::array<std::int64_t, std::size_t(Fault::count)> fault_ns_{};
  std::array<bool, std::size_t(Fault::count)> faulty_{};
  std::int64_t now_ns_ = 0, frame_ns_ = 0, joint_ns_ = 0;
  bool begun_ = false, frame_seen_ = false, joint_seen_ = false;

  static FrameMonitor::Config completed(FrameMonitor::Config c, const Readout_& readout, const UnloadedReference& unloaded) {
    if (c.position_m.size() == 0) c.position_m = readout.positions_m();
    if (c.unloaded.size() == 0) c.unloaded = unloaded.mean();
    return c;
  }
};

template <Camera Camera_, Actuator Actuator_, LocationEstimator Localizer, Readout Readout_, ContactJacobian Jacobian>
  requires std::same_as<typename Readout_::Sample, Frame>
ForceEstimator<Camera_, Actuator_, Localizer, Readout_, Jacobian>::ForceEstimator(Camera_& camera, Actuator_& actuator, Readout_ readout, Localizer localizer,
                                                                                  Jacobian jacobian, UnloadedReference unloaded, Config config)
    : camera_(&camera),
      actuator_(&actuator),
      readout_(std::move(readout)),
      localizer_(std::move(localizer)),
      unloaded_(std::move(unloaded)),
      config_(std::move(config)),
      frame_monitor_(completed(config_.frames, readout_, unloaded_)),
      joint_monitor_(config_.joints),
      filter_(std::move(jacobian), config_.filter) {
  const int n = filter_.jacobian().joints();
  if (int(config_.torque.size()) != n || config_.joints.joints != n)
    throw InvalidArgument(detail::text("force estimator has ", n, " joints in its Jacobian, ", config_.torque.size(), " torque models and ", config_.joints.joints,
        " joints to watch"));
  if (unloaded_.mean().size() != readout_.positions_m().size())
    throw InvalidArgument(detail::text("unloaded reference has ", unloaded_.mean().size(), " values, the readout ", readout_.positions_m().size()));
  joint_q_ = joint_torque_ = joint_variance_ = JointVector::Zero(n);
  for (const TorqueModel& m : config_.torque) validate(m);
  require_in_range("delay of the frames", config_.frame_delay_s, -10.0, 10.0, "s");
  require_in_range("delay of the joint samples", config_.joint_delay_s, -10.0, 10.0, "s");
  require_in_range("time for which a fault is reported", config_.fault_hold_s, 0.0, 1e6, "s");
  require_in_range("time for which a joint sticks", config_.stiction_time_s, 0.0, 1e3, "s");
  require_positive("time over which torques are smoothed", config_.smoothing_s, "s");
  require_positive("frame timeout", config_.frame_timeout_s, "s");
  require_positive("joint timeout", config_.joint_timeout_s, "s");
  require_positive("location that counts as known", config_.known_location_m, "m");
  require_positive("force that counts as known", config_.known_force_N, "N");
  require_in_range("error of the map", config_.map_sigma_m, 0.0, 1.0, "m");
  require_in_range("frames in a step", config_.max_frames, 1, 1e6, "");
  require_in_range("samples in a step", config_.max_samples, 1, 1e6, "");
}

template <Camera Camera_, Actuator Actuator_, LocationEstimator Localizer, Readout Readout_, ContactJacobian Jacobian>
  requires std::same_as<typename Readout_::Sample, Frame>
void ForceEstimator<Camera_, Actuator_, Localizer, Readout_, Jacobian>::take(const JointSample& s) {
  const auto verdict = joint_monitor_.check(s, now_ns_);
  note(verdict.faults);
  if (!verdict.usable) return;
  const Eigen::Index n = s.effort.size();
  JointVector torque(n), variance(n);
  for (Eigen::Index j = 0; j < n; ++j) {
    const TorqueModel& m = config_.torque[std::size_t(j)];
    torque[j] = m.motor_torque(s.effort[j], s.unit) - m.unloaded(s.position_rad[j], s.velocity_rad_per_s[j]);
    const double stick = m.stiction_sigma(s.velocity_rad_per_s[j]);
    variance[j] = std::clamp(m.noise_Nm * m.noise_Nm + stick * stick * std::max(1.0, config_.stiction_time_s / config_.joints.period_s), 1e-12, 1e12);
  }
  filter_.add_torque(s.stamp_ns - std::int64_t(1e9 * config_.joint_delay_s), torque, variance);
  const double weight = joint_seen_ ? -std::expm1(-1e-9 * double(s.stamp_ns - joint_ns_) / config_.smoothing_s) : 1.0;
  joint_torque_ += weight * (torque - joint_torque_);
  joint_variance_ = (1.0 - weight) * (1.0 - weight) * joint_variance_ + weight * weight * variance;
  joint_q_ = s.position_rad;
  joint_ns_ = s.stamp_ns;
  joint_seen_ = true;
}

template <Camera Camera_, Actuator Actuator_, LocationEstimator Localizer, Readout Readout_, ContactJacobian Jacobian>
  requires std::same_as<typename Readout_::Sample, Frame>
void ForceEstimator<Camera_, Actuator_, Localizer, Readout_, Jacobian>::take(const Frame& f) {
  const auto time = frame_monitor_.check_time(f.stamp_ns, now_ns_);
  note(time.faults);
  if (!time.usable) return;
  if (!readout_.read(f, reading_)) return note(Fault::frame_corrupt);
  const auto light = frame_monitor_.check_light(reading_, f.exposure_s, f.gain);
  note(light.faults);
  if (!light.usable) return;
  std::swap(profile_, reading_);
  unloaded_.subtract(profile_);
  location_ = localizer_.update(profile_);
  const std::int64_t taken = f.stamp_ns - std::int64_t(1e9 * config_.frame_delay_s);
  if (location_.contacts == 0) filter_.add_no_contact(taken);
  if (location_.contacts == 1) {
    // The filter has the localiser's offset as a state, and takes noises as independent.
    const ContactLocation& c = location_.contact[0];
    filter_.add_location(taken, c.y_m, std::clamp(c.noise_variance_m2 > 0.0 ? c.noise_variance_m2 : c.variance_m2 - c.bias_variance_m2, 1e-10, 1.0));
  }
  frame_ns_ = f.stamp_ns;
  frame_seen_ = true;
}

template <Camera Camera_, Actuator Actuator_, LocationEstimator Localizer, Readout Readout_, ContactJacobian Jacobian>
  requires std::same_as<typename Readout_::Sample, Frame>
ForceEstimate ForceEstimator<Camera_, Actuator_, Localizer, Readout_, Jacobian>::step(std::int64_t now_ns) {
  if (!begun_) now_ns_ = frame_ns_ = joint_ns_ = now_ns;
  begun_ = true;
  now_ns_ = std::max(now_ns_, now_ns);
  for (int i = 0; i < config_.max_samples; ++i) {
    const auto s = actuator_->next();
    if (!s) break;
    take(*s);
  }
  for (int i = 0; i < config_.max_frames; ++i) {
    const auto f = camera_->next();
    if (!f) break;
    take(*f);
  }
  if (camera_->state() == StreamState::failed) note(Fault::camera_lost);
  if (actuator_->state() == StreamState::failed) note(Fault::actuator_lost);
  const bool frames = within(frame_seen_, frame_ns_, config_.frame_timeout_s), joints = within(joint_seen_, joint_ns_, config_.joint_timeout_s);
  if (!frames) note(Fault::frames_missing);
  if (!joints) note(Fault::joint_missing);

  ForceEstimate e;
  e.stamp_ns = now_ns_, e.frame_stamp_ns = frame_ns_, e.joint_stamp_ns = joint_ns_;
  for (unsigned i = 0; i < unsigned(Fault::count); ++i)
    if (faulty_[i] && 1e-9 * double(now_ns_ - fault_ns_[i]) <= config_.fault_hold_s) e.faults.add(Fault(i));
  using enum EstimatorState;
  e.state = frames && joints ? (e.faults.any() ? degraded : ok) : joints ? torque_only : frames ? vision_only : invalid;
  e.contacts = location_.contacts;
  if (e.contacts == 2 && frames)
    describe_two(e, joints);
  else
    describe_one(e);
  return e;
}

template <Camera Camera_, Actuator Actuator_, LocationEstimator Localizer, Readout Readout_, ContactJacobian Jacobian>
  requires std::same_as<typename Readout_::Sample, Frame>
void ForceEstimator<Camera_, Actuator_, Localizer, Readout_, Jacobian>::describe_one(ForceEstimate& e) const {
  ContactBelief b = filter_.at(now_ns_, joint_q_);
  const ContactPoint point{config_.filter.link, std::clamp(b.y_m, config_.filter.from_m, config_.filter.to_m)};
  const JointVector arm = filter_.jacobian().column(joint_q_, point), slope = filter_.jacobian().slope(joint_q_, point);
  const Vector2d shift(1.0, -b.force_N * slope.dot(arm) / std::max(arm.squaredNorm(), 1e-8));  // a shift of y moves F along the torque
  b.covariance += config_.map_sigma_m * config_.map_sigma_m * shift * shift.transpose();
  ContactForce& c = e.contact[0];
  c.y_variance_m2 = b.covariance(0, 0), c.force_variance_N2 = b.covariance(1, 1), c.covariance_m_N = b.covariance(0, 1);
  const double force = std::max(0.0, b.force_N);  // pads are pushed, not pulled
  if (e.state == EstimatorState::torque_only || e.state == EstimatorState::invalid) e.contacts = force > 3.0 * std::sqrt(c.force_variance_N2) ? 1 : 0;
  e.contacts = std::min(e.contacts, 1);
  if (std::sqrt(c.y_variance_m2) <= config_.known_location_m) c.y_m = point.y_m;
  if (std::sqrt(c.force_variance_N2) <= config_.known_force_N) c.force_N = force;
  // Directions of the posterior that are wider than what counts as known are open.
  const Vector2d unit(config_.known_location_m, config_.known_force_N);
  const Matrix2d scaled = unit.cwiseInverse().asDiagonal() * b.covariance * unit.cwiseInverse().asDiagonal();
  Eigen::SelfAdjointEigenSolver<Matrix2d> axes;
  axes.computeDirect(scaled);  // ascending
  e.rank = int((axes.eigenvalues().array() <= 1.0).count());
  e.null_directions = axes.eigenvectors();
}

template <Camera Camera_, Actuator Actuator_, LocationEstimator Localizer, Readout Readout_, ContactJacobian Jacobian>
  requires std::same_as<typename Readout_::Sample, Frame>
void ForceEstimator<Camera_, Actuator_, Localizer, Readout_, Jacobian>::describe_two(ForceEstimate& e, bool with_forces) const {
  const int link = config_.filter.link;
  const double map2 = config_.map_sigma_m * config_.map_sigma_m, force2 = config_.filter.force_prior_N * config_.filter.force_prior_N;
  std::array<ContactPoint, 2> points;
  for (std::size_t i = 0; i < 2; ++i) {
    points[i] = {link, location_.contact[i].y_m};
    e.contact[i].y_m = location_.contact[i].y_m;
    e.contact[i].y_variance_m2 = location_.contact[i].variance_m2 + map2;
    e.contact[i].force_variance_N2 = force2;
  }
  e.rank = 0;
  e.null_directions.setIdentity();
  if (!with_forces) return;

  JointVector torque = joint_torque_;
  for (int j = 0; j < int(torque.size()); ++j) torque[j] -= filter_.torque_offset(j);
  const double bias = config_.filter.torque_bias_Nm, sigma = std::sqrt(bias * bias + joint_variance_.maxCoeff());  // of the joint that is worst
  const Dependent<Identification, Jacobian> forces = solve_forces(filter_.jacobian(), joint_q_, torque, points, sigma);
  e.rank = int(forces.rank);
  e.null_directions.setZero();
  e.null_directions.rightCols(2 - forces.rank) = forces.null_space;
  // A place that is off by dy takes F a'(y) dy of torque for force: dF = −A⁺ a' F dy, with A⁺ = (AᵀA)⁺ Aᵀ. The map's error is the same for both.
  const MatrixXd inverse = forces.covariance / (sigma * sigma) * contact_columns(filter_.jacobian(), joint_q_, std::span<const ContactPoint>(points)).transpose();
  Matrix2d by_place;
  for (Eigen::Index i = 0; i < 2; ++i) by_place.col(i) = -forces.value[i] * (inverse * filter_.jacobian().slope(joint_q_, points[std::size_t(i)]));
  Matrix2d place = Matrix2d::Constant(map2);
  for (Eigen::Index i = 0; i < 2; ++i) place(i, i) += location_.contact[std::size_t(i)].variance_m2;
  const Matrix2d covariance = forces.covariance + by_place * place * by_place.transpose() + force2 * forces.null_space * forces.null_space.transpose();
  const Matrix2d mixed = place * by_place.transpose();  // of places with forces
  for (Eigen::Index i = 0; i < 2; ++i) {
    ContactForce& c = e.contact[std::size_t(i)];
    c.force_variance_N2 = covariance(i, i);
    c.covariance_m_N = mixed(i, i);
    if (forces.complete()) c.force_N = std::max(0.0, forces.value[i]);
  }
}

}  // namespace lumo

// ---- lumo/sense/force_baselines.hpp

namespace lumo {

/// One moment of a log at which a force is asked for: joints there, what was estimated of the place, and the truth to compare with.
struct ForceSample {
  std::int64_t stamp_ns = 0;
  JointVector position_rad, contact_torque_Nm;  ///< torque: motor minus torque model
  std::optional<double> estimated_y_m;          ///< of the localiser
  std::optional<double> fused_N;                ///< of the force estimator
  double true_y_m = 0.0, true_force_N = 0.0;
};

/// Mean absolute errors [N] of the ways to a force, over the samples for which each gave one.
struct ForceErrors {
  struct Error {
    double mae_N = 0.0;
    int samples = 0;
  };
  Error fused;           ///< the filter
  Error optical;         ///< sample by sample, at the localiser's place
  Error fixed_arm;       ///< at the middle of the tested range
  Error known_location;  ///< at the true place
  Error torque_only;     ///< from the ratio of torques; none where one joint does not tell
  struct Common {
    Error optical, fixed_arm, known_location;
  };
  Common common;  ///< over those samples for which all three gave one: what is hard to see must not count for one way only
  /// Share of the gap between fixed arm and known location that the optical location recovers (paper: 89.5 %), over the common samples; empty where there is
  /// no gap.
  std::optional<double> recovery() const {
    const double gap = common.fixed_arm.mae_N - common.known_location.mae_N;
    return common.optical.samples && gap > 0.0 ? std::optional((common.fixed_arm.mae_N - common.optical.mae_N) / gap) : std::nullopt;
  }
};

/// Contact torques of the joints at a time, interpolated in the joint log and moved to the frames' clock; nothing in gaps of more than `max_gap_s`.
class ContactTorques {
 public:
  /// Throws InvalidArgument for no samples, or models that do not fit the joints.
  ContactTorques(std::span<const JointSample> samples, const std::vector<TorqueModel>& models, const ClockMap& clock = {}, double delay_s = 0.0)
      : joints_(int(models.size())), series_(series(samples, models, clock, delay_s)) {}

  /// Positions, then torques.
  template <class VectorXd = Eigen::VectorXd>
  std::optional<Eigen::VectorXd> at(std::int64_t stamp_ns, double max_gap_s = 0.02) const { return series_.at(stamp_ns, max_gap_s); }
  int joints() const { return joints_; }
  /// RMS misfit of interpolation in position [rad] and torque [N·m], joint by joint.
  template <class VectorXd = Eigen::VectorXd>
  Eigen::VectorXd residual() const { return series_.interpolation_residual(); }

 private:
  static TimeSeries series(std::span<const JointSample> samples, const std::vector<TorqueModel>& models, const ClockMap& clock, double delay_s) {
    const auto n = Eigen::Index(models.size());
    std::vector<std::int64_t> stamp;
    Eigen::MatrixXd value(2 * n, Eigen::Index(samples.size()));
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const JointSample& s = samples[i];
      if (s.effort.size() != n || s.position_rad.size() != n || s.velocity_rad_per_s.size() != n)
        throw InvalidArgument(detail::text("contact torques: sample ", i, " has ", s.effort.size(), " joints, there are ", n, " models"));
      stamp.push_back(clock(s.stamp_ns) - std::llround(1e9 * delay_s));
      for (Eigen::Index j = 0; j < n; ++j) {
        const TorqueModel& m = models[std::size_t(j)];
        value(j, Eigen::Index(i)) = s.position_rad[j];
        value(n + j, Eigen::Index(i)) = m.motor_torque(s.effort[j], s.unit) - m.unloaded(s.position_rad[j], s.velocity_rad_per_s[j]);
      }
    }
    if (stamp.empty() || n == 0) throw InvalidArgument("contact torques: no samples or no joints");
    return {std::move(stamp), std::move(value)};
  }

  int joints_;
  TimeSeries series_;
};

/// Compares the ways to a force on the same samples. `from_m`, `to_m`: the tested range, whose middle is the fixed arm. Forces are taken as at least 0, for
/// all ways alike.
template <ContactJacobian J>
ForceErrors force_errors(const J& jacobian, std::span<const ForceSample> samples, int link, double from_m, double to_m, double torque_sigma_Nm) {
  require_in_range("end of the tested range", to_m, from_m, 10.0, "m");
  ForceErrors e;
  const auto count = [](ForceErrors::Error& error, double force, double truth) {
    error.mae_N += (std::abs(std::max(0.0, force) - truth) - error.mae_N) / double(++error.samples);
  };
  for (const ForceSample& s : samples) {
    const auto at = [&](ForceErrors::Error& error, double y) {
      const ContactPoint point{link, y};
      const Identification f = solve_forces(jacobian, s.position_rad, s.contact_torque_Nm, std::span(&point, 1), torque_sigma_Nm);
      if (f.complete()) count(error, f.value[0], s.true_force_N);
      return f.complete() ? std::optional(f.value[0]) : std::nullopt;
    };
    if (s.fused_N) count(e.fused, *s.fused_N, s.true_force_N);
    const auto optical = s.estimated_y_m ? at(e.optical, *s.estimated_y_m) : std::nullopt;
    const auto fixed = at(e.fixed_arm, 0.5 * (from_m + to_m)), known = at(e.known_location, s.true_y_m);
    if (optical && fixed && known)
      count(e.common.optical, *optical, s.true_force_N), count(e.common.fixed_arm, *fixed, s.true_force_N), count(e.common.known_location, *known, s.true_force_N);
    const TorqueOnlySolution alone = solve_torque_only(jacobian, s.position_rad, s.contact_torque_Nm, link, from_m, to_m, torque_sigma_Nm);
    if (alone.rank == 2) count(e.torque_only, alone.force_N, s.true_force_N);
  }
  return e;
}

}  // namespace lumo

// ---- lumo/sense/calibration.hpp

namespace lumo {

/// Stiffness of one specimen against the nominal one, from a press curve.
struct StiffnessFit {
  Interval factor;         ///< of the nominal shear modulus (λ/μ kept), 95 %
  double onset_m = 0.0;    ///< of the marker, where the nominal curve begins
  double residual_N = 0.0;  ///< RMS
};

/// Fits force = factor · nominal(depth − onset). `nominal_N`: force of the nominal pad at a depth [m], 0 below 0, increasing: with the ratio of moduli kept, force is
/// proportional to the modulus at given depth. Samples of one press are not independent (the silicone creeps, the servo swings), so that the
/// interval counts `independent` of them (0: all). Throws InvalidArgument for fewer than three samples in contact, or ones that do not tell both.
template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd, class Vector2d = Eigen::Vector2d>
StiffnessFit fit_stiffness(std::span<const double> depth_m, std::span<const double> force_N, const std::function<double(double)>& nominal_N, int independent = 0);

/// Photon transfer of a camera (EMVA 1288): temporal variance of pixels over their signal. Row offsets and common changes of the lamps are taken out of each
/// pair of frames, fixed patterns fall out of their difference.
class PhotonTransfer {
 public:
  struct Result {
    Interval gain_DN_per_electron;   ///< slope, 95 %
    double dark_sigma_DN = 0.0;      ///< at no signal: read-out and the steps of 8 bits
  };

  /// One frame; the next one makes a pair with it. Throws InvalidArgument for another size or format.
  void add(const ImageView& v);
  /// From pixels with a mean below `full_DN` (above, the top of the range cuts the noise). Linear cameras only. Throws InvalidArgument for fewer than 8 pairs
  /// or signals that are all alike.
  template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd, class Vector2d = Eigen::Vector2d, class Matrix2d = Eigen::Matrix2d>
  Result result(double black_DN = 0.0, double full_DN = 230.0) const;
  int pairs() const { return std::max(0, frames_ - 1); }

 private:
  Image last_;
  int frames_ = 0;
  std::vector<double> sum_, squares_;  ///< of the values; of the differences
};

/// Light of the lamps alone, from pictures with and without them: mean difference over pixels that are lit at all [DN], and what that is in electrons.
struct LampLevel {
  double level_DN = 0.0;
  Interval electrons;  ///< a pixel and exposure, 95 %; flux, lens and exposure in one: a picture does not tell them apart
};

/// `lit` and `dark` are mean pictures of one view. Throws InvalidArgument for sizes that differ, or no light.
inline LampLevel lamp_level(const ImageView& lit, const ImageView& dark, const Interval& gain_DN_per_electron) {
  if (lit.empty() || lit.width != dark.width || lit.height != dark.height) throw InvalidArgument("lamp level: the lit and the dark picture must have one size");
  std::vector<double> difference;
  for (int y = 0; y < lit.height; ++y)
    for (int x = 0; x < lit.width; ++x) difference.push_back(double(lit.green(x, y)) - dark.green(x, y));
  const double half = 0.5 * quantile(difference, 0.98);
  double sum = 0.0;
  int count = 0;
  for (const double d : difference)
    if (d > half) sum += d, ++count;
  if (!(half > 0.5) || count == 0) throw InvalidArgument("lamp level: the lit picture is no brighter than the dark one");
  const double level = sum / count;
  return {level, {level / gain_DN_per_electron.value, level / gain_DN_per_electron.high, level / gain_DN_per_electron.low}};
}

template <class MatrixXd, class VectorXd, class Vector2d>
inline StiffnessFit fit_stiffness(std::span<const double> depth_m, std::span<const double> force_N, const std::function<double(double)>& nominal_N, int independent) {
  if (depth_m.size() != force_N.size()) throw InvalidArgument(detail::text("press curve has ", depth_m.size(), " depths and ", force_N.size(), " forces, must have as many"));
  const auto n = Eigen::Index(depth_m.size());
  StiffnessFit fit{{1.0, 1.0, 1.0}, 0.0, 0.0};
  constexpr double step_m = 1e-6;
  MatrixXd a(n, 2);
  VectorXd left(n);
  Identification last;
  for (int k = 0; k < 30; ++k) {
    for (Eigen::Index i = 0; i < n; ++i) {
      const double d = depth_m[std::size_t(i)] - fit.onset_m, f = nominal_N(d);
      a(i, 0) = f, a(i, 1) = -fit.factor.value * (nominal_N(d + step_m) - nominal_N(d - step_m)) / (2.0 * step_m);
      left[i] = force_N[std::size_t(i)] - fit.factor.value * f;
    }
    if ((a.col(0).array() > 0.0).count() < 3) throw InvalidArgument("press curve: fewer than three samples in contact");
    last = identify(a, left, Vector2d(1.0, 1e-4), 0.0, 1e-4);
    if (!last.complete()) throw InvalidArgument("press curve does not tell stiffness and onset apart");
    fit.factor.value = std::max(0.01, fit.factor.value + last.value[0]);
    fit.onset_m += std::clamp(last.value[1], -1e-3, 1e-3);
    if (std::abs(last.value[0]) < 1e-9 && std::abs(last.value[1]) < 1e-11) break;
  }
  fit.residual_N = last.residual;
  const double alike = independent > 0 ? std::max(1.0, double(n) / independent) : 1.0, sigma = std::sqrt(alike * last.covariance(0, 0));
  fit.factor.low = fit.factor.value - 1.96 * sigma, fit.factor.high = fit.factor.value + 1.96 * sigma;
  return fit;
}

inline void PhotonTransfer::add(const ImageView& v) {
  if (v.empty()) throw InvalidArgument("photon transfer: a picture is empty");
  const auto n = std::size_t(v.width) * std::size_t(v.height);
  if (frames_ == 0) sum_.assign(n, 0.0), squares_.assign(n, 0.0);
  if (frames_ > 0 && (v.width != last_.width || v.height != last_.height)) throw InvalidArgument("photon transfer: pictures must have one size");
  const Image before = last_;
  last_ = Image::black(v.width, v.height, PixelFormat::grey);
  std::vector<double> difference(std::size_t(v.width));
  for (int y = 0; y < v.height; ++y) {
    double mean = 0.0;
    for (int x = 0; x < v.width; ++x) {
      const std::uint8_t g = v.green(x, y);
      last_.row(y)[x] = g;
      sum_[std::size_t(y) * std::size_t(v.width) + std::size_t(x)] += g;
      if (frames_ > 0) difference[std::size_t(x)] = double(g) - before.view().row(y)[x], mean += difference[std::size_t(x)] / v.width;
    }
    if (frames_ > 0)
      for (int x = 0; x < v.width; ++x) squares_[std::size_t(y) * std::size_t(v.width) + std::size_t(x)] += 0.5 * std::pow(difference[std::size_t(x)] - mean, 2) * v.width / (v.width - 1.0);
  }
  ++frames_;
}

template <class MatrixXd, class VectorXd, class Vector2d, class Matrix2d>
inline PhotonTransfer::Result PhotonTransfer::result(double black_DN, double full_DN) const {
  if (pairs() < 8) throw InvalidArgument(detail::text("photon transfer has ", pairs(), " pairs of pictures, must have at least 8"));
  std::vector<double> signal, variance;
  for (std::size_t i = 0; i < sum_.size(); ++i)
    if (const double mean = sum_[i] / frames_; mean < full_DN && mean > black_DN + 1.0) signal.push_back(mean - black_DN), variance.push_back(squares_[i] / pairs());
  const auto n = Eigen::Index(signal.size());
  const double low = signal.empty() ? 0.0 : quantile(signal, 0.02), high = signal.empty() ? 0.0 : quantile(signal, 0.98);
  if (n < 100 || !(high > 1.5 * low + 5.0)) throw InvalidArgument("photon transfer: signals are all alike, they tell no slope");
  // Variance of a variance is 2 σ⁴/pairs: weights by the signal, from a first look.
  Vector2d line(0.5, 0.02);
  Identification fit;
  for (int k = 0; k < 4; ++k) {
    MatrixXd a(n, 2);
    VectorXd b(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const double weight = 1.0 / std::max(line[0] + line[1] * signal[std::size_t(i)], 0.05);
      a.row(i) << weight, weight * signal[std::size_t(i)];
      b[i] = weight * variance[std::size_t(i)];
    }
    // Normal equations: pixels are many, parameters two.
    const Matrix2d normal = a.transpose() * a;
    const Matrix2d inverse = normal.inverse();
    line = inverse * (a.transpose() * b);
    fit.covariance = (a * line - b).squaredNorm() / double(n - 2) * inverse;
  }
  const double sigma = std::sqrt(fit.covariance(1, 1));
  return {{line[1], line[1] - 1.96 * sigma, line[1] + 1.96 * sigma}, std::sqrt(std::max(line[0], 0.0))};
}

}  // namespace lumo

// ---- lumo/sense/finger_view.hpp

namespace lumo {

/// When a log's finger is known to be unloaded before the first contact: the first segment of kind "unloaded"; without one the first half second.
struct UnloadedStretch {
  std::int64_t from_ns = 0, to_ns = 0;

  static UnloadedStretch of(const Session& s, std::int64_t first_frame_ns) {
    const auto known = std::find_if(s.segments.begin(), s.segments.end(), [](const Segment& g) { return g.kind == "unloaded"; });
    return known == s.segments.end() ? UnloadedStretch{first_frame_ns, first_frame_ns + 500'000'000} : UnloadedStretch{known->from_ns, known->to_ns};
  }
  bool holds(std::int64_t stamp_ns) const { return stamp_ns >= from_ns && stamp_ns <= to_ns; }
};

/// Mean of pictures of one size and format; what differs from the first is left out.
class MeanImage {
 public:
  void add(const ImageView& v) {
    if (v.empty()) return;
    const std::size_t bytes = std::size_t(v.width) * std::size_t(channels(v.format));
    if (count_ == 0) mean_ = Image::black(v.width, v.height, v.format), sum_.assign(bytes * std::size_t(v.height), 0);
    if (v.width != mean_.width || v.height != mean_.height || v.format != mean_.format || count_ >= 1 << 16) return;
    ++count_;
    for (int y = 0; y < v.height; ++y)
      for (std::size_t x = 0; x < bytes; ++x) sum_[std::size_t(y) * bytes + x] += v.row(y)[x];
  }
  int count() const { return count_; }
  /// Rounded. Empty when nothing was added.
  Image image() const {
    Image m = mean_;
    for (std::size_t i = 0; i < sum_.size(); ++i) m.pixels[i] = std::uint8_t((sum_[i] + std::uint32_t(count_) / 2) / std::uint32_t(count_));
    return m;
  }

 private:
  Image mean_;
  std::vector<std::uint32_t> sum_;
  int count_ = 0;
};

/// How a finger lies in a camera's pictures: the map along it from its LEDs, and the band to both sides that is lit.
struct FingerView {
  LedDetection leds;
  double band_low_m = 0.0, band_high_m = 0.0;  ///< as GreenProfile::Config
  int width = 0, height = 0;
  PixelFormat format = PixelFormat::bgr;

  template <class = void>
  GreenProfile readout(const LongitudinalBins& bins) const { return GreenProfile({leds.map, bins, band_low_m, band_high_m, width, height, format}); }
};

/// The stretch across the finger, about its row of LEDs, that has at least half of the row's light above the darkest surroundings. Across: positive clockwise of
/// the tip's direction in the image, in m at the map's scale.
template <class Vector2d = Eigen::Vector2d>
inline std::pair<double, double> lit_band(const ImageView& unloaded, const AxisMap& map, double half_range_m = 22.0e-3) {
  const double scale = map.scale_m_per_px(map.u_px(0.0));
  const int reach = std::max(unloaded.width, unloaded.height);
  std::vector<double> sum(std::size_t(2 * reach + 1), 0.0), count = sum;
  for (int y = 0; y < unloaded.height; ++y)
    for (int x = 0; x < unloaded.width; ++x) {
      const Vector2d p = Vector2d(x, y) - map.origin_px;
      if (std::abs(map.y_m(p.dot(map.direction))) > half_range_m) continue;
      const long across = std::lround(-p.x() * map.direction.y() + p.y() * map.direction.x());
      if (std::abs(across) > reach) continue;
      sum[std::size_t(across + reach)] += unloaded.green(x, y), count[std::size_t(across + reach)] += 1.0;
    }
  const double most = *std::max_element(count.begin(), count.end());
  double dark = 255.0;
  for (std::size_t i = 0; i < sum.size(); ++i)
    if (count[i] > 0.5 * most) dark = std::min(dark, sum[i] / count[i]);
  // The row itself shines; what is lit beside it is what counts.
  std::vector<double> near;
  for (int k = -8; k <= 8; ++k)
    if (const auto i = std::size_t(k + reach); count[i] > 0.5 * most) near.push_back(sum[i] / count[i]);
  const double limit = dark + 0.5 * (median(near) - dark);
  const auto lit = [&](int k) { return count[std::size_t(k + reach)] > 0.5 * most && sum[std::size_t(k + reach)] / count[std::size_t(k + reach)] >= limit; };
  int low = 0, high = 0;
  while (low > -reach && lit(low - 1)) --low;
  while (high < reach && lit(high + 1)) ++high;
  return {scale * (low - 0.5), scale * (high + 0.5)};
}

/// From a picture of the unloaded finger. Throws InputError when its LEDs are not seen, with `name` before the message.
template <class = void>
inline FingerView view_finger(const ImageView& unloaded, const Session& session, const std::string& name) {
  std::optional<LedDetection> leds;
  if (!unloaded.empty()) leds = LedDetector{session.led_count, session.led_pitch_m, session.led_first_y_m, session.distal}.find(unloaded);
  if (!leds) throw InputError(detail::text(name, ": no row of ", session.led_count, " LEDs is seen in the pictures of the unloaded finger"));
  const auto [low, high] = lit_band(unloaded, leds->map);
  return {*leds, low, high, unloaded.width, unloaded.height, unloaded.format};
}

/// Mean picture of the unloaded stretch, and the finger in it. Throws InputError.
template <Camera C>
FingerView view_finger(C& camera, const Session& session, const UnloadedStretch& stretch, const std::string& name) {
  MeanImage mean;
  for (auto f = camera.next(); f && f->stamp_ns <= stretch.to_ns; f = camera.next())
    if (stretch.holds(f->stamp_ns)) mean.add(f->image);
  if (mean.count() == 0) throw InputError(detail::text(name, ": has no picture of the unloaded finger"));
  return view_finger(mean.image().view(), session, name);
}

/// Profiles of all frames that the readout can read.
template <Camera C>
std::vector<Profile> read_profiles(C& camera, GreenProfile& readout) {
  std::vector<Profile> list;
  Profile p;
  for (auto f = camera.next(); f; f = camera.next())
    if (readout.read(*f, p)) list.push_back(p);
  return list;
}

/// Of the profiles in the unloaded stretch. Throws InputError when there are none.
template <class = void>
inline UnloadedReference unloaded_reference(const std::vector<Profile>& profiles, const UnloadedStretch& stretch, const std::string& name) {
  UnloadedReference reference;
  for (const Profile& p : profiles)
    if (stretch.holds(p.stamp_ns)) reference.add(p);
  if (reference.count() == 0) throw InputError(detail::text(name, ": has no picture of the unloaded finger"));
  return reference;
}

}  // namespace lumo

// ---- lumo/sense/normal_force.hpp

namespace lumo {

/// What presses the finger over time: one channel [N], less `tare_N`. Stamps are moved by `clock`: Session::wrench_clock leads onto the frames'.
/// Throws InvalidArgument where that leaves two samples at the same time.
inline TimeSeries normal_force(const std::vector<WrenchSample>& wrenches, const ClockMap& clock = {}, double tare_N = 0.0) {
  std::vector<std::int64_t> stamp_ns;
  Eigen::MatrixXd force_N(1, Eigen::Index(wrenches.size()));
  for (const WrenchSample& w : wrenches) {
    force_N(0, Eigen::Index(stamp_ns.size())) = w.normal_force_N() - tare_N;
    stamp_ns.push_back(clock(w.stamp_ns));
  }
  return {std::move(stamp_ns), std::move(force_N)};
}

}  // namespace lumo

// ---- lumo/sense/log_truth.hpp

namespace lumo {

/// What a log says of the contacts that its estimates are compared with. Only whoever compares reads it.
class LogTruth {
 public:
  struct Touch {
    std::optional<double> y_m, force_N;
  };

  /// From the jig's places (segments) and the force sensor. The sensor is tared on what it reads where segments say unloaded.
  /// Throws InvalidArgument where the session's clock leads two of its samples to the same time.
  static LogTruth from_log(const Session& session, const std::vector<WrenchSample>& wrenches) {
    LogTruth t;
    t.segments_ = session.segments;
    double tare = 0.0;
    long count = 0;
    for (const WrenchSample& w : wrenches) {
      const std::int64_t at = session.wrench_clock(w.stamp_ns);
      for (const Segment& s : t.segments_)
        if (s.kind == "unloaded" && at >= s.from_ns && at <= s.to_ns) tare += w.normal_force_N(), ++count;
    }
    t.force_ = normal_force(wrenches, session.wrench_clock, count > 0 ? tare / double(count) : 0.0);
    return t;
  }
  /// From a lab's truth.csv: stamp_ns, contact, y_mm, force_N and columns that are not read. Throws InputError.
  static LogTruth from_table(std::istream& in, const std::string& name) {
    CsvReader csv(in, name);
    detail::StampColumn stamp(csv);
    const int contact = csv.require("contact"), y = csv.require("y_mm"), force = csv.require("force_N");
    LogTruth t;
    while (csv.next()) {
      const std::int64_t at = stamp.read(csv);
      t.table_.push_back({at, {csv.integer(contact) < 0 ? std::nullopt : std::optional(1e-3 * csv.number(y)), csv.number(force)}});
    }
    return t;
  }

  /// Place and force at a time; empty is what is not known there. No contact: a force of 0 where that is known, and no place.
  Touch at(std::int64_t stamp_ns) const {
    if (!force_) {
      const auto row = std::lower_bound(table_.begin(), table_.end(), stamp_ns, [](const auto& r, std::int64_t t) { return r.first < t; });
      return row != table_.end() && row->first == stamp_ns ? row->second : Touch{};
    }
    Touch touch;
    if (const auto f = force_->at(stamp_ns, 0.1)) touch.force_N = (*f)[0];
    for (const Segment& s : segments_)
      if (s.place >= 0 && stamp_ns >= s.from_ns && stamp_ns <= s.to_ns) {
        touch.y_m = 1e-3 * s.y_mm;
        if (!touch.force_N) touch.force_N = s.load_N;
      }
    return touch;
  }

 private:
  std::optional<TimeSeries> force_;                     ///< of a log's sensor; none of a table
  std::vector<Segment> segments_;
  std::vector<std::pair<std::int64_t, Touch>> table_;
};

}  // namespace lumo

// ---- lumo/sense/replay.hpp

namespace lumo {

/// A recorded stream given as it came: nothing is there before its time. One item is read ahead, so that reading a picture does not count to whoever asks for it.
template <class Source>
class Replay {
 public:
  explicit Replay(Source source) : source_(std::move(source)), ahead_(source_.next()) {}

  /// Lets all up to this time through.
  void until(std::int64_t now_ns) {
    now_ns_ = now_ns;
    if (!ahead_) ahead_ = source_.next();
  }
  auto next() {
    if (!ahead_ || ahead_->stamp_ns > now_ns_) return decltype(ahead_)();
    auto item = std::move(ahead_);
    ahead_.reset();
    if constexpr (Actuator<Source>) ahead_ = source_.next();  // owns what it gives; a picture stays valid until the next one is read
    return item;
  }
  StreamState state() const { return ahead_ ? StreamState::open : source_.state(); }

 private:
  Source source_;
  decltype(std::declval<Source&>().next()) ahead_;
  std::int64_t now_ns_ = INT64_MIN;
};

}  // namespace lumo

// ---- lumo/sense/standstill.hpp

namespace lumo {

/// How far the torque of an unloaded joint at rest is off the model: RMS over the rests of a run of each rest's mean [N·m]. What sticks is another at each
/// rest, and under a contact it adds to the contact's torque unseen. Rests count from 0.1 s on. Nothing for fewer than three.
inline std::optional<double> standstill_scatter(std::span<const JointSample> samples, int joint, const TorqueModel& model) {
  double squares = 0.0, sum = 0.0;
  int rests = 0, count = 0;
  std::int64_t from = 0, last = 0;
  const auto close = [&] {
    if (count >= 3 && 1e-9 * double(last - from) >= 0.1) squares += std::pow(sum / count, 2), ++rests;
    sum = 0.0, count = 0;
  };
  for (const JointSample& s : samples) {
    if (std::abs(s.velocity_rad_per_s[joint]) > 1.5 * model.rest_velocity_rad_per_s) {
      close();
      continue;
    }
    if (count == 0) from = s.stamp_ns;
    last = s.stamp_ns;
    sum += model.motor_torque(s.effort[joint], s.unit) - model.unloaded(s.position_rad[joint], 0.0);
    ++count;
  }
  close();
  return rests >= 3 ? std::optional(std::sqrt(squares / rests)) : std::nullopt;
}

}  // namespace lumo

// ---- lumo/sense/log_estimates.hpp

namespace lumo {

/// An estimate at one frame of a log, and later what was true there.
struct LogEstimate {
  std::int64_t stamp_ns = 0;
  LocationEstimate location;                 ///< of the localiser
  ForceEstimate force;                       ///< of the filter
  std::optional<Eigen::VectorXd> joints;     ///< positions, then contact torques, interpolated
  double seconds = 0.0;                      ///< from decoded picture to estimate
};

/// Knowledge of a log's finger from its unloaded stretch: what estimators start from.
struct LogReference {
  FingerView view;
  UnloadedReference unloaded;
  std::vector<TorqueModel> torque;           ///< of each joint; none without joint samples
  std::vector<double> standstill_Nm;         ///< what may stick unseen
};

/// The probabilistic localiser for a whole finger. Contacts are sought on the pad's regions only: one near a free end lights the pad up to its end, and a bump that may lie
/// beyond it would be put there. `bias_m`: how far bumps lie from contacts; chosen after seeds 1 to 10 of the virtual lab were seen, so these do not judge it.
template <class = void>
inline BayesLocalizer::Config finger_localizer(const GreenProfile& readout, const UnloadedReference& unloaded, double bias_m = 1.2_mm) {
  BayesLocalizer::Config c;
  c.position_m = readout.positions_m(), c.noise = unloaded.noise(), c.unloaded = unloaded.mean();
  c.from_m = -27.5_mm, c.to_m = 27.5_mm;
  c.bias_sigma_m = bias_m;
  return c;
}

/// Localises in profiles of a log. Frames that cannot be read are left out.
template <LocationEstimator L>
std::vector<LogEstimate> locate(const std::vector<Profile>& profiles, const UnloadedReference& unloaded, L localizer) {
  std::vector<LogEstimate> list;
  for (Profile p : profiles) {
    unloaded.subtract(p);
    LogEstimate e;
    e.stamp_ns = p.stamp_ns;
    e.location = localizer.update(p);
    list.push_back(std::move(e));
  }
  return list;
}

/// Friction, weight and offset of each joint from all samples before `until_ns` (frames' clock), which must be without contact; what moves tells of friction,
/// what rests of what sticks. `start`: what such a run does not tell.
template <class = void>
inline void identify_joints(LogReference& reference, const std::vector<JointSample>& samples, const Session& session, std::int64_t until_ns) {
  std::vector<JointSample> free, moving;
  for (const JointSample& s : samples)
    if (s.stamp_ns <= until_ns) {
      free.push_back(s);
      if (s.velocity_rad_per_s.cwiseAbs().maxCoeff() > 0.05) moving.push_back(s);
    }
  if (free.empty()) return;
  const auto joints = int(free.front().effort.size());
  for (int j = 0; j < joints; ++j) {
    TorqueModel start;
    start.torque_constant_Nm_per_A = session.torque_constant_Nm_per_A[std::size_t(j)];
    reference.torque.push_back(identify_unloaded(moving.size() >= 100 ? moving : free, j, start).model);
    reference.standstill_Nm.push_back(standstill_scatter(free, j, reference.torque.back()).value_or(0.02));
  }
}

/// Plays a log to the force estimator as it came, one step at each frame. `make_camera()` gives the log's camera from its start; `samples` are on the frames' clock.
/// Throws InputError without joint samples, InvalidArgument for parts that do not fit.
template <class MakeCamera, LocationEstimator L, ContactJacobian J>
std::vector<LogEstimate> estimate_forces(MakeCamera make_camera, const std::vector<JointSample>& samples, const std::vector<std::int64_t>& frame_ns, const LogReference& reference,
                                         const LongitudinalBins& bins, const L& localizer, const J& jacobian, const Session& session, double map_sigma_m = 0.0) {
  if (samples.size() < 2 || reference.torque.empty()) throw InputError("the log has no joint samples to estimate a force from");
  using Source = decltype(make_camera());
  Replay<Source> camera(make_camera());
  Replay<RecordedActuator> actuator{RecordedActuator(samples)};
  using Estimator = ForceEstimator<Replay<Source>, Replay<RecordedActuator>, L, GreenProfile, J>;
  typename Estimator::Config config;
  config.torque = reference.torque;
  config.joints.joints = int(reference.torque.size());
  config.joints.period_s = 1e-9 * double(samples.back().stamp_ns - samples.front().stamp_ns) / double(samples.size() - 1);
  config.joints.spike = 6.0 * std::max(0.05, reference.torque.front().noise_Nm / reference.torque.front().torque_constant_Nm_per_A);
  if (frame_ns.size() > 1) config.frames.period_s = 1e-9 * double(frame_ns.back() - frame_ns.front()) / double(frame_ns.size() - 1);
  config.filter.torque_bias_Nm = std::max(0.005, *std::max_element(reference.standstill_Nm.begin(), reference.standstill_Nm.end()));
  config.filter.torque_bias_s = 0.5;  // what sticks at rest tells nothing of what sticks under the next contact
  config.frame_delay_s = session.frame_delay_s, config.joint_delay_s = session.joint_delay_s;
  config.frame_timeout_s = std::max(0.2, 4.0 * config.frames.period_s), config.joint_timeout_s = std::max(0.05, 10.0 * config.joints.period_s);
  config.map_sigma_m = map_sigma_m;
  Estimator estimator(camera, actuator, reference.view.readout(bins), localizer, jacobian, reference.unloaded, config);
  const ContactTorques torques(samples, reference.torque);
  std::vector<LogEstimate> list;
  for (const std::int64_t now : frame_ns) {
    camera.until(now);
    actuator.until(now);
    LogEstimate e;
    e.stamp_ns = now;
    const auto from = std::chrono::steady_clock::now();
    e.force = estimator.step(now);
    e.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - from).count();
    e.location = estimator.location();
    e.joints = torques.at(now, std::max(0.02, 5.0 * config.joints.period_s));
    list.push_back(std::move(e));
  }
  return list;
}

/// How well places agree with the truth, over frames with a true force of at least `from_N` where the truth tells the place.
struct LocationScore {
  int samples = 0;       ///< frames to be located
  int located = 0;       ///< of them, those with exactly one contact found
  double mae_m = 0.0;    ///< over the located ones
  double coverage_90 = 0.0;  ///< share of the located ones whose 90 % interval holds the truth
};

template <class PlaceOf>
LocationScore location_score(const std::vector<LogEstimate>& estimates, const LogTruth& truth, double from_N, PlaceOf place_of) {
  LocationScore s;
  int covered = 0;
  for (const LogEstimate& e : estimates) {
    const LogTruth::Touch t = truth.at(e.stamp_ns);
    if (!t.y_m || !t.force_N || *t.force_N < from_N) continue;
    ++s.samples;
    const std::optional<ContactLocation> at = place_of(e);
    if (!at) continue;
    ++s.located;
    const double off = std::abs(at->y_m - *t.y_m);
    s.mae_m += off;
    covered += off <= 1.6448536269514722 * std::sqrt(at->variance_m2);
  }
  if (s.located > 0) s.mae_m /= s.located, s.coverage_90 = double(covered) / s.located;
  return s;
}

/// Errors of forces over the frames with a true force of at least `from_N`. Where the localiser saw no single contact the optical way takes the middle of the
/// tested range, so that all ways stand on the same samples.
struct ForceScore {
  ForceErrors errors;
  int samples = 0;
  double coverage_90 = 0.0;  ///< of the fused force's 90 % interval
};

template <ContactJacobian J>
ForceScore force_score(const std::vector<LogEstimate>& estimates, const LogTruth& truth, const J& jacobian, double from_m, double to_m, double torque_sigma_Nm, double from_N = 0.5) {
  std::vector<ForceSample> samples;
  int given = 0, covered = 0;
  for (const LogEstimate& e : estimates) {
    const LogTruth::Touch t = truth.at(e.stamp_ns);
    if (!t.y_m || !t.force_N || *t.force_N < from_N || !e.joints) continue;
    ForceSample s;
    const Eigen::Index n = e.joints->size() / 2;
    s.stamp_ns = e.stamp_ns, s.position_rad = e.joints->head(n), s.contact_torque_Nm = e.joints->tail(n), s.true_y_m = *t.y_m, s.true_force_N = *t.force_N;
    s.estimated_y_m = e.location.contacts == 1 ? e.location.contact[0].y_m : 0.5 * (from_m + to_m);
    const ContactForce& fused = e.force.contact[0];
    s.fused_N = fused.force_N;
    if (fused.force_N) ++given, covered += std::abs(*fused.force_N - *t.force_N) <= 1.6448536269514722 * std::sqrt(fused.force_variance_N2);
    samples.push_back(std::move(s));
  }
  ForceScore score;
  score.samples = int(samples.size());
  if (!samples.empty()) score.errors = force_errors(jacobian, std::span<const ForceSample>(samples), 0, from_m, to_m, torque_sigma_Nm);
  score.coverage_90 = given > 0 ? double(covered) / given : 0.0;
  return score;
}

}  // namespace lumo

// ---- lumo/campaign/ensemble.hpp

namespace lumo {

/// All combinations of diameters, approach angles (in one plane) and places along the finger, at the same loads.
struct Ensemble {
  std::vector<double> diameters_m = {10e-3, 15e-3, 20e-3, 30e-3};
  std::vector<double> angles_rad = {0.0};
  std::vector<double> places_m = {-22e-3, -11e-3, -5.5e-3, 0.0, 5.5e-3, 11e-3, 22e-3};
  std::vector<double> loads_N = {1.0, 2.0, 5.0, 10.0, 15.0};
  TiltPlane tilt = TiltPlane::xz;

  std::vector<Scenario<Sphere>> scenarios() const {
    std::vector<Scenario<Sphere>> all;
    for (double d : diameters_m)
      for (double a : angles_rad)
        for (double y : places_m) all.push_back({Sphere{d}, a, y, loads_N, tilt});
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

/// A scenario as the mirror image of one that is solved.
struct ScenarioImage {
  std::size_t solve;           ///< which solve it comes from
  Symmetry mirror;             ///< in which planes it is reflected
};

/// Which scenarios have to be solved when mirror images are solved once.
template <Indenter Tool = Sphere>
struct ContactPlan {
  struct Solve {
    Scenario<Tool> scenario;     ///< with angle ≥ 0 and y ≥ 0 where mirror images are solved once
    std::size_t place;           ///< index into `places`
  };
  /// Contacts at one angle and place share a mesh.
  struct Place {
    double angle_rad, y_m;
    TiltPlane tilt;
    std::vector<std::size_t> solves;
  };
  std::vector<Solve> solves;
  std::vector<ScenarioImage> images;  ///< one per scenario
  std::vector<Place> places;
};

namespace detail {

/// Planes in which a contact is to be mirrored, of those that are allowed, so that of all its images always the same one is left: y ≥ 0, angle ≥ 0.
template <Indenter Tool>
Symmetry to_first_image(const Scenario<Tool>& s, Symmetry allowed) {
  const bool along = s.tilt == TiltPlane::yz, back = s.angle_rad < 0.0;
  return {allowed.x && !along && back, allowed.y && (s.y_m < 0.0 || (along && s.y_m == 0.0 && back))};
}

}  // namespace detail

/// `symmetry`: of the body; `once`: planes in which one of two mirrored states stands for both, where tool and body are symmetric.
template <Indenter Tool>
ContactPlan<Tool> plan_contacts(const std::vector<Scenario<Tool>>& scenarios, Symmetry symmetry, Symmetry once = {true, true}) {
  ContactPlan<Tool> plan;
  for (const Scenario<Tool>& s : scenarios) {
    validate(s);
    const Symmetry mirror = detail::to_first_image(s, {once.x && symmetry.x && is_symmetric(s.indenter, 0), once.y && symmetry.y && is_symmetric(s.indenter, 1)});
    const Scenario<Tool> first = mirrored(s, mirror);
    std::size_t k = 0;
    while (k < plan.solves.size() && !(plan.solves[k].scenario == first)) ++k;
    if (k == plan.solves.size()) {
      // One mesh serves a contact and its mirror images: the mesh has the body's symmetry.
      const Scenario<Tool> home = mirrored(first, detail::to_first_image(first, symmetry));
      std::size_t place = 0;
      while (place < plan.places.size() && !(plan.places[place].angle_rad == home.angle_rad && plan.places[place].y_m == home.y_m && plan.places[place].tilt == home.tilt)) ++place;
      if (place == plan.places.size()) plan.places.push_back({home.angle_rad, home.y_m, home.tilt, {}});
      plan.places[place].solves.push_back(k);
      plan.solves.push_back({first, place});
    }
    plan.images.push_back({k, mirror});
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
  std::vector<double> response;          ///< per emitted power and channel: Observations::unloaded_response + mean change; empty without light
  Eigen::MatrixXd change;                ///< (r − r_0)/P_emit by replicate, replicates × channels, both traced on the scenario's own mesh
};

/// One scenario of an ensemble.
struct ScenarioRecord {
  double diameter_m = 0.0, angle_rad = 0.0, y_m = 0.0;  ///< diameter of the tool, or twice its contact_radius()
  Status status = Status::non_finite;    ///< of the last state that was tried
  ContactTerms terms;
  std::vector<StateRecord> states;
  TiltPlane tilt = TiltPlane::xz;
};

/// Seconds spent, summed over threads, and by the clock in all.
struct Timing {
  double mesh = 0.0, mechanics = 0.0, optics = 0.0, total = 0.0;
};

/// All states and responses of one body under an ensemble.
struct Observations {
  std::vector<ScenarioRecord> scenarios;        ///< in the ensemble's order, mirror images included
  std::vector<double> unloaded_response;        ///< per emitted power and channel (of the first colour, then the next), mean over the meshes
  std::vector<double> unloaded_error;           ///< its standard error; meshes share their rays, so that it does not shrink with their number
  EnergyLedger ledger;                          ///< of the traced state that closes worst
  std::size_t nodes = 0, elements = 0;          ///< of the largest mesh
  Timing seconds;
};

/// Did all scenarios converge, or were held where that is accepted?
inline bool all_scored(const std::vector<ScenarioRecord>& scenarios, bool accept_held) {
  return std::all_of(scenarios.begin(), scenarios.end(), [&](const ScenarioRecord& s) { return is_scored(s.status, accept_held); });
}

/// All states that can be compared for J_obs.
inline std::vector<ObservedState> observed_states(const std::vector<ScenarioRecord>& scenarios) {
  std::vector<ObservedState> states;
  for (std::size_t k = 0; k < scenarios.size(); ++k)
    for (const StateRecord& s : scenarios[k].states)
      if (s.change.size() > 0) states.push_back({k, scenarios[k].diameter_m, scenarios[k].angle_rad, scenarios[k].y_m, s.load_N, s.change, scenarios[k].tilt});
  return states;
}

namespace detail {

/// For the planes x = 0 and y = 0: channel of the light → its mirror image; empty: itself; nothing: unknown.
using ChannelImages = std::array<std::optional<std::vector<int>>, 2>;

/// The record of a scenario from that of its mirror image.
template <Indenter Tool>
ScenarioRecord mirrored(ScenarioRecord record, const Scenario<Tool>& scenario, const ChannelImages& channels, const ScenarioImage& image) {
  record.angle_rad = scenario.angle_rad;
  record.y_m = scenario.y_m;
  const auto renumber = [&](const std::optional<std::vector<int>>& channel) {
    if (!channel || channel->empty()) return;
    for (StateRecord& s : record.states) {
      const Eigen::MatrixXd change = s.change;
      for (Eigen::Index k = 0; k < change.cols(); ++k) s.change.col((*channel)[std::size_t(k)]) = change.col(k);
    }
  };
  if (image.mirror.x) renumber(channels[0]);
  if (image.mirror.y) renumber(channels[1]);
  return record;
}

}  // namespace detail

}  // namespace lumo

// ---- lumo/campaign/ray_refinement.hpp

namespace lumo {

/// Rays of a round of refinement, in those of round 0: 1, 1, 2, 2, 4, 4, 4, …
constexpr int rays_of(int round) { return round < 4 ? 1 << (round / 2) : 4; }

/// Rays of all rounds up to this one: 1, 2, 4, 6, 10, 14, 18, …
constexpr int rays_up_to(int round) {
  int all = 0;
  for (int r = 0; r <= round; ++r) all += rays_of(r);
  return all;
}

/// How the states that decide J_obs are known better than the others: each round traces those that undecided_states() names with new rays, at first
/// half as many as they have had (and the unloaded bodies on their meshes, too), until there are none. What is still undecided then shows in the error.
struct RayRefinement {
  double tolerance = 0.015;  ///< wanted standard error of J_obs, and of all that might be less, as a fraction
  int rounds = 17;           ///< at most this many: rays_up_to(17) = 62; 0: everything is traced once
  double focus_m = 14e-3;    ///< the new rays' density falls by e over this distance from the contact's place
};

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
  const Symmetry unloaded = symmetry_of(body, mesh), contact = symmetry_of(scenario);
  return {unloaded.x && contact.x, unloaded.y && contact.y};
}

/// The same for a state that ended so: sweeps visit vertices one after the other, and what they hold is not its own mirror image.
template <Indenter Tool>
Symmetry symmetry_of(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario, Status status) {
  return status == Status::held ? Symmetry{} : symmetry_of(body, mesh, scenario);
}

namespace detail {

/// A solved scenario with its fields.
struct SolvedScenario {
  ScenarioRecord record;
  std::vector<MechanicalState> states;
  double seconds = 0.0;
};

/// Light in the states of all solved scenarios.
template <class Light, class Pad, Indenter Tool>
class Lighting {
 public:
  /// `places`: the body on its mesh for each place of the plan.
  Lighting(const Body& body, const ContactPlan<Tool>& plan, const Light& light, double focus_m, const std::vector<Pad>& places, const std::vector<SolvedScenario>& solved)
      : body_(body), plan_(plan), light_(light), focus_m_(focus_m), places_(places), solved_(solved) {
    for (std::size_t k = 0; k < solved.size(); ++k) {
      records_.push_back(solved[k].record);
      for (std::size_t s = 0; s < solved[k].states.size(); ++s)
        if (is_scored(solved[k].states[s].status, true)) all_.push_back({k, s});
    }
  }

  struct State {
    std::size_t solve, state;
    auto operator<=>(const State&) const = default;
  };
  const std::vector<State>& all() const { return all_; }

  /// Traces these states with the rays of all rounds up to `round` that they lack, and the unloaded body on their meshes with the same rays.
  /// Round 0 takes all meshes, and sends its rays evenly; later ones send them to the contact's place. Rounds have independent patterns.
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
      const Light light = light_.refined(rays_of(r), std::uint64_t(r));
      const TetMesh& mesh = places_[place]->mesh();
      RayFocus focus;  // round 0 is for all there is to see
      const auto& p = plan_.places[place];
      if (r > 0 && (p.angle_rad == 0.0 || p.tilt == TiltPlane::xz)) focus.y_m = p.y_m, focus.length_m = focus_m_;   // others touch elsewhere
      if (state == nullptr) {
        const Symmetry unloaded = symmetry_of(body_, mesh);
        lit[i] = light.trace(body_, mesh, {}, {}, {unloaded.x, unloaded.y && focus.is_symmetric()}, focus);
      } else {
        const MechanicalState& loaded = solved_[state->solve].states[state->state];
        lit[i] = light.trace(body_, mesh, loaded, symmetry_of(body_, mesh, plan_.solves[state->solve].scenario, loaded.status), focus);
      }
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
      Eigen::MatrixXd& sum = records_[state->solve].states[state->state].change;
      const double share = double(rays_of(r)) / rays_up_to(r);
      sum = r == 0 ? change : Eigen::MatrixXd((1.0 - share) * sum + share * change);
      rounds_[*state] = r + 1;
    }
  }

  /// Of the solved scenarios, with their changes.
  const std::vector<ScenarioRecord>& records() const { return records_; }

  /// Responses of the undeformed body on each mesh.
  const std::vector<Response>& unloaded() const { return unloaded_.front(); }

  /// States that decide the least distance of those observed in `all` scenarios, mirror images being one state. A pure function of the responses.
  std::vector<State> undecided(const std::vector<ScenarioRecord>& all, double tolerance) const {
    const std::vector<ObservedState> observed = observed_states(all);
    std::vector<State> states;
    for (std::size_t i : undecided_states(observed, tolerance)) {
      const std::size_t solve = plan_.images[observed[i].scenario].solve;
      const auto& candidates = records_[solve].states;
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
  const ContactPlan<Tool>& plan_;
  const Light& light_;
  double focus_m_;
  const std::vector<Pad>& places_;
  const std::vector<SolvedScenario>& solved_;
  std::vector<ScenarioRecord> records_;
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
  int mesh_order = 2;                    ///< of the simulator's elements
  bool accept_held = false;              ///< score states of a solver that goes in time: the problem is what it holds, not equilibrium
};

/// Called after each step, and before the first of a long stage: stage, steps done, steps in all. May be called from any thread, one call at a time.
using ProgressReport = std::function<void(std::string_view stage, int done, int total)>;

/// A body pressed in every scenario, which may be lit more than once.
template <class Pad, Indenter Tool>
struct Pressed {
  std::vector<Scenario<Tool>> scenarios;
  ContactPlan<Tool> plan;
  std::vector<std::unique_ptr<Pad>> places;      ///< the body on the mesh of each place of the plan
  std::vector<detail::SolvedScenario> solved;    ///< as the plan has them
  Timing seconds;
};

template <class P>
using PadOf = decltype(std::declval<const P&>().simulator.prepare(std::declval<const Body&>(), std::declval<const TetMesh&>()));

/// Presses a body in every scenario. Bit-identical for every executor. Throws InvalidArgument and MeshError; a solve that fails is a status in its record.
template <class P, Indenter Tool, Executor E>
Pressed<PadOf<P>, Tool> press(const Body& body, const std::vector<Scenario<Tool>>& scenarios, const P& pipeline, const E& executor, const ProgressReport& progress = {});

/// Can light in `body` be read from these presses: are the mirror images of its channels known where mirror images were pressed once?
template <class P, class Pad, Indenter Tool>
bool lights(const Body& body, const Pressed<Pad, Tool>& pressed, const P& pipeline);

/// Lights a body in every state that was pressed, and again with more rays where they decide J_obs. `body` is the one that was pressed, or differs
/// from it in its optics only. The seconds contain those of the presses. Bit-identical for every executor. Throws InvalidArgument, also where it does not light these presses.
template <class P, class Pad, Indenter Tool, Executor E>
Observations observe(const Body& body, const Pressed<Pad, Tool>& pressed, const P& pipeline, const E& executor, const ProgressReport& progress = {});

/// Presses and lights a body in every scenario.
template <class P, Indenter Tool, Executor E>
Observations observe(const Body& body, const std::vector<Scenario<Tool>>& scenarios, const P& pipeline, const E& executor, const ProgressReport& progress = {}) {
  return observe(body, press(body, scenarios, pipeline, executor, progress), pipeline, executor, progress);
}

namespace detail {

template <class P, Indenter Tool, class Pad>
SolvedScenario solve_scenario(const Body& body, const Scenario<Tool>& scenario, const P& pipeline, const Pad& pad) {
  SolvedScenario out;
  const Stopwatch watch;
  out.states = pad.press(scenario);
  ScenarioRecord& record = out.record;
  record = {2.0 * contact_radius(scenario.indenter), scenario.angle_rad, scenario.y_m, out.states.back().status, {}, {}, scenario.tilt};
  record.terms = contact_terms(body, pad.mesh(), out.states, contact_radius(scenario.indenter), pipeline.mechanical_error);
  for (const MechanicalState& s : out.states)
    record.states.push_back({s.status, s.load_N, s.force_N, s.depth_m, s.contact_area_m2, s.reference_area_m2, s.residual_N, s.penetration_m, {}, {}});
  out.seconds = watch.seconds();
  return out;
}

/// Scenarios without a second symmetry plane take longest: they go first, so that threads end together.
template <Indenter Tool>
std::vector<std::size_t> longest_first(const ContactPlan<Tool>& plan) {
  std::vector<std::size_t> order(plan.solves.size());
  std::iota(order.begin(), order.end(), std::size_t(0));
  const auto halves = [&](std::size_t k) { return symmetry_of(plan.solves[k].scenario).x + symmetry_of(plan.solves[k].scenario).y; };
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return halves(a) < halves(b); });
  return order;
}

/// Records of all scenarios from those that were solved.
template <Indenter Tool>
std::vector<ScenarioRecord> unfold(const std::vector<Scenario<Tool>>& scenarios, const ChannelImages& channels, const ContactPlan<Tool>& plan,
                                   const std::vector<ScenarioRecord>& solved) {
  std::vector<ScenarioRecord> records;
  for (std::size_t k = 0; k < scenarios.size(); ++k) records.push_back(mirrored(solved[plan.images[k].solve], scenarios[k], channels, plan.images[k]));
  return records;
}

/// Meshes of different places give the same unloaded response up to their facets; that difference would hide small changes, so changes are
/// taken on one mesh and added to the common mean. `watts` names the mean power or its standard error.
inline std::vector<double> mean_per_emitted(const std::vector<Response>& responses, const std::vector<double> Response::*watts, int channels) {
  std::vector<double> mean(std::size_t(channels), 0.0);
  for (const Response& r : responses)
    for (std::size_t b = 0; b < mean.size(); ++b) mean[b] += (r.*watts)[b] / (r.ledger.emitted * double(responses.size()));
  return mean;
}

/// Mirror images of the channels of a body's light.
template <class Light>
ChannelImages channel_images(const Body& body, const Light& light) {
  if (light.channels(body) == 0) return {std::vector<int>{}, std::vector<int>{}};   // mechanics only
  return {light.image_channels(body, 0), light.image_channels(body, 1)};
}

/// Counts the steps of one stage, from any thread.
class StageReport {
 public:
  StageReport(const ProgressReport& progress, std::string stage) : progress_(progress), stage_(std::move(stage)) {}
  void begin(std::size_t total) {
    if (progress_) progress_(stage_, 0, int(total));
  }
  void step(std::size_t total) {
    const std::lock_guard lock(mutex_);
    if (progress_) progress_(stage_, ++done_, int(total));
  }

 private:
  const ProgressReport& progress_;
  std::string stage_;
  int done_ = 0;
  std::mutex mutex_;
};

}  // namespace detail

template <class P, Indenter Tool, Executor E>
Pressed<PadOf<P>, Tool> press(const Body& body, const std::vector<Scenario<Tool>>& scenarios, const P& pipeline, const E& executor, const ProgressReport& progress) {
  const detail::Stopwatch clock;
  const detail::ChannelImages images = detail::channel_images(body, pipeline.tracer);
  Pressed<PadOf<P>, Tool> out;
  out.scenarios = scenarios;
  out.plan = plan_contacts(scenarios, body.symmetry, {pipeline.mirror_once && images[0], pipeline.mirror_once && images[1]});
  const ContactPlan<Tool>& plan = out.plan;

  // Meshes: scenarios at one place and angle share one.
  const std::size_t places = plan.places.size();
  detail::StageReport meshing(progress, "mesh");
  meshing.begin(places);
  const TetMesh coarse = mesh_body(body, pipeline.mesher);
  out.places.resize(places);
  std::vector<double> spent(places);
  executor.for_each(places, [&](std::size_t k) {
    const detail::Stopwatch watch;
    std::vector<Scenario<Tool>> here;
    for (std::size_t s : plan.places[k].solves) here.push_back(plan.solves[s].scenario);
    out.places[k] = std::make_unique<PadOf<P>>(pipeline.simulator.prepare(body, mesh_for_contact(body, coarse, here, pipeline.mesher, pipeline.focus, pipeline.mesh_order)));
    spent[k] = watch.seconds();
    meshing.step(places);
  });

  // Equilibria.
  const std::vector<std::size_t> order = detail::longest_first(plan);
  out.solved.resize(order.size());
  detail::StageReport pressing(progress, "press");
  pressing.begin(order.size());
  executor.for_each(order.size(), [&](std::size_t i) {
    const auto& s = plan.solves[order[i]];
    out.solved[order[i]] = detail::solve_scenario(body, s.scenario, pipeline, *out.places[s.place]);
    pressing.step(order.size());
  });

  out.seconds.mesh = std::accumulate(spent.begin(), spent.end(), 0.0);
  for (const auto& s : out.solved) out.seconds.mechanics += s.seconds;
  out.seconds.total = clock.seconds();
  return out;
}

template <class P, class Pad, Indenter Tool>
bool lights(const Body& body, const Pressed<Pad, Tool>& pressed, const P& pipeline) {
  const detail::ChannelImages images = detail::channel_images(body, pipeline.tracer);
  return std::none_of(pressed.plan.images.begin(), pressed.plan.images.end(), [&](const ScenarioImage& i) { return (i.mirror.x && !images[0]) || (i.mirror.y && !images[1]); });
}

template <class P, class Pad, Indenter Tool, Executor E>
Observations observe(const Body& body, const Pressed<Pad, Tool>& pressed, const P& pipeline, const E& executor, const ProgressReport& progress) {
  if (!lights(body, pressed, pipeline)) throw InvalidArgument("observe: contacts were pressed once with their mirror images, but channels of the light have none");
  const detail::Stopwatch clock;
  const detail::ChannelImages images = detail::channel_images(body, pipeline.tracer);
  const int channels = pipeline.tracer.channels(body);  // 0: mechanics only
  Observations out;

  // Light, first for all states, then with more and more rays for those that decide.
  detail::Lighting lighting(body, pressed.plan, pipeline.tracer, pipeline.rays.focus_m, pressed.places, pressed.solved);
  const auto trace = [&](const auto& states, int round, std::string stage) {
    detail::StageReport tracing(progress, std::move(stage));
    lighting.trace(states, round, executor, [&](std::size_t total) { tracing.step(total); });
  };
  if (channels > 0) {
    trace(lighting.all(), 0, "light");
    out.unloaded_response = detail::mean_per_emitted(lighting.unloaded(), &Response::power_W, channels);
    out.unloaded_error = detail::mean_per_emitted(lighting.unloaded(), &Response::error_W, channels);
    const bool scored = all_scored(lighting.records(), pipeline.accept_held);
    for (int round = 1; scored && round <= pipeline.rays.rounds; ++round) {
      const auto undecided = lighting.undecided(detail::unfold(pressed.scenarios, images, pressed.plan, lighting.records()), pipeline.rays.tolerance);
      if (undecided.empty()) break;
      trace(undecided, round, detail::text("light, ", rays_up_to(round), " times the rays"));
    }
  }

  out.scenarios = detail::unfold(pressed.scenarios, images, pressed.plan, lighting.records());
  for (ScenarioRecord& record : out.scenarios)
    for (StateRecord& s : record.states)
      for (Eigen::Index b = 0; b < s.change.cols(); ++b) s.response.push_back(out.unloaded_response[std::size_t(b)] + s.change.col(b).mean());
  for (const auto& p : pressed.places) {
    out.nodes = std::max(out.nodes, p->mesh().nodes.size());
    out.elements = std::max(out.elements, p->mesh().tets.size());
  }
  out.ledger = lighting.ledger;
  out.seconds = pressed.seconds;
  out.seconds.optics = lighting.seconds;
  out.seconds.total += clock.seconds();
  return out;
}

}  // namespace lumo

// ---- lumo/campaign/evaluate.hpp

namespace lumo {

/// A number to optimise, with its error, from all that was observed of a body; nothing where that does not define it.
/// Laws: a pure function; never NaN.
template <class O>
concept ObservedObjective = requires(const O& objective, const Observations& all) {
  { objective(all) } -> std::same_as<std::optional<Estimate>>;
};

/// What an evaluation of any body gives. Where a scenario did not converge (or, where the pipeline accepts held states, was not held) all objectives are empty.
struct Scores {
  bool converged = false;
  std::vector<std::optional<Estimate>> objectives;
  Observations observations;
};

/// Body → meshes → equilibria → responses → objectives, for any body, tool and objectives (ObservedObjective). Mirror images are solved once; scenarios
/// run side by side. Throws MeshError when the body cannot be meshed, InvalidArgument.
template <class P, Indenter Tool, Executor E, ObservedObjective... Objectives>
Scores evaluate(const Body& body, const std::vector<Scenario<Tool>>& scenarios, const P& pipeline, const E& executor, const std::tuple<Objectives...>& objectives,
                const ProgressReport& progress = {}) {
  Scores scores;
  scores.observations = observe(body, scenarios, pipeline, executor, progress);
  scores.converged = all_scored(scores.observations.scenarios, pipeline.accept_held);
  const auto score = [&](const auto&... objective) {
    // A numerical failure is a status, never a score.
    (scores.objectives.push_back(scores.converged ? objective(scores.observations) : std::nullopt), ...);
  };
  std::apply(score, objectives);
  return scores;
}

/// What one evaluation of a design gives. An objective is empty when a scenario did not converge, or when its terms are not defined by the loads.
struct Evaluation {
  std::optional<Estimate> J_contact, J_obs;
  std::optional<std::size_t> worst_contact;       ///< scenario that sets J_contact
  std::optional<Separation> worst_observation;    ///< pair of `observed` that sets J_obs
  std::vector<ObservedState> observed;
  Observations observations;
};

/// The worst scenario's contact progression (paper Eq. 5), with the scenario that sets it.
inline std::optional<std::pair<Estimate, std::size_t>> contact_progression(const std::vector<ScenarioRecord>& scenarios);

/// The paper's two objectives from what was observed.
template <class P>
Evaluation score(Observations observations, const P& pipeline) {
  Evaluation result;
  result.observations = std::move(observations);
  const std::vector<ScenarioRecord>& scenarios = result.observations.scenarios;
  if (!all_scored(scenarios, pipeline.accept_held)) return result;

  if (const auto worst = contact_progression(scenarios)) {
    result.J_contact = worst->first;
    result.worst_contact = worst->second;
  }
  result.observed = observed_states(scenarios);
  result.worst_observation = optical_separation(result.observed, pipeline.optical_error);
  if (result.worst_observation) result.J_obs = result.worst_observation->distance;
  return result;
}

/// θ → finger → meshes → equilibria → responses → the paper's two objectives.
/// Throws InfeasibleDesign before anything is computed, MeshError when the body cannot be meshed.
template <class P, Executor E>
Evaluation evaluate(const FingerDesign& design, const Silicone& silicone, const Ensemble& ensemble, const P& pipeline, const FingerOptions& options,
                    const E& executor, const ProgressReport& progress = {}) {
  return score(observe(finger(design, silicone, options), ensemble.scenarios(), pipeline, executor, progress), pipeline);
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
class CampaignError : public NumericalError {
 public:
  using NumericalError::NumericalError;
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
  /// Evaluations that ended, and how many of them failed.
  struct Tally {
    int failed = 0, ended = 0;
  };
  /// Of designs: what the machine failed at is no evaluation.
  Tally designs() const;
  /// Of the machine, in the trials that it was given.
  Tally machine(const std::set<int>& own) const;
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
  int failures_at_least = 5;       ///< it stops once so many evaluations have failed: of all for their designs, or of this process's own for the machine
  double failures_above = 0.5;     ///< and more than this share of them
  double poll_s = 0.5;             ///< how often it looks whether another process has ended, or died
};

/// Evaluates what the optimiser asks until it has as many results as its problem wants, or no design is left. Continues what the log holds; several
/// processes may work on one log. Each entry depends only on those before it, so a campaign in one process has the same log, to the bit, after
/// any number of crashes. `evaluate(design)` gives a Verdict; `watch(state, id, verdict)` sees each as it was kept. Throws StoreError and CampaignError.
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
auto CampaignState<O>::designs() const -> Tally {
  const auto count = [&](const auto& is) { return int(std::count_if(optimizer_.trials().begin(), optimizer_.trials().end(), is)); };
  const int failed = count([](const Trial& t) { return t.state == Trial::State::failed && !t.retry; });
  return {failed, failed + count([](const Trial& t) { return t.state == Trial::State::told; })};
}

template <class O>
auto CampaignState<O>::machine(const std::set<int>& own) const -> Tally {
  const auto failed = [&](int id) {
    const Trial& t = optimizer_.trials()[std::size_t(id)];
    return t.state == Trial::State::failed && t.retry;
  };
  return {int(std::count_if(own.begin(), own.end(), failed)), int(own.size())};
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
  const auto claimed = [&](int id) {
    if (!log.claim(state.asked(id))) return false;
    state.read(log.entries());   // who had it may have answered and ended since the last look
    return !state.answered(id);
  };
  for (std::size_t k = 0; k < state.optimizer().trials().size(); ++k)
    if (state.optimizer().trials()[k].state == Trial::State::pending && claimed(int(k))) return int(k);
  const auto entry = log.append([&](const std::vector<LogEntry>& entries) { return state.ask(entries); });
  if (!entry) return std::nullopt;
  state.read(log.entries());
  const int id = parse_trial(*entry).id;
  return claimed(id) ? std::optional(id) : take(log, state);   // somebody else was faster
}

/// Outputs that the optimiser does not take (too few, too many, not finite) are a failure of the design: as an answer they would end the log.
template <class O>
Verdict acceptable(O probe, int id, Verdict verdict) {
  if (verdict.outputs.empty()) return verdict;
  try {
    probe.tell(id, verdict.outputs);
  } catch (const InvalidArgument& e) {
    verdict.outputs.clear();
    verdict.retry = false;
    verdict.why = text("objective: ", e.what());
  }
  return verdict;
}

}  // namespace detail

template <CampaignLog Log, class O, class Evaluate, class Watch>
OptimizerStatus run_campaign(Log& log, const O& optimizer, const Evaluate& evaluate, const Watch& watch, const CampaignConfig& config) {
  CampaignState<O> state(optimizer);
  std::set<int> own;   // trials that this process answered
  while (true) {
    state.read(log.entries());
    for (const auto& [failed, ended] : {state.designs(), state.machine(own)})
      if (failed >= config.failures_at_least && failed > config.failures_above * ended)
        throw CampaignError(detail::text("campaign stops: ", failed, " of ", ended, " evaluations failed, the limit is ", 100 * config.failures_above,
                                         " % once ", config.failures_at_least, " have; the last: ", state.last_failure()));
    const std::optional<int> id = detail::take(log, state);
    if (!id) {
      if (state.optimizer().status() != OptimizerStatus::waiting) return state.optimizer().status();
      std::this_thread::sleep_for(std::chrono::duration<double>(config.poll_s));
      continue;
    }
    Verdict verdict = evaluate(state.optimizer().trials()[std::size_t(*id)].x);
    const auto answer = log.append([&](const std::vector<LogEntry>& entries) -> std::optional<LogEntry> {
      state.read(entries);
      if (state.answered(*id)) return std::nullopt;
      verdict = detail::acceptable(state.optimizer(), *id, std::move(verdict));
      LogEntry e = verdict.outputs.empty() ? detail::fail_entry(*id, verdict.retry, verdict.why) : detail::tell_entry(*id, verdict.outputs);
      e.record = verdict.record;
      e.notes = verdict.notes;
      return e;
    });
    if (!answer) continue;
    own.insert(*id);
    state.read(log.entries());
    watch(std::as_const(state), *id, std::as_const(verdict));
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

/// The first scenario that failed, and how; empty when all converged, or were held where that is accepted.
inline std::string failed_press(const std::vector<ScenarioRecord>& scenarios, bool accept_held = false) {
  for (const ScenarioRecord& s : scenarios)
    if (!is_scored(s.status, accept_held))
      return detail::text("press: ", to_string(s.status), " at ", s.states.back().load_N, " N, sphere of ", 1e3 * s.diameter_m, " mm at ", s.angle_rad * 180.0 / pi,
                          " deg, y = ", 1e3 * s.y_m, " mm");
  return "";
}

/// Why an evaluation has no objectives: the stage and the first scenario that failed. Empty when it has both.
inline std::string failure_of(const Evaluation& e, bool accept_held = false) {
  if (e.J_contact && e.J_obs) return "";
  if (std::string why = failed_press(e.observations.scenarios, accept_held); !why.empty()) return why;
  return !e.J_contact ? "objective: the loads do not define the terms of J_contact" : "objective: no two states can be compared for J_obs";
}

/// Was it the machine's limits, not the body's, that ended a solve?
inline bool of_the_machine(const std::vector<ScenarioRecord>& scenarios) {
  return std::any_of(scenarios.begin(), scenarios.end(), [](const ScenarioRecord& s) { return s.status == Status::time_limit; });
}
/// The same of a body that was left without a mesh.
inline bool of_the_machine(const MeshError& e) { return e.reason() == MeshError::Reason::timed_out || e.reason() == MeshError::Reason::out_of_memory; }

/// What a campaign keeps of an evaluation; what the machine ended may be tried again.
inline Verdict verdict_of(const Evaluation& e, bool accept_held = false) {
  Verdict v;
  v.why = failure_of(e, accept_held);
  if (v.why.empty()) v.outputs = {e.J_contact->value, e.J_obs->value};
  v.retry = of_the_machine(e.observations.scenarios);
  return v;
}

/// The same of a mesh that could not be made.
inline Verdict verdict_of(const MeshError& e) {
  Verdict v;
  v.why = detail::text("mesh: ", e.what());
  v.retry = of_the_machine(e);
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

/// Designs up to which all of a study are spread evenly: a campaign stops before half of its evaluations have failed, and twice as many are drawn.
inline constexpr int largest_study = 500;

/// The designs of a study: feasible lattice points spread over `space` (Owen-scrambled Sobol points), as a problem without a search. What is
/// drawn does not hang on `designs`, so that a study can go on with more. Throws InvalidArgument for fewer than 1 or more than largest_study.
inline Problem study_problem(const DesignSpace& space, int designs, std::uint64_t seed) {
  if (designs < 1 || designs > largest_study) throw InvalidArgument(detail::text("number of designs of a study is ", designs, ", must lie in [1, ", largest_study, "]"));
  Problem p;
  p.space = space;
  p.objectives = {{"J_contact", true, 0.0}};
  p.sobol = 1024;
  p.evaluations = designs;
  p.seed = seed;
  return p;
}

/// The design itself, then its variants, in the order of `study.twins`. What fails in one leaves the others whole. Throws InfeasibleDesign, and
/// MeshError where a mesh failed for the machine's limits: another try may have them all.
template <class P, Executor E>
std::vector<VariantResult> compare_variants(const FingerDesign& design, const Silicone& silicone, const Ensemble& ensemble, const MatchedStudy& study, const P& pipeline,
                                            const FingerOptions& options, const E& executor, const ProgressReport& progress = {});

/// Median over scenarios of the norm of the response change at one load; empty when a scenario has none.
template <class MatrixXd = Eigen::MatrixXd>
inline std::optional<Estimate> median_change(const std::vector<ScenarioRecord>& scenarios, double load_N, const OpticalError& error) {
  std::vector<Estimate> norms;
  for (const ScenarioRecord& s : scenarios) {
    const auto state = std::find_if(s.states.begin(), s.states.end(), [&](const StateRecord& k) { return k.load_N == load_N && k.change.size() > 0; });
    if (state == s.states.end()) return std::nullopt;
    const Estimate d = response_distance(state->change, MatrixXd::Zero(state->change.rows(), state->change.cols()));
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
    if (of_the_machine(e)) throw;
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

// ---- lumo/campaign/gaussian_process_decoder.hpp

namespace lumo {

/// Templates that are smooth along the finger: one Gaussian process for each feature over the finger coordinate, so that each place learns from its
/// neighbours' observations too. A response is weighed against the processes' mean with one shrunk covariance of the residuals and the processes' own
/// variance. Unlike discriminants it has a template between the tested places as well.
struct GaussianProcessDecoder {
  double shrinkage = -1.0;  ///< of the residuals' covariance, 0 … 1; negative: Ledoit and Wolf's
  int grid = 201;           ///< coordinates that `coordinate_m` weighs

  class Model {
   public:
    template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
    Model(const LabelledResponses& t, const GaussianProcessDecoder& config) : grid_(VectorXd::LinSpaced(config.grid, t.place_m[0], t.place_m[t.places() - 1])) {
      const Eigen::Index d = t.response.rows(), n = t.response.cols();
      TrainingData data{MatrixXd(1, n), VectorXd(n), t.place_m.head(1), t.place_m.tail(1)};
      for (Eigen::Index i = 0; i < n; ++i) data.x(0, i) = t.place_m[t.place[std::size_t(i)]];
      MatrixXd residual(d, n), on_grid(d, config.grid), grid_variance(d, config.grid);
      mean_.resize(d, t.places());
      MatrixXd variance(d, t.places());
      for (Eigen::Index f = 0; f < d; ++f) {
        data.y = t.response.row(f).transpose();
        const auto process = GaussianProcess<>::fit(data);
        residual.row(f) = t.response.row(f) - process.mean(data.x).transpose();
        const auto places = process.predict(t.place_m.transpose()), fine = process.predict(grid_.transpose());
        mean_.row(f) = places.mean.transpose(), variance.row(f) = places.variance.transpose();
        on_grid.row(f) = fine.mean.transpose(), grid_variance.row(f) = fine.variance.transpose();
      }
      double share = config.shrinkage;
      covariance_ = detail::shrunk_covariance(residual, t.places(), share);
      for (Eigen::Index p = 0; p < mean_.cols(); ++p) place_.push_back(factor(variance.col(p)));
      for (Eigen::Index g = 0; g < grid_.size(); ++g) fine_.push_back(factor(grid_variance.col(g)));
      grid_mean_ = std::move(on_grid);
    }
    /// Throws InvalidArgument for another number of features.
    template <class VectorXd = Eigen::VectorXd>
    Decoding decode(In<VectorXd> response) const { return weigh(response, mean_, place_); }
    /// Mean of the coordinate's posterior over the tested range, flat before [m].
    template <class VectorXd = Eigen::VectorXd>
    double coordinate_m(In<VectorXd> response) const { return weigh(response, grid_mean_, fine_).probability.dot(grid_); }

   private:
    using Factor = Eigen::LLT<Eigen::MatrixXd>;
    template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
    Factor factor(In<VectorXd> variance) const { return Factor(covariance_ + MatrixXd(variance.asDiagonal())); }
    template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
    static Decoding weigh(In<VectorXd> response, In<MatrixXd> mean, const std::vector<Factor>& factors) {
      if (response.size() != mean.rows()) throw InvalidArgument(detail::text("response has ", response.size(), " features, the decoder ", mean.rows()));
      VectorXd log_likelihood(mean.cols());
      for (Eigen::Index p = 0; p < mean.cols(); ++p) {
        const Factor& l = factors[std::size_t(p)];
        const VectorXd z = l.matrixL().solve(response - mean.col(p));
        log_likelihood[p] = -0.5 * z.squaredNorm() - l.matrixLLT().diagonal().array().log().sum();
      }
      return detail::decoding_of(log_likelihood);
    }

    Eigen::VectorXd grid_;
    Eigen::MatrixXd mean_, grid_mean_, covariance_;
    std::vector<Factor> place_, fine_;
  };

  /// Throws InvalidArgument for data that do not fit together.
  template <class = void>
  Model fit(const LabelledResponses& training) const {
    validate(training);
    require_in_range("shrinkage", shrinkage, -1e300, 1.0, "");
    require_in_range("grid of the decoder", grid, 2, 100000, "");
    return Model(training, *this);
  }
};

static_assert(Decoder<GaussianProcessDecoder>);

}  // namespace lumo

// ---- lumo/lab/pad_responses.hpp

namespace lumo {

/// What one indenter does to the light at one side of a pad, computed at places along it and at loads. Powers are per emitted power; of one side, with both sides'
/// numbers used. Places are y ≥ 0; those below are mirror images.
struct PadResponses {
  std::vector<double> theta_mm;      ///< design
  std::string material;
  double diameter_m = 0.0;           ///< of the sphere
  Eigen::VectorXd position_m;        ///< middles of the bins, ascending, symmetric about 0
  Eigen::VectorXd unloaded;          ///< power through each bin
  Eigen::VectorXd place_m;           ///< ascending from 0
  Eigen::VectorXd load_N;            ///< ascending, > 0
  Eigen::MatrixXd depth_m;           ///< loads × places
  std::vector<Eigen::MatrixXd> change;  ///< by place: bins × loads
  Eigen::VectorXd tilt_place_m;      ///< places at which a tilted approach was computed, ascending from 0
  std::vector<Eigen::MatrixXd> tilt;  ///< by tilt place: odd part of the change on the side x > 0 per radian of approach angle, bins × loads
  Eigen::VectorXd error;             ///< by load: RMS standard error of a bin's change, from the tracer's replicates
};

/// Throws InputError, with `name` before it, where the parts do not fit together or are not finite.
template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
inline void validate(const PadResponses& r, const std::string& name) {
  const auto require = [&](bool good, const char* what) {
    if (!good) throw InputError(detail::text(name, ": responses of a pad: ", what));
  };
  const Eigen::Index bins = r.position_m.size(), loads = r.load_N.size(), places = r.place_m.size(), tilts = r.tilt_place_m.size();
  const auto ascend = [](const VectorXd& v) { return std::is_sorted(v.begin(), v.end(), std::less_equal<>()); };
  require(bins >= 3 && r.unloaded.size() == bins && ascend(r.position_m), "there must be at least 3 bins, ascending, with unloaded power each");
  require((r.position_m + r.position_m.reverse()).cwiseAbs().maxCoeff() < 1e-9, "bins must be symmetric about y = 0");
  require(loads >= 2 && ascend(r.load_N) && r.load_N[0] > 0.0 && r.error.size() == loads, "there must be at least 2 loads, ascending");
  require(places >= 2 && ascend(r.place_m) && r.place_m[0] == 0.0 && Eigen::Index(r.change.size()) == places, "there must be at least 2 places, ascending from 0");
  require(tilts >= 1 && ascend(r.tilt_place_m) && Eigen::Index(r.tilt.size()) == tilts, "there must be a tilted approach at least at one place");
  require(r.depth_m.rows() == loads && r.depth_m.cols() == places && r.depth_m.allFinite() && r.depth_m.minCoeff() > 0.0, "a depth is missing or not positive");
  require(r.unloaded.allFinite() && r.unloaded.minCoeff() >= 0.0 && r.unloaded.sum() > 0.0, "unloaded power must be finite and not negative");
  for (const auto* list : {&r.change, &r.tilt})
    for (const MatrixXd& m : *list) require(m.rows() == bins && m.cols() == loads && m.allFinite(), "a response is missing or not finite");
}

/// The responses in between: linear from place to place, monotone cubic (Fritsch & Butland 1984) from load to load, starting at 0 N.
class PadLight {
 public:
  /// Throws InputError for responses that do not fit together.
  template <class MatrixXd = Eigen::MatrixXd>
  explicit PadLight(PadResponses responses) : r_(std::move(responses)) {
    validate(r_, "responses");
    for (const MatrixXd& m : r_.change) slope_.push_back(slopes(m));
    for (const MatrixXd& m : r_.tilt) tilt_slope_.push_back(slopes(m));
    depth_slope_ = slopes(r_.depth_m.transpose());
  }

  const PadResponses& responses() const { return r_; }
  double reach_m() const { return r_.place_m[r_.place_m.size() - 1]; }
  double max_load_N() const { return r_.load_N[r_.load_N.size() - 1]; }

  /// Change of the power through each bin of the side x > 0 under a contact at y. Places and loads beyond those computed count as the last ones.
  /// The odd part of a tilt is that of the nearest tilt places, moved with the contact.
  template <class VectorXd = Eigen::VectorXd>
  Eigen::VectorXd change(double y_m, double load_N, double tilt_rad = 0.0) const {
    const auto [k, t] = between(r_.place_m, std::abs(y_m));
    VectorXd v = (1.0 - t) * at_load(r_.change[k], slope_[k], load_N);
    if (t > 0.0) v += t * at_load(r_.change[k + 1], slope_[k + 1], load_N);
    if (tilt_rad != 0.0) {
      const auto [i, s] = between(r_.tilt_place_m, std::abs(y_m));
      add_moved(v, tilt_rad * (1.0 - s), at_load(r_.tilt[i], tilt_slope_[i], load_N), std::abs(y_m) - r_.tilt_place_m[Eigen::Index(i)]);
      if (s > 0.0) add_moved(v, tilt_rad * s, at_load(r_.tilt[i + 1], tilt_slope_[i + 1], load_N), std::abs(y_m) - r_.tilt_place_m[Eigen::Index(i) + 1]);
    }
    return y_m < 0.0 ? VectorXd(v.reverse()) : v;
  }
  template <class VectorXd = Eigen::VectorXd>
  double depth_m(double y_m, double load_N) const {
    const auto [k, t] = between(r_.place_m, std::abs(y_m));
    const VectorXd all = at_load(r_.depth_m.transpose(), depth_slope_, load_N);
    return (1.0 - t) * all[Eigen::Index(k)] + (t > 0.0 ? t * all[Eigen::Index(k) + 1] : 0.0);
  }
  /// Load that gives a depth, the inverse of the above; beyond the last load with the last slope, 0 for none.
  template <class = void>
  double load_N(double y_m, double depth_m) const {
    const double most = max_load_N(), end = this->depth_m(y_m, most);
    if (!(depth_m > 0.0)) return 0.0;
    if (depth_m >= end) return most + (depth_m - end) * 0.05 * most / (end - this->depth_m(y_m, 0.95 * most));
    double low = 0.0, high = most;
    for (int k = 0; k < 50; ++k) {
      const double middle = 0.5 * (low + high);
      (this->depth_m(y_m, middle) < depth_m ? low : high) = middle;
    }
    return 0.5 * (low + high);
  }

 private:
  /// Interval of ascending `x` and the share of it; clamped.
  template <class VectorXd = Eigen::VectorXd>
  static std::pair<std::size_t, double> between(In<VectorXd> x, double at) {
    if (x.size() == 1 || at <= x[0]) return {0, 0.0};
    const Eigen::Index last = x.size() - 1;
    if (at >= x[last]) return {std::size_t(last), 0.0};
    const auto k = Eigen::Index(std::upper_bound(x.begin(), x.end(), at) - x.begin()) - 1;
    return {std::size_t(k), (at - x[k]) / (x[k + 1] - x[k])};
  }

  double load(Eigen::Index k) const { return k == 0 ? 0.0 : r_.load_N[k - 1]; }

  /// Derivatives over the load of rows that are 0 at 0 N; columns 0 N and all loads.
  template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
  Eigen::MatrixXd slopes(In<MatrixXd> value) const {
    const Eigen::Index n = value.cols();
    MatrixXd secant(value.rows(), n), slope(value.rows(), n + 1);
    for (Eigen::Index k = 0; k < n; ++k) secant.col(k) = (value.col(k) - (k ? VectorXd(value.col(k - 1)) : VectorXd::Zero(value.rows()))) / (load(k + 1) - load(k));
    slope.col(0) = secant.col(0), slope.col(n) = secant.col(n - 1);
    for (Eigen::Index k = 1; k < n; ++k) {
      const double a = load(k) - load(k - 1), b = load(k + 1) - load(k), wa = (a + 2.0 * b) / (3.0 * (a + b));
      for (Eigen::Index i = 0; i < value.rows(); ++i) {
        const double left = secant(i, k - 1), right = secant(i, k);
        slope(i, k) = left * right > 0.0 ? left * right / (wa * right + (1.0 - wa) * left) : 0.0;
      }
    }
    return slope;
  }
  template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
  Eigen::VectorXd at_load(In<MatrixXd> value, In<MatrixXd> slope, double at) const {
    const Eigen::Index n = value.cols();
    if (!(at > 0.0)) return VectorXd::Zero(value.rows());
    if (at >= load(n)) return value.col(n - 1);
    Eigen::Index k = 0;
    while (at >= load(k + 1)) ++k;
    const double h = load(k + 1) - load(k), t = (at - load(k)) / h, u = 1.0 - t;
    VectorXd v = (t * t * (1.0 + 2.0 * u)) * value.col(k) + (h * t * u * u) * slope.col(k) - (h * t * t * u) * slope.col(k + 1);
    if (k > 0) v += (u * u * (1.0 + 2.0 * t)) * value.col(k - 1);
    return v;
  }
  /// v += share · f(y − shift), f linear between bins and 0 beyond.
  void add_moved(Eigen::VectorXd& v, double share, const Eigen::VectorXd& f, double shift_m) const {
    const double width = r_.position_m[1] - r_.position_m[0];
    const Eigen::Index n = v.size();
    for (Eigen::Index i = 0; i < n; ++i) {
      const double at = double(i) - shift_m / width, whole = std::floor(at);
      const auto k = Eigen::Index(whole);
      const double t = at - whole;
      v[i] += share * ((k >= 0 && k < n ? (1.0 - t) * f[k] : 0.0) + (k + 1 >= 0 && k + 1 < n ? t * f[k + 1] : 0.0));
    }
  }

  PadResponses r_;
  std::vector<Eigen::MatrixXd> slope_, tilt_slope_;
  Eigen::MatrixXd depth_slope_;
};

}  // namespace lumo

// ---- lumo/lab/side_sight.hpp

namespace lumo {

/// What is seen of a pad's two sides, by the *deformed* place along the finger (a camera sees where the surface is, not where it was). By default all light that
/// leaves a visible side counts, whatever its direction, which is how the paper's own model reads an image (r_b). A real lens sees a narrow cone: one that
/// looks level or down on a pad that does not scatter sees hardly more than shadows, because a dent throws light down and outwards (docs/virtual_lab.md).
/// Channels 0 … bins − 1 are the side x > 0, the others the side x < 0, each from proximal to distal.
struct SideSight {
  int bins = 60;
  double half_range_m = 30.0_mm;
  double pitch_rad = 0.0;      ///< of the line of sight above the base plane: the camera looks down on the pad by so much
  double cone_rad = pi;        ///< half angle of the cone about the line of sight; π: all directions

  int channels(const Body&) const { return 2 * bins; }
  int channel(const Escape& e) const {
    if (e.region < 0) return -1;
    const bool right = e.reference.x() > 0.0;
    const double sideways = right ? e.direction.x() : -e.direction.x();
    if (cone_rad < pi && sideways * std::cos(pitch_rad) + e.direction.z() * std::sin(pitch_rad) < std::cos(cone_rad)) return -1;
    const double at = (e.position.y() + half_range_m) / (2.0 * half_range_m) * bins;
    return at >= 0.0 && at < bins ? int(at) + (right ? 0 : bins) : -1;
  }
  /// Middles of the bins of one side [m].
  std::vector<double> positions_m() const {
    std::vector<double> y;
    for (int b = 0; b < bins; ++b) y.push_back(half_range_m * ((2 * b + 1.0) / bins - 1.0));
    return y;
  }
};

static_assert(ExitReadout<SideSight>);

/// The body with the sight's bins for regions, on the surface that was visible before (whose ends now reach as far as the sight does).
/// `min_abs_nx`: of the undeformed normal, as FingerOptions::Readout says. Throws InvalidArgument for numbers that make no sense.
inline Body seen_from_sides(Body body, const SideSight& sight, double min_abs_nx = 0.5) {
  require_in_range("bins of the side's sight", sight.bins, 2, 4096, "");
  require_positive("range of the side's sight", sight.half_range_m, "m");
  require_in_range("cone of the side's sight", sight.cone_rad, 0.01, pi, "rad");
  const int n = sight.bins;
  body.regions = 2 * n;
  std::vector<int> other_side(std::size_t(2 * n)), other_end(std::size_t(2 * n));
  for (int b = 0; b < n; ++b) {
    other_side[std::size_t(b)] = b + n, other_side[std::size_t(b + n)] = b;
    other_end[std::size_t(b)] = n - 1 - b, other_end[std::size_t(b + n)] = 2 * n - 1 - b;
  }
  body.region_image_x = other_side;
  body.region_image_y = other_end;
  body.region = [n, half = sight.half_range_m, min_abs_nx](const Vec3& p, const Vec3& normal) {
    if (std::abs(normal.x()) < min_abs_nx || std::abs(p.y()) > half) return -1;
    const int b = std::clamp(int((p.y() + half) / (2.0 * half) * n), 0, n - 1);
    return p.x() > 0.0 ? b : b + n;
  };
  return body;
}

}  // namespace lumo

// ---- lumo/campaign/observe_pad.hpp

namespace lumo {

/// Where and how hard a pad is pressed for the virtual lab.
struct PadGrid {
  double diameter_m = 10.0_mm;
  std::vector<double> load_N{1.0, 2.0, 5.0, 10.0, 15.0, 20.0};
  double spacing_m = 1.0_mm;    ///< of the places; those at y < 0 are mirror images
  int places = 27;              ///< 0, 1, …, 26 mm
  double tilt_rad = 4.0_deg;    ///< of an approach from the side, from which follows what small angles do
  std::vector<double> tilt_place_m{0.0, 22.0_mm};
};

/// Presses the pad at all places of the grid and traces its light: mechanics and optics as everywhere else, read out as `sight` says. The pipeline's tracer must
/// have `sight` for its readout; `body` must be symmetric. Throws InvalidArgument, MeshError, and PressFailure when a press does not converge.
template <class P, Executor E>
PadResponses observe_pad(const Body& body, const SideSight& sight, const PadGrid& grid, const P& pipeline, const E& executor, const ProgressReport& progress = {}) {
  if (!body.symmetry.x || !body.symmetry.y) throw InvalidArgument("virtual lab: the pad must be symmetric in x and y");
  require_in_range("places of the virtual lab", grid.places, 2, 1000, "");
  require_positive("spacing of the virtual lab's places", grid.spacing_m, "m");
  require_in_range("tilt of the virtual lab", grid.tilt_rad, 0.001, 0.5, "rad");
  std::vector<Scenario<Sphere>> scenarios;
  for (int k = 0; k < grid.places; ++k) scenarios.push_back({Sphere{grid.diameter_m}, 0.0, grid.spacing_m * k, grid.load_N});
  for (const double y : grid.tilt_place_m) scenarios.push_back({Sphere{grid.diameter_m}, grid.tilt_rad, y, grid.load_N});
  const Observations seen = observe(seen_from_sides(body, sight), scenarios, pipeline, executor, progress);
  for (const ScenarioRecord& s : seen.scenarios)
    if (s.status != Status::converged) throw PressFailure(detail::text("virtual lab: no equilibrium at ", s.states.back().load_N, " N, y = ", 1e3 * s.y_m, " mm (", to_string(s.status), ")"));

  const Eigen::Index bins = sight.bins, loads = Eigen::Index(grid.load_N.size());
  PadResponses r;
  r.diameter_m = grid.diameter_m;
  const std::vector<double> at = sight.positions_m();
  r.position_m = Eigen::Map<const Eigen::VectorXd>(at.data(), bins);
  const Eigen::Map<const Eigen::VectorXd> rest(seen.unloaded_response.data(), 2 * bins);
  r.unloaded = 0.5 * (rest.head(bins) + rest.tail(bins));
  r.unloaded = 0.5 * (r.unloaded + r.unloaded.reverse().eval());
  r.load_N = Eigen::Map<const Eigen::VectorXd>(grid.load_N.data(), loads);
  r.place_m.resize(grid.places);
  r.depth_m.resize(loads, grid.places);
  r.tilt_place_m = Eigen::Map<const Eigen::VectorXd>(grid.tilt_place_m.data(), Eigen::Index(grid.tilt_place_m.size()));
  r.error = Eigen::VectorXd::Zero(loads);
  for (std::size_t k = 0; k < scenarios.size(); ++k) {
    const bool straight = k < std::size_t(grid.places);
    Eigen::MatrixXd part(bins, loads);
    for (Eigen::Index l = 0; l < loads; ++l) {
      const StateRecord& s = seen.scenarios[k].states[std::size_t(l)];
      const Eigen::MatrixXd right = s.change.leftCols(bins), left = s.change.rightCols(bins), wanted = straight ? Eigen::MatrixXd(0.5 * (right + left)) : Eigen::MatrixXd(0.5 * (right - left) / grid.tilt_rad);
      part.col(l) = wanted.colwise().mean().transpose();
      if (!straight) continue;
      double squares = 0.0;
      for (const double e : standard_error(wanted)) squares += e * e;
      r.error[l] += squares / double(bins * grid.places);
      r.depth_m(l, Eigen::Index(k)) = s.depth_m;
    }
    // At y = 0 the pad is its own mirror image; only the rays are not.
    if (scenarios[k].y_m == 0.0) part = (0.5 * (part + part.colwise().reverse())).eval();
    (straight ? r.change : r.tilt).push_back(std::move(part));
    if (straight) r.place_m[Eigen::Index(k)] = scenarios[k].y_m;
  }
  r.error = r.error.cwiseSqrt().eval();
  return r;
}

}  // namespace lumo

// ---- lumo/morphology/cast_section.hpp

namespace lumo {

/// What a pad that is cast on its carrier looks like, in general words: a dome over a ridge, an open gap along each side of the ridge, the same all along y.
/// Lengths in m, the body's frame: x across, y along, centred, z from the carrier's plate outwards.
struct CastSection {
  std::vector<std::array<double, 2>> outline;  ///< half outline (x, z) of the pad: from the plate at x > 0 up and over to (0, height)
  double length = 0.0;                         ///< of the pad along y
  double ridge_width = 0.0;                    ///< of the rigid ridge in the middle
  double ridge_height = 0.0;
  double gap_width = 0.0;                      ///< of the air gap on each side of the ridge, as high as the ridge; 0: none
  double exact_volume_m3 = 0.0;                ///< of the pad with its curve uncut [m³]
  FingerOptions::Leds leds;                    ///< centred on the ridge, facing up

  double half_width() const { return outline.front()[0]; }
  double height() const { return outline.back()[1]; }
  /// Area inside the cut outline, ridge and gaps taken off [m²].
  double area_m2() const;
};

/// Chords for making things: they leave the curve by less than 5 µm, a tenth of what printers resolve.
inline Chords fabrication_chords() { return {0.5e-3, 0.05, 0.05e-3}; }

/// The section of a feasible design for casting: its stem is the ridge, its voids are the gaps. Throws InfeasibleDesign.
CastSection cast_section(const FingerDesign& design, const FingerOptions& options = {}, const Chords& chords = fabrication_chords());

inline double CastSection::area_m2() const {
  double half = 0.0;
  for (std::size_t i = 0; i + 1 < outline.size(); ++i) half += 0.5 * (outline[i][0] * outline[i + 1][1] - outline[i + 1][0] * outline[i][1]);
  return 2.0 * half - (ridge_width + 2.0 * gap_width) * ridge_height;
}

inline CastSection cast_section(const FingerDesign& design, const FingerOptions& options, const Chords& chords) {
  validate(options);
  const HalfSection half = half_section(design, Twin::none, chords, options.pad);
  CastSection s;
  s.outline.push_back({0.5e-3 * options.pad.width, 0.0});
  for (std::size_t i = 0; i < half.x.size(); ++i)
    if (half.tag[i] == SectionTag::dome || half.tag[i] == SectionTag::mirror) s.outline.push_back({half.x[i], half.z[i]});
  s.length = 1e-3 * options.pad.length;
  s.ridge_width = 1e-3 * design.w_s, s.ridge_height = 1e-3 * design.h_s, s.gap_width = 1e-3 * design.w_v;
  s.exact_volume_m3 = 2.0 * half.exact_area_m2() * s.length;
  s.leds = options.leds;
  return s;
}

}  // namespace lumo

// ---- lumo/fabrication/casting_options.hpp

namespace lumo {

/// What may be chosen about the parts that a pad is cast with; lengths in m. Every default is our own choice, within what the sources in
/// docs/fabrication.md advise.
struct CastingOptions {
  double clearance = 0.2e-3;       ///< on each side between printed parts that are put together: FDM 0.2 mm, SLA 0.1 mm
  double plate = 4.0e-3;           ///< thickness of the carrier's plate
  double flange = 3.0e-3;          ///< of the plate beyond the pad's long sides: the mould seals on it
  double tab = 7.0e-3;             ///< of the plate beyond the pad's ends, with the mounting holes
  double hole_diameter = 3.4e-3;   ///< of the mounting holes: M3, ISO 273 medium
  double strip_width = 2.0e-3;     ///< of the LED strip
  double strip_height = 0.9e-3;    ///< of the LED strip with its LEDs: 0.3 mm flexible circuit and 0.6 mm LED
  double wall = 8.0e-3;            ///< of the mould about the pad
  double rim = 3.0e-3;             ///< how far the mould reaches down the plate's edge, which it is centred by
  double gate_diameter = 4.0e-3;   ///< at the pad; a Luer tip fits
  double vent_diameter = 2.0e-3;   ///< at the pad: the smallest hole that FDM prints well

  /// Of the smallest wall that is printed: two lines of a 0.4 mm nozzle.
  static constexpr double thinnest_wall = 0.8e-3;
};

/// Limits of the options in mm, as they are checked and as they are told.
namespace casting_limits {
inline constexpr Limits clearance_mm{0.05, 0.4}, plate_mm{3.0, 20.0}, wall_mm{7.0, 30.0}, strip_width_mm{0.8, 10.0}, strip_height_mm{0.2, 1.5};
inline constexpr Limits gate_mm{2.0, 4.0}, vent_mm{0.8, 2.0};
}

/// Throws InvalidArgument for an option that is out of range, or does not fit the section.
void validate(const CastingOptions& options, const CastSection& section);

/// The lengths that all parts share, so that they fit each other in every bit; in m, the pad's frame.
struct CastingLayout {
  double half_width, top, half_length;            ///< of the pad; half_length is that of the cavity, too
  double plate_x, plate_y;                        ///< half the plate
  double rim_x, rim_y;                            ///< where the mould's rim begins: the plate with its clearance
  double mould_x, mould_y, mould_top;             ///< half the mould, and its height above the plate
  double notch_inner, notch_outer, notch_roof;    ///< of the openings for the cores, from the middle out
  double pocket_x, pocket_y, pocket_floor;        ///< half the pocket for the LED strip, and its floor's height
  double strip_y;                                 ///< half the LED strip

  CastingLayout(const CastSection& s, const CastingOptions& o) {
    const double c = o.clearance;
    half_width = s.half_width(), top = s.height(), half_length = 0.5 * s.length;
    plate_x = half_width + o.flange, plate_y = half_length + o.tab;
    rim_x = plate_x + c, rim_y = plate_y + c;
    mould_x = half_width + o.wall, mould_y = rim_y + (mould_x - rim_x), mould_top = top + o.wall;
    notch_inner = 0.5 * s.ridge_width - c, notch_outer = 0.5 * s.ridge_width + s.gap_width + c, notch_roof = s.ridge_height + c;
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
    throw InvalidArgument(detail::text("LED strip width is ", detail::exact(o.strip_width * 1e3), " mm, must be at most ", widest,
                                       " mm: 0.6 mm of wall on each side of it in a ridge of ", s.ridge_width * 1e3, " mm"));
  if (at.pocket_y > at.half_length - 1.0e-3)
    throw InvalidArgument(detail::text("LED strip is ", 2e3 * at.strip_y, " mm long, must be at most ", 2e3 * (at.half_length - o.clearance - 1.0e-3), " mm"));
  if (at.notch_outer > at.half_width - 4.55e-3)
    throw InvalidArgument(detail::text("the pad is ", 1e3 * (at.half_width - at.notch_outer + o.clearance), " mm thick beside its gaps, must be at least ",
                                       4.55 + 1e3 * o.clearance, " mm"));
}

}  // namespace lumo

// ---- lumo/fabrication/faceted_solid.hpp

namespace lumo {

/// A solid that is told face by face: flat polygons with holes, and bands between loops. Corners at one place (in every bit) are one vertex, and an edge along
/// an axis takes up the corners of its neighbours that lie on it, so that faces meet edge to edge however they are cut. No boolean operations: what is
/// told is what is made, and surface() checks that it bounds a solid.
class FacetedSolid {
 public:
  using Loop = std::vector<Vec3>;

  /// A flat face; outline counter-clockwise seen from outside, holes clockwise.
  void face(const Loop& outline, const std::vector<Loop>& holes = {});
  /// Quadrilaterals between two chains of corners: from[i], from[i+1], to[i+1], to[i], which must be flat. With `closed` the last joins the first.
  /// Outward for a loop that is counter-clockwise seen from the side of `to`.
  void band(const Loop& from, const Loop& to, bool closed = true);

  /// The solid's triangles. Throws MeshError unless they bound a solid (see validate_surface).
  template <class = void>
  TriangleSurface surface() const;

 private:
  struct Face {
    std::vector<int> outline;
    std::vector<std::vector<int>> holes;
  };

  int vertex(const Vec3& p);
  std::vector<int> numbers(const Loop& loop);
  template <class Vec3 = Vec3>
  std::vector<int> with_corners_between(const std::vector<int>& loop) const;

  std::vector<Vec3> vertices_;
  std::map<std::array<double, 3>, int> known_;
  std::vector<Face> faces_;
};

/// The loop the other way round.
inline FacetedSolid::Loop reversed(FacetedSolid::Loop loop) {
  std::reverse(loop.begin(), loop.end());
  return loop;
}

inline int FacetedSolid::vertex(const Vec3& p) {
  const auto [place, fresh] = known_.try_emplace({p.x() + 0.0, p.y() + 0.0, p.z() + 0.0}, int(vertices_.size()));   // −0 is 0
  if (fresh) vertices_.push_back(p);
  return place->second;
}

inline std::vector<int> FacetedSolid::numbers(const Loop& loop) {
  std::vector<int> n;
  for (const Vec3& p : loop) n.push_back(vertex(p));
  return n;
}

inline void FacetedSolid::face(const Loop& outline, const std::vector<Loop>& holes) {
  Face f{numbers(outline), {}};
  for (const Loop& hole : holes) f.holes.push_back(numbers(hole));
  faces_.push_back(std::move(f));
}

inline void FacetedSolid::band(const Loop& from, const Loop& to, bool closed) {
  const std::size_t n = from.size();
  for (std::size_t i = 0; i + (closed ? 0 : 1) < n; ++i) face({from[i], from[(i + 1) % n], to[(i + 1) % n], to[i]});
}

/// The loop with all vertices of the solid that lie on its edges along an axis; exact, for two coordinates are the same there.
template <class Vec3>
inline std::vector<int> FacetedSolid::with_corners_between(const std::vector<int>& loop) const {
  std::vector<int> full;
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const int from = loop[i], to = loop[(i + 1) % loop.size()];
    const Vec3 &a = vertices_[std::size_t(from)], &b = vertices_[std::size_t(to)];
    full.push_back(from);
    for (int axis = 0; axis < 3; ++axis) {
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      if (a[u] != b[u] || a[v] != b[v]) continue;
      std::vector<std::pair<double, int>> between;
      for (std::size_t k = 0; k < vertices_.size(); ++k) {
        const Vec3& p = vertices_[k];
        if (p[u] == a[u] && p[v] == a[v] && (p[axis] - a[axis]) * (p[axis] - b[axis]) < 0.0) between.emplace_back(std::abs(p[axis] - a[axis]), int(k));
      }
      std::sort(between.begin(), between.end());
      for (const auto& corner : between) full.push_back(corner.second);
    }
  }
  return full;
}

template <class>
inline TriangleSurface FacetedSolid::surface() const {
  TriangleSurface s{vertices_, {}};
  for (const Face& f : faces_) {
    const std::vector<int> outline = with_corners_between(f.outline);
    std::vector<std::vector<int>> holes;
    for (const auto& hole : f.holes) holes.push_back(with_corners_between(hole));
    const Vec3 normal = detail::polygon_normal(vertices_, f.outline);
    // Numbers of the corners alone: the projection of thousands of others would cost more than the cut.
    std::vector<int> of = outline;
    for (const auto& hole : holes) of.insert(of.end(), hole.begin(), hole.end());
    std::sort(of.begin(), of.end());
    of.erase(std::unique(of.begin(), of.end()), of.end());
    std::vector<Vec3> corners;
    for (const int vertex : of) corners.push_back(vertices_[std::size_t(vertex)]);
    const auto local = [&](std::vector<int> loop) {
      for (int& vertex : loop) vertex = int(std::lower_bound(of.begin(), of.end(), vertex) - of.begin());
      return loop;
    };
    std::vector<std::vector<int>> local_holes;
    for (const auto& hole : holes) local_holes.push_back(local(hole));
    const auto triangles = detail::PolygonTriangles(corners, normal).cut(local(outline), std::move(local_holes));
    if (!triangles) throw MeshError(MeshError::Reason::self_intersecting, "solid: a face's outline crosses or touches itself or its holes");
    for (const auto& t : *triangles) s.triangles.push_back({of[std::size_t(t[0])], of[std::size_t(t[1])], of[std::size_t(t[2])]});
  }
  validate_surface(s);
  return s;
}

}  // namespace lumo

// ---- lumo/fabrication/carrier_solid.hpp

namespace lumo {

/// The rigid carrier: a plate with mounting holes, and on it the ridge with a pocket for the LED strip and a duct for its wires through the plate.
/// The ridge is a clearance shorter than the pad, so that it goes between the mould's ends. Stands on z = −plate.
/// Throws InvalidArgument, MeshError.
template <class = void>
TriangleSurface carrier_solid(const CastSection& section, const CastingOptions& options = {});

namespace detail {

/// Corners of a regular polygon in a circle, in the plane of u and v, counter-clockwise seen from u × v.
template <class Vec3 = Vec3>
inline FacetedSolid::Loop ring(In<Vec3> center, In<Vec3> u, In<Vec3> v, double radius, int corners = 32) {
  FacetedSolid::Loop loop;
  for (int k = 0; k < corners; ++k) loop.push_back(center + radius * (std::cos(2.0 * pi * k / corners) * u + std::sin(2.0 * pi * k / corners) * v));
  return loop;
}

/// A rectangle in a plane of constant z, counter-clockwise seen from above.
template <class = void>
inline FacetedSolid::Loop rectangle(double x0, double x1, double y0, double y1, double z) {
  return {{x0, y0, z}, {x1, y0, z}, {x1, y1, z}, {x0, y1, z}};
}

}  // namespace detail

template <class>
inline TriangleSurface carrier_solid(const CastSection& s, const CastingOptions& o) {
  validate(o, s);
  using detail::rectangle;
  const CastingLayout at(s, o);
  const double bottom = -o.plate, ridge_x = 0.5 * s.ridge_width, ridge_y = at.half_length - 0.5 * o.clearance;
  FacetedSolid solid;
  const auto plate = [&](double z) { return rectangle(-at.plate_x, at.plate_x, -at.plate_y, at.plate_y, z); };
  const auto ridge = [&](double z) { return rectangle(-ridge_x, ridge_x, -ridge_y, ridge_y, z); };
  const auto pocket = [&](double z) { return rectangle(-at.pocket_x, at.pocket_x, -at.pocket_y, at.pocket_y, z); };
  const auto duct = [&](double z) { return rectangle(-0.5 * o.strip_width, 0.5 * o.strip_width, -at.strip_y, CastingLayout::duct_length - at.strip_y, z); };
  const auto holes = [&](double z) {
    std::vector<FacetedSolid::Loop> loops;
    for (const double x : {-1.0, 1.0})
      for (const double y : {-1.0, 1.0})
        loops.push_back(reversed(detail::ring(Vec3(x * (at.half_width - 5.0e-3), y * (at.half_length + 0.5 * o.tab), z), Vec3::UnitX(), Vec3::UnitY(),
                                              0.5 * o.hole_diameter)));
    return loops;
  };
  auto below = holes(bottom), above = holes(0.0);
  for (std::size_t k = 0; k < below.size(); ++k) solid.band(below[k], above[k]);
  solid.band(plate(bottom), plate(0.0));
  solid.band(ridge(0.0), ridge(s.ridge_height));
  solid.band(reversed(duct(bottom)), reversed(duct(at.pocket_floor)));
  solid.band(reversed(pocket(at.pocket_floor)), reversed(pocket(s.ridge_height)));

  std::vector<FacetedSolid::Loop> openings;   // seen from below
  for (const auto& loop : below) openings.push_back(reversed(loop));
  openings.push_back(duct(bottom));
  solid.face(reversed(plate(bottom)), openings);
  above.push_back(reversed(ridge(0.0)));
  solid.face(plate(0.0), above);
  solid.face(pocket(at.pocket_floor), {reversed(duct(at.pocket_floor))});
  solid.face(ridge(s.ridge_height), {reversed(pocket(s.ridge_height))});
  return solid.surface();
}

}  // namespace lumo

// ---- lumo/fabrication/core_solid.hpp

namespace lumo {

/// Outline (y, z) of the core that keeps a gap free, counter-clockwise seen along −x [m]: a bar of the gap's height from one end of the cavity out through the
/// other, a handle behind it, and a step that stops at the mould.
inline std::vector<std::array<double, 2>> core_outline(const CastSection& s, const CastingOptions& o = {}) {
  const CastingLayout at(s, o);
  constexpr double handle = 10.0e-3;
  return {{-at.half_length, 0.0}, {at.mould_y, 0.0}, {at.mould_y, -o.rim}, {at.mould_y + handle, -o.rim}, {at.mould_y + handle, s.ridge_height},
          {-at.half_length, s.ridge_height}};
}

/// The core of the gap at x > 0, as thick as the gap is wide; the other one is the same, shifted. It comes out along +y.
/// Throws InvalidArgument where there is no gap, MeshError.
template <class = void>
inline TriangleSurface core_solid(const CastSection& s, const CastingOptions& o = {}) {
  validate(o, s);
  require_positive("gap width", s.gap_width * 1e3, "mm");
  const auto side = [&](double x) {
    FacetedSolid::Loop loop;
    for (const auto& p : core_outline(s, o)) loop.emplace_back(x, p[0], p[1]);
    return loop;
  };
  const auto inner = side(0.5 * s.ridge_width), outer = side(0.5 * s.ridge_width + s.gap_width);
  FacetedSolid solid;
  solid.band(inner, outer);
  solid.face(reversed(inner));
  solid.face(outer);
  return solid.surface();
}

}  // namespace lumo

// ---- lumo/fabrication/mould_half.hpp

namespace lumo {

/// An opening through the wall of mould half A at the end at which the pad is poured: the frustum of a cone along y; lengths in m, places in (x, z).
struct Opening {
  std::array<double, 2> at_pad, outside;   ///< centres at the pad's end and at the mould's outer face
  double radius, outer_radius;

  /// Volume of the opening, which is cut as a frustum over a regular polygon [m³].
  double volume_m3(double length, int corners = 32) const {
    const double unit = 0.5 * corners * std::sin(2.0 * pi / corners);
    return unit * length / 3.0 * (radius * radius + radius * outer_radius + outer_radius * outer_radius);
  }
};

/// A gate near the dome's middle, and a vent in each lower corner, where air would stay: poured with this end up, the end face is the highest place of the cavity.
std::vector<Opening> pour_openings(const CastSection& section, const CastingOptions& options = {});

/// Mould half A: the pad's side at x > 0 and its whole end at y > 0, with gate, vents and openings for the cores. Half B is the other side and the other end.
/// The parting runs along the crown (x = 0) and round the ends, so that no face of the pad needs draft of its own: opened along (cos β, sin β, 0) the ends
/// draw at β and the crown at its own slope. A cone and a socket on the parting face centre the halves; the rim below takes in the carrier's plate.
/// Throws InvalidArgument, MeshError.
template <class = void>
TriangleSurface mould_half_a(const CastSection& section, const CastingOptions& options = {});
template <class = void>
TriangleSurface mould_half_b(const CastSection& section, const CastingOptions& options = {});

inline std::vector<Opening> pour_openings(const CastSection& s, const CastingOptions& o) {
  const CastingLayout at(s, o);
  const double length = at.mould_y - at.half_length, gate = 0.5 * o.gate_diameter, vent = 0.5 * o.vent_diameter;
  // A funnel of 15° half angle that widens upwards only, as far as the mould allows; high up in a thick dome.
  const double z = std::max(0.5 * (s.ridge_height + s.height()), s.height() - 4.5e-3);
  const double funnel = std::max(gate, std::min(gate + length * std::tan(15.0_deg), 0.5 * (at.mould_top - 2.0e-3 - (z - gate))));
  const double corner_x = at.half_width - 2.5e-3, corner_z = 2.5e-3;
  std::vector<Opening> list{{{0.0, z}, {0.0, z - gate + funnel}, gate, funnel}};
  for (const double side : {-1.0, 1.0}) list.push_back({{side * corner_x, corner_z}, {side * corner_x, corner_z}, vent, std::min(vent + length * std::tan(3.0_deg), 1.9e-3)});
  return list;
}

namespace detail {

/// Tells the faces of one half; `poured` is half A with its openings and the notches for the cores, else they are left out.
class MouldHalf {
 public:
  MouldHalf(const CastSection& s, const CastingOptions& o, bool poured) : s_(s), o_(o), at_(s, o), near_(-at_.half_length), end_(at_.half_length), rim_(-o.rim) {
    if (!poured) return;
    openings_ = pour_openings(s, o);
    if (s.gap_width > 0.0) notches_ = {{-at_.notch_outer, -at_.notch_inner}, {at_.notch_inner, at_.notch_outer}};
  }

  template <class = void>
  TriangleSurface surface() {
    cavity();
    parting();
    underside();
    outside();
    notches();
    openings();
    return solid_.surface();
  }

 private:
  using Loop = FacetedSolid::Loop;
  using Corners = std::vector<std::array<double, 2>>;

  /// Of corners (x, z), in a plane of constant y.
  static Loop upright(const Corners& corners, double y) {
    Loop loop;
    for (const auto& c : corners) loop.emplace_back(c[0], y, c[1]);
    return loop;
  }
  /// Of corners (y, z), in a plane of constant x.
  static Loop lengthwise(const Corners& corners, double x) {
    Loop loop;
    for (const auto& c : corners) loop.emplace_back(x, c[0], c[1]);
    return loop;
  }
  /// Of corners (x, y), in a plane of constant z.
  static Loop level(const Corners& corners, double z) {
    Loop loop;
    for (const auto& c : corners) loop.emplace_back(c[0], c[1], z);
    return loop;
  }

  /// A line at height z from the mould's left side, with a step up to `up` over each core.
  Corners stepped(double z, double up) const {
    Corners line{{-at_.mould_x, z}};
    for (const auto& [a, b] : notches_) line.insert(line.end(), {{a, z}, {a, up}, {b, up}, {b, z}});
    return line;
  }

  template <class = void>
  void cavity();
  template <class = void>
  void parting();
  template <class = void>
  void underside();
  template <class = void>
  void outside();
  template <class = void>
  void notches();
  template <class = void>
  void openings();

  const CastSection& s_;
  const CastingOptions& o_;
  CastingLayout at_;
  std::vector<Opening> openings_;
  std::vector<std::pair<double, double>> notches_;   ///< from and to, along x
  double near_, end_, rim_;   ///< y of the cavity's ends, z of the rim's foot
  FacetedSolid solid_;
};

/// The pad's side, the end that closes it, and the flat face at which the other half's end closes it.
template <class>
inline void MouldHalf::cavity() {
  solid_.band(upright(s_.outline, near_), upright(s_.outline, end_), false);
  const Corners crown(s_.outline.rbegin(), s_.outline.rend());
  Corners face{{at_.half_width, 0.0}, {at_.rim_x, 0.0}, {at_.rim_x, rim_}, {at_.mould_x, rim_}, {at_.mould_x, at_.mould_top}, {0.0, at_.mould_top}};
  face.insert(face.end(), crown.begin(), crown.end() - 1);
  solid_.face(upright(face, near_));

  Corners wall = stepped(0.0, at_.notch_roof);
  wall.insert(wall.end(), s_.outline.begin(), s_.outline.end());
  wall.insert(wall.end(), {{0.0, at_.mould_top}, {-at_.mould_x, at_.mould_top}});
  std::vector<Loop> holes;
  for (const Opening& opening : openings_)
    holes.push_back(reversed(ring(Vec3(opening.at_pad[0], end_, opening.at_pad[1]), Vec3::UnitX(), Vec3::UnitZ(), opening.radius)));
  solid_.face(upright(wall, end_), holes);
}

/// The face on the crown with a cone towards +y and a socket for the other half's towards −y. Their 20° let them go along any opening direction up to that.
template <class>
inline void MouldHalf::parting() {
  constexpr double radius = 2.5e-3, height = 3.0e-3;
  const double tip = radius - height * std::tan(20.0_deg), c = o_.clearance, z = at_.top + 0.5 * o_.wall, y = 0.67 * at_.half_length;
  const auto around = [&](double x, double place, double r) { return ring(Vec3(x, place, z), Vec3::UnitZ(), Vec3::UnitY(), r); };   // seen from −x
  solid_.face(lengthwise({{near_, at_.top}, {near_, at_.mould_top}, {end_, at_.mould_top}, {end_, at_.top}}, 0.0),
              {reversed(around(0.0, y, radius)), reversed(around(0.0, -y, radius + c))});
  solid_.band(around(0.0, y, radius), around(-height, y, tip));
  solid_.face(around(-height, y, tip));
  solid_.band(reversed(around(height + c, -y, tip + c)), reversed(around(0.0, -y, radius + c)));
  solid_.face(around(height + c, -y, tip + c));
}

/// The ledge that lies on the carrier's plate, and the rim round it.
template <class>
inline void MouldHalf::underside() {
  const double left = -at_.mould_x, from = notches_.empty() ? left : at_.notch_outer;
  solid_.face(reversed(level({{at_.half_width, near_}, {at_.rim_x, near_}, {at_.rim_x, at_.rim_y}, {from, at_.rim_y}, {from, end_}, {at_.half_width, end_}}, 0.0)));
  if (!notches_.empty())
    for (const auto& [a, b] : {std::pair{left, -at_.notch_outer}, std::pair{-at_.notch_inner, at_.notch_inner}})
      solid_.face(reversed(rectangle(a, b, end_, at_.rim_y, 0.0)));
  solid_.face(reversed(level({{at_.rim_x, near_}, {at_.mould_x, near_}, {at_.mould_x, at_.mould_y}, {left, at_.mould_y}, {left, at_.rim_y},
                               {at_.rim_x, at_.rim_y}}, rim_)));
  solid_.face(reversed(lengthwise({{near_, rim_}, {at_.rim_y, rim_}, {at_.rim_y, 0.0}, {near_, 0.0}}, at_.rim_x)));
  Corners inner = stepped(0.0, -o_.clearance);   // along its top
  std::reverse(inner.begin(), inner.end());
  inner.insert(inner.end(), {{left, rim_}, {at_.rim_x, rim_}, {at_.rim_x, 0.0}});
  solid_.face(upright(inner, at_.rim_y));
}

template <class>
inline void MouldHalf::outside() {
  const double right = at_.mould_x, top = at_.mould_top, far = at_.mould_y;
  solid_.face(level({{0.0, near_}, {right, near_}, {right, far}, {-right, far}, {-right, end_}, {0.0, end_}}, top));
  solid_.face(lengthwise({{near_, rim_}, {far, rim_}, {far, top}, {near_, top}}, right));
  solid_.face(reversed(lengthwise({{end_, 0.0}, {at_.rim_y, 0.0}, {at_.rim_y, rim_}, {far, rim_}, {far, top}, {end_, top}}, -right)));
  std::vector<Loop> holes;
  for (const auto& [a, b] : notches_) holes.push_back(upright({{a, -o_.clearance}, {b, -o_.clearance}, {b, at_.notch_roof}, {a, at_.notch_roof}}, far));
  for (const Opening& opening : openings_)
    holes.push_back(ring(Vec3(opening.outside[0], far, opening.outside[1]), Vec3::UnitX(), Vec3::UnitZ(), opening.outer_radius));
  solid_.face(reversed(upright({{-right, rim_}, {right, rim_}, {right, top}, {-right, top}}, far)), holes);
}

/// Through the end wall, open to the plate; the rim below it is a clearance lower, so that the core lies on the plate.
template <class>
inline void MouldHalf::notches() {
  const double low = -o_.clearance, roof = at_.notch_roof, far = at_.mould_y;
  const Corners cheek{{end_, 0.0}, {at_.rim_y, 0.0}, {at_.rim_y, low}, {far, low}, {far, roof}, {end_, roof}};
  for (const auto& [a, b] : notches_) {
    solid_.face(lengthwise(cheek, a));
    solid_.face(reversed(lengthwise(cheek, b)));
    solid_.face(reversed(rectangle(a, b, end_, far, roof)));
    solid_.face(rectangle(a, b, at_.rim_y, far, low));
  }
}

template <class>
inline void MouldHalf::openings() {
  for (const Opening& o : openings_) {
    const Loop inner = ring(Vec3(o.at_pad[0], end_, o.at_pad[1]), Vec3::UnitX(), Vec3::UnitZ(), o.radius);
    const Loop outer = ring(Vec3(o.outside[0], at_.mould_y, o.outside[1]), Vec3::UnitX(), Vec3::UnitZ(), o.outer_radius);
    solid_.band(reversed(outer), reversed(inner));
  }
}

}  // namespace detail

template <class>
inline TriangleSurface mould_half_a(const CastSection& s, const CastingOptions& o) {
  validate(o, s);
  return detail::MouldHalf(s, o, true).surface();
}

template <class>
inline TriangleSurface mould_half_b(const CastSection& s, const CastingOptions& o) {
  validate(o, s);
  TriangleSurface half = detail::MouldHalf(s, o, false).surface();
  for (Vec3& v : half.vertices) v = Vec3(-v.x(), -v.y(), v.z());
  return half;
}

}  // namespace lumo

// ---- lumo/fabrication/millimetres.hpp

namespace lumo::detail {

/// A length in mm with at most six digits after the point: nanometres. The same in every locale.
inline std::string in_mm(double length_m) {
  char digits[400];
  std::string s(digits, std::to_chars(digits, digits + sizeof digits, 1e3 * length_m, std::chars_format::fixed, 6).ptr);
  s.erase(s.find_last_not_of('0') + 1);
  if (s.back() == '.') s.pop_back();
  return s == "-0" ? "0" : s;
}

}  // namespace lumo::detail

// ---- lumo/fabrication/three_mf.hpp

namespace lumo {

/// A file within an archive.
struct ArchivedFile {
  std::string name;   ///< with its folders, as in "3D/3dmodel.model"
  std::string contents;
};

/// Packs files into the bytes of one .zip file. Laws: same files, same bits; unpacked, the files are the same. Throws InputError.
template <class A>
concept Archiver = requires(const A& archiver, std::span<const ArchivedFile> files) {
  { archiver.pack(files) } -> std::same_as<std::string>;
};

/// A thing to be printed, `copies` times, standing on z = 0 with its corner at the origin.
struct PrintItem {
  std::string name;   ///< letters, digits, blanks and _ only
  TriangleSurface surface;
  int copies = 1;
};

/// The files of a 3MF package in mm: one object each, the copies beside each other, `spacing` [m] apart. Throws InvalidArgument for a name with other characters.
/// Source: 3MF Consortium, 3D Manufacturing Format Core Specification 1.3; ECMA-376 part 2 (open packaging).
template <class Vec3 = Vec3>
std::vector<ArchivedFile> three_mf_files(std::span<const PrintItem> items, double spacing = 5.0e-3);

/// The package in one. Throws InputError when the stream fails.
template <Archiver A>
void write_3mf(std::ostream& out, std::span<const PrintItem> items, const A& archiver) {
  const std::string bytes = archiver.pack(three_mf_files(items));
  out.write(bytes.data(), std::streamsize(bytes.size()));
  if (!out) throw InputError("writing a .3mf file failed");
}

template <class Vec3>
inline std::vector<ArchivedFile> three_mf_files(std::span<const PrintItem> items, double spacing) {
  using detail::in_mm;
  std::string objects, build;
  double x = 0.0;
  for (std::size_t k = 0; k < items.size(); ++k) {
    const PrintItem& item = items[k];
    for (const char c : item.name)
      if (!((c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == ' ' || c == '_'))
        throw InvalidArgument(detail::text("name of a printed part is '", item.name, "', must be of letters, digits, blanks and _"));
    const std::string id = std::to_string(k + 1);
    objects += "<object id=\"" + id + "\" type=\"model\" name=\"" + item.name + "\"><mesh><vertices>\n";
    double width = 0.0;
    for (const Vec3& v : item.surface.vertices) {
      objects += "<vertex x=\"" + in_mm(v.x()) + "\" y=\"" + in_mm(v.y()) + "\" z=\"" + in_mm(v.z()) + "\"/>\n";
      width = std::max(width, v.x());
    }
    objects += "</vertices><triangles>\n";
    for (const auto& t : item.surface.triangles)
      objects += "<triangle v1=\"" + std::to_string(t[0]) + "\" v2=\"" + std::to_string(t[1]) + "\" v3=\"" + std::to_string(t[2]) + "\"/>\n";
    objects += "</triangles></mesh></object>\n";
    for (int copy = 0; copy < item.copies; ++copy, x += width + spacing)
      build += "<item objectid=\"" + id + "\" transform=\"1 0 0 0 1 0 0 0 1 " + in_mm(x) + " 0 0\"/>\n";
  }
  const std::string xml = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
  return {{"[Content_Types].xml", xml + "<Types xmlns=\"http://schemas.openxmlformats.org/package/2006/content-types\">"
                                        "<Default Extension=\"rels\" ContentType=\"application/vnd.openxmlformats-package.relationships+xml\"/>"
                                        "<Default Extension=\"model\" ContentType=\"application/vnd.ms-package.3dmanufacturing-3dmodel+xml\"/></Types>\n"},
          {"_rels/.rels", xml + "<Relationships xmlns=\"http://schemas.openxmlformats.org/package/2006/relationships\">"
                                "<Relationship Target=\"/3D/3dmodel.model\" Id=\"rel0\" Type=\"http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel\"/></Relationships>\n"},
          {"3D/3dmodel.model", xml + "<model unit=\"millimeter\" xml:lang=\"en\" xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\">\n<resources>\n" + objects +
                                   "</resources>\n<build>\n" + build + "</build>\n</model>\n"}};
}

}  // namespace lumo

// ---- lumo/fabrication/casting_kit.hpp

namespace lumo {

/// A part to be printed.
struct CastingPart {
  std::string name;
  TriangleSurface assembled;      ///< where it is in the closed mould, the pad's frame [m]
  TriangleSurface printed;        ///< as it is printed best: it stands on z = 0, without supports, its corner at the origin [m]
  int copies = 1;
  double volume_m3 = 0.0;         ///< of one
  Vec3 box = Vec3::Zero();        ///< edges of the printed one's bounding box [m]
};

/// Silicone that a cast takes [m³].
struct CastVolume {
  double pad = 0.0;               ///< the design's, exact
  double fits = 0.0;              ///< clearance about the LED strip and at the ridge's ends, which fills up too
  double openings = 0.0;          ///< gate and vents up to the mould's outer face: cut off
  double total() const { return pad + fits + openings; }
};

/// All that one pad is made with: carrier, mould halves a and b, and for a pad with gaps the cores. Throws InvalidArgument, MeshError.
template <class = void>
std::vector<CastingPart> casting_kit(const CastSection& section, const CastingOptions& options = {});

CastVolume cast_volume(const CastSection& section, const CastingOptions& options = {});

/// Smallest angle [rad] between the opening direction and the faces of a mould half that touch the pad; negative: an undercut.
/// Faces of the half that lie within the pad's box are such.
template <class Vec3 = Vec3>
double least_draft(const TriangleSurface& half, const CastSection& section, In<Vec3> direction);

/// Along which mould half A comes off; half B goes the other way. Ten degrees out of the parting's normal are the draft of the pad's ends.
template <class = void>
inline Vec3 opening_direction(double angle = 10.0_deg) { return {std::cos(angle), std::sin(angle), 0.0}; }

namespace detail {

/// Turned by a rotation and moved to the corner of the printer's bed.
template <class Mat3 = Mat3>
inline CastingPart print_part(std::string name, TriangleSurface surface, In<Mat3> turn, int copies = 1) {
  CastingPart part{std::move(name), surface, std::move(surface), copies};
  for (Vec3& v : part.printed.vertices) v = turn * v;
  const SurfaceReport report = validate_surface(part.printed);
  for (Vec3& v : part.printed.vertices) v -= report.low;
  part.volume_m3 = report.volume, part.box = report.high - report.low;
  return part;
}

}  // namespace detail

template <class>
inline std::vector<CastingPart> casting_kit(const CastSection& s, const CastingOptions& o) {
  // A mould half stands on its end wall: the dome's curve is then drawn by the printer's axes and not stepped by its layers.
  const Mat3 flat = Mat3::Identity(), on_far_end = (Mat3() << 1, 0, 0, 0, 0, 1, 0, -1, 0).finished(), on_near_end = (Mat3() << 1, 0, 0, 0, 0, -1, 0, 1, 0).finished(),
             on_side = (Mat3() << 0, 1, 0, 0, 0, 1, 1, 0, 0).finished();
  std::vector<CastingPart> kit;
  kit.push_back(detail::print_part("carrier", carrier_solid(s, o), flat));
  kit.push_back(detail::print_part("mould_a", mould_half_a(s, o), on_far_end));
  kit.push_back(detail::print_part("mould_b", mould_half_b(s, o), on_near_end));
  if (s.gap_width > 0.0) kit.push_back(detail::print_part("core", core_solid(s, o), on_side, 2));
  return kit;
}

inline CastVolume cast_volume(const CastSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  CastVolume v{s.exact_volume_m3, 4.0 * (at.pocket_x * at.pocket_y - 0.5 * o.strip_width * at.strip_y) * o.strip_height + s.ridge_width * s.ridge_height * o.clearance, 0.0};
  for (const Opening& opening : pour_openings(s, o)) v.openings += opening.volume_m3(at.mould_y - at.half_length);
  return v;
}

template <class Vec3>
inline double least_draft(const TriangleSurface& half, const CastSection& s, In<Vec3> direction) {
  const double width = s.half_width() + 1e-9, top = s.height() + 1e-9, length = 0.5 * s.length + 1e-9;
  double least = 0.5 * pi;
  for (const auto& t : half.triangles) {
    const Vec3 &a = half.vertices[std::size_t(t[0])], &b = half.vertices[std::size_t(t[1])], &c = half.vertices[std::size_t(t[2])];
    const Vec3 middle = (a + b + c) / 3.0;
    if (std::abs(middle.x()) > width || std::abs(middle.y()) > length || middle.z() < 0.0 || middle.z() > top) continue;
    const Vec3 normal = (b - a).cross(c - a).normalized();
    least = std::min(least, std::asin(std::clamp(-normal.dot(direction.normalized()), -1.0, 1.0)));
  }
  return least;
}

}  // namespace lumo

// ---- lumo/fabrication/drawing.hpp

namespace lumo {

/// A flat drawing for cutting and checking; lengths in m, x to the right, y upwards.
struct Drawing {
  using Point = std::array<double, 2>;
  struct Layer {
    std::string name;    ///< capitals and _ only
    int dxf_color;       ///< AutoCAD's colour index, 1 to 255
    std::string stroke;  ///< the same, as CSS writes it
  };
  struct Line {
    int layer;
    std::vector<Point> points;
    bool closed = true;
  };
  struct Label {
    int layer;
    Point at;            ///< left end of its baseline
    double height;       ///< of capitals
    std::string words;   ///< ASCII
  };

  std::string title;
  std::vector<Layer> layers;
  std::vector<Line> lines;
  std::vector<Label> labels;

  /// Lower left and upper right corner of all lines.
  std::array<Point, 2> box() const {
    constexpr double far = std::numeric_limits<double>::infinity();
    Point low{far, far}, high{-far, -far};
    for (const Line& line : lines)
      for (const Point& p : line.points) low = {std::min(low[0], p[0]), std::min(low[1], p[1])}, high = {std::max(high[0], p[0]), std::max(high[1], p[1])};
    return {low, high};
  }
};

}  // namespace lumo

// ---- lumo/fabrication/casting_drawings.hpp

namespace lumo {

/// The cross-section through the middle of the closed mould, seen along y, at scale 1:1. Throws InvalidArgument.
Drawing section_drawing(const CastSection& section, const CastingOptions& options = {});
/// The LED strip from above, y to the right: its outline and its LEDs. Throws InvalidArgument.
Drawing strip_drawing(const CastSection& section, const CastingOptions& options = {});
/// The side of a core, for cutting it from sheet. Throws InvalidArgument where there is no gap.
Drawing core_drawing(const CastSection& section, const CastingOptions& options = {});

namespace detail {

/// Words under a drawing, and a line of 10 mm by which a print can be measured.
inline void add_caption(Drawing& d, const std::string& words) {
  const int layer = int(d.layers.size());
  d.layers.push_back({"NOTES", 8, "#666666"});
  const auto box = d.box();
  const double x = box[0][0], y = box[0][1] - 5.0e-3;
  d.lines.push_back({layer, {{x, y + 1.0e-3}, {x, y}, {x + 10.0e-3, y}, {x + 10.0e-3, y + 1.0e-3}}, false});
  d.labels.push_back({layer, {x + 12.0e-3, y}, 1.8e-3, "10 mm"});
  d.labels.push_back({layer, {x, y - 4.0e-3}, 1.8e-3, words});
  d.title = words;
}

inline Drawing::Line box_line(int layer, double x0, double x1, double y0, double y1) { return {layer, {{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}}}; }

/// A half outline at x > 0 and its mirror image in one loop.
inline std::vector<Drawing::Point> mirrored(std::vector<Drawing::Point> half) {
  for (std::size_t i = half.size(); i-- > 0;)
    if (half[i][0] != 0.0) half.push_back({-half[i][0], half[i][1]});
  return half;
}

}  // namespace detail

inline Drawing section_drawing(const CastSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  const double ridge = 0.5 * s.ridge_width, led = 0.5 * s.leds.width_x;
  Drawing d;
  d.layers = {{"SILICONE", 4, "#0072b2"}, {"CARRIER", 8, "#444444"}, {"LED_STRIP", 2, "#b07400"}, {"MOULD", 3, "#009e73"}};
  if (s.gap_width > 0.0) d.layers.push_back({"CORES", 1, "#d55e00"});
  std::vector<Drawing::Point> pad{{ridge, s.ridge_height}};
  if (s.gap_width > 0.0) pad.insert(pad.end(), {{ridge + s.gap_width, s.ridge_height}, {ridge + s.gap_width, 0.0}});
  else pad.push_back({ridge, 0.0});
  pad.insert(pad.end(), s.outline.begin(), s.outline.end());
  d.lines.push_back({0, detail::mirrored(std::move(pad))});
  d.lines.push_back({1, detail::mirrored({{at.pocket_x, at.pocket_floor}, {at.pocket_x, s.ridge_height}, {ridge, s.ridge_height}, {ridge, 0.0},
                                          {at.plate_x, 0.0}, {at.plate_x, -o.plate}})});
  d.lines.push_back(detail::box_line(2, -0.5 * o.strip_width, 0.5 * o.strip_width, at.pocket_floor, s.ridge_height));
  d.lines.push_back({2, {{-led, s.ridge_height}, {led, s.ridge_height}}, false});
  for (const double side : {1.0, -1.0}) {
    std::vector<Drawing::Point> half{{at.half_width, 0.0}, {at.rim_x, 0.0}, {at.rim_x, -o.rim}, {at.mould_x, -o.rim}, {at.mould_x, at.mould_top},
                                     {0.0, at.mould_top}};
    half.insert(half.end(), s.outline.rbegin(), s.outline.rend() - 1);
    for (Drawing::Point& p : half) p[0] *= side;
    d.lines.push_back({3, std::move(half)});
    if (s.gap_width > 0.0) d.lines.push_back(detail::box_line(4, side * ridge, side * (ridge + s.gap_width), 0.0, s.ridge_height));
  }
  std::vector<std::string> legend{"silicone", "carrier", "LED strip", "mould"};
  if (s.gap_width > 0.0) legend.push_back("cores");
  for (int layer = 0; layer < int(legend.size()); ++layer)
    d.labels.push_back({layer, {at.mould_x + 3.0e-3, at.mould_top - (2.0 + 4.0 * layer) * 1e-3}, 1.8e-3, legend[std::size_t(layer)]});
  detail::add_caption(d, "Section at scale 1:1");
  return d;
}

inline Drawing strip_drawing(const CastSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  Drawing d;
  d.layers = {{"OUTLINE", 7, "#222222"}, {"LEDS", 2, "#b07400"}};
  d.lines.push_back(detail::box_line(0, -at.strip_y, at.strip_y, -0.5 * o.strip_width, 0.5 * o.strip_width));
  for (int k = 0; k < s.leds.count; ++k) {
    const double y = (k - 0.5 * (s.leds.count - 1)) * s.leds.pitch;
    d.lines.push_back(detail::box_line(1, y - 0.5 * s.leds.length_y, y + 0.5 * s.leds.length_y, -0.5 * s.leds.width_x, 0.5 * s.leds.width_x));
  }
  detail::add_caption(d, detail::text("LED strip at scale 1:1, ", 2e3 * at.strip_y, " x ", 1e3 * o.strip_width, " mm, LEDs every ", 1e3 * s.leds.pitch, " mm"));
  return d;
}

inline Drawing core_drawing(const CastSection& s, const CastingOptions& o) {
  validate(o, s);
  require_positive("gap width", s.gap_width * 1e3, "mm");
  Drawing d;
  d.layers = {{"OUTLINE", 7, "#222222"}};
  d.lines.push_back({0, core_outline(s, o)});
  detail::add_caption(d, detail::text("Core at scale 1:1, ", 1e3 * s.gap_width, " mm thick, two of them"));
  return d;
}

}  // namespace lumo

// ---- lumo/fabrication/stl.hpp

namespace lumo {

/// The surface as a binary .stl file in mm, the format's unit by habit. Throws InputError when the stream fails.
/// Source: 3D Systems, StereoLithography Interface Specification, 1989: 80 bytes, the number of triangles, then 50 bytes each, little-endian.
template <class Vec3 = Vec3>
inline void write_stl(std::ostream& out, const TriangleSurface& surface) {
  std::string bytes = "binary STL, mm, by lumo";   // not "solid", by which texts are told
  bytes.resize(80, ' ');
  const auto word = [&bytes](std::uint32_t value) {
    for (int shift = 0; shift < 32; shift += 8) bytes += char(value >> shift & 0xFFu);
  };
  const auto point = [&word](const Vec3& p) {
    for (int i = 0; i < 3; ++i) word(std::bit_cast<std::uint32_t>(float(p[i])));
  };
  word(std::uint32_t(surface.triangles.size()));
  for (const auto& t : surface.triangles) {
    const std::array<Vec3, 3> corner{1e3 * surface.vertices[std::size_t(t[0])], 1e3 * surface.vertices[std::size_t(t[1])], 1e3 * surface.vertices[std::size_t(t[2])]};
    point((corner[1] - corner[0]).cross(corner[2] - corner[0]).normalized());
    for (const Vec3& p : corner) point(p);
    bytes.append(2, '\0');
  }
  out.write(bytes.data(), std::streamsize(bytes.size()));
  if (!out) throw InputError("writing an .stl file failed");
}

}  // namespace lumo

// ---- lumo/fabrication/dxf.hpp

namespace lumo {

/// The drawing as a DXF file, one drawing unit a mm: AutoCAD R12 in ASCII, which every laser cutter's program reads. The format has no place for a unit, so
/// that the drawings say it in words. Throws InputError when the stream fails. Source: Autodesk, DXF Reference, release 12.
inline void write_dxf(std::ostream& out, const Drawing& drawing) {
  const auto pair = [&out](int code, const std::string& value) { out << code << "\n" << value << "\n"; };
  const auto point = [&pair](int code, const Drawing::Point& p) { pair(code, detail::in_mm(p[0])), pair(code + 10, detail::in_mm(p[1])), pair(code + 20, "0"); };
  const auto begin = [&pair](const char* section) { pair(0, "SECTION"), pair(2, section); };
  const auto name = [&drawing](int layer) { return drawing.layers[std::size_t(layer)].name; };
  const auto box = drawing.box();

  pair(999, drawing.title + ", mm, 1:1, by lumo");
  begin("HEADER");
  pair(9, "$ACADVER"), pair(1, "AC1009");
  pair(9, "$EXTMIN"), point(10, box[0]);
  pair(9, "$EXTMAX"), point(10, box[1]);
  pair(0, "ENDSEC");
  begin("TABLES");
  pair(0, "TABLE"), pair(2, "LTYPE"), pair(70, "1");
  pair(0, "LTYPE"), pair(2, "CONTINUOUS"), pair(70, "0"), pair(3, "Solid line"), pair(72, "65"), pair(73, "0"), pair(40, "0");
  pair(0, "ENDTAB");
  pair(0, "TABLE"), pair(2, "LAYER"), pair(70, std::to_string(drawing.layers.size()));
  for (const Drawing::Layer& l : drawing.layers) pair(0, "LAYER"), pair(2, l.name), pair(70, "0"), pair(62, std::to_string(l.dxf_color)), pair(6, "CONTINUOUS");
  pair(0, "ENDTAB");
  pair(0, "ENDSEC");
  begin("ENTITIES");
  for (const Drawing::Line& line : drawing.lines) {
    pair(0, "POLYLINE"), pair(8, name(line.layer)), pair(66, "1"), point(10, {0.0, 0.0}), pair(70, line.closed ? "1" : "0");
    for (const Drawing::Point& p : line.points) pair(0, "VERTEX"), pair(8, name(line.layer)), point(10, p);
    pair(0, "SEQEND"), pair(8, name(line.layer));
  }
  for (const Drawing::Label& label : drawing.labels)
    pair(0, "TEXT"), pair(8, name(label.layer)), point(10, label.at), pair(40, detail::in_mm(label.height)), pair(1, label.words);
  pair(0, "ENDSEC"), pair(0, "EOF");
  if (!out) throw InputError("writing a .dxf file failed");
}

}  // namespace lumo

// ---- lumo/fabrication/scaled_svg.hpp

namespace lumo {

/// The drawing as an SVG file at scale 1:1: its user unit is a mm, and so is its size on paper. Each layer is a group. Throws InputError when the stream fails.
inline void write_svg(std::ostream& out, const Drawing& drawing) {
  using detail::in_mm;
  constexpr double margin = 5.0e-3;
  auto [low, high] = drawing.box();
  for (const Drawing::Label& label : drawing.labels) {   // letters are at most as wide as high, but for few
    low = {std::min(low[0], label.at[0]), std::min(low[1], label.at[1])};
    high = {std::max(high[0], label.at[0] + 0.85 * label.height * double(label.words.size())), std::max(high[1], label.at[1] + label.height)};
  }
  const double left = low[0] - margin, top = high[1] + margin;
  const std::string width = in_mm(high[0] + margin - left), height = in_mm(top - low[1] + margin);
  const auto at = [&](const Drawing::Point& p) { return in_mm(p[0] - left) + " " + in_mm(top - p[1]); };
  out << "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" << width << "mm\" height=\"" << height << "mm\" viewBox=\"0 0 " << width << " " << height
      << "\" font-family=\"DejaVu Sans, Verdana, Helvetica, sans-serif\">\n<title>" << drawing.title << "</title>\n<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n";
  for (std::size_t k = 0; k < drawing.layers.size(); ++k) {
    const Drawing::Layer& layer = drawing.layers[k];
    out << "<g id=\"" << layer.name << "\" fill=\"none\" stroke=\"" << layer.stroke << "\" stroke-width=\"0.15\" stroke-linejoin=\"round\">\n";
    for (const Drawing::Line& line : drawing.lines) {
      if (std::size_t(line.layer) != k) continue;
      out << "<path d=\"";
      for (std::size_t i = 0; i < line.points.size(); ++i) out << (i == 0 ? "M" : "L") << at(line.points[i]);
      out << (line.closed ? "Z\"/>\n" : "\"/>\n");
    }
    for (const Drawing::Label& label : drawing.labels)
      if (std::size_t(label.layer) == k)   // DejaVu's capitals are 0.73 of its size high
        out << "<text x=\"" << in_mm(label.at[0] - left) << "\" y=\"" << in_mm(top - label.at[1]) << "\" font-size=\"" << in_mm(label.height / 0.73) << "\" fill=\"" << layer.stroke
            << "\" stroke=\"none\">" << label.words << "</text>\n";
    out << "</g>\n";
  }
  out << "</svg>\n";
  if (!out) throw InputError("writing an .svg file failed");
}

}  // namespace lumo

// ---- lumo/lab/draws.hpp

namespace lumo {

/// Random numbers by counting: what is drawn depends on the seed, the stream's number and the count, not on what was drawn elsewhere. The same on every machine
/// up to its mathematical functions' last bit.
class Draws {
 public:
  Draws(std::uint64_t seed, std::uint64_t stream) : key_(detail::combine(detail::combine(0x1ab0ull, seed), stream)) {}

  double uniform() { return detail::uniform(detail::combine(key_, count_++)); }
  /// Standard normal (Box & Muller 1958); each pair of uniforms gives two.
  double normal() {
    if (spare_) return spare_ = false, second_;
    const double r = std::sqrt(-2.0 * std::log(uniform())), a = 2.0 * pi * uniform();
    second_ = r * std::sin(a);
    spare_ = true;
    return r * std::cos(a);
  }

 private:
  std::uint64_t key_, count_ = 0;
  double second_ = 0.0;
  bool spare_ = false;
};

/// First-order Gauss–Markov noise of standard deviation 1.
class SlowNoise {
 public:
  SlowNoise(Draws draws, double time_s) : draws_(draws), time_s_(time_s), value_(draws_.normal()) {}
  /// At a time not before the last one.
  double at(double t_s) {
    const double keep = std::exp(-(t_s - t_s_) / time_s_);
    value_ = keep * value_ + std::sqrt(1.0 - keep * keep) * draws_.normal();
    t_s_ = t_s;
    return value_;
  }

 private:
  Draws draws_;
  double time_s_, value_, t_s_ = 0.0;
};

}  // namespace lumo

// ---- lumo/lab/rig.hpp

namespace lumo {

// Every number of the virtual rig, with its source or the word "assumed" (docs/virtual_lab.md tells what each does). They were fixed before any decoder, localiser
// or force estimator was run on a log of the lab; `noise` in LabRun multiplies all that is marked σ.

/// The camera, about an Intel RealSense D435's colour sensor at 640 × 480, of which a window about the finger is recorded. The picture is its green plane.
struct CameraRig {
  int width = 192, height = 80;       ///< of the window [px]
  double focal_px = 616.0;            ///< 1386 px at 1920 × 1080 (FOV 69.4°, FRAMOS D435e manual), 1080 rows made 480
  double distance_m = 0.25;           ///< from the facing side; assumed, 0.41 mm/px
  double aim_sigma_rad = 1.5_deg;     ///< σ of yaw, pitch and roll of one placing by hand; assumed
  double aim_sigma_m = 1.0_mm;        ///< σ of the place along y and z; assumed
  double frames_per_s = 30.0;
  double exposure_s = 1.0e-3;         ///< device setting 10 (paper), 100 µs each (librealsense #8243)
  double gain = 64.0;                 ///< device setting (paper)
  double level_DN = 70.0;             ///< of the unloaded side, mean over |y| ≤ 25 mm; assumed
  double gamma = 1.0;                 ///< DN = 255 (linear/255)^(1/gamma); 1: linear, assumed
  double black_DN = 2.0;              ///< assumed
  double full_DN = 255.0;
  double shot_DN = 0.03;              ///< σ² per DN of signal: SNR 36 dB at 128 DN (EMVA 1288 model; level from memory: assumed), σ
  double read_DN = 0.6;               ///< σ, assumed
  double row_DN = 0.35;               ///< σ of a row's offset, one frame; 0.3–0.5 (memory: assumed)
  double pixel_gain = 0.01;           ///< σ of fixed sensitivities, PRNU about 1 % (memory: assumed)
  double blur_px = 0.8;               ///< standard deviation of the lens's point spread; assumed
  double stamp_sigma_s = 0.2e-3;      ///< σ of a stamp; assumed
};

/// The finger's lamps and the room's.
struct LightRig {
  double lamp_drift = 3.0e-3;         ///< σ of the lamps' slow common change; LED drift 0.2 % between contacts, 1–2 % warm-up (memory: assumed)
  double lamp_drift_s = 20.0;         ///< its time
  double lamp_white = 1.0e-3;         ///< σ frame by frame; assumed
  double ambient_DN = 5.0;            ///< mean; assumed
  double ambient_slope = 0.2;         ///< relative, from end to end of the window; assumed
  double ambient_drift = 0.02;        ///< σ relative; assumed
  double ambient_drift_s = 5.0;
  double flicker = 0.1;               ///< σ-like amplitude of 100 Hz (mains) relative to ambient; assumed
  double flicker_hz = 100.0;
  double spot_DN = 80.0;              ///< a LED's package seen through the side, on top of the side's light; assumed (the paper detects five LEDs)
  double spot_sigma_m = 0.7_mm;       ///< half of the package's 1.6 mm, blurred; assumed
};

/// The indenter and how well it comes back.
struct ContactRig {
  double place_sigma_m = 0.25_mm;     ///< σ of a re-contact along y; indexed jig 0.2–0.3 mm (memory: assumed)
  double tilt_sigma_rad = 0.5_deg;    ///< σ: angle 0.4° and 0.2 mm sideways on a dome of 36 mm radius, 0.3° (memory: assumed)
  double load_sigma = 0.005;          ///< σ of a hold's load, relative; assumed
  double sensor_sigma_N = 0.05;       ///< σ of one sample of the force sensor (Bota Rokubi, memory: assumed)
  double sensor_bias_N = 0.05;        ///< σ after tare; vendor's test accepts 0.2 N (bota_driver)
  double sensor_hz = 100.0;
  double marker_sigma_m = 0.02_mm;    ///< σ of the followed marker on the indenter; assumed
};

/// Linear viscoelasticity: shear relaxation in parts of the instantaneous modulus. Solaris: half of what field notes suggest for Dragon Skin; assumed.
struct SiliconeRig {
  std::array<double, 3> part{0.02, 0.015, 0.015};
  std::array<double, 3> time_s{0.1, 1.0, 10.0};
};

/// One joint under local position control, with current for torque.
struct MotorRig {
  double joint_to_origin_m = 65.0_mm;       ///< assumed; sets what a fixed arm errs by (paper: 2.72 N)
  double torque_constant_Nm_per_A = 0.35;   ///< gear included; assumed
  double constant_sigma = 0.02;             ///< σ of the constant's relative error, one for each log; 3–5 % uncalibrated (memory: assumed)
  double stiction_Nm = 0.075;               ///< σ of what sticks; new when a contact begins or ends, constant in between: set for 1.29 N
  double white_Nm = 0.065;                  ///< σ of one sample; current noise and ripple: set for 1.29 N
  double coulomb_Nm = 0.02, viscous_Nm_s_per_rad = 0.01;  ///< while it turns; 5–25 mN·m (memory: assumed)
  double weight_Nm = 0.06;                  ///< of the finger, times sin q; assumed
  double bias_Nm = 0.01;                    ///< σ of the current sensor's offset, one for each log; assumed
  double velocity_sigma_rad_per_s = 0.003;  ///< σ; assumed
  double hold_rad = 0.15;                   ///< where it holds; assumed
  double stiffness_Nm_per_rad = 200.0;      ///< of the position control; assumed
  double hz = 250.0;
};

/// All of it.
struct Rig {
  CameraRig camera;
  LightRig light;
  ContactRig contact;
  SiliconeRig silicone;
  MotorRig motor;
};

/// Throws InvalidArgument for numbers that make no sense.
inline void validate(const Rig& r) {
  require_in_range("width of the camera's window", r.camera.width, 32, 4096, "px");
  require_in_range("height of the camera's window", r.camera.height, 32, 4096, "px");
  require_positive("focal length", r.camera.focal_px, "px");
  require_in_range("distance of the camera", r.camera.distance_m, 0.05, 10.0, "m");
  require_in_range("frame rate", r.camera.frames_per_s, 1.0, 1000.0, "1/s");
  require_in_range("gamma", r.camera.gamma, 0.2, 5.0, "");
  require_in_range("level of the unloaded side", r.camera.level_DN, 1.0, 250.0, "DN");
  require_in_range("rate of the joint samples", r.motor.hz, 10.0, 10000.0, "1/s");
  require_in_range("rate of the force sensor", r.contact.sensor_hz, 1.0, 10000.0, "1/s");
  require_positive("torque constant", r.motor.torque_constant_Nm_per_A, "N·m/A");
  require_positive("stiffness of the position control", r.motor.stiffness_Nm_per_rad, "N·m/rad");
  double sum = 0.0;
  for (std::size_t k = 0; k < r.silicone.part.size(); ++k) {
    require_in_range("part of the relaxation", r.silicone.part[k], 0.0, 0.9, "");
    require_positive("relaxation time", r.silicone.time_s[k], "s");
    sum += r.silicone.part[k];
  }
  require_in_range("sum of the relaxing parts", sum, 0.0, 0.9, "");
}

}  // namespace lumo

// ---- lumo/lab/side_geometry.hpp

namespace lumo {

/// What a pad's side looks like, apart from the light itself.
struct SideGeometry {
  double half_width_m = 14.75_mm;       ///< of the pad: the facing side is taken as the plane x = half_width_m
  double half_length_m = 30.0_mm;       ///< where the pad ends along y
  double low_m = 0.0, high_m = 9.0_mm;  ///< heights between which light leaves the visible side
  double lamp_height_m = 5.0_mm;        ///< z of the LEDs
  double refractive_index = 1.41;
  std::vector<double> lamp_m{-22.0_mm, -11.0_mm, 0.0, 11.0_mm, 22.0_mm};
};

/// Of a body that is symmetric in x and y: its visible surface reaches as high as its regions do, found to 1 % of the pad's height. Throws InvalidArgument for a body
/// without LEDs or visible surface.
template <class Vec3 = Vec3>
inline SideGeometry side_geometry(const Body& body) {
  if (body.emitters.empty() || body.vertices.empty()) throw InvalidArgument("virtual lab: the pad has no LEDs or no surface");
  SideGeometry g{0.0, 0.0, 1e300, -1e300, body.emitters.front().center().z(), body.medium.refractive_index, {}};
  for (const Vec3& v : body.vertices) g.half_width_m = std::max(g.half_width_m, v.x()), g.half_length_m = std::max(g.half_length_m, std::abs(v.y()));
  for (const Facet& f : body.facets) {
    if (f.patch < 0 || !body.patches[std::size_t(f.patch)].contactable) continue;
    for (std::size_t k = 0; k < f.loop.size(); ++k)
      for (int part = 0; part <= 64; ++part) {
        const Vec3 &a = body.vertices[std::size_t(f.loop[k])], &b = body.vertices[std::size_t(f.loop[(k + 1) % f.loop.size()])];
        Vec3 p = a + part / 64.0 * (b - a);
        p.y() = 0.0;
        p = closest_point(body.patches[std::size_t(f.patch)].shape, p);
        if (body.region(p, outward_normal(body, f.patch, p)) < 0) continue;
        g.low_m = std::min(g.low_m, p.z()), g.high_m = std::max(g.high_m, p.z());
      }
  }
  if (!(g.high_m > g.low_m)) throw InvalidArgument("virtual lab: no part of the pad's surface is visible from the side");
  for (const Emitter& e : body.emitters) g.lamp_m.push_back(e.center().y());
  std::sort(g.lamp_m.begin(), g.lamp_m.end());
  g.lamp_m.erase(std::unique(g.lamp_m.begin(), g.lamp_m.end()), g.lamp_m.end());   // one on each side
  return g;
}

}  // namespace lumo

// ---- lumo/lab/side_painter.hpp

namespace lumo {

/// Where the camera stands, from what it should be.
struct CameraPlace {
  double yaw_rad = 0.0, pitch_rad = 0.0, roll_rad = 0.0;
  double along_m = 0.0, height_m = 0.0;
};

/// Paints the side of a pad as a camera sees it: pinhole, lens blur, vignetting (cos⁴), shot, read, row and pixel noise, gamma, 8 bits.
/// The light of a bin fills the height of the visible side evenly (the responses do not tell more). LEDs are spots behind the side: in the pad's middle, as deep as
/// refraction lets them seem, so that their pitch looks smaller than the side's.
class SidePainter {
 public:
  /// `position_m`: middles of the light's bins, evenly spaced. Throws InvalidArgument when the side does not lie in the window.
  template <class VectorXd = Eigen::VectorXd, class Vector2d = Eigen::Vector2d, class Vector3d = Eigen::Vector3d, class Matrix3d = Eigen::Matrix3d, class AngleAxisd = Eigen::AngleAxisd>
  SidePainter(const CameraRig& camera, const LightRig& light, const SideGeometry& side, const CameraPlace& place, In<VectorXd> position_m, std::uint64_t seed);

  /// `light`: of each bin [DN before gamma]. `lamps`: factor of the lamps' spots. `room_DN`: of the room at the window's middle.
  Image paint(const Eigen::VectorXd& light, double lamps, double room_DN, double noise, Draws draws) const;

  /// Pixel of a point on the facing side.
  template <class Vector2d = Eigen::Vector2d>
  Eigen::Vector2d pixel(double y_m, double z_m) const { return project({side_.half_width_m, y_m, z_m}); }
  /// Pixel at which an LED is seen.
  template <class Vector2d = Eigen::Vector2d>
  Eigen::Vector2d lamp_pixel(double y_m) const { return project({side_.half_width_m - side_.half_width_m / side_.refractive_index, y_m, side_.lamp_height_m}); }

 private:
  struct Pixel {
    int bin;            ///< left one of the two that it lies between; −1: no light of the side
    float share;        ///< of the right one
    float side, spot, vignette, gain, room;
  };
  template <class Vector2d = Eigen::Vector2d, class Vector3d = Eigen::Vector3d>
  Eigen::Vector2d project(In<Vector3d> p) const {
    const Vector3d d = axes_.transpose() * (p - eye_);
    return centre_ + camera_.focal_px / d.z() * d.template head<2>();
  }

  CameraRig camera_;
  SideGeometry side_;
  Eigen::Vector3d eye_;
  Eigen::Matrix3d axes_;   ///< columns: right, down, forward
  Eigen::Vector2d centre_;
  std::vector<Pixel> pixels_;
};

template <class VectorXd, class Vector2d, class Vector3d, class Matrix3d, class AngleAxisd>
inline SidePainter::SidePainter(const CameraRig& camera, const LightRig& light, const SideGeometry& side, const CameraPlace& place, In<VectorXd> position_m,
                                std::uint64_t seed)
    : camera_(camera), side_(side), centre_(0.5 * (camera.width - 1), 0.5 * (camera.height - 1)) {
  const double middle = 0.5 * (side.low_m + side.high_m);
  // Level, looking along −x; distal to the right. It turns about the middle of the side: whoever places it aims at that.
  Matrix3d level;
  level << 0, 0, -1, 1, 0, 0, 0, -1, 0;
  const Vector3d aim(side.half_width_m, place.along_m, middle + place.height_m);
  const Matrix3d turn = (AngleAxisd(place.yaw_rad, Vector3d::UnitZ()) * AngleAxisd(place.pitch_rad, Vector3d::UnitY()) *
                                AngleAxisd(place.roll_rad, Vector3d::UnitX())).toRotationMatrix();
  axes_ = turn * level;
  eye_ = aim - camera.distance_m * axes_.col(2);

  const double spacing = position_m[1] - position_m[0], scale = camera.distance_m / camera.focal_px, blur = camera.blur_px * scale;
  const auto edge = [&](double distance) { return 0.5 * std::erfc(-distance / (std::sqrt(2.0) * blur)); };
  const Eigen::Index bins = position_m.size();
  pixels_.resize(std::size_t(camera.width) * std::size_t(camera.height));
  Draws sensitivity(seed, 101);
  for (int v = 0; v < camera.height; ++v)
    for (int u = 0; u < camera.width; ++u) {
      Pixel& p = pixels_[std::size_t(v) * std::size_t(camera.width) + std::size_t(u)];
      const Vector2d off = (Vector2d(u, v) - centre_) / camera.focal_px;
      const Vector3d ray = axes_ * Vector3d(off.x(), off.y(), 1.0);
      const Vector3d at = eye_ + (side.half_width_m - eye_.x()) / ray.x() * ray;
      const double cover = edge(at.y() + side.half_length_m) * edge(side.half_length_m - at.y()) * edge(at.z() - side.low_m) * edge(side.high_m - at.z());
      const double place_in_bins = std::clamp((at.y() - position_m[0]) / spacing, 0.0, double(bins - 1) - 1e-9);
      p.bin = cover > 1e-4 ? int(place_in_bins) : -1;
      p.share = float(place_in_bins - std::floor(place_in_bins));
      p.side = float(cover);
      double spot = 0.0;
      for (const double y : side.lamp_m) {
        const double sigma = std::hypot(light.spot_sigma_m / scale, camera.blur_px), d = (Vector2d(u, v) - lamp_pixel(y)).norm() / sigma;
        spot += light.spot_DN * std::exp(-0.5 * d * d);
      }
      p.spot = float(spot);
      const double cosine = 1.0 / std::sqrt(1.0 + off.squaredNorm());
      p.vignette = float(cosine * cosine * cosine * cosine);
      p.gain = float(sensitivity.normal());
      p.room = float(1.0 + light.ambient_slope * (double(u) / (camera.width - 1) - 0.5));
    }
  for (const double y : {-side.half_length_m, side.half_length_m})
    for (const double z : {side.low_m, side.high_m}) {
      const Vector2d corner = pixel(y, z);
      if (!(corner.x() >= 1.0 && corner.y() >= 1.0 && corner.x() <= camera.width - 2.0 && corner.y() <= camera.height - 2.0))
        throw InvalidArgument(detail::text("virtual camera: the pad's corner is seen at (", corner.x(), ", ", corner.y(), "), outside the window of ", camera.width, " x ", camera.height, " px"));
    }
}

inline Image SidePainter::paint(const Eigen::VectorXd& light, double lamps, double room_DN, double noise, Draws draws) const {
  Image image = Image::black(camera_.width, camera_.height, PixelFormat::grey);
  const double inverse_gamma = 1.0 / camera_.gamma;
  for (int v = 0; v < camera_.height; ++v) {
    std::uint8_t* row = image.row(v);
    const double row_offset = noise * camera_.row_DN * draws.normal();
    for (int u = 0; u < camera_.width; ++u) {
      const Pixel& p = pixels_[std::size_t(v) * std::size_t(camera_.width) + std::size_t(u)];
      double signal = room_DN * p.room + lamps * p.spot;
      if (p.bin >= 0) signal += p.side * ((1.0 - p.share) * light[p.bin] + p.share * light[p.bin + 1]);
      signal *= p.vignette * (1.0 + noise * camera_.pixel_gain * p.gain);
      signal = std::max(signal, 0.0);
      signal += noise * std::sqrt(camera_.shot_DN * signal + camera_.read_DN * camera_.read_DN) * draws.normal() + row_offset;
      double value = std::clamp(signal + camera_.black_DN, 0.0, camera_.full_DN);
      if (inverse_gamma != 1.0) value = camera_.full_DN * std::pow(value / camera_.full_DN, inverse_gamma);
      row[u] = std::uint8_t(std::lround(value));
    }
  }
  return image;
}

}  // namespace lumo

// ---- lumo/lab/protocol.hpp

namespace lumo {

/// One load of a contact: reached evenly, then held.
struct LoadStep {
  double load_N = 0.0;
  double ramp_s = 0.3;
  double hold_s = 1.0;
  std::string kind = "hold";  ///< of the hold's segment
  int cycle = -1;
};

/// One contact from first touch to leaving.
struct LabContact {
  int place = 0;
  double y_m = 0.0;          ///< of the jig
  int repetition = 0;
  std::vector<LoadStep> steps;
  double angle_rad = 0.0;    ///< of approach, small
  double rest_s = 1.0;       ///< without contact before it
  int view = 0;              ///< of LabPlan::views
};

/// A camera's place and the room's and lamps' light, as an experiment sets them on purpose.
struct LabView {
  CameraPlace place;
  double room = 1.0;         ///< ambient light, times the rig's
  double lamps = 1.0;        ///< 0: off
};

/// What is done in one log.
struct LabPlan {
  std::string title;
  double free_run_s = 0.0;   ///< the joint sweeps without contact, to get to know its friction and weight
  std::vector<LabContact> contacts;
  std::vector<LabView> views{LabView{}};
};

namespace detail {

inline constexpr std::array<double, 6> lab_places_m{-25e-3, -15e-3, -5e-3, 5e-3, 15e-3, 25e-3};
/// Places 1, 3 and 5 of those, numbered along the finger without gaps in their own logs, where they are each other's neighbours.
inline constexpr std::array<double, 3> lab_odd_places_m{lab_places_m[0], lab_places_m[2], lab_places_m[4]};

inline std::vector<LoadStep> lab_holds(const std::vector<double>& loads_N, double ramp_s, double hold_s) {
  std::vector<LoadStep> steps;
  for (const double f : loads_N) steps.push_back({f, ramp_s, hold_s});
  return steps;
}

}  // namespace detail

/// Six places 10 mm apart, `repetitions` independent re-contacts each, 2, 5, 10, 15 N held 1 s, unloaded in between (paper, re-contact evaluation).
inline LabPlan recontact_plan(int repetitions = 5) {
  require_in_range("repetitions", repetitions, 1, 1000, "");
  LabPlan plan{"re-contacts at six places", 0.0, {}};
  for (int r = 0; r < repetitions; ++r)
    for (int p = 0; p < 6; ++p) plan.contacts.push_back({p, detail::lab_places_m[std::size_t(p)], r, detail::lab_holds({2, 5, 10, 15}, 0.3, 1.0)});
  return plan;
}

/// Five unbroken cycles between 2 and 15 N at places 1, 3 and 5, three runs, after re-contacts for the other metrics (paper, contact cycling).
inline LabPlan cycle_plan(int runs = 3) {
  require_in_range("runs", runs, 1, 1000, "");
  LabPlan plan{"cycles within contact at three places", 0.0, {}};
  for (int r = 0; r < runs; ++r)
    for (int p = 0; p < 3; ++p) {
      const double y = detail::lab_odd_places_m[std::size_t(p)];
      LabContact c{p, y, r, {}};
      for (int k = 0; k < 5; ++k)
        for (const double f : {2.0, 15.0}) c.steps.push_back({f, 0.5, 0.5, "cycle", k});
      plan.contacts.push_back(std::move(c));
      // The same contact anew: one hold at each load, for W_recontact and D_neighbor of these runs.
      plan.contacts.push_back({p, y, r, detail::lab_holds({2, 5, 10, 15}, 0.3, 0.5)});
    }
  return plan;
}

/// Places 1, 3 and 5 up to 20 N under other camera heights and pitches, other room light, and with the LEDs off (paper, imaging variation).
inline LabPlan imaging_plan() {
  LabPlan plan{"imaging variation", 0.0, {}, {}};
  plan.views = {{}, {{0, 0, 0, 0, 1.5_mm}}, {{0, 0, 0, 0, -1.5_mm}}, {{0, 6.0_deg}}, {{0, -6.0_deg}}, {{}, 4.0}, {{}, 1.0, 0.0}};
  for (int v = 0; v < int(plan.views.size()); ++v)
    for (int p = 0; p < 3; ++p) plan.contacts.push_back({p, detail::lab_odd_places_m[std::size_t(p)], v, detail::lab_holds({2, 5, 10, 15, 20}, 0.3, 0.5), 0.0, 1.0, v});
  return plan;
}

/// An unloaded sweep of the joint, then six sequences of 2, 5, 10, 15, 20 N, one for each place (paper, force estimation).
inline LabPlan force_plan() {
  LabPlan plan{"location and force at six places", 9.0, {}};
  for (int p = 0; p < 6; ++p) plan.contacts.push_back({p, detail::lab_places_m[std::size_t(p)], 0, detail::lab_holds({2, 5, 10, 15, 20}, 0.3, 0.9), 0.0, 1.5});
  return plan;
}

}  // namespace lumo

// ---- lumo/lab/relaxation.hpp

namespace lumo {

/// What load would, in equilibrium, give the deformation that a pad has now: it lags behind the load on it (Prony series; generalised Maxwell body).
/// With the equilibrium modulus for unit, load = e + Σ w_k h_k, where h_k' = e' − h_k/τ_k and w_k = part_k/(1 − Σ part).
class Relaxation {
 public:
  explicit Relaxation(const SiliconeRig& rig) : time_s_(rig.time_s) {
    double rest = 1.0;
    for (const double g : rig.part) rest -= g;
    for (std::size_t k = 0; k < weight_.size(); ++k) weight_[k] = rig.part[k] / rest;
  }

  /// Goes on by `dt_s` to the load [N] that is then there; e changes linearly within the step, for which the branches are exact. Returns e, never below 0.
  double step(double load_N, double dt_s) {
    double lag = 0.0, whole = 1.0;
    std::array<double, 3> keep{}, gain{};
    for (std::size_t k = 0; k < weight_.size(); ++k) {
      keep[k] = std::exp(-dt_s / time_s_[k]);
      gain[k] = (1.0 - keep[k]) * time_s_[k] / dt_s;
      lag += weight_[k] * (keep[k] * branch_[k] - gain[k] * equivalent_N_);
      whole += weight_[k] * gain[k];
    }
    const double next = std::max(0.0, (load_N - lag) / whole);
    for (std::size_t k = 0; k < weight_.size(); ++k) branch_[k] = keep[k] * branch_[k] + gain[k] * (next - equivalent_N_);
    return equivalent_N_ = next;
  }
  double equivalent_N() const { return equivalent_N_; }

 private:
  std::array<double, 3> time_s_, weight_{}, branch_{};
  double equivalent_N_ = 0.0;
};

}  // namespace lumo

// ---- lumo/lab/virtual_rig.hpp

namespace lumo {

/// What was really so at a frame. For whoever compares estimates with it, never for who makes them.
struct TruthSample {
  std::int64_t stamp_ns = 0;
  int contact = -1;            ///< number in the plan; −1: none
  double y_m = 0.0, force_N = 0.0, tilt_rad = 0.0;
  double equivalent_N = 0.0;   ///< load that in equilibrium gives the deformation there is
  double depth_m = 0.0;
};

/// truth.csv: stamp_ns, contact, y_mm, force_N, tilt_deg, equivalent_N, depth_mm.
inline std::string truth_text(const std::vector<TruthSample>& truth) {
  std::string t = "stamp_ns,contact,y_mm,force_N,tilt_deg,equivalent_N,depth_mm\n";
  for (const TruthSample& s : truth) {
    t += std::to_string(s.stamp_ns) + ',' + std::to_string(s.contact);
    for (const double v : {1e3 * s.y_m, s.force_N, s.tilt_rad * 180.0 / pi, s.equivalent_N, 1e3 * s.depth_m}) t += ',' + csv_number(v);
    t += '\n';
  }
  return t;
}

/// A pad, a camera, a motor and an indenter that go through a plan and leave a log as a real rig would. Light comes from computed responses only. A pure function
/// of responses, plan, seed and `noise`, which multiplies every σ of the rig.
class VirtualRig {
 public:
  /// `light` stays the caller's. Throws InvalidArgument for numbers that make no sense, or loads and places beyond those computed.
  template <class = void>
  VirtualRig(const PadLight& light, LabPlan plan, std::uint64_t seed = 1, double noise = 1.0, Rig rig = {}, SideGeometry side = {});

  const Session& session() const { return session_; }
  const std::vector<FrameRecord>& frames() const { return frames_; }
  const std::vector<JointSample>& joints() const { return joints_; }
  const std::vector<WrenchSample>& wrenches() const { return wrenches_; }
  const std::vector<MarkerSample>& markers() const { return markers_; }
  const std::vector<TruthSample>& truth() const { return truth_; }
  const Rig& rig() const { return rig_; }
  const LabPlan& plan() const { return plan_; }
  /// Picture k; the same whenever it is asked for.
  template <class VectorXd = Eigen::VectorXd>
  Image image(std::size_t k) const;

 private:
  struct Contact {
    double y_m, tilt_rad, stick_Nm;
    std::vector<double> load_N;  ///< of each step, as it came out
  };
  /// Load over a stretch of time, linear.
  struct Phase {
    double from_s, to_s, from_N, to_N;
    int contact;
  };
  struct Sampled {
    double load_N, equivalent_N;
    int contact;
  };

  void draw_contacts();
  void lay_out_time();
  void add_segment(double from_s, double to_s, const char* kind) {
    Segment s;
    s.from_ns = stamp(from_s), s.to_ns = stamp(to_s), s.kind = kind;
    session_.segments.push_back(s);
  }
  void deform();
  template <class = void>
  void record_joints();
  template <class Vec3 = Vec3>
  void record_forces();
  template <class = void>
  void record_frames();
  Sampled at(double t_s) const;
  static std::int64_t stamp(double t_s) { return std::llround(1e9 * t_s); }

  const PadLight* light_;
  LabPlan plan_;
  std::uint64_t seed_;
  double noise_;
  Rig rig_;
  SideGeometry side_;
  Session session_;
  std::vector<Contact> contacts_;
  std::vector<Phase> phases_;
  std::vector<Sampled> sampled_;   ///< at the joint's rate
  std::vector<SidePainter> painters_;
  std::vector<FrameRecord> frames_;
  std::vector<TruthSample> truth_;
  std::vector<int> view_;          ///< of each frame
  std::vector<double> lamps_, room_DN_;  ///< at each frame
  std::vector<JointSample> joints_;
  std::vector<WrenchSample> wrenches_;
  std::vector<MarkerSample> markers_;
  double end_s_ = 0.0, per_DN_ = 1.0;
};

/// The rig's camera as frames come from it. The rig stays the caller's.
class VirtualCamera {
 public:
  explicit VirtualCamera(const VirtualRig& rig) : rig_(&rig) {}

  template <class = void>
  std::optional<Frame> next() {
    if (next_ == rig_->frames().size()) return std::nullopt;
    image_ = rig_->image(next_);
    const FrameRecord& f = rig_->frames()[next_];
    return Frame{image_.view(), f.stamp_ns, f.exposure_s, f.gain, std::int64_t(next_++)};
  }
  StreamState state() const { return next_ == rig_->frames().size() ? StreamState::ended : StreamState::open; }

 private:
  const VirtualRig* rig_;
  Image image_;
  std::size_t next_ = 0;
};

static_assert(Camera<VirtualCamera>);

template <class>
inline VirtualRig::VirtualRig(const PadLight& light, LabPlan plan, std::uint64_t seed, double noise, Rig rig, SideGeometry side)
    : light_(&light), plan_(std::move(plan)), seed_(seed), noise_(noise), rig_(rig), side_(std::move(side)) {
  validate(rig_);
  require_in_range("noise of the virtual lab", noise_, 0.0, 100.0, "");
  for (const LabContact& c : plan_.contacts) {
    require_in_range("place of a contact", 1e3 * std::abs(c.y_m), 0.0, 1e3 * light.reach_m(), "mm");
    require_in_range("view of a contact", c.view, 0, double(plan_.views.size()) - 1.0, "");
    require_in_range("place's number", c.place, 0, 1000, "");
    for (const LoadStep& s : c.steps) {
      require_in_range("load of a contact", s.load_N, 0.0, light.max_load_N(), "N");
      require_positive("time to reach a load", s.ramp_s, "s");
    }
  }
  const PadResponses& r = light.responses();
  double sum = 0.0;
  int bins = 0;
  for (Eigen::Index b = 0; b < r.position_m.size(); ++b)
    if (std::abs(r.position_m[b]) <= 25.0_mm) sum += r.unloaded[b], ++bins;
  per_DN_ = rig_.camera.level_DN * bins / sum;

  session_.title = plan_.title;
  session_.clock = "virtual";
  session_.material = r.material;
  session_.theta_mm = r.theta_mm;
  session_.joint_to_origin_m = rig_.motor.joint_to_origin_m;
  session_.torque_constant_Nm_per_A = {rig_.motor.torque_constant_Nm_per_A};
  draw_contacts();
  lay_out_time();
  deform();
  record_joints();
  record_forces();
  record_frames();
}

inline void VirtualRig::draw_contacts() {
  Draws draws(seed_, 1);
  const double reach = light_->reach_m();
  for (const LabContact& c : plan_.contacts) {
    const double y = c.y_m + noise_ * rig_.contact.place_sigma_m * draws.normal(), tilt = c.angle_rad + noise_ * rig_.contact.tilt_sigma_rad * draws.normal();
    contacts_.push_back({std::clamp(y, -reach, reach), tilt, noise_ * rig_.motor.stiction_Nm * draws.normal(), {}});
    for (const LoadStep& s : c.steps) contacts_.back().load_N.push_back(std::min(light_->max_load_N(), s.load_N * (1.0 + noise_ * rig_.contact.load_sigma * draws.normal())));
  }
}

inline void VirtualRig::lay_out_time() {
  double t = plan_.free_run_s;
  if (t > 0.0) add_segment(0.0, t, "free");
  for (std::size_t i = 0; i < plan_.contacts.size(); ++i) {
    const LabContact& c = plan_.contacts[i];
    phases_.push_back({t, t + c.rest_s, 0.0, 0.0, -1});
    const double from = t + std::min(0.5, 0.5 * c.rest_s), to = t + c.rest_s - 0.02;
    add_segment(from, to, "unloaded");
    if (plan_.views[std::size_t(c.view)].lamps == 0.0) add_segment(from, to, "dark");
    t += c.rest_s;
    double load = 0.0;
    for (std::size_t k = 0; k < c.steps.size(); ++k) {
      const LoadStep& s = c.steps[k];
      phases_.push_back({t, t + s.ramp_s, load, contacts_[i].load_N[k], int(i)});
      t += s.ramp_s, load = contacts_[i].load_N[k];
      phases_.push_back({t, t + s.hold_s, load, load, int(i)});
      Segment g;
      g.from_ns = stamp(t + 0.2 * s.hold_s), g.to_ns = stamp(t + s.hold_s), g.kind = s.kind, g.place = c.place, g.y_mm = 1e3 * c.y_m, g.repetition = c.repetition;
      g.cycle = s.cycle, g.load_N = s.load_N, g.angle_deg = c.angle_rad * 180.0 / pi, g.diameter_mm = 1e3 * light_->responses().diameter_m;
      session_.segments.push_back(g);
      t += s.hold_s;
    }
    phases_.push_back({t, t + 0.2, load, 0.0, int(i)});
    t += 0.2;
  }
  phases_.push_back({t, t + 1.0, 0.0, 0.0, -1});
  end_s_ = t + 1.0;
}

inline void VirtualRig::deform() {
  int places = 1;
  for (const LabContact& c : plan_.contacts) places = std::max(places, c.place + 1);
  std::vector<Relaxation> pad(std::size_t(places), Relaxation(rig_.silicone));  // a place remembers its own contacts
  const double dt = 1.0 / rig_.motor.hz;
  std::size_t phase = 0;
  for (double t = 0.0; t < end_s_; t += dt) {
    while (phase + 1 < phases_.size() && t >= phases_[phase].to_s) ++phase;
    Sampled s{0.0, 0.0, -1};
    if (const Phase& p = phases_[phase]; p.contact >= 0 && t >= p.from_s)
      s = {p.from_N + (p.to_N - p.from_N) * std::clamp((t - p.from_s) / (p.to_s - p.from_s), 0.0, 1.0), 0.0, p.contact};
    const int place = s.contact < 0 ? -1 : plan_.contacts[std::size_t(s.contact)].place;
    for (int k = 0; k < places; ++k) {
      const double equivalent = pad[std::size_t(k)].step(k == place ? s.load_N : 0.0, dt);
      if (k == place) s.equivalent_N = equivalent;
    }
    sampled_.push_back(s);
  }
}

inline VirtualRig::Sampled VirtualRig::at(double t_s) const {
  const double index = std::clamp(t_s * rig_.motor.hz, 0.0, double(sampled_.size() - 1));
  const auto i = std::size_t(index), j = std::min(i + 1, sampled_.size() - 1);
  const Sampled &a = sampled_[i], &b = sampled_[j];
  const double share = index - double(i);
  if (a.contact != b.contact) return share < 0.5 ? a : b;
  return {a.load_N + share * (b.load_N - a.load_N), a.equivalent_N + share * (b.equivalent_N - a.equivalent_N), a.contact};
}

template <class>
inline void VirtualRig::record_joints() {
  const MotorRig& m = rig_.motor;
  Draws once(seed_, 2), draws(seed_, 3), stick(seed_, 4);
  const double constant = m.torque_constant_Nm_per_A * (1.0 + noise_ * m.constant_sigma * once.normal()), bias = noise_ * m.bias_Nm * once.normal();
  const double dt = 1.0 / m.hz;
  double rest_stick = 0.0, last_load = 0.0;
  int last = -1;
  bool moving = false;
  for (std::size_t i = 0; i < sampled_.size(); ++i) {
    const double t = double(i) * dt;
    const Sampled& s = sampled_[i];
    if (s.contact < 0 && (last >= 0 || i == 0)) rest_stick = noise_ * m.stiction_Nm * stick.normal();
    last = s.contact;
    const double arm = s.contact < 0 ? 0.0 : m.joint_to_origin_m + contacts_[std::size_t(s.contact)].y_m, load = s.load_N * arm;
    double q = m.hold_rad - load / m.stiffness_Nm_per_rad, v = -(load - last_load) / m.stiffness_Nm_per_rad / dt, friction = s.contact < 0 ? rest_stick : contacts_[std::size_t(s.contact)].stick_Nm;
    if (i == 0) v = 0.0;
    last_load = load;
    if (t < plan_.free_run_s) {  // to and fro, with a rest after each sweep: moving tells of friction, resting of what sticks
      const double beat = 0.75, sweep = 0.5, swing = 0.35, k = std::floor(t / beat), phase = std::min((t - k * beat) / sweep, 1.0), way = std::fmod(k, 2.0) == 0.0 ? 1.0 : -1.0;
      q = m.hold_rad - way * swing * std::cos(pi * phase), v = phase < 1.0 ? way * swing * pi / sweep * std::sin(pi * phase) : 0.0;
      if (phase >= 1.0 && moving) rest_stick = noise_ * m.stiction_Nm * stick.normal();
      moving = phase < 1.0;
      friction = moving ? m.coulomb_Nm * std::tanh(v / 0.02) + m.viscous_Nm_s_per_rad * v : rest_stick;
    }
    const double torque = load + m.weight_Nm * std::sin(q) + friction + bias + noise_ * m.white_Nm * draws.normal();
    joints_.push_back({stamp(t), JointVector::Constant(1, q), JointVector::Constant(1, v + noise_ * m.velocity_sigma_rad_per_s * draws.normal()), JointVector::Constant(1, torque / constant),
                       Effort::current_A});
  }
}

template <class Vec3>
inline void VirtualRig::record_forces() {
  const ContactRig& c = rig_.contact;
  Draws draws(seed_, 5);
  const double bias = noise_ * c.sensor_bias_N * draws.normal();
  for (double t = 0.0; t < end_s_; t += 1.0 / c.sensor_hz) {
    const Sampled s = at(t);
    const double y = s.contact < 0 ? 0.0 : contacts_[std::size_t(s.contact)].y_m;
    const auto jitter = [&] { return noise_ * c.sensor_sigma_N * draws.normal(); };
    const double fx = jitter(), fy = jitter(), fz = -s.load_N + bias + jitter();
    wrenches_.push_back({stamp(t), Vec3(fx, fy, fz), Vec3(-y * s.load_N, 0.0, 0.0)});
    const double sunk = s.contact < 0 ? 0.0 : light_->depth_m(y, s.equivalent_N);
    markers_.push_back({stamp(t), sunk + noise_ * c.marker_sigma_m * draws.normal()});
  }
}

template <class>
inline void VirtualRig::record_frames() {
  const CameraRig& c = rig_.camera;
  const LightRig& l = rig_.light;
  Draws once(seed_, 6), jitter(seed_, 7);
  CameraPlace set{noise_ * c.aim_sigma_rad * once.normal(), noise_ * c.aim_sigma_rad * once.normal(), noise_ * c.aim_sigma_rad * once.normal(), noise_ * c.aim_sigma_m * once.normal(),
                  noise_ * c.aim_sigma_m * once.normal()};
  for (const LabView& v : plan_.views)
    painters_.emplace_back(c, l, side_, CameraPlace{set.yaw_rad + v.place.yaw_rad, set.pitch_rad + v.place.pitch_rad, set.roll_rad + v.place.roll_rad, set.along_m + v.place.along_m, set.height_m + v.place.height_m},
                           light_->responses().position_m, seed_);
  SlowNoise lamp(Draws(seed_, 8), l.lamp_drift_s), room(Draws(seed_, 9), l.ambient_drift_s);
  Draws white(seed_, 10);
  const double phase = 2.0 * pi * once.uniform(), half = pi * l.flicker_hz * c.exposure_s, averaged = half > 0.0 ? std::sin(half) / half : 1.0;
  int view = plan_.contacts.empty() ? 0 : plan_.contacts.front().view;
  for (double t = 0.01; t < end_s_; t += 1.0 / c.frames_per_s) {
    const Sampled s = at(t);
    // The next contact's view is set while nothing touches.
    for (const Phase& p : phases_)
      if (p.contact >= 0 && p.to_s > t) {
        view = plan_.contacts[std::size_t(p.contact)].view;
        break;
      }
    TruthSample truth{stamp(t + noise_ * c.stamp_sigma_s * jitter.normal()), s.contact};
    if (s.contact >= 0) {
      const Contact& now = contacts_[std::size_t(s.contact)];
      truth.y_m = now.y_m, truth.force_N = s.load_N, truth.tilt_rad = now.tilt_rad, truth.equivalent_N = s.equivalent_N, truth.depth_m = light_->depth_m(now.y_m, s.equivalent_N);
    }
    char name[32];
    std::snprintf(name, sizeof name, "%06zu.png", frames_.size());
    frames_.push_back({truth.stamp_ns, name, c.exposure_s, c.gain});
    truth_.push_back(truth);
    view_.push_back(view);
    lamps_.push_back(plan_.views[std::size_t(view)].lamps * (1.0 + noise_ * (l.lamp_drift * lamp.at(t) + l.lamp_white * white.normal())));
    room_DN_.push_back(plan_.views[std::size_t(view)].room * l.ambient_DN * (1.0 + noise_ * (l.ambient_drift * room.at(t) + l.flicker * averaged * std::sin(2.0 * pi * l.flicker_hz * t + phase))));
  }
}

template <class VectorXd>
inline Image VirtualRig::image(std::size_t k) const {
  const TruthSample& s = truth_.at(k);
  VectorXd light = light_->responses().unloaded;
  if (s.contact >= 0) light += light_->change(s.y_m, s.equivalent_N, s.tilt_rad);
  light *= per_DN_ * lamps_[k];
  return painters_[std::size_t(view_[k])].paint(light, lamps_[k], room_DN_[k], noise_, Draws(seed_, 1000 + k));
}

}  // namespace lumo

// ---- lumo/core/write_whole.hpp

namespace lumo::detail {

/// The whole file or none: written beside its place under a name that no other writer takes, then renamed; an older one is replaced. Throws InputError of one
/// line, and leaves what was there.
inline void write_whole(const std::string& path, std::string_view bytes) {
  // Two programs, or threads, may write the same file at once; the time and a place on the stack tell them apart.
  const std::string part = text(path, ".part-", std::chrono::steady_clock::now().time_since_epoch().count(), '-', static_cast<const void*>(&bytes));
  errno = 0;
  std::ofstream out(part, std::ios::binary);
  out.write(bytes.data(), std::streamsize(bytes.size()));
  out.close();
  std::error_code error;
  if (!out) error = {errno != 0 ? errno : EIO, std::generic_category()};
  else std::filesystem::rename(part, path, error);
  if (out && !error) return;
  const std::string why = error.message();
  std::filesystem::remove(part, error);
  throw InputError(text(path, ": cannot be written: ", why));
}

}  // namespace lumo::detail

// ---- lumo/lab/pad_file.hpp

namespace lumo {

// Responses of a pad as a text file: a line that names the format, the key of what was computed, blocks "name rows columns" with their numbers row by row, and
// a last line with a checksum of all before it.

namespace detail {

inline constexpr std::string_view pad_file_head = "lumo-pad-responses 1\n";

inline std::uint64_t checksum(std::string_view text) {
  std::uint64_t sum = text.size();
  for (const char c : text) sum = mix64(sum ^ std::uint64_t(static_cast<unsigned char>(c))) + 0x9e3779b97f4a7c15ull;
  return sum;
}

inline void append_block(std::string& to, const char* name, const Eigen::MatrixXd& m) {
  to += text(name, ' ', m.rows(), ' ', m.cols(), '\n');
  char buffer[32];
  for (Eigen::Index i = 0; i < m.rows(); ++i)
    for (Eigen::Index j = 0; j < m.cols(); ++j) {
      const auto [end, error] = std::to_chars(buffer, buffer + sizeof buffer, m(i, j));
      to.append(buffer, end);
      to += j + 1 < m.cols() ? ' ' : '\n';
    }
}

/// Reads blocks in the order in which they were written. Throws InputError.
class BlockReader {
 public:
  BlockReader(std::string_view text, std::string name) : left_(text), name_(std::move(name)) {}

  std::string_view line() {
    const auto end = left_.find('\n');
    if (end == std::string_view::npos) fail("ends too early");
    const std::string_view l = left_.substr(0, end);
    left_.remove_prefix(end + 1);
    return l;
  }
  Eigen::MatrixXd block(std::string_view wanted) {
    const std::string_view head = line();
    const auto first = head.find(' '), second = head.find(' ', first + 1);
    long rows = -1, columns = -1;
    if (first == std::string_view::npos || second == std::string_view::npos || head.substr(0, first) != wanted) fail("a block is missing");
    std::from_chars(head.data() + first + 1, head.data() + second, rows);
    std::from_chars(head.data() + second + 1, head.data() + head.size(), columns);
    if (rows < 0 || columns < 0 || rows > 100000 || columns > 10000 || rows * columns > 4000000) fail("a block has no sensible size");
    Eigen::MatrixXd m(rows, columns);
    for (long i = 0; i < rows && columns > 0; ++i) {
      const std::string_view l = line();
      const char* at = l.data();
      for (long j = 0; j < columns; ++j) {
        const auto [end, error] = std::from_chars(at, l.data() + l.size(), m(i, j));
        if (error != std::errc{}) fail("a number is damaged");
        at = end + (end < l.data() + l.size());
      }
    }
    return m;
  }
  [[noreturn]] void fail(const char* why) const { throw InputError(text(name_, ": ", why)); }

 private:
  std::string_view left_;
  std::string name_;
};

}  // namespace detail

/// `key` says in one line what was computed and how; whoever reads the file must ask for the same.
template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
inline std::string to_text(const PadResponses& r, const std::string& key) {
  std::string t(detail::pad_file_head);
  t += "key " + key + "\nmaterial " + r.material + '\n';
  const auto add = [&](const char* name, const MatrixXd& m) { detail::append_block(t, name, m); };
  add("theta_mm", Eigen::Map<const VectorXd>(r.theta_mm.data(), Eigen::Index(r.theta_mm.size())));
  add("diameter_m", MatrixXd::Constant(1, 1, r.diameter_m));
  add("position_m", r.position_m), add("unloaded", r.unloaded), add("place_m", r.place_m), add("load_N", r.load_N), add("depth_m", r.depth_m);
  for (const auto& m : r.change) add("change", m);
  add("tilt_place_m", r.tilt_place_m);
  for (const auto& m : r.tilt) add("tilt", m);
  add("error", r.error);
  return t + detail::text("checksum ", detail::checksum(t), '\n');
}

/// Throws InputError of one line for what is damaged or was made for another key; without a key any will do. `name` stands in the message.
template <class MatrixXd = Eigen::MatrixXd, class VectorXd = Eigen::VectorXd>
inline PadResponses pad_responses_from_text(std::string_view text, const std::optional<std::string>& key, const std::string& name) {
  detail::BlockReader reader(text, name);
  if (!text.starts_with(detail::pad_file_head)) reader.fail("holds no responses of a pad");
  const auto last = text.rfind("checksum ");
  if (last == std::string_view::npos || text.substr(last) != detail::text("checksum ", detail::checksum(text.substr(0, last)), '\n')) reader.fail("is damaged, its checksum is wrong");
  reader.line();
  const std::string_view made_for = reader.line();
  if (key && made_for != "key " + *key) reader.fail("was made for another pad or with other settings");
  PadResponses r;
  const std::string_view material = reader.line();
  r.material = material.substr(std::min<std::size_t>(material.size(), 9));
  const VectorXd theta = reader.block("theta_mm");
  r.theta_mm.assign(theta.begin(), theta.end());
  const MatrixXd diameter = reader.block("diameter_m");
  if (diameter.size() != 1) reader.fail("the diameter is missing");
  r.diameter_m = diameter(0, 0);
  r.position_m = reader.block("position_m"), r.unloaded = reader.block("unloaded"), r.place_m = reader.block("place_m"), r.load_N = reader.block("load_N");
  r.depth_m = reader.block("depth_m");
  for (Eigen::Index k = 0; k < r.place_m.size(); ++k) r.change.push_back(reader.block("change"));
  r.tilt_place_m = reader.block("tilt_place_m");
  for (Eigen::Index k = 0; k < r.tilt_place_m.size(); ++k) r.tilt.push_back(reader.block("tilt"));
  r.error = reader.block("error");
  validate(r, name);
  return r;
}

/// Nothing when there is no such file. Throws InputError for one that cannot be used.
template <class = void>
inline std::optional<PadResponses> read_pad_responses(const std::string& path, const std::optional<std::string>& key = {}) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return std::nullopt;
  std::ifstream in(path, std::ios::binary);
  const std::string text((std::istreambuf_iterator<char>(in)), {});
  if (!in) throw InputError(detail::text(path, ": cannot be read"));
  return pad_responses_from_text(text, key, path);
}

/// The whole file or none. Throws InputError.
template <class = void>
inline void write_pad_responses(const std::string& path, const PadResponses& r, const std::string& key) { detail::write_whole(path, to_text(r, key)); }

}  // namespace lumo

// ---- lumo/lumo.hpp

// Everything of lumo that needs nothing but Eigen, in the order in which data flows. Foreign libraries enter through lumo/support/.
