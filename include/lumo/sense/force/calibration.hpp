#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/statistics.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/joints/torque_model.hpp"

#include <Eigen/Core>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <functional>
#include <span>
#include <vector>

namespace lumo::sense {

/// Half of a normal's 95 % interval, in standard deviations.
inline constexpr double sigmas_of_95_percent = 1.96;

/// Stiffness of one specimen against the nominal one, from a press curve.
struct StiffnessFit {
  Interval factor;          ///< of the nominal shear modulus (λ/μ kept), 95 %
  double onset_m = 0.0;     ///< of the marker, where the nominal curve begins
  double residual_N = 0.0;  ///< RMS
};

/// Fits force = factor · nominal(depth − onset). `nominal_N`: force of the nominal pad at a depth [m], 0 below 0,
/// increasing: with the ratio of moduli kept, force is proportional to the modulus at given depth. Samples of one press
/// are not independent (the silicone creeps, the servo swings), so that the interval counts `independent` of them (0:
/// all). Throws InvalidArgument for fewer than three samples in contact, or ones that do not determine both.
inline StiffnessFit fit_stiffness(std::span<const double> depth_m, std::span<const double> force_N,
    const std::function<double(double)>& nominal_N, int independent = 0) {
  if (depth_m.size() != force_N.size())
    throw InvalidArgument(
        message("press curve has ", depth_m.size(), " depths and ", force_N.size(), " forces, must have as many"));
  for (const double d : depth_m) require_finite("depth of a press curve", d, "m");
  for (const double f : force_N) require_finite("force of a press curve", f, "N");
  require_in_range("independent samples of a press curve", independent, 0, 1e9, "");
  const auto n = Eigen::Index(depth_m.size());
  StiffnessFit fit{{1.0, 1.0, 1.0}, 0.0, 0.0};
  constexpr int most_steps = 30;                        // of Gauss–Newton; some five are needed
  constexpr double step_m = 1e-6;                       // of the difference quotient
  constexpr double scale_m = 1e-4, tolerance = 1e-4;    // typical onset; singular values below do not count
  constexpr double least_factor = 0.01, most_m = 1e-3;  // a softer specimen, a longer step is no fit
  constexpr double converged_factor = 1e-9, converged_m = 1e-11;
  Eigen::MatrixXd a(n, 2);
  Eigen::VectorXd left(n);
  Identification last;
  for (int k = 0; k < most_steps; ++k) {
    for (Eigen::Index i = 0; i < n; ++i) {
      const double d = depth_m[std::size_t(i)] - fit.onset_m, f = nominal_N(d);
      a(i, 0) = f;
      a(i, 1) = -fit.factor.value * (nominal_N(d + step_m) - nominal_N(d - step_m)) / (2.0 * step_m);
      left[i] = force_N[std::size_t(i)] - fit.factor.value * f;
    }
    if ((a.col(0).array() > 0.0).count() < 3) throw InvalidArgument("press curve: fewer than three samples in contact");
    last = identify(a, left, Eigen::Vector2d(1.0, scale_m), 0.0, tolerance);
    if (!last.complete()) throw InvalidArgument("press curve does not separate stiffness and onset");
    fit.factor.value = std::max(least_factor, fit.factor.value + last.value[0]);
    fit.onset_m += std::clamp(last.value[1], -most_m, most_m);
    if (std::abs(last.value[0]) < converged_factor && std::abs(last.value[1]) < converged_m) break;
  }
  fit.residual_N = last.residual;
  const double alike = independent > 0 ? std::max(1.0, double(n) / independent) : 1.0,
               sigma = std::sqrt(alike * last.covariance(0, 0));
  fit.factor.low = fit.factor.value - sigmas_of_95_percent * sigma;
  fit.factor.high = fit.factor.value + sigmas_of_95_percent * sigma;
  return fit;
}

/// Photon transfer of a camera (EMVA 1288): temporal variance of pixels over their signal. Row offsets and common
/// changes of the lamps are taken out of each pair of frames, fixed patterns fall out of their difference.
class PhotonTransfer {
 public:
  struct Result {
    Interval gain_DN_per_electron;  ///< slope, 95 %
    double dark_sigma_DN = 0.0;     ///< at no signal: read-out and the steps of 8 bits
  };

