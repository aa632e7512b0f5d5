#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/location_estimator.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace lumo {

/// Filter over the number of contacts (none, one, two) and, for one, over its place on a grid. A contact is taken as a bright bump of unknown height
/// and one of a few widths on top of what is not contact: noise, and slow changes of the lamps and of ambient light, which are integrated out.
/// No labels, no training. How far a real bump is from the assumed shape is said by `shape_error` and `bias_sigma_m`.
class BayesLocalizer {
 public:
  struct Config {
    Eigen::VectorXd position_m;   ///< of the profile's values
    Eigen::VectorXd noise;        ///< standard deviation of each, unloaded
    Eigen::VectorXd unloaded;     ///< mean profile of the unloaded finger; empty: lamps are steady
    double lamp_sigma = 0.01;     ///< relative change of all lamps together; assumed
    double ambient_sigma = 0.3;   ///< change of ambient light, in the profile's unit; assumed
    double from_m = -30.0_mm, to_m = 30.0_mm, spacing_m = 0.5_mm;  ///< grid
    std::array<double, 3> width_m{3.0_mm, 5.0_mm, 8.0_mm};         ///< standard deviations of bumps
    double amplitude_sigma = 50.0;  ///< prior of a bump's height, half normal, in the profile's unit
    double shape_error = 0.05;      ///< of the assumed bump, relative to the response; counts as noise
    double bias_sigma_m = 0.5_mm;   ///< how far the bump's middle is believed to lie from the contact; assumed
    double min_separation_m = 12.0_mm;  ///< of two contacts
    double change_rate_per_s = 2.0;     ///< how often contacts come and go
    double creep_m_per_sqrt_s = 1.0_mm;  ///< random walk of a contact that stays
    double gap_s = 0.5;                  ///< longer without a profile: forget
  };

  /// Throws InvalidArgument for lengths that differ or numbers that make no sense.
  explicit BayesLocalizer(Config config);

  void reset() { fresh_ = true; }
  LocationEstimate update(const Profile& response);

  const Eigen::VectorXd& grid_m() const { return grid_; }
  /// Posterior of the place given one contact; sums to 1.
  const Eigen::VectorXd& place() const { return place_; }
  /// Posterior of none, one, two contacts.
  const Eigen::Vector3d& number() const { return number_; }

 private:
  struct Pair {
    Eigen::Index first = 0, second = 0;
    double log_evidence = -1e300;
  };

  double log_evidence(double s, double g, double tempering) const;
  Pair best_pair(double tempering) const;
  void predict(double step_s);
  ContactLocation one() const;
  LocationEstimate answer(std::int64_t stamp_ns) const;

  Config config_;
  Eigen::VectorXd grid_;
  Eigen::MatrixXd bumps_;      ///< profile × (grid · widths): the width varies slowest
  Eigen::MatrixXd matched_;    ///< Σ⁻¹ bumps
  Eigen::MatrixXd precision_;  ///< Σ⁻¹ of the profile
  Eigen::MatrixXd gram_;       ///< bumpsᵀ Σ⁻¹ bumps of the middle width
  Eigen::VectorXd energy_;     ///< diagonal of it, all widths
  Eigen::VectorXd score_, place_, likelihood_, spread_;
  Eigen::Vector3d number_{1.0, 0.0, 0.0};
  Pair pair_;
  std::int64_t stamp_ns_ = 0;
  bool fresh_ = true;
};

inline BayesLocalizer::BayesLocalizer(Config config) : config_(std::move(config)) {
  const Eigen::Index n = config_.position_m.size();
  if (n < 3 || config_.noise.size() != n || (config_.unloaded.size() != 0 && config_.unloaded.size() != n))
    throw InvalidArgument(detail::text("localiser has ", n, " positions, ", config_.noise.size(), " noises and ", config_.unloaded.size(), " unloaded values, must have as many, at least 3"));
  for (Eigen::Index i = 0; i < n; ++i) require_positive("noise of a profile's value", config_.noise[i], "");
  require_positive("grid spacing", config_.spacing_m, "m");
  require_in_range("grid's end", config_.to_m, config_.from_m + 2.0 * config_.spacing_m, config_.from_m + 4096.0 * config_.spacing_m, "m");
  for (const double w : config_.width_m) require_positive("width of a bump", w, "m");
  require_positive("height of a bump", config_.amplitude_sigma, "");
  require_in_range("shape error", config_.shape_error, 0.0, 1.0, "");
  require_positive("rate of change of contacts", config_.change_rate_per_s, "1/s");

  const auto cells = Eigen::Index(std::floor((config_.to_m - config_.from_m) / config_.spacing_m + 0.5)) + 1;
  grid_ = Eigen::VectorXd::LinSpaced(cells, config_.from_m, config_.to_m);
  Eigen::MatrixXd covariance = config_.noise.cwiseAbs2().asDiagonal();
  covariance.array() += config_.ambient_sigma * config_.ambient_sigma;
  if (config_.unloaded.size()) covariance += config_.lamp_sigma * config_.lamp_sigma * config_.unloaded * config_.unloaded.transpose();
  precision_ = covariance.llt().solve(Eigen::MatrixXd::Identity(n, n));
  bumps_.resize(n, cells * Eigen::Index(config_.width_m.size()));
  for (Eigen::Index w = 0; w < Eigen::Index(config_.width_m.size()); ++w)
    for (Eigen::Index j = 0; j < cells; ++j)
      bumps_.col(w * cells + j) = (-0.5 * ((config_.position_m.array() - grid_[j]) / config_.width_m[std::size_t(w)]).square()).exp();
  matched_ = precision_ * bumps_;
  energy_ = bumps_.cwiseProduct(matched_).colwise().sum().transpose();
  gram_ = bumps_.middleCols(cells, cells).transpose() * matched_.middleCols(cells, cells);
  place_ = Eigen::VectorXd::Constant(cells, 1.0 / double(cells));
  likelihood_ = spread_ = place_;
  score_.resize(bumps_.cols());
}

