#pragma once

#include "lumo/core/chi_squared.hpp"
#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/localize/bayes_localizer.hpp"
#include "lumo/sense/localize/location_estimator.hpp"
#include "lumo/sense/localize/response_templates.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace lumo::sense {

/// Locates one contact on a pad whose responses are known. Each response is judged by itself: of no contact, or of one
/// at a place and load of a grid, each a Gaussian about its template. Its covariance holds noise, lamps that drift one
/// by one and together, ambient light, the tool's shadow, and how far this pad may be from the templates': size, shape,
/// the silicone glued off along the finger, the map of the picture, the angle of the contact. A response is `unknown`,
/// and gives no place, where χ² says that the best of these does not explain it, or where any smooth change of light,
/// of whatever size and either sign, is the likelier explanation.
class TemplateLocalizer {
 public:
  struct Config {
    Eigen::VectorXd position_m;    ///< of the profile's values
    Eigen::VectorXd noise;         ///< standard deviation of each, unloaded
    Eigen::VectorXd unloaded;      ///< mean profile of the unloaded finger
    ResponseTemplates templates;   ///< in the profile's unit
    std::vector<double> lamp_m{};  ///< where the LEDs are, ascending; empty: they do not drift one by one
    double from_m = -27.5_mm, to_m = 27.5_mm, spacing_m = 0.5_mm;  ///< grid of places
    double least_load_N = 0.5;       ///< the grid's first load; the last is the templates'
    double load_ratio = 1.5;         ///< from load to load of the grid, about
    double lamp_sigma = 0.005;       ///< relative change of all lamps together; assumed, as all below
    double one_lamp_sigma = 0.005;   ///< of each lamp by itself
    double ambient_sigma = 0.3;      ///< change of ambient light, in the profile's unit
    double size_sigma = 0.25;        ///< of a response, relative to its template
    double shape_sigma = 0.08;       ///< of a response's value, relative to the template's largest
    double shape_length_m = 4.0_mm;  ///< over which errors of shape are alike
    double pad_sigma_m = 1.0_mm;     ///< how far off the silicone may be glued along the finger
    double map_sigma_m = 0.3_mm;     ///< of the map from the picture, where a response is seen
    double origin_sigma_m = 0.6_mm;  ///< of the LEDs on the finger, which no picture shows
    double most_size_sigmas = 3.0;   ///< that a response's size may be off its template's, or it is unknown
    /// Of the tool in the room's light, about the contact, in the profile's unit; 0: none. What lets shadows pass lets
    /// other pads' responses pass, too.
    double shadow_sigma = 0.0;
    double shadow_width_m = 10.0_mm;  ///< its standard deviation along the finger
    double false_alarm = 0.01;        ///< share of known responses that are called unknown, at most
    double least_probability = 0.99;  ///< of a contact against none, that one is reported
    double unknown_odds = 0.3;  ///< before anything is seen, of a change that is not the pad's against one that is
    double least_change = 0.25,
           most_change = 256.0;  ///< sizes of a change that is not the pad's, in the profile's unit
  };

  /// Throws InvalidArgument for lengths that differ or numbers out of range.
  explicit TemplateLocalizer(Config config);

  void reset() { fresh_ = true; }
  LocationEstimate update(const Profile& response);

  const Eigen::VectorXd& grid_m() const { return grid_; }
  const Eigen::VectorXd& loads_N() const { return loads_; }
  /// Posterior of the place given one contact, of the newest response; sums to 1.
  const Eigen::VectorXd& place() const { return place_; }
  /// χ² of the newest response under the template that explains it best and under no contact, and the limit beyond
  /// which it is unknown.
  double chi2_contact() const { return chi2_contact_; }
  double chi2_free() const { return chi2_free_; }
  double chi2_limit() const { return limit_; }
  /// Mean response to a contact at a grid's place, at a load: what the localiser expects.
  Eigen::VectorXd expected(double y_m, double load_N) const { return field_.at(config_.position_m, y_m, load_N).value; }

