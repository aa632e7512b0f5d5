#pragma once

#include "lumo/core/statistics.hpp"
#include "lumo/sense/force/force_baselines.hpp"
#include "lumo/sense/profile/unloaded_reference.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace lumo::sense {

/// Limits of the estimate of latency; chosen on the virtual lab, whose streams are stamped alike.
struct LatencyLimits {
  double most_s = 0.2, step_s = 4e-3;  ///< latencies that are tried
  double gap_s = 0.05;                 ///< over which joints are interpolated
  double noises = 4.0;                 ///< by which light must change from the picture before to the one after
  double apart_s = 1.0;                ///< from one event to the next
  int least_frames = 3, least_events = 3;
  double least_correlation = 0.8;  ///< of light's and torque's change in an event that counts
  double event_sigma_s = 0.02;     ///< standard deviation that one event has at least
  /// What all events of a log may have in common: light and torque do not rise by one law (silicone creeps, small loads
  /// take light and greater ones give it). Logs of the lab without any latency have a mean of −52 to 19 ms.
  double law_sigma_s = 0.03;
  double significant_sigmas = 4.0;  ///< from 0, beyond which a latency is none of chance
};

/// By how much joint samples are stamped later than pictures of the same moment, as contacts show that begin, grow and
/// end.
struct Latency {
  double seconds = 0.0, sigma_s = 0.0;
  int events = 0;               ///< contacts' changes that it is the mean of
  bool is_significant = false;  ///< it is none of chance
};

namespace detail {

/// Changes of light, and where they are great.
struct LightChanges {
  std::vector<std::int64_t> before_ns, after_ns;
  std::vector<double> change_DN;
  std::vector<std::vector<std::size_t>> events;
};

inline LightChanges light_changes(const std::vector<Profile>& profiles, const UnloadedReference& unloaded,
    double delay_s, const LatencyLimits& limits) {
  LightChanges c;
  const auto delay_ns = std::llround(1e9 * delay_s);
  std::vector<double> size;
  for (std::size_t k = 1; k + 1 < profiles.size(); ++k) {
    const Profile &a = profiles[k - 1], &b = profiles[k + 1];
    const bool usable = a.value.size() == unloaded.mean().size() && b.value.size() == a.value.size() &&
                        a.value.allFinite() && b.value.allFinite();
    c.before_ns.push_back(a.stamp_ns - delay_ns);
    c.after_ns.push_back(b.stamp_ns - delay_ns);
    c.change_DN.push_back(usable ? b.value.mean() - a.value.mean() : 0.0);
    size.push_back(std::abs(c.change_DN.back()));
  }
  if (size.empty()) return c;
  const double least = limits.noises * median(size) / half_of_normal;
  for (std::size_t k = 0; k < size.size(); ++k) {
    if (!(size[k] > least)) continue;
    if (c.events.empty() || 1e-9 * double(c.after_ns[k] - c.after_ns[c.events.back().back()]) > limits.apart_s)
      c.events.emplace_back();
    c.events.back().push_back(k);
  }
  return c;
}

/// Latency of the best match of an event, and its correlation; nullopt for the ends of what was tried, or for joints
/// that are not known throughout.
inline std::optional<std::pair<double, double>> event_latency(const LightChanges& c,
    const std::vector<std::size_t>& event, const ContactTorques& torques, const LatencyLimits& limits) {
  constexpr int parts = 8;  // of a picture's time, over which torques are averaged
  const Eigen::Index torque = 2 * torques.joints() - 1;
  const auto steps = int(std::lround(limits.most_s / limits.step_s));
  std::vector<double> match;
  for (int i = -steps; i <= steps; ++i) {
    double products = 0.0, light = 0.0, squares = 0.0;
    for (const std::size_t k : event) {
      double change = 0.0;
      const std::int64_t span = c.after_ns[k] - c.before_ns[k];
      for (int p = 0; p < parts; ++p) {
        const std::int64_t shift = std::llround(1e9 * limits.step_s * i) + span * (2 * p - parts + 1) / (4 * parts);
        const auto a = torques.at(c.before_ns[k] + shift, limits.gap_s),
                   b = torques.at(c.after_ns[k] + shift, limits.gap_s);
        if (!a || !b) return std::nullopt;
        change += ((*b)[torque] - (*a)[torque]) / parts;
      }
      products += change * c.change_DN[k];
      light += c.change_DN[k] * c.change_DN[k];
      squares += change * change;
    }
    match.push_back(std::abs(products) / std::sqrt(std::max(light * squares, 1e-300)));
  }
  const auto best = std::max_element(match.begin(), match.end());
  if (best == match.begin() || best + 1 == match.end()) return std::nullopt;
  const double before = *(best - 1), after = *(best + 1), bend = before - 2.0 * *best + after;
  const double part = bend < 0.0 ? 0.5 * (before - after) / bend : 0.0;
  return std::pair(limits.step_s * (double(best - match.begin() - steps) + part), *best);
}

}  // namespace detail

/// Light and torque rise and fall together: what shift in time makes their changes most alike, contact by contact.
/// `profiles`: before the reference is subtracted; `frame_delay_s`: of their stamps, as the session states it.
/// `torques`: on the same clock, less the joints' delay. nullopt: too few contacts show it.
inline std::optional<Latency> joint_latency(const std::vector<Profile>& profiles, const UnloadedReference& unloaded,
    const ContactTorques& torques, double frame_delay_s = 0.0, const LatencyLimits& limits = {}) {
  const detail::LightChanges changes = detail::light_changes(profiles, unloaded, frame_delay_s, limits);
  std::vector<double> found;
  for (const auto& event : changes.events) {
    if (int(event.size()) < limits.least_frames) continue;
    const auto at = detail::event_latency(changes, event, torques, limits);
    if (at && at->second >= limits.least_correlation) found.push_back(at->first);
  }
  if (int(found.size()) < limits.least_events) return std::nullopt;
  Latency l;
  l.events = int(found.size());
  for (const double f : found) l.seconds += f / double(found.size());
  double squares = 0.0;
  for (const double f : found) squares += std::pow(f - l.seconds, 2);
  const double scatter = std::max(std::sqrt(squares / double(found.size() - 1)), limits.event_sigma_s);
  l.sigma_s = std::hypot(scatter / std::sqrt(double(found.size())), limits.law_sigma_s);
  l.is_significant = std::abs(l.seconds) > limits.significant_sigmas * l.sigma_s;
  return l;
}

}  // namespace lumo::sense
