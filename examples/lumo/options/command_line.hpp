#pragma once

#include "console/output.hpp"
#include "console/progress.hpp"
#include "options/options.hpp"

#include <CLI/App.hpp>

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>

namespace lumo::program {

enum ExitCode { ok = 0, fault = 1, usage = 2, infeasible = 3, numerical = 4, bad_file = 5 };

/// One line on standard error.
int complain(const std::string& text, ExitCode code);

/// What a command prints, or what it got to before a solve failed; files are for good results only.
struct Result {
  std::string text;
  std::string failure = {};  ///< of a solve; empty: none

  Result(std::string printed) : text(std::move(printed)) {}
  Result(std::string printed, std::string failed) : text(std::move(printed)), failure(std::move(failed)) {}
};

/// The options that commands share.
struct Common {
  bool json = false;
  bool quiet = false;
  std::optional<std::string> out;  ///< directory for files
};

/// --json and --quiet.
void add_common(CLI::App& app, Common& o);
/// --out, a directory for files.
void add_out(CLI::App& app, Common& o);

/// A command has options, declares them, may check() them together, and runs; what it returns is printed when its files
/// are written.
template <class C>
concept Command = std::derived_from<C, Common> && requires(C c, CLI::App& app, Output& files, Progress& progress) {
  c.declare(app);
  { c.run(files, progress) } -> std::convertible_to<Result>;
};

/// The program's commands, and which of them was typed.
class CommandLine {
 public:
  CommandLine(
      const std::string& program, const std::string& about, const std::string& version_line, const std::string& footer);

  /// What the help says of commands with that first word: "campaign" of "campaign run".
  void name_group(const std::string& name, const std::string& help) { groups_[name] = {help, nullptr}; }
  template <Command C> void add(const std::string& name, const std::string& help, C options = {}) {
    const auto command = std::make_shared<C>(std::move(options));
    command->declare(make(name, help, [command] { return run(*command); }));
  }
  /// A command without its libraries: says which Debian packages it needs.
  void add_off(const std::string& name, const std::string& packages);

  /// What to run; empty when help or the version was asked for, which are then in `text`. Throws UsageError.
  std::function<int()> parse(std::span<char* const> arguments, std::string& text);

 private:
  template <Command C> static int run(C& command) {
    if constexpr (requires { command.check(); }) command.check();
    if constexpr (requires { command.printed_instead(); })
      if (const auto text = command.printed_instead()) {
        print(*text);
        return ok;
      }
    Output files(command.out);
    Progress progress(command.quiet);
    return hand_over(command.run(files, progress), files, progress);
  }
  static int hand_over(const Result& outcome, Output& files, Progress& progress);
  CLI::App& parent_of(const std::string& name);
  CLI::App& make(const std::string& name, const std::string& help, std::function<int()> run);
  void refuse_extras(const CLI::App& chosen, std::span<char* const> arguments) const;

  CLI::App app_;
  std::map<std::string, std::pair<std::string, CLI::App*>> groups_;  ///< help, and once it has a command, the group
  std::map<const CLI::App*, std::function<int()>> runs_;
};

}  // namespace lumo::program
