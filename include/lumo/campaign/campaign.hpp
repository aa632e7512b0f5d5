#pragma once

#include "lumo/campaign/journal.hpp"
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

/// The result of one evaluation.
struct TrialResult {
  std::vector<double> outputs;  ///< empty: it failed
  bool retry = false;           ///< failed for a reason of the machine, not of the design
  std::string why;              ///< stage and scenario of the failure
  std::string record;           ///< the whole result, the same in every run
  std::string notes;            ///< what may differ in another run: times, machine
};

/// More evaluations failed than a campaign can stand.
class CampaignError : public NumericalError {
 public:
  using NumericalError::NumericalError;
};

/// A campaign's journal, read by an optimiser: all trials that were asked, reported and failed so far.
template <class O> class CampaignState {
 public:
  /// `optimizer` knows the problem only.
  explicit CampaignState(O optimizer) : optimizer_(std::move(optimizer)) {}

  /// Takes in the new entries. Throws StoreError for entries that no campaign of this problem wrote.
  void read(const std::vector<JournalEntry>& entries) {
    for (; known_ < entries.size(); ++known_) {
      const JournalEntry& e = entries[known_];
      try {
        const TrialEntry t = parse_trial(e);
        if (t.kind == JournalEntry::Kind::ask) {
          optimizer_.restore(t.id, t.values);
          asked_.push_back(e.number);
          answered_.emplace_back();
          continue;
        }
        if (t.kind == JournalEntry::Kind::tell) optimizer_.tell(t.id, t.values);
        else optimizer_.fail(t.id, t.retry, t.why);
        answered_[std::size_t(t.id)] = e.number;
      } catch (const StoreError&) {
        throw;
      } catch (const Error& error) {
        throw StoreError(
            StoreError::Reason::corrupt, message("entry ", e.number, " does not fit those before it: ", error.what()));
      }
    }
  }
  /// The next trial, as the entry that announces it.
  std::optional<JournalEntry> ask(const std::vector<JournalEntry>& entries) {
    read(entries);
    O next = optimizer_;
    const std::optional<Trial> trial = next.ask();
    if (!trial) {
      optimizer_ = std::move(next);  // knows why there is none
      return std::nullopt;
    }
    return ask_entry(trial->id, trial->x);
  }

  const O& optimizer() const { return optimizer_; }
  /// Number of the entry that announced a trial, and of the one that answered it.
  std::int64_t asked(int id) const { return asked_[std::size_t(id)]; }
  std::optional<std::int64_t> answered(int id) const { return answered_[std::size_t(id)]; }

 private:
  O optimizer_;
  std::size_t known_ = 1;  // entry 0 is the problem
  std::vector<std::int64_t> asked_;
  std::vector<std::optional<std::int64_t>> answered_;
};

/// When a campaign stops because evaluations fail, and how it waits for other processes.
struct CampaignConfig {
  FailureLimit failures;  ///< of all evaluations for their designs, or of this process's own for the machine
  double poll_s = 0.5;    ///< between looks whether another process has ended, or died
};

namespace detail {

/// A trial for this process: one whose worker died, or a new one. `state` has read the journal.
template <Journal J, class O> std::optional<int> take_trial(J& journal, CampaignState<O>& state) {
  const auto claimed = [&](int id) {
    if (!journal.claim(state.asked(id))) return false;
    state.read(journal.entries());  // who had it may have answered and ended since the last look
    return !state.answered(id);
  };
  for (std::size_t k = 0; k < state.optimizer().trials().size(); ++k)
    if (state.optimizer().trials()[k].state == Trial::State::pending && claimed(int(k))) return int(k);
  const auto entry = journal.append([&](const std::vector<JournalEntry>& entries) { return state.ask(entries); });
  if (!entry) return std::nullopt;
  state.read(journal.entries());
  const int id = parse_trial(*entry).id;
  return claimed(id) ? std::optional(id) : take_trial(journal, state);  // another process was faster
}

/// Outputs that the optimiser does not take (too few, too many, not finite) are a failure of the design: as an answer
/// they would end the journal.
template <class O> TrialResult acceptable(O probe, int id, TrialResult result) {
  if (result.outputs.empty()) return result;
  try {
    probe.tell(id, result.outputs);
  } catch (const InvalidArgument& e) {
    result.outputs.clear();
    result.retry = false;
    result.why = message("objective: ", e.what());
  }
  return result;
}

}  // namespace detail

/// Evaluates what the optimiser asks until it has as many results as its problem wants, or no design is left. Continues
/// what the journal holds; several processes may work on one journal. Each entry depends only on those before it: a
/// campaign in one process has the same journal, to the bit, after any number of crashes. `evaluate(design)` gives a
/// TrialResult; `watch(state, id, result)` sees each as it was kept. Throws StoreError and CampaignError.
template <Journal J, class O, class Evaluate, class Watch> OptimizerStatus run_campaign(
    J& journal, const O& optimizer, const Evaluate& evaluate, const Watch& watch, const CampaignConfig& config = {}) {
  CampaignState<O> state(optimizer);
  std::set<int> own;  // trials that this process answered
  while (true) {
    state.read(journal.entries());
    const std::vector<Trial>& trials = state.optimizer().trials();
    for (const FailureTally& tally : {design_failures(trials), machine_failures(trials, own)})
      if (config.failures.exceeded(tally))
        throw CampaignError("campaign stops: " + config.failures.reason(tally, trials));
    const std::optional<int> id = detail::take_trial(journal, state);
    if (!id) {
      if (state.optimizer().status() != OptimizerStatus::waiting) return state.optimizer().status();
      pause_for(config.poll_s);
      continue;
    }
    TrialResult result = evaluate(state.optimizer().trials()[std::size_t(*id)].x);
    const auto answer = journal.append([&](const std::vector<JournalEntry>& entries) -> std::optional<JournalEntry> {
      state.read(entries);
      if (state.answered(*id)) return std::nullopt;
      result = detail::acceptable(state.optimizer(), *id, std::move(result));
      JournalEntry e =
          result.outputs.empty() ? fail_entry(*id, result.retry, result.why) : tell_entry(*id, result.outputs);
      e.record = result.record;
      e.notes = result.notes;
      return e;
    });
    if (!answer) continue;
    own.insert(*id);
    state.read(journal.entries());
    watch(std::as_const(state), *id, std::as_const(result));
  }
}

}  // namespace lumo
