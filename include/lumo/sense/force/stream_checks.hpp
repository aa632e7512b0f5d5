#pragma once

#include "lumo/core/statistics.hpp"
#include "lumo/sense/force/frame_estimate.hpp"
#include "lumo/sense/joints/contact_jacobian.hpp"
#include "lumo/sense/joints/planar_finger.hpp"
#include "lumo/sense/profile/unloaded_reference.hpp"
#include "lumo/sense/recording/log_truth.hpp"
#include "lumo/sense/recording/recording.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <optional>
#include <span>
#include <utility>
#include <vector>

namespace lumo::sense {

// Streams of one log are checked against each other: what no finger does is a wrong sign, order, unit or reference.

/// Limits of these checks; chosen on clean logs of the virtual lab, where none of them is met.
struct StreamCheckLimits {
  // Reference
  int smoothing = 5;            ///< values of a profile that are averaged first
  double darker_noises = 8.0;   ///< by which a place must be darker than the reference …
  double darker_share = 0.1;    ///< … and this share of its light
  double darker_frames = 0.03;  ///< share of all frames for which that holds at about one place
  double one_place_m = 6.0_mm;  ///< half width of "about one place"
  int least_darker = 10;        ///< frames
  // Torques
  double sure = 0.9;               ///< probability of a contact that the pictures see
  int least_contacts = 20;         ///< frames with one
  double torque_noises = 5.0;      ///< by which torques must be on the wrong side (median over contacts) …
  double least_torque_Nm = 0.02;   ///< … and this much
  double one_sign = 0.8;           ///< share of the contacts for which they are
  double better_order = 0.5;       ///< of the misfit, to which another order of the joints must bring it
  double mirrored = -0.5;          ///< correlation of places by torque and by light, below which one is mirrored
  double least_spread_m = 5.0_mm;  ///< of the places touched, that shows a mirrored one
  // Joints
  int least_free = 30;              ///< frames that the pictures see free
  double free_torque_noises = 8.0;  ///< of their median, by which torques must be off 0 there …
  double free_torque_Nm = 0.2;      ///< … and this much: beyond what sticks in a joint
  // Force sensor
  double least_force_N = 2.0;  ///< from which torque over force is a place
  double wrong_force_N = 0.5;  ///< on the wrong side, in holds (median)
  double wrong_scale = 2.0;    ///< of torques over force and place, or its inverse: no friction makes as much
};

/// Frames in which the finger is darker at one place than in its reference, while no other place is brighter by as
/// much: the reference was touched there.
struct TouchedReference {
  double y_m = 0.0;
  double darker_DN = 0.0;  ///< median over those frames
  int frames = 0, of = 0;
};

/// nullopt: nothing speaks against the reference. `profiles`: of the whole log, before the reference is subtracted.
/// Lamps that dim as a whole do not count.
inline std::optional<TouchedReference> touched_reference(const std::vector<Profile>& profiles,
    const Eigen::VectorXd& position_m, const UnloadedReference& unloaded, const StreamCheckLimits& limits = {}) {
  const Eigen::VectorXd& mean = unloaded.mean();
  const Eigen::VectorXd noise = unloaded.noise();
  const Eigen::Index n = mean.size(), half = limits.smoothing / 2;
  if (n <= 2 * half || position_m.size() != n) return std::nullopt;
  const auto smooth = [&](const Eigen::VectorXd& v, Eigen::Index i) {
    return v.segment(i - half, 2 * half + 1).mean();
  };
  std::vector<std::pair<double, double>> darker;  // place, by how much
  for (const Profile& p : profiles) {
    if (p.value.size() != n || !p.value.allFinite()) continue;
    const Eigen::VectorXd ratio = p.value.cwiseQuotient(mean.cwiseMax(1e-9));
    const double lamps = std::min(1.0, quantile({ratio.data(), ratio.data() + n}, 0.9));
    const Eigen::VectorXd change = p.value - lamps * mean;
    double least = 0.0, most = 0.0;
    Eigen::Index at = half;
    for (Eigen::Index i = half; i < n - half; ++i) {
      const double c = smooth(change, i);
      if (c < least) {
        least = c;
        at = i;
      }
      most = std::max(most, c);
    }
    const double enough = std::max(limits.darker_noises * smooth(noise, at), limits.darker_share * smooth(mean, at));
    if (-least > enough + most) darker.emplace_back(position_m[at], -least);
  }
  if (darker.empty()) return std::nullopt;
  std::vector<double> place, by;
  for (const auto& d : darker) place.push_back(d.first);
  const double middle = median(place);
  for (const auto& d : darker)
    if (std::abs(d.first - middle) <= limits.one_place_m) by.push_back(d.second);
  if (int(by.size()) < limits.least_darker || double(by.size()) < limits.darker_frames * double(profiles.size()) ||
      2 * by.size() < darker.size())
    return std::nullopt;
  return TouchedReference{middle, median(by), int(by.size()), int(profiles.size())};
}

/// What torques say of the contacts that the pictures see.
struct TorqueAgreement {
  int contacts = 0;               ///< frames with one
  std::vector<int> reversed;      ///< joints whose torque falls in contacts, which no push makes
  std::vector<int> better_order;  ///< of the joints, to which the torques fit better than to the one given; empty: none
  bool mirrored = false;          ///< places by torque run against places by light
};

namespace detail {

/// A frame with one sure contact: angles, contact torques, place.
struct SeenContact {
  JointVector position_rad, torque_Nm;
  double y_m;
};

inline std::vector<SeenContact> seen_contacts(
    std::span<const FrameEstimate> estimates, const StreamCheckLimits& limits) {
  std::vector<SeenContact> list;
  for (const FrameEstimate& e : estimates)
    if (const auto at = e.contact(); at && e.joints && e.location.probability > limits.sure) {
      const Eigen::Index n = e.joints->size() / 2;
      list.push_back({e.joints->head(n), e.joints->tail(n), at->y_m});
    }
  return list;
}

/// Sum of squares that one push at the place seen leaves of the torques, with the joints in an order.
template <ContactJacobian J>
double misfit(const J& jacobian, int link, const std::vector<SeenContact>& contacts, const std::vector<int>& order) {
  double sum = 0.0;
  for (const SeenContact& c : contacts) {
    JointVector q = c.position_rad, t = c.torque_Nm;
    for (std::size_t j = 0; j < order.size(); ++j) {
      q[Eigen::Index(j)] = c.position_rad[order[j]];
      t[Eigen::Index(j)] = c.torque_Nm[order[j]];
    }
    const JointVector a = jacobian.column(q, {link, c.y_m});
    const double force = std::max(0.0, a.dot(t) / std::max(a.squaredNorm(), 1e-12));
    sum += (t - force * a).squaredNorm();
  }
  return sum;
}

inline double correlation(const std::vector<double>& a, const std::vector<double>& b) {
  const auto n = Eigen::Index(a.size());
  const Eigen::VectorXd x = Eigen::Map<const Eigen::VectorXd>(a.data(), n).array() -
                            std::accumulate(a.begin(), a.end(), 0.0) / double(n),
                        y = Eigen::Map<const Eigen::VectorXd>(b.data(), n).array() -
                            std::accumulate(b.begin(), b.end(), 0.0) / double(n);
  return x.dot(y) / std::max(x.norm() * y.norm(), 1e-300);
}

}  // namespace detail

/// Compares torques with the contacts that the pictures see. `noise_Nm`: of one torque. Two joints or more tell order
/// and direction, too.
template <ContactJacobian J> TorqueAgreement torque_agreement(std::span<const FrameEstimate> estimates,
    const J& jacobian, const PadRange& range, double noise_Nm, const StreamCheckLimits& limits = {}) {
  const std::vector<detail::SeenContact> contacts = detail::seen_contacts(estimates, limits);
  TorqueAgreement r;
  r.contacts = int(contacts.size());
  if (r.contacts < limits.least_contacts) return r;
  const int joints = jacobian.joints();
  for (int j = 0; j < joints; ++j) {
    std::vector<double> torque;
    int wrong = 0;
    for (const detail::SeenContact& c : contacts) {
      const double arm = jacobian.column(c.position_rad, {range.link, c.y_m})[j];
      torque.push_back(arm < 0.0 ? -c.torque_Nm[j] : c.torque_Nm[j]);
      wrong += torque.back() < 0.0;
    }
    if (median(torque) < -std::max(limits.torque_noises * noise_Nm, limits.least_torque_Nm) &&
        wrong >= limits.one_sign * r.contacts)
      r.reversed.push_back(j);
  }
  if (joints < 2 || !r.reversed.empty()) return r;
  std::vector<int> order(std::size_t(joints), 0);
  std::iota(order.begin(), order.end(), 0);
  const double given = detail::misfit(jacobian, range.link, contacts, order);
  double least = std::max(limits.better_order * given, noise_Nm * noise_Nm * double(joints * r.contacts));
  constexpr int most_joints = 4;  // 24 orders
  while (joints <= most_joints && std::next_permutation(order.begin(), order.end()))
    if (const double m = detail::misfit(jacobian, range.link, contacts, order); m < least && m < given) {
      least = m;
      r.better_order = order;
    }
  if (!r.better_order.empty()) return r;
  std::vector<double> light, torque;
  for (const detail::SeenContact& c : contacts)
    if (const TorqueOnlySolution s =
            solve_torque_only(jacobian, c.position_rad, c.torque_Nm, range, std::max(noise_Nm, 1e-6));
        s.rank == 2) {
      light.push_back(c.y_m);
      torque.push_back(s.y_m);
    }
  if (int(light.size()) >= limits.least_contacts && quantile(light, 0.9) - quantile(light, 0.1) > limits.least_spread_m)
    r.mirrored = detail::correlation(light, torque) < limits.mirrored;
  return r;
}

/// Torque of the pad's joint in frames after `after_ns` that the pictures see free [N·m, median], where it is no noise:
/// then its friction, weight and offset were learnt in a contact, or something touches what the pictures do not see.
/// nullopt: it is noise, or there are too few such frames.
template <ContactJacobian J> std::optional<double> torque_without_contact(std::span<const FrameEstimate> estimates,
    const J& jacobian, double noise_Nm, std::int64_t after_ns, const StreamCheckLimits& limits = {}) {
  std::vector<double> torque;
  int positive = 0;
  for (const FrameEstimate& e : estimates)
    if (e.stamp_ns > after_ns && e.joints && e.location.contacts == 0 && !e.location.unknown &&
        e.location.probability > limits.sure) {
      torque.push_back((*e.joints)[2 * jacobian.joints() - 1]);
      positive += torque.back() > 0.0;
    }
  if (int(torque.size()) < limits.least_free) return std::nullopt;
  const double middle = median(torque), share = double(positive) / double(torque.size());
  const double noise = noise_Nm / std::sqrt(double(torque.size()));
  const bool far = std::abs(middle) > std::max(limits.free_torque_noises * noise, limits.free_torque_Nm);
  return far && std::max(share, 1.0 - share) > limits.one_sign ? std::optional(middle) : std::nullopt;
}

/// What a force sensor makes of one joint's torque: torque over force is the contact's distance from the joint.
struct SensorAgreement {
  bool mirrored = false;  ///< places by torque run against places by light, as where the view is mirrored
  double scale = 1.0;     ///< of the torques, where they are out of all proportion to force and place (median); 1: not
};

/// `joint`: where the finger is. For the sensor's sign see force_falls_in_contacts.
inline SensorAgreement sensor_agreement(std::span<const FrameEstimate> estimates, const MomentArm& joint,
    const Session& session, const std::vector<WrenchSample>& wrenches, const StreamCheckLimits& limits = {}) {
  SensorAgreement r;
  if (wrenches.empty()) return r;
  const TimeSeries force = normal_force(wrenches, session.wrench_clock, force_tare_N(session, wrenches));
  std::vector<double> light, arm_m, scale;
  for (const FrameEstimate& e : estimates)
    if (const auto at = e.contact(); at && e.joints && e.joints->size() == 2 && e.location.probability > limits.sure)
      if (const auto f = force.at(e.stamp_ns, LogTruth::max_gap_s); f && (*f)[0] > limits.least_force_N) {
        light.push_back(at->y_m);
        arm_m.push_back((*e.joints)[1] / (*f)[0]);
        scale.push_back(arm_m.back() / (joint.joint_to_origin_m + at->y_m));
      }
  if (int(light.size()) < limits.least_contacts) return r;
  r.mirrored = quantile(light, 0.9) - quantile(light, 0.1) > limits.least_spread_m &&
               detail::correlation(light, arm_m) < limits.mirrored;
  const double middle = median(scale);
  if (std::isfinite(middle) && (middle > limits.wrong_scale || (middle > 0.0 && middle < 1.0 / limits.wrong_scale)))
    r.scale = middle;
  return r;
}

/// The force sensor against contacts that the pictures see: the force falls where they begin. For logs without holds.
inline bool force_falls_in_contacts(std::span<const FrameEstimate> estimates, const Session& session,
    const std::vector<WrenchSample>& wrenches, const StreamCheckLimits& limits = {}) {
  if (wrenches.empty()) return false;
  const TimeSeries force = normal_force(wrenches, session.wrench_clock);
  std::vector<double> touched, free;
  for (const FrameEstimate& e : estimates)
    if (const auto f = force.at(e.stamp_ns, LogTruth::max_gap_s); f && e.location.probability > limits.sure)
      (e.location.contacts > 0 ? touched : free).push_back((*f)[0]);
  return int(touched.size()) >= limits.least_contacts && int(free.size()) >= limits.least_contacts &&
         median(touched) - median(free) < -limits.wrong_force_N;
}

}  // namespace lumo::sense
