#pragma once

#include "lumo/core/error.hpp"
#include "lumo/sense/recording/session.hpp"
#include "lumo/sense/recording/tables.hpp"

#include <cstddef>
#include <string>
#include <vector>

namespace lumo::sense {

/// A log's session and tables; the pictures stay in their files. A table that is absent is empty.
struct Recording {
  std::string path;  ///< of the folder, or of the MCAP file
  Session session;
  std::vector<FrameRecord> frames;
  std::vector<JointSample> joints;
  std::vector<WrenchSample> wrenches;
  std::vector<MarkerSample> markers;
  std::vector<PhotodiodeSample> photodiodes;
};

/// Throws InputError if session and tables do not match: currents need a torque constant for each joint.
inline void validate(const Recording& log) {
  if (log.joints.empty() || log.joints.front().unit == Effort::torque_Nm) return;
  const auto joints = std::size_t(log.joints.front().effort.size());
  if (log.session.torque_constant_Nm_per_A.size() != joints)
    throw InputError(message(log.path, ": has currents of ", joints, " joints, its session ",
        log.session.torque_constant_Nm_per_A.size(), " torque constants"));
}

}  // namespace lumo::sense
