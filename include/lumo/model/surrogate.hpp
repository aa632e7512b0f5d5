#pragma once

#include "lumo/model/gaussian_process.hpp"

#include <Eigen/Core>

#include <algorithm>
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

}  // namespace lumo
