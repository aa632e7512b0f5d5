#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/model/kernel.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace lumo {

/// Hyper-parameters of a Gaussian process without output scale, on inputs normalised to the unit box and outputs
/// standardised.
struct Hyperparameters {
  Eigen::VectorXd length_scale;  ///< one per input
  double noise = 0.0;            ///< variance of an observation
  double mean = 0.0;
};

/// ln x is normal with mean `location` and standard deviation `scale`. Throws InvalidArgument for an x that is not
/// positive, and for numbers that are no distribution.
struct LogNormalPrior {
  double location = 0.0;
  double scale = 1.0;

  double log_density(double x) const {
    check(x);
    const double z = (std::log(x) - location) / scale;
    return -std::log(x) - std::log(scale) - 0.5 * std::log(2.0 * pi) - 0.5 * z * z;
  }
  /// d log_density / d ln x.
  double log_slope(double x) const {
    check(x);
    return -1.0 - (std::log(x) - location) / (scale * scale);
  }
  double mode() const {
    check(1.0);
    return std::exp(location - scale * scale);
  }

 private:
  void check(double x) const {
    require_positive("argument of a log-normal prior", x, "");
    require_in_range("location of a log-normal prior", location, -500.0, 500.0, "");
    require_in_range("scale of a log-normal prior", scale, 1e-6, 1e3, "");
  }
};

/// Priors and bounds under which hyper-parameters are fitted. The mean has no prior.
struct HyperparameterPrior {
  LogNormalPrior length_scale;  ///< of each
  LogNormalPrior noise{-4.0, 1.0};
  double min_length_scale = 0.025;
  double max_length_scale = 1e4;
  double min_noise = 1e-4;
  double max_noise = 10.0;

  /// Length scales grow with the square root of the dimension. Source: Hvarfner, Hellsten & Nardi, "Vanilla Bayesian
  /// Optimization Performs Great in High Dimensions", ICML 2024; the numbers are those of BoTorch 0.18.
  static HyperparameterPrior for_dimension(Eigen::Index d) {
    if (d < 1) throw InvalidArgument(message("Gaussian process has ", d, " inputs, must have at least 1"));
    HyperparameterPrior prior;
    prior.length_scale = {std::sqrt(2.0) + 0.5 * std::log(double(d)), std::sqrt(3.0)};
    return prior;
  }
};

