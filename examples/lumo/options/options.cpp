#include "options/options.hpp"

#include "console/text.hpp"

#include <charconv>
#include <cmath>
#include <cstdlib>

namespace lumo::program {

namespace {

[[noreturn]] void refuse(const std::string& flag, std::string_view typed, const std::string& wanted) {
  throw UsageError(flag + " is " + in_quotes(typed) + ", must " + wanted);
}

double finite(const std::string& flag, std::string_view typed, std::string_view unit) {
  const auto value = parse_number(typed);
  const std::string in_unit = unit.empty() ? "" : lumo::message(" [", unit, "]");
  if (!value) refuse(flag, typed, "be a number" + in_unit);
  if (!std::isfinite(*value)) refuse(flag, typed, "be a finite number" + in_unit);
  return *value;
}

/// An empty value would be taken for an absent one.
CLI::Option* with_value(const CLI::App& app, CLI::Option* option, const std::string& kind) {
  option->type_name(kind)->allow_extra_args(false);
  return option->each([flag = option->get_name(), &app](const std::string& value) {
    const std::string hint = " (see " + full_name(app) + " --help)";
    if (value.empty()) throw UsageError(flag + " is '', must have a value" + hint);
    if (value.starts_with("--")) throw UsageError(flag + " needs a value, found " + in_quotes(value) + hint);
  });
}

}  // namespace

std::vector<std::string_view> split(std::string_view s, char separator) {
  std::vector<std::string_view> fields;
  while (true) {
    const std::size_t comma = s.find(separator);
    fields.push_back(s.substr(0, comma));
    if (comma == std::string_view::npos) return fields;
    s.remove_prefix(comma + 1);
  }
}

std::string shortened(std::string s) { return s.size() > 80 ? s.substr(0, 77) + "..." : s; }

std::string in_quotes(std::string_view s) { return "'" + shortened(one_line(s)) + "'"; }

std::optional<double> parse_number(std::string_view s) {
  if (s.starts_with('+') && s.size() > 1 && s[1] != '-' && s[1] != '+') s.remove_prefix(1);
  double value = 0.0;
  const auto [end, error] = std::from_chars(s.data(), s.data() + s.size(), value);
  if (s.empty() || end != s.data() + s.size()) return std::nullopt;
  // 0 or infinite; the locale is always "C" here.
  if (error == std::errc::result_out_of_range) return std::strtod(std::string(s).c_str(), nullptr);
  if (error != std::errc{}) return std::nullopt;
  return value;
}

double number_in(const std::string& flag, std::string_view typed, const Limits& limits, const char* unit) {
  const double value = finite(flag, typed, unit);
  if (value >= limits.low && value <= limits.high) return value;
  refuse(flag, typed, lumo::message("lie in [", limits.low, ", ", limits.high, "]", *unit ? " " : "", unit));
}

int whole_in(const std::string& flag, std::string_view typed, int low, int high) {
  int value = 0;
  const char* const last = typed.data() + typed.size();
  const auto [end, error] = std::from_chars(typed.data(), last, value);
  if (typed.empty() || error != std::errc{} || end != last || value < low || value > high)
    refuse(flag, typed, lumo::message("be a whole number from ", low, " to ", high));
  return value;
}

std::string one_of(const std::string& flag, const std::string& typed, const std::vector<std::string>& choices) {
  std::string list;
  for (const std::string& c : choices) {
    if (typed == c) return typed;
    list += (list.empty() ? "" : " or ") + c;
  }
  refuse(flag, typed, "be " + list);
}

std::string full_name(const CLI::App& app) {
  return app.get_parent() == nullptr ? app.get_name() : full_name(*app.get_parent()) + " " + app.get_name();
}

CLI::Option* add_value(
    CLI::App& app, const std::string& flag, const std::string& kind, const std::string& help, Read read) {
  return with_value(app, app.add_option_function<std::string>(flag, read, help), kind);
}

CLI::Option* add_texts(CLI::App& app, const std::string& flag, std::vector<std::string>& into, const std::string& kind,
    const std::string& help) {
  return with_value(app, app.add_option(flag, into, help), kind);
}

CLI::Option* add_text(
    CLI::App& app, const std::string& flag, std::string& into, const std::string& kind, const std::string& help) {
  return add_value(app, flag, kind, help, [&into](const std::string& typed) { into = typed; });
}

CLI::Option* add_text(CLI::App& app, const std::string& flag, std::optional<std::string>& into, const std::string& kind,
    const std::string& help) {
  return add_value(app, flag, kind, help, [&into](const std::string& typed) { into = typed; });
}

CLI::Option* add_whole(CLI::App& app, const std::string& flag, int& into, int low, int high, const std::string& help) {
  return add_value(app, flag, "N", help,
      [&into, flag, low, high](const std::string& typed) { into = whole_in(flag, typed, low, high); });
}

CLI::Option* add_flag(CLI::App& app, const std::string& flag, bool& into, const std::string& help) {
  return app.add_flag(flag, into, help)->disable_flag_override();
}

CLI::Option* add_word(CLI::App& app, const std::string& flag, std::string& into,
    const std::vector<std::string>& choices, const std::string& help) {
  return add_value(app, flag, "NAME", help,
      [&into, flag, choices](const std::string& typed) { into = one_of(flag, typed, choices); });
}

}  // namespace lumo::program
