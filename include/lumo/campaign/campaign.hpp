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
  std::vector<double> outputs;      ///< empty: it failed
  bool retry = false;               ///< failed for a reason of the machine, not of the design
  std::string why;                  ///< stage and scenario of the failure
  std::string record;               ///< the whole result, the same in every run
  std::string notes;                ///< what may differ in another run: times, machine
  std::vector<double> errors = {};  ///< standard errors of the outputs; empty: not known
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
        if (t.kind == JournalEntry::Kind::tell) optimizer_.tell(t.id, t.values, t.errors);
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
  /// Designs that may be under way. Proposal k + pending follows the answers to 1 … k, in order of ids: the journal is
  /// the same, to the bit, for any number of workers. nullopt: one more whenever a worker is free, so that the journal
  /// has the order in which answers came.
  std::optional<int> pending = std::nullopt;
};

namespace detail {

/// A trial for this process: one whose worker died, or a new one. `state` has read the journal.
template <Store S, class O> std::optional<int> take_trial(S& store, CampaignState<O>& state) {
  const auto claimed = [&](int id) {
    if (!store.claim(state.asked(id))) return false;
    state.read(store.entries());  // who had it may have answered and ended since the last look
    return !state.answered(id);
  };
  for (std::size_t k = 0; k < state.optimizer().trials().size(); ++k)
    if (state.optimizer().trials()[k].state == Trial::State::pending && claimed(int(k))) return int(k);
  const auto entry = store.append([&](const std::vector<JournalEntry>& entries) { return state.ask(entries); });
  if (!entry) return std::nullopt;
  state.read(store.entries());
  const int id = parse_trial(*entry).id;
  return claimed(id) ? std::optional(id) : take_trial(store, state);  // another process was faster
}

/// A trial that is under way, without an answer, and that no living worker has; now this one's.
template <Store S, class O> std::optional<int> claim_pending(S& store, CampaignState<O>& state) {
  while (true) {
    const std::vector<std::int64_t> delivered = store.delivered();
    std::vector<std::int64_t> free;
    for (const Trial& t : state.optimizer().trials())
      if (t.state == Trial::State::pending)
        if (const auto number = state.asked(t.id);
            std::find(delivered.begin(), delivered.end(), number) == delivered.end())
          free.push_back(number);
    const auto number = store.claim_first(free);
    if (!number) return std::nullopt;
    state.read(store.entries());  // who had it may have answered and ended since the last look
    for (const Trial& t : state.optimizer().trials())
      if (t.state == Trial::State::pending && state.asked(t.id) == *number && !store.delivery(*number)) return t.id;
    store.release(*number);
  }
}

/// The first trial that is under way.
template <class O> std::optional<int> first_pending(const O& optimizer) {
  for (const Trial& t : optimizer.trials())
    if (t.state == Trial::State::pending) return t.id;
  return std::nullopt;
}

/// What stands next in the journal, whoever adds it: a design while fewer than `pending` are under way, else the answer
/// to the first of them; nullopt until that was delivered. Without turns any answer that was.
template <Store S, class O> std::optional<JournalEntry> next_entry(
    const S& store, CampaignState<O>& state, const std::vector<JournalEntry>& entries, const CampaignConfig& config) {
  state.read(entries);
  if (config.failures.exceeded(design_failures(state.optimizer().trials()))) return std::nullopt;
  if (config.pending && state.optimizer().pending() < *config.pending)
    if (auto design = state.ask(entries)) return design;
  for (const Trial& t : state.optimizer().trials()) {
    if (t.state != Trial::State::pending) continue;
    if (auto answer = store.delivery(state.asked(t.id))) return answer;
    if (config.pending) break;
  }
  return std::nullopt;
}

/// Outputs or errors that the optimiser does not take (too few, too many, not finite) are a failure of the design: as
/// an answer they would end the journal. A search that is to know of no noise keeps no errors.
template <class O> TrialResult acceptable(O probe, int id, TrialResult result) {
  if (probe.problem().noise == Noise::none) result.errors.clear();
  if (result.outputs.empty()) return result;
  try {
    probe.tell(id, result.outputs, result.errors);
  } catch (const InvalidArgument& e) {
    result.outputs.clear();
    result.retry = false;
    result.why = message("objective: ", e.what());
  }
  return result;
}

/// An evaluation as the entry that answers its trial.
inline JournalEntry answer_entry(int id, const TrialResult& result) {
  JournalEntry e =
      result.outputs.empty() ? fail_entry(id, result.retry, result.why) : tell_entry(id, result.outputs, result.errors);
  e.record = result.record;
  e.notes = result.notes;
  return e;
}

/// The evaluation that an entry keeps; nullopt for one that answers nothing.
inline std::optional<std::pair<int, TrialResult>> answer_in(const JournalEntry& e) {
  const TrialEntry t = parse_trial(e);
  if (t.kind == JournalEntry::Kind::ask) return std::nullopt;
  return std::pair(t.id, TrialResult{t.values, t.retry, t.why, e.record, e.notes, t.errors});
}

/// May next_entry() have one? Without a look at the models.
template <Store S, class O>
bool may_go_on(const S& store, const CampaignState<O>& state, const CampaignConfig& config) {
  const O& optimizer = state.optimizer();
  if (config.pending && optimizer.status() == OptimizerStatus::running && optimizer.pending() < *config.pending)
    return true;
  const std::vector<std::int64_t> delivered = store.delivered();
  for (const Trial& t : optimizer.trials()) {
    if (t.state != Trial::State::pending) continue;
    if (std::find(delivered.begin(), delivered.end(), state.asked(t.id)) != delivered.end()) return true;
    if (config.pending) break;
  }
  return false;
}

/// Keeps an answer: as the next entry if it is its turn, or if there are no turns; else beside the journal. Nullopt
/// unless it was appended.
template <Store S, class O> std::optional<JournalEntry> keep_answer(
    S& store, CampaignState<O>& state, int id, const TrialResult& result, const CampaignConfig& config) {
  const auto due = [&] {
    const O& optimizer = state.optimizer();
    return !config.pending || (first_pending(optimizer) == id && optimizer.pending() >= *config.pending);
  };
  std::optional<JournalEntry> appended;
  if (due())  // as far as this process knows: what others added since can only have made it so
    appended = store.append([&](const std::vector<JournalEntry>& entries) {
      state.read(entries);
      return state.answered(id) || !due() ? std::nullopt
                                          : std::optional(answer_entry(id, acceptable(state.optimizer(), id, result)));
    });
  if (!appended && !state.answered(id))
    store.deliver(state.asked(id), answer_entry(id, acceptable(state.optimizer(), id, result)));
  store.release(state.asked(id));
  return appended;
}

}  // namespace detail

