#pragma once

#include "lumo/sense/devices/photodiodes.hpp"
#include "lumo/sense/recording/tables.hpp"

#include <optional>
#include <string>
#include <vector>

namespace lumo::sense {

/// Reads photodiode.csv: stamp_ns (or time_s), signal_V_0, signal_V_1, … without gaps in the numbers. Throws
/// InputError.
inline std::vector<PhotodiodeSample> read_photodiode_log(std::istream& in, const std::string& name) {
  CsvReader csv(in, name);
  StampColumn stamp(csv);
  std::vector<int> column;
  while (csv.find(numbered("signal_V", int(column.size()))) >= 0)
    column.push_back(csv.find(numbered("signal_V", int(column.size()))));
  if (column.empty()) csv.require("signal_V_0");
  csv.require_known([&](std::string_view c) {
    bool known = is_time(c);
    for (std::size_t i = 0; i < column.size(); ++i) known = known || c == numbered("signal_V", int(i));
    return known;
  });
  std::vector<PhotodiodeSample> list;
  while (csv.next()) {
    PhotodiodeSample s{stamp.read(csv), Eigen::VectorXd(Eigen::Index(column.size()))};
    for (std::size_t i = 0; i < column.size(); ++i) s.signal_V[Eigen::Index(i)] = csv.number(column[i]);
    list.push_back(std::move(s));
  }
  return list;
}

inline std::string photodiode_log_text(const std::vector<PhotodiodeSample>& samples) {
  std::string t = "stamp_ns";
  const auto n = samples.empty() ? Eigen::Index(1) : samples.front().signal_V.size();
  for (Eigen::Index i = 0; i < n; ++i) t += ',' + numbered("signal_V", int(i));
  t += '\n';
  std::optional<std::int64_t> last;
  for (const PhotodiodeSample& s : samples) {
    if (s.signal_V.size() != n) throw InvalidArgument("photodiode log: samples must have the same number of diodes");
    t += stamp_text(s.stamp_ns, last);
    for (Eigen::Index i = 0; i < n; ++i) t += ',' + csv_number(s.signal_V[i]);
    t += '\n';
  }
  return t;
}

}  // namespace lumo::sense
