#pragma once

// Linux: who am I, and does that process still live? (proc(5))

#include <unistd.h>
#include <fstream>
#include <string>

namespace lumo {

namespace detail {

inline std::string first_line(const std::string& file) {
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  return line;
}

// Start time of a process in clock ticks after boot; empty when there is none, or only its remains.
inline std::string process_start(const std::string& pid) {
  const std::string line = first_line("/proc/" + pid + "/stat");
  const std::size_t name_end = line.rfind(')');  // the name in parentheses may hold anything
  if (name_end == std::string::npos || name_end + 2 >= line.size() || line[name_end + 2] == 'Z') return "";
  std::size_t at = name_end + 1;
  for (int field = 2; field < 21; ++field) at = line.find(' ', at + 1);
  return at == std::string::npos ? "" : line.substr(at + 1, line.find(' ', at + 1) - at - 1);
}

}  // namespace detail

/// Names this process for as long as the machine is not started again: boot, number, start time.
inline std::string process_token() {
  const std::string pid = std::to_string(getpid());
  return detail::first_line("/proc/sys/kernel/random/boot_id") + ' ' + pid + ' ' + detail::process_start(pid);
}

/// Does the process of this token live, on this machine? Those of another machine, or from before it was started again,
/// count as dead.
inline bool process_lives(const std::string& token) {
  const std::size_t a = token.find(' '), b = token.rfind(' ');
  if (a == std::string::npos || a == b) return false;
  const std::string start = detail::process_start(token.substr(a + 1, b - a - 1));
  return token.substr(0, a) == detail::first_line("/proc/sys/kernel/random/boot_id") && !start.empty() &&
         start == token.substr(b + 1);
}

}  // namespace lumo
