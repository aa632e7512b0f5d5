#pragma once

#include "lumo/core/error.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace lumo::sense {

/// What the file metadata.yaml of a ROS 2 bag's folder says of its files (rosbag2_storage/yaml.hpp).
struct BagMetadata {
  std::string storage;             ///< "mcap", "sqlite3"
  std::vector<std::string> files;  ///< in their order, below the folder
};

namespace detail {

/// A value without blanks, comment and quotes.
inline std::string yaml_scalar(std::string_view text) {
  const auto trim = [&] {
    while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
    while (!text.empty() && (text.back() == ' ' || text.back() == '\t' || text.back() == '\r')) text.remove_suffix(1);
  };
  trim();
  if (!text.empty() && (text.front() == '"' || text.front() == '\'')) {
    const std::size_t end = text.find(text.front(), 1);
    return std::string(text.substr(1, end == std::string_view::npos ? end : end - 1));
  }
  if (const std::size_t comment = text.find(" #"); comment != std::string_view::npos) text = text.substr(0, comment);
  trim();
  return std::string(text);
}

}  // namespace detail

/// Reads metadata.yaml as rosbag2 writes it: of YAML no more than lines "key: value" and the list of files, in block or
/// in flow style. Throws InputError if it names no files, or such as do not lie below the folder.
inline BagMetadata bag_metadata(std::string_view text, const std::string& name) {
  BagMetadata m;
  bool listing = false;
  const auto add = [&](std::string_view item) {
    if (const std::string file = detail::yaml_scalar(item); !file.empty()) m.files.push_back(file);
  };
  for (std::size_t from = 0; from < text.size();) {
    const std::size_t end = std::min(text.find('\n', from), text.size());
    std::string_view line = text.substr(from, end - from);
    from = end + 1;
    line.remove_prefix(std::min(line.find_first_not_of(" \t"), line.size()));
    if (listing && line.starts_with("- ")) {
      add(line.substr(2));
      continue;
    }
    const std::size_t colon = line.find(':');
    const std::string_view key = line.substr(0, std::min(colon, line.size()));
    const std::string value =
        colon == std::string_view::npos ? std::string() : detail::yaml_scalar(line.substr(colon + 1));
    if (key == "storage_identifier") m.storage = value;
    listing = key == "relative_file_paths" && m.files.empty();
    if (listing && value.starts_with('['))
      for (std::size_t at = 1; at < value.size();) {
        const std::size_t next = std::min(value.find_first_of(",]", at), value.size());
        add(std::string_view(value).substr(at, next - at));
        at = next + 1;
      }
  }
  if (m.files.empty()) throw InputError(message(name, ": names no files (relative_file_paths)"));
  for (const std::string& file : m.files)
    if (file.front() == '/' || file.find("..") != std::string::npos || file.find('\0') != std::string::npos)
      throw InputError(message(name, ": file '", printable(file), "' does not lie below the folder"));
  return m;
}

/// Puts the files of a bag in the order of the numbers in their names: bag_2 before bag_10.
inline void sort_by_number(std::vector<std::string>& files) {
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  const auto key = [&](const std::string& name) {
    std::string padded;
    for (std::size_t i = 0; i < name.size();) {
      std::size_t end = i;
      while (end < name.size() && is_digit(name[end])) ++end;
      constexpr std::size_t most_digits = 20;
      if (end > i) padded += std::string(most_digits - std::min(most_digits, end - i), '0') + name.substr(i, end - i);
      else padded += name[end++];
      i = end;
    }
    return padded;
  };
  std::sort(files.begin(), files.end(),
      [&](const std::string& a, const std::string& b) { return std::pair(key(a), a) < std::pair(key(b), b); });
}

}  // namespace lumo::sense
