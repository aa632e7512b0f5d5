#pragma once

#include <algorithm>
#include <cmath>

namespace lumo {

/// How densely rays are sent along y: most where the body is pressed, since rays far from there find nothing changed.
/// Default: evenly. Changes how sure a response is, not its expected value. Compare responses of one focus: then only
/// what the press changed is left.
struct RayFocus {
  double y_m = 0.0;
  double length_m = 0.0;     ///< the density falls by e over this distance; 0: nowhere
  double least = 1.0 / 8.0;  ///< of the density at y_m

  double density(double y) const {
    return length_m > 0.0 ? std::max(least, std::exp(-std::abs(y - y_m) / length_m)) : 1.0;
  }
  /// The same for y and −y?
  bool is_symmetric() const { return y_m == 0.0 || length_m == 0.0; }
};

}  // namespace lumo
