#pragma once

#include "lumo/model/gaussian_process.hpp"
#include "lumo/model/normal.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>

namespace lumo {

/// Probability that an evaluation succeeds, for objectives that are not defined everywhere, and it is not known where:
/// a Gaussian process of 1 for a success and 0 for a failure of the design, and the probability that it is above one
/// half. Labels are taken as numbers with noise, so no iteration is needed. Source: hidden constraints of Lee,
/// Gramacy, Linkletter & Gray, Pacific J. Optim. 7 (2011); their probability as a factor of the acquisition: Gelbart,
/// Snoek & Adams, UAI 2014.
template <CovarianceKernel Kernel = RbfKernel> class SuccessModel {
 public:
  static constexpr double least_probability = 1e-12;  ///< leaves a choice between designs that are all thought to fail
  static constexpr double negligible =
      1e-3;  ///< utility that is not worth a failure, in units of the objectives' spread

  /// Designs (d × n each) inside [lower, upper], at least one in all. Throws InvalidArgument as GaussianProcess::fit().
  SuccessModel(const Eigen::MatrixXd& succeeded, const Eigen::MatrixXd& failed, const Eigen::VectorXd& lower,
      const Eigen::VectorXd& upper, const typename GaussianProcess<Kernel>::Config& config = {})
      : process_(GaussianProcess<Kernel>::fit(labelled(succeeded, failed, lower, upper), config)) {}

  /// log P(success) at the columns of `x`, from log least_probability to 0.
  Eigen::VectorXd log_probability(const Eigen::MatrixXd& x) const {
    const auto label = process_.predict(x);
    Eigen::VectorXd log(x.cols());
    for (Eigen::Index i = 0; i < x.cols(); ++i) {
      const double deviation = std::max(std::sqrt(label.variance[i]), 1e-9);  // labels are of order 1
      log[i] = std::log(std::max(normal_probability((label.mean[i] - 0.5) / deviation), least_probability));
    }
    return log;
  }

  /// log((utility + negligible) P(success)) from log utility at the columns of `x`. Once a search has converged on the
  /// edge of the failures, all utility lies beyond the edge, by many orders of magnitude; without the constant the
  /// search would ask for designs there without end.
  Eigen::VectorXd expected(const Eigen::VectorXd& log_utility, const Eigen::MatrixXd& x) const {
    const Eigen::VectorXd floor = Eigen::VectorXd::Constant(x.cols(), std::log(negligible)),
                          high = log_utility.cwiseMax(floor), low = log_utility.cwiseMin(floor);
    return high + (low - high).array().exp().log1p().matrix() + log_probability(x);
  }

 private:
  static TrainingData labelled(const Eigen::MatrixXd& succeeded, const Eigen::MatrixXd& failed,
      const Eigen::VectorXd& lower, const Eigen::VectorXd& upper) {
    Eigen::MatrixXd x(lower.size(), succeeded.cols() + failed.cols());
    x << succeeded, failed;
    Eigen::VectorXd y(x.cols());
    y << Eigen::VectorXd::Ones(succeeded.cols()), Eigen::VectorXd::Zero(failed.cols());
    return {x, y, lower, upper};
  }

  GaussianProcess<Kernel> process_;
};

}  // namespace lumo
