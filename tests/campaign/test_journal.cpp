#include "campaign/store_test.hpp"
#include "catch.hpp"
#include "german_locale.hpp"
#include "lumo/campaign/campaign.hpp"
#include "lumo/support/sqlite.hpp"
#include "temporary_folder.hpp"

#include <sqlite3.h>

#include <sys/resource.h>
#include <sys/wait.h>
#include <csignal>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <random>

using namespace lumo;
namespace fs = std::filesystem;

namespace {

/// What entry k of the test campaign must be.
JournalEntry entry(std::size_t k) {
  return {std::int64_t(k), JournalEntry::Kind::tell, "x = " + std::to_string(k * k),
      std::string(700, char('a' + k % 26)), "took " + std::string(60, char('0' + k % 10)) + " s"};
}

/// Adds entries until there are `count` after the problem.
template <class Log> void fill(Log& log, std::size_t count) {
  while (log.append([&](const std::vector<JournalEntry>& list) -> std::optional<JournalEntry> {
    if (list.size() > count) return std::nullopt;
    return entry(list.size());
  })) {
  }
}

StoreError::Reason reason_of(const std::function<void()>& act) {
  try {
    act();
  } catch (const StoreError& e) {
    INFO(e.what());
    CHECK(std::string(e.what()).find('\n') == std::string::npos);
    return e.reason();
  }
  FAIL("nothing was thrown");
  return {};
}

/// Runs `work` in a child process; its exit code, or −signal.
int in_child(const std::function<void()>& work) {
  int status = 0;
  waitpid(start_child(work), &status, 0);
  return WIFSIGNALED(status) ? -WTERMSIG(status) : WEXITSTATUS(status);
}

}  // namespace

TEMPLATE_TEST_CASE("A journal gives back what was put in, in order", "", MemoryJournal, SqliteStore) {
  const TemporaryFolder folder;
  TestType log = [&] {
    if constexpr (std::is_same_v<TestType, MemoryJournal>) return MemoryJournal("problem 1");
    else return SqliteStore(folder / "store", "problem 1");
  }();
  fill(log, 5);
  const auto list = log.entries();
  REQUIRE(list.size() == 6);
  CHECK(list[0].kind == JournalEntry::Kind::problem);
  CHECK(list[0].content == "problem 1");
  for (std::size_t k = 1; k < list.size(); ++k) {
    CHECK(list[k].number == std::int64_t(k));
    CHECK(list[k].content == entry(k).content);
    CHECK(log.record(std::int64_t(k)) == entry(k).record);
  }
  CHECK(log.claim(3));
}

TEST_CASE("A store is the same whether it was opened once or often, and notes do not enter its digest") {
  const TemporaryFolder folder;
  SqliteStore once(folder / "once", "p");
  fill(once, 8);
  for (std::size_t k = 1; k <= 8; ++k) {
    SqliteStore again(folder / "often", "p");
    again.append([&](const auto&) {
      JournalEntry e = entry(k);
      e.notes = "took " + std::to_string(std::rand()) + " s";
      return std::optional(e);
    });
  }
  const SqliteStore often(folder / "often");
  CHECK(once.digest() == often.digest());
  CHECK(once.digest() == once.digest(8));
  CHECK(once.digest(0) == SqliteStore(folder / "empty", "p").digest());  // of the problem alone
  CHECK(once.digest(0) != SqliteStore(folder / "other", "q").digest());
  often.verify();
}

TEST_CASE("A store refuses another problem and says what differs, and what is no store is refused, too") {
  const TemporaryFolder folder;
  { SqliteStore log(folder / "store", "material DS\nensemble flat\nseed 1"); }
  try {
    SqliteStore log(folder / "store", "material DS\nensemble curved\nseed 1");
    FAIL("opened");
  } catch (const StoreError& e) {
    CHECK(e.reason() == StoreError::Reason::different);
    CHECK(std::string(e.what()).find("ensemble flat") != std::string::npos);
    CHECK(std::string(e.what()).find("ensemble curved") != std::string::npos);
  }
  CHECK(reason_of([&] { SqliteStore log(folder / "missing"); }) == StoreError::Reason::unusable);
  CHECK(reason_of([&] { SqliteStore log(folder / "no/such/folder", "p"); }) == StoreError::Reason::unusable);
  folder.write("text",
      "this is a diary and no store, and long enough to look like a file with a header of some kind, which it "
      "does not have");
  CHECK(reason_of([&] { SqliteStore log(folder / "text", "p"); }) == StoreError::Reason::corrupt);
  CHECK(folder.read("text").starts_with("this is a diary"));
}

