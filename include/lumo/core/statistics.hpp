#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/sobol.hpp"
#include "lumo/core/types.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace lumo {

/// A number with a lower and an upper bound.
struct Interval {
  double value = 0.0, low = 0.0, high = 0.0;
};

/// Half of a normal's values lie within so many standard deviations.
inline constexpr double half_of_normal = 0.6744897501960817;

/// Middle one of the numbers, mean of the middle two for an even count. Throws InvalidArgument for none.
inline double median(std::vector<double> v) {
  if (v.empty()) throw InvalidArgument("median of no numbers");
  const auto half = v.begin() + std::ptrdiff_t(v.size() / 2);
  std::nth_element(v.begin(), half, v.end());
  return v.size() % 2 ? *half : 0.5 * (*half + *std::max_element(v.begin(), half));
}

/// Quantile by linear interpolation between order statistics (type 7 of Hyndman & Fan 1996). Throws InvalidArgument for
/// none.
inline double quantile(std::vector<double> v, double p) {
  if (v.empty()) throw InvalidArgument("quantile of no numbers");
  require_in_range("quantile", p, 0.0, 1.0, "");
  std::sort(v.begin(), v.end());
  const double place = p * double(v.size() - 1);
  const auto i = std::size_t(place);
  return i + 1 == v.size() ? v[i] : v[i] + (place - double(i)) * (v[i + 1] - v[i]);
}

/// Of ascending numbers the first of those `count` in a row that lie closest together; `count` is 1 to their number.
inline std::size_t closest_together(const std::vector<double>& sorted, std::size_t count) {
  std::size_t closest = 0;
  for (std::size_t i = 1; i + count <= sorted.size(); ++i)
    if (sorted[i + count - 1] - sorted[i] < sorted[closest + count - 1] - sorted[closest]) closest = i;
  return closest;
}

/// Root mean square of the entries.
inline double rms(const Eigen::Ref<const Eigen::VectorXd>& v) {
  return v.size() ? v.norm() / std::sqrt(double(v.size())) : 0.0;
}

/// Median of each row.
inline Eigen::VectorXd pointwise_median(const Eigen::MatrixXd& m) {
  Eigen::VectorXd r(m.rows());
  for (Eigen::Index i = 0; i < m.rows(); ++i) {
    const Eigen::VectorXd row = m.row(i);
    r[i] = median({row.data(), row.data() + row.size()});
  }
  return r;
}

/// Wilson's score interval of a share, `right` of `all`; z = 1.96 for 95 %. Source: Wilson 1927.
inline Interval wilson_interval(int right, int all, double z = 1.959963984540054) {
  if (all < 1 || right < 0 || right > all)
    throw InvalidArgument(message("share is ", right, " of ", all, ", must have 0 <= right <= all, all >= 1"));
  const double n = all, p = right / n, z2 = z * z, middle = (p + 0.5 * z2 / n) / (1.0 + z2 / n);
  const double half = z * std::sqrt(p * (1.0 - p) / n + 0.25 * z2 / (n * n)) / (1.0 + z2 / n);
  return {p, std::max(0.0, middle - half), std::min(1.0, middle + half)};
}

/// Standard normal numbers from a counter; a pure function of (seed, number of calls). Source: Box & Muller 1958.
class CountedNormals {
 public:
  explicit CountedNormals(std::uint64_t seed) : seed_(seed) {}
  double operator()() {
    const double radius = std::sqrt(-2.0 * std::log(uniform(combine(seed_, count_)))),
                 turn = uniform(combine(seed_, count_ + 1));
    count_ += 2;
    return radius * std::cos(6.2831853071795864769 * turn);
  }

 private:
  std::uint64_t seed_, count_ = 0;
};

}  // namespace lumo
