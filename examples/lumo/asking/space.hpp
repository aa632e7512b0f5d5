#pragma once

#include "lumo/optimize/problem.hpp"

#include <nlohmann/json.hpp>

#include <string>

/// `lumo optimize`: ask and tell as JSON lines.
namespace lumo::program {

/// What a space file says.
struct SpaceFile {
  Problem problem;
  std::string source;            ///< of candidates: "paper" or "default"
  nlohmann::ordered_json whole;  ///< the file with every default written out, for comparison with a transcript
};

/// Throws InputError in one line: the file, the key, its value, and what it must be.
SpaceFile read_space(const std::string& path);

/// Parser callback: throws InvalidArgument where values are nested so deeply that only an attack makes sense of it.
bool flat_enough(int depth, nlohmann::ordered_json::parse_event_t event, nlohmann::ordered_json& parsed);

/// What differs between two JSON values, as `key is …, was …`; empty when they are equal.
std::string difference(
    const nlohmann::ordered_json& now, const nlohmann::ordered_json& before, const std::string& key = "");

}  // namespace lumo::program
