#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/model/normal.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

namespace lumo {

/// Does `a` dominate `b`: at least as good everywhere, better somewhere? All objectives are maximised.
template <class A, class B> bool dominates(const Eigen::DenseBase<A>& a, const Eigen::DenseBase<B>& b) {
  return (a.derived().array() >= b.derived().array()).all() && (a.derived().array() > b.derived().array()).any();
}

namespace detail {

inline void require_finite_objectives(const Eigen::MatrixXd& y) {
  if (!y.allFinite()) throw InvalidArgument("objectives must be finite numbers");
}

}  // namespace detail

/// Columns of `y` (objectives × points, maximised) that no other dominates, by falling first objective, equal ones by
/// index. Throws InvalidArgument, like all here, for objectives that are not finite.
inline std::vector<Eigen::Index> pareto_front(const Eigen::MatrixXd& y) {
  detail::require_finite_objectives(y);
  std::vector<Eigen::Index> order(std::size_t(y.cols()));
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](Eigen::Index i, Eigen::Index k) {
    for (Eigen::Index j = 0; j < y.rows(); ++j)
      if (y(j, i) != y(j, k)) return y(j, i) > y(j, k);
    return false;
  });
  // No point dominates one before it in this order.
  std::vector<Eigen::Index> front;
  for (const Eigen::Index i : order) {
    const bool beaten = y.rows() == 2 ? !front.empty() && dominates(y.col(front.back()), y.col(i))
                                      : std::any_of(front.begin(), front.end(),
                                            [&](Eigen::Index k) { return dominates(y.col(k), y.col(i)); });
    if (!beaten) front.push_back(i);
  }
  return front;
}

/// Boxes that overlap at their faces only: objectives × boxes; upper corners may be infinite.
struct BoxDecomposition {
  Eigen::MatrixXd lower, upper;
};

namespace detail {

/// Slices the space above `reference` that no point dominates into boxes.
struct BoxSlicer {
  const Eigen::VectorXd& reference;
  Eigen::VectorXd low, high;  ///< of the slice at hand
  std::vector<Eigen::VectorXd> lower, upper;

  explicit BoxSlicer(const Eigen::VectorXd& r) : reference(r), low(r.size()), high(r.size()) {}

  /// Slices the space that no column of `y` dominates along objective `along`, and each slice along those after it.
  void slice(const Eigen::MatrixXd& y, Eigen::Index along) {
    const double infinite = std::numeric_limits<double>::infinity();
    if (along + 1 == reference.size()) {
      low[along] = y.cols() ? std::max(reference[along], y.row(along).maxCoeff()) : reference[along];
      high[along] = infinite;
      lower.push_back(low);
      upper.push_back(high);
      return;
    }
    std::vector<double> levels = {reference[along]};
    for (Eigen::Index i = 0; i < y.cols(); ++i) levels.push_back(y(along, i));
    std::sort(levels.begin(), levels.end());
    levels.erase(std::unique(levels.begin(), levels.end()), levels.end());
    for (std::size_t k = 0; k < levels.size(); ++k) {
      const double top = k + 1 < levels.size() ? levels[k + 1] : infinite;
      std::vector<Eigen::Index> reach;  // those that dominate inside the slice
      for (Eigen::Index i = 0; i < y.cols(); ++i)
        if (y(along, i) >= top) reach.push_back(i);
      low[along] = levels[k];
      high[along] = top;
      slice(y(Eigen::all, reach), along + 1);
    }
  }
};

}  // namespace detail

/// Decomposes the space above `reference` that no column of `y` (objectives × points, maximised) dominates. Exact for
/// any number of objectives: one more box than the front has points for two, more than proportional for three and
/// above.
inline BoxDecomposition nondominated_boxes(const Eigen::MatrixXd& y, const Eigen::VectorXd& reference) {
  if (reference.size() < 1 || (y.cols() > 0 && y.rows() != reference.size()))
    throw InvalidArgument(message("points have ", y.rows(), " objectives, the reference point has ", reference.size()));
  detail::require_finite_objectives(y);
  detail::require_finite_objectives(reference);
  std::vector<Eigen::Index> above;
  for (Eigen::Index i = 0; i < y.cols(); ++i)
    if ((y.col(i).array() > reference.array()).all()) above.push_back(i);
  Eigen::MatrixXd front = y.cols() ? Eigen::MatrixXd(y(Eigen::all, above)) : Eigen::MatrixXd(reference.size(), 0);
  front = Eigen::MatrixXd(front(Eigen::all, pareto_front(front)));
  detail::BoxSlicer slicer(reference);
  slicer.slice(front, 0);
  const auto count = Eigen::Index(slicer.lower.size());
  BoxDecomposition boxes{Eigen::MatrixXd(reference.size(), count), Eigen::MatrixXd(reference.size(), count)};
  for (Eigen::Index k = 0; k < count; ++k) {
    boxes.lower.col(k) = slicer.lower[std::size_t(k)];
    boxes.upper.col(k) = slicer.upper[std::size_t(k)];
  }
  return boxes;
}

