#include "sensing/pictures.hpp"

#include "console/version.hpp"

#include "lumo/core/error.hpp"

#include <dlfcn.h>

#include <filesystem>

namespace lumo::program {

using namespace sense;

namespace {

/// Beside the program, as the build makes it, or where it is installed.
const Pictures* load() {
  const std::filesystem::path here = std::filesystem::read_symlink("/proc/self/exe").parent_path();
  std::string why;
  for (const std::filesystem::path& folder : {here, (here / LUMO_PROGRAM_MODULES).lexically_normal()}) {
    const std::filesystem::path file = folder / pictures_file;
    if (std::error_code error; !std::filesystem::exists(file, error)) continue;
    void* const module = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (module == nullptr) throw Error(std::string("pictures need OpenCV, which cannot be loaded: ") + dlerror());
    const auto make = reinterpret_cast<MakePictures*>(dlsym(module, pictures_symbol));
    if (const Pictures* made = make != nullptr ? make(version) : nullptr) return made;
    throw Error("pictures need OpenCV, but '" + file.string() + "' is of another version of lumo");
  }
  throw Error("pictures need OpenCV: '" + (here / pictures_file).string() +
              "' is missing, which the build makes where libopencv-dev is installed; run 'lumo doctor'");
}

}  // namespace

const Pictures& pictures() {
  static const Pictures* const loaded = load();
  return *loaded;
}

}  // namespace lumo::program
