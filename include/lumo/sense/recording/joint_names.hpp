#pragma once

#include "lumo/core/error.hpp"

#include <algorithm>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace lumo::sense {

/// "base, tip", as messages show them.
inline std::string joint_list(const std::vector<std::string>& names) {
  return listing(names, [](const std::string& n) { return printable(n); });
}

/// A name of digits only: a joint's number.
inline bool is_joint_number(std::string_view name) {
  return !name.empty() && std::all_of(name.begin(), name.end(), [](char c) { return c >= '0' && c <= '9'; });
}

/// Whether columns of a table can carry these names: none is empty, a number, or there twice, and none holds what
/// divides a table or ends a line.
inline bool are_column_names(const std::vector<std::string>& names) {
  constexpr std::size_t longest = 200;
  const auto plain = [](const std::string& n) {
    return !n.empty() && n.size() <= longest && !is_joint_number(n) && n.front() != ' ' && n.back() != ' ' &&
           std::none_of(n.begin(), n.end(),
               [](char c) { return c == ',' || c == ';' || c == '"' || static_cast<unsigned char>(c) < ' '; });
  };
  for (std::size_t i = 0; i < names.size(); ++i)
    if (!plain(names[i]) ||
        std::find(names.begin(), names.begin() + std::ptrdiff_t(i), names[i]) != names.begin() + std::ptrdiff_t(i))
      return false;
  return true;
}

/// Place of each wanted name among those that are there. Throws InputError, with `where` before it, for one that is
/// not.
inline std::vector<std::size_t> places_of(
    const std::vector<std::string>& wanted, const std::vector<std::string>& there, const std::string& where) {
  std::vector<std::size_t> places;
  for (const std::string& name : wanted) {
    const auto at = std::find(there.begin(), there.end(), name);
    if (at == there.end())
      throw InputError(message(where, ": has no joint '", printable(name), "', but ", joint_list(there)));
    places.push_back(std::size_t(at - there.begin()));
  }
  return places;
}

}  // namespace lumo::sense
