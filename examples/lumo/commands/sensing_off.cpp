// Takes the place of sensing.cpp where OpenCV, LZ4 or Zstandard is missing.
#include "commands/sensing.hpp"

namespace lumo::program {

std::string sense(const Options& o, Output&, Progress&, char**) {
  if (o.camera) throw Error("cameras need OpenCV; run 'lumo doctor'");
  if (name(o.command).starts_with("lab ")) throw Error("the virtual lab was built without OpenCV, LZ4 or Zstandard; run 'lumo doctor'");
  throw Error("reading logs was built without OpenCV, LZ4 or Zstandard; run 'lumo doctor'");
}

}  // namespace lumo::program
