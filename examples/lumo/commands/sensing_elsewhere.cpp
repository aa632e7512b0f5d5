// Takes the place of sensing.cpp in lumo, which does not link OpenCV.
#include "commands/sensing.hpp"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>

namespace lumo::program {

std::string sense(const Options& o, Output&, Progress&, char** arguments) {
  const auto beside = std::filesystem::read_symlink("/proc/self/exe").replace_filename("lumo-sensing");
  execv(beside.c_str(), arguments);
  const int cause = errno;
  throw Error(lumo::detail::text("'", name(o.command), "' needs the program '", beside.string(), "': ", std::strerror(cause), cause == ENOENT ? " (the target lumo_sensing makes it)" : ""));
}

}  // namespace lumo::program
