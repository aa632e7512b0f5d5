#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/sobol.hpp"
#include "lumo/core/units.hpp"
#include "lumo/model/normal.hpp"
#include "lumo/optimize/hypervolume.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

/// Hypervolume of many objectives, where exact boxes are too many. In polar coordinates about the reference point r it
/// is V = c E[ρ(λ)^m] over directions λ of the positive part of the unit sphere, where ρ(λ) = max over the points y of
/// min over j of (y_j − r_j)/λ_j, and c = π^(m/2) / (2^m Γ(m/2 + 1)). Source: Golovin & Zhang, "Random Hypervolume
/// Scalarizations for Provable Multi-Objective Black Box Optimization", ICML 2020.
namespace lumo {

/// `count` unit vectors (objectives × count) with positive entries, spread evenly: normal numbers of a scrambled Sobol
/// sequence. Throws InvalidArgument for more than 32 objectives.
inline Eigen::MatrixXd hypervolume_directions(Eigen::Index objectives, Eigen::Index count, std::uint64_t seed) {
  require_in_range("number of objectives", double(objectives), 1.0, double(Sobol::dimensions), "");
  const OwenSobol sequence{seed};
  Eigen::MatrixXd directions(objectives, count);
  for (Eigen::Index k = 0; k < count; ++k) {
    for (Eigen::Index j = 0; j < objectives; ++j)
      directions(j, k) = normal_quantile(0.5 + 0.5 * sequence(std::uint32_t(k), int(j)));
    directions.col(k) = directions.col(k).cwiseMax(1e-9).normalized();
  }
  return directions;
}

/// c of the volume above.
inline double hypervolume_of_unit_reach(Eigen::Index objectives) {
  const double m = double(objectives);
  return std::exp(0.5 * m * std::log(pi) - m * std::log(2.0) - std::lgamma(0.5 * m + 1.0));
}

/// ρ of a direction: how far from `reference` the columns of `y` (objectives × points, maximised) dominate along it.
template <class Direction>
double dominated_reach(const Eigen::MatrixXd& y, const Eigen::VectorXd& reference, const Direction& direction) {
  double reach = 0.0;
  for (Eigen::Index i = 0; i < y.cols(); ++i)
    reach = std::max(reach, ((y.col(i) - reference).array() / direction.array()).minCoeff());
  return reach;
}

/// A hypervolume with its standard error.
struct HypervolumeEstimate {
  double value = 0.0, error = 0.0;
};

/// Estimate by 16 scrambled sets of directions. Throws InvalidArgument as hypervolume() and hypervolume_directions().
inline HypervolumeEstimate estimated_hypervolume(
    const Eigen::MatrixXd& y, const Eigen::VectorXd& reference, Eigen::Index directions_of_set = 512) {
  detail::require_finite_objectives(y);
  detail::require_finite_objectives(reference);
  constexpr int sets = 16;
  const double unit = hypervolume_of_unit_reach(reference.size());
  std::array<double, sets> volumes{};
  for (int s = 0; s < sets; ++s) {
    const Eigen::MatrixXd directions = hypervolume_directions(reference.size(), directions_of_set, combine(11, s));
    for (Eigen::Index k = 0; k < directions.cols(); ++k)
      volumes[std::size_t(s)] += unit / double(directions.cols()) *
                                 std::pow(dominated_reach(y, reference, directions.col(k)), double(reference.size()));
  }
  HypervolumeEstimate estimate;
  for (const double v : volumes) estimate.value += v / sets;
  for (const double v : volumes) estimate.error += (v - estimate.value) * (v - estimate.value);
  estimate.error = std::sqrt(estimate.error / (sets * (sets - 1)));
  return estimate;
}

/// Expected hypervolume improvement of a point whose objectives are independent and normal, as a mean over directions:
/// along each, P(ρ > t) is a product of normal probabilities, and m ∫ t^(m−1) P(ρ > t) dt beyond the reach of the front
/// is done by Gauss–Legendre's rule. The cost grows with directions and objectives, not with the front.
class DirectedHypervolume {
 public:
  /// `y`: objectives × points, maximised. Throws InvalidArgument for objectives that are not finite.
  DirectedHypervolume(const Eigen::MatrixXd& y, const Eigen::VectorXd& reference, Eigen::MatrixXd directions)
      : reference_(reference), directions_(std::move(directions)), reach_(directions_.cols()) {
    detail::require_finite_objectives(y);
    for (Eigen::Index k = 0; k < reach_.size(); ++k) reach_[k] = dominated_reach(y, reference, directions_.col(k));
    unit_ = hypervolume_of_unit_reach(reference.size()) / double(directions_.cols());
  }

