#pragma once

#include <algorithm>
#include <cmath>

namespace lumo::sense {

/// Kalman filter of a random walk x that is seen together with a slowly changing offset b (first-order Gauss–Markov):
/// two states, linear, exact. The offset keeps many alike measurements (a motor that sticks, frames of one peak) from
/// looking like many independent ones.
struct OffsetWalk {
  double x = 0.0, b = 0.0;
  double xx = 0.0, xb = 0.0, bb = 0.0;  ///< covariance

  /// `walk`: growth of the variance of x per second, up to `most`. `offset`: stationary variance of b, which forgets
  /// within `time_s`.
  void predict(double dt, double walk, double most, double offset, double time_s) {
    const double keep = std::exp(-dt / time_s);
    b *= keep;
    xb *= keep;
    bb = keep * keep * bb + (1.0 - keep * keep) * offset;
    xx += walk * dt;
    if (xx > most) {
      xb *= std::sqrt(most / xx);
      xx = most;
    }
  }
  /// Takes z = x + share · b + noise.
  void update(double z, double variance, double share = 1.0) {
    const double px = xx + share * xb, pb = xb + share * bb, s = px + share * pb + variance;
    const double innovation = (z - x - share * b) / s;
    x += px * innovation;
    b += pb * innovation;
    xx = std::max(xx - px * px / s, 0.0);
    bb = std::max(bb - pb * pb / s, 0.0);
    xb -= px * pb / s;
  }
  /// Variance of what is seen, without noise.
  double seen() const { return xx + 2.0 * xb + bb; }
};

}  // namespace lumo::sense
