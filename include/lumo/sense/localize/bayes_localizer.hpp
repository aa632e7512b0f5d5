#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/localize/location_estimator.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

namespace lumo::sense {

/// Mean and variance of a distribution over places, and the number of its most probable one.
struct GridMoments {
  double mean, variance;
  Eigen::Index mode;
};

/// Weights below this share of the mode's do not count: what new contacts leave, which may be anywhere.
inline constexpr double least_grid_weight = 1e-4;

/// Moments about the mode. Throws InvalidArgument unless there are as many weights as places, all are finite, and the
/// largest weight is positive.
inline GridMoments moments_about_mode(const Eigen::VectorXd& place, const Eigen::VectorXd& weight) {
  if (place.size() != weight.size() || weight.size() < 1 || !(place.array().abs() <= 1e100).all() ||
      !(weight.array().abs() <= 1e100).all() || !(weight.maxCoeff() > 0.0))
    throw InvalidArgument(message("grid has ", place.size(), " places and ", weight.size(),
        " weights, must have as many, within 1e100, the largest weight > 0"));
  GridMoments m{0.0, 0.0, 0};
  const double most = weight.maxCoeff(&m.mode);
  double sum = 0.0, first = 0.0, second = 0.0;
  for (Eigen::Index j = 0; j < weight.size(); ++j) {
    const double w = weight[j] > least_grid_weight * most ? weight[j] : 0.0, d = place[j] - place[m.mode];
    sum += w;
    first += w * d;
    second += w * d * d;
  }
  m.mean = place[m.mode] + first / sum;
  m.variance = std::max(second / sum - first * first / (sum * sum), 0.0);
  return m;
}

/// Filter over the number of contacts (none, one, two) and over the place of a single one on a grid. The model of a
/// contact is a bright bump of unknown height and one of a few widths. It adds to noise and to slow changes of the
/// lamps and of ambient light, which are integrated out. No labels, no training. `shape_error` and `bias_sigma_m` state
/// how far a real bump is from the assumed shape.
class BayesLocalizer {
 public:
  struct Config {
    Eigen::VectorXd position_m;  ///< of the profile's values
    Eigen::VectorXd noise;       ///< standard deviation of each, unloaded
    Eigen::VectorXd unloaded;    ///< mean profile of the unloaded finger; empty: lamps are steady
    double lamp_sigma = 0.01;    ///< relative change of all lamps together; assumed
    double ambient_sigma = 0.3;  ///< change of ambient light, in the profile's unit; assumed
    double from_m = -30.0_mm, to_m = 30.0_mm, spacing_m = 0.5_mm;   ///< grid
    std::array<double, 4> width_m{3.0_mm, 4.0_mm, 5.5_mm, 8.0_mm};  ///< standard deviations of bumps
    /// The pad ends at ± this place in clear faces, which reflect a bump's light as its mirror image; 0: no ends near.
    double end_m = 0.0;
    /// Share of that light. Assumed: light within 45° of the finger's axis leaves, the rest is reflected totally.
    double end_share = 1.0;
    double amplitude_sigma = 50.0;      ///< prior of a bump's height, half normal, in the profile's unit
    double shape_error = 0.05;          ///< of the assumed bump, relative to the response; counts as noise
    double bias_sigma_m = 0.5_mm;       ///< how far the bump's middle is believed to lie from the contact; assumed
    double end_bias_sigma_m = 0.0;      ///< the same, on top, of contacts near an end; assumed
    double end_near_m = 5.0_mm;         ///< contacts within this of an end have all of it; assumed
    double end_far_m = 10.0_mm;         ///< those beyond this have none, those between a share; assumed
    double min_separation_m = 12.0_mm;  ///< of two contacts
    /// Of the stronger contact's height that the weaker one must have: less may be the bump's own shape.
    double min_share = 0.2;
    /// Of the weaker contact's height by which the response must dip between the two; assumed.
    double min_dip = 0.25;
    double change_rate_per_s = 2.0;      ///< how often contacts come and go
    double creep_m_per_sqrt_s = 1.0_mm;  ///< random walk of a contact that stays
    double gap_s = 0.5;                  ///< longer without a profile: forget
  };

  /// Throws InvalidArgument for lengths that differ or numbers out of range.
  explicit BayesLocalizer(Config config);