/// Log of the Bayes factor of a bump with matched score s and energy g against none; its height is half normal and integrated out.
inline double BayesLocalizer::log_evidence(double s, double g, double tempering) const {
  const double prior = 1.0 / (config_.amplitude_sigma * config_.amplitude_sigma), h = g * tempering + prior, t = s * tempering;
  const double z = t / std::sqrt(h);
  // log of 2 Φ(z) e^{z²/2}, without overflow on either side
  const double tail = z > -6.0 ? 0.5 * z * z + std::log(std::erfc(-0.70710678118654752440 * z)) : std::log(0.79788456080286535588 / -z) - 1.0 / (z * z);
  return tail + 0.5 * std::log(prior / h);
}

inline BayesLocalizer::Pair BayesLocalizer::best_pair(double tempering) const {
  const Eigen::Index cells = grid_.size();
  const double prior = 1.0 / (config_.amplitude_sigma * config_.amplitude_sigma);
  const auto apart = std::max<Eigen::Index>(1, Eigen::Index(std::ceil(config_.min_separation_m / config_.spacing_m - 1e-9)));
  const auto middle = score_.segment(cells, cells);
  Pair best;
  double most = -1.0, heights = 1.0;
  for (Eigen::Index i = 0; i < cells; ++i)
    for (Eigen::Index j = i + apart; j < cells; ++j) {
      const double a = tempering * gram_(i, i) + prior, b = tempering * gram_(j, j) + prior, c = tempering * gram_(i, j);
      const double s = tempering * middle[i], t = tempering * middle[j], det = a * b - c * c;
      const double hi = b * s - c * t, hj = a * t - c * s;  // heights times det
      if (!(hi > 0.0 && hj > 0.0)) continue;
      const double fit = 0.5 * (s * hi + t * hj) / det;
      if (fit > most) most = fit, heights = det, best.first = hi >= hj ? i : j, best.second = hi >= hj ? j : i;
    }
  if (most < 0.0) return best;
  // The sum over pairs is replaced by the best one times the cells that it stands for (Laplace), as wide as a bump's error of place.
  const double sharp = std::max(1.0, 2.5 * std::sqrt(config_.width_m[1] * config_.width_m[1] / std::max(2.0 * most, 1.0)) / config_.spacing_m);
  const double pairs = 0.5 * double(cells - apart) * double(cells - apart + 1);
  best.log_evidence = most + 0.5 * std::log(prior * prior / heights) + std::log(4.0) + 2.0 * std::log(sharp) - std::log(std::max(pairs, 1.0));
  return best;
}

inline void BayesLocalizer::predict(double step_s) {
  const double change = -std::expm1(-config_.change_rate_per_s * step_s);
  number_ = (1.0 - change) * number_ + Eigen::Vector3d::Constant(change / 3.0);
  // A contact that stays creeps; one that is new may be anywhere.
  const double walk = config_.creep_m_per_sqrt_s * std::sqrt(step_s) / config_.spacing_m, cells = double(place_.size());
  const auto reach = std::min<Eigen::Index>(place_.size() - 1, Eigen::Index(std::ceil(3.0 * walk)));
  spread_.setZero();
  double whole = 0.0;
  for (Eigen::Index k = -reach; k <= reach; ++k) {
    const double w = std::exp(-0.5 * double(k * k) / std::max(walk * walk, 1e-12));
    whole += w;
    const Eigen::Index n = place_.size() - std::abs(k);
    spread_.segment(std::max<Eigen::Index>(k, 0), n) += w * place_.segment(std::max<Eigen::Index>(-k, 0), n);
  }
  place_ = (1.0 - change) / whole * spread_;
  place_.array() += (1.0 - place_.sum()) / cells;
}

