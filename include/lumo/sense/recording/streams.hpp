#pragma once

#include "lumo/core/error.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace lumo::sense {

/// The streams of a log.
enum class LogStream { frames, joints, wrenches, markers, photodiodes };
inline constexpr std::size_t log_streams = 5;

/// What was found of a stream as it was read.
struct StreamReading {
  /// Up to this share of the rows is left out for their stamps or gaps; beyond, the stream is faulty.
  static constexpr double most_left_out = 0.05;

  std::string fault;           ///< why the stream is empty although the log has it; empty: no fault
  std::size_t rows = 0;        ///< that the log has
  std::size_t repeated = 0;    ///< of them left out: they have the stamp of another one
  std::size_t backward = 0;    ///< and those whose stamps are against the order of the others
  std::size_t incomplete = 0;  ///< and those that lack a number which is needed
  bool operator==(const StreamReading&) const = default;

  std::size_t left_out() const { return repeated + backward + incomplete; }
  bool is_beyond_limit() const { return double(left_out()) > most_left_out * double(rows); }
};

/// The rows of a stream that can be kept so that stamps ascend strictly.
struct AscendingRows {
  std::vector<std::size_t> kept;
  StreamReading reading;
};

/// Keeps as many rows as possible, and of rows of one stamp the first: a single stamp in the far future costs one row,
/// not all that follow. By the longest ascending sequence (Fredman, 1975).
inline AscendingRows ascending_rows(std::span<const std::int64_t> stamp_ns) {
  std::vector<std::size_t> last, before(stamp_ns.size());  // `last`: row that ends the sequence of each length
  for (std::size_t i = 0; i < stamp_ns.size(); ++i) {
    const auto at = std::lower_bound(
        last.begin(), last.end(), stamp_ns[i], [&](std::size_t row, std::int64_t t) { return stamp_ns[row] < t; });
    if (at != last.end() && stamp_ns[*at] == stamp_ns[i]) continue;
    if (at != last.begin()) before[i] = *(at - 1);
    if (at == last.end()) last.push_back(i);
    else *at = i;
  }
  AscendingRows rows;
  rows.kept.resize(last.size());
  for (std::size_t n = last.size(), row = n > 0 ? last.back() : 0; n > 0; row = before[row]) rows.kept[--n] = row;
  rows.reading.rows = stamp_ns.size();
  std::size_t next = 0;
  for (std::size_t i = 0; i < stamp_ns.size(); ++i) {
    if (next < rows.kept.size() && rows.kept[next] == i) {
      ++next;
      continue;
    }
    const auto same = std::lower_bound(rows.kept.begin(), rows.kept.end(), stamp_ns[i],
        [&](std::size_t row, std::int64_t t) { return stamp_ns[row] < t; });
    ++(same != rows.kept.end() && stamp_ns[*same] == stamp_ns[i] ? rows.reading.repeated : rows.reading.backward);
  }
  return rows;
}

/// The first stamp that does not exceed the one before it, and the share of such rows, for a message. The row is one
/// of `stamp_ns`, which do not ascend strictly.
inline std::string stamps_fault(std::span<const std::int64_t> stamp_ns, const StreamReading& reading, std::size_t row) {
  return message("stamp ", stamp_ns[row], " ns does not exceed the one before it, ", stamp_ns[row - 1], " ns; ",
      reading.left_out(), " of ", reading.rows, " stamps do not ascend, at most ", 100.0 * StreamReading::most_left_out,
      " % are left out");
}

/// The first row whose stamp does not exceed the one before it; 0: there is none.
inline std::size_t first_backward(std::span<const std::int64_t> stamp_ns) {
  for (std::size_t i = 1; i < stamp_ns.size(); ++i)
    if (stamp_ns[i] <= stamp_ns[i - 1]) return i;
  return 0;
}

/// Period of a stream [s], from at least two rows: the mean, or where pauses make that longer the median.
template <class Rows> double stream_period_s(const Rows& rows) {
  constexpr double most_excess = 1.1;  // of the mean over the median: jitter, no pause
  std::vector<std::int64_t> period;
  for (std::size_t i = 1; i < rows.size(); ++i) period.push_back(rows[i].stamp_ns - rows[i - 1].stamp_ns);
  const auto middle = period.begin() + std::ptrdiff_t(period.size() / 2);
  std::nth_element(period.begin(), middle, period.end());
  const double mean = 1e-9 * double(rows.back().stamp_ns - rows.front().stamp_ns) / double(rows.size() - 1);
  return mean > most_excess * 1e-9 * double(*middle) ? 1e-9 * double(*middle) : mean;
}

/// Leaves these rows of a list, which are in ascending order.
template <class Row> void keep_rows(std::vector<Row>& list, const std::vector<std::size_t>& kept) {
  if (kept.size() == list.size()) return;
  for (std::size_t n = 0; n < kept.size(); ++n)
    if (n != kept[n]) list[n] = std::move(list[kept[n]]);
  list.resize(kept.size());
}

/// From a stream's first stamp to its last one.
struct Stretch {
  std::int64_t from_ns = 0, to_ns = 0;

  template <class Rows> static std::optional<Stretch> of(const Rows& rows) {
    if (rows.empty()) return std::nullopt;
    return Stretch{rows.front().stamp_ns, rows.back().stamp_ns};
  }
  bool holds(std::int64_t stamp_ns) const { return stamp_ns >= from_ns && stamp_ns <= to_ns; }
  bool meets(const Stretch& o) const { return std::max(from_ns, o.from_ns) <= std::min(to_ns, o.to_ns); }
};

/// "12.5 to 19.25 s".
inline std::string to_string(const Stretch& s) {
  const auto seconds = [](std::int64_t ns) {
    const std::int64_t ms = ns / 1'000'000;
    std::string digits = std::to_string(ms < 0 ? -(ms % 1000) : ms % 1000);
    digits.insert(0, 3 - digits.size(), '0');
    return (ns < 0 && ms / 1000 == 0 ? "-" : "") + std::to_string(ms / 1000) + '.' + digits;
  };
  return seconds(s.from_ns) + " to " + seconds(s.to_ns) + " s";
}

}  // namespace lumo::sense