  void reset() { fresh_ = true; }
  LocationEstimate update(const Profile& response);

  const Eigen::VectorXd& grid_m() const { return grid_; }
  /// Posterior of the place given one contact; sums to 1.
  const Eigen::VectorXd& place() const { return place_; }
  /// Posterior of none, one, two contacts.
  const Eigen::Vector3d& number() const { return number_; }

 private:
  static constexpr Eigen::Index widths = 4;
  static constexpr double most_cells = 1024.0;        ///< pairs of places are looked up in tables of cells²
  static constexpr Eigen::Index pair_parameters = 4;  ///< places and heights of two bumps
  static constexpr double significant_sigmas = 3.0;   ///< beyond this many standard deviations it is more than noise
  static constexpr double least_number = 1e-12;       ///< probability that a number of contacts keeps
  static constexpr double least_likelihood = 1e-300;  ///< keeps a logarithm finite
  static constexpr double least_information = 1e-3;   ///< of a profile, relative to what was known before

  /// Two bumps of one width, the higher one first.
  struct Pair {
    Eigen::Index first = 0, second = 0, width = 0;
    double explained = -1.0;  ///< by how much they lower χ²; −1: no pair
  };

  static void require_valid(const Config& c);
  void lay_out_bumps();
  double explain(const Eigen::VectorXd& response);
  double weigh_places(double tempering);
  double log_evidence(double s, double g, double tempering) const;
  double log_evidence(const Pair& pair, double tempering) const;
  Pair best_pair(double tempering) const;
  bool dips_between(const Eigen::VectorXd& response, const Pair& pair) const;
  std::array<double, 2> heights(const Pair& pair, double tempering, double& det) const;
  void predict(double step_s);
  double bias_variance_m2(double y) const {
    const double from_far = std::abs(y) - config_.end_m + config_.end_far_m;
    const double near =
        config_.end_m > 0.0 ? std::clamp(from_far / (config_.end_far_m - config_.end_near_m), 0.0, 1.0) : 0.0;
    const double end = near * config_.end_bias_sigma_m;
    return config_.bias_sigma_m * config_.bias_sigma_m + end * end;
  }
  ContactLocation one() const;
  LocationEstimate answer(std::int64_t stamp_ns) const;

