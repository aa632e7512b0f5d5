#pragma once

#include "lumo/objective/contact_progression.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

namespace lumo {

/// Of one quantity: what a design has more than its variant. Errors of both are taken as independent.
inline Estimate difference(const Estimate& design, const Estimate& variant) {
  return {design.value - variant.value, std::hypot(design.error, variant.error)};
}

/// Differences of many designs in a few numbers.
struct PairedSummary {
  std::size_t positive = 0, negative = 0;  ///< signs that count: |difference| above twice its error
  std::size_t undecided = 0;
  std::size_t above_zero = 0;  ///< differences > 0, whatever their error
  double median = 0.0;
  /// Distribution-free interval of the median: the widest order statistics that the binomial law leaves at least 95 %;
  /// empty below six differences, where not even the extremes reach that. Source: Conover, Practical Nonparametric
  /// Statistics, §3.2.
  std::optional<std::pair<double, double>> median_95;

  std::size_t count() const { return positive + negative + undecided; }
};

/// Empty without differences.
inline std::optional<PairedSummary> summarize(const std::vector<Estimate>& differences) {
  if (differences.empty()) return std::nullopt;
  PairedSummary s;
  std::vector<double> sorted;
  for (const Estimate& d : differences) {
    if (std::abs(d.value) <= 2.0 * d.error)
      ++s.undecided;
    else
      ++(d.value > 0.0 ? s.positive : s.negative);
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

}  // namespace lumo