/// Volume above `reference` that the columns of `y` (objectives × points, maximised) dominate; points not above
/// it add nothing. Exact for any number of objectives, by slicing along the last. Source: Zitzler, 2001; While,
/// Hingston, Barone & Huband, 2006.
inline double hypervolume(const Eigen::MatrixXd& y, const Eigen::VectorXd& reference) {
  const Eigen::Index m = reference.size();
  if (m < 1 || (y.cols() > 0 && y.rows() != m))
    throw InvalidArgument(message("points have ", y.rows(), " objectives, the reference point has ", m));
  detail::require_finite_objectives(y);
  detail::require_finite_objectives(reference);
  std::vector<Eigen::Index> order;
  for (Eigen::Index i = 0; i < y.cols(); ++i)
    if ((y.col(i).array() > reference.array()).all()) order.push_back(i);
  if (order.empty()) return 0.0;
  if (m == 1) {
    double best = reference[0];
    for (const Eigen::Index i : order) best = std::max(best, y(0, i));
    return best - reference[0];
  }
  std::stable_sort(
      order.begin(), order.end(), [&](Eigen::Index i, Eigen::Index k) { return y(m - 1, i) > y(m - 1, k); });
  double volume = 0.0, widest = reference[0];
  for (std::size_t k = 0; k < order.size(); ++k) {
    const double bottom = k + 1 < order.size() ? y(m - 1, order[k + 1]) : reference[m - 1];
    const double height = y(m - 1, order[k]) - bottom;
    if (m == 2) {  // the slice's section is one interval
      widest = std::max(widest, y(0, order[k]));
      volume += height * (widest - reference[0]);
    } else if (height > 0.0) {
      const std::vector<Eigen::Index> reach(order.begin(), order.begin() + std::ptrdiff_t(k) + 1);
      volume += height * hypervolume(Eigen::MatrixXd(y(Eigen::all, reach).topRows(m - 1)), reference.head(m - 1));
    }
  }
  return volume;
}

/// Expected hypervolume improvement of a point whose objectives are independent and normal, in closed form: over each
/// box of the decomposition the expectation is a product of one-dimensional integrals, and all terms are positive.
/// Exact for any number of objectives. Source: Emmerich, Deutz & Klinkenberg, CEC 2011; Yang, Emmerich, Deutz & Bäck,
/// J. Glob. Optim. 75 (2019), for the slices of two objectives.
class ExpectedHypervolume {
 public:
  /// `y`: objectives × points, maximised; only those above `reference` that no other dominates matter.
  ExpectedHypervolume(const Eigen::MatrixXd& y, const Eigen::VectorXd& reference)
      : boxes_(nondominated_boxes(y, reference)) {}

  /// log of the expected improvement, finite for all `mean` and positive `deviation` within 1e153; others throw
  /// InvalidArgument.
  template <class Mean, class Deviation> double log_value(const Mean& mean, const Deviation& deviation) const {
    const double sum = value(mean, deviation);
    if (sum > 1e-280 && std::isfinite(sum)) return std::log(sum);
    return log_sum(mean, deviation);
  }

  /// The expected improvement itself; underflows to 0 far from the front. Two objectives only take one pass over the
  /// front.
  template <class Mean, class Deviation> double value(const Mean& mean, const Deviation& deviation) const {
    const Eigen::Index m = boxes_.lower.rows(), count = boxes_.lower.cols();
    for (Eigen::Index j = 0; j < m; ++j) {
      require_in_range("mean of an objective", mean[j], -largest, largest, "");
      require_positive("deviation of an objective", deviation[j], "");
    }
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
  static constexpr double largest = 1e153;  ///< squares do not overflow

  /// log ∫ P(Y > t) dt over [low, high] for Y normal.
  static double log_side(double mean, double deviation, double low, double high) {
    const double a = (mean - low) / deviation;
    if (!std::isfinite(high)) return std::log(deviation) + log_expected_excess(a);
    const double b = (mean - high) / deviation;
    if ((a - b) * std::max(1.0, std::abs(a)) < 1e-5)  // too thin for a difference
      return std::log(high - low) + log_normal_probability(0.5 * (a + b));
    return std::log(deviation) + log_difference(log_expected_excess(a), log_expected_excess(b));
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
