#pragma once

#include "lumo/optimize/acquisition.hpp"
#include "lumo/optimize/expected_hypervolume.hpp"

namespace lumo {

/// Log noisy expected hypervolume improvement with only the standing designs drawn: given a draw of them, a candidate's
/// objectives are independent and normal, so its improvement is known in closed form. Stays exact far from the front,
/// where a sampled candidate finds no improvement and is ranked by distance. Needs a reduction that is the identity.
/// Source of NEHVI: Daulton, Balandat & Bakshy, "Parallel Bayesian Optimization of Multiple Noisy Objectives with
/// Expected Hypervolume Improvement", NeurIPS 2021.
struct LogNehvi {
  int draws = 16;
  bool noisy = true;  ///< false: observed values stand as they are, and only pending designs are drawn
  /// Observed designs are not drawn if another still beats them in all objectives after so many deviations of both
  /// towards each other: they would hardly ever be in a front, and cost time.
  double hopeless = 3.0;

  template <CovarianceKernel Kernel> class Prepared {
   public:
    Prepared(std::vector<ConditionalPosterior<Kernel>> posteriors, std::vector<ExpectedHypervolume> improvements)
        : posteriors_(std::move(posteriors)), improvements_(std::move(improvements)) {}

    Eigen::VectorXd operator()(const Eigen::MatrixXd& x) const {
      const auto m = Eigen::Index(posteriors_.size()), drawn = Eigen::Index(improvements_.size());
      std::vector<typename ConditionalPosterior<Kernel>::Conditional> at;
      for (const auto& p : posteriors_) at.push_back(p.at(x));
      Eigen::VectorXd mean(m), deviation(m), sum = Eigen::VectorXd::Zero(x.cols());
      const auto load = [&](Eigen::Index i, Eigen::Index s) {
        for (Eigen::Index j = 0; j < m; ++j) {
          mean[j] = at[std::size_t(j)].mean(i, s);
          deviation[j] = at[std::size_t(j)].deviation[i];
        }
      };
      for (Eigen::Index s = 0; s < drawn; ++s)
        for (Eigen::Index i = 0; i < x.cols(); ++i) {
          load(i, s);
          sum[i] += improvements_[std::size_t(s)].value(mean, deviation);
        }
      std::vector<double> logs(improvements_.size());
      for (Eigen::Index i = 0; i < x.cols(); ++i) {
        if (sum[i] > 1e-280 && std::isfinite(sum[i])) {
          sum[i] = std::log(sum[i] / double(drawn));
          continue;
        }
        for (Eigen::Index s = 0; s < drawn; ++s) {  // hopeless, but to be ranked
          load(i, s);
          logs[std::size_t(s)] = improvements_[std::size_t(s)].log_value(mean, deviation);
        }
        sum[i] = log_sum_exp(logs.begin(), logs.end()) - std::log(double(drawn));
      }
      return sum;
    }

   private:
    std::vector<ConditionalPosterior<Kernel>> posteriors_;
    std::vector<ExpectedHypervolume> improvements_;
  };

  /// Models are referred to, not copied: they must outlive the result. Throws InvalidArgument for a reduction other
  /// than the identity.
  template <CovarianceKernel Kernel, Reduction R>
  Prepared<Kernel> prepare(const std::vector<GaussianProcess<Kernel>>& models, const R& reduction,
      const Evidence& evidence, std::uint64_t seed) const {
    if (!reduction.identity() || Eigen::Index(models.size()) != evidence.reference.size())
      throw InvalidArgument(message("closed-form improvement needs one model for each of ", evidence.reference.size(),
          " objectives, has ", models.size(), " outputs to reduce"));
    const Eigen::MatrixXd base = noisy ? contenders(models, evidence) : evidence.pending;
    const Eigen::Index count = base.cols() ? std::max(1, draws) : 1;
    std::vector<ConditionalPosterior<Kernel>> posteriors;
    std::vector<Eigen::MatrixXd> drawn;
    for (std::size_t j = 0; j < models.size(); ++j) {
      posteriors.emplace_back(models[j], base, base_normals(base.cols(), count, combine(seed, j)));
      drawn.push_back(posteriors.back().draws());
    }
    std::vector<ExpectedHypervolume> improvements;
    for (Eigen::Index s = 0; s < count; ++s)
      improvements.emplace_back(standing_objectives(drawn, s, reduction, evidence, noisy), evidence.reference);
    return {std::move(posteriors), std::move(improvements)};
  }

 private:
  /// Observed designs that may be in a front, and all that are pending.
  template <CovarianceKernel Kernel>
  Eigen::MatrixXd contenders(const std::vector<GaussianProcess<Kernel>>& models, const Evidence& evidence) const {
    const Eigen::Index n = evidence.x.cols(), m = Eigen::Index(models.size());
    Eigen::MatrixXd low(m, n), high(m, n);
    for (Eigen::Index j = 0; j < m; ++j) {
      const auto p = models[std::size_t(j)].predict(evidence.x);
      const Eigen::VectorXd reach = hopeless * p.variance.cwiseSqrt();
      low.row(j) = (p.mean - reach).transpose();
      high.row(j) = (p.mean + reach).transpose();
    }
    std::vector<Eigen::Index> kept;
    for (Eigen::Index i = 0; i < n; ++i) {
      bool beaten = false;
      for (Eigen::Index k = 0; k < n && !beaten; ++k) beaten = (low.col(k).array() > high.col(i).array()).all();
      if (!beaten) kept.push_back(i);
    }
    Eigen::MatrixXd base(evidence.x.rows(), Eigen::Index(kept.size()) + evidence.pending.cols());
    base << Eigen::MatrixXd(evidence.x(Eigen::all, kept)), evidence.pending;
    return base;
  }
};

}  // namespace lumo
