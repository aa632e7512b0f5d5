#pragma once

#include "report/json.hpp"

#include <string>
#include <vector>

/// What this program was built with, and what it runs on.
namespace lumo::program {

/// A library below lumo. `package`: Debian's.
struct Component {
  std::string name, licence, package, use;
  std::string version = "", detail = "";
  bool on = false;
};
std::vector<Component> components();

/// Vector instructions of the processor, and those that this program was compiled for.
struct Feature {
  const char* name;
  bool here, used;
};
std::vector<Feature> features();

std::string compiler();
std::string processor();

/// What the numbers of a store may hang on besides its problem: processor, system, compiler, versions of the libraries
/// that compute them.
Json provenance();

}  // namespace lumo::program