 private:
  static constexpr Eigen::Index most_components = 24;  ///< of a response, the smoothest ones, that are compared
  static constexpr Eigen::Index terms = 6;             ///< size, glue, map, way between places, angle, shadow
  static constexpr double most_cells = 1024.0;
  static constexpr double farthest = 1e6;  ///< standard deviations that a component may be off

  static void require_valid(const Config& c);
  void whiten();
  void lay_out_templates();
  void lay_out(Eigen::Index number, double y_m, double load_N);
  double log_odds_of_any_change() const;
  LocationEstimate answer(std::int64_t stamp_ns) const;

  Config config_;
  TemplateField field_;
  Eigen::VectorXd grid_, loads_;
  Eigen::MatrixXd to_components_;  ///< components × positions: unloaded scatter has unit variance in each
  Eigen::VectorXd smoothness_;     ///< of each component: variance of an error of shape of size 1
  // By template, the loads vary fastest: χ² = z²·weight − 2 z·matched + own − |narrow z|².
  Eigen::MatrixXd weight_, matched_;  ///< templates × components
  Eigen::MatrixXd narrow_;            ///< (templates · terms) × components
  Eigen::VectorXd own_, log_det_, noise_share_, peak_;
  Eigen::VectorXd component_, square_, chi2_, likelihood_, narrowed_, place_;
  double limit_ = 0.0, chi2_contact_ = 0.0, chi2_free_ = 0.0, log_odds_ = 0.0, log_odds_unknown_ = 0.0, size_off_ = 0.0;
  Eigen::Index best_ = 0;
  std::int64_t stamp_ns_ = 0;
  bool fresh_ = true;
};

inline TemplateLocalizer::TemplateLocalizer(Config config) : config_(std::move(config)), field_(config_.templates) {
  require_valid(config_);
  whiten();
  lay_out_templates();
}

inline void TemplateLocalizer::require_valid(const Config& c) {
  const Eigen::Index n = c.position_m.size();
  if (n < 3 || c.noise.size() != n || c.unloaded.size() != n)
    throw InvalidArgument(message("localiser has ", n, " positions, ", c.noise.size(), " noises and ",
        c.unloaded.size(), " unloaded values, must have as many, at least 3"));
  for (Eigen::Index i = 0; i < n; ++i) require_in_range("noise of a profile's value", c.noise[i], 1e-100, 1e100, "");
  require_ascending_positions(c.position_m);
  if (!is_usable({0, c.unloaded, 0.0})) throw InvalidArgument("localiser: unloaded values must be finite");
  for (std::size_t k = 0; k < c.lamp_m.size(); ++k) {
    require_in_range("place of a lamp", c.lamp_m[k], -10.0, 10.0, "m");
    if (k > 0) require_positive("way from lamp to lamp", c.lamp_m[k] - c.lamp_m[k - 1], "m");
  }
  require_positive("grid spacing", c.spacing_m, "m");
  require_in_range("grid's start", c.from_m, -10.0, 10.0, "m");
  require_in_range("grid's end", c.to_m, c.from_m + 2.0 * c.spacing_m, c.from_m + most_cells * c.spacing_m, "m");
  require_in_range("first load of the grid", c.least_load_N, 1e-3, 1e3, "N");
  require_in_range("ratio of the grid's loads", c.load_ratio, 1.05, 10.0, "");
  require_in_range("relative change of the lamps", c.lamp_sigma, 0.0, 1e3, "");
  require_in_range("relative change of one lamp", c.one_lamp_sigma, 0.0, 1e3, "");
  require_in_range("change of ambient light", c.ambient_sigma, 0.0, 1e6, "");
  require_in_range("error of a response's size", c.size_sigma, 0.0, 1e3, "");
  require_in_range("error of a response's shape", c.shape_sigma, 0.0, 1e3, "");
  require_positive("length of an error of shape", c.shape_length_m, "m");
  require_in_range("shift of the pad", c.pad_sigma_m, 0.0, 1.0, "m");
  require_in_range("error of the map", c.map_sigma_m, 0.0, 1.0, "m");
  require_in_range("error of the LEDs' place", c.origin_sigma_m, 0.0, 1.0, "m");
  require_in_range("standard deviations of a response's size", c.most_size_sigmas, 0.1, 1e3, "");
  require_in_range("shadow of the tool", c.shadow_sigma, 0.0, 1e6, "");
  require_positive("width of the tool's shadow", c.shadow_width_m, "m");
  require_in_range("false alarms", c.false_alarm, 1e-9, 0.5, "");
  require_in_range("least probability of a contact", c.least_probability, 0.5, 1.0 - 1e-9, "");
  require_in_range("odds of a change that is not the pad's", c.unknown_odds, 1e-9, 1e9, "");
  require_positive("least change of light", c.least_change, "");
  require_in_range("largest change of light", c.most_change, c.least_change, 1e6, "");
}

