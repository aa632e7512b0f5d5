#pragma once

#include "options/command_line.hpp"
#include "options/groups.hpp"

/// Each command has a file: its options, its registration, and what it does. The build makes a list of those whose
/// libraries are there.
namespace lumo::program {

/// Registers all commands, in the order of the help.
void add_commands(CommandLine& line);

/// What the commands about one design share.
struct DesignCommand : Configured {
  int threads = all_threads();

  void declare_common(CLI::App& app) {
    declare_configuration(app);
    add_pad(app, effective);
    add_threads(app, threads);
    add_out(app, *this);
    add_common(app, *this);
  }
};

}  // namespace lumo::program
