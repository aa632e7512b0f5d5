#pragma once

#include "configuration/mechanics.hpp"
#include "lumo/core/units.hpp"
#include "lumo/drawing/svg.hpp"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <limits>
#include <span>
#include <string>
#include <string_view>

/// Numbers, columns and lines that people read.
namespace lumo::program {

/// "Not defined by the given loads", or not measured: null in JSON, a dash in text.
inline constexpr double undefined = std::numeric_limits<double>::quiet_NaN();

/// Control characters would break a message's one line, or the terminal.
inline std::string one_line(std::string_view s) {
  std::string out;
  for (const char c : s) out += c == '\n' ? ' ' : static_cast<unsigned char>(c) < 32 || c == 127 ? '?' : c;
  return out;
}

/// Without the last digits, which a change of unit leaves: 30°, not 29.999999999999996.
inline double as_typed(double v) { return std::round(v * 1e9) / 1e9; }
inline double mm(double m) { return as_typed(1e3 * m); }
inline double degrees(double rad) { return as_typed(rad * 180.0 / pi); }

/// A design as it is typed, or with another separator.
inline std::string joined(std::span<const double> values, const char* separator = ",") {
  std::string s;
  for (const double v : values) s += (s.empty() ? "" : separator) + short_number(v);
  return s;
}

/// With `digits` after the point, or a dash where it is not defined.
inline std::string cell(double v, int digits, int width = 0) {
  std::string text = "-";
  if (std::isfinite(v)) {
    char buffer[400];  // the largest number has 309 digits before the point
    text.assign(buffer, std::to_chars(buffer, buffer + sizeof buffer, v, std::chars_format::fixed, digits).ptr);
  }
  if (text.size() < std::size_t(width)) text.insert(0, std::size_t(width) - text.size(), ' ');
  return text;
}

inline std::string scientific(double v, int digits = 3) {
  if (!std::isfinite(v)) return "-";
  char buffer[64];
  return {buffer, std::to_chars(buffer, buffer + sizeof buffer, v, std::chars_format::scientific, digits).ptr};
}

/// Of UTF-8: characters, not bytes.
inline int length(std::string_view s) {
  return int(
      std::count_if(s.begin(), s.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0u) != 0x80u; }));
}

/// Filled up with blanks, on the left, or for a negative width on the right.
inline std::string pad(std::string s, int width) {
  if (const int missing = std::abs(width) - length(s); missing > 0)
    s.insert(width > 0 ? 0 : s.size(), std::size_t(missing), ' ');
  return s;
}

/// How presses were computed.
inline std::string mechanics_text(const Mechanics& m) {
  std::string s = m.solver == Mechanics::Solver::vbd
                      ? "vertex block descent, " + std::to_string(m.sweeps) + " sweeps a step"
                      : "quasi-static";
  s += ", " + std::string(name(m.element)) + " tetrahedra" +
       (m.size_mm > 0.0 ? " of " + short_number(m.size_mm) + " mm" : ", graded");
  s += m.law == Mechanics::Law::newton ? ", Newton's Neo-Hookean law" : ", Neo-Hookean law";
  return s + (m.points == Mechanics::Points::vertex ? ", contact at vertices" : ", contact all over the surface") +
         ", friction " + short_number(m.friction);
}

/// A field of a CSV file that may hold anything (RFC 4180).
inline std::string csv_text(std::string_view s) {
  std::string out = "\"";
  for (const char c : s) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

/// A time as people say it.
inline std::string span(double seconds) {
  char text[32];
  if (seconds < 99.95) return cell(seconds, 1) + " s";
  if (seconds < 5400) std::snprintf(text, sizeof text, "%d min %02d s", int(seconds) / 60, int(seconds) % 60);
  else std::snprintf(text, sizeof text, "%d h %02d min", int(seconds) / 3600, int(seconds) / 60 % 60);
  return text;
}

/// As a shell takes it for one word.
inline std::string shell_word(const std::string& s) {
  const auto plain = [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 ||
           std::string_view("/._-+=:,@%").find(c) != std::string_view::npos;
  };
  if (!s.empty() && std::all_of(s.begin(), s.end(), plain)) return s;
  std::string quoted = "'";
  for (const char c : s) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

}  // namespace lumo::program
