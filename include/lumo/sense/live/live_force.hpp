#pragma once

#include "lumo/sense/devices/actuator.hpp"
#include "lumo/sense/force/log_estimates.hpp"
#include "lumo/sense/live/live_rest.hpp"

#include <cmath>
#include <cstdint>
#include <string>
#include <utility>

namespace lumo::sense {

/// Where a finger is touched and how hard, as its camera's pictures and its motors' samples come. Both are stamped on
/// the clock of `wait.now_ns`. The first `wait.rest_s` seconds must be without contact, as for locate_live; `joints` is
/// what an earlier run without contact told of them (identify_joints). `told(estimate)` is called for each picture that
/// can be used, and every `wait.patience_s` / 10 where none can, and says whether to go on: lost pictures and samples
/// are states of the estimate, not the end. Ends when camera and motors have. Throws as look_at_rest, and InputError
/// where the motors say nothing during the rest.
template <Camera C, Actuator A, class MakeLocalizer, ContactJacobian J, class Told>
void estimate_forces_live(C& camera, A& actuator, const JointReference& joints, const Session& session,
                          const LongitudinalBins& bins, MakeLocalizer make, const J& jacobian, Told told,
                          const std::string& name, int link = 0, const LiveWait& wait = {}) {
  std::int64_t samples = 0, first = 0, last = 0;
  Effort unit = Effort::torque_Nm;
  const auto drain = [&] {
    for (auto s = actuator.next(); s; s = actuator.next()) {
      if (s->effort.size() != Eigen::Index(joints.torque.size()))
        throw InputError(message("the motors tell of ", s->effort.size(), " joints, the run without contact of ",
                                 joints.torque.size()));
      if (samples++ == 0) first = s->stamp_ns;
      last = s->stamp_ns, unit = s->unit;
    }
  };
  while (actuator.next()) {
  }  // what queued up before is not of this time
  LiveRest rest = look_at_rest(camera, session, bins, wait, name, drain);
  drain();
  if (samples < 2 || last <= first)
    throw InputError(
        message("the motors: ", samples, " samples came while the finger rested; does something command them?"));
  auto localizer = make(rest.readout, rest.unloaded);
  using Estimator = ForceEstimator<C, A, decltype(localizer), GreenProfile, J>;
  const double map_sigma_m = std::sqrt(rest.view.leds.map.variance_m2(0.0));
  auto config = force_config<Estimator>(joints, session, unit, 1e-9 * double(last - first) / double(samples - 1),
                                        rest.trusted.period_s, map_sigma_m, link);
  config.frames = std::move(rest.trusted);
  Estimator estimator(camera, actuator, std::move(rest.readout), std::move(localizer), jacobian,
                      std::move(rest.unloaded), std::move(config));
  std::int64_t picture = estimator.step(wait.now_ns()).frame_stamp_ns, said = wait.now_ns();
  while (camera.state() == StreamState::open || actuator.state() == StreamState::open) {
    const ForceEstimate e = estimator.step(wait.now_ns());
    const bool is_new = e.frame_stamp_ns != picture,
               overdue = 1e-9 * double(wait.now_ns() - said) > 0.1 * wait.patience_s;
    if (is_new || overdue) {
      picture = e.frame_stamp_ns, said = wait.now_ns();
      if (!told(e)) return;
    } else {
      idle();
    }
  }
}

}  // namespace lumo::sense