/// Log marginal likelihood of a Gaussian process and its gradient in the logarithms of the hyper-parameters; the mean
/// takes its best value, (1ᵀK⁻¹y) / (1ᵀK⁻¹1), at each. Source: Rasmussen & Williams, Gaussian Processes for Machine
/// Learning, 2006, §5.4.
template <CovarianceKernel Kernel> class MarginalLikelihood {
 public:
  struct Value {
    /// −∞ where the covariance is not positive definite
    double log_likelihood = -std::numeric_limits<double>::infinity();
    double log_prior = 0.0;
    double mean = 0.0;
    Eigen::VectorXd gradient;            ///< d log_likelihood / d ln(length scales, noise)
    Eigen::VectorXd posterior_gradient;  ///< d (log_likelihood + log_prior) / d the same
  };

  /// `x`: d × n, normalised; `y`: n, standardised; `known_noise`: n variances besides the one that is fitted, or none.
  MarginalLikelihood(const Eigen::MatrixXd& x, const Eigen::VectorXd& y, Kernel kernel, HyperparameterPrior prior,
      Eigen::VectorXd known_noise = {})
      : size_(x.cols()),
        y_(y),
        known_noise_(std::move(known_noise)),
        kernel_(kernel),
        prior_(prior),
        squares_(x.cols() * (x.cols() - 1) / 2, x.rows()) {
    for (Eigen::Index k = 0, first = 0; k < size_; ++k) {
      const Eigen::Index below = size_ - 1 - k;
      squares_.middleRows(first, below) =
          (x.rightCols(below).colwise() - x.col(k)).array().square().matrix().transpose();
      first += below;
    }
  }

  Value operator()(const Hyperparameters& h, bool with_gradient = true) const {
    const Eigen::Index n = size_, d = squares_.cols();
    Value value;
    for (Eigen::Index j = 0; j < d; ++j) value.log_prior += prior_.length_scale.log_density(h.length_scale[j]);
    value.log_prior += prior_.noise.log_density(h.noise);

    const Eigen::VectorXd weight = h.length_scale.array().square().inverse();
    const Eigen::ArrayXXd r2 = squares_ * weight, correlation = kernel_.correlation(r2);
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(n, n);
    for (Eigen::Index k = 0, first = 0; k < n; first += n - 1 - k, ++k) {
      covariance(k, k) = 1.0 + h.noise;
      covariance.col(k).tail(n - 1 - k) = correlation.col(0).segment(first, n - 1 - k);
    }
    if (known_noise_.size() > 0) covariance.diagonal() += known_noise_;
    const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
    if (factor.info() != Eigen::Success) return value;

    Eigen::MatrixXd both(n, 2);
    both << y_, Eigen::VectorXd::Ones(n);
    factor.solveInPlace(both);
    value.mean = both.col(0).sum() / both.col(1).sum();
    const Eigen::VectorXd alpha = both.col(0) - value.mean * both.col(1);
    double log_determinant = 0.0;
    for (Eigen::Index i = 0; i < n; ++i) log_determinant += 2.0 * std::log(factor.matrixLLT()(i, i));
    value.log_likelihood =
        -0.5 * (alpha.dot((y_.array() - value.mean).matrix()) + log_determinant + double(n) * std::log(2.0 * pi));
    if (!std::isfinite(value.log_likelihood)) value.log_likelihood = -std::numeric_limits<double>::infinity();
    if (!with_gradient || !std::isfinite(value.log_likelihood)) return value;

    // ½ tr((α αᵀ − K⁻¹) dK): each pair counts twice. The mean is at its optimum and adds nothing.
    Eigen::MatrixXd inverse_factor = Eigen::MatrixXd::Identity(n, n);
    for (Eigen::Index first = 0; first < n; first += 32) {  // in blocks of columns, which are zero above the diagonal
      auto below = inverse_factor.block(first, first, n - first, std::min<Eigen::Index>(32, n - first));
      factor.matrixLLT()
          .bottomRightCorner(n - first, n - first)
          .template triangularView<Eigen::Lower>()
          .solveInPlace(below);
    }
    Eigen::MatrixXd inverse = Eigen::MatrixXd::Zero(n, n);
    inverse.template selfadjointView<Eigen::Lower>().rankUpdate(inverse_factor.transpose());
    Eigen::ArrayXXd pull = kernel_.slope(r2, correlation);
    for (Eigen::Index k = 0, first = 0; k < n; first += n - 1 - k, ++k) {
      const Eigen::Index below = n - 1 - k;
      pull.col(0).segment(first, below) *= alpha.tail(below).array() * alpha[k] - inverse.col(k).tail(below).array();
    }
    value.gradient.resize(d + 1);
    value.gradient.head(d) = -2.0 * weight.cwiseProduct(squares_.transpose() * pull.matrix());
    value.gradient[d] = 0.5 * h.noise * (alpha.squaredNorm() - inverse.trace());
    value.posterior_gradient = value.gradient;
    for (Eigen::Index j = 0; j < d; ++j)
      value.posterior_gradient[j] += prior_.length_scale.log_slope(h.length_scale[j]);
    value.posterior_gradient[d] += prior_.noise.log_slope(h.noise);
    return value;
  }

 private:
  Eigen::Index size_;
  Eigen::VectorXd y_, known_noise_;
  Kernel kernel_;
  HyperparameterPrior prior_;
  Eigen::MatrixXd squares_;  ///< (pair i > k, input): squared difference; pairs column by column of the lower triangle
};

}  // namespace lumo
