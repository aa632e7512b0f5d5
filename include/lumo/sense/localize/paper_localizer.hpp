#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/statistics.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/localize/location_estimator.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

namespace lumo::sense {

/// The paper's localiser as its authors run it, on rows of the positive change of green (BrightRows): Gaussian filter
/// along the finger, causal median of three frames, a threshold above what the unloaded rows have, and the centroid or
/// the largest value of what stands above it. A contact whose light fails a gate has no place and is `unknown`. Source:
/// the authors' public code (dokkev/fingertip-design-framework, contact_localization.py), by description.
class PaperLocalizer {
 public:
  enum class Place { centroid, largest };  ///< the live code's, the force figure's

  struct Config {
    Eigen::VectorXd position_m;     ///< of the rows
    std::vector<Profile> unloaded;  ///< at least one
    Place place = Place::centroid;
    double smoothing_rows = 2.0;  ///< standard deviation
    double least_noise_DN = 0.75;
    double threshold_noises = 4.0;
    double least_evidence_DN = 4.0;  ///< sum over the rows
    double least_contrast = 1.2;     ///< of largest to median row, each with `contrast_floor_DN` on top
    double contrast_floor_DN = 0.75;
    double most_entropy = 0.985;  ///< of the evidence, 1: even
    double most_nearly_saturated = 0.25, most_saturated = 0.05;
    double sigma_m = 6.0_mm;  ///< stated error of a place; the paper states none, its mean error was 5 mm
  };

  /// Throws InvalidArgument for lengths that differ or numbers out of range.
  explicit PaperLocalizer(Config config) : config_(std::move(config)) {
    const Eigen::Index n = config_.position_m.size();
    if (n < 3 || config_.unloaded.empty())
      throw InvalidArgument(message("paper's localiser has ", n, " rows and ", config_.unloaded.size(),
          " unloaded profiles, must have at least 3 and 1"));
    require_ascending_positions(config_.position_m);
    require_in_range("smoothing", config_.smoothing_rows, 0.1, 100.0, "rows");
    require_positive("least noise", config_.least_noise_DN, "DN");
    require_positive("threshold", config_.threshold_noises, "noises");
    require_positive("stated error of a place", config_.sigma_m, "m");
    Eigen::MatrixXd rows(n, Eigen::Index(config_.unloaded.size()));
    for (Eigen::Index k = 0; k < rows.cols(); ++k) {
      const Profile& p = config_.unloaded[std::size_t(k)];
      if (p.value.size() != n || !is_usable(p))
        throw InvalidArgument(
            message("unloaded profile has ", p.value.size(), " values, must have ", n, " finite ones"));
      rows.col(k) = smoothed(p.value);
    }
    centre_ = pointwise_median(rows);
    constexpr double sigmas_per_mad = 1.4826;  // of a normal distribution
    noise_ =
        (sigmas_per_mad * pointwise_median((rows.colwise() - centre_).cwiseAbs())).cwiseMax(config_.least_noise_DN);
  }

  void reset() {
    seen_ = 0;
    stamped_ = false;
    last_ = {};
  }

  LocationEstimate update(const Profile& response) {
    if (response.value.size() != config_.position_m.size())
      throw InvalidArgument(
          message("response has ", response.value.size(), " values, the localiser ", config_.position_m.size()));
    if ((stamped_ && response.stamp_ns <= stamp_ns_) || !is_usable(response)) {
      last_.stamp_ns = response.stamp_ns;
      return last_;
    }
    stamp_ns_ = response.stamp_ns;
    stamped_ = true;
    recent_[std::size_t(seen_++ % 3)] = smoothed(response.value);
    last_ = answer(response, median_of_recent());
    return last_;
  }

 private:
  Eigen::VectorXd smoothed(const Eigen::VectorXd& v) const {
    const auto reach = Eigen::Index(std::ceil(4.0 * config_.smoothing_rows)), n = v.size();
    Eigen::VectorXd s(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      double sum = 0.0, whole = 0.0;
      for (Eigen::Index k = -reach; k <= reach; ++k) {
        const double away = double(k) / config_.smoothing_rows, weight = std::exp(-0.5 * away * away);
        sum += weight * v[std::clamp<Eigen::Index>(i + k, 0, n - 1)];
        whole += weight;
      }
      s[i] = sum / whole;
    }
    return s;
  }
  Eigen::VectorXd median_of_recent() const {
    const auto count = Eigen::Index(std::min<std::int64_t>(seen_, 3));
    Eigen::MatrixXd rows(config_.position_m.size(), count);
    for (Eigen::Index k = 0; k < count; ++k) rows.col(k) = recent_[std::size_t(k)];
    return pointwise_median(rows);
  }
  LocationEstimate answer(const Profile& response, const Eigen::VectorXd& rows) const {
    LocationEstimate e{response.stamp_ns, 0, {}, 1.0};
    const Eigen::VectorXd above = rows - centre_, evidence = (above - config_.threshold_noises * noise_).cwiseMax(0.0);
    const double sum = evidence.sum();
    Eigen::Index top = 0;
    const double largest = evidence.maxCoeff(&top);
    if (sum < config_.least_evidence_DN || !(largest > 0.0)) return e;
    const double middle = median({rows.data(), rows.data() + rows.size()}), peak = rows.maxCoeff();
    double entropy = 0.0;
    for (const double v : evidence)
      if (v > 0.0) entropy -= v / sum * std::log(v / sum);
    entropy /= std::log(double(evidence.size()));
    const double contrast = (peak + config_.contrast_floor_DN) / (middle + config_.contrast_floor_DN);
    e.unknown = contrast < config_.least_contrast || entropy > config_.most_entropy ||
                response.nearly_saturated > config_.most_nearly_saturated ||
                response.saturated > config_.most_saturated;
    if (e.unknown) return e;
    const double row =
                     evidence.dot(Eigen::VectorXd::LinSpaced(evidence.size(), 0.0, double(evidence.size() - 1))) / sum,
                 variance = config_.sigma_m * config_.sigma_m;
    e.contacts = 1;
    e.contact[0] = {
        config_.place == Place::largest ? config_.position_m[top] : place_of(row), variance, largest, variance, 0.0};
    return e;
  }
  double place_of(double row) const {
    const Eigen::VectorXd& x = config_.position_m;
    const auto k = std::min(Eigen::Index(row), x.size() - 2);
    return x[k] + (row - double(k)) * (x[k + 1] - x[k]);
  }

  Config config_;
  Eigen::VectorXd centre_, noise_;
  std::array<Eigen::VectorXd, 3> recent_;
  LocationEstimate last_;
  std::int64_t seen_ = 0, stamp_ns_ = 0;
  bool stamped_ = false;
};

static_assert(LocationEstimator<PaperLocalizer>);

}  // namespace lumo::sense
