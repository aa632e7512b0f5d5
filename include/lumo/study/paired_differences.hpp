#pragma once

#include "lumo/objective/contact_progression.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <span>
#include <utility>
#include <vector>

namespace lumo {

/// A design less its variant. The errors of both are taken as independent.
inline Estimate paired_difference(const Estimate& design, const Estimate& variant) {
  return {design.value - variant.value, std::hypot(design.error, variant.error)};
}

/// Differences of many designs in a few numbers.
struct PairedSummary {
  std::size_t positive = 0, negative = 0;  ///< signs that count: |difference| above twice its error
  std::size_t undecided = 0;
  std::size_t above_zero = 0;  ///< differences > 0, whatever their error
  double median = 0.0;
  /// Distribution-free interval of the median, between order statistics: the narrowest to which the binomial law gives
  /// at least 95 %; nullopt below six differences, as not even the extremes reach that then. Source: Conover, Practical
  /// Nonparametric Statistics, §3.2.
  std::optional<std::pair<double, double>> median_95;

  std::size_t count() const { return positive + negative + undecided; }
};

/// nullopt without differences.
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
  double term = std::pow(0.5, double(n)), outside = 0.0;  // P(exactly k of n below the median), and up to there
  for (std::size_t k = 0; k < n / 2; ++k) {
    outside += term;
    if (outside > 0.025) break;
    s.median_95 = std::pair(sorted[k], sorted[n - 1 - k]);
    term *= double(n - k) / double(k + 1);
  }
  return s;
}

/// Kendall's τ-b of two rankings of the same things: pairs in the same order less pairs in the opposite one, over the
/// geometric mean of the pairs that either ranking distinguishes; 1 for the same ranking, ties included. nullopt if one
/// of them ties all. Source: Kendall, Biometrika 33 (1945).
inline std::optional<double> kendall_tau(std::span<const double> a, std::span<const double> b) {
  const std::size_t n = a.size();
  if (b.size() != n) return std::nullopt;
  long agreed = 0, apart_a = 0, apart_b = 0;
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = i + 1; j < n; ++j) {
      const int order_a = (a[i] > a[j]) - (a[i] < a[j]), order_b = (b[i] > b[j]) - (b[i] < b[j]);
      agreed += order_a * order_b;
      apart_a += order_a != 0;
      apart_b += order_b != 0;
    }
  if (apart_a == 0 || apart_b == 0) return std::nullopt;
  return double(agreed) / std::sqrt(double(apart_a) * double(apart_b));
}

}  // namespace lumo
