#pragma once

#include "lumo/core/design_space.hpp"

#include <cmath>
#include <cstdint>
#include <set>
#include <string>
#include <vector>

namespace lumo {

/// Values in variable order.
using Design = std::vector<double>;
using DesignSet = std::set<Design>;

/// One figure of merit. Only values better than `reference` add to the hypervolume.
struct Objective {
  std::string name;
  bool maximize = true;
  double reference = 0.0;

  double signed_value(double y) const { return maximize ? y : -y; }  ///< larger is better
};

/// A result that was not asked for: of an earlier search, or measured. It may lie off the lattice and outside the
/// space, and there may be several of one design.
struct KnownResult {
  Design x;
  std::vector<double> outputs;  ///< in their own units and sense
  std::vector<double> errors;   ///< standard errors of the outputs; empty: not known
  bool stands = true;  ///< in the front, if it lies inside the space; what cannot be compared only informs the models
};

/// Whether observations carry noise: then a front is of the models' means, not of the values that were reported.
enum class Noise {
  estimated,  ///< where a standard error was reported, or the models see noise beyond doubt
  none,       ///< not even with standard errors
  present
};

/// An optimisation problem, and how much of the search is fixed beforehand.
struct Problem {
  DesignSpace space;
  std::vector<Objective> objectives;
  std::vector<Design> initial;     ///< asked first
  bool initial_anywhere = false;   ///< they may lie off the lattice and outside the bounds
  std::vector<KnownResult> known;  ///< the models know them from the start; none is proposed
  Noise noise = Noise::estimated;
  int repeats = 1;       ///< evaluations of one design, at most; more only where there is noise
  int sobol = 8;         ///< asked next: points spread over the space
  int evaluations = 40;  ///< observed trials at which it ends, initial and Sobol ones included
  std::uint64_t seed = 0;

  /// Throws InvalidArgument or InfeasibleDesign naming the fault; DesignSampler checks variables and constraints.
  void validate() const {
    if (objectives.empty()) throw InvalidArgument("problem has no objectives, must have at least 1");
    std::set<std::string> names;
    for (const Objective& o : objectives) {
      if (!names.insert(o.name).second) throw InvalidArgument(message("objective ", o.name, " is there twice"));
      if (!std::isfinite(o.reference))
        throw InvalidArgument(
            message("objective ", o.name, " has reference ", o.reference, ", must be a finite number"));
    }
    if (sobol < 0 || sobol > 100000)
      throw InvalidArgument(message("number of Sobol points is ", sobol, ", must lie in [0, 100000]"));
    if (evaluations < 1 || evaluations > 100000)
      throw InvalidArgument(message("number of evaluations is ", evaluations, ", must lie in [1, 100000]"));
    if (repeats < 1 || repeats > 1000)
      throw InvalidArgument(message("number of evaluations of one design is ", repeats, ", must lie in [1, 1000]"));
    if (repeats > 1 && noise == Noise::none)
      throw InvalidArgument(message("designs are to be evaluated ", repeats, " times, but there is to be no noise"));
    DesignSpace asked = space;
    if (initial_anywhere) asked = asked.unbounded();
    for (const Design& x : initial) {
      space.check_result(x);
      asked.check(x);
    }
    for (const KnownResult& k : known) space.check_result(k.x);
  }
};

/// A design that was asked, and its outcome.
struct Trial {
  enum class State { pending, observed, failed };
  int id = 0;  ///< counts from 0 in the order of asking
  Design x;
  State state = State::pending;
  std::vector<double> outputs;  ///< observed ones, in their own units and sense
  std::vector<double> errors;   ///< their standard errors; empty: not known
  bool retry = false;           ///< failed for a reason that does not lie in the design
  std::string why;
};

/// A design's objectives, in their own units and sense.
struct Outcome {
  int id = 0;  ///< of its trial; −1 − k for the known result k
  std::vector<double> objectives;
  std::vector<double> deviations = {};  ///< standard deviations of what the models believe; empty for reported values
};

/// Evaluations that ended, and how many of them failed.
struct FailureTally {
  int failed = 0, ended = 0;
};

/// Counts designs: a failure of the machine is no evaluation.
inline FailureTally design_failures(const std::vector<Trial>& trials) {
  FailureTally tally;
  for (const Trial& t : trials) {
    const bool failed = t.state == Trial::State::failed && !t.retry;
    tally.failed += failed;
    tally.ended += failed || t.state == Trial::State::observed;
  }
  return tally;
}

/// Counts failures of the machine in the trials `own`.
inline FailureTally machine_failures(const std::vector<Trial>& trials, const std::set<int>& own) {
  FailureTally tally{0, int(own.size())};
  for (const int id : own)
    tally.failed += trials[std::size_t(id)].state == Trial::State::failed && trials[std::size_t(id)].retry;
  return tally;
}

/// When failures end a search, so that one that cannot succeed does not go on for ever.
struct FailureLimit {
  int at_least = 5;    ///< once so many evaluations have failed
  double above = 0.5;  ///< and more than this share of them

  bool exceeded(const FailureTally& tally) const {
    return tally.failed >= at_least && tally.failed > above * tally.ended;
  }
  /// Why a search ends, in words; of the last trial that failed.
  std::string reason(const FailureTally& tally, const std::vector<Trial>& trials) const {
    std::string why;
    for (const Trial& t : trials)
      if (t.state == Trial::State::failed) why = t.why;
    return message(tally.failed, " of ", tally.ended, " evaluations failed, the limit is ", 100 * above, " % once ",
        at_least, " have; the last: ", why);
  }
};

enum class OptimizerStatus {
  running,   ///< there is more to ask
  waiting,   ///< no design to ask until a pending trial is answered
  finished,  ///< as many trials are observed as the problem wants
  exhausted  ///< every feasible design that can be found has been asked
};

}  // namespace lumo
