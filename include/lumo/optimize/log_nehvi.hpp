#pragma once

#include "lumo/optimize/acquisition.hpp"
#include "lumo/optimize/expected_hypervolume.hpp"


namespace lumo {

/// Log noisy expected hypervolume improvement with only the standing designs drawn: given a draw of them, a candidate's objectives are
/// independent and normal, so its improvement is known in closed form. Stays exact far from the front, where sampling the candidate too
/// finds no improvement and ranks by distance. Needs a reduction that is the identity.
/// Source of NEHVI: Daulton, Balandat & Bakshy, "Parallel Bayesian Optimization of Multiple Noisy Objectives with Expected Hypervolume
/// Improvement", NeurIPS 2021.
struct LogNehvi {
  int draws = 16;
  bool noisy = true;  ///< false: told values stand as they are, and only pending designs are drawn

  template <CovarianceKernel Kernel>
  class Prepared {
   public:
    Prepared(std::vector<ConditionalPosterior<Kernel>> posteriors, std::vector<ExpectedHypervolume> improvements)
        : posteriors_(std::move(posteriors)), improvements_(std::move(improvements)) {}

    Eigen::VectorXd operator()(const Eigen::MatrixXd& x) const {
      const std::size_t m = posteriors_.size(), count = improvements_.size();
      std::vector<typename ConditionalPosterior<Kernel>::Conditional> at;
      for (const auto& p : posteriors_) at.push_back(p.at(x));
      Eigen::VectorXd mean(static_cast<Eigen::Index>(m)), deviation(static_cast<Eigen::Index>(m)), out(x.cols());
      std::vector<double> logs(count);
      for (Eigen::Index i = 0; i < x.cols(); ++i) {
        for (std::size_t j = 0; j < m; ++j) deviation[Eigen::Index(j)] = at[j].deviation[i];
        const auto each = [&](auto&& take) {
          for (std::size_t s = 0; s < count; ++s) {
            for (std::size_t j = 0; j < m; ++j) mean[Eigen::Index(j)] = at[j].mean(i, Eigen::Index(s));
            take(s);
          }
        };
        double sum = 0.0;
        each([&](std::size_t s) { sum += improvements_[s].value(mean, deviation); });
        if (sum > 1e-280 && std::isfinite(sum)) {
          out[i] = std::log(sum / double(count));
          continue;
        }
        each([&](std::size_t s) { logs[s] = improvements_[s].log_value(mean, deviation); });
        out[i] = log_sum_exp(logs.begin(), logs.end()) - std::log(double(count));
      }
      return out;
    }

   private:
    std::vector<ConditionalPosterior<Kernel>> posteriors_;
    std::vector<ExpectedHypervolume> improvements_;
  };

  /// Models are looked at, not copied: they must outlive what is returned. Throws InvalidArgument for a reduction other than the identity.
  template <CovarianceKernel Kernel, Reduction R>
  Prepared<Kernel> prepare(const std::vector<GaussianProcess<Kernel>>& models, const R& reduction, const Evidence& evidence, std::uint64_t seed) const {
    if (!reduction.identity() || Eigen::Index(models.size()) != evidence.reference.size())
      throw InvalidArgument(detail::text("closed-form improvement needs one model for each of ", evidence.reference.size(), " objectives, has ", models.size(), " outputs to reduce"));
    const Eigen::MatrixXd base = detail::base_points(evidence, noisy);
    const Eigen::Index count = base.cols() ? std::max(1, draws) : 1;
    std::vector<ConditionalPosterior<Kernel>> posteriors;
    std::vector<Eigen::MatrixXd> drawn;
    for (std::size_t j = 0; j < models.size(); ++j) {
      posteriors.emplace_back(models[j], base, base_normals(base.cols(), count, detail::combine(seed, j)));
      drawn.push_back(posteriors.back().draws());
    }
    std::vector<ExpectedHypervolume> improvements;
    for (Eigen::Index s = 0; s < count; ++s) improvements.emplace_back(detail::standing_objectives(drawn, s, reduction, evidence, noisy), evidence.reference);
    return {std::move(posteriors), std::move(improvements)};
  }
};

static_assert(Acquisition<LogNehvi, std::vector<GaussianProcess<RbfKernel>>, EachOutput>);

}  // namespace lumo
