#pragma once

// What stores have in common: digests by xxHash (BSD-2, header only), each over an entry and the digest before it.

#include "lumo/campaign/journal.hpp"

#define XXH_INLINE_ALL
#include <xxhash.h>
#undef XXH_INLINE_ALL

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace lumo::detail {

/// Of everything but the notes, and of all entries before it.
inline std::string entry_digest(const JournalEntry& e, const std::string& before) {
  std::string all = before;
  for (const std::string& part : {std::to_string(e.number), to_string(e.kind), e.content, e.record})
    all += std::to_string(part.size()) + ':' + part;
  const XXH128_hash_t h = XXH3_128bits(all.data(), all.size());
  char hex[33];
  std::snprintf(hex, sizeof hex, "%016llx%016llx", static_cast<unsigned long long>(h.high64),
      static_cast<unsigned long long>(h.low64));
  return hex;
}

/// An entry as a store has it, with the digest that it is said to have.
struct StoredEntry {
  std::string kind;
  JournalEntry entry;  ///< its kind is taken from the text
  std::string digest;
};

/// The entries of a store that were read so far, without their records.
struct EntryChain {
  std::vector<JournalEntry> entries;
  std::string digest;  ///< of the last one

  /// Takes the next one. Throws StoreError that names it unless it is what was written.
  void add(const std::string& store, StoredEntry s) {
    const auto kind = journal_kind(s.kind);
    if (kind) s.entry.kind = *kind;
    if (!kind || s.entry.number != std::int64_t(entries.size()) || entry_digest(s.entry, digest) != s.digest)
      throw StoreError(StoreError::Reason::corrupt, message("store ", store, " is damaged at entry ", entries.size()));
    digest = std::move(s.digest);
    s.entry.record.clear();
    entries.push_back(std::move(s.entry));
  }
  /// Throws StoreError unless the last one is the one that the store says it ends with.
  void require_end(const std::string& store, std::int64_t number, const std::string& last) const {
    if (!entries.empty() && entries.back().number == number && digest == last) return;
    throw StoreError(StoreError::Reason::corrupt, message("store ", store, " is damaged after entry ",
                                                      std::int64_t(entries.size()) - 1, ": entries are missing"));
  }
};

/// An answer that waits for its turn, of which nothing was added before. Throws StoreError unless it is what was
/// written.
inline JournalEntry checked_delivery(const std::string& store, StoredEntry s) {
  const auto kind = journal_kind(s.kind);
  if (kind) s.entry.kind = *kind;
  if (!kind || entry_digest(s.entry, "") != s.digest)
    throw StoreError(StoreError::Reason::corrupt,
        message("store ", store, " is damaged at the answer that waits for entry ", s.entry.number));
  return std::move(s.entry);
}

/// Throws StoreError with the first line that differs between the problem of a store and the one asked for.
inline void require_problem(const std::string& store, const std::string& stored, const std::string& asked) {
  if (stored == asked) return;
  const auto [a, b] = std::mismatch(stored.begin(), stored.end(), asked.begin(), asked.end());
  const auto line_of = [](const std::string& s, std::size_t at) {
    const std::size_t from = at == 0 ? 0 : s.rfind('\n', at - 1) + 1;
    std::string line = s.substr(from, s.find('\n', from) - from);
    line.erase(0, line.find_first_not_of(' '));
    if (line.ends_with(',') || (line.ends_with('}') && line.find('{') == std::string::npos)) line.pop_back();
    return line;
  };
  throw StoreError(StoreError::Reason::different,
      message("store ", store, " belongs to another problem: it has ", line_of(stored, std::size_t(a - stored.begin())),
          ", asked for is ", line_of(asked, std::size_t(b - asked.begin()))));
}

}  // namespace lumo::detail
