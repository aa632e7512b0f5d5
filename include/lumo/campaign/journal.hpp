#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/stopwatch.hpp"

#include <algorithm>
#include <charconv>
#include <concepts>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace lumo {

/// One entry of a campaign's journal. Entries are only ever added. `notes` is what may differ between two runs of the
/// same campaign (times, process numbers); everything else is the same to the last bit.
struct JournalEntry {
  enum class Kind { problem, ask, tell, fail };
  std::int64_t number = 0;  ///< from 0, without gaps
  Kind kind = Kind::problem;
  std::string content;  ///< what a resumed campaign needs of it
  std::string record;   ///< the whole result
  std::string notes;
};

/// The kind as stores write it.
inline std::string to_string(JournalEntry::Kind kind) {
  switch (kind) {
    case JournalEntry::Kind::ask: return "ask";
    case JournalEntry::Kind::tell: return "tell";
    case JournalEntry::Kind::fail: return "fail";
    default: return "problem";
  }
}

/// The kind that a store has written; nullopt if there is no such kind.
inline std::optional<JournalEntry::Kind> journal_kind(std::string_view text) {
  using enum JournalEntry::Kind;
  for (const auto kind : {problem, ask, tell, fail})
    if (to_string(kind) == text) return kind;
  return std::nullopt;
}

/// A journal that cannot be opened, read or written.
class StoreError : public Error {
 public:
  enum class Reason {
    corrupt,    ///< its content is not what was written
    full,       ///< no space left
    busy,       ///< another process holds it for too long
    different,  ///< it belongs to another problem
    unusable    ///< no such folder, no permission, a defect disk, not a store
  };
  StoreError(Reason reason, const std::string& text) : Error(text), reason_(reason) {}
  Reason reason() const { return reason_; }

 private:
  Reason reason_;
};

/// Where a campaign is kept. Entry 0 is the problem. Laws: what `append` returned is there after any crash; two
/// processes never append at once; `next` sees all entries, without their records, and nothing is added between its
/// look and its entry.
template <class J>
concept Journal = requires(J& journal, const J& view,
    std::function<std::optional<JournalEntry>(const std::vector<JournalEntry>&)> next, std::int64_t number) {
  { view.entries() } -> std::same_as<std::vector<JournalEntry>>;
  { view.record(number) } -> std::same_as<std::string>;
  { journal.append(next) } -> std::same_as<std::optional<JournalEntry>>;
  { journal.claim(number) } -> std::same_as<bool>;
};

/// Work that a living worker has claimed.
struct Claim {
  std::int64_t number = 0;      ///< of the entry that announces it
  std::string node, process;    ///< as the store knows them
  std::optional<double> age_s;  ///< by the store's own clock; nullopt if it keeps no times
};

/// A journal that several workers share. Laws: at most one living worker has a claim, and it ends with its worker; an
/// answer that was delivered is there after any crash, and waits outside of the entries until one with its kind and
/// content is there; a second one to the same entry is not taken.
template <class S>
concept Store = Journal<S> && requires(
    S& store, const S& view, const JournalEntry& answer, const std::vector<std::int64_t>& numbers, double seconds) {
  { store.claim_first(numbers) } -> std::same_as<std::optional<std::int64_t>>;
  { store.release(answer.number) } -> std::same_as<void>;
  { store.deliver(answer.number, answer) } -> std::same_as<bool>;
  { view.delivered() } -> std::same_as<std::vector<std::int64_t>>;
  { view.delivery(answer.number) } -> std::same_as<std::optional<JournalEntry>>;
  { view.claims() } -> std::same_as<std::vector<Claim>>;
  { store.wait(seconds) } -> std::same_as<void>;
};

/// A journal that lives as long as its process.
class MemoryJournal {
 public:
  explicit MemoryJournal(std::string problem) {
    entries_.push_back({0, JournalEntry::Kind::problem, std::move(problem), "", ""});
  }

  /// All entries, without their records.
  std::vector<JournalEntry> entries() const {
    std::vector<JournalEntry> list = entries_;
    for (JournalEntry& e : list) e.record.clear();
    return list;
  }
  std::string record(std::int64_t number) const { return entries_.at(std::size_t(number)).record; }

  /// Adds the entry that `next` makes of those so far, if any; returns it with its number.
  template <class Next> std::optional<JournalEntry> append(Next&& next) {
    std::optional<JournalEntry> entry = next(entries());
    if (!entry) return std::nullopt;
    entry->number = std::int64_t(entries_.size());
    entries_.push_back(*entry);
    std::erase_if(
        delivered_, [&](const auto& d) { return d.second.kind == entry->kind && d.second.content == entry->content; });
    return entry;
  }

