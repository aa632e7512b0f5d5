#pragma once

#include "commands/commands.hpp"
#include "computing/contacts.hpp"
#include "computing/evaluation.hpp"

#include <optional>
#include <string>

namespace lumo::program {

inline constexpr int most_designs = 500;  ///< of a study

/// Words of the help in which studies differ.
struct StudyWords {
  const char *designs, *ensemble;
  const char* coarse = nullptr;  ///< there is no such option
};

/// A command that compares many designs and keeps them in a store.
struct StudyCommand : Configured {
  std::string store;
  int designs = 40, seed = 1;
  StudyTools tools{.threads = all_threads()};

  void declare(CLI::App& app, const StudyWords& words) {
    add_text(app, "--store", store, "FILE", "File that keeps the study; it continues if the file exists");
    add_whole(app, "--designs", designs, 1, most_designs, words.designs);
    add_seed(app, seed, "Of the designs, default 1");
    if (words.coarse != nullptr) add_flag(app, "--coarse", tools.coarse, words.coarse);
    declare_configuration(app);
    add_material(app, effective);
    add_setting(app, effective, "--ensemble", "ensemble.name", words.ensemble);
    add_out(app, *this);
    add_threads(app, tools.threads);
    add_common(app, *this);
  }
  /// Was an ensemble asked for? Else a study presses its own few contacts.
  bool whole_ensemble() const { return effective.gives("ensemble"); }
};

}  // namespace lumo::program