/// Components in which the scatter of unloaded profiles is white and errors of shape are independent, the smoothest
/// first.
inline void TemplateLocalizer::whiten() {
  const Eigen::VectorXd &x = config_.position_m, &rest = config_.unloaded;
  const Eigen::Index n = x.size();
  Eigen::MatrixXd scatter = config_.noise.cwiseAbs2().asDiagonal();
  scatter.array() += config_.ambient_sigma * config_.ambient_sigma;
  scatter += config_.lamp_sigma * config_.lamp_sigma * rest * rest.transpose();
  const auto& lamps = config_.lamp_m;
  for (std::size_t k = 0; k < lamps.size(); ++k) {  // a lamp's share falls linearly to 0 at its neighbours
    Eigen::VectorXd light = rest;
    for (Eigen::Index i = 0; i < n; ++i) {
      if (k > 0 && x[i] < lamps[k]) light[i] *= std::max(0.0, (x[i] - lamps[k - 1]) / (lamps[k] - lamps[k - 1]));
      if (k + 1 < lamps.size() && x[i] > lamps[k])
        light[i] *= std::max(0.0, (lamps[k + 1] - x[i]) / (lamps[k + 1] - lamps[k]));
    }
    scatter += config_.one_lamp_sigma * config_.one_lamp_sigma * light * light.transpose();
  }
  const Eigen::LLT<Eigen::MatrixXd> root(scatter);
  Eigen::MatrixXd shape(n, n);
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index j = 0; j < n; ++j) {
      const double apart = (x[i] - x[j]) / config_.shape_length_m;
      shape(i, j) = std::exp(-0.5 * apart * apart);
    }
  const Eigen::MatrixXd half = root.matrixL().solve(shape);
  const Eigen::MatrixXd whole = root.matrixL().solve(half.transpose());
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> axes(0.5 * (whole + whole.transpose()));  // ascending
  const Eigen::Index m = std::min(n, most_components);
  const Eigen::MatrixXd smooth = axes.eigenvectors().rightCols(m).rowwise().reverse();
  smoothness_ = axes.eigenvalues().tail(m).reverse().cwiseMax(0.0);
  to_components_ = root.matrixL().transpose().solve(smooth).transpose();
}

inline void TemplateLocalizer::lay_out_templates() {
  const auto cells = Eigen::Index(std::floor((config_.to_m - config_.from_m) / config_.spacing_m + 0.5)) + 1;
  grid_ = Eigen::VectorXd::LinSpaced(cells, config_.from_m, config_.to_m);
  const double most = std::max(field_.max_load_N(), config_.least_load_N * config_.load_ratio);
  const auto loads =
      Eigen::Index(std::ceil(std::log(most / config_.least_load_N) / std::log(config_.load_ratio) - 1e-9)) + 1;
  loads_ = Eigen::VectorXd::LinSpaced(loads, std::log(config_.least_load_N), std::log(most)).array().exp();
  const Eigen::Index m = to_components_.rows(), count = cells * loads;
  weight_.resize(count, m);
  matched_.resize(count, m);
  narrow_.resize(count * terms, m);
  own_.resize(count);
  log_det_.resize(count);
  noise_share_.resize(count);
  peak_.resize(count);
  for (Eigen::Index i = 0; i < cells; ++i)
    for (Eigen::Index l = 0; l < loads; ++l) lay_out(i * loads + l, grid_[i], loads_[l]);
  place_ = Eigen::VectorXd::Constant(cells, 1.0 / double(cells));
  limit_ = chi_squared_quantile(double(m), 1.0 - config_.false_alarm);
}

