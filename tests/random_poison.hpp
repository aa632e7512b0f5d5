#pragma once

#include "catch.hpp"
#include "lumo/core/error.hpp"

#include <cmath>
#include <limits>
#include <random>
#include <vector>

// Poisons one or two numbers or indices of a whole set of inputs at random.
namespace lumo::test {

/// Where the inputs' numbers and indices lie.
struct Poisonable {
  std::vector<double*> numbers;
  std::vector<int*> indices;

  template <class Vector> void add(Vector& v) {
    for (auto& x : v) numbers.push_back(&x);
  }
};

struct PoisonCount {
  int refused = 0, answered = 0, not_finite = 0, odd = 0;
};

/// `inputs` are copied for each of `count` poisonings; `where(inputs)` is their Poisonable; `finite(inputs)` computes
/// with them, and says whether all of the answer is finite. It may throw lumo::Error.
template <class Inputs, class Where, class Finite>
PoisonCount poison_at_random(const Inputs& inputs, int count, unsigned seed, const Where& where, const Finite& finite) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  constexpr double poisons[] = {
      std::numeric_limits<double>::quiet_NaN(), infinity, -infinity, -1.0, 0.0, 1e308, -1e308, 1e-308, 1e9, -1e-9};
  constexpr int strange[] = {-1, -2, 0, 3, 1'000'000, std::numeric_limits<int>::max(), std::numeric_limits<int>::min()};
  std::mt19937 random(seed);
  const auto one_of = [&](std::size_t size) { return std::uniform_int_distribution<std::size_t>(0, size - 1)(random); };
  PoisonCount ended;
  for (int k = 0; k < count; ++k) {
    Inputs poisoned = inputs;
    const Poisonable at = where(poisoned);
    for (std::size_t n = 0; n <= one_of(2); ++n)
      if (!at.indices.empty() && one_of(4) == 0)
        *at.indices[one_of(at.indices.size())] = strange[one_of(std::size(strange))];
      else *at.numbers[one_of(at.numbers.size())] = poisons[one_of(std::size(poisons))];
    try {
      ++(finite(poisoned) ? ended.answered : ended.not_finite);
    } catch (const Error&) {
      ++ended.refused;
    } catch (...) {
      ++ended.odd;
    }
  }
  return ended;
}

}  // namespace lumo::test
