#pragma once

#include "lumo/sense/devices/device.hpp"

#include <cmath>
#include <istream>
#include <sstream>
#include <string>

namespace own {

//! [actuator]
/// One joint from a text, a line for each sample: time_s position_rad velocity_rad_per_s current_A.
class TextActuator {
 public:
  explicit TextActuator(std::istream& in) : in_(&in) {}

  std::optional<lumo::sense::JointSample> next() {
    if (state_ != lumo::sense::StreamState::open) return std::nullopt;
    std::string line;
    if (!std::getline(*in_, line)) return state_ = lumo::sense::StreamState::ended, std::nullopt;
    std::istringstream words(line);
    double time_s = 0.0, position = 0.0, velocity = 0.0, current = 0.0;
    if (!(words >> time_s >> position >> velocity >> current))
      return state_ = lumo::sense::StreamState::failed, std::nullopt;
    lumo::sense::JointSample sample;
    sample.stamp_ns = std::int64_t(std::llround(1e9 * time_s));
    sample.position_rad = lumo::sense::JointVector::Constant(1, position);
    sample.velocity_rad_per_s = lumo::sense::JointVector::Constant(1, velocity);
    sample.effort = lumo::sense::JointVector::Constant(1, current);
    sample.unit = lumo::sense::Effort::current_A;
    return sample;
  }
  lumo::sense::StreamState state() const { return state_; }

 private:
  std::istream* in_;
  lumo::sense::StreamState state_ = lumo::sense::StreamState::open;
};

static_assert(lumo::sense::Actuator<TextActuator>);
//! [actuator]

}  // namespace own