/// What one template needs for its χ², by the matrix inversion lemma: a diagonal and a few terms.
inline void TemplateLocalizer::lay_out(Eigen::Index number, double y_m, double load_N) {
  const Eigen::VectorXd& x = config_.position_m;
  constexpr double step_m = 0.25_mm;
  const auto component = [&](const Eigen::VectorXd& v) { return Eigen::VectorXd(to_components_ * v); };
  const TemplateResponse here = field_.at(x, y_m, load_N);
  const Eigen::VectorXd before = field_.at(x, y_m - step_m, load_N).value,
                        after = field_.at(x, y_m + step_m, load_N).value,
                        left = field_.at(x.array() - step_m, y_m, load_N).value,
                        right = field_.at(x.array() + step_m, y_m, load_N).value;
  const Eigen::VectorXd by_place = (after - before) / (2.0 * step_m), along = (right - left) / (2.0 * step_m);
  const Eigen::VectorXd middle = component(here.value);
  Eigen::MatrixXd off(middle.size(), terms);
  off.col(0) = config_.size_sigma * middle;
  off.col(1) = config_.pad_sigma_m * component(by_place + along);  // pad and light move, LEDs and contact stay
  off.col(2) = config_.map_sigma_m * component(along);
  off.col(3) = component(here.doubt);
  off.col(4) = component(here.sideways);
  const Eigen::VectorXd away = (x.array() - y_m) / config_.shadow_width_m;
  off.col(5) = config_.shadow_sigma * component((-0.5 * away.array().square()).exp());
  Eigen::Index top = 0;
  const double largest = here.value.cwiseAbs().maxCoeff(&top), shape = config_.shape_sigma * largest;
  const Eigen::VectorXd diagonal = 1.0 + shape * shape * smoothness_.array();
  const Eigen::VectorXd inverse = diagonal.cwiseInverse();
  const Eigen::MatrixXd weighted = inverse.asDiagonal() * off;
  const Eigen::MatrixXd inner = Eigen::MatrixXd::Identity(terms, terms) + off.transpose() * weighted;
  const Eigen::LLT<Eigen::MatrixXd> root(inner);
  const auto explained = [&](const Eigen::VectorXd& v) {  // Σ⁻¹ v
    return Eigen::VectorXd(inverse.cwiseProduct(v) - weighted * root.solve(weighted.transpose() * v));
  };
  weight_.row(number) = inverse.transpose();
  narrow_.middleRows(number * terms, terms) = root.matrixL().solve(weighted.transpose());
  matched_.row(number) = explained(middle).transpose();
  own_[number] = middle.dot(matched_.row(number));
  log_det_[number] =
      diagonal.array().log().sum() + 2.0 * Eigen::VectorXd(root.matrixLLT().diagonal()).array().log().sum();
  const Eigen::VectorXd slope = component(by_place), aim = explained(slope);
  const double information = slope.dot(aim);
  noise_share_[number] = information > 0.0 ? std::min(1.0, aim.squaredNorm() / information) : 1.0;
  peak_[number] = here.value[top];
}

