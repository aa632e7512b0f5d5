#pragma once

#include "lumo/optimize/problem.hpp"

#include <nlohmann/json.hpp>

#include <string>
#include <string_view>
#include <vector>

/// `lumo optimize`: ask and tell as JSON lines.
namespace lumo::program {

/// What a space file says.
struct SpaceFile {
  Problem problem;
  double failures = 0.5;         ///< share of the evaluations above which failures end a search; 1: never
  std::string source;            ///< of candidates: "paper" or "default"
  nlohmann::ordered_json whole;  ///< the file with all defaults, for comparison with a transcript
};

/// Throws InputError in one line: the file, the key, its value, and what it must be. `known_table`: CSV of further
/// known results, or empty.
SpaceFile read_space(const std::string& path, const std::string& known_table);

/// Results of a table with a column for each variable (`<name>` or `<name>_<unit>`) and objective, and perhaps one
/// `<objective>_err` for each; where it has a column `state`, of the rows in which that is "evaluated". Throws
/// InputError in one line.
std::vector<KnownResult> read_known_table(const std::string& path, const Problem& problem);

/// Throws InvalidArgument with the predicate of a sentence for what is no JSON, holds a number that is not finite, has
/// a key twice, or nests values so deeply that only an attack makes sense of it.
nlohmann::ordered_json parse_strictly(std::string_view text);

/// What of a space must stay as it is as long as a search lasts, with names that depend on nothing: bounds, lattices,
/// constraints, goals and initial designs. All else may change from one evaluation to the next.
nlohmann::ordered_json fixed_part(const nlohmann::ordered_json& space);

/// What differs between two JSON values, as `key is …, was …`; empty when they are equal.
std::string difference(
    const nlohmann::ordered_json& now, const nlohmann::ordered_json& before, const std::string& key = "");

}  // namespace lumo::program
