#pragma once

#include "lumo/optimize/problem.hpp"

#include <nlohmann/json.hpp>

#include <string>
#include <vector>

/// `lumo optimize`: ask and tell as JSON lines.
namespace lumo::program {

/// Parser callback: throws InvalidArgument where values are nested so deeply that only an attack makes sense of it.
bool flat_enough(int depth, nlohmann::ordered_json::parse_event_t event, nlohmann::ordered_json& parsed);

/// What a space file says.
struct SpaceFile {
  Problem problem;
  std::string source;            ///< of candidates: "paper" or "default"
  nlohmann::ordered_json whole;  ///< the file with every default written out, for comparison with a transcript
};

/// Throws InputError in one line: the file, the key, its value, and what it must be.
SpaceFile read_space(const std::string& path);

/// What differs between two JSON values, as `key is …, was …`; empty when they are equal.
std::string difference(const nlohmann::ordered_json& now, const nlohmann::ordered_json& before, const std::string& key = "");

/// An append-only file of JSON lines: the space, then every ask, tell and fail in the order in which they happened. Each line is on the disk
/// before anything else happens, so that it may end at any moment; what is left of a line that was cut off is dropped.
class Transcript {
 public:
  /// Opens or makes `path` and locks it for as long as this lives. Throws InputError when it cannot, when another process has it, when it
  /// belongs to another space, or when a line makes no sense.
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

/// Runs to the end. Throws InputError for a bad space file, transcript or answer, or when standard input ends too early.
void optimize(const std::string& space, const std::string& transcript);

}  // namespace lumo::program