inline LocationEstimate TemplateLocalizer::update(const Profile& response) {
  if (response.value.size() != config_.position_m.size())
    throw InvalidArgument(
        message("response has ", response.value.size(), " values, the localiser ", config_.position_m.size()));
  if (!fresh_ && response.stamp_ns <= stamp_ns_) return answer(response.stamp_ns);
  if (!is_usable(response)) return answer(response.stamp_ns);
  fresh_ = false;
  stamp_ns_ = response.stamp_ns;
  component_.noalias() = to_components_ * response.value;
  component_ = component_.cwiseMax(-farthest).cwiseMin(farthest);
  square_ = component_.cwiseAbs2();
  chi2_free_ = square_.sum();
  narrowed_.noalias() = narrow_ * component_;
  chi2_.noalias() = weight_ * square_;
  chi2_.noalias() -= 2.0 * (matched_ * component_);
  const Eigen::Index count = own_.size(), loads = loads_.size();
  chi2_ += own_;
  for (Eigen::Index k = 0; k < count; ++k) chi2_[k] -= narrowed_.segment<terms>(k * terms).squaredNorm();
  likelihood_ = -0.5 * (chi2_ + log_det_);
  likelihood_.array() += 0.5 * chi2_free_;  // logarithms, against no contact
  const double top = likelihood_.maxCoeff(&best_);
  chi2_contact_ = chi2_[best_];
  size_off_ = config_.size_sigma * (matched_.row(best_).dot(component_) - own_[best_]);
  double sum = 0.0;
  for (Eigen::Index i = 0; i < place_.size(); ++i) {
    place_[i] = (likelihood_.segment(i * loads, loads).array() - top).exp().sum();
    sum += place_[i];
  }
  place_ /= sum;
  log_odds_ = top + std::log(sum / double(count));
  log_odds_unknown_ = log_odds_of_any_change() + std::log(config_.unknown_odds);
  return answer(stamp_ns_);
}

/// Log of the Bayes factor of a smooth Gaussian change, its size unknown, against no contact.
inline double TemplateLocalizer::log_odds_of_any_change() const {
  double top = -std::numeric_limits<double>::infinity(), sum = 0.0;
  int sizes = 0;
  for (double size = config_.least_change; size <= config_.most_change * 1.0001; size *= 2.0) {
    double log_factor = 0.0;
    for (Eigen::Index i = 0; i < square_.size(); ++i) {
      const double more = size * size * smoothness_[i];
      log_factor += 0.5 * (square_[i] * more / (1.0 + more) - std::log1p(more));
    }
    sum = log_factor > top ? sum * std::exp(top - log_factor) + 1.0 : sum + std::exp(log_factor - top);
    top = std::max(top, log_factor);
    ++sizes;
  }
  return top + std::log(sum / sizes);
}

inline LocationEstimate TemplateLocalizer::answer(std::int64_t stamp_ns) const {
  LocationEstimate e{stamp_ns, 0, {}, 1.0};
  if (fresh_) return e;
  const double contact = 1.0 / (1.0 + std::exp(-std::clamp(log_odds_, -700.0, 700.0)));
  const bool touched = contact >= config_.least_probability;
  e.probability = touched ? contact : 1.0 - contact;
  // Gaussian sizes may be negative: a response that is upside down would be its template's of a size far off.
  const bool explained = std::min(chi2_contact_, chi2_free_) <= limit_ && log_odds_unknown_ <= std::max(log_odds_, 0.0);
  e.unknown = !explained || (touched && std::abs(size_off_) > config_.most_size_sigmas);
  if (e.unknown || !touched) return e;
  const GridMoments m = moments_about_mode(grid_, place_);
  const double cell2 = config_.spacing_m * config_.spacing_m / 12.0,
               origin2 = config_.origin_sigma_m * config_.origin_sigma_m, all = m.variance + cell2,
               noise = noise_share_[best_] * all;
  e.contacts = 1;
  e.contact[0] = {m.mean, all + origin2, peak_[best_], all - noise + origin2, noise};
  return e;
}

static_assert(LocationEstimator<TemplateLocalizer>);

}  // namespace lumo::sense
