#pragma once

#include "lumo/core/error.hpp"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string_view>

namespace fuzz {

/// Ends the program, which the fuzzer reports with the input that led here.
[[noreturn]] inline void finding(std::string_view what, std::string_view text = {}) {
  std::fprintf(stderr, "finding: %.*s: %.*s\n", int(what.size()), what.data(), int(text.size()), text.data());
  std::abort();
}

/// What a parser may do with any bytes at all: succeed, or say in one printable line what is wrong. Other exceptions
/// pass, and end the program.
template <class Parse> void attempt(Parse parse) {
  try {
    parse();
  } catch (const lumo::Error& e) {
    const std::string_view line = e.what();
    if (line.empty() ||
        !std::all_of(line.begin(), line.end(), [](char c) { return static_cast<unsigned char>(c) >= ' ' && c != 127; }))
      finding("a message of more than one line", line);
  }
}

}  // namespace fuzz
