#pragma once

#include "lumo/core/statistics.hpp"
#include "lumo/core/types.hpp"

#include <cmath>
#include <optional>
#include <vector>

namespace lumo::sense {

/// Slope of each channel's response over force [unit/N], by least squares with an intercept: a profile that is the same
/// at all loads, such as the unloaded one, drops out, subtracted or not. `response`: channels × loads. Throws
/// InvalidArgument for fewer than two different loads or numbers that are not finite.
inline Eigen::VectorXd intensity_force_slope(const Eigen::MatrixXd& response, const Eigen::VectorXd& force_N) {
  if (force_N.size() < 2 || response.cols() != force_N.size())
    throw InvalidArgument(message("slope over force: ", response.cols(), " responses and ", force_N.size(),
        " loads, must be as many, at least 2"));
  if (!response.allFinite() || !force_N.allFinite()) throw InvalidArgument("slope over force: numbers must be finite");
  const Eigen::VectorXd centred = force_N.array() - force_N.mean();
  const double spread = centred.squaredNorm();
  if (!(spread > 1e-12 * force_N.squaredNorm())) throw InvalidArgument("slope over force: all loads are the same");
  return response * centred / spread;
}

/// How far neighbouring places differ, against how well re-contacts repeat, by slopes (intensity_force_slope). Source:
/// paper, Eq. 9; that no unloaded profile enters, its authors' public code (dokkev/fingertip-design-framework).
struct RecontactMetrics {
  double D_neighbor = 0.0;  ///< median over neighbours of the RMS difference of their median profiles [unit/N]
  /// Median over places and re-contacts of the RMS deviation from the median profile [unit/N]
  double W_recontact = 0.0;
  std::optional<double> Q;  ///< D/W; empty where W is 0
};

/// Q with what happens to it when one re-contact is left out (the paper's whiskers), and a bootstrap interval.
struct RecontactQuality {
  RecontactMetrics metrics;
  double Q_low = 0.0, Q_high = 0.0;  ///< least and greatest with one re-contact left out everywhere, and of all
  /// Interval of the Q that infinitely many re-contacts at these places would give. Few re-contacts make Q too large,
  /// for their median lies among them; the interval makes up for that and so need not hold the sample's own Q.
  double bootstrap_low = 0.0, bootstrap_high = 0.0;
};

/// `slope[i]`: profiles of slopes at place i along the finger, channels × re-contacts. Throws InvalidArgument for fewer
/// than two places, no re-contacts, or shapes that differ.
inline RecontactMetrics recontact_metrics(const std::vector<Eigen::MatrixXd>& slope) {
  if (slope.size() < 2)
    throw InvalidArgument(message("re-contact metrics have ", slope.size(), " places, must have at least 2"));
  std::vector<Eigen::VectorXd> middle;
  std::vector<double> between, within;
  for (const Eigen::MatrixXd& p : slope) {
    if (p.cols() < 1 || p.rows() != slope.front().rows() || p.rows() < 1)
      throw InvalidArgument(message("re-contact metrics: place ", middle.size(), " has ", p.rows(), " channels × ",
          p.cols(), " re-contacts, the first ", slope.front().rows(), " channels"));
    if (!p.allFinite())
      throw InvalidArgument(message("re-contact metrics: slopes at place ", middle.size(), " must be finite"));
    middle.push_back(pointwise_median(p));
    for (Eigen::Index r = 0; r < p.cols(); ++r) within.push_back(rms(p.col(r) - middle.back()));
  }
  for (std::size_t i = 1; i < middle.size(); ++i) between.push_back(rms(middle[i] - middle[i - 1]));
  RecontactMetrics m{median(between), median(within), {}};
  if (m.W_recontact > 0.0) m.Q = m.D_neighbor / m.W_recontact;
  return m;
}

/// At least three re-contacts at each place, as many everywhere (of two, the whiskers' one would be its own median).
/// The interval is a parametric bootstrap of log Q: re-contacts are drawn about each place's median from a Gaussian
/// with the covariance that the place's own re-contacts have (channels scatter together where a contact shifts), and
/// the errors of log Q against that known model are taken off. Re-contacts are not drawn anew: so few of
/// them would repeat, and W would be too small. `confidence` of the interval. Source: Efron & Tibshirani
/// 1993, §6.5 and §13. Throws InvalidArgument where Q is not defined.
inline RecontactQuality recontact_quality(
    const std::vector<Eigen::MatrixXd>& slope, int resamples = 2000, std::uint64_t seed = 1, double confidence = 0.95) {
  require_in_range("bootstrap resamples", resamples, 20, 1e6, "");
  require_in_range("confidence", confidence, 0.0, 1.0, "");
  RecontactQuality q;
  q.metrics = recontact_metrics(slope);
  const Eigen::Index repeats = slope.front().cols();
  for (const Eigen::MatrixXd& p : slope)
    if (p.cols() != repeats || repeats < 3)
      throw InvalidArgument(message(
          "re-contact quality needs as many re-contacts everywhere, at least 3; has ", p.cols(), " and ", repeats));
  if (!q.metrics.Q) throw InvalidArgument("re-contact quality is not defined: all re-contacts are the same");
  if (!(*q.metrics.Q > 0.0)) throw InvalidArgument("re-contact quality is not defined: all places are the same");
  q.Q_low = q.Q_high = *q.metrics.Q;
  std::vector<Eigen::MatrixXd> some(slope.size());
  for (Eigen::Index left_out = 0; left_out < repeats; ++left_out) {
    for (std::size_t i = 0; i < slope.size(); ++i) {
      some[i].resize(slope[i].rows(), repeats - 1);
      some[i] << slope[i].leftCols(left_out), slope[i].rightCols(repeats - 1 - left_out);
    }
    if (const auto without = recontact_metrics(some).Q) {
      q.Q_low = std::min(q.Q_low, *without);
      q.Q_high = std::max(q.Q_high, *without);
    }
  }
  std::vector<Eigen::VectorXd> middle;
  std::vector<Eigen::MatrixXd> scatter;  // times a vector of normal numbers: a deviation of that place
  for (const Eigen::MatrixXd& p : slope) {
    middle.push_back(pointwise_median(p));
    scatter.push_back((p.colwise() - p.rowwise().mean()) / std::sqrt(double(repeats) - 1.0));
  }
  CountedNormals normal(seed);
  Eigen::VectorXd numbers(repeats);
  const auto deviation = [&](std::size_t place) {
    for (double& z : numbers) z = normal();
    return Eigen::VectorXd(scatter[place] * numbers);
  };
  std::vector<double> sizes, error;
  for (int k = 0; k < resamples; ++k)
    for (std::size_t i = 0; i < slope.size(); ++i) sizes.push_back(rms(deviation(i)));
  const double W = median(sizes);  // of the model
  some = slope;
  for (int k = 0; k < resamples && W > 0.0; ++k) {
    for (std::size_t i = 0; i < slope.size(); ++i)
      for (Eigen::Index r = 0; r < repeats; ++r) some[i].col(r) = middle[i] + deviation(i);
    if (const auto drawn = recontact_metrics(some).Q; drawn && *drawn > 0.0)
      error.push_back(std::log(*drawn * W / q.metrics.D_neighbor));
  }
  if (error.empty())
    throw InvalidArgument("re-contact quality has no interval: at most places all re-contacts are the same");
  // The scatter itself is known from so many re-contacts only: wider by √(n/(n − 1)) about the middle.
  const double centre = median(error), wider = std::sqrt(double(repeats) / (double(repeats) - 1.0));
  const auto limit = [&](double p) { return *q.metrics.Q * std::exp(-centre - wider * (quantile(error, p) - centre)); };
  q.bootstrap_low = limit(0.5 * (1.0 + confidence));
  q.bootstrap_high = limit(0.5 * (1.0 - confidence));
  return q;
}

/// Regional RMS change: of each channel, over re-contacts, from a low load to a high one (paper: 2 to 15 N). Both
/// channels × re-contacts.
inline Eigen::VectorXd regional_rms_change(const Eigen::MatrixXd& low, const Eigen::MatrixXd& high) {
  if (low.rows() != high.rows() || low.cols() != high.cols() || low.cols() < 1)
    throw InvalidArgument(message("regional change: ", low.rows(), " × ", low.cols(), " and ", high.rows(), " × ",
        high.cols(), " responses, must be the same, at least one re-contact"));
  if (!low.allFinite() || !high.allFinite()) throw InvalidArgument("regional change: responses must be finite");
  return ((high - low).rowwise().squaredNorm() / double(low.cols())).cwiseSqrt();
}

/// 100 (1 − W/W_base) [%]: by how much a variation is smaller than the baseline's.
inline double reduction_percent(double value, double baseline) {
  constexpr double most = 1e150;  // their ratio does not overflow
  require_in_range("baseline's value", baseline, 1.0 / most, most, "");
  require_in_range("value", value, -most, most, "");
  return 100.0 * (1.0 - value / baseline);
}
/// 100 (D/D_base − 1) [%].
inline double gain_percent(double value, double baseline) { return -reduction_percent(value, baseline); }

}  // namespace lumo::sense
