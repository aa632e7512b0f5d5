#pragma once

#include "lumo/core/error.hpp"

#include <algorithm>
#include <cmath>

namespace lumo {

/// Probability that χ² of `freedom` degrees of freedom is below x: the regularised lower incomplete gamma function
/// P(freedom/2, x/2) by its series (Abramowitz & Stegun 6.5.29). Throws InvalidArgument for numbers out of range.
inline double chi_squared_below(double x, double freedom) {
  require_in_range("degrees of freedom", freedom, 0.1, 1e4, "");
  require_in_range("chi squared", x, 0.0, 1e6, "");
  const double a = 0.5 * freedom, h = 0.5 * x;
  if (!(h > 0.0)) return 0.0;
  if (h > a + 20.0 * std::sqrt(a) + 60.0) return 1.0;  // what is left is below 1e-12
  double term = std::exp(a * std::log(h) - h - std::lgamma(a + 1.0)), sum = term;
  for (double k = 1.0; term > 1e-17 * sum; ++k) {
    term *= h / (a + k);
    sum += term;
  }
  return std::min(1.0, sum);
}

/// What χ² stays below with the given probability. Throws InvalidArgument for numbers out of range.
inline double chi_squared_quantile(double freedom, double probability) {
  require_in_range("probability", probability, 0.0, 1.0 - 1e-9, "");
  double low = 0.0, high = freedom + 20.0 * std::sqrt(freedom) + 120.0;
  for (int k = 0; k < 60; ++k) {
    const double middle = 0.5 * (low + high);
    (chi_squared_below(middle, freedom) < probability ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace lumo