/// Evaluates what the optimiser asks until it has as many results as its problem wants, or no design is left. Continues
/// what the store holds; several processes may work on one store. Each entry depends only on those before it: a
/// campaign has the same journal, to the bit, after any number of crashes, in one process or, with `config.pending`, in
/// any number. `evaluate(design)` gives a TrialResult; `watch(state, id, result)` sees each answer that this process
/// added to the journal. Throws StoreError and CampaignError.
template <Store S, class O, class Evaluate, class Watch> OptimizerStatus run_campaign(
    S& store, const O& optimizer, const Evaluate& evaluate, const Watch& watch, const CampaignConfig& config = {}) {
  if (config.pending) require_in_range("number of designs under way", *config.pending, 1, 100000, "");
  CampaignState<O> state(optimizer);
  std::set<int> own;  // trials that this process answered
  const auto watched = [&](const JournalEntry& entry) {
    state.read(store.entries());
    if (const auto answer = detail::answer_in(entry))
      watch(std::as_const(state), answer->first, std::as_const(answer->second));
  };
  while (true) {
    state.read(store.entries());
    const std::vector<Trial>& trials = state.optimizer().trials();
    for (const FailureTally& tally : {design_failures(trials), machine_failures(trials, own)})
      if (config.failures.exceeded(tally))
        throw CampaignError("campaign stops: " + config.failures.reason(tally, trials));
    if (detail::may_go_on(store, state, config))
      if (const auto entry = store.append([&](const std::vector<JournalEntry>& entries) {
            return detail::next_entry(store, state, entries, config);
          })) {
        watched(*entry);
        continue;
      }
    const std::optional<int> id =
        config.pending ? detail::claim_pending(store, state) : detail::take_trial(store, state);
    if (!id) {
      const OptimizerStatus end = state.optimizer().status();
      if (end == OptimizerStatus::finished || end == OptimizerStatus::exhausted) return end;
      store.wait(config.poll_s);
      continue;
    }
    const TrialResult result = evaluate(state.optimizer().trials()[std::size_t(*id)].x);
    const auto entry = detail::keep_answer(store, state, *id, result, config);
    if (entry || !state.answered(*id)) own.insert(*id);
    if (entry) watched(*entry);
  }
}

}  // namespace lumo
