#pragma once

#include "lumo/core/statistics.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/force/force_estimator.hpp"
#include "lumo/sense/joints/free_run.hpp"
#include "lumo/sense/joints/joint_reference.hpp"
#include "lumo/sense/joints/planar_finger.hpp"
#include "lumo/sense/localize/bayes_localizer.hpp"
#include "lumo/sense/localize/peak_localizer.hpp"
#include "lumo/sense/localize/template_localizer.hpp"
#include "lumo/sense/profile/finger_view.hpp"
#include "lumo/sense/profile/first_touch.hpp"
#include "lumo/sense/recording/joint_velocity.hpp"
#include "lumo/sense/recording/recording.hpp"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>
#include <vector>

namespace lumo::sense {

/// The optical half of what is known of a finger: all that a location needs.
struct FingerOptics {
  LongitudinalBins bins = LongitudinalBins::uniform(-27.5_mm, 27.5_mm, 55);  ///< of 1 mm, where profiles are read
  FingerView view;             ///< camera's axis map and lit band, from the LEDs in an unloaded picture
  UnloadedReference unloaded;  ///< light at rest and its noise in each bin [DN], from unloaded pictures

  double from_m = -27.5_mm, to_m = 27.5_mm;  ///< where contacts are sought: the paper's 11 regions of 5 mm
  double end_m = 30.0_mm;                    ///< clear ends of the finger of 60 mm mirror a contact's light
  /// How far bumps of light lie from contacts, and how much farther near the ends. Chosen, as `end_m` was, by seeds 1
  /// to 10 of the virtual lab; those seeds do not judge it.
  double bias_sigma_m = 0.75_mm, end_bias_sigma_m = 1.25_mm;

