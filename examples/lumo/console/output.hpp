#pragma once

#include "console/progress.hpp"

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace lumo::program {

/// The files of one command. They are collected first and appear together, complete, under their names, or not at all.
class Output {
 public:
  /// Throws InputError when `directory` cannot be made or written to, so that a long run does not end in vain; makes
  /// nothing yet.
  explicit Output(std::optional<std::string> directory);

  bool wanted() const { return directory_.has_value(); }
  void add(std::string name, std::string contents);
  /// Writes all files and returns their paths. Throws InputError and leaves no file of this run behind.
  std::vector<std::string> write();

 private:
  std::optional<std::string> directory_;
  std::vector<std::pair<std::string, std::string>> files_;
};

/// To standard output. Throws InputError when it does not hold; a reader who has closed it has seen enough, which is no
/// error.
void print(const std::string& text);

/// The end of a command: its files are written, its result is printed, and each file is named. The result is printed
/// even where the files cannot be written: the work is done, and not to be lost with them. Throws InputError.
void hand_out(const std::string& result, Output& files, Progress& progress);

}  // namespace lumo::program
