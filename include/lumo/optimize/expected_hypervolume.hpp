#pragma once

#include "lumo/core/types.hpp"
#include "lumo/model/normal.hpp"
#include "lumo/optimize/hypervolume.hpp"

#include <Eigen/Core>

#include <cmath>
#include <limits>
#include <vector>

namespace lumo {

/// Expected hypervolume improvement of a point whose objectives are independent and normal, in closed form: over each
/// box of the decomposition the expectation is a product of one-dimensional integrals, and all terms are positive.
/// Exact for any number of objectives. Source: Emmerich, Deutz & Klinkenberg, CEC 2011; Yang, Emmerich, Deutz & Bäck,
/// J. Glob. Optim. 75 (2019), for the slices of two objectives.
class ExpectedHypervolume {
 public:
  /// `y`: objectives × points, maximised; only those above `reference` that no other dominates matter.
  ExpectedHypervolume(const Eigen::MatrixXd& y, const Eigen::VectorXd& reference)
      : boxes_(nondominated_boxes(y, reference)) {}

  /// log of the expected improvement, finite for all finite `mean` and positive `deviation`.
  template <class Mean, class Deviation> double log_value(const Mean& mean, const Deviation& deviation) const {
    const double sum = value(mean, deviation);
    if (sum > 1e-280 && std::isfinite(sum)) return std::log(sum);
    return log_sum(mean, deviation);
  }

  /// The expected improvement itself; underflows to 0 far from the front. Two objectives only take one pass over the
  /// front.
  template <class Mean, class Deviation> double value(const Mean& mean, const Deviation& deviation) const {
    const Eigen::Index m = boxes_.lower.rows(), count = boxes_.lower.cols();
    if (m != 2) return std::exp(log_sum(mean, deviation));
    double sum = 0.0, above = 0.0, side = std::numeric_limits<double>::quiet_NaN(), excess = 0.0;
    for (Eigen::Index k = count; k-- > 0;) {  // from the topmost slice, which has no upper end, downwards
      if (boxes_.lower(1, k) != side) {
        side = boxes_.lower(1, k);
        excess = expected_excess((mean[1] - side) / deviation[1]);
      }
      const double from = expected_excess((mean[0] - boxes_.lower(0, k)) / deviation[0]);
      sum += excess * (from - above);
      above = from;
    }
    return sum * deviation[0] * deviation[1];
  }

  const BoxDecomposition& boxes() const { return boxes_; }

 private:
  /// log ∫ P(Y > t) dt over [low, high] for Y normal.
  static double log_side(double mean, double deviation, double low, double high) {
    const double a = (mean - low) / deviation;
    if (!std::isfinite(high)) return std::log(deviation) + log_expected_excess(a);
    const double b = (mean - high) / deviation;
    if ((a - b) * std::max(1.0, std::abs(a)) < 1e-5)  // too thin for a difference
      return std::log(high - low) + log_probability(0.5 * (a + b));
    return std::log(deviation) + log_difference(log_expected_excess(a), log_expected_excess(b));
  }
  static double log_probability(double z) {
    if (z > -30.0) return std::log(normal_probability(z));
    return -0.5 * z * z - 0.5 * std::log(2.0 * pi) - std::log(-z) + std::log1p(-1.0 / (z * z) + 3.0 / (z * z * z * z));
  }
  /// Sum over the boxes in logarithms. E[(Z + a)⁺] ≤ e^(−a²/2) for a ≤ 0 and ≤ a + 1 above: boxes that this bound
  /// leaves below e⁻⁴⁰ of the most promising one are passed over.
  template <class Mean, class Deviation> double log_sum(const Mean& mean, const Deviation& deviation) const {
    const Eigen::Index count = boxes_.lower.cols(), m = boxes_.lower.rows();
    if (count == 0) return -std::numeric_limits<double>::infinity();
    double scale = 0.0;
    for (Eigen::Index j = 0; j < m; ++j) scale += std::log(deviation[j]);
    Eigen::ArrayXd bound = Eigen::ArrayXd::Constant(count, scale);
    for (Eigen::Index k = 0; k < count; ++k)
      for (Eigen::Index j = 0; j < m; ++j) {
        const double a = (mean[j] - boxes_.lower(j, k)) / deviation[j];
        bound[k] += a > 0.0 ? std::log(a + 1.0) : -0.5 * a * a;
      }
    const auto term = [&](Eigen::Index k) {
      double log = 0.0;
      for (Eigen::Index j = 0; j < m; ++j)
        log += log_side(mean[j], deviation[j], boxes_.lower(j, k), boxes_.upper(j, k));
      return log;
    };
    Eigen::Index first = 0;
    bound.maxCoeff(&first);
    const double floor = term(first) - 40.0;
    std::vector<double> terms;
    for (Eigen::Index k = 0; k < count; ++k)
      if (bound[k] >= floor) terms.push_back(term(k));
    return log_sum_exp(terms.begin(), terms.end());
  }

  BoxDecomposition boxes_;
};

}  // namespace lumo
