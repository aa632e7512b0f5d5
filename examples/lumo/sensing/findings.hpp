#pragma once

#include "report/json.hpp"
#include "sensing/log.hpp"

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace lumo::program {

using namespace sense;

/// What was found of one of a log's streams.
struct StreamFinding {
  /// Samples farther apart than so many median periods are a pause.
  static constexpr double pause_periods = 5.0;

  LogStream stream = LogStream::frames;
  std::size_t rows = 0;            ///< that are used
  std::optional<Stretch> stretch;  ///< on the frames' clock
  StreamReading reading;
  double period_s = 0.0;  ///< median
  int pauses = 0;
  double paused_s = 0.0;    ///< in all
  std::size_t outside = 0;  ///< pictures before the first or after the last sample
};

/// Texts, each as one line.
Json lines_json(const std::vector<std::string>& texts);

std::string_view name_of(LogStream stream);

/// Of the streams that the log has.
std::vector<StreamFinding> streams_of(const OpenLog& log);

/// Notes what whoever reads results must know: streams that cannot be read, rows left out, pauses and pictures lost
/// beyond 1 %.
void tell_findings(const OpenLog& log, const PictureCount& pictures, Progress& progress);

/// A line for each stream: how many, from when to when, what is missing.
std::string findings_text(const OpenLog& log, const PictureCount& pictures);
/// `notes`: all that were reported, of the log and of what it was used with.
Json findings_json(const OpenLog& log, const PictureCount& pictures, std::vector<std::string> notes);

/// A log without an estimate: its streams, and what each picture is. Throws InputError.
std::string examined(const std::string& path, const McapTopics& topics, bool as_json, Progress& progress);

}  // namespace lumo::program
