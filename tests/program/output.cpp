#include "catch.hpp"

#include "program/output.hpp"

#include "lumo/core/error.hpp"

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>

namespace fs = std::filesystem;
using lumo::program::Output;

namespace {

struct Scratch {
  fs::path path = fs::temp_directory_path() / ("lumo-output-" + std::to_string(getpid()));
  Scratch() { fs::create_directories(path); }
  ~Scratch() { fs::remove_all(path); }
  std::size_t entries(const fs::path& folder) const { return std::size_t(std::distance(fs::directory_iterator(folder), fs::directory_iterator())); }
};

std::string read(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

TEST_CASE("nothing to write leaves no directory") {
  const Scratch scratch;
  Output files((scratch.path / "out" / "deep").string());
  CHECK(files.write().empty());
  CHECK(!fs::exists(scratch.path / "out"));
  fs::create_directory(scratch.path / "empty");
  Output there((scratch.path / "empty").string());
  CHECK(fs::exists(scratch.path / "empty"));
}

TEST_CASE("what cannot become a directory is refused before any work") {
  const Scratch scratch;
  fs::create_symlink(scratch.path / "nowhere", scratch.path / "link");
  for (const fs::path& p : {scratch.path / "link", scratch.path / std::string(300, 'n'), fs::path("/proc/lumo")}) {
    INFO(p);
    CHECK_THROWS_AS(Output(p.string()), lumo::InputError);
  }
}

TEST_CASE("a directory in the way of a file leaves the older files as they were") {
  const Scratch scratch;
  fs::create_directories(scratch.path / "y.txt");
  std::ofstream(scratch.path / "x.txt") << "old";
  Output files(scratch.path.string());
  files.add("x.txt", "new");
  files.add("y.txt", "new");
  CHECK_THROWS_AS(files.write(), lumo::InputError);
  CHECK(read(scratch.path / "x.txt") == "old");
  CHECK(scratch.entries(scratch.path) == 2);
}

TEST_CASE("files appear complete, in new directories too, and replace older ones") {
  const Scratch scratch;
  const fs::path folder = scratch.path / "a" / "b";
  for (const std::string text : {"first", "second, longer\n"}) {
    Output files(folder.string());
    files.add("x.txt", text);
    files.add("y.txt", "");
    CHECK(files.write().size() == 2);
    CHECK(read(folder / "x.txt") == text);
    CHECK(scratch.entries(folder) == 2);
  }
}

TEST_CASE("a file in the way of the directory is refused before any work") {
  const Scratch scratch;
  std::ofstream(scratch.path / "file") << "x";
  CHECK_THROWS_AS(Output((scratch.path / "file").string()), lumo::InputError);
  CHECK_THROWS_AS(Output((scratch.path / "file" / "below").string()), lumo::InputError);
  CHECK_THROWS_AS(Output("/dev/null/out"), lumo::InputError);
  CHECK_NOTHROW(Output((scratch.path / "new" / "deep").string()));
}

TEST_CASE("when one file cannot be written none is left") {
  const Scratch scratch;
  fs::create_directories(scratch.path / "out" / "y.txt" / "full");   // a directory where the second file should go
  Output files((scratch.path / "out").string());
  files.add("x.txt", "x");
  files.add("y.txt", "y");
  CHECK_THROWS_AS(files.write(), lumo::InputError);
  CHECK(scratch.entries(scratch.path / "out") == 1);
}
