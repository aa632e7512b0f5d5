// Takes the place of fabrication.cpp where libzip is missing, so that `lumo doctor` can still say so.
#include "commands/fabricate.hpp"

namespace lumo::program {

std::string fabricate(const Options&, Output&) { throw Error("'fabricate' was built without a library that it needs; run 'lumo doctor'"); }

}  // namespace lumo::program
