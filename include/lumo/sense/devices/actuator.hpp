#pragma once

#include "lumo/sense/devices/joint_sample.hpp"
#include "lumo/sense/devices/stream.hpp"

#include <concepts>
#include <optional>

namespace lumo::sense {

/// A source of joint samples: live motors or a recording.
/// Laws: `next` gives each sample once, in the order of arrival, and nullopt if there is none now; it never waits; all
/// samples have the same number of joints, in the same order; there is no sample unless the state is `open`.
template <class A>
concept Actuator = requires(A& actuator, const A& view) {
  { actuator.next() } -> std::same_as<std::optional<JointSample>>;
  { view.state() } -> std::same_as<StreamState>;
};

}  // namespace lumo::sense
