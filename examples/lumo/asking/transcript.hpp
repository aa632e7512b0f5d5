#pragma once

#include <nlohmann/json.hpp>

#include <cstdint>
#include <string>
#include <vector>

namespace lumo::program {

/// An append-only file of JSON lines: the space, then every ask, tell and fail in the order in which they happened, and
/// the space again where it changed. Each line is on the disk before anything else happens, so that it may end at any
/// moment; what is left of a line that was cut off is dropped. Each line carries a digest of itself and of all before
/// it. Transcripts of earlier versions have none: their lines are covered by the digest of the first line added.
class Transcript {
 public:
  /// Opens or makes `path` and locks it for as long as this lives; a space that differs in what may change is noted.
  /// Throws InputError when it cannot, when another process has it, when it belongs to another space, or when a line
  /// makes no sense or is not what was written.
  Transcript(const std::string& path, const nlohmann::ordered_json& space);
  ~Transcript();
  Transcript(const Transcript&) = delete;
  Transcript& operator=(const Transcript&) = delete;

  /// The events that were there, with the number of their line.
  struct Event {
    int line;
    nlohmann::ordered_json content;
  };
  const std::vector<Event>& events() const { return events_; }
  /// How the space differs from that of the last run, as `key is ..., was ...`; empty if it does not.
  const std::string& change() const { return change_; }
  /// Throws InputError where the line cannot be kept, or the file is no longer the one at its path; then all that it
  /// held is beside it with this line.
  void append(const nlohmann::ordered_json& event);

 private:
  void read(const std::string& text);
  void take_space(const nlohmann::ordered_json& space);
  void require_in_place(const std::string& line) const;

  std::string path_;
  int file_ = -1;
  std::uint64_t digest_ = 0;  ///< of the last line
  std::vector<Event> events_;
  std::string change_;
};

}  // namespace lumo::program
