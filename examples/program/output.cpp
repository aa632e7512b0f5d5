#include "program/output.hpp"

#include "lumo/core/error.hpp"
#include "program/interrupt.hpp"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>

namespace lumo::program {

namespace fs = std::filesystem;

namespace {

[[noreturn]] void refuse(const fs::path& path, const std::string& why) { throw InputError("cannot write to '" + path.string() + "': " + why); }

}  // namespace

Output::Output(std::optional<std::string> directory) : directory_(std::move(directory)) {
  if (!directory_) return;
  std::error_code error;
  const fs::path wanted = fs::absolute(*directory_, error).lexically_normal();
  for (fs::path p = wanted; !error; p = p.parent_path()) {   // the nearest ancestor that is there decides
    const auto status = fs::status(p, error);
    if (status.type() == fs::file_type::not_found) {
      error.clear();
      if (p == p.parent_path()) break;
      continue;
    }
    if (error) break;
    if (!fs::is_directory(status)) refuse(*directory_, "'" + p.string() + "' is not a directory");
    if (access(p.c_str(), W_OK | X_OK) != 0) refuse(*directory_, std::strerror(errno));
    return;
  }
  refuse(*directory_, error ? error.message() : "no such directory");
}

void Output::add(std::string name, std::string contents) {
  if (wanted()) files_.emplace_back(std::move(name), std::move(contents));
}

std::vector<std::string> Output::write() {
  std::vector<std::string> paths;
  if (!wanted() || files_.empty()) return paths;
  const FilesBeingWritten guard;
  const fs::path directory = *directory_;
  const std::string mark = ".part-" + std::to_string(getpid());
  std::error_code error;
  fs::create_directories(directory, error);
  if (error) refuse(directory, error.message());

  std::vector<fs::path> parts;
  const auto give_up = [&](const fs::path& path, const std::string& why) {
    for (const fs::path& p : parts) fs::remove(p, error);
    for (const std::string& p : paths) fs::remove(p, error);
    refuse(path, why);
  };
  for (const auto& [name, contents] : files_) {
    parts.push_back(directory / ("." + name + mark));
    errno = 0;
    std::ofstream file(parts.back(), std::ios::binary | std::ios::trunc);
    file.write(contents.data(), std::streamsize(contents.size()));
    file.close();
    if (!file) give_up(directory / name, errno != 0 ? std::strerror(errno) : "write failed");
  }
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const fs::path path = directory / files_[i].first;
    fs::rename(parts[i], path, error);
    if (error) {
      const std::string why = error.message();
      give_up(path, why);
    }
    paths.push_back(path.string());
  }
  files_.clear();
  return paths;
}

}  // namespace lumo::program
