#pragma once

#include "configuration/effective.hpp"
#include "options/command_line.hpp"

#include <optional>
#include <string>

namespace lumo::program {

/// A command whose computation has a configuration: --config, --finger, --assume, --quick and --set, one over the
/// other, and over them the command's own options.
struct Configured : Common {
  Effective effective;
  bool dump_only = false;

  const Configuration& asked() const { return effective.value(); }
  void declare_configuration(CLI::App& app);
  void check() const { effective.check(); }
  /// What is printed in place of a result, if that was asked for.
  std::optional<std::string> printed_instead() const;
};

/// An option for a setting.
CLI::Option* add_setting(
    CLI::App& app, Effective& effective, const std::string& flag, const std::string& path, const std::string& help);

}  // namespace lumo::program
