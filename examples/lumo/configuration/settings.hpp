#pragma once

#include "configuration/configuration.hpp"
#include "report/json.hpp"

#include <functional>
#include <string>
#include <vector>

/// What can be set in a configuration, by name.
namespace lumo::program {

/// Where a default comes from.
enum class Mark {
  paper,     ///< the paper's text
  code,      ///< its first author's public code, where the paper is silent
  inferred,  ///< from either
  lumo       ///< lumo's own choice
};
std::string_view name(Mark mark);

struct Setting;
/// The same of a configuration's value: those of a finger that is not as its authors built it are lumo's own.
Mark source_of(const Setting& setting, const Configuration& configuration);

enum class Kind { number, number_or_null, whole, flag, word, numbers };

/// One value of a configuration. Units stand in the path.
struct Setting {
  std::string path;
  Kind kind;
  Mark mark;
  std::string help;
  std::function<Json(const Configuration&)> get = {};
  std::function<void(Configuration&, const Json&)> put = {};  ///< of a value that fits
  Limits limits{0.0, 0.0};
  std::string unit = {};
  std::vector<std::string> words = {};  ///< those there are; empty: any
  std::size_t count = 0;                ///< of numbers; 0: one or more
  bool increasing = false;              ///< numbers
};

/// All of them, in the order in which they are applied: what decides others comes before them.
const std::vector<Setting>& settings();
/// Throws UsageError that names the nearest one.
const Setting& setting(const std::string& path);

/// A value that does not fit: what is wrong about it, if that needs words, and what it must be.
struct Misfit {
  std::string detail, wanted;
  int field = -1;  ///< of a list; −1: the whole
};
/// Throws Misfit.
void put(const Setting& setting, Configuration& configuration, const Json& value);
/// What was typed, as the setting's kind has it; text where it does not fit, which put() refuses.
Json typed_value(const Setting& setting, const std::string& typed);

/// On one line, shortened: as messages show a value.
std::string short_form(const Json& value);
/// The values that it admits, in a few words.
std::string admitted(const Setting& setting);

/// The one of `known` that is spelled most like `word`.
std::string nearest(const std::string& word, const std::vector<std::string>& known);

}  // namespace lumo::program
