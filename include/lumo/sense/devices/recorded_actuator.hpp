#pragma once

#include "lumo/sense/devices/actuator.hpp"

#include <utility>
#include <vector>

namespace lumo::sense {

/// Joint samples that are in memory, given as fast as they are asked for. `read_joint_log` (sense/log.hpp) reads them
/// from a file.
class RecordedActuator {
 public:
  explicit RecordedActuator(std::vector<JointSample> samples) : samples_(std::move(samples)) {}

  std::optional<JointSample> next() {
    return next_ == samples_.size() ? std::nullopt : std::optional<JointSample>(samples_[next_++]);
  }
  StreamState state() const { return next_ == samples_.size() ? StreamState::ended : StreamState::open; }

 private:
  std::vector<JointSample> samples_;
  std::size_t next_ = 0;
};

static_assert(Actuator<RecordedActuator>);

}  // namespace lumo::sense