inline LocationEstimate BayesLocalizer::update(const Profile& response) {
  if (response.value.size() != config_.position_m.size())
    throw InvalidArgument(detail::text("response has ", response.value.size(), " values, the localiser ", config_.position_m.size()));
  const double step_s = 1e-9 * double(response.stamp_ns - stamp_ns_);
  if (!fresh_ && step_s <= 0.0) return answer(response.stamp_ns);
  const Eigen::Index cells = grid_.size();
  if (fresh_ || step_s > config_.gap_s) {
    number_ = Eigen::Vector3d(1.0, 1.0, 1.0) / 3.0;
    place_.setConstant(1.0 / double(cells));
    fresh_ = false;
  } else {
    predict(step_s);
  }
  stamp_ns_ = response.stamp_ns;

  score_.noalias() = matched_.transpose() * response.value;
  // The error of the assumed shape grows with the response; it makes all that is seen less certain by one factor.
  const double typical = config_.noise.mean(), shape = config_.shape_error * response.value.cwiseAbs().maxCoeff();
  const double tempering = typical * typical / (typical * typical + shape * shape);

  double top = -1e300;
  for (Eigen::Index j = 0; j < cells; ++j) {
    std::array<double, 3> e{};
    for (std::size_t w = 0; w < 3; ++w) {
      const Eigen::Index k = Eigen::Index(w) * cells + j;
      e[w] = log_evidence(score_[k], energy_[k], tempering);
    }
    const double most = std::max({e[0], e[1], e[2]});
    likelihood_[j] = most + std::log((std::exp(e[0] - most) + std::exp(e[1] - most) + std::exp(e[2] - most)) / 3.0);
    top = std::max(top, likelihood_[j]);
  }
  likelihood_ = (likelihood_.array() - top).exp();
  const double log_one = top + std::log(std::max(likelihood_.mean(), 1e-300));
  place_ = place_.cwiseProduct(likelihood_);
  const double sum = place_.sum();
  place_ = sum > 0.0 ? Eigen::VectorXd(place_ / sum) : Eigen::VectorXd(likelihood_ / likelihood_.sum());

  pair_ = best_pair(tempering);
  const double highest = std::max({0.0, log_one, pair_.log_evidence});
  number_ = number_.cwiseProduct(Eigen::Vector3d(std::exp(-highest), std::exp(log_one - highest), std::exp(pair_.log_evidence - highest)));
  number_ = number_.cwiseMax(1e-12);
  number_ /= number_.sum();
  return answer(stamp_ns_);
}

/// Mean and variance of the posterior about its mode; the flat part that new contacts leave does not count.
inline ContactLocation BayesLocalizer::one() const {
  Eigen::Index top = 0;
  const double most = place_.maxCoeff(&top);
  double sum = 0.0, first = 0.0, second = 0.0;
  for (Eigen::Index j = 0; j < place_.size(); ++j) {
    const double p = place_[j] > 1e-4 * most ? place_[j] : 0.0, d = grid_[j] - grid_[top];
    sum += p, first += p * d, second += p * d * d;
  }
  const double mean = first / sum, cell2 = config_.spacing_m * config_.spacing_m / 12.0;
  const double variance = std::max(second / sum - mean * mean, 0.0) + cell2 + config_.bias_sigma_m * config_.bias_sigma_m;
  const Eigen::Index k = grid_.size() + top;
  return {grid_[top] + mean, variance, std::max(0.0, score_[k] / energy_[k])};
}

inline LocationEstimate BayesLocalizer::answer(std::int64_t stamp_ns) const {
  LocationEstimate e{stamp_ns, 0, {}, 1.0};
  if (fresh_) return e;
  Eigen::Index n = 0;
  e.probability = number_.maxCoeff(&n);
  e.contacts = int(n);
  if (n == 1) e.contact[0] = one();
  if (n == 2) {
    const Eigen::Index cells = grid_.size();
    const double a = gram_(pair_.first, pair_.first), b = gram_(pair_.second, pair_.second), c = gram_(pair_.first, pair_.second), det = a * b - c * c;
    const double s = score_[cells + pair_.first], t = score_[cells + pair_.second];
    const double variance = config_.spacing_m * config_.spacing_m / 12.0 + 4.0 * config_.bias_sigma_m * config_.bias_sigma_m;  // each bends the other
    e.contact[0] = {grid_[pair_.first], variance, std::max(0.0, (b * s - c * t) / det)};
    e.contact[1] = {grid_[pair_.second], variance, std::max(0.0, (a * t - c * s) / det)};
  }
  return e;
}

static_assert(LocationEstimator<BayesLocalizer>);

}  // namespace lumo