  template <class Mean, class Deviation> double value(const Mean& mean, const Deviation& deviation) const {
    return std::exp(log_value(mean, deviation));
  }
  /// log of the expected improvement, finite for all `mean` and positive `deviation` within 1e100.
  template <class Mean, class Deviation> double log_value(const Mean& mean, const Deviation& deviation) const {
    std::vector<double> logs(static_cast<std::size_t>(reach_.size()));
    for (Eigen::Index k = 0; k < reach_.size(); ++k) logs[std::size_t(k)] = log_along(k, mean, deviation);
    return std::log(unit_) + log_sum_exp(logs.begin(), logs.end());
  }

 private:
  static constexpr double sure = 7.0;    ///< deviations beyond which a normal number hardly ever lies
  static constexpr double falls = 25.0;  ///< logarithms by which the integrand falls until it is left out
  static constexpr std::array<double, 6> half_nodes{0.0092196828766403782, 0.047941371814762601, 0.11504866290284765,
      0.20634102285669126, 0.31608425050090994, 0.43738329574426554};
  static constexpr std::array<double, 6> half_weights{0.023587668193255917, 0.053469662997659088, 0.080039164271673166,
      0.10158371336153292, 0.11674626826917739, 0.12457352290670144};

  // log of m ∫ t^(m−1) P(ρ > t) dt from the front's reach on, in one direction.
  template <class Mean, class Deviation>
  double log_along(Eigen::Index k, const Mean& mean, const Deviation& deviation) const {
    const Eigen::Index m = reference_.size();
    const auto direction = directions_.col(k);
    double certain = std::numeric_limits<double>::infinity(), possible = certain;
    for (Eigen::Index j = 0; j < m; ++j) {
      const double above = mean[j] - reference_[j];
      certain = std::min(certain, (above - sure * deviation[j]) / direction[j]);
      possible = std::min(possible, (above + sure * deviation[j]) / direction[j]);
    }
    const double from = std::max(reach_[k], certain);
    std::array<double, 13> terms;
    terms[12] = from > reach_[k] ? log_difference(double(m) * std::log(from), log_power(reach_[k], double(m)))
                                 : -std::numeric_limits<double>::infinity();
    // Beyond `possible` the integrand falls at least as fast as at the front's reach: it is log-concave.
    double slope = 0.0;
    for (Eigen::Index j = 0; j < m; ++j) {
      const double z = (mean[j] - reference_[j] - from * direction[j]) / deviation[j];
      slope += std::max(0.0, -z) * direction[j] / deviation[j];
    }
    const double length = possible > from
                              ? std::min(possible - from,
                                    slope > 0.0 ? std::max(falls / slope, 0.2 * (possible - from)) : possible - from)
                              : falls / slope;
    for (std::size_t q = 0; q < 12; ++q) {
      const std::size_t h = std::min(q, 11 - q);
      const double t = from + length * (q < 6 ? half_nodes[h] : 1.0 - half_nodes[h]);
      double log = std::log(half_weights[h] * length * double(m)) + log_power(t, double(m) - 1.0);
      for (Eigen::Index j = 0; j < m; ++j)
        log += log_normal_probability((mean[j] - reference_[j] - t * direction[j]) / deviation[j]);
      terms[q] = log;
    }
    return log_sum_exp(terms.begin(), terms.end());
  }
  static double log_power(double t, double exponent) {
    return exponent == 0.0 ? 0.0 : t > 0.0 ? exponent * std::log(t) : -std::numeric_limits<double>::infinity();
  }

  Eigen::VectorXd reference_;
  Eigen::MatrixXd directions_;
  Eigen::VectorXd reach_;  ///< of the front, in each direction
  double unit_ = 1.0;      ///< volume of unit reach in all directions, for each of them
};

}  // namespace lumo
