#pragma once

#include "lumo/core/units.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

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

}  // namespace detail

/// E[(Z + a)⁺] = a Φ(a) + φ(a) for a standard normal Z, to full relative accuracy (10⁻¹³) until it underflows below a = −38.
inline double expected_excess(double a) {
  if (a <= -39.0) return 0.0;
  if (a <= -8.0) return normal_density(a) * detail::scaled_excess_tail(a);
  return a * normal_probability(a) + normal_density(a);
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
  for (Iterator i = first; i != last; ++i) sum += std::exp(*i - top);
  return top + std::log(sum);
}

}  // namespace lumo
