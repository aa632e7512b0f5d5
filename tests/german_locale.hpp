#pragma once

#include "catch.hpp"
#include "temporary_folder.hpp"

#include <clocale>
#include <cstdio>
#include <cstdlib>
#include <locale>
#include <string>

/// While one of these lives the global locale of C and C++ writes 1.234,5, as that of a program with a German user
/// interface does. Made here (localedef, of glibc's own programs), so that none need be installed.
class GermanLocale {
 public:
  GermanLocale()
      : before_(std::locale::global(std::locale(std::locale::classic(), new Numbers))),
        c_before_(std::setlocale(LC_ALL, nullptr)) {
    const std::string source = folder_.write("source",
        "comment_char %\nescape_char /\nLC_NUMERIC\ndecimal_point \",\"\nthousands_sep \".\"\ngrouping 3;3\n"
        "END LC_NUMERIC\n");
    const std::string made = folder_ / "lumo_comma";
    // It warns of the categories that are not there.
    REQUIRE(std::system(("localedef --no-archive -c -i " + source + " " + made + " > /dev/null 2>&1").c_str()) != -1);
    REQUIRE(::setenv("LOCPATH", folder_.path.c_str(), 1) == 0);
    const bool set = std::setlocale(LC_ALL, "lumo_comma") != nullptr;
    ::unsetenv("LOCPATH");
    REQUIRE(set);
    char text[8];
    std::snprintf(text, sizeof text, "%.1f", 0.5);
    REQUIRE(text == std::string("0,5"));
  }
  ~GermanLocale() {
    std::setlocale(LC_ALL, c_before_.c_str());
    std::locale::global(before_);
  }
  GermanLocale(const GermanLocale&) = delete;
  GermanLocale& operator=(const GermanLocale&) = delete;

 private:
  struct Numbers : std::numpunct<char> {
    char do_decimal_point() const override { return ','; }
    char do_thousands_sep() const override { return '.'; }
    std::string do_grouping() const override { return "\3"; }
  };
  TemporaryFolder folder_;
  std::locale before_;
  std::string c_before_;
};
