#pragma once

#include <cmath>
#include <concepts>

namespace lumo {

/// Correlation of a stationary Gaussian process as a function of the squared distance r² between inputs, each divided by its length scale.
/// Laws: correlation(0) = 1, decreasing, positive definite in any dimension; slope = d correlation / d r².
template <class K>
concept CovarianceKernel = requires(const K& kernel, double r2) {
  { kernel.correlation(r2) } -> std::same_as<double>;
  { kernel.slope(r2) } -> std::same_as<double>;
};

/// Squared exponential: exp(−r²/2). Samples are smooth.
struct RbfKernel {
  double correlation(double r2) const { return std::exp(-0.5 * r2); }
  double slope(double r2) const { return -0.5 * std::exp(-0.5 * r2); }
};

/// Matérn with ν = 5/2: (1 + s + s²/3) e⁻ˢ with s = √5 r. Samples have two derivatives. Source: Stein, Interpolation of Spatial Data, 1999.
struct Matern52Kernel {
  double correlation(double r2) const {
    const double s = std::sqrt(5.0 * r2);
    return (1.0 + s + s * s / 3.0) * std::exp(-s);
  }
  double slope(double r2) const {
    const double s = std::sqrt(5.0 * r2);
    return -5.0 / 6.0 * (1.0 + s) * std::exp(-s);
  }
};

static_assert(CovarianceKernel<RbfKernel>);
static_assert(CovarianceKernel<Matern52Kernel>);

}  // namespace lumo
