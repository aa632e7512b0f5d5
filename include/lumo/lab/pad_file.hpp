#pragma once

#include "lumo/core/files.hpp"
#include "lumo/core/sobol.hpp"
#include "lumo/lab/pad_responses.hpp"

#include <charconv>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>

namespace lumo {

// Responses of a pad as a text file: a line that names the format, the key of what was computed, blocks "name rows
// columns" with their numbers row by row, and a last line with a checksum of all before it.

inline constexpr std::string_view pad_file_head = "lumo-pad-responses 1\n";

inline std::uint64_t checksum(std::string_view text) {
  std::uint64_t sum = text.size();
  for (const char c : text) sum = mix64(sum ^ std::uint64_t(static_cast<unsigned char>(c))) + 0x9e3779b97f4a7c15ull;
  return sum;
}

inline void append_block(std::string& to, const char* name, const Eigen::MatrixXd& m) {
  to += message(name, ' ', m.rows(), ' ', m.cols(), '\n');
  char buffer[32];
  for (Eigen::Index i = 0; i < m.rows(); ++i)
    for (Eigen::Index j = 0; j < m.cols(); ++j) {
      const auto [end, error] = std::to_chars(buffer, buffer + sizeof buffer, m(i, j));
      to.append(buffer, end);
      to += j + 1 < m.cols() ? ' ' : '\n';
    }
}

/// Reads blocks in the order in which they were written. Throws InputError.
class BlockReader {
 public:
  BlockReader(std::string_view text, std::string name) : left_(text), name_(std::move(name)) {}

  std::string_view line() {
    const auto end = left_.find('\n');
    if (end == std::string_view::npos) fail("ends too early");
    const std::string_view l = left_.substr(0, end);
    left_.remove_prefix(end + 1);
    return l;
  }
  Eigen::MatrixXd block(std::string_view wanted) {
    const std::string_view head = line();
    const auto first = head.find(' '), second = head.find(' ', first + 1);
    long rows = -1, columns = -1;
    if (first == std::string_view::npos || second == std::string_view::npos || head.substr(0, first) != wanted)
      fail("a block is missing");
    std::from_chars(head.data() + first + 1, head.data() + second, rows);
    std::from_chars(head.data() + second + 1, head.data() + head.size(), columns);
    if (rows < 0 || columns < 0 || rows > 100000 || columns > 10000 || rows * columns > 4000000)
      fail("a block has no sensible size");
    Eigen::MatrixXd m(rows, columns);
    for (long i = 0; i < rows && columns > 0; ++i) {
      const std::string_view l = line();
      const char* at = l.data();
      for (long j = 0; j < columns; ++j) {
        const auto [end, error] = std::from_chars(at, l.data() + l.size(), m(i, j));
        if (error != std::errc{}) fail("a number is damaged");
        at = end + (end < l.data() + l.size());
      }
    }
    return m;
  }
  Eigen::VectorXd column(std::string_view wanted) {
    const Eigen::MatrixXd m = block(wanted);
    if (m.cols() != 1) fail("a block has more than one column");
    return m.col(0);
  }
  [[noreturn]] void fail(const char* why) const { throw InputError(message(name_, ": ", why)); }

 private:
  std::string_view left_;
  std::string name_;
};

/// `key` names in one line what was computed and how; a reader must ask for the same.
inline std::string to_text(const PadResponses& r, const std::string& key) {
  std::string t(pad_file_head);
  t += "key " + key + "\nmaterial " + r.material + '\n';
  const auto add = [&](const char* name, const Eigen::MatrixXd& m) { append_block(t, name, m); };
  add("theta_mm", Eigen::Map<const Eigen::VectorXd>(r.theta_mm.data(), Eigen::Index(r.theta_mm.size())));
  add("diameter_m", Eigen::MatrixXd::Constant(1, 1, r.diameter_m));
  add("position_m", r.position_m);
  add("unloaded", r.unloaded);
  add("place_m", r.place_m);
  add("load_N", r.load_N);
  add("depth_m", r.depth_m);
  for (const auto& m : r.change) add("change", m);
  add("tilt_place_m", r.tilt_place_m);
  for (const auto& m : r.tilt) add("tilt", m);
  add("error", r.error);
  return t + message("checksum ", checksum(t), '\n');
}

/// Throws InputError of one line for what is damaged or was made for another key; without a key any will do. `name`
/// stands in the message.
inline PadResponses pad_responses_from_text(
    std::string_view text, const std::optional<std::string>& key, const std::string& name) {
  BlockReader reader(text, name);
  if (!text.starts_with(pad_file_head)) reader.fail("holds no responses of a pad");
  const auto last = text.rfind("checksum ");
  if (last == std::string_view::npos || text.substr(last) != message("checksum ", checksum(text.substr(0, last)), '\n'))
    reader.fail("is damaged, its checksum is wrong");
  reader.line();
  const std::string_view made_for = reader.line();
  if (key && made_for != "key " + *key) reader.fail("was made for another pad or with other settings");
  PadResponses r;
  const std::string_view material = reader.line();
  r.material = material.substr(std::min<std::size_t>(material.size(), 9));
  const Eigen::VectorXd theta = reader.column("theta_mm");
  r.theta_mm.assign(theta.begin(), theta.end());
  const Eigen::MatrixXd diameter = reader.block("diameter_m");
  if (diameter.size() != 1) reader.fail("the diameter is missing");
  r.diameter_m = diameter(0, 0);
  r.position_m = reader.column("position_m");
  r.unloaded = reader.column("unloaded");
  r.place_m = reader.column("place_m");
  r.load_N = reader.column("load_N");
  r.depth_m = reader.block("depth_m");
  for (Eigen::Index k = 0; k < r.place_m.size(); ++k) r.change.push_back(reader.block("change"));
  r.tilt_place_m = reader.column("tilt_place_m");
  for (Eigen::Index k = 0; k < r.tilt_place_m.size(); ++k) r.tilt.push_back(reader.block("tilt"));
  r.error = reader.column("error");
  validate(r, name);
  return r;
}

/// nullopt if there is no such file. Throws InputError for one that cannot be used.
inline std::optional<PadResponses> read_pad_responses(
    const std::string& path, const std::optional<std::string>& key = {}) {
  if (std::error_code unseen; !std::filesystem::exists(path, unseen)) return std::nullopt;
  const auto text = read_whole(path);
  if (!text) throw InputError(message(path, ": cannot be read"));
  return pad_responses_from_text(*text, key, path);
}

/// The whole file or none. Throws InputError.
inline void write_pad_responses(const std::string& path, const PadResponses& r, const std::string& key) {
  write_whole(path, to_text(r, key));
}

}  // namespace lumo
