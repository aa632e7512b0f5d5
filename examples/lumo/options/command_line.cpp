#include "options/command_line.hpp"

#include "console/text.hpp"

#include <CLI/CLI.hpp>

#include <algorithm>
#include <iostream>

namespace lumo::program {

namespace {

/// The last command that was typed, or the program itself.
const CLI::App& innermost(const CLI::App& app) {
  const auto chosen = app.get_subcommands();
  return chosen.empty() ? app : innermost(*chosen.front());
}

std::string hint(const CLI::App& app) { return " (see " + full_name(app) + " --help)"; }

/// Help comes before complaints about values, which CLI11 reads at the end.
void give_help_first(CLI::App& app) {
  app.get_help_ptr()->trigger_on_parse()->each([](const std::string&) { throw CLI::CallForHelp(); });
}

std::string missing(const CLI::App& command) {
  for (const CLI::Option* o : command.get_options())
    if (o->get_required() && o->count() == 0)
      return (o->get_positional() ? o->get_description() : o->get_name()) + " is missing";
  return "an option is missing";
}

std::string excluding(const CLI::App& command) {
  std::string both;
  for (const CLI::Option* o : command.get_options())
    if (o->count() > 0 && !o->get_excludes().empty()) both += (both.empty() ? "" : " and ") + o->get_name();
  return both + " exclude each other";
}

/// What the parser objects to. CLI11 names the option in its own sentences only: options and words are looked at again.
std::string objection(const CLI::App& command, std::span<char* const> arguments, const CLI::ParseError& e) {
  if (dynamic_cast<const CLI::RequiredError*>(&e)) return missing(command);
  if (dynamic_cast<const CLI::ExcludesError*>(&e)) return excluding(command);
  for (const CLI::Option* o : command.get_options())
    if (o->get_expected_max() == 1 && o->count() > 1)
      return lumo::message(o->get_name(), " is given ", o->count(), " times, must be given once");
  const auto named = [&](std::string_view word) {
    return command.get_option_no_throw(std::string(word.substr(0, word.find('='))));
  };
  for (const std::string_view word : arguments.subspan(1)) {
    const CLI::Option* const flag = word.starts_with('-') ? named(word) : nullptr;
    if (flag != nullptr && flag->get_expected_max() == 0 && word.find('=') != std::string_view::npos)
      return flag->get_name() + " takes no value";
  }
  if (const CLI::Option* const o = named(arguments.back())) return o->get_name() + " has no value";
  return shortened(one_line(e.what()));
}

}  // namespace

int complain(const std::string& text, ExitCode code) {
  std::cerr << "lumo: " << one_line(text) << std::endl;
  return code;
}

void add_common(CLI::App& app, Common& o) {
  add_flag(app, "--json", o.json, "Print the result as JSON");
  add_flag(app, "--quiet", o.quiet, "No progress on standard error");
}

void add_out(CLI::App& app, Common& o) {
  add_text(app, "--out", o.out, "DIR", "Directory for files; made when there is something to write");
}

CommandLine::CommandLine(
    const std::string& program, const std::string& about, const std::string& version_line, const std::string& footer)
    : app_(about, program) {
  app_.set_version_flag("--version", version_line);
  app_.require_subcommand(0, 1);
  app_.footer(footer);
  app_.allow_extras();  // unknown words are reported below
  give_help_first(app_);
}

CLI::App& CommandLine::parent_of(const std::string& name) {
  const std::size_t space = name.find(' ');
  if (space == std::string::npos) return app_;
  auto& [help, group] = groups_[name.substr(0, space)];
  if (group != nullptr) return *group;
  group = app_.add_subcommand(name.substr(0, space), help);
  group->require_subcommand(0, 1);
  group->allow_extras();
  give_help_first(*group);
  return *group;
}

CLI::App& CommandLine::make(const std::string& name, const std::string& help, std::function<int()> run) {
  CLI::App& command = *parent_of(name).add_subcommand(name.substr(name.find(' ') + 1), help);
  command.allow_extras();
  give_help_first(command);
  runs_[&command] = std::move(run);
  return command;
}

void CommandLine::add_off(const std::string& name, const std::string& packages) {
  make(name, "Off: needs " + packages, [name, packages]() -> int {
    throw Error("'" + name + "' was built without a library that it needs: " + packages + "; run 'lumo doctor'");
  }).prefix_command(true);
}

int CommandLine::hand_over(const Result& outcome, Output& files, Progress& progress) {
  if (outcome.failure.empty()) {
    hand_out(outcome.text, files, progress);
    return ok;
  }
  progress.finish();
  print(outcome.text);
  return complain(outcome.failure, numerical);
}

void CommandLine::refuse_extras(const CLI::App& chosen, std::span<char* const> arguments) const {
  const auto extras = app_.remaining(true);
  if (extras.empty()) return;
  const std::string& word = extras.front();
  const bool option = word.starts_with('-') && word.size() > 1, complete = runs_.contains(&chosen);
  const auto is_end = [](const char* a) { return std::string_view(a) == "--"; };
  const bool after_end = std::any_of(arguments.begin(), arguments.end(), is_end);
  if (option && complete && !after_end && chosen.get_option_no_throw(word) != nullptr)
    throw UsageError("option " + in_quotes(word) + " must follow the command" + hint(chosen));
  const char* const what = option ? "unknown option " : complete ? "unexpected argument " : "unknown command ";
  throw UsageError(what + in_quotes(word) + hint(chosen));
}

std::function<int()> CommandLine::parse(std::span<char* const> arguments, std::string& text) {
  std::vector<std::string> words(arguments.begin() + (arguments.empty() ? 0 : 1), arguments.end());
  std::reverse(words.begin(), words.end());  // as CLI11 wants them
  try {
    app_.parse(words);
  } catch (const CLI::CallForHelp&) {
    const CLI::App& chosen = innermost(app_);
    text = &chosen == &app_ ? app_.help() : chosen.help(full_name(*chosen.get_parent()), CLI::AppFormatMode::Normal);
    return {};
  } catch (const CLI::CallForVersion& e) {
    text = std::string(e.what()) + "\n";
    return {};
  } catch (const CLI::ParseError& e) {
    const CLI::App& chosen = innermost(app_);
    if (dynamic_cast<const CLI::RequiredError*>(&e)) refuse_extras(chosen, arguments);
    throw UsageError(objection(chosen, arguments, e) + hint(chosen));
  }
  const CLI::App& chosen = innermost(app_);
  const bool off = chosen.get_prefix_command();  // whatever follows
  if (!off) refuse_extras(chosen, arguments);
  const auto run = runs_.find(&chosen);
  if (run == runs_.end()) throw UsageError("no command given" + hint(chosen));
  return run->second;
}

}  // namespace lumo::program
