#include "console/output.hpp"

#include "console/interrupt.hpp"
#include "console/text.hpp"
#include "lumo/core/error.hpp"
#include "lumo/core/files.hpp"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <system_error>

namespace lumo::program {

namespace fs = std::filesystem;

namespace {

[[noreturn]] void refuse(const fs::path& path, const std::string& why) {
  throw InputError("cannot write to '" + path.string() + "': " + why);
}

}  // namespace

// Whether a directory can be made is known when it has been made; nothing is left of that.
Output::Output(std::optional<std::string> directory) : directory_(std::move(directory)) {
  if (!directory_) return;
  std::error_code error;
  fs::path wanted = fs::absolute(*directory_, error).lexically_normal();
  if (!wanted.has_filename()) wanted = wanted.parent_path();  // "out/" is "out"
  std::vector<fs::path> made;
  fs::path there = wanted;  // what the new ones are made in
  for (; !fs::exists(fs::symlink_status(there, error)) && there != there.parent_path(); there = there.parent_path())
    made.push_back(there);
  if (!fs::is_directory(there, error)) {
    if (error && error != std::errc::no_such_file_or_directory)
      refuse(*directory_, error.message());  // a link to nowhere is no directory
    refuse(*directory_, made.empty() ? "it is not a directory" : "part of it is not a directory");
  }
  fs::create_directories(wanted, error);
  std::string why = error ? error.message() : "";
  if (why.empty() && access(wanted.c_str(), W_OK | X_OK) != 0) why = std::strerror(errno);
  for (const fs::path& p : made)
    if (fs::is_empty(p, error) && !error) fs::remove(p, error);
  if (!why.empty()) refuse(*directory_, why);
}

void Output::add(std::string name, std::string contents) {
  if (wanted()) files_.emplace_back(std::move(name), std::move(contents));
}

std::vector<std::string> Output::write() {
  std::vector<std::string> paths;
  if (!wanted() || files_.empty()) return paths;
  const FilesBeingWritten guard;
  const fs::path directory = *directory_;
  std::error_code error;
  fs::create_directories(directory, error);
  if (error) refuse(directory, error.message());
  for (const auto& [name, contents] : files_)
    if (fs::is_directory(directory / name, error)) refuse(directory / name, "it is a directory");

  std::vector<Part> parts;
  const auto give_up = [&](const fs::path& path, const std::string& why) {
    for (const std::string& p : paths) fs::remove(p, error);
    refuse(path, why);
  };
  for (const auto& [name, contents] : files_) {
    const fs::path hidden = directory / ("." + name);
    Part::sweep(hidden);
    errno = 0;
    auto part = Part::make(hidden, Part::Kind::file);
    if (!part || !part->write(contents) || !part->synchronise())
      give_up(directory / name, errno != 0 ? std::strerror(errno) : "write failed");
    parts.push_back(std::move(*part));
  }
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const fs::path path = directory / files_[i].first;
    if (!parts[i].take_name(path)) give_up(path, std::strerror(errno));
    paths.push_back(path.string());
  }
  synchronise(directory.string());  // the names must last as well
  files_.clear();
  return paths;
}

void print(const std::string& text) {
  errno = 0;
  std::cout << text << std::flush;
  const int cause = errno;
  // `lumo section | head -1` is how people look at the beginning: the command has done its work, its files are written
  // before (see hand_out), and what is left of the result is not wanted. So this is no failure of the command.
  if (std::cout || cause == EPIPE) return;
  throw InputError(
      std::string("cannot write to standard output: ") + (cause != 0 ? std::strerror(cause) : "write failed"));
}

void hand_out(const std::string& result, Output& files, Progress& progress) {
  progress.finish();
  std::vector<std::string> paths;
  try {
    paths = files.write();
  } catch (const InputError&) {
    print(result);
    throw;
  }
  print(result);
  for (const std::string& path : paths) progress.note("wrote " + one_line(path));
}

}  // namespace lumo::program
