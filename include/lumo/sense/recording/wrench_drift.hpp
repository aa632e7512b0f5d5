#pragma once

#include "lumo/core/statistics.hpp"
#include "lumo/core/types.hpp"
#include "lumo/sense/recording/session.hpp"
#include "lumo/sense/recording/tables.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace lumo::sense {

/// Limits of what is taken for a force sensor's drift; chosen on the virtual lab, whose sensor does not drift.
struct DriftLimits {
  std::size_t least_samples = 5;  ///< of a tare
  double least_N = 0.15;          ///< by which a tare must be off the middle one …
  double sigmas = 6.0;            ///< … and so many of its own errors
};

/// What a force sensor reads without load.
struct WrenchTare {
  std::int64_t stamp_ns = 0;  ///< middle, on the frames' clock
  Vec3d force_N{0.0, 0.0, 0.0}, torque_Nm{0.0, 0.0, 0.0};
  double sigma_N = 0.0;  ///< of the normal force's mean
};

namespace detail {

/// Stretches in which a session says that the force sensor has no load. What lies before an approach may be one, or the
/// end of another contact.
inline std::vector<Segment> without_load(const Session& session) {
  std::vector<Segment> list;
  for (const Segment& g : session.segments)
    if (g.is_without_contact()) list.push_back(g);
  std::sort(list.begin(), list.end(),
      [](const Segment& a, const Segment& b) { return a.from_ns + a.to_ns < b.from_ns + b.to_ns; });
  return list;
}

inline std::optional<WrenchTare> tare_of(const Segment& segment, const Session& session,
    const std::vector<WrenchSample>& wrenches, std::size_t least_samples) {
  WrenchTare tare;
  double squares = 0.0;
  std::size_t count = 0;
  for (const WrenchSample& w : wrenches) {
    if (!segment.holds(session.wrench_clock(w.stamp_ns))) continue;
    const double off = w.force_N.z() - tare.force_N.z();
    ++count;
    tare.force_N += (w.force_N - tare.force_N) / double(count);
    tare.torque_Nm += (w.torque_Nm - tare.torque_Nm) / double(count);
    squares += off * (w.force_N.z() - tare.force_N.z());
  }
  if (count < std::max<std::size_t>(least_samples, 2)) return std::nullopt;
  tare.stamp_ns = segment.from_ns / 2 + segment.to_ns / 2;
  tare.sigma_N = std::sqrt(squares / double(count - 1) / double(count));
  return tare;
}

}  // namespace detail

/// The tares of a log, in the order of time.
inline std::vector<WrenchTare> wrench_tares(
    const Session& session, const std::vector<WrenchSample>& wrenches, const DriftLimits& limits = {}) {
  std::vector<WrenchTare> list;
  for (const Segment& g : detail::without_load(session))
    if (const auto tare = detail::tare_of(g, session, wrenches, limits.least_samples);
        tare && (list.empty() || tare->stamp_ns > list.back().stamp_ns))
      list.push_back(*tare);
  return list;
}

/// Takes a force sensor's drift out of its samples, by straight lines from tare to tare; what is left has one tare, the
/// mean of all. Returns the greatest distance of a tare from the middle one [N]; nullopt, with all samples as they
/// were, if none is off by more than noise makes.
inline std::optional<double> remove_wrench_drift(
    std::vector<WrenchSample>& wrenches, const Session& session, const DriftLimits& limits = {}) {
  const std::vector<WrenchTare> tares = wrench_tares(session, wrenches, limits);
  if (tares.size() < 2) return std::nullopt;
  std::vector<double> normal;
  WrenchTare mean;
  for (const WrenchTare& t : tares) {
    normal.push_back(t.force_N.z());
    mean.force_N += t.force_N / double(tares.size());
    mean.torque_Nm += t.torque_Nm / double(tares.size());
  }
  const double middle = median(normal);
  double most = 0.0;
  bool drifts = false;
  for (const WrenchTare& t : tares) {
    const double off = std::abs(t.force_N.z() - middle);
    most = std::max(most, off);
    drifts = drifts || off > std::max(limits.least_N, limits.sigmas * t.sigma_N);
  }
  if (!drifts) return std::nullopt;
  for (WrenchSample& w : wrenches) {
    const std::int64_t at = session.wrench_clock(w.stamp_ns);
    const auto after = std::lower_bound(
        tares.begin(), tares.end(), at, [](const WrenchTare& t, std::int64_t stamp) { return t.stamp_ns < stamp; });
    const WrenchTare &b = after == tares.end() ? tares.back() : *after, &a = after == tares.begin() ? b : *(after - 1);
    const double share = a.stamp_ns == b.stamp_ns || after == tares.end()
                             ? 1.0
                             : double(at - a.stamp_ns) / double(b.stamp_ns - a.stamp_ns);
    w.force_N -= (1.0 - share) * a.force_N + share * b.force_N - mean.force_N;
    w.torque_Nm -= (1.0 - share) * a.torque_Nm + share * b.torque_Nm - mean.torque_Nm;
  }
  return most;
}

}  // namespace lumo::sense