TEST_CASE("Flipped bits and cut files are found, or do no harm") {
  const TemporaryFolder folder;
  {
    SqliteStore log(folder / "store", "p");
    fill(log, 40);
  }
  const std::string good = folder.read("store"), digest = SqliteStore(folder / "store").digest();
  std::mt19937 random(7);
  int found = 0;
  for (int trial = 0; trial < 1000; ++trial) {
    std::string bad = good;
    if (trial % 10 == 0) bad.resize(random() % good.size());
    else bad[random() % bad.size()] ^= char(1 << random() % 8);
    folder.write("bad", bad);
    try {
      const SqliteStore log(folder / "bad");
      const auto list = log.entries();
      REQUIRE(list.size() == 41);
      for (std::size_t k = 1; k < list.size(); ++k) {
        REQUIRE(list[k].content == entry(k).content);
        REQUIRE(log.record(std::int64_t(k)) == entry(k).record);
      }
      REQUIRE(log.digest() == digest);
    } catch (const StoreError&) {
      ++found;
    }
  }
  CHECK(found > 500);
}

TEST_CASE("A flipped bit in notes, which no digest covers, leaves the log as it is") {
  const TemporaryFolder folder;
  {
    SqliteStore log(folder / "store", "p");
    fill(log, 3);
  }
  std::string bad = folder.read("store");
  const std::size_t at = bad.find(entry(2).notes);
  REQUIRE(at != std::string::npos);
  bad[at + 10] ^= char(0x80);
  folder.write("bad", bad);
  const SqliteStore log(folder / "bad");
  log.verify();
  CHECK(log.entries()[2].notes != entry(2).notes);
  CHECK(log.entries()[2].content == entry(2).content);
  CHECK(log.digest() == SqliteStore(folder / "store").digest());
}

TEST_CASE("Where SQLite itself finds damage, the first entry that cannot be read is named") {
  const TemporaryFolder folder;
  {
    SqliteStore log(folder / "store", "p");
    fill(log, 40);
  }
  const std::string good = folder.read("store");
  const std::size_t page = 4096;
  int named = 0;
  for (std::size_t from = page; from < good.size(); from += page) {
    if (good[from] != 0x0d) continue;  // no leaf of a table
    const auto holds = [&](std::size_t k) {
      return good.substr(from, page)
                 .find(k == 0 ? "problemp" : "tell" + entry(k).content + entry(k).record.substr(0, 20)) !=
             std::string::npos;
    };
    std::size_t first = 0;
    while (first <= 40 && !holds(first)) ++first;
    if (first > 40) continue;  // no entries on this page
    std::string bad = good;
    std::fill_n(bad.begin() + std::ptrdiff_t(from), page, '\0');
    folder.write("bad", bad);
    try {
      const SqliteStore log(folder / "bad");
      FAIL("opened");
    } catch (const StoreError& e) {
      INFO(e.what());
      CHECK(e.reason() == StoreError::Reason::corrupt);
      const std::string said = e.what();
      CHECK(said.find("is damaged at entry " + std::to_string(first) + ": ") != std::string::npos);
      ++named;
    }
  }
  CHECK(named > 5);
}

TEST_CASE("A store survives kills at any moment: nothing lost, nothing twice") {
  const TemporaryFolder folder;
  const std::size_t count = 60;
  SqliteStore whole(folder / "whole", "p");
  fill(whole, count);
  std::mt19937 random(3);
  int kills = 0;
  for (;;) {
    const pid_t pid = fork();
    if (pid == 0) {
      SqliteStore log(folder / "store", "p");
      fill(log, count);
      _exit(0);
    }
    usleep(useconds_t(random() % 20000));
    if (kills < 100) kill(pid, SIGKILL);
    int status = 0;
    waitpid(pid, &status, 0);
    kills += WIFSIGNALED(status);
    if (WIFEXITED(status)) break;
  }
  CHECK(kills > 0);
  const SqliteStore log(folder / "store");
  CHECK(log.entries().size() == count + 1);
  CHECK(log.digest() == whole.digest());
  log.verify();
}

