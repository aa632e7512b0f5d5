#include "asking/transcript.hpp"

#include "asking/space.hpp"
#include "console/interrupt.hpp"

#include "lumo/core/error.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>

namespace lumo::program {

namespace {

using Json = nlohmann::ordered_json;

[[noreturn]] void refuse(const std::string& path, const std::string& what) {
  throw InputError("transcript '" + path + "' " + what);
}
[[noreturn]] void refuse_system(const std::string& path, const std::string& what) {
  refuse(path, what + ": " + std::strerror(errno));
}

std::string read_all(int file, const std::string& path) {
  std::string text;
  char buffer[1 << 16];
  while (true) {
    const ssize_t n = read(file, buffer, sizeof buffer);
    if (n == 0) return text;
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) refuse_system(path, "cannot be read");
    text.append(buffer, std::size_t(n));
  }
}

}  // namespace

Transcript::Transcript(const std::string& path, const Json& space) : path_(path) {
  file_ = open(path.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
  if (file_ < 0) refuse_system(path, "cannot be opened");
  try {
    struct stat info = {};
    if (fstat(file_, &info) != 0 || !S_ISREG(info.st_mode)) refuse(path, "is not a regular file");
    if (flock(file_, LOCK_EX | LOCK_NB) != 0) refuse(path, "is in use by another process");
    const std::string text = read_all(file_, path);

    // A line counts once its end is there. What follows the last end was cut off.
    std::vector<Event> lines;
    std::size_t good = 0;
    for (std::size_t begin = 0, number = 1; begin < text.size(); ++number) {
      const std::size_t end = text.find('\n', begin);
      if (end == std::string::npos) break;
      Json content;
      try {
        content =
            Json::parse(text.begin() + std::ptrdiff_t(begin), text.begin() + std::ptrdiff_t(end), flat_enough, false);
      } catch (const InvalidArgument& e) {
        refuse(path, lumo::message("line ", number, ' ', e.what()));
      }
      if (!content.is_object() || content.size() != 1)
        refuse(path, lumo::message("line ", number, " is damaged: not a JSON object with one key"));
      lines.push_back({int(number), std::move(content)});
      begin = good = end + 1;
    }
    const std::string opening = "{\"space\":";  // of which all may have been cut off
    if (lines.empty() ? text.find(opening) != 0 && opening.find(text) != 0 : !lines.front().content.contains("space"))
      refuse(path, "does not begin with a space: it is no transcript");
    if (!lines.empty()) {
      const std::string found = difference(space, lines.front().content["space"]);
      if (!found.empty()) refuse(path, "belongs to another space: " + found);
    }
    // Only now is it known to be ours.
    if (good < text.size() && ftruncate(file_, off_t(good)) != 0)
      refuse_system(path, "cannot be cut back to its last whole line");
    if (lines.empty()) {
      append({{"space", space}});
      // The new file's name must last as well.
      const std::string folder = std::filesystem::absolute(path).parent_path().string();
      const int directory = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
      if (directory >= 0) {
        fsync(directory);
        close(directory);
      }
      return;
    }
    events_.assign(lines.begin() + 1, lines.end());
  } catch (...) {
    close(file_);
    throw;
  }
}

Transcript::~Transcript() { close(file_); }

void Transcript::append(const Json& event) {
  const std::string line = event.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
  const FilesBeingWritten guard;
  for (std::size_t done = 0; done < line.size();) {
    const ssize_t n = write(file_, line.data() + done, line.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) refuse_system(path_, "cannot be written");
    done += std::size_t(n);
  }
  if (fsync(file_) != 0) refuse_system(path_, "cannot be brought to the disk");
}

}  // namespace lumo::program
