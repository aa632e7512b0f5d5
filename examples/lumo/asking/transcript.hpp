#pragma once

#include <nlohmann/json.hpp>

#include <string>
#include <vector>

namespace lumo::program {

/// An append-only file of JSON lines: the space, then every ask, tell and fail in the order in which they happened.
/// Each line is on the disk before anything else happens, so that it may end at any moment; what is left of a line that
/// was cut off is dropped.
class Transcript {
 public:
  /// Opens or makes `path` and locks it for as long as this lives. Throws InputError when it cannot, when another
  /// process has it, when it belongs to another space, or when a line makes no sense.
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
  void append(const nlohmann::ordered_json& event);

 private:
  std::string path_;
  int file_ = -1;
  std::vector<Event> events_;
};

}  // namespace lumo::program