  /// One frame; the next one makes a pair with it. Throws InvalidArgument for another size or format.
  void add(const ImageView& v) {
    if (v.empty()) throw InvalidArgument("photon transfer: a picture is empty");
    const auto n = std::size_t(v.width) * std::size_t(v.height);
    if (frames_ == 0) {
      sum_.assign(n, 0.0);
      squares_.assign(n, 0.0);
    }
    if (frames_ > 0 && (v.width != last_.width || v.height != last_.height))
      throw InvalidArgument("photon transfer: pictures must have one size");
    const Image before = last_;
    last_ = Image::black(v.width, v.height, PixelFormat::grey);
    std::vector<double> difference(std::size_t(v.width));
    for (int y = 0; y < v.height; ++y) {
      double mean = 0.0;
      for (int x = 0; x < v.width; ++x) {
        const std::uint8_t g = v.green(x, y);
        last_.row(y)[x] = g;
        sum_[std::size_t(y) * std::size_t(v.width) + std::size_t(x)] += g;
        if (frames_ > 0) {
          difference[std::size_t(x)] = double(g) - before.view().row(y)[x];
          mean += difference[std::size_t(x)] / v.width;
        }
      }
      if (frames_ > 0)
        for (int x = 0; x < v.width; ++x)
          squares_[std::size_t(y) * std::size_t(v.width) + std::size_t(x)] +=
              0.5 * std::pow(difference[std::size_t(x)] - mean, 2) * v.width / (v.width - 1.0);
    }
    ++frames_;
  }
  /// From pixels with a mean below `full_DN` (above, the top of the range cuts the noise). Linear cameras only. Throws
  /// InvalidArgument for fewer than 8 pairs or signals that are all alike.
  Result result(double black_DN = 0.0, double full_DN = 230.0) const {
    constexpr int least_pairs = 8, least_pixels = 100, rounds = 4;
    if (pairs() < least_pairs)
      throw InvalidArgument(
          message("photon transfer has ", pairs(), " pairs of pictures, must have at least ", least_pairs));
    std::vector<double> signal, variance;
    for (std::size_t i = 0; i < sum_.size(); ++i)
      if (const double mean = sum_[i] / frames_; mean < full_DN && mean > black_DN + 1.0) {
        signal.push_back(mean - black_DN);
        variance.push_back(squares_[i] / pairs());
      }
    const auto n = Eigen::Index(signal.size());
    const double low = signal.empty() ? 0.0 : quantile(signal, 0.02),
                 high = signal.empty() ? 0.0 : quantile(signal, 0.98);
    if (n < least_pixels || !(high > 1.5 * low + 5.0))
      throw InvalidArgument("photon transfer: signals are all alike, they give no slope");
    // Variance of a variance is 2 σ⁴/pairs: weights by the signal, from a first look.
    Eigen::Vector2d line(0.5, 0.02);
    Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
    for (int k = 0; k < rounds; ++k) {
      Eigen::MatrixXd a(n, 2);
      Eigen::VectorXd b(n);
      for (Eigen::Index i = 0; i < n; ++i) {
        const double weight = 1.0 / std::max(line[0] + line[1] * signal[std::size_t(i)], 0.05);
        a.row(i) << weight, weight * signal[std::size_t(i)];
        b[i] = weight * variance[std::size_t(i)];
      }
      // Normal equations: pixels are many, parameters two.
      const Eigen::Matrix2d normal = a.transpose() * a;
      const Eigen::Matrix2d inverse = normal.inverse();
      line = inverse * (a.transpose() * b);
      covariance = (a * line - b).squaredNorm() / double(n - 2) * inverse;
    }
    const double sigma = std::sqrt(covariance(1, 1));
    return {{line[1], line[1] - sigmas_of_95_percent * sigma, line[1] + sigmas_of_95_percent * sigma},
        std::sqrt(std::max(line[0], 0.0))};
  }
  int pairs() const { return std::max(0, frames_ - 1); }

 private:
  Image last_;
  int frames_ = 0;
  std::vector<double> sum_, squares_;  ///< of the values; of the differences
};

/// Light of the lamps alone, from pictures with and without them: mean difference over pixels that are lit at all [DN],
/// and what that is in electrons.
struct LampLevel {
  double level_DN = 0.0;
  Interval electrons;  ///< a pixel and exposure, 95 %; flux, lens and exposure in one: a picture does not separate them
};

/// `lit` and `dark` are mean pictures of one view. Throws InvalidArgument for sizes that differ, or no light.
inline LampLevel lamp_level(const ImageView& lit, const ImageView& dark, const Interval& gain_DN_per_electron) {
  if (lit.empty() || lit.width != dark.width || lit.height != dark.height)
    throw InvalidArgument("lamp level: the lit and the dark picture must have one size");
  std::vector<double> difference;
  for (int y = 0; y < lit.height; ++y)
    for (int x = 0; x < lit.width; ++x) difference.push_back(double(lit.green(x, y)) - dark.green(x, y));
  const double half = 0.5 * quantile(difference, 0.98);
  double sum = 0.0;
  int count = 0;
  for (const double d : difference)
    if (d > half) {
      sum += d;
      ++count;
    }
  if (!(half > 0.5) || count == 0)
    throw InvalidArgument("lamp level: the lit picture is no brighter than the dark one");
  const double level = sum / count;
  return {
      level, {level / gain_DN_per_electron.value, level / gain_DN_per_electron.high, level / gain_DN_per_electron.low}};
}

}  // namespace lumo::sense
