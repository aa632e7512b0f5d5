#include "catch.hpp"

#include "lumo/core/files.hpp"
#include "temporary_folder.hpp"

#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

using namespace lumo;

TEST_CASE("a file is read whole, and what is no file or too large is not read", "[core]") {
  const TemporaryFolder folder;
  const std::string bytes("\0a\r\n\xff", 5);
  CHECK(read_whole(folder.write("file", bytes)) == bytes);
  CHECK(read_whole(folder.write("empty", "")) == "");
  CHECK(read_whole(folder / "file", 5) == bytes);
  CHECK_FALSE(read_whole(folder / "file", 4));
  CHECK_FALSE(read_whole(folder / "nothing"));
  CHECK_FALSE(read_whole(folder.path));
  REQUIRE(::mkfifo((folder / "pipe").c_str(), 0600) == 0);
  CHECK_FALSE(read_whole(folder / "pipe"));  // and does not wait for a writer
}

TEST_CASE("what cannot be read is refused with its name and the reason", "[core]") {
  const TemporaryFolder folder;
  CHECK(read_text(folder.write("file", "text")) == "text");
  CHECK(read_text(folder.write("long", std::string(200000, 'x'))) == std::string(200000, 'x'));
  CHECK(read_text(folder.write("empty", "")).empty());
  CHECK_THROWS_WITH(read_text(folder / "none"), Catch::Contains("none: cannot be read: No such file"));
  CHECK_THROWS_WITH(read_text(folder.path), Catch::Contains("cannot be read: Is a directory"));
  CHECK_THROWS_WITH(read_text(folder / "long", 199999), Catch::Contains("it has more than 199999 bytes"));
  CHECK_THROWS_WITH(read_text("/dev/zero", 1000), Catch::Contains("/dev/zero: cannot be read: it has more than 1000"));
  CHECK_THROWS_WITH(read_text("/proc/self/mem"), Catch::Contains("/proc/self/mem: cannot be read: Input/output error"));
}

TEST_CASE("a file is whole: new or replaced, with nothing left beside it") {
  const TemporaryFolder folder;
  for (const std::string& bytes : {std::string("first\0line\r\n", 12), std::string(100000, 'x'), std::string()}) {
    write_whole(folder / "file", bytes);
    CHECK(folder.read("file") == bytes);
    CHECK(folder.entries() == 1);
  }
}

TEST_CASE("parts of dead writers go with the next write, those of living ones and of others stay", "[core]") {
  const TemporaryFolder folder;
  int ready[2];
  REQUIRE(::pipe(ready) == 0);
  const pid_t writer = ::fork();
  if (writer == 0) {
    const auto file = Part::make(folder / "file", Part::Kind::file),
               log = Part::make(folder / "log", Part::Kind::folder);
    const bool made = file && file->write("half") && log && ::mkdir((log->path() / "frames").c_str(), 0777) == 0;
    if (::write(ready[1], made ? "y" : "n", 1) != 1) ::_exit(1);
    while (true) ::pause();
  }
  char answer = 0;
  REQUIRE(::read(ready[0], &answer, 1) == 1);
  REQUIRE(answer == 'y');
  folder.write("file.part-1", "of an earlier version");
  folder.write("file.part-final", "a person's");
  write_whole(folder / "file", "mine");
  Part::sweep(folder / "log");
  CHECK(folder.read("file") == "mine");
  CHECK(folder.entries() == 4);  // both parts, the person's and the file
  ::kill(writer, SIGKILL);
  REQUIRE(::waitpid(writer, nullptr, 0) == writer);
  write_whole(folder / "file", "mine again", Durability::memory);  // leaves no time for that
  CHECK(folder.entries() == 4);
  write_whole(folder / "file", "mine again");
  Part::sweep(folder / "log");
  CHECK(folder.entries() == 2);
  CHECK(folder.read("file.part-final") == "a person's");
  ::close(ready[0]);
  ::close(ready[1]);
}

TEST_CASE("a file that cannot be written is reported in one line, and what was there stays") {
  const TemporaryFolder folder;
  std::filesystem::create_directories(folder.path / "folder" / "full");
  CHECK_THROWS_WITH(
      write_whole(folder / "none/file", "x"), Catch::Contains("none/file: cannot be written: No such file"));
  CHECK_THROWS_AS(write_whole(folder / "folder", "x"), InputError);  // written beside it, but not renamed
  CHECK(folder.entries() == 1);

  folder.write("file", "old");
  rlimit before;
  REQUIRE(getrlimit(RLIMIT_FSIZE, &before) == 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{1000, before.rlim_max};
  REQUIRE(setrlimit(RLIMIT_FSIZE, &small) == 0);
  std::string why;
  try {
    write_whole(folder / "file", std::string(100000, 'x'));
  } catch (const InputError& e) {
    why = e.what();
  }
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  CHECK(why.find("File too large") != std::string::npos);
  CHECK(folder.read("file") == "old");
  CHECK(folder.entries() == 2);
}

TEST_CASE("writers of the same file do not get in each other's way") {
  const TemporaryFolder folder;
  std::vector<std::thread> writers;
  std::atomic<int> failed = 0;
  for (int k = 0; k < 4; ++k)
    writers.emplace_back([&] {
      for (int i = 0; i < 500; ++i) try {
          write_whole(folder / "file", std::string(20000, 'y'));
        } catch (const InputError&) {
          ++failed;
        }
    });
  for (std::thread& w : writers) w.join();
  CHECK(failed == 0);
  CHECK(folder.read("file") == std::string(20000, 'y'));
  CHECK(folder.entries() == 1);
}