  /// May this process work on the trial that the entry announces? Not while another living process does.
  bool claim(std::int64_t) { return true; }
  /// The first of these entries whose trial this process may work on.
  std::optional<std::int64_t> claim_first(const std::vector<std::int64_t>& numbers) {
    return numbers.empty() ? std::nullopt : std::optional(numbers.front());
  }
  void release(std::int64_t) {}
  std::vector<Claim> claims() const { return {}; }

  /// Keeps the answer to the entry `number` until its turn; false if there is one.
  bool deliver(std::int64_t number, JournalEntry answer) {
    for (const JournalEntry& e : entries_)
      if (e.kind == answer.kind && e.content == answer.content) return false;
    return delivered_.try_emplace(number, std::move(answer)).second;
  }
  std::vector<std::int64_t> delivered() const {
    std::vector<std::int64_t> numbers;
    for (const auto& [number, answer] : delivered_) numbers.push_back(number);
    return numbers;
  }
  std::optional<JournalEntry> delivery(std::int64_t number) const {
    const auto found = delivered_.find(number);
    return found == delivered_.end() ? std::nullopt : std::optional(found->second);
  }
  /// Until something may have changed, at most so long.
  void wait(double seconds) { pause_for(seconds); }

 private:
  std::vector<JournalEntry> entries_;
  std::map<std::int64_t, JournalEntry> delivered_;
};

static_assert(Store<MemoryJournal>);

/// A trial in a journal: "<id> <design>" (ask), "<id> <outputs>" or "<id> <outputs> +- <their standard errors>" (tell),
/// or "<id> retry|final <why>" (fail).
struct TrialEntry {
  JournalEntry::Kind kind = JournalEntry::Kind::ask;
  int id = 0;
  std::vector<double> values;  ///< the design, or its outputs
  std::vector<double> errors;  ///< standard errors of the outputs; empty: not known
  bool retry = false;
  std::string why;
};

inline JournalEntry trial_entry(JournalEntry::Kind kind, int id, const std::vector<double>& values) {
  std::string text = std::to_string(id);
  for (const double v : values) text += ' ' + exact(v);
  return {0, kind, std::move(text), "", ""};
}
inline JournalEntry ask_entry(int id, const std::vector<double>& design) {
  return trial_entry(JournalEntry::Kind::ask, id, design);
}
inline JournalEntry tell_entry(int id, const std::vector<double>& outputs, const std::vector<double>& errors = {}) {
  JournalEntry e = trial_entry(JournalEntry::Kind::tell, id, outputs);
  if (!errors.empty()) e.content += " +-";
  for (const double v : errors) e.content += ' ' + exact(v);
  return e;
}
inline JournalEntry fail_entry(int id, bool retry, const std::string& why) {
  return {0, JournalEntry::Kind::fail, std::to_string(id) + (retry ? " retry " : " final ") + why, "", ""};
}

/// Throws StoreError for an entry that is none of these.
inline TrialEntry parse_trial(const JournalEntry& entry) {
  const auto refuse = [&] {
    throw StoreError(StoreError::Reason::corrupt,
        message("entry ", entry.number, " is no trial: ", to_string(entry.kind), ' ', entry.content));
  };
  std::string_view rest = entry.content;
  const auto read = [&](auto& value) {
    const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), value);
    if (error != std::errc{} || (end != rest.data() + rest.size() && *end != ' ')) refuse();
    rest.remove_prefix(std::min(rest.size(), std::size_t(end - rest.data()) + 1));
  };
  if (entry.kind == JournalEntry::Kind::problem) refuse();
  TrialEntry t;
  t.kind = entry.kind;
  read(t.id);
  if (t.id < 0) refuse();
  if (entry.kind == JournalEntry::Kind::fail) {
    t.retry = rest.starts_with("retry ");
    if (!t.retry && !rest.starts_with("final ")) refuse();
    t.why = rest.substr(std::string_view("retry ").size());
    return t;
  }
  constexpr std::string_view and_errors = "+- ";
  while (!rest.empty() && !rest.starts_with(and_errors)) read(t.values.emplace_back());
  if (rest.empty()) return t;
  if (entry.kind != JournalEntry::Kind::tell) refuse();
  rest.remove_prefix(and_errors.size());
  do read(t.errors.emplace_back());
  while (!rest.empty());
  return t;
}

}  // namespace lumo