TEST_CASE("A store is read although its writer was killed in the middle of a write") {
  const TemporaryFolder folder;
  {
    SqliteStore log(folder / "store", "p");
    fill(log, 3);
  }
  sqlite3* writer = nullptr;
  REQUIRE(sqlite3_open(std::string(folder / "store").c_str(), &writer) == SQLITE_OK);
  REQUIRE(sqlite3_exec(writer, "PRAGMA cache_size=1; BEGIN; UPDATE entry SET record = hex(zeroblob(100000))", nullptr,
              nullptr, nullptr) == SQLITE_OK);
  for (const char* suffix : {"", "-journal"})
    fs::copy_file(std::string(folder / "store") + suffix,
        std::string(folder / "killed") + suffix);  // as a kill leaves them
  CHECK(fs::file_size(folder / "killed") > 200'000);
  sqlite3_close(writer);
  const auto list = SqliteStore(folder / "killed").entries();
  REQUIRE(list.size() == 4);
  CHECK(SqliteStore(folder / "killed").record(3) == entry(3).record);
}

TEST_CASE("Three processes on one store add each entry once, and living ones keep what they claimed") {
  const TemporaryFolder folder;
  { SqliteStore log(folder / "store", "p"); }
  std::vector<pid_t> children;
  for (int k = 0; k < 3; ++k) {
    const pid_t pid = fork();
    if (pid == 0) {
      try {
        SqliteStore log(folder / "store", "p");
        fill(log, 50);
        _exit(0);
      } catch (...) {
        _exit(1);
      }
    }
    children.push_back(pid);
  }
  for (const pid_t pid : children) {
    int status = 1;
    waitpid(pid, &status, 0);
    CHECK(status == 0);
  }
  SqliteStore log(folder / "store", "p");
  CHECK(log.entries().size() == 51);
  CHECK(log.claim(1));
  CHECK(in_child([&] {
    SqliteStore other(folder / "store", "p");
    if (other.claim(1)) throw 1;  // this process lives
    if (!other.claim(2)) throw 2;
  }) == 0);
  CHECK(log.claim(2));  // the child is dead
  SqliteStore second(folder / "store");
  CHECK_FALSE(second.claim(1));  // another worker, if in one process
}

TEST_CASE("A claim holds though its process cannot be seen, and ends with it") {
  const TemporaryFolder folder;
  { SqliteStore log(folder / "store", "p"); }
  int ready[2];
  REQUIRE(pipe(ready) == 0);
  const pid_t worker = start_child([&] {
    SqliteStore log(folder / "store", "p");
    if (!log.claim(1) || write(ready[1], "x", 1) != 1) throw Error("claim");
    while (true) pause();
  });
  char byte = 0;
  REQUIRE(read(ready[0], &byte, 1) == 1);
  {
    // As the number of a process of another container, which has the same or none here.
    sqlite3* db = nullptr;
    REQUIRE(sqlite3_open((folder / "store").c_str(), &db) == SQLITE_OK);
    REQUIRE(sqlite3_exec(db, "UPDATE worker SET process = 'another 1 1'", nullptr, nullptr, nullptr) == SQLITE_OK);
    sqlite3_close(db);
    SqliteStore log(folder / "store");
    CHECK_FALSE(log.claim(1));
    CHECK(log.claim_first({1, 2}) == 2);
    CHECK(log.claims().size() == 2);
    kill(worker, SIGKILL);
    REQUIRE(waitpid(worker, nullptr, 0) == worker);
    CHECK(log.claims().size() == 1);
    CHECK(log.claim(1));
    std::filesystem::remove(folder / "store.claims");  // what a person tidies away is made again
    CHECK(log.claim(3));
    SqliteStore other(folder / "store");
    CHECK_FALSE(other.claim(2));
    CHECK_FALSE(other.claim(3));
    log.release(3);
    CHECK(other.claim(3));
  }
  CHECK(folder.entries() == 1);  // no locks, no file
}

namespace {

/// Every connection that is opened from now on has room for so many pages: SQLite says of what is more that the disk is
/// full.
int little_room(sqlite3* db, const char**, const struct sqlite3_api_routines*) {
  return sqlite3_exec(db, "PRAGMA max_page_count=12", nullptr, nullptr, nullptr);
}

}  // namespace

TEST_CASE("A full disk is an error, and the store stays valid") {
  const TemporaryFolder folder;
  { SqliteStore log(folder / "store", "p"); }
  const auto fails_for = [&](StoreError::Reason reason) {  // in a child of its own, which alone has the limit
    SqliteStore full(folder / "store", "p");
    try {
      fill(full, 1000);
    } catch (const StoreError& e) {
      if (e.reason() != reason) throw;
      if (full.entries().size() < 4) throw 3;  // what was there before is still read
      return;
    }
    throw 2;
  };
  {
    SqliteStore log(folder / "store", "p");
    fill(log, 3);
  }
  CHECK(in_child([&] {
    sqlite3_auto_extension(reinterpret_cast<void (*)()>(little_room));
    fails_for(StoreError::Reason::full);
  }) == 0);
  CHECK(in_child([&] {  // a limit on the file's size: the operating system refuses to write
    signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{fs::file_size(folder / "store") + 1, RLIM_INFINITY};
    if (setrlimit(RLIMIT_FSIZE, &limit) != 0) throw 1;
    fails_for(StoreError::Reason::unusable);
  }) == 0);
  SqliteStore again(folder / "store");
  again.verify();
  const std::size_t kept = again.entries().size();
  CHECK(kept > 4);
  CHECK(kept < 1001);
  fill(again, kept);  // and goes on once there is room
  SqliteStore whole(folder / "whole", "p");
  fill(whole, kept);
  CHECK(again.digest() == whole.digest());
}

TEST_CASE("A store is not used after a fork") {
  const TemporaryFolder folder;
  SqliteStore log(folder / "store", "p");
  fill(log, 2);
  const std::vector<std::function<void()>> members = {[&] { log.entries(); }, [&] { log.record(1); },
      [&] { log.claim(1); }, [&] { log.digest(); }, [&] { log.verify(); }, [&] { fill(log, 3); }};
  for (const auto& use : members)
    CHECK(in_child([&] {
      try {
        use();
      } catch (const StoreError& e) {
        if (e.reason() == StoreError::Reason::unusable) return;
      }
      throw 1;
    }) == 0);
  fill(log, 3);
  log.verify();
}

namespace {

/// Bytes that this process has read so far, from wherever the system had them.
std::uintmax_t bytes_read() {
  std::ifstream in("/proc/self/io");
  std::string key;
  std::uintmax_t bytes = 0;
  in >> key >> bytes;
  REQUIRE(key == "rchar:");
  return bytes;
}

/// Bytes that an append of one entry to so many reads, by two workers in turns, so that what SQLite has of the file in
/// memory is never good, and with one answer that waits.
double read_by_an_append(const std::string& store, std::size_t entries) {
  SqliteStore one(store, "p"), other(store, "p");
  fill(one, entries);
  one.deliver(1, entry(entries + 1'000'000));
  other.entries();
  const std::uintmax_t before = bytes_read();
  constexpr std::size_t appends = 20;
  for (std::size_t k = 1; k <= appends; ++k) fill(k % 2 == 0 ? one : other, entries + k);
  return double(bytes_read() - before) / double(appends);
}

}  // namespace

TEST_CASE("An append reads no more of a long store than of a short one") {
  const TemporaryFolder folder;
  const double first = read_by_an_append(folder / "store", 100), later = read_by_an_append(folder / "store", 1500);
  CHECK(later < first + 50'000.0);
  CHECK(double(fs::file_size(folder / "store")) > first + 500'000.0);  // which would be seen
}

TEST_CASE("An append reads no more of a store of 10,000 entries than of a short one", "[long]") {
  const TemporaryFolder folder;
  const double first = read_by_an_append(folder / "store", 100), later = read_by_an_append(folder / "store", 10'000);
  WARN("an append reads " << first << " bytes after 100 entries, " << later << " after 10,000");
  CHECK(later < first + 50'000.0);
}

TEST_CASE("A store is made under every locale, and is the same") {
  const TemporaryFolder folder;
  SqliteStore plain(folder / "plain", "p");
  fill(plain, 3);
  const GermanLocale german;
  SqliteStore log(folder / "german", "p");
  fill(log, 3);
  CHECK(log.digest() == plain.digest());
  CHECK(folder.read("german") == folder.read("plain"));
}

TEST_CASE("Every name of a store is a file's name") {
  const TemporaryFolder folder;
  CHECK(in_child([&] {
    fs::current_path(folder.path);
    for (const char* name : {":memory:", "file:kept.db?mode=memory", "file::memory:", "file:plain"}) {
      {
        SqliteStore log(name, "p");
        fill(log, 2);
      }
      if (SqliteStore(name).entries().size() != 3) throw Error(name);
    }
  }) == 0);
  CHECK(folder.entries() == 4);
  CHECK(fs::exists(folder / ":memory:"));
  CHECK(reason_of([] { SqliteStore log("", "p"); }) == StoreError::Reason::unusable);
}

TEST_CASE("A store that is removed, renamed or replaced keeps the finished evaluation beside it") {
  for (const std::string how : {"removed", "renamed", "replaced"}) {
    const TemporaryFolder folder;
    const std::string store = folder / "store";
    Problem p;
    p.space.variables = {{"a", 0.0, 10.0, 1.0, ""}};
    p.objectives = {{"f", true, 0.0}};
    p.sobol = 3;
    p.evaluations = 5;
    SqliteStore log(store, "p");
    int evaluations = 0;
    const auto evaluate = [&](const Design& x) {
      if (++evaluations == 2) {
        if (how == "renamed") fs::rename(store, folder / "elsewhere");
        else fs::remove(store);
        if (how == "replaced") SqliteStore(store, "p");
      }
      return TrialResult{{x[0]}, false, "", "hours of work", ""};
    };
    std::string why;
    try {
      run_campaign(log, Optimizer<>(p), evaluate, [](const auto&, int, const TrialResult&) {});
    } catch (const StoreError& e) {
      why = e.what();
    }
    CHECK(evaluations == 2);
    CHECK_THAT(why, Catch::Contains(how) && Catch::Contains("store.rescued-1"));
    SqliteStore kept(folder / "store.rescued-1");
    kept.verify();
    REQUIRE(kept.entries().size() == 5);
    CHECK(kept.record(4) == "hours of work");
    run_campaign(kept, Optimizer<>(p), evaluate, [](const auto&, int, const TrialResult&) {});  // it goes on from there
    CHECK(evaluations == 5);
  }
}

TEST_CASE("A store with a stranger's trigger or view is refused, and nothing of it is carried out") {
  const TemporaryFolder folder;
  for (const char* sql : {"CREATE TRIGGER t AFTER INSERT ON entry BEGIN DELETE FROM entry WHERE number = 2; END",
           "CREATE VIEW v AS SELECT 1", "CREATE TABLE more(a)",
           "ALTER TABLE entry RENAME TO hidden; CREATE VIEW entry AS WITH RECURSIVE r(number) AS (SELECT 0 UNION ALL "
           "SELECT number + 1 FROM r) SELECT number, '' AS kind, '' AS content, '' AS record, '' AS notes, '' AS "
           "digest FROM r"}) {
    fs::remove(folder / "store");
    {
      SqliteStore log(folder / "store", "p");
      fill(log, 3);
    }
    sqlite3* stranger = nullptr;
    REQUIRE(sqlite3_open(std::string(folder / "store").c_str(), &stranger) == SQLITE_OK);
    REQUIRE(sqlite3_exec(stranger, sql, nullptr, nullptr, nullptr) == SQLITE_OK);
    sqlite3_close(stranger);
    const std::string before = folder.read("store");
    CHECK(reason_of([&] { SqliteStore log(folder / "store", "p"); }) == StoreError::Reason::corrupt);
    CHECK(reason_of([&] { SqliteStore log(folder / "store"); }) == StoreError::Reason::corrupt);
    CHECK(folder.read("store") == before);
  }
}

TEST_CASE("A journal that is open sees what others append, and damage to what it has not read") {
  const TemporaryFolder folder;
  SqliteStore mine(folder / "store", "p"), other(folder / "store", "p");
  fill(mine, 2);
  fill(other, 5);
  fill(mine, 6);
  CHECK(mine.entries().size() == 7);
  CHECK(other.entries().size() == 7);
  CHECK(mine.digest() == other.digest());
  fill(mine, 8);
  sqlite3* stranger = nullptr;
  REQUIRE(sqlite3_open(std::string(folder / "store").c_str(), &stranger) == SQLITE_OK);
  REQUIRE(sqlite3_exec(stranger, "UPDATE entry SET content = 'x' WHERE number = 8", nullptr, nullptr, nullptr) ==
          SQLITE_OK);
  sqlite3_close(stranger);
  CHECK(reason_of([&] { other.entries(); }) == StoreError::Reason::corrupt);
}
