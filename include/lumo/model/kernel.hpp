#pragma once

#include "lumo/core/types.hpp"

#include <Eigen/Core>

#include <concepts>

namespace lumo {

/// Correlation of a stationary Gaussian process as a function of the squared distance r² between inputs, each divided
/// by its length scale; element by element, so that it is computed many at a time. Laws: correlation(0) = 1,
/// decreasing, positive definite in any dimension; slope(r², correlation(r²)) = d correlation / d r².
template <class K>
concept CovarianceKernel = requires(const K& kernel, const Eigen::ArrayXXd& r2, const Eigen::ArrayXXd& correlation) {
  { kernel.correlation(r2) } -> std::convertible_to<Eigen::ArrayXXd>;
  { kernel.slope(r2, correlation) } -> std::convertible_to<Eigen::ArrayXXd>;
};

/// Squared exponential: exp(−r²/2). Samples are smooth.
struct RbfKernel {
  Eigen::ArrayXXd correlation(const Eigen::ArrayXXd& r2) const { return (-0.5 * r2).exp(); }
  Eigen::ArrayXXd slope(const Eigen::ArrayXXd&, const Eigen::ArrayXXd& correlation) const { return -0.5 * correlation; }
};

/// Matérn with ν = 5/2: (1 + s + s²/3) e⁻ˢ with s = √5 r. Samples have two derivatives. Source: Stein, Interpolation of
/// Spatial Data, 1999.
struct Matern52Kernel {
  Eigen::ArrayXXd correlation(const Eigen::ArrayXXd& r2) const {
    const Eigen::ArrayXXd s = (5.0 * r2).sqrt();
    return (1.0 + s + s.square() / 3.0) * (-s).exp();
  }
  Eigen::ArrayXXd slope(const Eigen::ArrayXXd& r2, const Eigen::ArrayXXd& correlation) const {
    const Eigen::ArrayXXd s = (5.0 * r2).sqrt();
    return -5.0 / 6.0 * (1.0 + s) / (1.0 + s + s.square() / 3.0) * correlation;
  }
};

static_assert(CovarianceKernel<RbfKernel> && CovarianceKernel<Matern52Kernel>);

}  // namespace lumo
