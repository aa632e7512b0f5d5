#include "sensing/responses.hpp"

#include "console/interrupt.hpp"

#include "lumo/lab/pad_file.hpp"

#include <cstdio>
#include <filesystem>
#include <system_error>

namespace lumo::program {

using namespace sense;

namespace fs = std::filesystem;

namespace {

/// The file that a key's responses are kept in; its name distinguishes pads and settings.
std::string cache_file(const ResponsesRequest& o, const std::string& log_path, const std::string& key) {
  std::error_code error;
  const fs::path log = fs::absolute(log_path, error).lexically_normal();
  const fs::path folder = o.cache ? fs::path(*o.cache) : (log.has_filename() ? log : log.parent_path()).parent_path();
  fs::create_directories(folder, error);
  char name[48];
  std::snprintf(name, sizeof name, "lumo-pad-%016llx.txt", static_cast<unsigned long long>(lumo::checksum(key)));
  return (folder / name).string();
}

}  // namespace

PadResponses responses(const ResponsesRequest& o, const std::string& log, Progress& progress) {
  const std::string key = pad_responses_key(o), file = cache_file(o, log, key);
  try {
    if (auto kept = read_pad_responses(file, key)) return std::move(*kept);
  } catch (const InputError& e) {
    progress.note(std::string(e.what()) + "; computed anew");
  }
  PadResponses r = make_pad_responses(o, o.threads, progress);
  {
    const FilesBeingWritten whole;
    write_pad_responses(file, r, key);
  }
  progress.finish();
  progress.note("kept in " + file);
  return r;
}

}  // namespace lumo::program
