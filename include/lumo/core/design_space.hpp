#pragma once

#include "lumo/core/error.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <span>
#include <string>
#include <vector>

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
    return std::abs(x - nearest_node(x)) <=
           4.0 * std::numeric_limits<double>::epsilon() * std::max(std::abs(x), std::abs(origin));
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
  std::function<InfeasibleDesign(std::span<const double>)> refusal;  ///< what check() throws if it does not hold
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

  /// Throws InvalidArgument when the number of values is wrong, or one lies more than a million widths off the bounds:
  /// all else can be a result, if not a design to try.
  void check_result(std::span<const double> x) const;

  /// The same constraints without bounds and lattices.
  DesignSpace unbounded() const {
    DesignSpace wide = *this;
    for (Variable& v : wide.variables) {
      v.upper = std::numeric_limits<double>::max();
      v.lower = -v.upper;
      v.step = 0.0;
    }
    return wide;
  }

  /// Whether bounds and linear constraints hold, on the lattice or not. Throws as check_result().
  bool encloses(std::span<const double> x) const;
};

inline void DesignSpace::check(std::span<const double> x) const {
  if (x.size() != variables.size())
    throw InvalidArgument(message("design has ", x.size(), " values, the space has ", variables.size(), " variables"));
  for (std::size_t i = 0; i < x.size(); ++i) {
    const Variable& v = variables[i];
    const std::string unit = v.unit.empty() ? "" : " " + v.unit;
    if (!std::isfinite(x[i]))
      throw InfeasibleDesign(v.name + " finite", x[i], v.upper, v.unit,
          message("infeasible design: ", v.name, " = ", exact(x[i]), unit, ", must lie in [", v.lower, ", ", v.upper,
              "]", unit));
    if (x[i] < v.lower)
      throw InfeasibleDesign(v.name + " lower bound", x[i], v.lower, v.unit,
          message(
              "infeasible design: ", v.name, " = ", exact(x[i]), unit, " is below its lower bound ", v.lower, unit));
    if (x[i] > v.upper)
      throw InfeasibleDesign(v.name + " upper bound", x[i], v.upper, v.unit,
          message(
              "infeasible design: ", v.name, " = ", exact(x[i]), unit, " is above its upper bound ", v.upper, unit));
    if (v.step > 0.0 && !v.on_lattice(x[i]))
      throw InfeasibleDesign(v.name + " lattice", x[i], v.nearest_node(x[i]), v.unit,
          message("infeasible design: ", v.name, " = ", exact(x[i]), unit, " is off the ", v.step, unit,
              " lattice; nearest is ", v.nearest_node(x[i]), unit));
  }
  for (const LinearConstraint& c : constraints) {
    const double sum = c.sum(x), rounding = c.rounding(x);
    const std::string unit = c.unit.empty() ? "" : " " + c.unit;
    if (sum > c.upper + rounding)
      throw InfeasibleDesign(c.name, sum, c.upper, c.unit,
          message("infeasible design: ", c.name, " = ", sum, unit, " exceeds its limit ", c.upper, unit));
    if (sum < c.lower - rounding)
      throw InfeasibleDesign(c.name, sum, c.lower, c.unit,
          message("infeasible design: ", c.name, " = ", sum, unit, " is below its limit ", c.lower, unit));
  }
  for (const DesignRule& r : rules)
    if (!r.holds(x)) throw r.refusal(x);
}

inline bool DesignSpace::contains(std::span<const double> x) const {
  if (x.size() != variables.size())
    throw InvalidArgument(message("design has ", x.size(), " values, the space has ", variables.size(), " variables"));
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

inline void DesignSpace::check_result(std::span<const double> x) const {
  constexpr double widths = 1e6;
  if (x.size() != variables.size())
    throw InvalidArgument(message("design has ", x.size(), " values, the space has ", variables.size(), " variables"));
  for (std::size_t i = 0; i < x.size(); ++i) {
    const Variable& v = variables[i];
    const double reach = widths * std::max(v.upper - v.lower, std::numeric_limits<double>::min());
    if (!(x[i] >= v.lower - reach && x[i] <= v.upper + reach))
      throw InvalidArgument(message("design has ", v.name, " = ", exact(x[i]), ", more than a million widths off [",
          v.lower, ", ", v.upper, "]"));
  }
}

inline bool DesignSpace::encloses(std::span<const double> x) const {
  check_result(x);
  for (std::size_t i = 0; i < x.size(); ++i)
    if (!(x[i] >= variables[i].lower && x[i] <= variables[i].upper)) return false;
  return std::all_of(constraints.begin(), constraints.end(), [&](const LinearConstraint& c) {
    const double sum = c.sum(x), rounding = c.rounding(x);
    return sum <= c.upper + rounding && sum >= c.lower - rounding;
  });
}

}  // namespace lumo
