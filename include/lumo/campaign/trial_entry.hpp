#pragma once

#include "lumo/campaign/journal.hpp"

#include <algorithm>
#include <charconv>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

namespace lumo {

/// What the log of a campaign says about a trial: "<id> <design>", "<id> <outputs>" or "<id> retry|final <why>".
struct TrialEntry {
  enum class Kind { ask, tell, fail };
  Kind kind = Kind::ask;
  int id = 0;
  std::vector<double> values;  ///< design or outputs
  bool retry = false;
  std::string why;
};

/// The shortest text that reads back as the same number.
inline std::string exact_text(double value) {
  char text[32];
  return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

inline std::string trial_text(int id, const std::vector<double>& values) {
  std::string s = std::to_string(id);
  for (const double v : values) s += ' ' + exact_text(v);
  return s;
}

inline JournalEntry ask_entry(int id, const std::vector<double>& design) {
  return {0, "ask", trial_text(id, design), "", ""};
}
inline JournalEntry tell_entry(int id, const std::vector<double>& outputs) {
  return {0, "tell", trial_text(id, outputs), "", ""};
}
inline JournalEntry fail_entry(int id, bool retry, const std::string& why) {
  return {0, "fail", std::to_string(id) + (retry ? " retry " : " final ") + why, "", ""};
}

/// Throws StoreError for an entry that is none of these.
inline TrialEntry parse_trial(const JournalEntry& entry) {
  const auto refuse = [&] {
    throw StoreError(StoreError::Reason::corrupt,
                     message("entry ", entry.number, " is no trial: ", entry.kind, ' ', entry.content));
  };
  std::string_view rest = entry.content;
  const auto take = [&](auto& value) {
    const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), value);
    if (error != std::errc{} || (end != rest.data() + rest.size() && *end != ' ')) refuse();
    rest.remove_prefix(std::min(rest.size(), std::size_t(end - rest.data()) + 1));
  };
  TrialEntry t;
  take(t.id);
  if (t.id < 0) refuse();
  if (entry.kind == "fail") {
    t.kind = TrialEntry::Kind::fail;
    t.retry = rest.starts_with("retry ");
    if (!t.retry && !rest.starts_with("final ")) refuse();
    t.why = rest.substr(6);
    return t;
  }
  if (entry.kind != "ask" && entry.kind != "tell") refuse();
  t.kind = entry.kind == "ask" ? TrialEntry::Kind::ask : TrialEntry::Kind::tell;
  while (!rest.empty()) take(t.values.emplace_back());
  return t;
}

}  // namespace lumo
