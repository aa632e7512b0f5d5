#pragma once

#include <Eigen/Core>

#include <concepts>
#include <cstdint>

namespace lumo::sense {

/// Light along the finger at one time.
struct Profile {
  std::int64_t stamp_ns = 0;
  Eigen::VectorXd value;  ///< one for each position of the readout; its unit is the readout's
  /// Share of the raw values at the top of their range: profile values there are lower bounds.
  double saturated = 0.0;
};

/// Turns one raw sample (a camera's frame, a row of photodiodes) into a longitudinal profile.
/// Laws: linear in the light unless a value saturates; value i belongs to `positions_m()[i]` on the finger's y axis,
/// ascending; a sample of another size or kind gives false and leaves the profile as it was; no memory is allocated
/// after the first call.
template <class R>
concept Readout = requires(R& readout, const R& view, const typename R::Sample& sample, Profile& profile) {
  { readout.read(sample, profile) } -> std::same_as<bool>;
  { view.positions_m() } -> std::convertible_to<const Eigen::VectorXd&>;
};

}  // namespace lumo::sense
