#pragma once

#include "lumo/model/surrogate.hpp"
#include "lumo/optimize/hypervolume.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

namespace lumo {

/// What one more evaluation of a design that was evaluated before is worth: the expected rise of the hypervolume of the
/// models' means. A fresh design is worth its expected improvement, in the same units.
struct Repeat {
  Eigen::Index design = 0;  ///< column of the designs
  double worth = 0.0;
};

/// The design in the front of the models' means that is best evaluated again; nullopt if none may be. One more
/// observation of noise τ² moves the mean of a value whose standard deviation is s by s²/√(s² + τ²) (one step of the
/// knowledge gradient; Frazier, Powell & Dayanik, SIAM J. Control Optim. 47 (2008)), here for each objective by itself.
/// `x`: different designs, d × n; `may`: by design. Objectives have one model each, larger is better.
template <CovarianceKernel Kernel> std::optional<Repeat> best_repeat(const std::vector<GaussianProcess<Kernel>>& models,
    const Evidence& evidence, const Eigen::MatrixXd& x, const std::vector<bool>& may) {
  const auto m = Eigen::Index(models.size()), n = x.cols();
  Eigen::MatrixXd mean(m, n), moved(m, n);
  for (Eigen::Index j = 0; j < m; ++j) {
    const GaussianProcess<Kernel>& model = models[std::size_t(j)];
    const auto at = model.predict(x);
    double noise = model.output_scale() * model.output_scale() * model.hyperparameters().noise;
    if (evidence.errors.cols() > 0) noise += evidence.errors.row(j).array().square().mean();
    mean.row(j) = at.mean.transpose();
    moved.row(j) = (at.variance.array() / (at.variance.array() + noise).sqrt()).cwiseMax(1e-12).matrix().transpose();
  }
  std::optional<Repeat> best;
  const double whole = hypervolume(mean, evidence.reference);
  for (const Eigen::Index i : pareto_front(mean)) {
    if (!may[std::size_t(i)]) continue;
    std::vector<Eigen::Index> others;
    for (Eigen::Index k = 0; k < n; ++k)
      if (k != i) others.push_back(k);
    const Eigen::MatrixXd rest = mean(Eigen::all, others);
    const double worth = ExpectedHypervolume(rest, evidence.reference).value(mean.col(i), moved.col(i)) -
                         (whole - hypervolume(rest, evidence.reference));
    if (!best || worth > best->worth) best = Repeat{i, worth};
  }
  return best;
}

}  // namespace lumo