  Config config_;
  Eigen::VectorXd grid_;
  Eigen::MatrixXd bumps_;                ///< profile × (grid · widths): the width varies slowest
  Eigen::MatrixXd matched_;              ///< Σ⁻¹ bumps
  Eigen::MatrixXd precision_;            ///< Σ⁻¹ of the profile
  std::array<Eigen::MatrixXd, 4> gram_;  ///< bumpsᵀ Σ⁻¹ bumps of each width
  Eigen::VectorXd energy_;               ///< diagonal of it, all widths
  Eigen::VectorXd score_, place_, likelihood_, spread_, expected_;  ///< expected_: place_ before the newest profile
  Eigen::Vector3d number_{1.0, 0.0, 0.0};
  Pair pair_;
  std::int64_t stamp_ns_ = 0;
  bool fresh_ = true;
};

inline BayesLocalizer::BayesLocalizer(Config config) : config_(std::move(config)) {
  require_valid(config_);
  lay_out_bumps();
  place_ = Eigen::VectorXd::Constant(grid_.size(), 1.0 / double(grid_.size()));
  likelihood_ = spread_ = expected_ = place_;
  score_.resize(bumps_.cols());
}

inline void BayesLocalizer::require_valid(const Config& c) {
  const Eigen::Index n = c.position_m.size();
  if (n < 3 || c.noise.size() != n || (c.unloaded.size() != 0 && c.unloaded.size() != n))
    throw InvalidArgument(message("localiser has ", n, " positions, ", c.noise.size(), " noises and ",
        c.unloaded.size(), " unloaded values, must have as many, at least 3"));
  for (Eigen::Index i = 0; i < n; ++i) require_in_range("noise of a profile's value", c.noise[i], 1e-100, 1e100, "");
  require_ascending_positions(c.position_m);
  if (c.unloaded.size() && !c.unloaded.allFinite()) throw InvalidArgument("localiser: unloaded values must be finite");
  require_in_range("relative change of the lamps", c.lamp_sigma, 0.0, 1e3, "");
  require_in_range("change of ambient light", c.ambient_sigma, 0.0, 1e6, "");
  require_positive("grid spacing", c.spacing_m, "m");
  require_in_range("grid's start", c.from_m, -10.0, 10.0, "m");
  require_in_range("grid's end", c.to_m, c.from_m + 2.0 * c.spacing_m, c.from_m + most_cells * c.spacing_m, "m");
  for (const double w : c.width_m) require_positive("width of a bump", w, "m");
  require_in_range("end of the pad", c.end_m, 0.0, 10.0, "m");
  require_in_range("share of the light that the pad's ends throw back", c.end_share, 0.0, 1.0, "");
  require_in_range("height of a bump", c.amplitude_sigma, 1e-100, 1e100, "");
  require_in_range("shape error", c.shape_error, 0.0, 1.0, "");
  require_in_range("share of the weaker contact", c.min_share, 0.0, 1.0, "");
  require_positive("rate of change of contacts", c.change_rate_per_s, "1/s");
  require_in_range("bias of a bump", c.bias_sigma_m, 0.0, 1.0, "m");
  require_in_range("bias of a bump near an end", c.end_bias_sigma_m, 0.0, 1.0, "m");
  require_in_range("separation of two contacts", c.min_separation_m, 0.0, 10.0, "m");
  require_in_range("creep of a contact", c.creep_m_per_sqrt_s, 0.0, 10.0, "m/sqrt(s)");
  require_positive("gap of the localiser", c.gap_s, "s");
  require_in_range("reach of an end's bias", c.end_near_m, 0.0, c.end_far_m, "m");
  require_positive("fall of an end's bias", c.end_far_m - c.end_near_m, "m");
  require_in_range("dip between two contacts", c.min_dip, 0.0, 1.0, "");
}

/// The bumps of all places and widths, and what they are under the noise.
inline void BayesLocalizer::lay_out_bumps() {
  const Eigen::Index n = config_.position_m.size();
  const auto cells = Eigen::Index(std::floor((config_.to_m - config_.from_m) / config_.spacing_m + 0.5)) + 1;
  grid_ = Eigen::VectorXd::LinSpaced(cells, config_.from_m, config_.to_m);
  Eigen::MatrixXd covariance = config_.noise.cwiseAbs2().asDiagonal();
  covariance.array() += config_.ambient_sigma * config_.ambient_sigma;
  if (config_.unloaded.size())
    covariance += config_.lamp_sigma * config_.lamp_sigma * config_.unloaded * config_.unloaded.transpose();
  precision_ = covariance.llt().solve(Eigen::MatrixXd::Identity(n, n));
  bumps_.resize(n, cells * widths);
  for (Eigen::Index w = 0; w < widths; ++w)
    for (Eigen::Index j = 0; j < cells; ++j) {
      const auto bump_at = [&](double y) {
        return Eigen::VectorXd(
            (-0.5 * ((config_.position_m.array() - y) / config_.width_m[std::size_t(w)]).square()).exp());
      };
      auto bump = bumps_.col(w * cells + j);
      bump = bump_at(grid_[j]);
      if (config_.end_m > 0.0)
        for (const double end : {-config_.end_m, config_.end_m})
          bump += config_.end_share * bump_at(2.0 * end - grid_[j]);
    }
  matched_ = precision_ * bumps_;
  energy_ = bumps_.cwiseProduct(matched_).colwise().sum().transpose();
  for (Eigen::Index w = 0; w < widths; ++w)
    gram_[std::size_t(w)] = bumps_.middleCols(w * cells, cells).transpose() * matched_.middleCols(w * cells, cells);
}

/// Log of the Bayes factor of a bump with matched score s and energy g against none; its height is half normal and
/// integrated out.
inline double BayesLocalizer::log_evidence(double s, double g, double tempering) const {
  const double prior = 1.0 / (config_.amplitude_sigma * config_.amplitude_sigma), h = g * tempering + prior,
               t = s * tempering;
  const double z = t / std::sqrt(h);
  // log of 2 Φ(z) e^{z²/2}, without overflow on either side
  constexpr double asymptotic_below = -6.0, one_by_sqrt_2 = 0.70710678118654752440;
  constexpr double sqrt_2_by_pi = 0.79788456080286535588;
  const double tail = z > asymptotic_below ? 0.5 * z * z + std::log(std::erfc(-one_by_sqrt_2 * z))
                                           : std::log(sqrt_2_by_pi / -z) - 1.0 / (z * z);
  return tail + 0.5 * std::log(prior / h);
}

/// Heights of the two bumps under the prior's ridge, the first's first; `det` of the two equations.
inline std::array<double, 2> BayesLocalizer::heights(const Pair& p, double tempering, double& det) const {
  const Eigen::MatrixXd& gram = gram_[std::size_t(p.width)];
  const double prior = 1.0 / (config_.amplitude_sigma * config_.amplitude_sigma);
  const double a = tempering * gram(p.first, p.first) + prior, b = tempering * gram(p.second, p.second) + prior,
               c = tempering * gram(p.first, p.second);
  const double s = tempering * score_[p.width * grid_.size() + p.first],
               t = tempering * score_[p.width * grid_.size() + p.second];
  det = a * b - c * c;
  return {(b * s - c * t) / det, (a * t - c * s) / det};
}

/// Searched on every other cell, then about the best.
inline auto BayesLocalizer::best_pair(double tempering) const -> Pair {
  const Eigen::Index cells = grid_.size();
  const double prior = 1.0 / (config_.amplitude_sigma * config_.amplitude_sigma);
  const auto apart =
      std::max<Eigen::Index>(1, Eigen::Index(std::ceil(config_.min_separation_m / config_.spacing_m - 1e-9)));
  Pair best;
  const auto look = [&](Eigen::Index width, Eigen::Index i, Eigen::Index j) {
    const Eigen::MatrixXd& gram = gram_[std::size_t(width)];
    const double a = tempering * gram(i, i) + prior, b = tempering * gram(j, j) + prior, c = tempering * gram(j, i);
    const double s = tempering * score_[width * cells + i], t = tempering * score_[width * cells + j];
    const double hi = b * s - c * t, hj = a * t - c * s;  // heights times the determinant
    if (!(std::min(hi, hj) > config_.min_share * std::max(hi, hj))) return;
    const double explained = (s * hi + t * hj) / (a * b - c * c);
    if (explained > best.explained) best = {hi >= hj ? i : j, hi >= hj ? j : i, width, explained};
  };
  for (Eigen::Index width = 0; width < widths; ++width)
    for (Eigen::Index i = 0; i < cells; i += 2)
      for (Eigen::Index j = i + apart; j < cells; j += 2) look(width, i, j);
  if (best.explained < 0.0) return best;
  const Eigen::Index i = std::min(best.first, best.second), j = std::max(best.first, best.second);
  for (Eigen::Index k = std::max<Eigen::Index>(0, i - 1); k <= i + 1; ++k)
    for (Eigen::Index l = std::max(j - 1, k + apart); l <= std::min(cells - 1, j + 1); ++l) look(best.width, k, l);
  return best;
}

/// Two contacts must show as two peaks, so two within about three bump widths count as one. Otherwise a bump of
/// slightly another shape, or a change of the lamps, would count as a second contact.
inline bool BayesLocalizer::dips_between(const Eigen::VectorXd& response, const Pair& pair) const {
  const auto index = [&](Eigen::Index cell) {
    Eigen::Index i = 0;
    (config_.position_m.array() - grid_[cell]).abs().minCoeff(&i);
    return i;
  };
  double det = 1.0;
  const Eigen::Index a = index(pair.first), b = index(pair.second);
  const double least = response.segment(std::min(a, b), std::abs(a - b) + 1).minCoeff();
  return response[b] - least > config_.min_dip * heights(pair, 1.0, det)[1];
}

/// Log of the Bayes factor of two bumps against none.
inline double BayesLocalizer::log_evidence(const Pair& p, double tempering) const {
  if (p.explained < 0.0) return -std::numeric_limits<double>::infinity();
  double det = 1.0;
  const auto h = heights(p, tempering, det);
  const double prior = 1.0 / (config_.amplitude_sigma * config_.amplitude_sigma), cells = double(grid_.size());
  const double fit =
      0.5 * tempering *
      (score_[p.width * grid_.size() + p.first] * h[0] + score_[p.width * grid_.size() + p.second] * h[1]);
  // The best pair times the cells that it stands for replaces the sum over pairs (Laplace): √(2π) times a bump's error
  // of place, width/√L. L = fit/2 is the log likelihood that the bump explains; moved by d it is L (1 − d²/(2 width²)).
  constexpr double sqrt_2_pi = 2.5066282746310002;
  const double width = config_.width_m[std::size_t(p.width)];
  const double sharp = std::max(1.0, sqrt_2_pi * width / std::sqrt(std::max(0.5 * fit, 1.0)) / config_.spacing_m);
  const double apart = config_.min_separation_m / config_.spacing_m,
               pairs = 0.5 * (cells - apart) * (cells - apart + 1.0);
  return fit + 0.5 * std::log(prior * prior / det) + std::log(4.0) + 2.0 * std::log(sharp) -
         std::log(std::max(pairs, 1.0)) - std::log(double(widths));
}

inline void BayesLocalizer::predict(double step_s) {
  const double change = -std::expm1(-config_.change_rate_per_s * step_s);
  number_ = (1.0 - change) * number_ + Eigen::Vector3d::Constant(change / 3.0);
  // A contact that stays creeps; one that is new may be anywhere.
  const double walk = config_.creep_m_per_sqrt_s * std::sqrt(step_s) / config_.spacing_m, cells = double(place_.size());
  // A Gaussian narrower than a cell loses its variance when it is sampled; a step to either side keeps it.
  const bool narrow = walk <= 1.0;
  const auto reach = std::min<Eigen::Index>(place_.size() - 1, narrow ? 1 : Eigen::Index(std::ceil(4.0 * walk)));
  spread_.setZero();
  double whole = 0.0;
  for (Eigen::Index k = -reach; k <= reach; ++k) {
    const double w = !narrow  ? std::exp(-0.5 * double(k * k) / (walk * walk))
                     : k == 0 ? 1.0 - walk * walk
                              : 0.5 * walk * walk;
    whole += w;
    const Eigen::Index n = place_.size() - std::abs(k);
    spread_.segment(std::max<Eigen::Index>(k, 0), n) += w * place_.segment(std::max<Eigen::Index>(-k, 0), n);
  }
  place_ = (1.0 - change) / whole * spread_;
  place_.array() += (1.0 - place_.sum()) / cells;
}

/// Scores of all bumps, and the best pair of them. Returns by what factor the response is less certain than its noise
/// states.
inline double BayesLocalizer::explain(const Eigen::VectorXd& response) {
  score_.noalias() = matched_.transpose() * response;
  // The error of the assumed shape grows with the response; it makes all that is seen less certain by one factor.
  const double typical = config_.noise.mean(), shape = config_.shape_error * response.cwiseAbs().maxCoeff();
  const double tempering = typical * typical / (typical * typical + shape * shape);

  // Best of one and of two bumps. If even that leaves more than noise, the response is no sum of such bumps, and noise
  // stands for the rest (Birge).
  const double explained = (score_.cwiseMax(0.0).cwiseAbs2().cwiseQuotient(energy_)).maxCoeff();
  pair_ = best_pair(tempering);
  if (pair_.explained > 0.0 && !dips_between(response, pair_)) pair_.explained = -1.0;
  const double chi2 = response.dot(precision_ * response),
               freedom = double(std::max<Eigen::Index>(1, response.size() - pair_parameters));
  const double left = chi2 - std::max(explained, pair_.explained / tempering);
  const bool beyond_noise = left > freedom + significant_sigmas * std::sqrt(2.0 * freedom);
  return beyond_noise ? std::min(tempering, freedom / left) : tempering;
}

/// Updates the posterior of a single contact's place. Returns the log of the Bayes factor of one contact against none.
inline double BayesLocalizer::weigh_places(double tempering) {
  const Eigen::Index cells = grid_.size();
  double top = -std::numeric_limits<double>::infinity();
  for (Eigen::Index j = 0; j < cells; ++j) {
    std::array<double, std::size_t(widths)> e{};
    for (std::size_t w = 0; w < e.size(); ++w) {
      const Eigen::Index k = Eigen::Index(w) * cells + j;
      e[w] = log_evidence(score_[k], energy_[k], tempering);
    }
    const double most = *std::max_element(e.begin(), e.end());
    double sum = 0.0;
    for (const double v : e) sum += std::exp(v - most);
    likelihood_[j] = most + std::log(sum / double(widths));
    top = std::max(top, likelihood_[j]);
  }
  likelihood_ = (likelihood_.array() - top).exp();
  const double log_one = top + std::log(std::max(likelihood_.mean(), least_likelihood));
  place_ = place_.cwiseProduct(likelihood_);
  const double sum = place_.sum();
  place_ = sum > 0.0 ? Eigen::VectorXd(place_ / sum) : Eigen::VectorXd(likelihood_ / likelihood_.sum());
  return log_one;
}

inline LocationEstimate BayesLocalizer::update(const Profile& response) {
  if (response.value.size() != config_.position_m.size())
    throw InvalidArgument(
        message("response has ", response.value.size(), " values, the localiser ", config_.position_m.size()));
  const double step_s = 1e-9 * double(response.stamp_ns - stamp_ns_);
  if (!fresh_ && step_s <= 0.0) return answer(response.stamp_ns);
  if (!is_usable(response)) {
    if (step_s > config_.gap_s) reset();
    return answer(response.stamp_ns);
  }
  if (fresh_ || step_s > config_.gap_s) {
    number_ = Eigen::Vector3d(1.0, 1.0, 1.0) / 3.0;
    place_.setConstant(1.0 / double(grid_.size()));
    fresh_ = false;
  } else {
    predict(step_s);
  }
  stamp_ns_ = response.stamp_ns;
  expected_ = place_;

  const double tempering = explain(response.value);
  const double log_one = weigh_places(tempering), log_two = log_evidence(pair_, tempering);
  const double highest = std::max({0.0, log_one, log_two});
  number_ = number_.cwiseProduct(
      Eigen::Vector3d(std::exp(-highest), std::exp(log_one - highest), std::exp(log_two - highest)));
  number_ = number_.cwiseMax(least_number);
  number_ /= number_.sum();
  return answer(stamp_ns_);
}

inline ContactLocation BayesLocalizer::one() const {
  const GridMoments now = moments_about_mode(grid_, place_), before = moments_about_mode(grid_, expected_);
  const double cell2 = config_.spacing_m * config_.spacing_m / 12.0, bias2 = bias_variance_m2(now.mean);
  // The noise of this profile alone: 1/noise = 1/posterior − 1/prior. A profile with little information has a large
  // noise; one that moves the estimate far owes nothing to the prior.
  const double posterior = now.variance + cell2, prior = before.variance + cell2, moved = now.mean - before.mean;
  const double noise = moved * moved > significant_sigmas * significant_sigmas * (prior + posterior)
                           ? posterior
                           : posterior * prior / std::max(prior - posterior, least_information * prior);
  const Eigen::Index k = grid_.size() + now.mode;  // of the second width, a middling one
  return {now.mean, posterior + bias2, std::max(0.0, score_[k] / energy_[k]), bias2, noise};
}

inline LocationEstimate BayesLocalizer::answer(std::int64_t stamp_ns) const {
  LocationEstimate e{stamp_ns, 0, {}, 1.0};
  if (fresh_) return e;
  Eigen::Index n = 0;
  e.probability = number_.maxCoeff(&n);
  e.contacts = int(n);
  if (n == 1) e.contact[0] = one();
  if (n == 2) {
    double det = 1.0;
    const auto h = heights(pair_, 1.0, det);
    // Each bump bends the other, which doubles the bias. The filter does not follow pairs in time.
    const double cell2 = config_.spacing_m * config_.spacing_m / 12.0;
    const auto at = [&](Eigen::Index cell, double height) {
      const double bias2 = 4.0 * bias_variance_m2(grid_[cell]);
      return ContactLocation{grid_[cell], cell2 + bias2, std::max(0.0, height), bias2, cell2};
    };
    e.contact[0] = at(pair_.first, h[0]);
    e.contact[1] = at(pair_.second, h[1]);
  }
  return e;
}

static_assert(LocationEstimator<BayesLocalizer>);

}  // namespace lumo::sense
