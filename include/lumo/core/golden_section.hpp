#pragma once

namespace lumo {

/// Where a function of one number is least between a and b, if it has one minimum there: `steps` sections, each of
/// which leaves 0.618 of the stretch. Source: Kiefer 1953.
template <class Function> double golden_section(Function function, double a, double b, int steps) {
  constexpr double golden = 0.61803398874989484820;
  for (int k = 0; k < steps; ++k) {
    const double c = b - golden * (b - a), d = a + golden * (b - a);
    if (function(c) <= function(d)) b = d;
    else a = c;
  }
  return 0.5 * (a + b);
}

}  // namespace lumo
