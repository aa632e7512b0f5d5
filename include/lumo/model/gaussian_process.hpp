#pragma once

#include "lumo/core/sobol.hpp"
#include "lumo/core/types.hpp"
#include "lumo/model/marginal_likelihood.hpp"
#include "lumo/model/quasi_newton.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

namespace lumo {

/// Data of a Gaussian process: inputs d × n inside [lower, upper], finite outputs n.
struct TrainingData {
  Eigen::MatrixXd x;
  Eigen::VectorXd y;
  Eigen::VectorXd lower, upper;
  Eigen::VectorXd errors = {};  ///< standard errors of the outputs, n, if they are known; empty otherwise
};

/// Lower Cholesky factor of a covariance, and the addition to its diagonal that it took.
struct JitteredFactor {
  Eigen::MatrixXd lower;
  double jitter = 0.0;
};

inline constexpr double largest_jitter = 2e-4;  ///< above 1e-4, whatever rounding did on the way there
constexpr double next_jitter(double jitter) { return jitter == 0.0 ? 1e-12 : 10.0 * jitter; }

/// Adds 0, 10⁻¹², 10⁻¹¹ … 10⁻⁴ times the largest variance until the matrix is positive definite; nullopt if even that
/// is too little.
inline std::optional<JitteredFactor> jittered_factor(const Eigen::MatrixXd& covariance) {
  const double top = covariance.size() ? covariance.diagonal().maxCoeff() : 0.0;
  for (double jitter = 0.0; jitter <= largest_jitter; jitter = next_jitter(jitter)) {
    Eigen::MatrixXd a = covariance;
    a.diagonal().array() += jitter * top;
    const Eigen::LLT<Eigen::MatrixXd> factor(a);
    if (factor.info() == Eigen::Success && factor.matrixLLT().diagonal().minCoeff() > 0.0)
      return JitteredFactor{Eigen::MatrixXd(factor.matrixL()), jitter * top};
  }
  return std::nullopt;
}

/// Gaussian process regression with a constant mean, one length scale per input and homoscedastic noise. Inputs are
/// normalised by their bounds and outputs standardised (n − 1) inside; results are in the units of the data.
/// Equal inputs and constant outputs are allowed.
template <CovarianceKernel Kernel = RbfKernel> class GaussianProcess {
 public:
  struct Config {
    Kernel kernel = {};
    std::optional<HyperparameterPrior> prior;  ///< default: HyperparameterPrior::for_dimension
    int starts = 3;                            ///< searches for hyper-parameters; the first begins at the prior's modes
    int probes = 16;                           ///< places, the other starts are the best of
    Eigen::Index subset = 64;  ///< with more observations, the search over all begins at the best optimum of this many
    QuasiNewton search = {};
  };

  /// Fits hyper-parameters to their maximum a posteriori. Deterministic. Throws InvalidArgument for shapes that do not
  /// fit, values that are not finite, or no observations.
  static GaussianProcess fit(const TrainingData& data, const Config& config = {}) {
    GaussianProcess gp(data, config);
    const Eigen::Index n = gp.size();
    const MarginalLikelihood<Kernel> likelihood = gp.likelihood();
    std::vector<Minimum> optima;
    if (n <= config.subset) {
      optima = gp.optima(likelihood, n);
    } else {
      std::vector<Eigen::Index> some;
      for (Eigen::Index i = 0; i < config.subset; ++i) some.push_back(i * n / config.subset);
      const MarginalLikelihood<Kernel> coarse(gp.x_(Eigen::all, some), gp.y_(some), config.kernel, gp.prior(),
          gp.known_noise_.size() ? Eigen::VectorXd(gp.known_noise_(some)) : Eigen::VectorXd());
      gp.config_.search.value_tolerance = 1e-5;  // a start needs no more
      const std::vector<Minimum> found = gp.optima(coarse, config.subset);
      gp.config_.search = config.search;
      std::optional<std::size_t> nearest;
      double least = std::numeric_limits<double>::infinity();
      for (std::size_t k = 0; k < found.size(); ++k)
        if (const double value = negative(likelihood, n, found[k].x, nullptr); value < least) {
          least = value;
          nearest = k;
        }
      optima = {nearest ? gp.descend(likelihood, n, found[*nearest].x, found[*nearest].hessian)
                        : gp.descend(likelihood, n, gp.modes())};
    }
    const Minimum* best = &optima.front();
    for (const Minimum& o : optima) best = o.value < best->value - 1e-9 ? &o : best;
    Hyperparameters h = unpack(best->x);
    h.mean = likelihood(h, false).mean;
    gp.converged_ = best->converged;
    gp.condition(h);
    return gp;
  }

  /// Takes hyper-parameters as given. Throws as fit(), and if no bounded jitter makes the covariance positive definite.
  GaussianProcess(const TrainingData& data, const Hyperparameters& h, const Config& config = {})
      : GaussianProcess(data, config) {
    if (h.length_scale.size() != x_.rows() || !h.length_scale.allFinite() || !(h.length_scale.minCoeff() > 0.0) ||
        !(h.noise >= 0.0 && std::isfinite(h.noise)))
      throw InvalidArgument(message("Gaussian process: needs ", x_.rows(),
          " length scales > 0 and a noise variance >= 0, has ", h.length_scale.size(), " and ", h.noise));
    require_finite("mean of a Gaussian process", h.mean, "");
    condition(h);
  }

  const Hyperparameters& hyperparameters() const { return hyperparameters_; }
  double jitter() const { return jitter_; }  ///< added to the diagonal of the standardised covariance
  bool converged() const { return converged_; }
  Eigen::Index size() const { return x_.cols(); }
  /// (log p(y) + log prior) / n of the standardised outputs: what fit() maximises.
  double objective() const {
    const auto value = likelihood()(hyperparameters_, false);
    return (value.log_likelihood + value.log_prior) / double(size());
  }
  /// By how much the data are likelier (in the logarithm) than to a model of the same kind with hardly any noise.
  double evidence_of_noise() const {
    Config quiet = config_;
    quiet.prior = prior();
    quiet.prior->max_noise = quiet.prior->min_noise;
    GaussianProcess other = *this;
    other.config_ = quiet;
    const MarginalLikelihood<Kernel> without = other.likelihood();
    double best = -std::numeric_limits<double>::infinity();
    for (const Minimum& o : other.optima(without, size()))
      best = std::max(best, without(unpack(o.x), false).log_likelihood);
    return likelihood()(hyperparameters_, false).log_likelihood - best;
  }

  /// Mean and variance of the latent function (without observation noise) at the columns of `x`. All that takes places
  /// throws InvalidArgument for another number of inputs, and for numbers that are not finite.
  struct Prediction {
    Eigen::VectorXd mean, variance;
  };
  Prediction predict(const Eigen::MatrixXd& x) const {
    const Eigen::MatrixXd v = whitened(normalized(x));
    const Eigen::VectorXd standard = (v.transpose() * whitened_y_).array() + hyperparameters_.mean;
    const Eigen::VectorXd variance = (1.0 - v.colwise().squaredNorm().array()).max(0.0).transpose();
    return {(output_mean_ + output_scale_ * standard.array()).matrix(), output_scale_ * output_scale_ * variance};
  }
  Eigen::VectorXd mean(const Eigen::MatrixXd& x) const {
    const Eigen::VectorXd alpha = factor_.matrixU().solve(whitened_y_);
    return (output_mean_ + output_scale_ * ((correlation(normalized(x), x_) * alpha).array() + hyperparameters_.mean))
        .matrix();
  }
  /// Posterior covariance of the latent function between two sets of points.
  Eigen::MatrixXd covariance(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) const {
    const Eigen::MatrixXd ua = normalized(a), ub = normalized(b);
    return output_scale_ * output_scale_ * (correlation(ua, ub) - whitened(ua).transpose() * whitened(ub));
  }
  /// Joint samples at the columns of `x`: points × samples, from standard normal numbers of the same shape. nullopt if
  /// the covariance cannot be factorised.
  std::optional<Eigen::MatrixXd> sample(const Eigen::MatrixXd& x, const Eigen::MatrixXd& normals) const {
    if (normals.rows() != x.cols() || !normals.allFinite())
      throw InvalidArgument(
          message("samples at ", x.cols(), " points need as many rows of finite normal numbers, not ", normals.rows()));
    const auto factor = jittered_factor(covariance(x, x));
    if (!factor) return std::nullopt;
    return (factor->lower * normals).colwise() + predict(x).mean;
  }
  /// Prediction of each observation without it, with its noise, from the fitted hyper-parameters.
  /// Source: Rasmussen & Williams 2006, eq. 5.12.
  Prediction leave_one_out() const {
    const Eigen::MatrixXd inverse = factor_.solve(Eigen::MatrixXd::Identity(size(), size()));
    const Eigen::VectorXd alpha = factor_.matrixU().solve(whitened_y_);
    const Eigen::ArrayXd variance = inverse.diagonal().array().inverse();
    return {(output_mean_ + output_scale_ * (y_.array() - alpha.array() * variance)).matrix(),
        (output_scale_ * output_scale_ * variance).matrix()};
  }

  /// K(X, x) after forward substitution: V with posterior covariance k(a, b) − V(a)ᵀV(b), in standardised units.
  Eigen::MatrixXd whitened(const Eigen::MatrixXd& unit_x) const {
    Eigen::MatrixXd v = correlation(x_, unit_x);
    factor_.matrixL().solveInPlace(v);
    return v;
  }
  Eigen::MatrixXd correlation(const Eigen::MatrixXd& unit_a, const Eigen::MatrixXd& unit_b) const {
    const Eigen::ArrayXd inverse = hyperparameters_.length_scale.array().inverse();
    const Eigen::MatrixXd a = (unit_a.array().colwise() * inverse).matrix(),
                          b = (unit_b.array().colwise() * inverse).matrix();
    Eigen::ArrayXXd r2 = Eigen::ArrayXXd::Zero(a.cols(), b.cols());
    for (Eigen::Index i = 0; i < b.cols(); ++i)
      for (Eigen::Index j = 0; j < a.rows(); ++j) r2.col(i) += (a.row(j).array() - b(j, i)).square().transpose();
    return config_.kernel.correlation(r2);
  }
  Eigen::MatrixXd normalized(const Eigen::MatrixXd& x) const {
    if (x.rows() != lower_.size() || !x.allFinite())
      throw InvalidArgument(
          message("Gaussian process: places have ", x.rows(), " inputs, must have ", lower_.size(), " finite ones"));
    Eigen::MatrixXd unit = ((x.colwise() - lower_).array().colwise() * inverse_width_.array()).matrix();
    constexpr double largest = 1e100;  // squares of differences do not overflow
    if (!(unit.array().abs() <= largest).all())
      throw InvalidArgument("Gaussian process: a place is more than 1e100 widths of the bounds away");
    return unit;
  }
  const Eigen::VectorXd& weights() const { return whitened_y_; }  ///< L⁻¹(y − mean), standardised
  double output_mean() const { return output_mean_; }
  double output_scale() const { return output_scale_; }

 private:
  Eigen::MatrixXd x_;            ///< normalised
  Eigen::VectorXd y_;            ///< standardised
  Eigen::VectorXd known_noise_;  ///< variances of the observations that are known, standardised; empty: none
  Eigen::VectorXd lower_, inverse_width_;
  double output_mean_ = 0.0, output_scale_ = 1.0;
  Hyperparameters hyperparameters_;
  Config config_;
  Eigen::LLT<Eigen::MatrixXd> factor_;
  Eigen::VectorXd whitened_y_;
  double jitter_ = 0.0;
  bool converged_ = true;

  explicit GaussianProcess(const TrainingData& data, const Config& config) : lower_(data.lower), config_(config) {
    const Eigen::Index d = data.x.rows(), n = data.x.cols();
    if (n < 1 || d < 1)
      throw InvalidArgument(
          message("Gaussian process has ", n, " observations of ", d, " inputs, must have at least 1 of each"));
    if (data.y.size() != n || data.lower.size() != d || data.upper.size() != d)
      throw InvalidArgument(message("Gaussian process has ", n, " observations of ", d, " inputs, but ", data.y.size(),
          " outputs, ", data.lower.size(), " lower and ", data.upper.size(), " upper bounds"));
    if (!data.x.allFinite() || !data.y.allFinite() || !data.lower.allFinite() || !data.upper.allFinite())
      throw InvalidArgument("Gaussian process: observations and bounds must be finite numbers");
    inverse_width_ = (data.upper - data.lower).unaryExpr([](double w) { return w > 0.0 ? 1.0 / w : 0.0; });
    x_ = normalized(data.x);

    // Scaled so that squares neither overflow nor vanish.
    const double size = std::max(data.y.cwiseAbs().maxCoeff(), std::numeric_limits<double>::min());
    const Eigen::VectorXd scaled = data.y / size;
    const double mean = scaled.mean();
    const double deviation = n > 1 ? std::sqrt((scaled.array() - mean).square().sum() / double(n - 1)) : 0.0;
    const bool constant = deviation < 1e-14;  // no more than rounding
    output_mean_ = mean * size;
    output_scale_ = constant ? 1.0 : deviation * size;
    y_ = constant ? Eigen::VectorXd::Zero(n) : Eigen::VectorXd((scaled.array() - mean) / deviation);
    if (data.errors.size() == 0) return;
    if (data.errors.size() != n || !data.errors.allFinite() || data.errors.minCoeff() < 0.0)
      throw InvalidArgument(
          message("Gaussian process: needs ", n, " finite standard errors >= 0, has ", data.errors.size()));
    constexpr double largest = 1e3;  // of a standard deviation of the outputs: such an observation says nothing
    known_noise_ = (data.errors.array() / output_scale_).min(largest).square().matrix();
  }
  MarginalLikelihood<Kernel> likelihood() const { return {x_, y_, config_.kernel, prior(), known_noise_}; }
  void condition(const Hyperparameters& h) {
    hyperparameters_ = h;
    Eigen::MatrixXd covariance = correlation(x_, x_);
    covariance.diagonal().array() += h.noise;
    if (known_noise_.size() > 0) covariance.diagonal() += known_noise_;
    for (jitter_ = 0.0;; jitter_ = next_jitter(jitter_)) {
      if (jitter_ > largest_jitter)
        throw InvalidArgument("Gaussian process: covariance is not positive definite, even with a jitter of 1e-4");
      Eigen::MatrixXd a = covariance;
      a.diagonal().array() += jitter_;
      factor_.compute(a);
      if (factor_.info() == Eigen::Success && factor_.matrixLLT().diagonal().minCoeff() > 0.0) break;
    }
    whitened_y_ = (y_.array() - h.mean).matrix();
    factor_.matrixL().solveInPlace(whitened_y_);
  }
  // The search for hyper-parameters is in their logarithms; it minimises −(log p(y) + log prior)/n.
  static Hyperparameters unpack(const Eigen::VectorXd& u) {
    const Eigen::Index d = u.size() - 1;
    return {u.head(d).unaryExpr([](double v) { return std::exp(v); }), std::exp(u[d]), 0.0};
  }
  static double negative(const MarginalLikelihood<Kernel>& likelihood, Eigen::Index n, const Eigen::VectorXd& u,
      Eigen::VectorXd* gradient) {
    const auto value = likelihood(unpack(u), gradient != nullptr);
    if (!std::isfinite(value.log_likelihood)) return std::numeric_limits<double>::infinity();
    if (gradient) *gradient = -value.posterior_gradient / double(n);
    return -(value.log_likelihood + value.log_prior) / double(n);
  }
  Eigen::VectorXd modes() const {
    Eigen::VectorXd u = Eigen::VectorXd::Constant(x_.rows() + 1, std::log(prior().length_scale.mode()));
    u[x_.rows()] = std::log(prior().noise.mode());
    return u;
  }
  Minimum descend(const MarginalLikelihood<Kernel>& likelihood, Eigen::Index n, const Eigen::VectorXd& start,
      const std::optional<Eigen::MatrixXd>& hessian = std::nullopt) const {
    const Eigen::Index d = x_.rows();
    const HyperparameterPrior p = prior();
    Eigen::VectorXd lower = Eigen::VectorXd::Constant(d + 1, std::log(p.min_length_scale)),
                    upper = Eigen::VectorXd::Constant(d + 1, std::log(p.max_length_scale));
    lower[d] = std::log(p.min_noise);
    upper[d] = std::log(p.max_noise);
    return config_.search.minimize(
        [&](const Eigen::VectorXd& u, Eigen::VectorXd& gradient) { return negative(likelihood, n, u, &gradient); },
        start, lower, upper, hessian);
  }
  /// One start stops in local optima: after the prior's modes come the most promising of some places spread between
  /// short and long length scales, little and much noise.
  std::vector<Minimum> optima(const MarginalLikelihood<Kernel>& likelihood, Eigen::Index n) const {
    const Eigen::Index d = x_.rows();
    std::vector<Minimum> found = {descend(likelihood, n, modes())};
    std::vector<std::pair<double, Eigen::VectorXd>> probes;
    for (int k = 0; config_.starts > 1 && k < config_.probes; ++k) {
      Eigen::VectorXd u(d + 1);
      for (Eigen::Index j = 0; j <= d; ++j) {
        const double t =
            OwenSobol{combine(7, std::uint64_t(j / Sobol::dimensions))}(std::uint32_t(k), int(j % Sobol::dimensions));
        u[j] = j < d ? std::log(0.1) + t * (std::log(100.0) + 0.5 * std::log(double(d)))
                     : std::log(1e-4) + t * std::log(1e3);
      }
      if (const double value = negative(likelihood, n, u, nullptr); std::isfinite(value)) probes.emplace_back(value, u);
    }
    std::stable_sort(probes.begin(), probes.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    for (std::size_t k = 0; k < probes.size() && int(k) + 1 < config_.starts; ++k)
      found.push_back(descend(likelihood, n, probes[k].second));
    return found;
  }
  HyperparameterPrior prior() const {
    return config_.prior ? *config_.prior : HyperparameterPrior::for_dimension(x_.rows());
  }
};

}  // namespace lumo
