#pragma once

#include "lumo/core/types.hpp"

#include <Eigen/Core>

#include <algorithm>

namespace lumo::sense {

/// Mean and variance of a distribution over places, and the number of its most probable one.
struct GridMoments {
  double mean, variance;
  Eigen::Index mode;
};

/// About the mode: a part below 10⁻⁴ of it, as new contacts that may be anywhere leave it, does not count. As many
/// weights as places, one of them positive.
inline GridMoments moments_about_mode(const Eigen::VectorXd& place, const Eigen::VectorXd& weight) {
  GridMoments m{0.0, 0.0, 0};
  const double most = weight.maxCoeff(&m.mode);
  double sum = 0.0, first = 0.0, second = 0.0;
  for (Eigen::Index j = 0; j < weight.size(); ++j) {
    const double w = weight[j] > 1e-4 * most ? weight[j] : 0.0, d = place[j] - place[m.mode];
    sum += w, first += w * d, second += w * d * d;
  }
  m.mean = place[m.mode] + first / sum;
  m.variance = std::max(second / sum - first * first / (sum * sum), 0.0);
  return m;
}

}  // namespace lumo::sense
