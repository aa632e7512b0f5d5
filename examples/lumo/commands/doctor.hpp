#pragma once

#include "commands/topics.hpp"
#include "console/progress.hpp"

#include <string>

namespace lumo::program {

/// Text or JSON about a log: see `examined`. Null where the libraries that logs are read with are missing: then
/// doctor_log.cpp, which sets it, is not there.
using ExamineLog = std::string (*)(
    const std::string& path, const lumo::sense::McapTopics& topics, bool as_json, Progress& progress);
inline ExamineLog examine_log = nullptr;

}  // namespace lumo::program
