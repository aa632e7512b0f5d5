#pragma once

#include "lumo/optimize/acquisition.hpp"
#include "lumo/optimize/directed_hypervolume.hpp"
#include "lumo/optimize/hypervolume.hpp"

#include <utility>
#include <variant>
#include <vector>

namespace lumo {

/// Log noisy expected hypervolume improvement with only the standing designs drawn: given a draw of them, a candidate's
/// objectives are independent and normal, so its improvement is known in closed form. Stays exact far from the front,
/// where a sampled candidate finds no improvement and is ranked by distance. Needs a reduction that is the identity.
/// Source of NEHVI: Daulton, Balandat & Bakshy, "Parallel Bayesian Optimization of Multiple Noisy Objectives with
/// Expected Hypervolume Improvement", NeurIPS 2021.
/// Boxes are exact for up to three objectives. Above, their number explodes, and the improvement is a mean over
/// directions (DirectedHypervolume), with other directions in each draw.
struct LogNehvi {
  static constexpr Eigen::Index exact_objectives = 3;
  int draws = 16;
  int directions = 8;  ///< of each draw, with more than `exact_objectives`
  bool noisy = true;   ///< false: observed values stand as they are, and only pending designs are drawn
  /// Observed designs are not drawn if another still beats them in all objectives after so many deviations of both
  /// towards each other: they would hardly ever be in a front, and cost time.
  double hopeless = 3.0;

