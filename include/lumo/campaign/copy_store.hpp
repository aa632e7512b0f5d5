#pragma once

#include "lumo/campaign/journal.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace lumo {

/// Appends what `copy` lacks of `source`, which has the same problem: entries with their records and notes, then
/// answers that wait. It may be interrupted and goes on. Throws StoreError of reason `different` if an entry differs
/// from the one that `copy` has.
template <Store S, Store T> void copy_store(const S& source, T& copy) {
  const std::vector<JournalEntry> all = source.entries();
  const std::vector<JournalEntry> there = copy.entries();
  const auto refuse = [](std::int64_t number) {
    throw StoreError(StoreError::Reason::different, message("entry ", number, " differs in the other store"));
  };
  if (there.size() > all.size()) refuse(std::int64_t(all.size()));
  for (const JournalEntry& e : there)
    if (const JournalEntry& own = all[std::size_t(e.number)];
        own.kind != e.kind || own.content != e.content || source.record(e.number) != copy.record(e.number))
      refuse(e.number);
  for (std::size_t k = there.size(); k < all.size(); ++k)
    copy.append([&](const std::vector<JournalEntry>& list) -> std::optional<JournalEntry> {
      if (list.size() > k) refuse(std::int64_t(k));  // another process writes to it
      JournalEntry e = all[k];
      e.record = source.record(e.number);
      return e;
    });
  for (const std::int64_t number : source.delivered())
    if (const auto answer = source.delivery(number)) copy.deliver(number, *answer);
}

}  // namespace lumo
