#pragma once

#include <array>
#include <cstddef>
#include <string_view>

namespace lumo {

/// How a solve ended. Only `converged` is scored (and `held` where a problem says so).
enum class Status {
  converged,              ///< equilibrium, residual certified, stable
  held,                   ///< a dynamic solver ran its sweeps; no statement about equilibrium
  max_iterations,         ///< residual still too large after the allowed iterations
  line_search,            ///< even the shortest step leaves an element less than a fifth of its volume by the solver's
                          ///< prediction: it is crushed, or flattened
  inverted,               ///< an element is turned inside out
  not_positive_definite,  ///< equilibrium, but unstable: the body would buckle away from it
  non_finite,             ///< NaN or infinity in the state or in a factor
  time_limit              ///< stopped by the caller's time limit
};

/// Whether objectives may rest on a state that ended so. `accept_held`: the problem says that it is about held states
/// (the paper's mechanics).
constexpr bool is_scored(Status s, bool accept_held = false) {
  return s == Status::converged || (accept_held && s == Status::held);
}

constexpr std::string_view to_string(Status s) {
  constexpr std::array<std::string_view, 8> names{"converged", "held", "max_iterations", "line_search", "inverted",
      "not_positive_definite", "non_finite", "time_limit"};
  return names[std::size_t(s)];
}

}  // namespace lumo
