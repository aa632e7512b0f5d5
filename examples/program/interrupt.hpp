#pragma once

namespace lumo::program {

/// From here on Ctrl-C and a termination request end the program at once with exit code 130 and one line on standard error.
/// Solves write nothing, so there is nothing to tidy up; files are completed first (see FilesBeingWritten).
void stop_on_interrupt();

/// While one of these lives an interrupt waits, so that no file is left half-written or without its companions.
class FilesBeingWritten {
 public:
  FilesBeingWritten();
  ~FilesBeingWritten();
  FilesBeingWritten(const FilesBeingWritten&) = delete;
  FilesBeingWritten& operator=(const FilesBeingWritten&) = delete;
};

}  // namespace lumo::program