  template <CovarianceKernel Kernel, class Improvement> class Over {
   public:
    Over(std::vector<ConditionalPosterior<Kernel>> posteriors, std::vector<Improvement> improvements)
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
    std::vector<Improvement> improvements_;
  };
  template <CovarianceKernel Kernel> class Prepared {
   public:
    using Exact = Over<Kernel, ExpectedHypervolume>;
    using Directed = Over<Kernel, DirectedHypervolume>;
    explicit Prepared(std::variant<Exact, Directed> utility) : utility_(std::move(utility)) {}

    Eigen::VectorXd operator()(const Eigen::MatrixXd& x) const {
      return std::visit([&](const auto& utility) { return utility(x); }, utility_);
    }

   private:
    std::variant<Exact, Directed> utility_;
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
    const auto standing = [&](Eigen::Index s) { return standing_objectives(drawn, s, reduction, evidence, noisy); };
    if (evidence.reference.size() <= exact_objectives) {
      std::vector<ExpectedHypervolume> improvements;
      for (Eigen::Index s = 0; s < count; ++s) improvements.emplace_back(standing(s), evidence.reference);
      return Prepared<Kernel>(typename Prepared<Kernel>::Exact{std::move(posteriors), std::move(improvements)});
    }
    std::vector<DirectedHypervolume> improvements;
    for (Eigen::Index s = 0; s < count; ++s)
      improvements.emplace_back(standing(s), evidence.reference,
          hypervolume_directions(evidence.reference.size(), directions * draws / count, combine(combine(seed, 97), s)));
    return Prepared<Kernel>(typename Prepared<Kernel>::Directed{std::move(posteriors), std::move(improvements)});
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

namespace detail {

/// log of a smooth max(x, 0) whose lower tail falls like 1/x² instead of exponentially. Source: Ament et al. 2023,
/// appendix A.
inline double log_fat_relu(double x, double tau) {
  const double t = x / tau;
  const double softplus = t > 0.0 ? t + std::log1p(std::exp(-t)) : std::log1p(std::exp(t));
  return std::log(tau) + std::log(softplus + 0.1 / (1.0 + t * t));
}

/// Smooth minimum of two numbers with a tail that falls like a power. Source: Ament et al. 2023, appendix A.
inline double fat_minimum(double a, double b, double tau) {
  const double gap = std::abs(a - b) / tau;
  return std::min(a, b) - tau * std::log1p(2.0 / (2.0 + gap * (2.0 + gap)));
}

}  // namespace detail

/// qLogNEHVI by sampling, for any reduction: q > 1 designs are chosen one after the other, each with those before it
/// pending, and pending designs join the front draw by draw. Fixed base samples. Source: Daulton, Balandat & Bakshy,
/// NeurIPS 2021 (cached box decompositions, sequential greedy choice); Ament et al., NeurIPS 2023 (logarithms and
/// smoothing).
struct QLogNehvi {
  int draws = 128;
  bool noisy = true;       ///< false: observed values stand as they are (qLogEHVI)
  double tau_relu = 1e-6;  ///< smoothing of max(·, 0), in the units of the objectives
  double tau_max = 1e-3;   ///< smoothing of minima of logarithms

  /// Standard normal numbers that replace random ones.
  struct BaseSamples {
    std::vector<Eigen::MatrixXd> base;       ///< per output: base points × draws
    std::vector<Eigen::VectorXd> candidate;  ///< per output: draws
  };

  template <CovarianceKernel Kernel, Reduction R> class Prepared {
   public:
    Prepared(const QLogNehvi& config, const std::vector<GaussianProcess<Kernel>>& models, const R& reduction,
        const Evidence& evidence, const BaseSamples& samples)
        : tau_relu_(config.tau_relu), tau_max_(config.tau_max), reduction_(reduction), candidate_(samples.candidate) {
      const Eigen::MatrixXd base = base_points(evidence, config.noisy);
      std::vector<Eigen::MatrixXd> drawn;
      for (std::size_t j = 0; j < models.size(); ++j) {
        posteriors_.emplace_back(models[j], base, samples.base[j]);
        drawn.push_back(posteriors_.back().draws());
      }
      for (Eigen::Index s = 0; s < candidate_.front().size(); ++s)
        boxes_.push_back(nondominated_boxes(
            standing_objectives(drawn, std::min(s, drawn.front().cols() - 1), reduction, evidence, config.noisy),
            evidence.reference));
    }

    Eigen::VectorXd operator()(const Eigen::MatrixXd& x) const {
      const Eigen::Index outputs = Eigen::Index(posteriors_.size()), count = candidate_.front().size();
      std::vector<typename ConditionalPosterior<Kernel>::Conditional> at;
      for (const auto& p : posteriors_) at.push_back(p.at(x));
      Eigen::VectorXd out(x.cols());
      Eigen::MatrixXd sample(outputs, count);
      std::vector<double> per_draw(static_cast<std::size_t>(count)), per_box;
      for (Eigen::Index i = 0; i < x.cols(); ++i) {
        for (Eigen::Index j = 0; j < outputs; ++j) {
          const auto& a = at[std::size_t(j)];
          for (Eigen::Index s = 0; s < count; ++s)
            sample(j, s) = a.mean(i, std::min(s, a.mean.cols() - 1)) + a.deviation[i] * candidate_[std::size_t(j)][s];
        }
        const Eigen::MatrixXd y = reduction_.objectives(sample);
        for (Eigen::Index s = 0; s < count; ++s) {
          const BoxDecomposition& boxes = boxes_[std::size_t(s)];
          per_box.assign(std::size_t(boxes.lower.cols()), 0.0);
          for (Eigen::Index k = 0; k < boxes.lower.cols(); ++k)
            for (Eigen::Index j = 0; j < y.rows(); ++j) {
              const double side = std::log(boxes.upper(j, k) - boxes.lower(j, k));  // ∞ where the box is open
              per_box[std::size_t(k)] +=
                  detail::fat_minimum(detail::log_fat_relu(y(j, s) - boxes.lower(j, k), tau_relu_), side, tau_max_);
            }
          per_draw[std::size_t(s)] = log_sum_exp(per_box.begin(), per_box.end());
        }
        out[i] = log_sum_exp(per_draw.begin(), per_draw.end()) - std::log(double(count));
      }
      return out;
    }

   private:
    double tau_relu_, tau_max_;
    R reduction_;
    std::vector<Eigen::VectorXd> candidate_;
    std::vector<ConditionalPosterior<Kernel>> posteriors_;
    std::vector<BoxDecomposition> boxes_;
  };

  /// Models are referred to, not copied: they must outlive the result.
  template <CovarianceKernel Kernel, Reduction R>
  Prepared<Kernel, R> prepare(const std::vector<GaussianProcess<Kernel>>& models, const R& reduction,
      const Evidence& evidence, std::uint64_t seed) const {
    const Eigen::Index base = base_points(evidence, noisy).cols();
    BaseSamples samples;
    for (std::size_t j = 0; j < models.size(); ++j) {
      const Eigen::MatrixXd z = base_normals(base + 1, draws, combine(seed, j));
      samples.base.push_back(z.topRows(base));
      samples.candidate.push_back(z.row(base).transpose());
    }
    return Prepared<Kernel, R>(*this, models, reduction, evidence, samples);
  }
};

}  // namespace lumo
