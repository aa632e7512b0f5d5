#pragma once

#include <Eigen/Core>

#include <cstddef>
#include <utility>
#include <vector>

namespace lumo {

/// What the steps with a kept factor have shown of a symmetric, positive definite tangent since it was made: the BFGS
/// correction of the factor's inverse (Matthies, Strang 1979, doi:10.1002/nme.1620141104), applied by Nocedal's two
/// loops (1980, doi:10.1090/S0025-5718-1980-0572855-7).
class SecantPairs {
 public:
  void clear() { pairs_.clear(); }

  /// A step with the change of the residual that came with it; of equal sizes. Without effect where the residual did
  /// not grow along the step beyond rounding: the corrected inverse stays positive definite.
  void add(Eigen::VectorXd step, Eigen::VectorXd change) {
    const double curvature = step.dot(change);
    if (curvature > 1e-12 * step.norm() * change.norm())
      pairs_.push_back({std::move(step), std::move(change), 1.0 / curvature});
  }

  /// Solution of the corrected system, where `factor` is that of the kept one: a function of a vector.
  template <class Factor> Eigen::VectorXd solve(Eigen::VectorXd residual, Factor&& factor) const {
    std::vector<double> along(pairs_.size());
    for (std::size_t k = pairs_.size(); k-- > 0;) {
      along[k] = pairs_[k].scale * pairs_[k].step.dot(residual);
      residual -= along[k] * pairs_[k].change;
    }
    Eigen::VectorXd solution = factor(residual);
    for (std::size_t k = 0; k < pairs_.size(); ++k)
      solution += (along[k] - pairs_[k].scale * pairs_[k].change.dot(solution)) * pairs_[k].step;
    return solution;
  }

 private:
  struct Pair {
    Eigen::VectorXd step, change;
    double scale;  ///< 1 / (step · change)
  };
  std::vector<Pair> pairs_;
};

}  // namespace lumo
