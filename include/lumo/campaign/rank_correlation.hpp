#pragma once

#include <cstddef>
#include <optional>
#include <span>

namespace lumo {

/// Kendall's τ of two rankings of the same things: pairs in the same order less pairs in the opposite one, over all pairs; a tie in either counts
/// nothing. Nothing for fewer than two. Source: Kendall, Biometrika 30 (1938).
inline std::optional<double> kendall_tau(std::span<const double> a, std::span<const double> b) {
  const std::size_t n = a.size();
  if (n < 2 || b.size() != n) return std::nullopt;
  long agreed = 0;
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = i + 1; j < n; ++j) agreed += ((a[i] > a[j]) - (a[i] < a[j])) * ((b[i] > b[j]) - (b[i] < b[j]));
  return double(agreed) / (0.5 * double(n) * double(n - 1));
}

}  // namespace lumo
