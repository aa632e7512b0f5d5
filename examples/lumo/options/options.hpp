#pragma once

#include "lumo/core/error.hpp"

#include <CLI/App.hpp>

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

/// The kinds of options that commands have. Each reads what was typed strictly, the same in every locale; a message
/// states the option, what was typed, what it must be, and its unit.
namespace lumo::program {

/// The command line is wrong. The program ends with exit code 2.
class UsageError : public Error {
 public:
  using Error::Error;
};

using Read = std::function<void(const std::string& typed)>;

/// An option of any kind: `read` takes the value and throws UsageError for a wrong one. `kind` stands in the help.
CLI::Option* add_value(
    CLI::App& app, const std::string& flag, const std::string& kind, const std::string& help, Read read);

CLI::Option* add_text(
    CLI::App& app, const std::string& flag, std::string& into, const std::string& kind, const std::string& help);
CLI::Option* add_text(CLI::App& app, const std::string& flag, std::optional<std::string>& into, const std::string& kind,
    const std::string& help);
/// May be repeated.
CLI::Option* add_texts(CLI::App& app, const std::string& flag, std::vector<std::string>& into, const std::string& kind,
    const std::string& help);
CLI::Option* add_whole(CLI::App& app, const std::string& flag, int& into, int low, int high, const std::string& help);
CLI::Option* add_flag(CLI::App& app, const std::string& flag, bool& into, const std::string& help);

/// The one of `choices` that was typed. Throws UsageError.
std::string one_of(const std::string& flag, const std::string& typed, const std::vector<std::string>& choices);
CLI::Option* add_word(CLI::App& app, const std::string& flag, std::string& into,
    const std::vector<std::string>& choices, const std::string& help);

/// The number that the whole of `s` spells, the same in every locale; nullopt otherwise. May be NaN or infinite.
std::optional<double> parse_number(std::string_view s);
/// A finite number within its limits. Throws UsageError.
double number_in(const std::string& flag, std::string_view typed, const Limits& limits, const char* unit);
int whole_in(const std::string& flag, std::string_view typed, int low, int high);
/// The fields between separators, at least one.
std::vector<std::string_view> split(std::string_view s, char separator = ',');
/// On one line, shortened, in quotation marks: as messages show what was typed.
std::string in_quotes(std::string_view s);
std::string shortened(std::string s);

/// As typed: "lumo campaign run".
std::string full_name(const CLI::App& app);

}  // namespace lumo::program
