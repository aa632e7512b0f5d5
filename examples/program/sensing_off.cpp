// Takes the place of lab.cpp and the sensing commands where OpenCV is missing.
#include "program/lab.hpp"
#include "program/sensing.hpp"

namespace lumo::program {

std::string lab(const Options&, Progress&) { throw Error("the virtual lab was built without OpenCV; run 'lumo doctor'"); }
std::string calibrate(const Options&, Progress&) { throw Error("reading logs was built without OpenCV; run 'lumo doctor'"); }
std::string sense(const Options&, Output&, Progress&) { throw Error("reading logs was built without OpenCV; run 'lumo doctor'"); }
std::string doctor_camera(int, bool) { throw Error("cameras need OpenCV; run 'lumo doctor'"); }

}  // namespace lumo::program
