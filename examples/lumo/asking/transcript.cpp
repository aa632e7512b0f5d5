#include "asking/transcript.hpp"

#include "asking/space.hpp"
#include "console/interrupt.hpp"
#include "console/text.hpp"

#include "lumo/core/error.hpp"
#include "lumo/core/files.hpp"
#include "lumo/core/sobol.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <string_view>

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
    const ssize_t n = pread(file, buffer, sizeof buffer, off_t(text.size()));
    if (n == 0) return text;
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) refuse_system(path, "cannot be read");
    text.append(buffer, std::size_t(n));
  }
}

void write_all(int file, std::string_view text, const std::string& path) {
  while (!text.empty()) {
    const ssize_t n = write(file, text.data(), text.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) refuse_system(path, "cannot be written");
    text.remove_prefix(std::size_t(n));
  }
  if (fsync(file) != 0) refuse_system(path, "cannot be brought to the disk");
}

/// Of a line without its digest, and of all before it.
std::uint64_t digest_of(std::string_view line, std::uint64_t before) {
  for (const char c : line) before = combine(before, static_cast<unsigned char>(c));
  return combine(before, line.size());
}

std::string seal(std::uint64_t digest) {
  char text[40];
  std::snprintf(text, sizeof text, ",\"digest\":\"%016llx\"}", static_cast<unsigned long long>(digest));
  return text;
}

constexpr std::string_view seal_begin = ",\"digest\":\"";

/// Does a line end as one with a digest does?
bool sealed(std::string_view line) {
  const std::size_t length = seal(0).size();
  return line.size() > length && line.substr(line.size() - length).starts_with(seal_begin);
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
    read(text);
    if (!events_.empty()) take_space(space);
    // Only now is it known to be ours. What follows the last end of a line was cut off.
    const std::size_t good = text.rfind('\n') + 1;
    if (good < text.size() && ftruncate(file_, off_t(good)) != 0)
      refuse_system(path, "cannot be cut back to its last whole line");
    if (events_.empty()) {
      append({{"space", space}});
      synchronise(std::filesystem::absolute(path).parent_path().string());  // the new file's name must last as well
    } else if (!change_.empty()) {
      append({{"space", space}});
    }
    std::erase_if(events_, [](const Event& e) { return e.content.contains("space"); });
  } catch (...) {
    close(file_);
    throw;
  }
}

Transcript::~Transcript() { close(file_); }

void Transcript::read(const std::string& text) {
  const std::string_view opening = "{\"space\":";  // of which all may have been cut off
  if (text.substr(0, opening.size()) != opening.substr(0, text.size()) || text.starts_with('\n'))
    refuse(path_, "does not begin with a space: it is no transcript");
  bool with_digests = false;
  for (std::size_t begin = 0, number = 1; begin < text.size(); ++number) {
    const std::size_t end = text.find('\n', begin);
    if (end == std::string::npos) return;  // a line counts once its end is there
    std::string line = text.substr(begin, end - begin);
    begin = end + 1;
    const bool has_digest = sealed(line);
    if (with_digests && !has_digest) refuse(path_, lumo::message("line ", number, " is damaged: it has no digest"));
    with_digests = has_digest;
    const std::string given = has_digest ? line.substr(line.size() - seal(0).size()) : "";
    if (has_digest) line.replace(line.size() - given.size(), given.size(), "}");
    digest_ = digest_of(line, digest_);
    if (has_digest && given != seal(digest_))
      refuse(path_, lumo::message("line ", number, " is damaged: it is not what was written"));
    try {
      events_.push_back({int(number), parse_strictly(line)});
    } catch (const InvalidArgument& e) {
      refuse(path_, lumo::message("line ", number, " is damaged: it ", e.what()));
    }
    if (!events_.back().content.is_object() || events_.back().content.size() != 1)
      refuse(path_, lumo::message("line ", number, " is damaged: not a JSON object with one key"));
  }
}

void Transcript::take_space(const Json& space) {
  const auto last =
      std::find_if(events_.rbegin(), events_.rend(), [](const Event& e) { return e.content.contains("space"); });
  const Json& before = last->content["space"];
  std::string found;
  try {
    found = difference(fixed_part(space), fixed_part(before));
  } catch (const nlohmann::json::exception&) {
    refuse(path_, lumo::message("line ", last->line, " is damaged: it holds no space"));
  }
  if (!found.empty()) refuse(path_, "belongs to another space: " + found);
  change_ = difference(space, before);
}

void Transcript::append(const Json& event) {
  std::string line = event.dump(-1, ' ', false, Json::error_handler_t::replace);
  const std::uint64_t digest = digest_of(line, digest_);
  line.pop_back();
  line += seal(digest) + "\n";
  const FilesBeingWritten guard;
  require_in_place(line);
  write_all(file_, line, path_);
  digest_ = digest;
}

void Transcript::require_in_place(const std::string& line) const {
  struct stat mine = {}, there = {};
  const bool found = stat(path_.c_str(), &there) == 0;
  if (fstat(file_, &mine) != 0) refuse_system(path_, "cannot be looked at");
  if (found && mine.st_dev == there.st_dev && mine.st_ino == there.st_ino) return;
  const std::string what = found ? "was replaced" : mine.st_nlink == 0 ? "was removed" : "was renamed or moved";
  for (int k = 1; k < 1000; ++k) {
    const std::string beside = lumo::message(path_, ".rescued-", k);
    const int file = open(beside.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (file < 0 && errno == EEXIST) continue;
    if (file < 0) refuse_system(path_, what + " while it was in use, and '" + beside + "' cannot be made");
    try {
      write_all(file, read_all(file_, path_) + line, beside);
    } catch (const InputError&) {
      close(file);
      throw;
    }
    close(file);
    refuse(path_, what + " while it was in use; all that it held and the last line are in '" + beside + "'");
  }
  refuse(path_, what + " while it was in use");
}

}  // namespace lumo::program
