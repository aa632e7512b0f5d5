#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"

#include <Eigen/Core>

#include <cmath>

namespace lumo {

/// Hyper-parameters of a Gaussian process without output scale, on inputs normalised to the unit box and outputs standardised.
struct Hyperparameters {
  Eigen::VectorXd length_scale;  ///< one per input
  double noise = 0.0;            ///< variance of an observation
  double mean = 0.0;
};

/// ln x is normal with mean `location` and standard deviation `scale`.
struct LogNormalPrior {
  double location = 0.0;
  double scale = 1.0;

  double log_density(double x) const {
    const double z = (std::log(x) - location) / scale;
    return -std::log(x) - std::log(scale) - 0.5 * std::log(2.0 * pi) - 0.5 * z * z;
  }
  /// d log_density / d ln x.
  double log_slope(double x) const { return -1.0 - (std::log(x) - location) / (scale * scale); }
  double mode() const { return std::exp(location - scale * scale); }
};

/// Priors and bounds under which hyper-parameters are fitted. The mean has no prior.
struct HyperparameterPrior {
  LogNormalPrior length_scale;  ///< of each
  LogNormalPrior noise{-4.0, 1.0};
  double min_length_scale = 0.025;
  double max_length_scale = 1e4;
  double min_noise = 1e-4;
  double max_noise = 10.0;

  /// Length scales grow with the square root of the dimension. Source: Hvarfner, Hellsten & Nardi, "Vanilla Bayesian
  /// Optimization Performs Great in High Dimensions", ICML 2024; the numbers are those of BoTorch 0.18.
  static HyperparameterPrior for_dimension(Eigen::Index d) {
    if (d < 1) throw InvalidArgument(message("Gaussian process has ", d, " inputs, must have at least 1"));
    HyperparameterPrior prior;
    prior.length_scale = {std::sqrt(2.0) + 0.5 * std::log(double(d)), std::sqrt(3.0)};
    return prior;
  }
};

}  // namespace lumo
