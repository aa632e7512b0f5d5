#pragma once

#include "catch.hpp"
#include "lumo/core/error.hpp"

#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

// Feeds numbers that are none to functions of numbers, one argument at a time.
namespace lumo::test {

using Numbers = std::vector<double>;

/// A function with sound arguments. Infinite answers that its documentation promises are turned into finite ones by
/// `call` itself; an empty answer is one, too.
struct PoisonedCase {
  std::string name;
  Numbers sound;
  std::function<Numbers(const Numbers&)> call;
};

/// Each case answers finitely for its sound arguments, and for each poison in each of them throws lumo::Error or
/// answers finitely. Returns how many calls that were.
inline int check_poisoned(const std::vector<PoisonedCase>& cases) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  const double poisons[] = {std::numeric_limits<double>::quiet_NaN(), infinity, -infinity, -1.0, 1e308};
  const auto finite = [](const Numbers& answer) {
    for (const double a : answer)
      if (!std::isfinite(a)) return false;
    return true;
  };
  int calls = 0;
  for (const PoisonedCase& c : cases) {
    INFO(c.name);
    CHECK(finite(c.call(c.sound)));
    for (std::size_t k = 0; k < c.sound.size(); ++k)
      for (const double poison : poisons) {
        Numbers x = c.sound;
        x[k] = poison;
        INFO("argument " << k << " is " << poison);
        ++calls;
        Numbers answer;
        try {
          answer = c.call(x);
        } catch (const Error&) {
        }
        CHECK(finite(answer));
      }
  }
  return calls;
}

}  // namespace lumo::test
