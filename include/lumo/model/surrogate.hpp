#pragma once

#include "lumo/model/gaussian_process.hpp"
#include "lumo/model/normal.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <concepts>
#include <numeric>
#include <vector>

namespace lumo {

/// How observed outputs become objectives. Laws: objectives(outputs) works column by column (outputs × points →
/// objectives × points); there are outputs(m) outputs for m objectives, and objective(k) is the one that output k
/// counts for; identity() only if objectives() returns its argument, so that normal outputs stay normal; scaling
/// all outputs of an objective by s > 0 scales the objective by s.
template <class R>
concept Reduction = requires(const R& reduction, const Eigen::MatrixXd& outputs, int k) {
  { reduction.objectives(outputs) } -> std::convertible_to<Eigen::MatrixXd>;
  { reduction.outputs(k) } -> std::convertible_to<int>;
  { reduction.objective(k) } -> std::convertible_to<int>;
  { reduction.identity() } -> std::convertible_to<bool>;
};

/// Each output is an objective.
struct EachOutput {
  const Eigen::MatrixXd& objectives(const Eigen::MatrixXd& outputs) const { return outputs; }
  int outputs(int objectives) const { return objectives; }
  int objective(int output) const { return output; }
  bool identity() const { return true; }
};

/// Composite surrogate: each objective is the least of its terms (scenarios), and each term has a Gaussian process of
/// its own, so that the kinks of the minimum stay out of the model. Source: Astudillo & Frazier, "Bayesian Optimization
/// of Composite Functions", ICML 2019.
struct MinimumOverTerms {
  std::vector<int> terms;  ///< number of consecutive outputs that belong to each objective

  Eigen::MatrixXd objectives(const Eigen::MatrixXd& y) const {
    Eigen::MatrixXd least(Eigen::Index(terms.size()), y.cols());
    Eigen::Index first = 0;
    for (std::size_t j = 0; j < terms.size(); first += terms[j++])
      least.row(Eigen::Index(j)) = y.middleRows(first, terms[j]).colwise().minCoeff();
    return least;
  }
  /// Throws InvalidArgument unless there are as many counts as objectives, and all are positive.
  int outputs(int objectives) const {
    if (int(terms.size()) != objectives || std::any_of(terms.begin(), terms.end(), [](int n) { return n < 1; }))
      throw InvalidArgument(message("minimum over terms needs a positive number of terms for each of ", objectives,
          " objectives, has ", terms.size(), " numbers"));
    return std::accumulate(terms.begin(), terms.end(), 0);
  }
  int objective(int output) const {
    int j = 0;
    for (; j + 1 < int(terms.size()) && output >= terms[std::size_t(j)]; ++j) output -= terms[std::size_t(j)];
    return j;
  }
  bool identity() const {
    return std::all_of(terms.begin(), terms.end(), [](int n) { return n == 1; });
  }
};

static_assert(Reduction<EachOutput>);
static_assert(Reduction<MinimumOverTerms>);

/// Designs that are observed or pending, as acquisitions see them. All objectives are maximised.
struct Evidence {
  Eigen::MatrixXd x;        ///< observed: d × n
  Eigen::MatrixXd outputs;  ///< observed: outputs × n
  Eigen::MatrixXd errors;   ///< their standard errors, 0 where not known; empty where none is
  Eigen::MatrixXd pending;  ///< d × p: asked and not yet observed
  Eigen::VectorXd lower, upper;
  Eigen::VectorXd reference;  ///< per objective
};

/// Joint posterior of a Gaussian process at base points, drawn once, and of any further point given each draw. Without
/// base points there is one empty draw, and the conditional on it is the plain posterior.
template <CovarianceKernel Kernel> class ConditionalPosterior {
 public:
  /// `normals`: base points × draws. Throws InvalidArgument if they do not fit.
  ConditionalPosterior(const GaussianProcess<Kernel>& gp, const Eigen::MatrixXd& base, const Eigen::MatrixXd& normals)
      : gp_(&gp), base_(gp.normalized(base)), normals_(normals) {
    if (normals.rows() != base.cols())
      throw InvalidArgument(
          message("draws at ", base.cols(), " points need as many rows of normal numbers, not ", normals.rows()));
    if (base.cols() == 0) return;
    whitened_ = gp.whitened(base_);
    const auto factor = jittered_factor(gp.correlation(base_, base_) - whitened_.transpose() * whitened_);
    if (!factor) throw InvalidArgument("posterior covariance of the base points is not positive definite");
    factor_ = factor->lower;
    jitter_ = factor->jitter;
  }

  /// Samples at the base points: points × draws, in the units of the data.
  Eigen::MatrixXd draws() const {
    if (base_.cols() == 0) return Eigen::MatrixXd(0, std::max<Eigen::Index>(1, normals_.cols()));
    const Eigen::MatrixXd standard = (factor_ * normals_).colwise() + standard_mean(whitened_);
    return (gp_->output_mean() + gp_->output_scale() * standard.array()).matrix();
  }

  /// Given each draw, the latent function at the columns of `x` is normal with these means (points × draws) and
  /// deviations (points).
  struct Conditional {
    Eigen::MatrixXd mean;
    Eigen::VectorXd deviation;
  };
  Conditional at(const Eigen::MatrixXd& x) const {
    const Eigen::MatrixXd unit = gp_->normalized(x), v = gp_->whitened(unit);
    Eigen::VectorXd variance = (1.0 - v.colwise().squaredNorm().array()).transpose();
    Eigen::MatrixXd standard = standard_mean(v);
    if (base_.cols() > 0) {
      Eigen::MatrixXd cross = gp_->correlation(base_, unit) - whitened_.transpose() * v;
      factor_.template triangularView<Eigen::Lower>().solveInPlace(cross);
      variance.array() -= cross.colwise().squaredNorm().array().transpose();
      standard = (cross.transpose() * normals_).colwise() + Eigen::VectorXd(standard.col(0));
    }
    const double scale = gp_->output_scale();
    return {(gp_->output_mean() + scale * standard.array()).matrix(), scale * variance.cwiseMax(1e-18).cwiseSqrt()};
  }

  double jitter() const { return jitter_; }

 private:
  Eigen::VectorXd standard_mean(const Eigen::MatrixXd& v) const {
    return ((v.transpose() * gp_->weights()).array() + gp_->hyperparameters().mean).matrix();
  }

  const GaussianProcess<Kernel>* gp_;
  Eigen::MatrixXd base_, normals_, whitened_, factor_;
  double jitter_ = 0.0;
};

/// Probability that an evaluation succeeds, for objectives that are not defined everywhere, and it is not known where:
/// a Gaussian process of 1 for a success and 0 for a failure of the design, and the probability that it is above one
/// half. Labels are taken as numbers with noise, so no iteration is needed. Source: hidden constraints of Lee,
/// Gramacy, Linkletter & Gray, Pacific J. Optim. 7 (2011); their probability as a factor of the acquisition: Gelbart,
/// Snoek & Adams, UAI 2014.
template <CovarianceKernel Kernel = RbfKernel> class SuccessModel {
 public:
  static constexpr double least_probability = 1e-12;  ///< leaves a choice between designs that are all thought to fail
  /// Utility that is not worth a failure, in units of the objectives' spread
  static constexpr double negligible = 1e-3;

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
