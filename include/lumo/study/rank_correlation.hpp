#pragma once

#include <cmath>
#include <cstddef>
#include <optional>
#include <span>

namespace lumo {

/// Kendall's τ-b of two rankings of the same things: pairs in the same order less pairs in the opposite one, over the
/// geometric mean of the pairs that either ranking tells apart; 1 for the same ranking, ties included. Nothing where
/// one of them ties all. Source: Kendall, Biometrika 33 (1945).
inline std::optional<double> kendall_tau(std::span<const double> a, std::span<const double> b) {
  const std::size_t n = a.size();
  if (b.size() != n) return std::nullopt;
  long agreed = 0, apart_a = 0, apart_b = 0;
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = i + 1; j < n; ++j) {
      const int order_a = (a[i] > a[j]) - (a[i] < a[j]), order_b = (b[i] > b[j]) - (b[i] < b[j]);
      agreed += order_a * order_b, apart_a += order_a != 0, apart_b += order_b != 0;
    }
  if (apart_a == 0 || apart_b == 0) return std::nullopt;
  return double(agreed) / std::sqrt(double(apart_a) * double(apart_b));
}

}  // namespace lumo
