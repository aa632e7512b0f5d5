#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/statistics.hpp"
#include "lumo/core/types.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/recording/alignment.hpp"
#include "lumo/sense/recording/log_truth.hpp"
#include "lumo/sense/recording/session.hpp"
#include "lumo/sense/recording/tables.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <tuple>
#include <utility>
#include <vector>

namespace lumo::sense {

/// Frames of one branch of a cycle, in any order.
struct CycleBranch {
  Eigen::VectorXd load_N;   ///< measured at each frame
  Eigen::MatrixXd profile;  ///< channels × frames [DN]

  bool covers(double at_N) const { return load_N.size() > 0 && load_N.minCoeff() <= at_N && at_N <= load_N.maxCoeff(); }
};

/// One cycle within maintained contact.
struct LoadCycle {
  CycleBranch loading, unloading;

  bool covers(double at_N) const { return loading.covers(at_N) && unloading.covers(at_N); }
};

/// The measured cycles of one contact; conditioning cycles are not among them.
using CycleRun = std::vector<LoadCycle>;

/// Loads at which cycles are compared: from_N, from_N + step_N, … to_N. Source: see cycle_variation.
struct CycleLoads {
  double from_N = 3.0, to_N = 14.0, step_N = 0.5;
};

/// How well cycles within maintained contact repeat.
struct CycleVariation {
  double W_cycle_DN = 0.0;
  double from_N = 0.0, to_N = 0.0;  ///< stretch of loads that was compared
  int runs = 0;                     ///< with two cycles at one of these loads
};

/// Profile of a branch at a load, on the line between the two frames whose loads enclose it most closely: measured
/// loads scatter, so that those of neighbouring frames need not ascend. nullopt for loads beyond all frames.
inline std::optional<Eigen::VectorXd> profile_at(const CycleBranch& branch, double load_N) {
  if (!branch.covers(load_N)) return std::nullopt;
  const Eigen::VectorXd& load = branch.load_N;
  Eigen::Index below = 0, above = 0;
  load.minCoeff(&below);
  load.maxCoeff(&above);
  for (Eigen::Index i = 0; i < load.size(); ++i) {
    if (load[i] <= load_N && load[i] > load[below]) below = i;
    if (load[i] >= load_N && load[i] < load[above]) above = i;
  }
  const double apart = load[above] - load[below], share = apart > 0.0 ? (load_N - load[below]) / apart : 0.0;
  return Eigen::VectorXd((1.0 - share) * branch.profile.col(below) + share * branch.profile.col(above));
}

namespace detail {

/// Throws InvalidArgument.
inline void validate_cycles(const std::vector<CycleRun>& runs, const CycleLoads& loads) {
  require_in_range("first load of the cycles", loads.from_N, 0.0, 1e6, "N");
  require_in_range("last load of the cycles", loads.to_N, loads.from_N, 1e6, "N");
  require_in_range("step of the cycles' loads", loads.step_N, 1e-3, 1e6, "N");
  std::optional<Eigen::Index> channels;
  for (const CycleRun& run : runs)
    for (const LoadCycle& cycle : run)
      for (const CycleBranch* branch : {&cycle.loading, &cycle.unloading}) {
        if (branch->load_N.size() == 0) continue;
        if (!channels) channels = branch->profile.rows();
        if (branch->profile.rows() != *channels || *channels < 1 || branch->profile.cols() != branch->load_N.size())
          throw InvalidArgument(
              message("cycle variation: a branch has ", branch->profile.rows(), " channels × ", branch->profile.cols(),
                  " frames and ", branch->load_N.size(), " loads, the first ", *channels, " channels"));
        if (!branch->profile.allFinite() || !branch->load_N.allFinite())
          throw InvalidArgument("cycle variation: profiles and loads must be finite");
      }
  if (!channels) throw InvalidArgument("cycle variation: no cycles");
}

/// The longest stretch of the loads of which each lies within both branches of at least half of all cycles; of equally
/// long ones the lowest. Throws InvalidArgument for none.
inline std::vector<double> common_stretch(const std::vector<CycleRun>& runs, const CycleLoads& loads) {
  std::size_t cycles = 0;
  for (const CycleRun& run : runs) cycles += run.size();
  std::vector<double> stretch, longest;
  const auto last = std::lround(std::floor((loads.to_N - loads.from_N) / loads.step_N + 1e-9));
  for (long k = 0; k <= last; ++k) {
    const double load = loads.from_N + double(k) * loads.step_N;
    std::size_t covered = 0;
    for (const CycleRun& run : runs)
      for (const LoadCycle& cycle : run) covered += cycle.covers(load) ? 1 : 0;
    if (2 * covered >= cycles) stretch.push_back(load);
    else stretch.clear();
    if (stretch.size() > longest.size()) longest = stretch;
  }
  if (longest.empty())
    throw InvalidArgument(message("cycle variation: at no load from ", loads.from_N, " to ", loads.to_N,
        " N do half of the ", cycles, " cycles have frames below and above, on both branches"));
  return longest;
}

/// Median over the cycles that reach this load on this branch; nullopt for fewer than two: one is its own median.
inline std::optional<double> cell_variation(const CycleRun& run, CycleBranch LoadCycle::*branch, double load_N) {
  std::vector<Eigen::VectorXd> reached;
  for (const LoadCycle& cycle : run)
    if (auto p = profile_at(cycle.*branch, load_N)) reached.push_back(*std::move(p));
  if (reached.size() < 2) return std::nullopt;
  Eigen::MatrixXd profile(reached.front().size(), Eigen::Index(reached.size()));
  for (std::size_t c = 0; c < reached.size(); ++c) profile.col(Eigen::Index(c)) = reached[c];
  const Eigen::VectorXd middle = pointwise_median(profile);
  std::vector<double> deviation;
  for (const Eigen::VectorXd& p : reached) deviation.push_back(rms(p - middle));
  return median(deviation);
}

}  // namespace detail

/// W_cycle: at each load and branch the RMS of each cycle to the pointwise median cycle of its run, median over cycles,
/// then over all loads and both branches of a run, then over runs. A constant unloaded profile drops out. The loads are
/// those of `loads` that half of this recording's cycles cover; the authors cut them by the cycles of all morphologies,
/// so that two pads are compared as they are where both runs report the same stretch. Noise of single frames is part of
/// it: profiles are not averaged over time. Throws InvalidArgument for no cycles, shapes that differ, or no common
/// load. Source: the authors' public code (dokkev/fingertip-design-framework, experiments/analysis,
/// contact_history.py); the paper says "matched-force variation across cycles".
inline CycleVariation cycle_variation(const std::vector<CycleRun>& runs, const CycleLoads& loads = {}) {
  detail::validate_cycles(runs, loads);
  const std::vector<double> stretch = detail::common_stretch(runs, loads);
  std::vector<double> of_runs;
  for (const CycleRun& run : runs) {
    std::vector<double> cells;
    for (const double load : stretch)
      for (const auto branch : {&LoadCycle::loading, &LoadCycle::unloading})
        if (const auto v = detail::cell_variation(run, branch, load)) cells.push_back(*v);
    if (!cells.empty()) of_runs.push_back(median(std::move(cells)));
  }
  if (of_runs.empty()) throw InvalidArgument("cycle variation: no run has two cycles");
  const int count = int(of_runs.size());
  return {median(std::move(of_runs)), stretch.front(), stretch.back(), count};
}

/// Cycles as a log has them.
struct LoggedCycles {
  std::vector<CycleRun> runs;
  int lost = 0;  ///< runs left out because the contact was lost in them
};

namespace detail {

/// The frames of a segment and the loads measured there, parted where the load is greatest.
inline LoadCycle logged_cycle(
    std::span<const Profile> profiles, const Segment& segment, const TimeSeries& force, double frame_delay_s) {
  std::vector<const Profile*> frames;
  std::vector<double> load_N;
  for (const Profile& p : profiles)
    if (segment.holds(p.stamp_ns))
      if (const auto f = force.at(p.stamp_ns - std::llround(1e9 * frame_delay_s), LogTruth::max_gap_s)) {
        frames.push_back(&p);
        load_N.push_back((*f)[0]);
      }
  if (frames.empty()) return {};
  const auto peak = std::size_t(std::max_element(load_N.begin(), load_N.end()) - load_N.begin());
  const auto part = [&](std::size_t from, std::size_t to) {  // both included
    const auto n = Eigen::Index(to - from + 1);
    CycleBranch b{Eigen::VectorXd(n), Eigen::MatrixXd(frames[from]->value.size(), n)};
    for (Eigen::Index k = 0; k < n; ++k) {
      const Profile& p = *frames[from + std::size_t(k)];
      if (p.value.size() != b.profile.rows())
        throw InvalidArgument(message("profiles have ", b.profile.rows(), " and ", p.value.size(), " values"));
      b.load_N[k] = load_N[from + std::size_t(k)];
      b.profile.col(k) = p.value;
    }
    return b;
  };
  return {part(0, peak), part(peak, frames.size() - 1)};
}

}  // namespace detail

/// Below this load [N] the contact counts as lost: the authors' limit for an unloaded finger.
inline constexpr double contact_lost_N = 1.0;

/// Runs of cycles within maintained contact: one for each indenter, place, angle and repetition. A segment of kind
/// `cycle` spans one cycle, from the low load to the high one and back; numbers below 0 are conditioning cycles, which
/// only count where the contact is lost. Loads are the force sensor's normal force, tared on the unloaded segments, at
/// the time of each picture. Throws InvalidArgument for a cycle of two segments, or where there are cycles but no
/// forces.
inline LoggedCycles cycle_runs(
    std::span<const Profile> profiles, const Session& session, const std::vector<WrenchSample>& wrenches) {
  std::map<std::tuple<double, int, double, int>, std::map<int, const Segment*>> runs;
  for (const Segment& s : session.segments)
    if (s.kind == SegmentKind::cycle &&
        !runs[{s.diameter_mm, s.place, s.angle_deg, s.repetition}].emplace(s.cycle, &s).second)
      throw InvalidArgument(message("cycle ", s.cycle, " at place ", s.place, ", run ", s.repetition,
          ", has two segments; one must span the whole cycle"));
  LoggedCycles logged;
  if (runs.empty()) return logged;
  if (wrenches.empty()) throw InvalidArgument("cycles are compared at measured loads, and there are no forces");
  const double tare = force_tare_N(session, wrenches);
  const TimeSeries force = normal_force(wrenches, session.wrench_clock, tare);
  for (const auto& segments : runs) {
    bool lost = false;
    CycleRun run;
    for (const auto& [number, segment] : segments.second) {
      for (const WrenchSample& w : wrenches)
        lost = lost || (segment->holds(session.wrench_clock(w.stamp_ns)) && w.normal_force_N() - tare < contact_lost_N);
      if (number < 0) continue;
      LoadCycle cycle = detail::logged_cycle(profiles, *segment, force, session.frame_delay_s);
      if (cycle.loading.load_N.size() > 0) run.push_back(std::move(cycle));
    }
    if (lost) ++logged.lost;
    else if (!run.empty()) logged.runs.push_back(std::move(run));
  }
  return logged;
}

}  // namespace lumo::sense
