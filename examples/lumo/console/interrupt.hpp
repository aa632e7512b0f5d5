#pragma once

#include <filesystem>

namespace lumo::program {

/// Starts the program again where OpenBLAS has made threads: it does so before main(), they hear signals, and lumo runs
/// scenarios side by side instead. It then also chooses OpenBLAS's kernels where that chooses badly.
void settle_blas(char** argv);

/// Opens those of standard input, output and error that are closed on nothing. Call it before anything else.
void open_standard_streams();

/// From here on Ctrl-C, a hang-up and a termination request end the program at once with exit code 130 and one line on
/// standard error; a broken pipe and a file that becomes too large are errors of the write. Call it before other
/// threads start. Solves write nothing; files are completed first (see FilesBeingWritten), and folders that are not
/// removed (see UnfinishedFolder).
void stop_on_interrupt();

/// While one of these lives an interrupt waits, so that no file is left half-written or without its companions.
class FilesBeingWritten {
 public:
  FilesBeingWritten();
  ~FilesBeingWritten();
  FilesBeingWritten(const FilesBeingWritten&) = delete;
  FilesBeingWritten& operator=(const FilesBeingWritten&) = delete;
};

/// While one of these lives the first interrupt is only noted, for work that ends well when it is asked to; the second
/// one ends the program.
class GentleStop {
 public:
  GentleStop();
  ~GentleStop();
  GentleStop(const GentleStop&) = delete;
  GentleStop& operator=(const GentleStop&) = delete;
  static bool asked();
};

/// Ends the program as an interrupt does.
[[noreturn]] void end_interrupted();

/// While one of these lives an interrupt removes this folder, which is of no use before it is whole.
class UnfinishedFolder {
 public:
  explicit UnfinishedFolder(std::filesystem::path path);
  ~UnfinishedFolder();
  UnfinishedFolder(const UnfinishedFolder&) = delete;
  UnfinishedFolder& operator=(const UnfinishedFolder&) = delete;

 private:
  std::filesystem::path path_;
};

}  // namespace lumo::program
