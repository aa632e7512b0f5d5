#include "catch.hpp"

#include "console/output.hpp"

#include "lumo/core/error.hpp"
#include "temporary_folder.hpp"

#include <filesystem>
#include <iostream>
#include <sstream>

namespace fs = std::filesystem;
using lumo::program::hand_out, lumo::program::Output, lumo::program::Progress;

TEST_CASE("nothing to write leaves no directory") {
  const TemporaryFolder scratch;
  Output files((scratch.path / "out" / "deep").string());
  CHECK(files.write().empty());
  CHECK(!fs::exists(scratch.path / "out"));
  fs::create_directory(scratch.path / "empty");
  Output there((scratch.path / "empty").string());
  CHECK(fs::exists(scratch.path / "empty"));
}

TEST_CASE("what cannot become a directory is refused before any work") {
  const TemporaryFolder scratch;
  fs::create_symlink(scratch.path / "nowhere", scratch.path / "link");
  for (const fs::path& p : {scratch.path / "link", scratch.path / std::string(300, 'n'), fs::path("/proc/lumo")}) {
    INFO(p);
    CHECK_THROWS_AS(Output(p.string()), lumo::InputError);
  }
}

TEST_CASE("a directory in the way of a file leaves the older files as they were") {
  const TemporaryFolder scratch;
  fs::create_directories(scratch.path / "y.txt");
  scratch.write("x.txt", "old");
  Output files(scratch.path.string());
  files.add("x.txt", "new");
  files.add("y.txt", "new");
  CHECK_THROWS_AS(files.write(), lumo::InputError);
  CHECK(scratch.read("x.txt") == "old");
  CHECK(scratch.entries() == 2);
}

TEST_CASE("files appear complete, in new directories too, and replace older ones") {
  const TemporaryFolder scratch;
  const fs::path folder = scratch.path / "a" / "b";
  for (const std::string text : {"first", "second, longer\n"}) {
    Output files(folder.string());
    files.add("x.txt", text);
    files.add("y.txt", "");
    CHECK(files.write().size() == 2);
    CHECK(scratch.read("a/b/x.txt") == text);
    CHECK(scratch.entries("a/b") == 2);
  }
}

TEST_CASE("a file in the way of the directory is refused before any work") {
  const TemporaryFolder scratch;
  scratch.write("file", "x");
  CHECK_THROWS_AS(Output((scratch.path / "file").string()), lumo::InputError);
  CHECK_THROWS_AS(Output((scratch.path / "file" / "below").string()), lumo::InputError);
  CHECK_THROWS_AS(Output("/dev/null/out"), lumo::InputError);
  CHECK_NOTHROW(Output((scratch.path / "new" / "deep").string()));
}

TEST_CASE("when one file cannot be written none is left") {
  const TemporaryFolder scratch;
  fs::create_directories(scratch.path / "out" / "y.txt" / "full");  // a directory where the second file should go
  Output files((scratch.path / "out").string());
  files.add("x.txt", "x");
  files.add("y.txt", "y");
  CHECK_THROWS_AS(files.write(), lumo::InputError);
  CHECK(scratch.entries("out") == 1);
}

TEST_CASE("a command hands out its result and its files, the result even where the files cannot be written") {
  const TemporaryFolder scratch;
  std::ostringstream shown;
  std::streambuf* const screen = std::cout.rdbuf(shown.rdbuf());
  Progress progress(true);
  Output files(scratch.path.string()), hindered(scratch.path.string());
  files.add("x.txt", "x");
  hindered.add("x.txt", "y");
  hindered.add("y.txt", "y");
  fs::create_directories(scratch.path / "y.txt");
  std::string why;
  hand_out("good\n", files, progress);
  try {
    hand_out("all the same\n", hindered, progress);
  } catch (const lumo::InputError& e) {
    why = e.what();
  }
  std::cout.rdbuf(screen);
  CHECK(shown.str() == "good\nall the same\n");
  CHECK(why.find("y.txt") != std::string::npos);
  CHECK(scratch.read("x.txt") == "x");
}
