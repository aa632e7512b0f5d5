#pragma once

#include "lumo/core/error.hpp"

#include <cmath>
#include <functional>
#include <limits>
#include <span>
#include <string>
#include <vector>

namespace lumo {

/// One design variable: bounds and, when `step` > 0, a lattice of multiples of `step` counted from zero.
struct Variable {
  std::string name;
  double lower = 0.0;
  double upper = 1.0;
  double step = 0.0;
  std::string unit;
};

/// lower ≤ Σ coefficients · x ≤ upper. Coefficients as many as variables.
struct LinearConstraint {
  std::string name;
  std::vector<double> coefficients;
  double lower = -std::numeric_limits<double>::infinity();
  double upper = std::numeric_limits<double>::infinity();
  std::string unit;
};

/// The designs that may be tried, in any number of dimensions: a box or lattice, linear constraints, and whatever else `rule` refuses.
struct DesignSpace {
  std::vector<Variable> variables;
  std::vector<LinearConstraint> constraints;
  std::function<void(std::span<const double>)> rule;  ///< throws InfeasibleDesign; called after all other checks have passed

  /// Throws InfeasibleDesign naming the first broken constraint, or InvalidArgument when the number of values is wrong.
  void check(std::span<const double> x) const;

  /// Whether check() would pass.
  bool contains(std::span<const double> x) const {
    try {
      check(x);
      return true;
    } catch (const InfeasibleDesign&) {
      return false;
    }
  }
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
    if (v.step > 0.0) {
      const double node = std::round(x[i] / v.step) * v.step;
      if (x[i] != node && std::abs(x[i] - node) > 4.0 * std::numeric_limits<double>::epsilon() * std::abs(x[i]))
        throw InfeasibleDesign(v.name + " lattice", x[i], node, v.unit,
                               detail::text("infeasible design: ", v.name, " = ", x[i], unit, " is off the ", v.step, unit, " lattice; nearest is ", node, unit));
    }
  }
  for (const LinearConstraint& c : constraints) {
    double sum = 0.0;
    for (std::size_t i = 0; i < x.size(); ++i) sum += c.coefficients[i] * x[i];
    const std::string unit = c.unit.empty() ? "" : " " + c.unit;
    if (sum > c.upper)
      throw InfeasibleDesign(c.name, sum, c.upper, c.unit, detail::text("infeasible design: ", c.name, " = ", sum, unit, " exceeds its limit ", c.upper, unit));
    if (sum < c.lower)
      throw InfeasibleDesign(c.name, sum, c.lower, c.unit, detail::text("infeasible design: ", c.name, " = ", sum, unit, " is below its limit ", c.lower, unit));
  }
  if (rule) rule(x);
}

}  // namespace lumo
