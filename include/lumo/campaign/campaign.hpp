#pragma once

#include "lumo/campaign/journal.hpp"
#include "lumo/campaign/trial_entry.hpp"
#include "lumo/core/stopwatch.hpp"
#include "lumo/optimize/optimizer.hpp"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace lumo {

/// What became of one evaluation.
struct TrialResult {
  std::vector<double> outputs;  ///< empty: it failed
  bool retry = false;           ///< failed for a reason of the machine, not of the design
  std::string why;              ///< stage and scenario of the failure
  std::string record;           ///< the whole result, the same in every run
  std::string notes;            ///< what another run may give otherwise: times, machine
};

/// More evaluations failed than a campaign can stand.
class CampaignError : public NumericalError {
 public:
  using NumericalError::NumericalError;
};

/// A campaign's log, read by an optimiser: all that was asked, told and failed so far.
template <class O> class CampaignState {
 public:
  /// `optimizer` knows the problem and nothing else.
  explicit CampaignState(O optimizer) : optimizer_(std::move(optimizer)) {}

  /// Takes in what is new. Throws StoreError for entries that no campaign of this problem wrote.
  void read(const std::vector<JournalEntry>& entries);
  /// The next trial, as the entry that announces it.
  std::optional<JournalEntry> ask(const std::vector<JournalEntry>& entries);

  const O& optimizer() const { return optimizer_; }
  /// Number of the entry that announced a trial, and of the one that answered it.
  std::int64_t asked(int id) const { return asked_[std::size_t(id)]; }
  std::optional<std::int64_t> answered(int id) const { return answered_[std::size_t(id)]; }
  /// Evaluations that ended, and how many of them failed.
  struct Tally {
    int failed = 0, ended = 0;
  };
  /// Of designs: what the machine failed at is no evaluation.
  Tally designs() const;
  /// Of the machine, in the trials that it was given.
  Tally machine(const std::set<int>& own) const;
  /// Of the latest trial that failed; empty when none did.
  std::string last_failure() const;

 private:
  O optimizer_;
  std::size_t known_ = 1;  // entry 0 is the problem
  std::vector<std::int64_t> asked_;
  std::vector<std::optional<std::int64_t>> answered_;
};

/// How a campaign goes on when things go wrong.
struct CampaignConfig {
  int failures_at_least = 5;    ///< it stops once so many evaluations have failed: of all for their designs, or of this
                                ///< process's own for the machine
  double failures_above = 0.5;  ///< and more than this share of them
  double poll_s = 0.5;          ///< how often it looks whether another process has ended, or died
};

/// Evaluates what the optimiser asks until it has as many results as its problem wants, or no design is left. Continues
/// what the log holds; several processes may work on one log. Each entry depends only on those before it, so a campaign
/// in one process has the same log, to the bit, after any number of crashes. `evaluate(design)` gives a TrialResult;
/// `watch(state, id, verdict)` sees each as it was kept. Throws StoreError and CampaignError.
template <Journal Log, class O, class Evaluate, class Watch>
OptimizerStatus run_campaign(Log& log, const O& optimizer, const Evaluate& evaluate, const Watch& watch,
                             const CampaignConfig& config = {});

template <class O> void CampaignState<O>::read(const std::vector<JournalEntry>& entries) {
  for (; known_ < entries.size(); ++known_) {
    const JournalEntry& e = entries[known_];
    try {
      const TrialEntry t = parse_trial(e);
      if (t.kind == TrialEntry::Kind::ask) {
        optimizer_.restore(t.id, t.values);
        asked_.push_back(e.number);
        answered_.emplace_back();
        continue;
      }
      if (t.kind == TrialEntry::Kind::tell)
        optimizer_.tell(t.id, t.values);
      else
        optimizer_.fail(t.id, t.retry, t.why);
      answered_[std::size_t(t.id)] = e.number;
    } catch (const StoreError&) {
      throw;
    } catch (const Error& error) {
      throw StoreError(StoreError::Reason::corrupt,
                       message("entry ", e.number, " does not fit those before it: ", error.what()));
    }
  }
}

template <class O> std::optional<JournalEntry> CampaignState<O>::ask(const std::vector<JournalEntry>& entries) {
  read(entries);
  O next = optimizer_;
  const std::optional<Trial> trial = next.ask();
  if (!trial) {
    optimizer_ = std::move(next);  // knows why there is none
    return std::nullopt;
  }
  return ask_entry(trial->id, trial->x);
}

