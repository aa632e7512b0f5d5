#pragma once

#include "console/interrupt.hpp"

#include "lumo/core/error.hpp"
#include "lumo/core/files.hpp"

#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <system_error>
#include <vector>

namespace lumo::program {

/// A whole file or none, in a NewFolder, which brings all to the disk at its end. Throws InputError.
inline void write_bytes(const std::string& path, const std::vector<std::uint8_t>& bytes) {
  write_whole(path, {reinterpret_cast<const char*>(bytes.data()), bytes.size()}, Durability::memory);
}

/// A log's folder that takes its name only when all is in it.
class NewFolder {
 public:
  explicit NewFolder(const std::string& path) : path_(std::filesystem::path(path).lexically_normal()) {
    if (!path_.has_filename()) path_ = path_.parent_path();
    std::error_code error;
    if (std::filesystem::exists(path_, error) &&
        !(std::filesystem::is_directory(path_, error) && std::filesystem::is_empty(path_, error)))
      throw InputError("cannot write to '" + path + "': it is there and not empty");
    if (path_.has_parent_path()) std::filesystem::create_directories(path_.parent_path(), error);
    Part::sweep(path_);
    if (!error) part_ = Part::make(path_, Part::Kind::folder);
    if (!error && !part_) error = std::error_code(errno, std::generic_category());
    if (!error) unfinished_.emplace(part_->path());
    if (!error) std::filesystem::create_directories(part_->path() / "frames", error);
    if (error) throw InputError("cannot write to '" + path + "': " + error.message());
  }

  const std::filesystem::path& path() const { return part_->path(); }
  void keep() {
    const FilesBeingWritten now;
    std::error_code error;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(part_->path(), error))
      if (!error && !synchronise(entry.path().string())) error = std::error_code(errno, std::generic_category());
    if (!error) std::filesystem::remove(path_, error);
    if (!error && !part_->take_name(path_)) error = std::error_code(errno, std::generic_category());
    if (error) throw InputError("cannot write to '" + path_.string() + "': " + error.message());
    synchronise(std::filesystem::absolute(path_).parent_path().string());
  }

 private:
  std::filesystem::path path_;
  std::optional<Part> part_;
  std::optional<UnfinishedFolder> unfinished_;
};

}  // namespace lumo::program
