#pragma once

#include "lumo/core/error.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

namespace lumo::sense {

/// Stamps lie within ±this [ns], 146 years, so that the difference of any two fits into 64 bits.
inline constexpr std::int64_t stamp_limit_ns = 4'600'000'000'000'000'000;

/// From one clock to another: to = from + offset + drift · (from − origin).
struct ClockMap {
  std::int64_t origin_ns = 0;
  double offset_s = 0.0;
  double drift = 0.0;       ///< seconds per second
  double residual_s = 0.0;  ///< RMS residual of a fit; 0 if the map was given
  bool operator==(const ClockMap&) const = default;

  /// Saturates at the limit of stamps. Throws InvalidArgument for an offset or drift that is not finite.
  std::int64_t operator()(std::int64_t from_ns) const {
    require_finite("offset of a clock", offset_s, "s");
    require_finite("drift of a clock", drift, "");
    constexpr double limit = double(stamp_limit_ns);
    const double shift = 1e9 * offset_s + drift * (double(from_ns) - double(origin_ns));
    return std::clamp<std::int64_t>(
        from_ns + std::llround(std::clamp(shift, -limit, limit)), -stamp_limit_ns, stamp_limit_ns);
  }

  /// Least-squares fit to the stamps of the same events on both clocks; one event gives the offset alone. Throws
  /// InvalidArgument for none.
  static ClockMap fit(std::span<const std::int64_t> from_ns, std::span<const std::int64_t> to_ns) {
    if (from_ns.empty() || from_ns.size() != to_ns.size())
      throw InvalidArgument(message(
          "clocks have ", from_ns.size(), " and ", to_ns.size(), " common events, must have as many, at least 1"));
    for (std::size_t i = 0; i < from_ns.size(); ++i)
      for (const std::int64_t stamp : {from_ns[i], to_ns[i]})
        if (stamp < -stamp_limit_ns || stamp > stamp_limit_ns)
          throw InvalidArgument(message("stamp of a common event is ", stamp, " ns, must lie within 4.6e18 ns"));
    ClockMap map;
    map.origin_ns = from_ns[from_ns.size() / 2];
    const double n = double(from_ns.size());
    double sum_t = 0.0, sum_d = 0.0, sum_tt = 0.0, sum_td = 0.0;
    for (std::size_t i = 0; i < from_ns.size(); ++i) {
      const double t = 1e-9 * double(from_ns[i] - map.origin_ns), d = 1e-9 * double(to_ns[i] - from_ns[i]);
      sum_t += t;
      sum_d += d;
      sum_tt += t * t;
      sum_td += t * d;
    }
    const double det = n * sum_tt - sum_t * sum_t;
    map.drift = det > 1e-9 * n * n ? (n * sum_td - sum_t * sum_d) / det : 0.0;
    map.offset_s = (sum_d - map.drift * sum_t) / n;
    double squares = 0.0;
    for (std::size_t i = 0; i < from_ns.size(); ++i) squares += std::pow(1e-9 * double(to_ns[i] - map(from_ns[i])), 2);
    map.residual_s = std::sqrt(squares / n);
    return map;
  }
};

/// A recorded quantity of some channels over time, interpolated linearly.
class TimeSeries {
 public:
  /// `value`: channels × stamps. Stamps ascend strictly. Throws InvalidArgument.
  TimeSeries(std::vector<std::int64_t> stamp_ns, Eigen::MatrixXd value)
      : stamp_(std::move(stamp_ns)), value_(std::move(value)) {
    if (value_.cols() != Eigen::Index(stamp_.size()))
      throw InvalidArgument(message("time series has ", stamp_.size(), " stamps and ", value_.cols(), " values"));
    for (std::size_t i = 1; i < stamp_.size(); ++i)
      if (stamp_[i] <= stamp_[i - 1])
        throw InvalidArgument(message(
            "time series: stamp ", i, " is ", stamp_[i], " ns, must exceed its predecessor, ", stamp_[i - 1], " ns"));
    if (!stamp_.empty() && (stamp_.front() < -stamp_limit_ns || stamp_.back() > stamp_limit_ns))
      throw InvalidArgument(
          message("time series goes from ", stamp_.front(), " to ", stamp_.back(), " ns, must lie within 4.6e18 ns"));
  }

  /// Value at a time; nullopt outside of the series, or in a gap longer than `max_gap_s` (NaN: in each).
  std::optional<Eigen::VectorXd> at(std::int64_t stamp_ns, double max_gap_s) const {
    const Eigen::MatrixXd& value = value_;
    const auto after = std::lower_bound(stamp_.begin(), stamp_.end(), stamp_ns);
    if (after == stamp_.end()) return std::nullopt;
    const auto j = Eigen::Index(after - stamp_.begin());
    if (*after == stamp_ns) return Eigen::VectorXd(value.col(j));
    if (after == stamp_.begin()) return std::nullopt;
    const double gap = double(*after - *(after - 1));
    if (!(1e-9 * gap <= max_gap_s)) return std::nullopt;
    const double share = double(stamp_ns - *(after - 1)) / gap;
    return Eigen::VectorXd((1.0 - share) * value.col(j - 1) + share * value.col(j));
  }

  /// RMS difference between each inner sample and the line through its neighbours, per channel: noise, and curvature
  /// that interpolation misses. White noise of standard deviation σ gives √1.5 σ. Interpolation itself spans half the
  /// distance, so its error is about a quarter of the curvature's part.
  Eigen::VectorXd interpolation_residual() const {
    const Eigen::MatrixXd& value = value_;
    Eigen::VectorXd squares = Eigen::VectorXd::Zero(value.rows());
    for (std::size_t i = 1; i + 1 < stamp_.size(); ++i) {
      const double share = double(stamp_[i] - stamp_[i - 1]) / double(stamp_[i + 1] - stamp_[i - 1]);
      const auto k = Eigen::Index(i);
      squares += (value.col(k) - (1.0 - share) * value.col(k - 1) - share * value.col(k + 1)).cwiseAbs2();
    }
    return stamp_.size() < 3 ? squares : Eigen::VectorXd((squares / double(stamp_.size() - 2)).cwiseSqrt());
  }
  double largest_gap_s() const {
    std::int64_t gap = 0;
    for (std::size_t i = 1; i < stamp_.size(); ++i) gap = std::max(gap, stamp_[i] - stamp_[i - 1]);
    return 1e-9 * double(gap);
  }
  std::size_t size() const { return stamp_.size(); }

 private:
  std::vector<std::int64_t> stamp_;
  Eigen::MatrixXd value_;
};

}  // namespace lumo::sense
