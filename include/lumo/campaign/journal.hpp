#pragma once

#include "lumo/core/error.hpp"

#include <concepts>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace lumo {

/// One entry of a campaign's log. Entries are only ever added; `notes` is what may differ between two runs of the same
/// campaign (times, process numbers), everything else is the same to the last bit.
struct JournalEntry {
  std::int64_t number = 0;  ///< from 0, without gaps
  std::string kind;         ///< what happened
  std::string content;      ///< what a resumed campaign needs of it
  std::string record;       ///< the whole result
  std::string notes;
};

/// A log that cannot be opened, read or written.
class StoreError : public Error {
 public:
  enum class Reason {
    corrupt,    ///< what is there is not what was written
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
template <class L>
concept Journal = requires(L& log, const L& view,
                               std::function<std::optional<JournalEntry>(const std::vector<JournalEntry>&)> next,
                               std::int64_t number) {
  { view.entries() } -> std::same_as<std::vector<JournalEntry>>;
  { view.record(number) } -> std::same_as<std::string>;
  { log.append(next) } -> std::same_as<std::optional<JournalEntry>>;
  { log.claim(number) } -> std::same_as<bool>;
};

/// A log that lives as long as its process.
class MemoryJournal {
 public:
  explicit MemoryJournal(std::string problem) { entries_.push_back({0, "problem", std::move(problem), "", ""}); }

  /// All entries, without their records.
  std::vector<JournalEntry> entries() const {
    std::vector<JournalEntry> list = entries_;
    for (JournalEntry& e : list) e.record.clear();
    return list;
  }
  std::string record(std::int64_t number) const { return entries_.at(std::size_t(number)).record; }

  /// Adds what `next` makes of the entries so far, if anything; returns it with its number.
  template <class Next> std::optional<JournalEntry> append(Next&& next) {
    std::optional<JournalEntry> entry = next(entries());
    if (!entry) return std::nullopt;
    entry->number = std::int64_t(entries_.size());
    entries_.push_back(*entry);
    return entry;
  }

  /// May this process work on what the entry announces? Not when another living one does.
  bool claim(std::int64_t) { return true; }

 private:
  std::vector<JournalEntry> entries_;
};

static_assert(Journal<MemoryJournal>);

}  // namespace lumo