template <class O> auto CampaignState<O>::designs() const -> Tally {
  const auto count = [&](const auto& is) {
    return int(std::count_if(optimizer_.trials().begin(), optimizer_.trials().end(), is));
  };
  const int failed = count([](const Trial& t) { return t.state == Trial::State::failed && !t.retry; });
  return {failed, failed + count([](const Trial& t) { return t.state == Trial::State::observed; })};
}

template <class O> auto CampaignState<O>::machine(const std::set<int>& own) const -> Tally {
  const auto failed = [&](int id) {
    const Trial& t = optimizer_.trials()[std::size_t(id)];
    return t.state == Trial::State::failed && t.retry;
  };
  return {int(std::count_if(own.begin(), own.end(), failed)), int(own.size())};
}

template <class O> std::string CampaignState<O>::last_failure() const {
  std::string why;
  for (const Trial& t : optimizer_.trials())
    if (t.state == Trial::State::failed) why = t.why;
  return why;
}

/// A trial for this process: one whose worker died, or a new one. `state` has read the log.
template <Journal Log, class O> std::optional<int> take(Log& log, CampaignState<O>& state) {
  const auto claimed = [&](int id) {
    if (!log.claim(state.asked(id))) return false;
    state.read(log.entries());  // who had it may have answered and ended since the last look
    return !state.answered(id);
  };
  for (std::size_t k = 0; k < state.optimizer().trials().size(); ++k)
    if (state.optimizer().trials()[k].state == Trial::State::pending && claimed(int(k))) return int(k);
  const auto entry = log.append([&](const std::vector<JournalEntry>& entries) { return state.ask(entries); });
  if (!entry) return std::nullopt;
  state.read(log.entries());
  const int id = parse_trial(*entry).id;
  return claimed(id) ? std::optional(id) : take(log, state);  // somebody else was faster
}

/// Outputs that the optimiser does not take (too few, too many, not finite) are a failure of the design: as an answer
/// they would end the log.
template <class O> TrialResult acceptable(O probe, int id, TrialResult verdict) {
  if (verdict.outputs.empty()) return verdict;
  try {
    probe.tell(id, verdict.outputs);
  } catch (const InvalidArgument& e) {
    verdict.outputs.clear();
    verdict.retry = false;
    verdict.why = message("objective: ", e.what());
  }
  return verdict;
}

template <Journal Log, class O, class Evaluate, class Watch>
OptimizerStatus run_campaign(Log& log, const O& optimizer, const Evaluate& evaluate, const Watch& watch,
                             const CampaignConfig& config) {
  CampaignState<O> state(optimizer);
  std::set<int> own;  // trials that this process answered
  while (true) {
    state.read(log.entries());
    for (const auto& [failed, ended] : {state.designs(), state.machine(own)})
      if (failed >= config.failures_at_least && failed > config.failures_above * ended)
        throw CampaignError(message("campaign stops: ", failed, " of ", ended, " evaluations failed, the limit is ",
                                    100 * config.failures_above, " % once ", config.failures_at_least,
                                    " have; the last: ", state.last_failure()));
    const std::optional<int> id = take(log, state);
    if (!id) {
      if (state.optimizer().status() != OptimizerStatus::waiting) return state.optimizer().status();
      pause_for(config.poll_s);
      continue;
    }
    TrialResult verdict = evaluate(state.optimizer().trials()[std::size_t(*id)].x);
    const auto answer = log.append([&](const std::vector<JournalEntry>& entries) -> std::optional<JournalEntry> {
      state.read(entries);
      if (state.answered(*id)) return std::nullopt;
      verdict = acceptable(state.optimizer(), *id, std::move(verdict));
      JournalEntry e =
          verdict.outputs.empty() ? fail_entry(*id, verdict.retry, verdict.why) : tell_entry(*id, verdict.outputs);
      e.record = verdict.record;
      e.notes = verdict.notes;
      return e;
    });
    if (!answer) continue;
    own.insert(*id);
    state.read(log.entries());
    watch(std::as_const(state), *id, std::as_const(verdict));
  }
}

}  // namespace lumo
