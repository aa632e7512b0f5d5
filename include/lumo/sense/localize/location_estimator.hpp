#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/sense/devices/device.hpp"

#include <array>
#include <concepts>
#include <cstdint>

namespace lumo::sense {

/// Where the finger is touched, and how sure that is.
struct ContactLocation {
  double y_m = 0.0;
  double variance_m2 = 0.0;       ///< of all errors
  double amplitude = 0.0;         ///< of the response there, in the readout's unit
  double bias_variance_m2 = 0.0;  ///< the part that stays the same from profile to profile
  /// Of this profile's own information, without bias: for a filter that takes estimates as independent.
  double noise_variance_m2 = 0.0;
};

/// Throws InvalidArgument unless positions of a profile are finite and ascend.
inline void require_ascending_positions(const Eigen::VectorXd& position_m) {
  for (Eigen::Index i = 0; i < position_m.size(); ++i) {
    require_in_range("position of a profile's value", position_m[i], -10.0, 10.0, "m");
    if (i > 0 && !(position_m[i] > position_m[i - 1]))
      throw InvalidArgument(message("position ", i, " of a profile is ", position_m[i],
          " m, must exceed its predecessor, ", position_m[i - 1], " m"));
  }
}

/// Contacts by one profile and those before it. Always finite.
struct LocationEstimate {
  std::int64_t stamp_ns = 0;
  int contacts = 0;                        ///< 0, 1 or 2
  std::array<ContactLocation, 2> contact;  ///< the first `contacts` count, the stronger one first
  double probability = 1.0;                ///< of this number of contacts under the model
  /// The response is neither no contact nor any that the model knows: no place is given, and that means nothing.
  bool unknown = false;
};

/// Can a response be worked with: are its values finite, and their squares?
inline bool is_usable(const Profile& response) {
  constexpr double largest = 1e100;
  return (response.value.array().abs() <= largest).all();
}

/// Locates contacts from responses: profiles minus the unloaded reference.
/// Laws: causal, the estimate depends on this and earlier responses only; always finite; a response that is not newer
/// than its predecessor, or not usable (is_usable), changes only the answer's stamp, but that a gap without usable ones
/// is forgotten; after `reset` the estimator is as new.
template <class L>
concept LocationEstimator = requires(L& localizer, const Profile& response) {
  { localizer.update(response) } -> std::same_as<LocationEstimate>;
  localizer.reset();
};

}  // namespace lumo::sense