  GreenProfile readout() const { return view.readout(bins); }
  /// Standard deviation of the map from image to finger at the origin [m].
  double map_sigma_m() const { return std::sqrt(view.leds.map.variance_m2(0.0)); }
};

/// The probabilistic localiser for a finger with clear ends. Throws InvalidArgument without view or unloaded pictures.
inline BayesLocalizer bayes_localizer(const FingerOptics& finger) {
  BayesLocalizer::Config c;
  c.position_m = finger.readout().positions_m();
  c.noise = finger.unloaded.noise();
  c.unloaded = finger.unloaded.mean();
  c.from_m = finger.from_m;
  c.to_m = finger.to_m;
  c.bias_sigma_m = finger.bias_sigma_m;
  c.end_m = finger.end_m;
  c.end_bias_sigma_m = finger.end_bias_sigma_m;
  return BayesLocalizer(c);
}

/// The localiser at the brightest place. Throws InvalidArgument without view or unloaded pictures.
inline PeakLocalizer peak_localizer(const FingerOptics& finger) {
  return PeakLocalizer({finger.readout().positions_m(), finger.unloaded.noise()});
}

/// How sure templates are of the pad at hand: computed ones of a pad of this design, or recorded ones of this very pad.
enum class TemplateSource { computed, recorded };

/// Settings of the localiser of a pad whose responses are known; `lamp_m`: where its LEDs are. The scatter at rest is
/// the mean over 9 neighbouring positions: a short unloaded stretch does not tell one position's own. Throws
/// InvalidArgument without view or unloaded pictures, or where these show none of the templates' light.
inline TemplateLocalizer::Config template_config(const FingerOptics& finger, const ResponseTemplates& templates,
    const std::vector<double>& lamp_m, TemplateSource source = TemplateSource::computed) {
  constexpr Eigen::Index neighbours = 4;  // to each side
  TemplateLocalizer::Config c;
  c.position_m = finger.readout().positions_m();
  const Eigen::VectorXd noise = finger.unloaded.noise();
  const Eigen::Index n = noise.size();
  c.noise.resize(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Index from = std::max<Eigen::Index>(0, i - neighbours), to = std::min(n - 1, i + neighbours);
    c.noise[i] = rms(noise.segment(from, to - from + 1));
  }
  c.unloaded = finger.unloaded.mean();
  c.lamp_m = lamp_m;
  c.from_m = finger.from_m;
  c.to_m = finger.to_m;
  c.templates = scaled_to(templates, c.position_m, c.unloaded, lamp_m);
  if (source == TemplateSource::recorded) {
    c.size_sigma = 0.15;
    c.shape_sigma = 0.12;  // places may lie 10 mm apart
    c.pad_sigma_m = 0.2_mm;
  }
  return c;
}

/// What is assumed of a finger's streams and of what sticks in its joints; chosen on the virtual lab.
struct StreamAssumptions {
  double least_scatter = 0.05;  ///< of an effort [A or N·m]: jumps of quieter joints are not watched more closely
  double spike_scatters = 6.0;  ///< a jump of an effort by so many scatters is a fault; noise makes 2 in 10⁹ of them
  double least_standstill_Nm = 5e-3;  ///< that may stick unseen, however quiet the rests were
  double standstill_s = 0.5;          ///< what sticks at rest says nothing of what sticks under the next contact
  double frame_timeout_s = 0.2, frame_timeout_periods = 4.0;    ///< no frame for the longer of both is a fault
  double joint_timeout_s = 0.05, joint_timeout_periods = 10.0;  ///< the same of joint samples
  double joint_gap_s = 0.02, joint_gap_periods = 5.0;  ///< joints are interpolated over at most the longer of both
};

/// All that is known of a finger: what estimates of a recording and of a live run start from.
template <ContactJacobian Jacobian = PlanarFinger> struct FingerModel {
  Session session;        ///< LEDs [m], torque constants [N·m/A], delays [s], clocks; from session.json
  Jacobian jacobian;      ///< geometry of the joints: contact force to motor torque
  int link = 0;           ///< of `jacobian`, the one with the pad
  FingerOptics optics;    ///< known_finger and live runs fill in view and light
  JointReference joints;  ///< friction, weight, offset, noise and what sticks [N·m], from an unloaded run
  StreamAssumptions assumptions;
};

/// The session's finger with parallel joints; view, light and joints are still to be identified. Throws
/// InvalidArgument.
inline FingerModel<> finger_model(const Session& session) {
  PlanarFinger joints(session.joint_to_joint_m, session.joint_to_origin_m);
  const int link = joints.pad_link();
  return {session, std::move(joints), link, {}, {}, {}};
}

/// Periods of a finger's streams, and the unit of its efforts.
struct StreamRates {
  double frame_period_s = FrameMonitor::Config{}.period_s;
  double joint_period_s = JointMonitor::Config{}.period_s;
  Effort unit = Effort::torque_Nm;
};

/// Of a recording with at least two joint samples.
inline StreamRates stream_rates(std::span<const FrameRecord> frames, std::span<const JointSample> samples) {
  StreamRates rates;
  rates.unit = samples.front().unit;
  rates.joint_period_s = stream_period_s(samples);
  if (frames.size() > 1) rates.frame_period_s = stream_period_s(frames);
  return rates;
}

/// Whether somebody said when the finger was without contact: by segments, or by a chosen stretch.
inline bool is_stated(const Session& session, const UnloadedStretch& rest) {
  return rest.chosen || std::any_of(session.segments.begin(), session.segments.end(),
                            [](const Segment& g) { return g.is_without_contact(); });
}

/// The stretch that joints are learnt from: `rest`, or where nobody said when the finger was free up to shortly before
/// the first contact that `profiles` show, or that the session names.
inline UnloadedStretch joint_stretch(const Session& session, const UnloadedStretch& rest,
    const std::vector<Profile>& profiles, const UnloadedReference& unloaded) {
  if (is_stated(session, rest)) return rest;
  UnloadedStretch longer = rest;
  longer.to_ns = std::max(rest.to_ns, untouched_until_ns(profiles, unloaded));
  for (const Segment& g : session.segments)
    if (g.from_ns > rest.to_ns) longer.to_ns = std::min(longer.to_ns, g.from_ns);
  return longer;
}

/// A recording's joint samples, stamped on the frames' clock. Velocities that do not fit the positions are taken from
/// these (mend_velocities). Throws InputError for positions in degrees.
inline std::vector<JointSample> on_frames_clock(const Recording& recording) {
  std::vector<JointSample> samples = recording.joints;
  for (JointSample& s : samples) s.stamp_ns = recording.session.joint_clock(s.stamp_ns);
  try {
    mend_velocities(samples);
  } catch (const InvalidArgument& e) {
    throw InputError(message(recording.path, ": ", e.what()));
  }
  return samples;
}

/// The samples of a recording, on the frames' clock, that are without contact.
struct UntouchedSamples {
  /// Up to the end of the unloaded stretch. Where contacts came before, or the stretch was chosen, nothing is assumed
  /// of what lies between: then only those in the stretch and in segments that say so (unloaded, dark, free).
  std::vector<JointSample> first;
  /// In segments after that. They do not enter the joints' model: a joint sticks otherwise after each contact, and a
  /// mean over many rests is farther off the next one (lab: 2.2 against 1.4 N).
  std::vector<JointSample> later;
};
inline UntouchedSamples samples_without_contact(const Recording& recording, const UnloadedStretch& rest) {
  const std::vector<Segment>& segments = recording.session.segments;
  const bool after_contact = rest.chosen || std::any_of(segments.begin(), segments.end(), [&](const Segment& g) {
    return !g.is_without_contact() && g.from_ns < rest.to_ns;
  });
  UntouchedSamples untouched;
  for (JointSample& s : on_frames_clock(recording)) {
    const bool stated = rest.holds(s.stamp_ns) || std::any_of(segments.begin(), segments.end(), [&](const Segment& g) {
      return g.is_without_contact() && g.holds(s.stamp_ns);
    });
    if (s.stamp_ns > rest.to_ns) {
      if (stated) untouched.later.push_back(std::move(s));
    } else if (stated || !after_contact) {
      untouched.first.push_back(std::move(s));
    }
  }
  return untouched;
}

/// What a recording's samples without contact show of the finger's joints. Where nobody said when these were, what is
/// far off the rest of them is left out. Throws InputError if there are none, or of other joints than the session's.
inline JointReference unloaded_joints(const Recording& recording, const UnloadedStretch& rest) {
  const Session& session = recording.session;
  require_readable(recording, LogStream::joints);
  if (recording.joints.empty())
    throw InputError(recording.path + ": has no joint samples (joint.csv) to estimate a force from");
  const int joints = PlanarFinger(session.joint_to_joint_m, session.joint_to_origin_m).joints();
  if (recording.joints.front().effort.size() != joints)
    throw InputError(message(recording.path, ": the session describes ", joints, joints == 1 ? " joint" : " joints",
        " (joint_to_joint_mm), the samples have ", recording.joints.front().effort.size()));
  UntouchedSamples untouched = samples_without_contact(recording, rest);
  FreeRun free{std::move(untouched.first)};
  if (free.samples.empty()) throw InputError(recording.path + ": has no joint samples of the finger without contact");
  if (!is_stated(session, rest)) free = free_run(free.samples, session.torque_constant_Nm_per_A);
  JointReference reference = identify_joints(free.samples, session.torque_constant_Nm_per_A, {}, untouched.later);
  reference.left_out = free.left_out;
  return reference;
}

/// Settings of the force estimator of a finger whose joints were identified. One limit on jumps holds for all joints,
/// that of the one that scatters most.
template <ContactJacobian J> ForceEstimatorConfig force_config(const FingerModel<J>& finger, const StreamRates& rates) {
  const StreamAssumptions& assumed = finger.assumptions;
  const JointReference& joints = finger.joints;
  ForceEstimatorConfig config;
  config.torque = joints.torque;
  config.filter.link = finger.link;
  config.joints.joints = int(joints.torque.size());
  config.joints.period_s = rates.joint_period_s;
  double scatter = assumed.least_scatter, quietest = config.joints.max_effort;
  for (const TorqueModel& m : joints.torque) {
    const double noise =
        rates.unit == Effort::current_A ? std::abs(m.noise_Nm / m.torque_constant_Nm_per_A) : m.noise_Nm;
    scatter = std::max(scatter, noise);
    quietest = std::min(quietest, noise);
  }
  config.joints.quantum = std::min(joints.effort_step, config.joints.max_effort);
  config.joints.noise = quietest;
  config.joints.spike = assumed.spike_scatters * scatter;
  config.frames.period_s = rates.frame_period_s;
  config.filter.torque_bias_Nm = assumed.least_standstill_Nm;
  for (const double stuck : joints.standstill_Nm)
    config.filter.torque_bias_Nm = std::max(config.filter.torque_bias_Nm, stuck);
  config.filter.torque_bias_s = assumed.standstill_s;
  config.frame_delay_s = finger.session.frame_delay_s;
  config.joint_delay_s = finger.session.joint_delay_s;
  config.frame_timeout_s = std::max(assumed.frame_timeout_s, assumed.frame_timeout_periods * rates.frame_period_s);
  config.joint_timeout_s = std::max(assumed.joint_timeout_s, assumed.joint_timeout_periods * rates.joint_period_s);
  config.map_sigma_m = finger.optics.map_sigma_m();
  return config;
}

}  // namespace lumo::sense
