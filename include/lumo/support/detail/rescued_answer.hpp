#pragma once

// Finished answers whose store is gone, each in a file that the next worker hands in.

#include "lumo/campaign/journal.hpp"
#include "lumo/core/files.hpp"
#include "lumo/support/detail/entry_chain.hpp"

#include <charconv>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

namespace lumo::detail {

inline constexpr std::string_view rescued_mark = "lumo rescued answer 1\n";

inline std::string rescued_prefix(const std::string& schema) { return schema + ".rescued-"; }

/// Writes the answer to a new file in a folder, with the digest of the problem that it belongs to; the end of a message
/// that says where it is, or that it could not be written.
inline std::string rescued(
    const std::string& folder, const std::string& schema, const JournalEntry& problem, JournalEntry answer) {
  answer.number = 0;
  std::string text(rescued_mark);
  for (const std::string& part : {entry_digest(problem, ""), to_string(answer.kind), answer.content, answer.record,
           answer.notes, entry_digest(answer, "")})
    text += std::to_string(part.size()) + ':' + part;
  // The digest names the file: workers in one folder do not take each other's.
  const std::string path =
      (std::filesystem::path(folder) / (rescued_prefix(schema) + entry_digest(answer, ""))).string();
  try {
    write_whole(path, text);
    return message("; the finished answer is in ", path, ": the next worker that starts there hands it in");
  } catch (const Error& e) {
    return message("; and the finished answer cannot be kept: ", e.what());
  }
}

/// Files of that kind in a folder.
inline std::vector<std::string> rescued_files(const std::string& folder, const std::string& schema) {
  std::vector<std::string> list;
  std::error_code none;
  for (const auto& file : std::filesystem::directory_iterator(folder, none))
    if (file.path().filename().string().starts_with(rescued_prefix(schema))) list.push_back(file.path().string());
  return list;
}

/// The answer in such a file; nullopt if it belongs to another problem, or is not what was written.
inline std::optional<JournalEntry> read_rescued(const std::string& path, const JournalEntry& problem) {
  const std::optional<std::string> text = read_whole(path);
  if (!text || !text->starts_with(rescued_mark)) return std::nullopt;
  std::string_view rest = std::string_view(*text).substr(rescued_mark.size());
  std::vector<std::string> parts;
  while (!rest.empty()) {
    std::size_t size = 0;
    const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), size);
    const auto from = std::size_t(end - rest.data()) + 1;
    if (error != std::errc{} || from > rest.size() || *end != ':' || size > rest.size() - from) return std::nullopt;
    parts.emplace_back(rest.substr(from, size));
    rest.remove_prefix(from + size);
  }
  if (parts.size() != 6 || parts[0] != entry_digest(problem, "")) return std::nullopt;
  const auto kind = journal_kind(parts[1]);
  if (!kind) return std::nullopt;
  JournalEntry answer{0, *kind, parts[2], parts[3], parts[4]};
  return entry_digest(answer, "") == parts[5] ? std::optional(answer) : std::nullopt;
}

}  // namespace lumo::detail
