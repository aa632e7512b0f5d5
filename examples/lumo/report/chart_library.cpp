#include "report/chart_library.hpp"

#include "lumo/core/error.hpp"
#include "lumo/core/files.hpp"

#include <fstream>
#include <string_view>

namespace lumo::program {

namespace {

constexpr std::string_view path = LUMO_PROGRAM_PLOTLY;  // the build passes what it found, or nothing

}  // namespace

std::string chart_library() {
  const char* const help = "; apt install python3-plotly, or configure with -DLUMO_PLOTLY=FILE, and build again";
  if (path.empty())
    throw InputError(std::string("a report needs plotly.js, which was not found when lumo was built") + help);
  auto script = read_whole(std::string(path));
  if (!script || script->find("lotly") == std::string::npos)
    throw InputError("a report needs plotly.js, which cannot be read from '" + std::string(path) + "'" + help);
  return std::move(*script);
}

std::string chart_library_version() {
  std::ifstream file{std::string(path), std::ios::binary};
  std::string head(400, '\0');
  file.read(head.data(), std::streamsize(head.size()));
  head.resize(std::size_t(file.gcount()));
  const std::string before = "plotly.js v";
  const std::size_t found = head.find(before);
  if (found == std::string::npos) return "";
  const std::size_t from = found + before.size();
  return head.substr(from, head.find_first_not_of("0123456789.", from) - from);
}

}  // namespace lumo::program
